// Its discard reads the lights, which a pre-pass does not have.
#import bevy_pbr::{forward_io::VertexOutput, mesh_view_bindings::lights}

@fragment
fn fragment(in: VertexOutput) -> @location(0) vec4<f32> {
    if f32(lights.n_directional_lights) + in.uv.x > 1.5 {
        discard;
    }
    return vec4(1.0);
}
