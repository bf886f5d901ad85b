// The pre-pass of morph.wgsl by hand: what the derived one is compared with.
#import bevy_pbr::{
    prepass_bindings,
    prepass_io::{Vertex, VertexOutput, FragmentOutput},
    mesh_functions,
    morph,
    mesh_bindings::mesh,
    mesh_view_bindings::view,
    view_transformations::position_world_to_clip,
}

struct Values { amount: f32, cutoff: f32, rate: f32, unused: f32 }
@group(#{MATERIAL_BIND_GROUP}) @binding(0) var<uniform> values: Values;

fn morphed(position: vec3<f32>, index: u32, instance: u32) -> vec3<f32> {
    var sum = position;
    let vertex = index - mesh[instance].first_vertex_index;
    for (var i = 0u; i < morph::layer_count(instance); i++) {
        sum += morph::weight_at(i, instance) * morph::morph_position(vertex, i, instance);
    }
    return sum;
}

fn morphed_before(position: vec3<f32>, index: u32, instance: u32) -> vec3<f32> {
    var sum = position;
    let vertex = index - mesh[instance].first_vertex_index;
    for (var i = 0u; i < morph::layer_count(instance); i++) {
        sum += morph::prev_weight_at(i, instance) * morph::morph_position(vertex, i, instance);
    }
    return sum;
}

@vertex
fn vertex(in: Vertex) -> VertexOutput {
    var out: VertexOutput;
    let model = mesh_functions::get_world_from_local(in.instance_index);
    let position = morphed(in.position, in.index, in.instance_index);
    out.world_position = model * vec4(position, 1.0);
    out.position = position_world_to_clip(out.world_position.xyz);
#ifdef NORMAL_PREPASS_OR_DEFERRED_PREPASS
    out.world_normal = mesh_functions::mesh_normal_local_to_world(in.normal, in.instance_index);
#endif
#ifdef MOTION_VECTOR_PREPASS
    let previous_model = mesh_functions::get_previous_world_from_local(in.instance_index);
    out.previous_world_position = previous_model * vec4(morphed_before(in.position, in.index, in.instance_index), 1.0);
#endif
    return out;
}

#ifdef PREPASS_FRAGMENT
@fragment
fn fragment(in: VertexOutput) -> FragmentOutput {
    var out: FragmentOutput;
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
}
#endif
