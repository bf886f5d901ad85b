//! What specialising leaves, what it assumes, and that with those values it computes the same.
#![allow(clippy::unwrap_used, clippy::panic)]

mod common;

use std::collections::BTreeMap;

use common::random;
use common::stages::{VERTEX, attributes};
use naga::{Binding, Module, ShaderStage, TypeInner};
use preshade_passes::evaluate::{self, Environment, Scalar, Stuck, Value};
use preshade_passes::pass::{Facts, Pass};
use preshade_passes::plan::Plan;
use preshade_passes::program::Program;
use preshade_passes::reflect;
use preshade_passes::specialize::{Fold, Params, Specialize};
use preshade_passes::state::MaterialState;
use proptest::prelude::*;

fn original(source: &str) -> Plan {
    let program = common::program(source);
    Plan::original("test", program, "vs", Some("fs"), &MaterialState::default())
}

fn set(values: &str) -> Params {
    Params {
        set: Some(values.to_owned()),
        ..Params::default()
    }
}

/// The plan, or why not.
fn specialized(plan: &Plan, params: &Params) -> Result<Plan, String> {
    let found = Specialize::sites(plan, &Facts::default(), params);
    match (&found.sites[..], &found.refusals[..]) {
        ([site], []) => {
            Specialize::apply(plan, &Facts::default(), &site.key, params).map_err(|r| r.to_string())
        }
        (_, [refusal]) => Err(refusal.to_string()),
        _ => panic!("{found:#?}"),
    }
}

fn text(plan: &Plan) -> String {
    common::wgsl(plan.program(plan.main().unwrap()).unwrap())
}

const LIT: &str = "
struct Material { flags: u32, fog: f32, lights: u32, coat: f32, color: vec4<f32>, mode: i32 }
@group(0) @binding(0) var<uniform> material: Material;
@group(0) @binding(1) var normal_map: texture_2d<f32>;
@group(0) @binding(2) var map_sampler: sampler;
const NORMAL: u32 = 1u;
const CUTOUT: u32 = 2u;
struct Varyings { @builtin(position) position: vec4<f32>, @location(0) normal: vec3<f32>, @location(1) uv: vec2<f32>, @location(2) distance: f32 }
fn has(flag: u32) -> bool { return (material.flags & flag) != 0u; }
fn light(n: vec3<f32>, i: u32) -> f32 { return max(dot(n, normalize(vec3(f32(i), 1.0, 0.5))), 0.0); }
@vertex fn vs(@location(0) position: vec3<f32>, @location(1) normal: vec3<f32>, @location(2) uv: vec2<f32>) -> Varyings {
    return Varyings(vec4(position, 1.0), normal, uv, length(position));
}
@fragment fn fs(in: Varyings) -> @location(0) vec4<f32> {
    var n = normalize(in.normal);
    if has(NORMAL) { n = normalize(n + textureSample(normal_map, map_sampler, in.uv).xyz); }
    if has(CUTOUT) && material.color.a < 0.5 { discard; }
    var sum = vec3(0.0);
    for (var i = 0u; i < material.lights; i++) { sum += light(n, i) * material.color.rgb; }
    switch material.mode { case 1: { sum = sum.zyx; } case 2: { sum *= 2.0; } default: { sum += 0.1; } }
    sum = mix(sum, vec3(1.0), material.coat);
    if material.fog > 0.0 { sum = mix(sum, vec3(0.5), 1.0 - exp(-material.fog * in.distance)); }
    return vec4(sum, material.color.a);
}
";

#[test]
fn everything_off() {
    let params = set("flags=0+fog=0+lights=0+mode=7");
    let plan = specialized(&original(LIT), &params).unwrap();
    insta::assert_snapshot!(text(&plan));
    let main = plan.main().unwrap();
    let names: Vec<&str> = main.bindings.iter().map(|b| b.name.as_str()).collect();
    assert_eq!(names, ["material"]);
    assert!(main.attributes.iter().all(|a| a.name != "uv"));
    assert_eq!(plan.contract.kind(), "exact");
    assert_eq!(plan.fallback.as_deref(), Some("original"));
}

#[test]
fn some_on() {
    let params = set("flags=1+fog=0.25+lights=2+mode=2+coat=0");
    let plan = specialized(&original(LIT), &params).unwrap();
    insta::assert_snapshot!(text(&plan));
    let guard = plan.guard.unwrap();
    let names: Vec<String> = guard.values.iter().map(ToString::to_string).collect();
    // A weight that no branch tests decides nothing exactly.
    let expected = [
        "material.flags = 1",
        "material.fog = 0.25",
        "material.lights = 2",
        "material.mode = 2",
    ];
    assert_eq!(names, expected);
}

#[test]
fn many_lights_stay_a_loop_with_a_literal_bound() {
    let plan = specialized(&original(LIT), &set("lights=30")).unwrap();
    let text = text(&plan);
    assert!(text.contains("< 30u"), "{text}");
}

#[test]
fn a_weight_of_nothing_goes_where_floats_may_be_folded() {
    let params = Params {
        fold: Fold::Rounding,
        ..set("coat=0")
    };
    let plan = specialized(&original(LIT), &params).unwrap();
    assert_eq!(plan.contract.kind(), "rounding");
    assert!(!text(&plan).contains("material.coat"), "{}", text(&plan));
    let refused = specialized(&original(LIT), &set("coat=0")).unwrap_err();
    assert!(refused.contains("nothing-known"), "{refused}");
}

#[test]
fn what_does_not_fit_is_refused_with_what_would() {
    let refused = |values: &str| specialized(&original(LIT), &set(values)).unwrap_err();
    assert!(refused("fgo=0").contains("is named `fgo`"));
    assert!(refused("flags=0.5").contains("cannot be 0.5"));
    assert!(refused("flags").contains("is not `name=number`"));
    assert!(refused("flags=1+flags=2").contains("`material.flags` is given twice"));
    // Nor by two steps: no value would be let through by both.
    let once = specialized(&original(LIT), &set("flags=1")).unwrap();
    let twice = specialized(&once, &set("flags=2"));
    assert!(twice.is_err_and(|why| why.contains("material.flags") || why.contains("no branch")));
}

/// What the adapter may round either way is not decided.
#[test]
fn a_comparison_within_a_rounding_stays() {
    let source = |condition: &str| {
        format!(
            "struct U {{ a: f32, b: f32, n: u32 }}
@group(0) @binding(0) var<uniform> u: U;
@vertex fn vs(@location(0) p: vec4<f32>) -> @builtin(position) vec4<f32> {{ return p; }}
@fragment fn fs() -> @location(0) vec4<f32> {{
    if {condition} {{ return vec4(1.0); }}
    return vec4(u.b);
}}"
        )
    };
    let folds = |condition: &str, values: &str| {
        specialized(&original(&source(condition)), &set(values)).is_ok()
    };
    assert!(folds("u.a > 0.0", "a=0"));
    assert!(folds("u.a * u.b > 0.0", "a=0+b=3"));
    assert!(folds("u.a * u.b > 0.5", "a=2+b=3"));
    // 0.1 * 3 is 0.3 only to within a rounding.
    assert!(!folds("u.a * u.b > 0.3", "a=0.1+b=3"));
    // A denormal may be flushed to 0.
    assert!(!folds("u.a > 0.0", "a=1e-40"));
    assert!(folds("u.a >= 0.0", "a=1e-40"));
    assert!(!folds("1.0 / u.a > 0.0", "a=0"));
    // Wrapping integers are not followed.
    assert!(!folds("u.n + 4294967295u > 3u", "n=2"));
}

#[test]
fn an_override_takes_its_value() {
    let source = "
override FANCY: bool = true;
override OCTAVES: u32 = 8u;
@vertex fn vs(@location(0) p: vec4<f32>) -> @builtin(position) vec4<f32> { return p; }
@fragment fn fs(@builtin(position) p: vec4<f32>) -> @location(0) vec4<f32> {
    var sum = 0.0;
    if FANCY { for (var i = 0u; i < OCTAVES; i++) { sum += sin(p.x * f32(i)); } }
    return vec4(sum);
}";
    let plan = specialized(&original(source), &set("FANCY=0")).unwrap();
    let without = text(&plan);
    assert!(
        !without.contains("sin") && !without.contains("FANCY"),
        "{without}"
    );
    let plan = specialized(&original(source), &set("OCTAVES=2")).unwrap();
    let two = text(&plan);
    assert!(!two.contains("loop") && two.contains("if FANCY"), "{two}");
}

/// A random shader in which some inputs are uniforms, and loops turn as often as one says.
fn steered(bytes: &[u8]) -> String {
    let mut source = random::shader(bytes)
        .replace("in.k", "su.k")
        .replace("in.r", "su.r")
        .replace("in.q.y", "su.y");
    for turns in 1..=4 {
        for n in 0..40 {
            let counter = format!("k{n} < {turns};");
            source = source.replace(&counter, &format!("k{n} < su.n{turns};"));
            let tested = format!("if k{n} >= {turns} {{");
            source = source.replace(&tested, &format!("if k{n} >= su.n{turns} {{"));
        }
    }
    format!(
        "struct Steering {{ k: i32, r: f32, y: f32, n1: i32, n2: i32, n3: i32, n4: i32 }}
@group(0) @binding(0) var<uniform> su: Steering;
{source}{VERTEX}"
    )
}

/// Values of the uniform: small integers, and floats that comparisons in random shaders are near to.
fn steering(seed: u32) -> (String, Value) {
    let k = (seed % 7) as i32 - 2;
    let [r, y] = [seed / 7, seed / 49].map(|s| [0.0, 0.5, 1.25, -0.75, 3.0][s as usize % 5]);
    let turns = [1, 2, 3, 4].map(|n| (n + seed as i32 / 343 % 2) % 5);
    let [n1, n2, n3, n4] = turns;
    let text = format!("k={k}+su.r={r}+su.y={y}+n1={n1}+n2={n2}+n3={n3}+n4={n4}");
    let mut parts = vec![Value::i32(k), Value::f32(r), Value::f32(y)];
    parts.extend(turns.map(Value::i32));
    (text, Value::Composite(parts))
}

/// Builtins and locations that a stage writes, and whether it discards.
type Written = (BTreeMap<String, Value>, BTreeMap<u32, Value>, bool);

fn run(
    program: &Program,
    stage: ShaderStage,
    inputs: &BTreeMap<u32, Value>,
    front: bool,
    steering: &Value,
) -> Result<Written, Stuck> {
    let module = program.module();
    let name = if stage == ShaderStage::Vertex {
        "vs"
    } else {
        "fs"
    };
    let (entry, point) = program.entry_point(stage, name).unwrap();
    let value = |binding: &Binding| match binding {
        Binding::Location { location, .. } => inputs[location].clone(),
        Binding::BuiltIn(_) => Value::Scalar(Scalar::Bool(front)),
    };
    let argument = |module: &Module, a: &naga::FunctionArgument| match &module.types[a.ty].inner {
        TypeInner::Struct { members, .. } if a.binding.is_none() => {
            let members = members.iter().map(|m| value(m.binding.as_ref().unwrap()));
            Value::Composite(members.collect())
        }
        _ => value(a.binding.as_ref().unwrap()),
    };
    let arguments: Vec<Value> = point
        .function
        .arguments
        .iter()
        .map(|a| argument(module, a))
        .collect();
    let environment = Environment {
        resources: BTreeMap::from([((0, 0), steering.clone())]),
        texture: &|_| [0.0; 4],
        derivative: None,
        trace: None,
        steps: 200_000,
    };
    let outcome = evaluate::entry_point(module, entry, &arguments, &environment)?;
    let outputs = reflect::outputs(module, &point.function);
    let is_struct = point
        .function
        .result
        .as_ref()
        .is_some_and(|r| r.binding.is_none());
    let values = match &outcome.result {
        Some(Value::Composite(parts)) if is_struct => parts.clone(),
        Some(one) => vec![one.clone()],
        None => Vec::new(),
    };
    let (mut by_binding, mut by_location) = (BTreeMap::new(), BTreeMap::new());
    for (io, value) in outputs.iter().zip(values) {
        let binding = io.binding.as_ref().unwrap();
        if let Binding::Location { location, .. } = binding {
            by_location.insert(*location, value.clone());
        }
        by_binding.insert(format!("{binding:?}"), value);
    }
    Ok((by_binding, by_location, outcome.discarded))
}

/// Specialises to the steering values of `seed` and compares on several fragments; whether anything was specialised.
fn the_same_with_its_values(bytes: &[u8], seed: u32) -> bool {
    let source = steered(bytes);
    let plan = original(&source);
    let (values, steering) = steering(seed);
    let next = match specialized(&plan, &set(&values)) {
        Ok(next) => next,
        Err(why) if why.contains("nothing-known") => return false,
        Err(why) => panic!("{why}\n{source}"),
    };
    let before = plan.program(plan.main().unwrap()).unwrap();
    let after = next.program(next.main().unwrap()).unwrap();
    common::wgsl(after);
    for i in 0..6_u32 {
        let at = seed.rotate_left(5 * i) ^ i;
        let front = at.is_multiple_of(2);
        let both = [before, after].map(|program| {
            let given = attributes(at);
            let (_, varyings, _) = run(program, ShaderStage::Vertex, &given, front, &steering)?;
            run(program, ShaderStage::Fragment, &varyings, front, &steering)
                .map(|(by_binding, _, discarded)| (by_binding, discarded))
        });
        let [Ok(a), b] = both else { continue };
        assert_eq!(
            Ok(a),
            b,
            "with {values}, fragment {at}\n{source}\n=====\n{}",
            common::wgsl(after)
        );
    }
    true
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    #[test]
    fn specialised_shaders_give_the_same(bytes in proptest::collection::vec(any::<u8>(), 0..400), seed in any::<u32>()) {
        the_same_with_its_values(&bytes, seed);
    }
}

#[test]
fn random_shaders_are_specialised_often_enough_to_count() {
    let count = (0..150_u32)
        .filter(|i| {
            let bytes: Vec<u8> = (0..240_u32)
                .map(|j| (i.wrapping_mul(7919).wrapping_add(j * j * 31) >> 3) as u8)
                .collect();
            the_same_with_its_values(&bytes, i.wrapping_mul(2_654_435_761))
        })
        .count();
    assert!(count >= 60, "only {count} of 150");
}
