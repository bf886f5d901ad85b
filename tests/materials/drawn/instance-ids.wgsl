// A list of visible objects, and the matrices that it points to.
struct Viewer {
    m: mat4x4<f32>,
}

@group(0) @binding(0) var<uniform> viewer: Viewer;
@group(0) @binding(1) var<storage, read> visible: array<u32>;
@group(0) @binding(2) var<storage, read> locals: array<mat4x4<f32>>;

struct Varyings {
    @builtin(position) clip: vec4<f32>,
    @location(0) up: f32,
}

@vertex
fn vs(@builtin(instance_index) i: u32, @location(0) p: vec3<f32>) -> Varyings {
    let world = locals[visible[i]] * vec4<f32>(p, 1.0);
    return Varyings(viewer.m * world, world.y);
}

@fragment
fn fs(in: Varyings) -> @location(0) vec4<f32> {
    return vec4<f32>(fract(in.up), 0.5, 0.7, 1.0);
}
