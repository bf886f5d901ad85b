// Writes the numbers of a texture as depths.

@group(0) @binding(0) var numbers: texture_2d<f32>;

@vertex
fn everywhere(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {
    return vec4f(f32(i & 1u) * 4.0 - 1.0, f32(i >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

@fragment
fn stored(@builtin(position) at: vec4f) -> @builtin(frag_depth) f32 {
    return textureLoad(numbers, vec2u(at.xy), 0).r;
}
