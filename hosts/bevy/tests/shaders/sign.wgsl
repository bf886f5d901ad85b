// It always faces the camera.
#import bevy_pbr::{
    mesh_functions,
    forward_io::{Vertex, VertexOutput},
    mesh_view_bindings::view,
    view_transformations::position_world_to_clip,
}

struct Values { amount: f32, cutoff: f32, rate: f32, unused: f32 }
@group(#{MATERIAL_BIND_GROUP}) @binding(0) var<uniform> values: Values;

fn facing(center: vec3<f32>, eye: vec3<f32>, position: vec3<f32>) -> vec4<f32> {
    let forward = normalize(eye - center);
    let right = normalize(cross(vec3(0.0, 1.0, 0.0), forward));
    return vec4(center + right * position.x + cross(forward, right) * position.y + forward * position.z * 0.1, 1.0);
}

@vertex
fn vertex(in: Vertex) -> VertexOutput {
    var out: VertexOutput;
    let model = mesh_functions::get_world_from_local(in.instance_index);
    out.world_position = facing(model[3].xyz, view.world_position, in.position);
    out.position = position_world_to_clip(out.world_position.xyz);
    out.world_normal = mesh_functions::mesh_normal_local_to_world(in.normal, in.instance_index);
    return out;
}

// The argument has the name of one of Bevy's variables, as in its examples.
@fragment
fn fragment(mesh: VertexOutput) -> @location(0) vec4<f32> {
    let light = max(dot(normalize(mesh.world_normal), vec3(0.3, 0.9, 0.3)), 0.1);
    return vec4(vec3(0.9, 0.5, 0.2) * light * values.unused, 1.0);
}
