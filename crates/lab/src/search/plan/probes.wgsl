// Frames that ask for one kind of work each: much or little of it, by the entry points that are taken.

struct Probe {
    view_proj: mat4x4<f32>,
}

@group(0) @binding(0) var<uniform> probe: Probe;
@group(0) @binding(1) var<uniform> model: mat4x4<f32>;
@group(0) @binding(2) var noise: texture_2d<f32>;
@group(0) @binding(3) var noise_sampler: sampler;

struct VertexOut {
    @builtin(position) clip: vec4<f32>,
    @location(0) place: vec3<f32>,
}

// About ten operations.
fn turn(v: vec3<f32>) -> vec3<f32> {
    return v.yzx * 0.99 + sin(v) * 0.01;
}

@vertex
fn vs_cheap(@location(0) position: vec3<f32>) -> VertexOut {
    let world = model * vec4<f32>(position, 1.0);
    return VertexOut(probe.view_proj * world, world.xyz);
}

@vertex
fn vs_dear(@location(0) position: vec3<f32>) -> VertexOut {
    let world = model * vec4<f32>(position, 1.0);
    var place = world.xyz;
    for (var i = 0; i < 64; i++) {
        place = turn(place);
    }
    return VertexOut(probe.view_proj * world, place);
}

@fragment
fn fs_flat() -> @location(0) vec4<f32> {
    return vec4<f32>(0.5, 0.6, 0.7, 1.0);
}

@fragment
fn fs_some(in: VertexOut) -> @location(0) vec4<f32> {
    var v = in.place;
    for (var i = 0; i < 16; i++) {
        v = turn(v);
    }
    return vec4<f32>(v, 1.0);
}

@fragment
fn fs_much(in: VertexOut) -> @location(0) vec4<f32> {
    var v = in.place;
    for (var i = 0; i < 128; i++) {
        v = turn(v);
    }
    return vec4<f32>(v, 1.0);
}

@fragment
fn fs_taps(in: VertexOut) -> @location(0) vec4<f32> {
    var sum = vec4<f32>(0.0);
    for (var i = 0; i < 16; i++) {
        sum += textureSampleLevel(noise, noise_sampler, in.place.xy * (0.1 + f32(i) * 0.3), 0.0);
    }
    return sum / 16.0;
}
