//! What is emitted reads back, keeps the author's interface, and is the same bytes each time.
#![allow(clippy::unwrap_used, clippy::panic)]
#![cfg(all(feature = "glsl", feature = "spirv"))]

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
