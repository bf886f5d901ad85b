//! Rebuilds slices as code: the original statements, filtered and in order, in fresh arenas with
//! new `Emit`s.
//!
//! All functions take a module by reference and return another. By construction an expression
//! refers only to earlier ones, every expression that needs evaluation is in exactly one `Emit` at
//! the point where the original evaluated it, and a call's result appears with its call.

use naga::Module;

mod builder;
mod copies;
mod discard;
mod function;
mod interface;
mod members;
mod retain;
mod rewrite;

pub use builder::CodeBuilder;
pub(crate) use copies::copy_called;
pub use discard::without_discard;
pub use function::free_name;
use interface::Placement;
pub use interface::{PositionInvariance, io_struct};
pub use retain::retain;
pub use rewrite::{
    Replacement, Replacements, Rewrite, function_mut, prologue, prologue_replacing, rewritten,
};

use preshade_dataflow::graph::Graph;
use preshade_dataflow::slice::Slice;

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
