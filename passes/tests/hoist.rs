//! Hoisting moves what it says, keeps what has to stay, and gives the same values at the vertices.
#![allow(clippy::unwrap_used, clippy::panic)]

mod common;

use std::collections::BTreeMap;

use common::random;
use naga::{Binding, Module, ShaderStage, TypeInner};
use preshade_passes::evaluate::{self, Environment, Outcome, Stuck, Value};
use preshade_passes::hoist::{Hoist, Params};
use preshade_passes::pass::{Facts, Pass, Sites};
use preshade_passes::plan::Plan;
use preshade_passes::program::Program;
use preshade_passes::reflect;
use preshade_passes::state::MaterialState;
use proptest::prelude::*;

fn original(source: &str) -> Plan {
    let program = common::program(source);
    Plan::original("test", program, "vs", Some("fs"), &MaterialState::default())
}

fn sites(plan: &Plan, params: &Params) -> Sites {
    Hoist::sites(plan, &Facts::default(), params)
}

fn hoisted(source: &str, params: &Params) -> (Plan, String) {
    let plan = original(source);
    let sites = sites(&plan, params);
    let [site] = &sites.sites[..] else {
        panic!("{:#?}", sites.refusals)
    };
    let next = Hoist::apply(&plan, &Facts::default(), &site.key, params).unwrap();
    let text = common::wgsl(next.program(next.main().unwrap()).unwrap());
    (next, format!("// {}\n{text}", site.what))
}

fn budget() -> Params {
    Params {
        budget: Some(0.02),
        finite: preshade_passes::hoist::travel::Finite::Assumed,
        ..Params::default()
    }
}

const NOISE: &str = "
struct Scene { clip: mat4x4<f32>, tint: vec3<f32>, time: f32 }
@group(0) @binding(0) var<uniform> scene: Scene;
struct VertexOutput { @builtin(position) position: vec4<f32>, @location(0) world: vec3<f32>, @location(1) uv: vec2<f32> }
fn hash(p: vec3<f32>) -> f32 { return fract(sin(dot(p, vec3(12.9898, 78.233, 37.719))) * 43758.5453); }
fn value_noise(p: vec3<f32>) -> f32 {
    let i = floor(p);
    let f = p - i;
    let u = f * f * (3.0 - 2.0 * f);
    let a = mix(hash(i), hash(i + vec3(1.0, 0.0, 0.0)), u.x);
    let b = mix(hash(i + vec3(0.0, 1.0, 0.0)), hash(i + vec3(1.0, 1.0, 0.0)), u.x);
    return mix(a, b, u.y);
}
fn fbm(p: vec3<f32>) -> f32 {
    var sum = 0.0;
    var amplitude = 0.5;
    var q = p;
    for (var octave = 0; octave < 4; octave++) {
        sum += amplitude * value_noise(q);
        q = q * 2.0;
        amplitude *= 0.5;
    }
    return sum;
}
@vertex fn vs(@location(0) position: vec3<f32>, @location(1) uv: vec2<f32>) -> VertexOutput {
    var out: VertexOutput;
    out.position = scene.clip * vec4(position, 1.0);
    out.world = position;
    out.uv = uv;
    return out;
}
@fragment fn fs(in: VertexOutput) -> @location(0) vec4<f32> {
    let n = fbm(in.world * 2.8 + scene.time);
    let edge = fwidth(in.uv.x);
    return vec4(scene.tint * n + edge, 1.0);
}
";

#[test]
fn a_loop_of_noise_moves_whole() {
    let (plan, text) = hoisted(NOISE, &budget());
    insta::assert_snapshot!(text);
    assert_eq!(plan.contract.kind(), "approximate");
}

/// Runs a stage on inputs by location; a builtin is what the seed says.
fn run(
    program: &Program,
    stage: ShaderStage,
    name: &str,
    inputs: &BTreeMap<u32, Value>,
    seed: u32,
) -> Result<(BTreeMap<String, Value>, BTreeMap<u32, Value>, Outcome), Stuck> {
    let module = program.module();
    let (entry, point) = program.entry_point(stage, name).unwrap();
    let value = |binding: &Binding| match binding {
        Binding::Location { location, .. } => inputs[location].clone(),
        Binding::BuiltIn(_) => Value::Scalar(evaluate::Scalar::Bool(seed.is_multiple_of(2))),
    };
    let arguments: Vec<Value> = point
        .function
        .arguments
        .iter()
        .map(|a| match (&a.binding, &module.types[a.ty].inner) {
            (Some(b), _) => value(b),
            (None, TypeInner::Struct { members, .. }) => {
                let members = members.iter().map(|m| value(m.binding.as_ref().unwrap()));
                Value::Composite(members.collect())
            }
            _ => panic!("an argument without binding"),
        })
        .collect();
    let environment = Environment {
        resources: BTreeMap::new(),
        texture: &|_| [0.0; 4],
        steps: 200_000,
    };
    let outcome = evaluate::entry_point(module, entry, &arguments, &environment)?;
    let (by_binding, by_location) = outputs(module, &point.function, &outcome);
    Ok((by_binding, by_location, outcome))
}

fn outputs(
    module: &Module,
    function: &naga::Function,
    outcome: &Outcome,
) -> (BTreeMap<String, Value>, BTreeMap<u32, Value>) {
    let described = reflect::outputs(module, function);
    let is_struct = function
        .result
        .as_ref()
        .is_some_and(|r| r.binding.is_none());
    let values = match &outcome.result {
        Some(Value::Composite(members)) if is_struct => members.clone(),
        Some(value) => vec![value.clone()],
        None => Vec::new(),
    };
    let mut by_binding = BTreeMap::new();
    let mut by_location = BTreeMap::new();
    for (io, value) in described.iter().zip(values) {
        let binding = io.binding.as_ref().unwrap();
        if let Binding::Location { location, .. } = binding {
            by_location.insert(*location, value.clone());
        }
        by_binding.insert(format!("{binding:?}"), value);
    }
    (by_binding, by_location)
}

/// A vertex stage in front of a random fragment stage: passes everything on, a little changed.
const RANDOM_VERTEX: &str = "
struct Varyings { @builtin(position) position: vec4<f32>, @location(0) p: vec4<f32>, @location(1) q: vec2<f32>,
    @location(2) @interpolate(flat) k: i32, @location(3) r: f32 }
@vertex fn vs(@location(0) p: vec4<f32>, @location(1) q: vec2<f32>, @location(2) k: i32, @location(3) r: f32) -> Varyings {
    return Varyings(p * 2.0, p, q * 0.5, k + 1, r - 0.25);
}
";

fn attributes(seed: u32) -> BTreeMap<u32, Value> {
    let number = |i: u32| {
        let bits = seed.wrapping_mul(2_654_435_761).rotate_left(7 * i + 3) >> 8;
        (bits as f32 / (1 << 22) as f32) - 2.0
    };
    BTreeMap::from([
        (
            0,
            Value::vector(&[number(0), number(1), number(2), number(3)]),
        ),
        (1, Value::vector(&[number(4), number(5)])),
        (2, Value::i32((seed % 7) as i32 - 2)),
        (3, Value::f32(number(6))),
    ])
}

/// Both stages run one after the other: what the fragment stage gives where a fragment lies on a vertex.
fn at_vertex(program: &Program, seed: u32) -> Result<(BTreeMap<String, Value>, bool), Stuck> {
    let (_, varyings, _) = run(program, ShaderStage::Vertex, "vs", &attributes(seed), seed)?;
    let (outputs, _, outcome) = run(program, ShaderStage::Fragment, "fs", &varyings, seed)?;
    Ok((outputs, outcome.discarded))
}

/// Whether anything was hoisted.
fn the_same_at_vertices(bytes: &[u8], seeds: &[u32]) -> bool {
    let source = format!("{}{RANDOM_VERTEX}", random::shader(bytes));
    let plan = original(&source);
    let params = Params {
        vertices_per_fragment: Some(0.0),
        ..budget()
    };
    let found = sites(&plan, &params);
    let Some(site) = found.sites.first() else {
        return false;
    };
    let next = Hoist::apply(&plan, &Facts::default(), &site.key, &params)
        .unwrap_or_else(|e| panic!("{e}\n{source}"));
    let before = plan.program(plan.main().unwrap()).unwrap();
    let after = next.program(next.main().unwrap()).unwrap();
    for seed in seeds {
        let (Ok(a), Ok(b)) = (at_vertex(before, *seed), at_vertex(after, *seed)) else {
            continue;
        };
        assert_eq!(
            a,
            b,
            "seed {seed}: {}\n{source}\n=====\n{}",
            site.what,
            common::wgsl(after)
        );
    }
    true
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, ..ProptestConfig::default() })]

    #[test]
    fn hoisted_shaders_give_the_same_at_vertices(bytes in proptest::collection::vec(any::<u8>(), 0..400), seed in any::<u32>()) {
        the_same_at_vertices(&bytes, &[seed, seed.rotate_left(9), 3]);
    }
}

#[test]
fn random_shaders_are_hoisted_often_enough_to_count() {
    let hoisted = (0..60_u32)
        .filter(|i| {
            let bytes: Vec<u8> = (0..200_u32)
                .map(|j| (i.wrapping_mul(7919).wrapping_add(j * j * 31) >> 3) as u8)
                .collect();
            the_same_at_vertices(&bytes, &[*i, i * 77 + 5])
        })
        .count();
    assert!(hoisted >= 15, "only {hoisted} of 60");
}
