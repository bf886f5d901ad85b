// A sky at the far plane: a box around the eye, whose view matrix only turns.
struct Sky {
    lens: mat4x4<f32>,
    turn: mat4x4<f32>,
}

@group(0) @binding(0) var<uniform> sky: Sky;
@group(0) @binding(1) var stars: texture_cube<f32>;
@group(0) @binding(2) var smooth_sampler: sampler;

struct Varyings {
    @builtin(position) clip: vec4<f32>,
    @location(0) direction: vec3<f32>,
}

@vertex
fn vs(@location(0) p: vec3<f32>) -> Varyings {
    let clip = sky.lens * vec4<f32>((sky.turn * vec4<f32>(p, 0.0)).xyz, 1.0);
    return Varyings(clip.xyww, p);
}

@fragment
fn fs(in: Varyings) -> @location(0) vec4<f32> {
    return textureSample(stars, smooth_sampler, in.direction);
}
