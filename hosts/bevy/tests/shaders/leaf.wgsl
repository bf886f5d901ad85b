// The mesh's own vertex stage, and a fragment stage whose alpha says how much of a pixel is covered.
#import bevy_pbr::{
    forward_io::VertexOutput,
}

@fragment
fn fragment(in: VertexOutput) -> @location(0) vec4<f32> {
    let alpha = saturate(2.0 - 4.5 * length(fract(in.uv * 6.0) - 0.5));
    let light = max(dot(normalize(in.world_normal), vec3(0.3, 0.9, 0.3)), 0.1);
    return vec4(vec3(0.3, 0.8, 0.2) * light, alpha);
}
