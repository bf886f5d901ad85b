//! Rebuilds slices as code: the original statements, filtered and in order, in fresh arenas with
//! new `Emit`s.
//!
//! All functions take a module by reference and return another. By construction an expression
//! refers only to earlier ones, every expression that needs evaluation is in exactly one `Emit` at
//! the point where the original evaluated it, and a call's result appears with its call.

use naga::{Module, ShaderStage, Statement};

mod builder;
mod discard;
mod function;
mod interface;
mod members;
mod rewrite;

pub use builder::Builder;
pub use discard::without_discard;
pub(crate) use function::free_name;
use interface::Placement;
pub use interface::{PositionInvariance, io_struct};
pub use rewrite::{Replacement, Replacements, Rewrite, prologue, prologue_replacing, rewritten};

use crate::graph::{Graph, operands};
use crate::slice::Slice;

/// The module `onto` with a slice of one of its entry points as a new entry point `name` of the
/// same stage. `onto` is the module of `graph`, or one on which other slices of it have been
/// placed, so that handles remain valid.
///
/// Functions that the slice keeps whole are shared; others become `{name}_{suffix}`. The entry's
/// arguments and results are narrowed to the slice, and structs become new types `{name}_{suffix}`.
///
/// A slice of a vertex stage must decide the position; otherwise the result does not validate.
pub fn entry_point(
    graph: &Graph<'_>,
    slice: &Slice,
    onto: &Module,
    name: &str,
    suffix: &str,
    position: PositionInvariance,
) -> Module {
    let placement = Placement {
        name,
        suffix,
        position,
    };
    function::place(graph, slice, onto, &placement)
}

/// The module with an entry point's position marked `@invariant`.
pub fn with_invariant_position(module: &Module, entry: usize) -> Module {
    interface::with_invariant_position(module, entry)
}

/// The module with only these entry points and their dependences, without unused functions,
/// globals, types, constants and dead `let`s.
pub fn retain(module: &Module, entries: &[(ShaderStage, &str)]) -> Module {
    let mut module = module.clone();
    module
        .entry_points
        .retain(|e| entries.contains(&(e.stage, e.name.as_str())));
    module.doc_comments = None;
    let functions = module
        .functions
        .iter_mut()
        .map(|(_, f)| f)
        .chain(module.entry_points.iter_mut().map(|e| &mut e.function));
    for function in functions {
        drop_dead_names(function);
    }
    naga::compact::compact(&mut module, naga::compact::KeepUnused::No);
    // Compaction keeps named constants, so remove unused names first.
    while drop_unused_constant_names(&mut module) {
        naga::compact::compact(&mut module, naga::compact::KeepUnused::No);
    }
    module
}

/// Removes the names of unused constants; returns whether there were any.
fn drop_unused_constant_names(module: &mut Module) -> bool {
    let mut used = vec![false; module.constants.len()];
    let functions = module
        .functions
        .iter()
        .map(|(_, f)| f)
        .chain(module.entry_points.iter().map(|e| &e.function));
    let arenas = functions
        .map(|f| &f.expressions)
        .chain(std::iter::once(&module.global_expressions));
    for (_, expression) in arenas.flat_map(|a| a.iter()) {
        if let naga::Expression::Constant(c) = expression {
            used[c.index()] = true;
        }
    }
    let mut dropped = false;
    for (handle, constant) in module.constants.iter_mut() {
        if !used[handle.index()] {
            dropped |= constant.name.take().is_some();
        }
    }
    dropped
}

/// Removes the names of expressions without dependent statements: compaction keeps named
/// expressions.
fn drop_dead_names(function: &mut naga::Function) {
    let mut used = vec![false; function.expressions.len()];
    operands::visit(&function.body, &mut |statement| {
        let read = operands::of_statement(statement);
        for e in read.into_iter().chain(operands::result(statement)) {
            used[e.index()] = true;
        }
    });
    for (e, expression) in function.expressions.iter().rev() {
        if used[e.index()] {
            for operand in operands::of_expression(expression) {
                used[operand.index()] = true;
            }
        }
    }
    function.named_expressions.retain(|e, _| used[e.index()]);
}

/// Whether a block does nothing.
fn is_idle(block: &naga::Block) -> bool {
    block.iter().all(|s| matches!(s, Statement::Emit(_)))
}
