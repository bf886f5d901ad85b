//! Finds discontinuous values: interpolation between two vertices has no meaning for them.
//!
//! A discontinuity is an operation on a value that varies over a triangle: a discontinuous float
//! operation (`floor`, `step`), or one that turns floats into an integer or a bool. Values that
//! depend on it through a product, a branch or an index count as discontinuous too. Noise is an
//! exception that we cannot prove: its cells join continuously. If range analysis shows that the
//! operand never crosses the discontinuity, we ignore it.
//!
//! The operands of a discontinuity are continuous. A small error of theirs moves one threshold by
//! as little. But `fract` has a threshold in every unit, and if the operand was scaled up before,
//! as a depth packed into bytes is, a small error decides everything.

use naga::{BinaryOperator, Expression, Handle, MathFunction, ScalarKind};

use crate::analysis::range::AllRanges;
use crate::analysis::values::{ContextId, Node, ValueId, Values};
use crate::evaluate::interval::Interval;

/// Why a value cannot be interpolated.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Discontinuity {
    /// The value itself has a discontinuity.
    Own {
        /// The operation that has it.
        operation: String,
    },
    /// A periodic operation uses the value: a small error of the value becomes a full step there.
    Amplified {
        /// The periodic operation.
        operation: String,
    },
}

/// For each value, the discontinuity that it has or depends on, or else a periodic one that depends
/// on it.
pub(crate) fn reached(values: &Values<'_, '_>, ranges: &AllRanges) -> Vec<Option<Discontinuity>> {
    let users = values.users();
    let mut found: Vec<Option<Discontinuity>> = (0..values.values.len())
        .map(|id| {
            let operation = happens(values, ranges, id)?;
            Some(Discontinuity::Own { operation })
        })
        .collect();
    let own: Vec<ValueId> = (0..found.len()).filter(|id| found[*id].is_some()).collect();
    let mut work = own.clone();
    while let Some(id) = work.pop() {
        for user in &users[id] {
            // A value that is constant over the triangle is safe, however it was computed.
            if found[*user].is_none() && !is_flat(values, *user) {
                found[*user] = found[id].clone();
                work.push(*user);
            }
        }
    }
    let reaches = |reached: &Option<Discontinuity>| match reached {
        Some(Discontinuity::Own { operation }) if comes_again(operation) => {
            let operation = operation.clone();
            Some(Discontinuity::Amplified { operation })
        }
        _ => None,
    };
    let mut work: Vec<(ValueId, Discontinuity)> = own
        .into_iter()
        .filter_map(|id| Some((id, reaches(&found[id])?)))
        .collect();
    while let Some((id, reached)) = work.pop() {
        for operand in &values.values[id].operands {
            if found[*operand].is_none() && !is_flat(values, *operand) {
                found[*operand] = Some(reached.clone());
                work.push((*operand, reached.clone()));
            }
        }
    }
    found
}

/// Whether the discontinuity repeats periodically, rather than being at one place.
fn comes_again(operation: &str) -> bool {
    const ONCE: [&str; 8] = [
        "step",
        "sign",
        "atan2",
        "refract",
        "faceForward",
        "a comparison",
        "a comparison of depths",
        "a test",
    ];
    !ONCE.contains(&operation)
}

fn is_flat(values: &Values<'_, '_>, id: ValueId) -> bool {
    values.values[id].fact.rate.is_flat()
}

/// Name of the operation if its result may be discontinuous within a triangle.
fn happens(values: &Values<'_, '_>, ranges: &AllRanges, id: ValueId) -> Option<String> {
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
    let operands = crate::graph::operands::of_expression(expression);
    if !operands.iter().any(varies) {
        return None;
    }
    let whole = kind(e).is_some_and(|k| k != ScalarKind::Float);
    let named = operation(expression).or(match expression {
        Expression::ImageSample {
            depth_ref: Some(_), ..
        } => Some("a comparison of depths"),
        Expression::Math { .. } | Expression::ImageLoad { .. } if whole => Some("an integer"),
        _ => None,
    });
    let named = named.filter(|_| !is_steady(values, ranges, context, expression));
    named.map(str::to_owned)
}

/// Whether the operands stay away from the discontinuity.
fn is_steady(
    values: &Values<'_, '_>,
    ranges: &AllRanges,
    context: ContextId,
    expression: &Expression,
) -> bool {
    let of = |o: Handle<Expression>| ranges.operand(values, context, o);
    match expression {
        Expression::Math { fun, arg, arg1, .. } => {
            let x = of(*arg);
            let y = arg1.map_or(Interval::ANYTHING, of);
            match fun {
                MathFunction::Floor | MathFunction::Fract => same(x, f64::floor),
                MathFunction::Ceil => same(x, f64::ceil),
                MathFunction::Trunc => same(x, f64::trunc),
                MathFunction::Round => same(x, f64::round_ties_even),
                MathFunction::Sign => apart(x, Interval::new(0.0, 0.0)),
                // step(edge, x)
                MathFunction::Step => apart(x, y),
                // The cut is at x < 0 and y = 0.
                MathFunction::Atan2 => {
                    let zero = Interval::new(0.0, 0.0);
                    (y.low > 0.0 && apart(y, zero)) || apart(x, zero)
                }
                _ => false,
            }
        }
        Expression::Binary { op, left, right } => match op {
            BinaryOperator::Equal
            | BinaryOperator::NotEqual
            | BinaryOperator::Less
            | BinaryOperator::LessEqual
            | BinaryOperator::Greater
            | BinaryOperator::GreaterEqual => apart(of(*left), of(*right)),
            BinaryOperator::Modulo => same(of(*left).over(of(*right)), f64::trunc),
            _ => false,
        },
        Expression::As {
            kind: ScalarKind::Sint | ScalarKind::Uint,
            expr,
            convert: Some(_),
        } => same(of(*expr), f64::trunc),
        // Conversions to 32 bits or more lose nothing that fits.
        Expression::As {
            kind: ScalarKind::Float,
            convert: Some(width),
            ..
        } => *width >= 4,
        _ => false,
    }
}

/// Relative error of a range's bounds by rounding. Ranges are real numbers, and rounding is
/// monotonic.
const ROUNDED: f64 = 1e-5;

/// A bound lowered by the rounding error. Whole numbers are exact.
fn below(low: f64) -> f64 {
    low - ROUNDED * low.abs()
}

fn above(high: f64) -> f64 {
    high + ROUNDED * high.abs()
}

/// Whether a monotonic function has the same value at both ends, including rounding.
fn same(range: Interval, function: fn(f64) -> f64) -> bool {
    let whole = |end: f64| end.fract() == 0.0;
    let low = if whole(range.low) {
        range.low
    } else {
        below(range.low)
    };
    let high = if whole(range.high) {
        range.high
    } else {
        above(range.high)
    };
    low.is_finite() && high.is_finite() && function(low) == function(high)
}

/// Whether two ranges are apart by more than rounding.
fn apart(a: Interval, b: Interval) -> bool {
    above(a.high) < below(b.low) || above(b.high) < below(a.low)
}

/// Name of an operation with a discontinuous result.
pub(crate) fn operation(expression: &Expression) -> Option<&'static str> {
    use BinaryOperator as B;
    Some(match expression {
        Expression::Math { fun, .. } => match fun {
            MathFunction::Floor => "floor",
            MathFunction::Ceil => "ceil",
            MathFunction::Round => "round",
            MathFunction::Trunc => "trunc",
            MathFunction::Fract => "fract",
            MathFunction::Step => "step",
            MathFunction::Sign => "sign",
            MathFunction::Modf | MathFunction::Frexp => "modf",
            MathFunction::QuantizeToF16 => "quantizeToF16",
            // `atan2` at its cut, `refract` at total reflection, `faceForward` where the side
            // changes.
            MathFunction::Atan2 => "atan2",
            MathFunction::Refract => "refract",
            MathFunction::FaceForward => "faceForward",
            _ => return None,
        },
        Expression::Binary { op, .. } => match op {
            B::Modulo => "%",
            B::Equal | B::NotEqual | B::Less | B::LessEqual | B::Greater | B::GreaterEqual => {
                "a comparison"
            }
            B::And | B::ExclusiveOr | B::InclusiveOr | B::ShiftLeft | B::ShiftRight => {
                "a bit operation"
            }
            _ => return None,
        },
        Expression::As { kind, convert, .. } => match (kind, convert) {
            (ScalarKind::Float, Some(_)) => "a conversion",
            (_, None) => "bitcast",
            _ => "a conversion to an integer",
        },
        Expression::Relational { .. } => "a test",
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_jump_outside_of_the_range_does_not_happen() {
        let range = Interval::new;
        assert!(same(range(1.25, 1.75), f64::floor));
        assert!(same(range(1.0, 1.75), f64::floor));
        assert!(!same(range(1.25, 2.0), f64::floor));
        assert!(!same(range(1.25, 1.999_999_9), f64::floor));
        assert!(same(range(-0.25, 0.25), f64::trunc));
        assert!(!same(Interval::ANYTHING, f64::floor));
        assert!(apart(range(0.0, 1.0), range(1.5, 2.0)));
        assert!(!apart(range(0.0, 1.0), range(1.0, 2.0)));
        assert!(!apart(Interval::ANYTHING, range(1.0, 2.0)));
    }
}
