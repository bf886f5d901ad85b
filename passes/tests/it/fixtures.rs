//! Every output of every fixture shader, sliced: the placed slice validates, prints as WGSL that
//! parses again, costs no more, and where the interpreter can run the shader, gives the same bits.

use std::collections::BTreeMap;

use naga::{Module, ScalarKind, Type, TypeInner};
use naga_edit::interface;
use naga_interp::{Environment, Lookup, RunResult, Scalar, Stuck, Value};
use preshade_dataflow::graph::{FunctionId, Graph};
use preshade_dataflow::slice::{self, Criterion, OutputFilter, Termination};
use preshade_passes::rebuild::place::{self, PositionInvariance};
use preshade_plan::program::Program;

use crate::common;

/// A value of a type, different for each seed; runtime arrays get 16 elements.
fn value(module: &Module, ty: naga::Handle<Type>, seed: &mut u32) -> Value {
    let mut scalar = |kind| {
        *seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        match kind {
            ScalarKind::Float => Scalar::F32((*seed >> 8) as f32 / (1 << 22) as f32 - 2.0),
            ScalarKind::Sint => Scalar::I32((*seed >> 28) as i32),
            ScalarKind::Uint => Scalar::U32(*seed >> 28),
            _ => Scalar::Bool(*seed >> 31 == 0),
        }
    };
    match &module.types[ty].inner {
        TypeInner::Scalar(s) | TypeInner::Atomic(s) => Value::Scalar(scalar(s.kind)),
        TypeInner::Vector { size, scalar: s } => Value::Composite(
            (0..*size as usize)
                .map(|_| Value::Scalar(scalar(s.kind)))
                .collect(),
        ),
        TypeInner::Matrix { columns, rows, .. } => Value::Composite(
            (0..*columns as usize)
                .map(|_| {
                    Value::Composite(
                        (0..*rows as usize)
                            .map(|_| Value::Scalar(scalar(ScalarKind::Float)))
                            .collect(),
                    )
                })
                .collect(),
        ),
        TypeInner::Array { base, size, .. } => {
            let count = match size {
                naga::ArraySize::Constant(n) => n.get(),
                _ => 16,
            };
            Value::Composite((0..count).map(|_| value(module, *base, seed)).collect())
        }
        TypeInner::Struct { members, .. } => {
            Value::Composite(members.iter().map(|m| value(module, m.ty, seed)).collect())
        }
        other => panic!("no value of {other:?}"),
    }
}

/// Inputs by binding, so that a slice gets the same as the whole.
fn input(module: &Module, io: &interface::Io, seed: u32) -> Value {
    let mut own = io
        .binding
        .iter()
        .flat_map(|b| format!("{b:?}").into_bytes())
        .fold(seed, |h, b| h.wrapping_mul(31).wrapping_add(u32::from(b)));
    value(module, io.ty, &mut own)
}

fn texel(lookup: &Lookup<'_>) -> [f32; 4] {
    let sum = lookup
        .coordinates
        .iter()
        .fold(lookup.binding.map_or(0.0, |b| b.1 as f32), |s, c| {
            s * 1.7 + c
        });
    [0.0_f32, 1.0, 2.0, 3.0].map(|i| (sum * (i + 1.0)).sin() * 0.5 + 0.5)
}

fn run(program: &Program, entry: usize, seed: u32) -> Result<RunResult, Stuck> {
    let module = program.module();
    let function = &module.entry_points[entry].function;
    let mut inputs = interface::inputs(module, function).into_iter();
    let arguments: Vec<Value> = function
        .arguments
        .iter()
        .map(|a| match &module.types[a.ty].inner {
            TypeInner::Struct { members, .. } if a.binding.is_none() => Value::Composite(
                members
                    .iter()
                    .map(|_| input(module, &inputs.next().unwrap(), seed))
                    .collect(),
            ),
            _ => input(module, &inputs.next().unwrap(), seed),
        })
        .collect();
    // Entry points may give one binding to different variables.
    let used = program.info().get_entry_point(entry);
    let resources: BTreeMap<(u32, u32), Value> = module
        .global_variables
        .iter()
        .filter(|(handle, _)| !used[*handle].is_empty())
        .filter(|(_, g)| g.space != naga::AddressSpace::Handle)
        .filter_map(|(_, g)| {
            let at = g.binding.as_ref()?;
            let mut own = seed ^ (at.group * 977 + at.binding);
            Some(((at.group, at.binding), value(module, g.ty, &mut own)))
        })
        .collect();
    let environment = Environment {
        resources: resources.into(),
        texture: &texel,
        derivative: None,
        trace: None,
        steps: 2_000_000,
    };
    naga_interp::entry_point(module, entry, &arguments, &environment)
}

/// The outputs by binding.
fn outputs(program: &Program, entry: usize, outcome: &RunResult) -> BTreeMap<String, Value> {
    let function = &program.module().entry_points[entry].function;
    let described = interface::outputs(program.module(), function);
    let values = match &outcome.result {
        None => Vec::new(),
        Some(Value::Composite(members)) if function.result.as_ref().unwrap().binding.is_none() => {
            members.clone()
        }
        Some(value) => vec![value.clone()],
    };
    described
        .into_iter()
        .map(|io| match io.binding.unwrap() {
            naga::Binding::BuiltIn(naga::BuiltIn::Position { .. }) => "position".to_owned(),
            other => format!("{other:?}"),
        })
        .zip(values)
        .collect()
}

/// Each takes seconds: `make check` skips them.
mod slow {
    use super::*;

    #[test]
    fn every_output_of_every_fixture_can_be_placed_and_run() {
        let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures");
        let mut files = Vec::new();
        let mut folders = vec![std::path::PathBuf::from(root)];
        while let Some(folder) = folders.pop() {
            for entry in std::fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                if path.is_dir() {
                    folders.push(path);
                } else if path.extension().is_some_and(|e| e == "wgsl") {
                    files.push(path);
                }
            }
        }
        files.sort();
        let (mut placed_slices, mut compared) = (0, 0);
        for file in files {
            let source = std::fs::read_to_string(&file).unwrap();
            // Some fixtures are wrong on purpose.
            if naga::front::wgsl::parse_str(&source).is_err() {
                continue;
            }
            let program = common::program(&source);
            let graph = Graph::build(&program);
            assert!(!graph.to_dot().is_empty());
            for (entry, point) in program.module().entry_points.iter().enumerate() {
                let outputs_of = interface::outputs(program.module(), &point.function);
                // The two sources of a blend stand for one output: neither is valid alone.
                let is_alone = |io: &interface::Io| {
                    !matches!(
                        io.binding,
                        Some(naga::Binding::Location {
                            blend_src: Some(_),
                            ..
                        })
                    )
                };
                let mut criteria: Vec<Vec<Criterion>> = (0..outputs_of.len())
                    .filter(|i| is_alone(&outputs_of[*i]))
                    .map(|i| vec![Criterion::Output(OutputFilter::Index(i))])
                    .collect();
                criteria.push(vec![Criterion::Discard]);
                criteria.push(vec![
                    Criterion::Discard,
                    Criterion::Output(OutputFilter::All),
                ]);
                for mut criteria in criteria {
                    // A vertex stage without a position is no vertex stage.
                    if point.stage == naga::ShaderStage::Vertex {
                        criteria.push(Criterion::Output(OutputFilter::Position));
                    }
                    for termination in [Termination::Assumed, Termination::Preserved] {
                        let slice = slice::backward_with(&graph, entry, &criteria, termination);
                        assert!(
                            slice.cost <= graph.cost(FunctionId::EntryPoint(entry)) + 1e-6,
                            "{}",
                            file.display()
                        );
                        let module = place::entry_point(
                            &graph,
                            &slice,
                            program.module(),
                            "sliced",
                            "cut",
                            PositionInvariance::Invariant,
                        );
                        let module = place::retain(&module, &[(point.stage, "sliced")]);
                        let placed = common::validated(&program, module);
                        common::wgsl(&placed);
                        placed_slices += 1;
                        for seed in 1..4 {
                            let Ok(whole) = run(&program, entry, seed) else {
                                continue;
                            };
                            let part = run(&placed, 0, seed).unwrap();
                            let expected = outputs(&program, entry, &whole);
                            for (binding, value) in outputs(&placed, 0, &part) {
                                assert_eq!(expected[&binding], value, "{}", file.display());
                            }
                            if criteria.contains(&Criterion::Discard) {
                                assert_eq!(whole.discarded, part.discarded, "{}", file.display());
                            }
                            compared += 1;
                        }
                    }
                }
            }
        }
        assert!(placed_slices > 10);
        assert!(compared > placed_slices, "{compared} of {placed_slices}");
    }
}
