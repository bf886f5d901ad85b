struct Light { ambient: vec3<f32> }
@group(0) @binding(0) var<uniform> light: Light;
@group(0) @binding(1) var albedo: texture_2d<f32>;
@group(0) @binding(2) var albedo_sampler: sampler;

struct Varyings { @builtin(position) clip: vec4<f32>, @location(0) uv: vec2<f32> }

@vertex fn vs(@location(0) position: vec3<f32>, @location(1) uv: vec2<f32>) -> Varyings {
    return Varyings(vec4<f32>(position, 1.0), uv);
}

@fragment fn fs(in: Varyings) -> @location(0) vec4<f32> {
    return textureSample(albedo, albedo_sampler, in.uv) * vec4<f32>(light.ambient, 1.0);
}
