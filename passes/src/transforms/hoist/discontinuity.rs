//! Finds discontinuous values: interpolation between two vertices has no meaning for them.
//!
//! A discontinuity is an operation on a value that varies over a triangle: a discontinuous float
//! operation (`floor`, `step`), or one that turns floats into an integer or a bool. Values that
//! depend on it through a product, a branch or an index count as discontinuous too. Noise is an
//! exception that we cannot prove: its cells join continuously. If range analysis shows that the
//! operand never crosses the discontinuity, we ignore it.
//!
//! The operands of a discontinuity are continuous. A small error of theirs moves one threshold by
//! as little. But `fract` has a threshold in every unit. If the operand was scaled up before, as
//! for a depth packed into bytes, a small error decides everything.

use naga::{BinaryOperator, Expression, Handle, ScalarKind};

use crate::analysis::operations::{Break, ZERO, discontinuity, of_sample};
use crate::analysis::range::AllRanges;
use crate::analysis::values::{Node, ValueId, Values};

/// Why a value cannot be interpolated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Discontinuity {
    /// The value itself has a discontinuity, of this operation.
    Own(&'static str),
    /// This periodic operation uses the value: a small error becomes a full step there.
    Amplified(&'static str),
}

/// For each value, the discontinuity that it has or depends on, or else a periodic one that depends
/// on it.
pub(crate) fn reached(values: &Values<'_, '_>, ranges: &AllRanges) -> Vec<Option<Discontinuity>> {
    let users = values.users();
    let own: Vec<(ValueId, Break)> = (0..values.values.len())
        .filter_map(|id| Some((id, happens(values, ranges, id)?)))
        .collect();
    let mut found = vec![None; values.values.len()];
    for (id, discontinuity) in &own {
        found[*id] = Some(Discontinuity::Own(discontinuity.name));
    }
    let mut work: Vec<ValueId> = own.iter().map(|(id, _)| *id).collect();
    while let Some(id) = work.pop() {
        for user in &users[id] {
            // A value that is constant over the triangle is safe, however it was computed.
            if found[*user].is_none() && !is_flat(values, *user) {
                found[*user] = found[id];
                work.push(*user);
            }
        }
    }
    let mut work: Vec<(ValueId, Discontinuity)> = own
        .into_iter()
        .filter(|(_, discontinuity)| discontinuity.at.repeats())
        .map(|(id, discontinuity)| (id, Discontinuity::Amplified(discontinuity.name)))
        .collect();
    while let Some((id, reached)) = work.pop() {
        for operand in &values.values[id].operands {
            if found[*operand].is_none() && !is_flat(values, *operand) {
                found[*operand] = Some(reached);
                work.push((*operand, reached));
            }
        }
    }
    found
}

fn is_flat(values: &Values<'_, '_>, id: ValueId) -> bool {
    values.values[id].fact.rate.is_flat()
}

/// The discontinuity that an operation may have within a triangle.
fn happens(values: &Values<'_, '_>, ranges: &AllRanges, id: ValueId) -> Option<Break> {
    let Node::Expression(context, e, _) = values.values[id].node else {
        return None;
    };
    if is_flat(values, id) {
        return None;
    }
    let f = values.function(context);
    let module = values.graph.module();
    let kind = |e: Handle<Expression>| f.ty(module, e).scalar_kind();
    let expression = &f.function.expressions[e];
    let varies = |o: &Handle<Expression>| {
        let id = values.named(context, *o);
        kind(*o) == Some(ScalarKind::Float) && id.is_none_or(|id| !is_flat(values, id))
    };
    // Operations on integers and bools: the discontinuity was earlier.
    let operands = naga_operands::of_expression(expression);
    if !operands.iter().any(varies) {
        return None;
    }
    let found = discontinuity(expression).or_else(|| of_sample(expression))?;
    let of = |o: Handle<Expression>| ranges.operand(values, context, o);
    let (x, y) = match expression {
        Expression::Math { arg, arg1, .. } => (of(*arg), arg1.map_or(ZERO, of)),
        Expression::Binary {
            op: BinaryOperator::Modulo,
            left,
            right,
        } => (of(*left).over(of(*right)), ZERO),
        Expression::Binary { left, right, .. } => (of(*left), of(*right)),
        Expression::As { expr, .. } => (of(*expr), ZERO),
        _ => (ZERO, ZERO),
    };
    (!found.at.is_avoided(x, y)).then_some(found)
}
