// Vertices and their indices from storage buffers, neither named as such.
struct Camera {
    worldToScreen: mat4x4<f32>,
}

struct Point {
    shade: vec4<f32>,
    at: vec3<f32>,
    chart: vec2<f32>,
}

@group(0) @binding(0) var<uniform> cam: Camera;
@group(0) @binding(1) var<storage, read> points: array<Point>;
@group(0) @binding(2) var<storage, read> order: array<u32>;

struct Varyings {
    @builtin(position) clip: vec4<f32>,
    @location(0) shade: vec4<f32>,
}

@vertex
fn main_vs(@builtin(vertex_index) number: u32) -> Varyings {
    let point = points[order[number]];
    return Varyings(cam.worldToScreen * vec4<f32>(point.at, 1.0), point.shade);
}

@fragment
fn main_fs(in: Varyings) -> @location(0) vec4<f32> {
    return in.shade;
}
