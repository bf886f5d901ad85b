//! What slices keep and drop, and what they look like as code.
#![allow(clippy::unwrap_used, clippy::panic)]

mod common;

use naga::ShaderStage;
use preshade_passes::graph::Graph;
use preshade_passes::place::{self, PositionInvariance};
use preshade_passes::program::Program;
use preshade_passes::slice::{self, Criterion, OutputFilter};

fn sliced(program: &Program, stage: ShaderStage, name: &str, criteria: &[Criterion]) -> Program {
    let graph = Graph::build(program);
    let (entry, _) = program.entry_point(stage, name).unwrap();
    let slice = slice::backward(&graph, entry, criteria);
    let placed = place::entry_point(
        &graph,
        &slice,
        program.module(),
        "sliced",
        "depth",
        PositionInvariance::AsWritten,
    );
    common::validated(program, placed.clone());
    common::validated(program, place::retain(&placed, &[(stage, "sliced")]))
}

fn position(source: &str) -> String {
    common::wgsl(&sliced(
        &common::program(source),
        ShaderStage::Vertex,
        "vs",
        &[Criterion::Output(OutputFilter::Position)],
    ))
}

fn discard(source: &str) -> String {
    common::wgsl(&sliced(
        &common::program(source),
        ShaderStage::Fragment,
        "fs",
        &[
            Criterion::Discard,
            Criterion::Output(OutputFilter::FragDepth),
        ],
    ))
}

const LIT: &str = "
struct Camera { view: mat4x4<f32>, projection: mat4x4<f32>, time: f32 }
@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<uniform> light: vec4<f32>;
struct VertexInput { @location(0) position: vec3<f32>, @location(1) normal: vec3<f32>, @location(2) uv: vec2<f32> }
struct VertexOutput { @builtin(position) clip: vec4<f32>, @location(0) normal: vec3<f32>, @location(1) uv: vec2<f32>, @location(2) glow: f32 }
fn noise(p: vec3<f32>) -> f32 {
    var sum = 0.0;
    for (var i = 0; i < 8; i++) { sum += sin(p.x * f32(i)) * light.w; }
    return sum;
}
fn wave(p: vec3<f32>) -> vec3<f32> { return p + vec3(0.0, sin(camera.time + p.x), 0.0); }
@vertex fn vs(in: VertexInput, @builtin(instance_index) instance: u32) -> VertexOutput {
    var out: VertexOutput;
    let world = wave(in.position);
    out.glow = noise(in.position) + f32(instance);
    out.normal = in.normal;
    out.uv = in.uv;
    out.clip = camera.projection * camera.view * vec4(world, 1.0);
    return out;
}
@group(1) @binding(0) var albedo: texture_2d<f32>;
@group(1) @binding(1) var smp: sampler;
struct Surface { color: vec3<f32>, alpha: f32 }
fn surface(in: VertexOutput) -> Surface {
    let texel = textureSample(albedo, smp, in.uv);
    return Surface(texel.rgb * noise(in.normal), texel.a);
}
@fragment fn fs(in: VertexOutput) -> @location(0) vec4<f32> {
    let s = surface(in);
    if s.alpha < 0.5 { discard; }
    return vec4(s.color * in.glow, 1.0);
}
";

#[test]
fn position_slice_of_a_lit_material() {
    insta::assert_snapshot!(position(LIT));
}

#[test]
fn discard_slice_of_a_lit_material() {
    insta::assert_snapshot!(discard(LIT));
}

#[test]
fn dump() {
    let p = common::program(LIT);
    let g = Graph::build(&p);
    println!("{}", g.to_dot());
}
