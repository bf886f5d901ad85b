// Eight floats a vertex in one buffer: position, normal, texture coordinates.
@group(0) @binding(0) var<uniform> transformationMatrix: mat4x4<f32>;
@group(0) @binding(1) var<uniform> cameraMatrix: mat4x4<f32>;
@group(1) @binding(0) var<storage, read> stream: array<f32>;

const STRIDE = 8u;

struct Varyings {
    @builtin(position) clip: vec4<f32>,
    @location(0) normal: vec3<f32>,
}

fn three(first: u32) -> vec3<f32> {
    return vec3<f32>(stream[first], stream[first + 1u], stream[first + 2u]);
}

@vertex
fn vs(@builtin(vertex_index) number: u32) -> Varyings {
    let base = number * STRIDE;
    let world = transformationMatrix * vec4<f32>(three(base), 1.0);
    return Varyings(cameraMatrix * world, three(base + 3u));
}

@fragment
fn fs(in: Varyings) -> @location(0) vec4<f32> {
    return vec4<f32>(0.5 + 0.5 * normalize(in.normal), 1.0);
}
