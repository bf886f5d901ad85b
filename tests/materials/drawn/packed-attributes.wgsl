// Quantised vertices: half floats for the position, signed bytes for the normal.
struct Scene {
    clipFromObject: mat4x4<f32>,
    extent: f32,
}

@group(0) @binding(0) var<uniform> scene: Scene;

struct Varyings {
    @builtin(position) clip: vec4<f32>,
    @location(0) normal: vec3<f32>,
}

@vertex
fn vs(@location(0) halves: vec2<u32>, @location(1) bytes: u32) -> Varyings {
    let place = vec3<f32>(unpack2x16float(halves.x), unpack2x16float(halves.y).x);
    return Varyings(scene.clipFromObject * vec4<f32>(place * scene.extent, 1.0), unpack4x8snorm(bytes).xyz);
}

@fragment
fn fs(in: Varyings) -> @location(0) vec4<f32> {
    return vec4<f32>(0.5 + 0.5 * in.normal, 1.0);
}
