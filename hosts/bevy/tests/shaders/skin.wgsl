// A skin, with a wave on top.
#import bevy_pbr::{
    mesh_functions,
    skinning,
    forward_io::{Vertex, VertexOutput},
    mesh_view_bindings::globals,
    view_transformations::position_world_to_clip,
}

struct Values { amount: f32, cutoff: f32, rate: f32, unused: f32 }
@group(#{MATERIAL_BIND_GROUP}) @binding(0) var<uniform> values: Values;

fn waved(world: vec4<f32>, time: f32) -> vec4<f32> {
    return world + vec4(0.0, 0.0, sin(time * values.rate + world.y * 4.0) * values.amount, 0.0);
}

@vertex
fn vertex(in: Vertex) -> VertexOutput {
    var out: VertexOutput;
    let model = skinning::skin_model(in.joint_indices, in.joint_weights, in.instance_index);
    out.world_position = waved(model * vec4(in.position, 1.0), globals.time);
    out.position = position_world_to_clip(out.world_position.xyz);
    out.world_normal = skinning::skin_normals(model, in.normal);
    return out;
}

@fragment
fn fragment(in: VertexOutput) -> @location(0) vec4<f32> {
    let light = max(dot(normalize(in.world_normal), vec3(0.3, 0.9, 0.3)), 0.1);
    return vec4(vec3(0.8, 0.6, 0.4) * light, 1.0);
}
