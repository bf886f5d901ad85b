//! Which values jump: between two vertices there is no value in between that interpolation could stand for.
//!
//! A jump is an operation of what varies over a triangle: one of floats that is not continuous (`floor`, `step`), or one that makes an integer or a truth of floats. What rests on it may jump too, by a
//! product, a branch or an index, and is taken to. That it may not, as in noise, whose cells meet, no rule here sees; that it does not happen where the operand lies is seen of the operand's range.
//!
//! What a jump is made of does not jump. Being off by a little it moves the place of one threshold by as little; but a `fract` of it has a threshold in every unit, and where it is scaled up ahead of that, as
//! a depth is that is packed into bytes, the little is all there is.

use naga::{BinaryOperator, Expression, Handle, MathFunction, ScalarKind};

use crate::analysis::range::{AllRanges, Range};
use crate::analysis::values::{ContextId, Node, ValueId, Values};

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

/// For each value, the jump that it is or rests on, or else one that comes again and again and rests on it.
pub(crate) fn reached(values: &Values<'_, '_>, ranges: &AllRanges) -> Vec<Option<Discontinuity>> {
    let users = values.users();
    let mut found: Vec<Option<Discontinuity>> = (0..values.values.len())
        .map(|id| {
            let operation = happens(values, ranges, id)?;
            Some(Discontinuity::Own { operation })
        })
        .collect();
    let jumps: Vec<ValueId> = (0..found.len()).filter(|id| found[*id].is_some()).collect();
    let mut work = jumps.clone();
    while let Some(id) = work.pop() {
        for user in &users[id] {
            // What is constant over the triangle is one value, however it came about.
            if found[*user].is_none() && !is_flat(values, *user) {
                found[*user] = found[id].clone();
                work.push(*user);
            }
        }
    }
    let reaches = |stays: &Option<Discontinuity>| match stays {
        Some(Discontinuity::Own { operation }) if comes_again(operation) => {
            let operation = operation.clone();
            Some(Discontinuity::Amplified { operation })
        }
        _ => None,
    };
    let mut work: Vec<(ValueId, Discontinuity)> = jumps
        .into_iter()
        .filter_map(|id| Some((id, reaches(&found[id])?)))
        .collect();
    while let Some((id, stays)) = work.pop() {
        for operand in &values.values[id].operands {
            if found[*operand].is_none() && !is_flat(values, *operand) {
                found[*operand] = Some(stays.clone());
                work.push((*operand, stays.clone()));
            }
        }
    }
    found
}

/// Whether an operation jumps wherever its operand has grown by as much again, rather than at one place.
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

/// The name of the operation that a value is, if its result may jump within a triangle.
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
    // Of integers and truths what jumps has jumped before.
    let operands = crate::graph::operands::of_expression(expression);
    if !operands.iter().any(varies) {
        return None;
    }
    let whole = kind(e).is_some_and(|k| k != ScalarKind::Float);
    let named = jump(expression).or(match expression {
        Expression::ImageSample {
            depth_ref: Some(_), ..
        } => Some("a comparison of depths"),
        Expression::Math { .. } | Expression::ImageLoad { .. } if whole => Some("an integer"),
        _ => None,
    });
    let named = named.filter(|_| !is_steady(values, ranges, context, expression));
    named.map(str::to_owned)
}

/// Whether the operands lie where the operation does not jump.
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
            let y = arg1.map_or(Range::ANYTHING, of);
            match fun {
                MathFunction::Floor | MathFunction::Fract => same(x, f64::floor),
                MathFunction::Ceil => same(x, f64::ceil),
                MathFunction::Trunc => same(x, f64::trunc),
                MathFunction::Round => same(x, f64::round_ties_even),
                MathFunction::Sign => apart(x, Range::new(0.0, 0.0)),
                // step(edge, x)
                MathFunction::Step => apart(x, y),
                // Its cut is where x is below 0 and y is 0.
                MathFunction::Atan2 => {
                    let zero = Range::new(0.0, 0.0);
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
        // Of 32 bits and more no number that fits is lost.
        Expression::As {
            kind: ScalarKind::Float,
            convert: Some(width),
            ..
        } => *width >= 4,
        _ => false,
    }
}

/// What roundings may move a range's end by, relative to it: ranges are of real numbers, and rounding keeps their order.
const ROUNDED: f64 = 1e-5;

/// An end of a range, moved by what roundings may. A whole number is one to every rounding.
fn below(low: f64) -> f64 {
    low - ROUNDED * low.abs()
}

fn above(high: f64) -> f64 {
    high + ROUNDED * high.abs()
}

/// Whether a function that never falls is the same number at both ends, roundings included.
fn same(range: Range, function: fn(f64) -> f64) -> bool {
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

/// Whether no number of one range comes near one of the other.
fn apart(a: Range, b: Range) -> bool {
    above(a.high) < below(b.low) || above(b.high) < below(a.low)
}

/// The name of an operation whose result jumps.
pub(crate) fn jump(expression: &Expression) -> Option<&'static str> {
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
            // At its cut, behind the origin; where reflection is total; where the side turns.
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
        let range = Range::new;
        assert!(same(range(1.25, 1.75), f64::floor));
        assert!(same(range(1.0, 1.75), f64::floor));
        assert!(!same(range(1.25, 2.0), f64::floor));
        assert!(!same(range(1.25, 1.999_999_9), f64::floor));
        assert!(same(range(-0.25, 0.25), f64::trunc));
        assert!(!same(Range::ANYTHING, f64::floor));
        assert!(apart(range(0.0, 1.0), range(1.5, 2.0)));
        assert!(!apart(range(0.0, 1.0), range(1.0, 2.0)));
        assert!(!apart(Range::ANYTHING, range(1.0, 2.0)));
    }
}
