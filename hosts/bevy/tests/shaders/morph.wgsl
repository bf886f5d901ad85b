// Morph targets, as a shader of an author's own applies them.
#import bevy_pbr::{
    mesh_functions,
    morph,
    mesh_bindings::mesh,
    forward_io::{Vertex, VertexOutput},
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

@vertex
fn vertex(in: Vertex) -> VertexOutput {
    var out: VertexOutput;
    let model = mesh_functions::get_world_from_local(in.instance_index);
    let position = morphed(in.position, in.index, in.instance_index);
    out.world_position = model * vec4(position, 1.0);
    out.position = position_world_to_clip(out.world_position.xyz);
    out.world_normal = mesh_functions::mesh_normal_local_to_world(in.normal, in.instance_index);
    return out;
}

@fragment
fn fragment(in: VertexOutput) -> @location(0) vec4<f32> {
    let light = max(dot(normalize(in.world_normal), vec3(0.3, 0.9, 0.3)), 0.1);
    return vec4(vec3(0.5, 0.5, 0.9) * light * values.unused, 1.0);
}
