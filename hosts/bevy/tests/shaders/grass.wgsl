// It sways in the wind, and its texture cuts it out.
#import bevy_pbr::{
    mesh_functions,
    forward_io::{Vertex, VertexOutput},
    mesh_view_bindings::globals,
    view_transformations::position_world_to_clip,
}

struct Values { amount: f32, cutoff: f32, rate: f32, unused: f32 }
@group(#{MATERIAL_BIND_GROUP}) @binding(0) var<uniform> values: Values;
@group(#{MATERIAL_BIND_GROUP}) @binding(1) var picture: texture_2d<f32>;
@group(#{MATERIAL_BIND_GROUP}) @binding(2) var picture_sampler: sampler;

fn swayed(world: vec4<f32>, time: f32) -> vec4<f32> {
    return world + vec4(sin(time * values.rate + world.z) * values.amount * world.y, 0.0, 0.0, 0.0);
}

@vertex
fn vertex(in: Vertex) -> VertexOutput {
    var out: VertexOutput;
    let model = mesh_functions::get_world_from_local(in.instance_index);
    out.world_position = swayed(model * vec4(in.position, 1.0), globals.time);
    out.position = position_world_to_clip(out.world_position.xyz);
    out.world_normal = mesh_functions::mesh_normal_local_to_world(in.normal, in.instance_index);
    out.uv = in.uv;
    return out;
}

@fragment
fn fragment(in: VertexOutput) -> @location(0) vec4<f32> {
    let texel = textureSample(picture, picture_sampler, in.uv);
    if texel.a < values.cutoff {
        discard;
    }
    let light = max(dot(normalize(in.world_normal), vec3(0.3, 0.9, 0.3)), 0.1);
    return vec4(texel.rgb * light, 1.0);
}
