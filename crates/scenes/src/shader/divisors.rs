//! Values for uniforms of a bare shader that are divisors. A division by 0 would draw a black
//! picture.

use std::collections::BTreeMap;

use naga::{BinaryOperator, Expression, ScalarKind};
use preshade_passes::analysis::values::ValueId;

use super::flow::{BufferRead, StageFlow};
use preshade_draw::scene::Value;
use preshade_draw::scene::layout::leaf_shape;

/// An integer divisor. 1 would have no effect.
const PARTS: f64 = 4.0;

/// A float nearer to 0 than this is replaced.
const NEAR: f64 = 0.25;

/// A division, or a remainder, by uniforms.
pub(super) struct Division {
    /// The dividend.
    pub divided: Option<ValueId>,
    /// The uniforms whose product is the divisor.
    pub by: Vec<BufferRead>,
}

/// The divisions by uniforms among values.
pub(super) fn divisions(
    flow: &StageFlow<'_, '_>,
    values: impl IntoIterator<Item = ValueId>,
) -> Vec<Division> {
    let of = |value: ValueId| {
        let (context, Expression::Binary { op, left, right }, _) = flow.expression(value)? else {
            return None;
        };
        if !matches!(op, BinaryOperator::Divide | BinaryOperator::Modulo) {
            return None;
        }
        let mut by = flow.factors(flow.values.named(context, *right)?);
        by.retain(|read| read.is_uniform(flow.values.graph.module()));
        Some(Division {
            divided: flow.values.named(context, *left),
            by,
        })
    };
    values.into_iter().filter_map(of).collect()
}

/// A value, by path, for each uniform divisor of a stage that is an integer, or whose made-up value
/// is close to 0.
pub(super) fn numbers(flow: &StageFlow<'_, '_>) -> BTreeMap<String, Value> {
    let module = flow.values.graph.module();
    let all = divisions(flow, 0..flow.values.values.len());
    let number = |read: BufferRead| {
        let made_up = read.made_up(module)?;
        let (1, _, scalar) = leaf_shape(&module.types[read.ty].inner)? else {
            return None;
        };
        let number = match scalar.kind {
            ScalarKind::Sint | ScalarKind::Uint => PARTS,
            ScalarKind::Float if made_up.iter().any(|n| n.abs() < NEAR) => 1.0,
            _ => return None,
        };
        Some((read.text(module), Value::Numbers(vec![number])))
    };
    let by = all.into_iter().flat_map(|division| division.by);
    by.filter_map(number).collect()
}
