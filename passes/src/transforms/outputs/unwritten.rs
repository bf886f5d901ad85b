//! Outputs that no statement writes.

use naga::{AddressSpace, Binding, Expression};

use crate::analysis::reach::with_operands;
use crate::analysis::values::{Node, Value, ValueId, Values};
use preshade_dataflow::graph::Graph;
use preshade_dataflow::graph::cells::Root;
use preshade_dataflow::graph::memory::Origin;

/// Whether an entry point writes nothing to its output at `location`. Then it is 0 in each invocation. `false` if the
/// entry point is too large, or has no such output.
pub(crate) fn is_unwritten(graph: &Graph<'_>, entry: usize, location: u32) -> bool {
    let Ok(values) = Values::new(graph, entry) else {
        return false;
    };
    let is_it = |binding: &Option<Binding>| matches!(binding, Some(Binding::Location { location: own, .. }) if *own == location);
    let outputs = values.outputs().into_iter();
    let outputs: Vec<ValueId> = outputs
        .filter(|(binding, _)| is_it(binding))
        .map(|(_, value)| value)
        .collect();
    if outputs.is_empty() {
        return false;
    }
    let reached = with_operands(&values, outputs);
    let mut sources = values.values.iter().zip(reached);
    sources
        .all(|(value, reached)| !reached || !value.operands.is_empty() || is_zero(&values, value))
}

/// Whether a value without operands is 0 because nothing was written.
fn is_zero(values: &Values<'_, '_>, value: &Value) -> bool {
    match &value.node {
        Node::Version(context, version) => {
            let f = values.function(*context);
            if *f.memory.origin(*version) != Origin::Initial {
                return false;
            }
            match f.memory.cell(*version).root {
                Root::Local(local) => f.function.local_variables[local].init.is_none(),
                Root::Global(global) => {
                    let global = &values.graph.module().global_variables[global];
                    global.space == AddressSpace::Private && global.init.is_none()
                }
                Root::Argument(_) => false,
            }
        }
        Node::Expression(context, e, _) => {
            let function = values.function(*context).function;
            matches!(function.expressions[*e], Expression::ZeroValue(_))
        }
        Node::Input(_) | Node::Control(..) => false,
    }
}
