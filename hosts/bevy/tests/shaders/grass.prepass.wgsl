// The pre-pass of grass.wgsl by hand: what the derived one is compared with.
#import bevy_pbr::{
    prepass_bindings,
    prepass_io::{Vertex, VertexOutput, FragmentOutput},
    mesh_functions,
    mesh_view_bindings::view,
    view_transformations::position_world_to_clip,
}

#import bevy_render::globals::Globals
@group(0) @binding(1) var<uniform> globals: Globals;
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
    out.uv = in.uv;
#ifdef NORMAL_PREPASS_OR_DEFERRED_PREPASS
    out.world_normal = mesh_functions::mesh_normal_local_to_world(in.normal, in.instance_index);
#endif
#ifdef MOTION_VECTOR_PREPASS
    let previous_model = mesh_functions::get_previous_world_from_local(in.instance_index);
    out.previous_world_position = swayed(previous_model * vec4(in.position, 1.0), globals.time - globals.delta_time);
#endif
    return out;
}

#ifdef PREPASS_FRAGMENT
@fragment
fn fragment(in: VertexOutput) -> FragmentOutput {
    var out: FragmentOutput;
    let texel = textureSample(picture, picture_sampler, in.uv);
    if texel.a < values.cutoff {
        discard;
    }
#ifdef NORMAL_PREPASS
    out.normal = vec4(normalize(in.world_normal) * 0.5 + vec3(0.5), 1.0);
#endif
#ifdef MOTION_VECTOR_PREPASS
    let now = view.unjittered_clip_from_world * in.world_position;
    let before = prepass_bindings::previous_view_uniforms.clip_from_world * in.previous_world_position;
    out.motion_vector = (now.xy / now.w - before.xy / before.w) * vec2(0.5, -0.5);
#endif
    return out;
}
#else
@fragment
fn fragment(in: VertexOutput) {
    let texel = textureSample(picture, picture_sampler, in.uv);
    if texel.a < values.cutoff {
        discard;
    }
}
#endif
