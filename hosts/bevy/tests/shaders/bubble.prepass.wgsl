// The pre-pass of bubble.wgsl by hand: what the derived one is compared with.
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

fn bulged(position: vec3<f32>, time: f32) -> vec4<f32> {
    return vec4(position * (1.0 + sin(time * values.rate * 3.0 + position.y * 6.0) * values.amount * 0.5), 1.0);
}

@vertex
fn vertex(in: Vertex) -> VertexOutput {
    var out: VertexOutput;
    let model = mesh_functions::get_world_from_local(in.instance_index);
    out.world_position = model * bulged(in.position, globals.time);
    out.position = position_world_to_clip(out.world_position.xyz);
#ifdef MOTION_VECTOR_PREPASS
    let previous_model = mesh_functions::get_previous_world_from_local(in.instance_index);
    out.previous_world_position = previous_model * bulged(in.position, globals.time - globals.delta_time);
#endif
    return out;
}

#ifdef PREPASS_FRAGMENT
@fragment
fn fragment(in: VertexOutput) -> FragmentOutput {
    var out: FragmentOutput;
#ifdef NORMAL_PREPASS
    // Of the triangle: the mesh's normal is that of a sphere.
    let normal = normalize(cross(dpdy(in.world_position.xyz), dpdx(in.world_position.xyz)));
    out.normal = vec4(normal * 0.5 + vec3(0.5), 1.0);
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
}
#endif
