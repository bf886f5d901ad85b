//! What is emitted reads back, keeps the author's interface, and is the same bytes each time.
#![allow(clippy::unwrap_used, clippy::panic)]
#![cfg(all(feature = "glsl", feature = "spirv"))]

#[path = "accept/mod.rs"]
mod accept;

use preshade::emit::{self, File, Target};
use preshade::front::{self, Color, Source};
use preshade_passes::plan::Plan;
use preshade_passes::state::MaterialState;

const LIT: &str = r"
struct Camera {
    view_proj: mat4x4<f32>,
    eye: vec3<f32>,
}
@group(0) @binding(0) var<uniform> camera: Camera;
@group(1) @binding(0) var albedo: texture_2d<f32>;
@group(1) @binding(1) var linear_sampler: sampler;

struct Varyings {
    @builtin(position) @invariant clip: vec4<f32>,
    @location(0) uv0: vec2<f32>,
    @location(1) normal: vec3<f32>,
}

fn shade(n: vec3<f32>, albedo1: vec3<f32>) -> vec3<f32> {
    let light = normalize(vec3<f32>(1.0, 2.0, 3.0));
    return albedo1 * max(dot(n, light), 0.1);
}

@vertex
fn vs_main(@location(0) position: vec3<f32>, @location(1) normal: vec3<f32>, @location(2) uv: vec2<f32>) -> Varyings {
    var out: Varyings;
    out.clip = camera.view_proj * vec4<f32>(position, 1.0);
    out.uv0 = uv;
    out.normal = normal;
    return out;
}

@fragment
fn fs_main(in: Varyings) -> @location(0) vec4<f32> {
    let texel = textureSample(albedo, linear_sampler, in.uv0);
    if texel.a < 0.5 {
        discard;
    }
    let color = shade(normalize(in.normal), texel.rgb);
    return vec4<f32>(color, texel.a);
}
";

/// Loops, a switch, early returns, an array, a private global, padded structs, names that end in digits.
const EVERYTHING: &str = r"
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
";

fn plan(name: &str, text: &str) -> Plan {
    let parsed = front::parse(&[Source::new(name, text)], &front::Options::default())
        .unwrap_or_else(|e| panic!("{}", e.render(Color::Never)));
    Plan::original(
        "material",
        parsed.program,
        &parsed.vertex,
        parsed.fragment.as_deref(),
        &MaterialState::default(),
    )
}

fn emit_all(plan: &Plan) -> Vec<File> {
    emit::emit(plan, &Target::ALL, &emit::Options::default()).unwrap()
}

fn text<'a>(files: &'a [File], name: &str) -> &'a str {
    let file = files.iter().find(|f| f.name == name).unwrap();
    std::str::from_utf8(&file.bytes).unwrap()
}

#[test]
fn a_material_is_written_in_every_target() {
    let files = emit_all(&plan("lit.wgsl", LIT));
    let names: Vec<&str> = files.iter().map(|f| f.name.as_str()).collect();
    assert_eq!(
        names,
        [
            "material.main.wgsl",
            "material.main.vert.spv",
            "material.main.frag.spv",
            "material.main.vert",
            "material.main.frag",
            "material.main.es.vert",
            "material.main.es.frag",
            "material.plan.json",
        ]
    );
    insta::assert_snapshot!("lit_wgsl", text(&files, "material.main.wgsl"));
    insta::assert_snapshot!("lit_es_frag", text(&files, "material.main.es.frag"));
    insta::assert_snapshot!("lit_plan", text(&files, "material.plan.json"));
}

#[test]
fn the_same_plan_gives_the_same_bytes() {
    let plan = plan("lit.wgsl", LIT);
    assert_eq!(emit_all(&plan), emit_all(&plan));
}

#[test]
fn other_compilers_take_every_target() {
    let sets: Vec<(String, Vec<File>)> = [("lit", LIT), ("everything", EVERYTHING)]
        .map(|(name, text)| {
            (
                name.to_owned(),
                emit_all(&plan(&format!("{name}.wgsl"), text)),
            )
        })
        .into();
    let judged = accept::accept(&sets);
    assert_eq!((judged.wgsl, judged.spirv, judged.glsl), (2, 4, 8));
}

#[test]
fn text_reads_like_an_authors() {
    let files = emit_all(&plan("everything.wgsl", EVERYTHING));
    insta::assert_snapshot!("everything_wgsl", text(&files, "material.main.wgsl"));
}
