//! Running a slice gives the sliced value: random structured programs, original and slice run on
//! the same inputs, outputs equal bit for bit, and the same fragments discarded.

use std::collections::BTreeMap;

use naga::{Binding, BuiltIn, Function, Module, ShaderStage, TypeInner};
use naga_edit::interface;
use naga_interp::{Environment, RunResult, Scalar, Stuck, Value};
use preshade_dataflow::graph::Graph;
use preshade_dataflow::slice::{self, Criterion, OutputFilter, Termination};
use preshade_passes::rebuild::place::{self, PositionInvariance};
use preshade_plan::program::Program;
use proptest::prelude::*;

use crate::common::random::{self, Choices};
use crate::common::{self};

/// The value of an input by its binding.
fn input(binding: &Binding, seed: u32) -> Value {
    let number = |i: u32| {
        let bits = (seed.wrapping_mul(2_654_435_761)).rotate_left(7 * i + 3) >> 8;
        (bits as f32 / (1 << 22) as f32) - 2.0
    };
    match binding {
        Binding::Location { location: 0, .. } => {
            Value::vector(&[number(0), number(1), number(2), number(3)])
        }
        Binding::Location { location: 1, .. } => Value::vector(&[number(4), number(5)]),
        Binding::Location { location: 2, .. } => Value::i32((seed % 7) as i32 - 2),
        Binding::Location { location: 3, .. } => Value::f32(number(6)),
        Binding::BuiltIn(BuiltIn::FrontFacing) => {
            Value::Scalar(Scalar::Bool(seed.is_multiple_of(2)))
        }
        other => panic!("no value for {other:?}"),
    }
}

fn arguments(module: &Module, function: &Function, seed: u32) -> Vec<Value> {
    function
        .arguments
        .iter()
        .map(
            |argument| match (&argument.binding, &module.types[argument.ty].inner) {
                (Some(binding), _) => input(binding, seed),
                (None, TypeInner::Struct { members, .. }) => Value::Composite(
                    members
                        .iter()
                        .map(|m| input(m.binding.as_ref().unwrap(), seed))
                        .collect(),
                ),
                _ => panic!("an argument without binding"),
            },
        )
        .collect()
}

fn run(program: &Program, name: &str, seed: u32) -> Result<RunResult, Stuck> {
    let (entry, point) = program.entry_point(ShaderStage::Fragment, name).unwrap();
    let environment = Environment {
        resources: BTreeMap::new().into(),
        texture: &|_| [0.0; 4],
        derivative: None,
        trace: None,
        steps: 200_000,
    };
    let arguments = arguments(program.module(), &point.function, seed);
    naga_interp::entry_point(program.module(), entry, &arguments, &environment)
}

/// The outputs by binding.
fn outputs(program: &Program, name: &str, outcome: &RunResult) -> Vec<(Binding, Value)> {
    let (_, point) = program.entry_point(ShaderStage::Fragment, name).unwrap();
    let described = interface::outputs(program.module(), &point.function);
    let values = match (&outcome.result, described.len()) {
        (None, _) => return Vec::new(),
        (Some(Value::Composite(members)), n)
            if point.function.result.as_ref().unwrap().binding.is_none() =>
        {
            assert_eq!(members.len(), n);
            members.clone()
        }
        (Some(value), _) => vec![value.clone()],
    };
    described
        .into_iter()
        .map(|io| io.binding.unwrap())
        .zip(values)
        .collect()
}

/// Slices, places, and compares on some inputs.
fn check(program: &Program, criteria: &[Criterion], termination: Termination) {
    let graph = Graph::build(program);
    let (entry, _) = program.entry_point(ShaderStage::Fragment, "fs").unwrap();
    let slice = slice::backward_with(&graph, entry, criteria, termination);
    let placed = place::entry_point(
        &graph,
        &slice,
        program.module(),
        "sliced",
        "cut",
        PositionInvariance::AsWritten,
    );
    let placed = place::retain(&placed, &[(ShaderStage::Fragment, "sliced")]);
    let placed = common::validated(program, placed);
    for seed in 0..12 {
        let Ok(whole) = run(program, "fs", seed) else {
            continue;
        };
        let part = match run(&placed, "sliced", seed) {
            Ok(part) => part,
            Err(e) => panic!("{e}\n{:#?}", placed.module().entry_points[0].function),
        };
        if criteria.contains(&Criterion::Discard) {
            assert_eq!(whole.discarded, part.discarded, "discard, seed {seed}");
        } else {
            assert!(!part.discarded);
        }
        let expected: Vec<_> = outputs(program, "fs", &whole)
            .into_iter()
            .enumerate()
            .filter(|(i, _)| slice.outputs.contains(i))
            .map(|(_, o)| o)
            .collect();
        let sliced = outputs(&placed, "sliced", &part);
        let [expected, sliced] = [expected, sliced].map(|o| decided(o, criteria));
        assert_eq!(expected, sliced, "seed {seed}");
    }
}

/// The outputs with the one component of the first location that is sliced for, where that is all:
/// the others may be anything.
fn decided(outputs: Vec<(Binding, Value)>, criteria: &[Criterion]) -> Vec<(Binding, Value)> {
    let component = criteria.iter().find_map(|c| match c {
        Criterion::Component(_, component) => Some(*component as usize),
        _ => None,
    });
    outputs
        .into_iter()
        .map(|(binding, value)| match (component, &binding, value) {
            (Some(c), Binding::Location { location: 0, .. }, Value::Composite(parts)) => {
                (binding, parts[c].clone())
            }
            (_, _, value) => (binding, value),
        })
        .collect()
}

fn criteria() -> Vec<Vec<Criterion>> {
    let output = |filter| Criterion::Output(filter);
    vec![
        vec![output(OutputFilter::Index(0))],
        vec![output(OutputFilter::Location(1))],
        vec![output(OutputFilter::Location(2))],
        vec![output(OutputFilter::FragDepth)],
        vec![Criterion::Discard],
        vec![Criterion::Discard, output(OutputFilter::FragDepth)],
        vec![
            output(OutputFilter::Location(1)),
            output(OutputFilter::FragDepth),
        ],
        vec![Criterion::Discard, output(OutputFilter::All)],
        vec![Criterion::Component(OutputFilter::Location(0), 0)],
        vec![Criterion::Component(OutputFilter::Location(0), 2)],
        vec![
            Criterion::Discard,
            Criterion::Component(OutputFilter::Location(0), 3),
            output(OutputFilter::FragDepth),
        ],
    ]
}

fn cases(default: u32) -> ProptestConfig {
    let cases = std::env::var("PROPTEST_CASES")
        .ok()
        .and_then(|c| c.parse().ok())
        .unwrap_or(default);
    ProptestConfig {
        cases,
        failure_persistence: None,
        ..ProptestConfig::default()
    }
}

proptest! {
    #![proptest_config(cases(64))]

    #[test]
    fn a_slice_gives_the_sliced_value(bytes in prop::collection::vec(any::<u8>(), 40..600)) {
        let program = common::program(&random::shader(&bytes));
        let mut module = program.module().clone();
        random::fall_through(&mut module, &mut Choices::new(&bytes[bytes.len() / 2..]));
        for program in [&program, &common::validated(&program, module)] {
            for criteria in criteria() {
                check(program, &criteria, Termination::Assumed);
            }
            check(program, &[Criterion::Discard], Termination::Preserved);
        }
    }
}
