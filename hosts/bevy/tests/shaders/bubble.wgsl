// A soap bubble: it wobbles, and has neither light nor a normal.
#import bevy_pbr::{
    mesh_functions,
    forward_io::{Vertex, VertexOutput},
    mesh_view_bindings::globals,
    view_transformations::position_world_to_clip,
}

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
    return out;
}

@fragment
fn fragment(in: VertexOutput) -> @location(0) vec4<f32> {
    return vec4(0.5 + 0.5 * cos(in.world_position.y * vec3(9.0, 10.0, 11.0)), 1.0);
}
