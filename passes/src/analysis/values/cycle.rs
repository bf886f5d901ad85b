//! Cycles of values that depend on each other through loops.

use std::collections::{BTreeMap, HashSet};

use naga::Statement;
use petgraph::algo::kosaraju_scc;
use petgraph::graph::DiGraph;

use crate::analysis::values::{Node, Value, ValueId, Values};
use preshade_dataflow::graph::counted;
use preshade_dataflow::graph::memory::Origin;

/// The strongly connected components, users before operands.
pub(crate) fn cycles(values: &[Value]) -> Vec<Vec<ValueId>> {
    let edges = values.iter().map(|v| v.operands.len()).sum();
    let mut graph = DiGraph::<(), ()>::with_capacity(values.len(), edges);
    let nodes: Vec<_> = values.iter().map(|_| graph.add_node(())).collect();
    for (id, value) in values.iter().enumerate() {
        for operand in &value.operands {
            graph.add_edge(nodes[id], nodes[*operand], ());
        }
    }
    // Start at the operands.
    let mut cycles: Vec<Vec<ValueId>> = kosaraju_scc(&graph)
        .into_iter()
        .map(|cycle| cycle.into_iter().map(|node| node.index()).collect())
        .collect();
    cycles.reverse();
    cycles
}

/// The values of a cycle without some of them, operands first, as far as the rest is acyclic.
pub(crate) fn operands_first(
    values: &Values<'_, '_>,
    cycle: &[ValueId],
    without: &[ValueId],
) -> Vec<ValueId> {
    let mut left: HashSet<ValueId> = cycle.iter().copied().collect();
    for id in without {
        left.remove(id);
    }
    let mut ordered = Vec::with_capacity(left.len());
    for start in cycle {
        if !left.remove(start) {
            continue;
        }
        // Each value with the operands still to visit.
        let mut stack = vec![(*start, values.values[*start].operands.iter())];
        while let Some((id, operands)) = stack.last_mut() {
            match operands.find(|o| left.contains(o)) {
                Some(operand) => {
                    left.remove(operand);
                    stack.push((*operand, values.values[*operand].operands.iter()));
                }
                None => {
                    ordered.push(*id);
                    stack.pop();
                }
            }
        }
    }
    ordered
}

/// Iterations after which the ranges of an uncounted loop are assumed to grow without bound.
pub(crate) const UNCOUNTED_ITERATIONS: usize = 8;
/// Largest number of iterations of a counted loop to follow.
const MOST_ITERATIONS: usize = 256;

/// The loop-carried values of a cycle.
pub(crate) struct Merges {
    pub of: Vec<ValueId>,
    /// How often they are merged, if the loops are counted: once per iteration at the header and in
    /// `continuing`, and once at the exit.
    pub iterations: Option<usize>,
}

impl Merges {
    pub fn of(values: &Values<'_, '_>, cycle: &[ValueId]) -> Self {
        let mut loops = BTreeMap::new();
        let mut of = Vec::new();
        for id in cycle {
            let Node::Version(context, version) = values.values[*id].node else {
                continue;
            };
            let f = values.function(context);
            let Origin::Phi { at: Some(at), .. } = *f.memory.origin(version) else {
                continue;
            };
            if matches!(f.statements.get(at).statement, Statement::Loop { .. }) {
                of.push(*id);
                loops.insert((context, at), counted::trips(values.graph.module(), f, at));
            }
        }
        let iterations = loops.values().try_fold(1_usize, |product, trips| {
            let iterations = 2 * usize::try_from((*trips)?).ok()? + 2;
            product
                .checked_mul(iterations)
                .filter(|t| *t <= MOST_ITERATIONS)
        });
        let iterations = iterations.filter(|_| !of.is_empty());
        Self { of, iterations }
    }
}
