//! Both stages of a random material run by the evaluator, and what lies between them.

use std::collections::BTreeMap;

use naga::{Binding, Module, ShaderStage, TypeInner};
use naga_edit::interface;
use naga_interp::{Environment, RunResult, Stuck, Value};
use preshade_plan::program::Program;

/// What a stage gave.
pub struct Ran {
    pub by_binding: BTreeMap<String, Value>,
    pub by_location: BTreeMap<u32, Value>,
    pub discarded: bool,
}

/// Runs a stage on inputs by location; its only builtin input is the front face.
pub fn run(
    program: &Program,
    stage: ShaderStage,
    name: &str,
    inputs: &BTreeMap<u32, Value>,
    front: bool,
) -> Result<Ran, Stuck> {
    let module = program.module();
    let (entry, point) = program.entry_point(stage, name).unwrap();
    let value = |binding: &Binding| match binding {
        Binding::Location { location, .. } => inputs[location].clone(),
        Binding::BuiltIn(_) => Value::Scalar(naga_interp::Scalar::Bool(front)),
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
        resources: draw_constants(module).into(),
        texture: &|_| [0.0; 4],
        derivative: None,
        trace: None,
        steps: 200_000,
    };
    let outcome = naga_interp::entry_point(module, entry, &arguments, &environment)?;
    let (by_binding, by_location) = outputs(module, &point.function, &outcome);
    Ok(Ran {
        by_binding,
        by_location,
        discarded: outcome.discarded,
    })
}

fn outputs(
    module: &Module,
    function: &naga::Function,
    outcome: &RunResult,
) -> (BTreeMap<String, Value>, BTreeMap<u32, Value>) {
    let described = interface::outputs(module, function);
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
pub const VERTEX: &str = "
struct Varyings { @builtin(position) position: vec4<f32>, @location(0) p: vec4<f32>, \
    @location(1) q: vec2<f32>,
    @location(2) @interpolate(flat) k: i32, @location(3) r: f32 }
@vertex fn vs(@location(0) p: vec4<f32>, @location(1) q: vec2<f32>, @location(2) k: i32, \
    @location(3) r: f32) -> Varyings {
    return Varyings(p * 2.0, p, q * 0.5, k + 1, r - 0.25);
}
";

pub fn attributes(seed: u32) -> BTreeMap<u32, Value> {
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

/// The uniforms: floats and integers other than 0, no further from it than 4.
fn draw_constants(module: &Module) -> BTreeMap<(u32, u32), Value> {
    let variables = module.global_variables.iter();
    variables
        .filter_map(|(_, g)| {
            let at = g.binding?;
            let mut next = 0;
            Some((
                (at.group, at.binding),
                constant(module, &module.types[g.ty].inner, &mut next),
            ))
        })
        .collect()
}

fn constant(module: &Module, ty: &TypeInner, next: &mut u32) -> Value {
    let number = |next: &mut u32| {
        *next += 1;
        // The first is one that is no short fraction.
        match *next {
            1 => 1.372_549,
            n => (n as f32 * 0.754_877_7).fract() * 3.75 + 0.25,
        }
    };
    let mut times = |n: u32, ty: &TypeInner| {
        Value::Composite((0..n).map(|_| constant(module, ty, next)).collect())
    };
    match ty {
        TypeInner::Scalar(s) if s.kind == naga::ScalarKind::Float => Value::f32(number(next)),
        TypeInner::Scalar(_) => Value::i32(1),
        TypeInner::Vector { size, scalar } => times(*size as u32, &TypeInner::Scalar(*scalar)),
        TypeInner::Matrix {
            columns,
            rows,
            scalar,
        } => times(
            *columns as u32,
            &TypeInner::Vector {
                size: *rows,
                scalar: *scalar,
            },
        ),
        TypeInner::Struct { members, .. } => {
            let members = members.iter();
            let values = members.map(|m| constant(module, &module.types[m.ty].inner, next));
            Value::Composite(values.collect())
        }
        _ => panic!("a uniform of a type that no test has"),
    }
}
