//! Random materials, specialised to random values: wherever the guard holds both programs write the
//! same bits, whatever lies outside the guard.
//!
//! `PRESHADE_CASES=20000 cargo test -p preshade-passes --test it specialize_random` runs more of
//! them, `PRESHADE_SEED` others.

use std::collections::BTreeMap;
use std::panic::AssertUnwindSafe;

use naga::{Binding, Module, ShaderStage, TypeInner};
use naga_edit::interface;
use naga_interp::{Environment, Scalar, Stuck, Value};
use preshade_passes::transforms::specialize::{Fold, SpecializeParams, Specialized};
use preshade_plan::guard::{Assumed, Bounds, Guard, Place, ScalarType};
use preshade_plan::pass::{Constant, Facts};
use preshade_plan::program::Program;

use crate::common::decided::{self, Kind};
use crate::common::specialized::original;
use crate::common::stages::{VERTEX, attributes};
use crate::common::{self, random};

/// Numbers without a pattern (Steele, Lea and Flood, 2014: SplitMix64).
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }
}

/// A material with a uniform of scalars at group 0, binding 0.
struct Material {
    source: String,
    /// In the order of their offsets, four bytes each.
    fields: Vec<(&'static str, Kind)>,
}

const STEERING: [(&str, Kind); 7] = [
    ("su.k", Kind::Integer),
    ("su.r", Kind::Float),
    ("su.y", Kind::Float),
    ("su.n1", Kind::Integer),
    ("su.n2", Kind::Integer),
    ("su.n3", Kind::Integer),
    ("su.n4", Kind::Integer),
];

/// A random shader in which some inputs are uniforms, and loops turn as often as one says.
fn steered(bytes: &[u8]) -> Material {
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
    Material {
        source: format!(
            "struct Steering {{ k: i32, r: f32, y: f32, n1: i32, n2: i32, n3: i32, n4: i32 }}
@group(0) @binding(0) var<uniform> su: Steering;
{source}{VERTEX}"
        ),
        fields: STEERING.to_vec(),
    }
}

fn material(bytes: &[u8]) -> Material {
    match bytes.split_first() {
        Some((which, rest)) if which % 4 == 0 => steered(rest),
        Some((_, rest)) => Material {
            source: decided::material(rest),
            fields: decided::FIELDS.to_vec(),
        },
        None => steered(bytes),
    }
}

const INTEGERS: [i32; 9] = [0, 0, 1, 1, 2, 3, -1, 5, 30];
const FLOATS: [f32; 7] = [0.0, 0.0, 0.5, 1.0, 1.25, -0.75, 3.0];

fn any(kind: Kind, numbers: &mut Numbers) -> f64 {
    match kind {
        Kind::Integer => f64::from(INTEGERS[numbers.below(INTEGERS.len())]),
        Kind::Float => f64::from(FLOATS[numbers.below(FLOATS.len())]),
    }
}

/// What is known of some of the uniforms: one number, or, as of several draws, two bounds.
fn assumed(material: &Material, numbers: &mut Numbers) -> Facts {
    let mut constants = Vec::new();
    for (i, (name, kind)) in material.fields.iter().enumerate() {
        let bounds = match numbers.below(8) {
            0 => continue,
            1 => Bounds::one(any(*kind, numbers)).or(Bounds::one(any(*kind, numbers))),
            _ => Bounds::one(any(*kind, numbers)),
        };
        constants.push(Constant {
            material: "test".to_owned(),
            value: Assumed {
                name: (*name).to_owned(),
                place: Place::Uniform {
                    group: 0,
                    binding: 0,
                    offset: 4 * i as u32,
                },
                ty: match kind {
                    Kind::Integer => ScalarType::I32,
                    Kind::Float => ScalarType::F32,
                },
                bounds,
            },
        });
    }
    Facts {
        constants,
        ..Facts::default()
    }
}

/// A content of the uniform that the guard holds for, anything else left to chance.
fn content(material: &Material, guard: &Guard, numbers: &mut Numbers) -> Value {
    let scalars = material.fields.iter().map(|(name, kind)| {
        let chosen = match guard.values.iter().find(|v| v.name == *name) {
            Some(v) if numbers.below(2) == 0 => v.bounds.low,
            Some(v) => v.bounds.high,
            None => any(*kind, numbers),
        };
        match kind {
            Kind::Integer => Value::i32(chosen as i32),
            Kind::Float => Value::f32(chosen as f32),
        }
    });
    Value::Composite(scalars.collect())
}

/// Builtins and locations that a stage writes, and whether it discards.
type Written = (BTreeMap<String, Value>, BTreeMap<u32, Value>, bool);

fn run(
    program: &Program,
    stage: ShaderStage,
    inputs: &BTreeMap<u32, Value>,
    front: bool,
    content: &Value,
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
        resources: BTreeMap::from([((0, 0), content.clone())]).into(),
        texture: &|_| [0.0; 4],
        derivative: None,
        trace: None,
        steps: 50_000,
    };
    let outcome = naga_interp::entry_point(module, entry, &arguments, &environment)?;
    let outputs = interface::outputs(module, &point.function);
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

fn drawn(program: &Program, at: u32, content: &Value) -> Result<Written, Stuck> {
    let front = at.is_multiple_of(2);
    let (_, varyings, _) = run(
        program,
        ShaderStage::Vertex,
        &attributes(at),
        front,
        content,
    )?;
    run(program, ShaderStage::Fragment, &varyings, front, content)
}

/// What came of a case.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Came {
    /// A constant expression of the author's does not fit, or is out of bounds.
    Unread,
    /// Nothing rests on what is known.
    Nothing,
    /// Something was folded, and all fragments are the same.
    Same,
}

/// Specialises the material of `bytes` to values of `seed`, and compares.
///
/// # Errors
/// How they differ.
fn checked(bytes: &[u8], seed: u64) -> Result<Came, String> {
    let mut numbers = Numbers(seed);
    let material = material(bytes);
    if common::read(&material.source).is_err() {
        return Ok(Came::Unread);
    }
    let plan = original(&material.source);
    let facts = assumed(&material, &mut numbers);
    // Without a division hardly anything is infinite, which `fold=rounding` takes for granted.
    let fold = match numbers.below(4) {
        0 if !material.source.contains(" / ") => Fold::Rounding,
        _ => Fold::Exact,
    };
    let params = SpecializeParams {
        fold,
        unroll: [4, 4, 1, 0][numbers.below(4)],
        ..SpecializeParams::default()
    };
    let done = match Specialized::new(&plan, &facts, &params) {
        Ok(done) => done,
        Err(refusal) if refusal.code.ends_with("nothing-known") => return Ok(Came::Nothing),
        Err(refusal) => return Err(format!("{refusal}\n{}", material.source)),
    };
    let before = plan.program(plan.main().unwrap()).unwrap();
    let written = common::wgsl(done.program());
    // What is shipped is the text.
    let after = common::read(&written)
        .map_err(|why| format!("{why}\n{}\n=====\n{written}", material.source))?;
    for i in 0..6_u32 {
        let content = content(&material, &done.guard, &mut numbers);
        let at = (seed as u32).rotate_left(5 * i) ^ i;
        let Ok((expected, _, discarded)) = drawn(before, at, &content) else {
            continue;
        };
        let found = drawn(&after, at, &content).map(|(values, _, discarded)| (values, discarded));
        let is_same = match (&found, fold) {
            (Ok(found), Fold::Rounding) => {
                let all_finite = expected.values().all(is_finite);
                !all_finite || found.1 == discarded && is_equal(&found.0, &expected)
            }
            (found, _) => *found == Ok((expected.clone(), discarded)),
        };
        if !is_same {
            let guard: Vec<String> = done.guard.values.iter().map(ToString::to_string).collect();
            return Err(format!(
                "fragment {at}, with {content:?}, guard {}\n{:?}\n{found:?}\n{}\n=====\n{written}",
                guard.join(", "),
                (expected, discarded),
                material.source,
            ));
        }
    }
    Ok(Came::Same)
}

fn is_finite(value: &Value) -> bool {
    match value {
        Value::Scalar(Scalar::F32(f)) => f.is_finite(),
        Value::Composite(parts) => parts.iter().all(is_finite),
        _ => true,
    }
}

/// Equal numbers: 0 is -0.
fn is_equal(a: &BTreeMap<String, Value>, b: &BTreeMap<String, Value>) -> bool {
    fn positive(value: &Value) -> Value {
        // -0 + 0 is 0.
        let mut positive = |scalar: Scalar| match scalar {
            Scalar::F32(f) => Ok(Scalar::F32(f + 0.0)),
            scalar => Ok(scalar),
        };
        value.map(&mut positive).unwrap()
    }
    let each = |of: &BTreeMap<String, Value>| of.values().map(positive).collect::<Vec<_>>();
    each(a) == each(b)
}

/// A panic of naga's or ours is a finding too.
fn caught(bytes: &[u8], seed: u64) -> Result<Came, String> {
    std::panic::catch_unwind(AssertUnwindSafe(|| checked(bytes, seed)))
        .unwrap_or_else(|_| Err("it panics".to_owned()))
}

/// The least string of choices that still fails.
fn shrunk(mut bytes: Vec<u8>, seed: u64) -> Vec<u8> {
    let mut step = bytes.len() / 2;
    while step > 0 {
        let mut at = 0;
        while at < bytes.len() {
            let end = (at + step).min(bytes.len());
            let without = [&bytes[..at], &bytes[end..]].concat();
            let mut zeros = bytes.clone();
            zeros[at..end].fill(0);
            if caught(&without, seed).is_err() {
                bytes = without;
            } else if zeros != bytes && caught(&zeros, seed).is_err() {
                bytes = zeros;
                at = end;
            } else {
                at = end;
            }
        }
        step /= 2;
    }
    bytes
}

fn variable(name: &str, default: u64) -> u64 {
    let value = std::env::var(name).ok();
    value.and_then(|v| v.parse().ok()).unwrap_or(default)
}

/// Each takes seconds: `make check` skips them.
mod slow {
    use super::*;

    #[test]
    fn the_same_bits_wherever_the_guard_holds() {
        let (cases, first) = (
            variable("PRESHADE_CASES", 400),
            variable("PRESHADE_SEED", 1),
        );
        let (mut same, mut unread) = (0, 0);
        for i in 0..cases {
            let seed = first.wrapping_mul(1_000_003).wrapping_add(i);
            let mut numbers = Numbers(seed);
            let bytes: Vec<u8> = (0..30 + numbers.below(330))
                .map(|_| numbers.next() as u8)
                .collect();
            match caught(&bytes, seed) {
                Ok(Came::Same) => same += 1,
                Ok(Came::Unread) => unread += 1,
                Ok(Came::Nothing) => {}
                Err(_) => {
                    let least = shrunk(bytes, seed);
                    let why = caught(&least, seed).unwrap_err();
                    panic!("case {i} of seed {first}: {least:?}\n{why}");
                }
            }
        }
        // Most of them are about something.
        assert!(2 * same >= cases, "{same} of {cases} were specialised");
        assert!(10 * unread <= cases, "{unread} of {cases} are not read");
        println!("{same} of {cases} specialised, {unread} not read");
    }
}
