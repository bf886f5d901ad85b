// A material that moves its vertices by a number that is part of the text.
#import bevy_pbr::{
    forward_io::{Vertex, VertexOutput},
    mesh_functions,
    view_transformations::position_world_to_clip,
}

@group(#{MATERIAL_BIND_GROUP}) @binding(0) var<uniform> amount: f32;

@vertex
fn vertex(in: Vertex) -> VertexOutput {
    var out: VertexOutput;
    let model = mesh_functions::get_world_from_local(in.instance_index);
    let moved = in.position * (1.0 + amount * sin(f32(#{NUMBER})));
    out.world_position = mesh_functions::mesh_position_local_to_world(model, vec4(moved, 1.0));
    out.position = position_world_to_clip(out.world_position.xyz);
    out.world_normal = mesh_functions::mesh_normal_local_to_world(in.normal, in.instance_index);
    return out;
}

@fragment
fn fragment(in: VertexOutput) -> @location(0) vec4<f32> {
    if fract(in.world_normal.x * f32(#{NUMBER})) < 0.1 {
        discard;
    }
    return vec4(in.world_normal, 1.0);
}
