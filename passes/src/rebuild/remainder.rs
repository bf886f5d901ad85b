//! The rest of a stage that is given some of its values: it reads them, and lacks the code that
//! only they needed.

use std::collections::BTreeMap;

use naga::{Expression, Handle, Module};

use crate::analysis::values::{ContextId, Values};
use crate::rebuild::isolate::{self, isolate};
use crate::rebuild::outline::{Failed, Wanted};
use crate::rebuild::place::{self, CodeBuilder, PositionInvariance, Replacement, Rewrite};
use preshade_dataflow::graph::{FunctionId, Graph};
use preshade_dataflow::slice::{self, Criterion, OutputFilter, Termination};
use preshade_plan::program::Program;

/// The values that a stage is given, by index of the wanted ones.
pub(crate) type Given = BTreeMap<usize, Handle<Expression>>;

/// The module with unchanged author's functions, and the entry point of `values` without the code of
/// `wanted`, which `given` reads at its start. `termination` is of the loops that decide nothing more.
///
/// # Errors
/// [`Failed`].
pub(crate) fn rebuild(
    program: &Program,
    module: &Module,
    values: &Values<'_, '_>,
    wanted: &[Wanted],
    termination: Termination,
    given: &mut dyn FnMut(&mut CodeBuilder<'_>) -> Given,
) -> Result<Module, Failed> {
    let entry = values.entry;
    let contexts: Vec<ContextId> = wanted.iter().map(|w| w.context).collect();
    let (mut module, copies) = isolate(module, entry, values, &contexts.iter().copied().collect());
    // The values of each context: its own, and those of the contexts it calls.
    let below = isolate::reachable_contexts(values, &copies, &contexts);
    for (context, id) in &copies {
        let children = isolate::callees(values, &copies, &below, *context);
        module = place::rewritten(&module, *id, |build| {
            let carried = match id {
                FunctionId::EntryPoint(_) => given(build),
                FunctionId::Function(_) => below[context]
                    .iter()
                    .map(|i| {
                        let ty = build.ty(wanted[*i].inner.clone());
                        (*i, build.argument(&wanted[*i].name, ty, None))
                    })
                    .collect(),
            };
            let here = |i: &usize| wanted[*i].context == *context;
            Rewrite {
                replacements: carried
                    .iter()
                    .filter(|(i, _)| here(i))
                    .map(|(i, value)| (wanted[*i].expression, Replacement::Value(*value)))
                    .collect(),
                arguments: children
                    .iter()
                    .map(|(callee, through)| {
                        let passed = through.iter().filter_map(|i| carried.get(i).copied());
                        (*callee, passed.collect())
                    })
                    .collect(),
            }
        });
    }
    let built = program.with_module(module)?;
    let graph = Graph::build(&built);
    let observed = [Criterion::Output(OutputFilter::All), Criterion::Discard];
    let slice = slice::backward_with(&graph, entry, &observed, termination);
    let name = built.module().entry_points[entry].name.clone();
    let mut module = place::entry_point(
        &graph,
        &slice,
        built.module(),
        "preshade_remainder",
        "left",
        PositionInvariance::AsWritten,
    );
    let Some(mut placed) = module.entry_points.pop() else {
        return Err(Failed::Built("nothing was placed".to_owned()));
    };
    placed.name.clone_from(&name);
    placed.function.name = Some(name);
    module.entry_points[entry] = placed;
    Ok(module)
}
