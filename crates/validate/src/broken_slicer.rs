//! Tests that validation detects a faulty slicer. If the same fault affects a variant and the
//! original's slice, the two slices are equal.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::sync::Arc;

use super::compare::Colors;
use super::environment::TestPoint;
use super::promise::Pair;
use super::{By, Effort, Proof, Verdict, validate};
use preshade_dataflow::slice::fault::{self, Fault};
use preshade_geometry::pass_named;
use preshade_plan::pass::Facts;
use preshade_plan::plan::{Plan, Role};
use preshade_plan::program::Program;
use preshade_plan::state::MaterialState;
use shader_text::source::{Language, SourceMap};

/// A discard that depends on an early return, a branch, a partly written array, and a callee's
/// writes.
const MATERIAL: &str = "
@group(0) @binding(0) var<uniform> turn: mat4x4<f32>;
struct Varyings { @builtin(position) position: vec4<f32>, @location(0) at: vec4<f32> }
fn lower(by: ptr<function, f32>, at: f32) { *by = *by - at; }
@vertex fn vs(@location(0) position: vec3<f32>) -> Varyings { \
    return Varyings(turn * vec4(position, 1.0), turn * vec4(position, 2.0)); }
@fragment fn fs(in: Varyings) -> @location(0) vec4<f32> {
    if in.at.w > 3.0 { return vec4(0.5); }
    var cut = array(in.at.x, 0.25);
    cut[select(0u, 1u, turn[3].w > 0.0)] = in.at.y;
    var edge = in.at.z;
    if edge < 0.0 { edge = edge + 0.5; }
    lower(&edge, 0.125);
    if cut[0] + cut[1] > edge { discard; }
    return vec4(in.at.xyz, 1.0);
}
";

const EFFORT: Effort = Effort {
    inputs: 240,
    seed: 0,
    steps: 5_000,
    paths: 64,
};

fn original() -> Plan {
    let module = naga::front::wgsl::parse_str(MATERIAL).unwrap();
    let mut sources = SourceMap::new();
    sources.add("test.wgsl", MATERIAL);
    let program = Program::new(module, Arc::new(sources), Language::Wgsl).unwrap();
    Plan::original("test", program, "vs", Some("fs"), &MaterialState::default())
}

fn split(original: &Plan) -> Plan {
    let pass = pass_named("depth-prepass").unwrap();
    let facts = Facts::without_ties();
    let params = serde_json::json!({});
    pass.run(original, &facts, &params).unwrap().plan
}

/// Whether the original and the pre-pass have the same discard slice.
fn is_one_slice(original: &Plan, variant: &Plan) -> bool {
    let main = original.main().unwrap();
    let mut passes = variant.passes.iter();
    let pass = passes.find(|p| p.role == Role::Prepass).unwrap();
    let own = original.program(main).unwrap();
    let other = variant.program(pass).unwrap();
    let by = By {
        effort: &EFFORT,
        runner: None,
        told: &|_, _| {},
    };
    let pair = Pair::new(variant, (main, own), (pass, other), by).unwrap();
    pair.slices_are_same(TestPoint::Inside, Colors::Ignored)
}

#[test]
fn what_a_broken_slicer_forgets_in_both_is_seen() {
    let original = original();
    for forgotten in [Fault::Control, Fault::Merge, Fault::Under, Fault::Callee] {
        fault::with(forgotten, || {
            let variant = split(&original);
            assert!(is_one_slice(&original, &variant), "{forgotten:?}");
            let checks = validate(&original, &variant, &EFFORT);
            let broken = checks.iter().any(|c| c.verdict.is_broken());
            assert!(broken, "{forgotten:?}: {checks:#?}");
        });
    }
}

#[test]
fn one_slice_in_both_is_run_beside() {
    let original = original();
    let variant = split(&original);
    assert!(is_one_slice(&original, &variant));
    let checks = validate(&original, &variant, &EFFORT);
    let run = checks.iter().filter(|c| match c.verdict {
        Verdict::Proved {
            by: Proof::Slices { inputs },
        } => inputs > 0,
        _ => false,
    });
    assert!(run.count() > 0, "{checks:#?}");
    assert!(checks.iter().all(|c| c.verdict.holds()), "{checks:#?}");
}
