struct Light {
    @size(32) position1: vec3<f32>,
    @align(16) color: vec3<f32>,
    range: f32,
}
struct Params {
    lights: array<Light, 4>,
    count: u32,
    @align(64) tail: vec2<f32>,
}
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(3) var map2: texture_2d_array<f32>;
@group(0) @binding(2) var s: sampler;
var<private> seed: u32 = 1u;
const STEPS: i32 = 4;

fn random() -> f32 {
    seed = seed * 1664525u + 1013904223u;
    return f32(seed >> 8u) / 16777216.0;
}

fn fbm(p0: vec2<f32>) -> f32 {
    var p = p0;
    var sum = 0.0;
    var amplitude = 0.5;
    for (var i = 0; i < STEPS; i++) {
        sum += amplitude * sin(p.x * 1.7 + p.y);
        p = p * 2.0 + vec2(random(), 0.5);
        if sum > 10.0 { return 10.0; }
        amplitude *= 0.5;
    }
    return sum;
}

fn pick(i: u32) -> vec3<f32> {
    switch i {
        case 0u, 1u: { return vec3(1.0, 0.0, 0.0); }
        case 2u: { break; }
        default: { return params.lights[i & 3u].color; }
    }
    return vec3(0.0);
}

struct Out {
    @invariant @builtin(position) clip: vec4f,
    @location(0) uv: vec2f,
    @location(1) @interpolate(flat) id: u32,
    @location(2) @interpolate(perspective, centroid) fade: f32,
}

@vertex
fn vs(@builtin(vertex_index) index: u32, @builtin(instance_index) instance: u32, @location(0) position: vec3f) -> Out {
    var out: Out;
    let wave = fbm(position.xz);
    out.clip = vec4f(position + vec3f(0.0, wave, 0.0), 1.0);
    out.uv = position.xy;
    out.id = index + instance;
    out.fade = params.tail.x;
    return out;
}

struct Targets {
    @location(0) color: vec4f,
    @location(1) normal: vec4f,
    @builtin(frag_depth) depth: f32,
}

@fragment
fn fs(@builtin(position) at: vec4f, @location(0) uv: vec2f, @location(1) @interpolate(flat) id: u32, @location(2) @interpolate(perspective, centroid) fade: f32, @builtin(front_facing) front: bool) -> Targets {
    let dx = dpdx(uv);
    let dy = dpdy(uv);
    var color = textureSampleGrad(map2, s, uv, i32(id), dx, dy);
    var i = 0u;
    loop {
        if i >= params.count { break; }
        let light = params.lights[i];
        if light.range < 0.0 { i++; continue; }
        color += vec4f(light.color * fade, 0.0);
        i++;
    }
    if color.a < 0.1 { discard; }
    var out: Targets;
    out.color = vec4f(color.rgb * pick(id), color.a);
    out.normal = vec4f(select(-1.0, 1.0, front));
    out.depth = at.z + 0.25 * fade;
    return out;
}
