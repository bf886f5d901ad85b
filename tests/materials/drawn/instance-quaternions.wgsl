// Instances from a buffer: place, turn as a quaternion, and size.
struct Thing {
    place: vec3<f32>,
    size: f32,
    turn: vec4<f32>,
}

@group(0) @binding(0) var<uniform> toScreen: mat4x4<f32>;
@group(0) @binding(1) var<storage, read> things: array<Thing>;

struct Varyings {
    @builtin(position) clip: vec4<f32>,
    @location(0) normal: vec3<f32>,
}

fn turned(v: vec3<f32>, q: vec4<f32>) -> vec3<f32> {
    return v + 2.0 * cross(q.xyz, cross(q.xyz, v) + q.w * v);
}

@vertex
fn vs(@builtin(instance_index) i: u32, @location(0) p: vec3<f32>, @location(1) n: vec3<f32>) -> Varyings {
    let thing = things[i];
    let world = turned(p, thing.turn) * thing.size + thing.place;
    return Varyings(toScreen * vec4<f32>(world, 1.0), turned(n, thing.turn));
}

@fragment
fn fs(in: Varyings) -> @location(0) vec4<f32> {
    return vec4<f32>(0.5 + 0.5 * in.normal, 1.0);
}
