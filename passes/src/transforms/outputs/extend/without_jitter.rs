//! A program whose jitter is 0 wherever it is read: a light has none.

use naga::{GlobalVariable, Handle, Module};

use super::Member;
use crate::transforms::outputs::remap::{self, Pair};
use naga_edit::variable::private;
use preshade_dataflow::graph::FunctionId;
use preshade_plan::mapping::name_of;
use preshade_plan::program::Program;
use shader_text::source::Invalid;

/// Why a jitter cannot be left out.
#[derive(Debug)]
pub(crate) enum Unsteady {
    /// No function reads it.
    Unread(String),
    /// A function reads a whole that it is a part of: the whole, and the jitter.
    Whole(String, String),
    /// The result is invalid: a bug.
    Built(Box<Invalid>),
}

/// The program with zeros for `jitter`.
///
/// # Errors
/// [`Unsteady`].
pub(crate) fn steady(program: &Program, jitter: &[Member]) -> Result<Program, Unsteady> {
    let mut module = program.module().clone();
    let functions = module
        .functions
        .iter()
        .map(|(h, _)| FunctionId::Function(h));
    let entries = (0..module.entry_points.len()).map(FunctionId::EntryPoint);
    let all: Vec<FunctionId> = functions.chain(entries).collect();
    let read = read(&module);
    let mut pairs = Vec::new();
    for ours in jitter {
        let name = name_of(&module, ours.global, &ours.steps);
        let mut of_it = read.iter().filter(|(global, _)| *global == ours.global);
        let whole = of_it
            .clone()
            .find(|(_, steps)| steps.len() < ours.steps.len() && ours.steps.starts_with(steps));
        if let Some((global, steps)) = whole {
            let whole = name_of(&module, *global, steps).to_string();
            return Err(Unsteady::Whole(whole, name.to_string()));
        }
        if !of_it.any(|(_, steps)| steps.starts_with(&ours.steps)) {
            return Err(Unsteady::Unread(name.to_string()));
        }
        let zero = format!("{}_zero", name.members.last().unwrap_or(&name.variable));
        let global = private(&mut module, &zero, ours.ty, None);
        pairs.push(Pair {
            ours: ours.clone(),
            theirs: Member {
                global,
                steps: Vec::new(),
                ty: ours.ty,
            },
        });
    }
    for id in all {
        module = remap::redirected(module, id, &pairs);
    }
    program.with_module(module).map_err(Unsteady::Built)
}

/// The parts of variables that any function reads.
fn read(module: &Module) -> Vec<(Handle<GlobalVariable>, Vec<usize>)> {
    let functions = module.functions.iter().map(|(_, f)| f);
    let entries = module.entry_points.iter().map(|e| &e.function);
    functions
        .chain(entries)
        .flat_map(remap::parts_read)
        .collect()
}
