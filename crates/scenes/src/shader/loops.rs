//! Iteration counts for the loops of a bare shader.

use std::collections::{BTreeMap, BTreeSet};

use naga::{BinaryOperator, Expression, ScalarKind};
use preshade_passes::analysis::values::ValueId;

use super::flow::StageFlow;
use preshade_draw::scene::Value;
use preshade_draw::scene::layout::leaf_shape;

/// Iterations if the host decides them. With four, the first, middle and last ones differ.
const TURNS: f64 = 4.0;

/// A value, by path, for each integer that a loop's counter is compared with. With 0 the loop would
/// not run.
pub(super) fn counts(flow: &StageFlow<'_, '_>) -> BTreeMap<String, Value> {
    let module = flow.values.graph.module();
    let cycles = flow.values.cycles().iter().filter(|c| c.len() > 1);
    let carried: BTreeSet<ValueId> = cycles.flatten().copied().collect();
    let mut found = BTreeMap::new();
    for value in 0..flow.values.values.len() {
        let Some((context, Expression::Binary { op, left, right }, _)) = flow.expression(value)
        else {
            continue;
        };
        if !is_bound(*op) {
            continue;
        }
        let sides = [*left, *right].map(|e| flow.values.named(context, e));
        let [Some(left), Some(right)] = sides.map(|s| Some(flow.behind(s?))) else {
            continue;
        };
        let is_carried = |side: &BTreeSet<ValueId>| side.iter().any(|v| carried.contains(v));
        let bound = match (is_carried(&left), is_carried(&right)) {
            (true, false) => right,
            (false, true) => left,
            _ => continue,
        };
        for read in bound.into_iter().filter_map(|v| flow.read(v)) {
            let shape = leaf_shape(&module.types[read.ty].inner);
            let is_integer = shape.is_some_and(|(columns, rows, scalar)| {
                (columns, rows) == (1, 1)
                    && matches!(scalar.kind, ScalarKind::Sint | ScalarKind::Uint)
            });
            if is_integer && read.semantic(module).is_none() {
                found.insert(read.text(module), Value::Numbers(vec![TURNS]));
            }
        }
    }
    found
}

fn is_bound(op: BinaryOperator) -> bool {
    use BinaryOperator as B;
    matches!(
        op,
        B::Less | B::LessEqual | B::Greater | B::GreaterEqual | B::NotEqual
    )
}
