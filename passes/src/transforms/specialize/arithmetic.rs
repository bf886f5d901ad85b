//! Interval arithmetic on abstract values, rounded outwards.

use naga::{
    BinaryOperator, Expression, MathFunction, RelationalFunction, ScalarKind, UnaryOperator,
};

use super::known::{AbstractValue, Scalar};
use naga_interp::Number as _;
use naga_interp::accuracy::Accuracy;
use naga_interp::interval::{Arithmetic, Interval};

/// Bounds of the result of a unary operator.
pub(crate) fn unary(op: UnaryOperator, operand: &AbstractValue) -> AbstractValue {
    AbstractValue::zip(&[operand], &|s| match (op, s) {
        (UnaryOperator::LogicalNot, [Scalar::Bool(b)]) => Some(Scalar::Bool(!b)),
        (UnaryOperator::Negate, [Scalar::Number(kind, x)]) => Scalar::number(*kind, x.negated()),
        (UnaryOperator::BitwiseNot, [Scalar::Number(kind, _)]) => {
            let bits = s[0].integer()?;
            single(
                *kind,
                if *kind == ScalarKind::Uint {
                    i64::from(!(bits as u32))
                } else {
                    !bits
                },
            )
        }
        _ => None,
    })
}

/// Applies a binary operator to scalars, or component by component to vectors. Not for matrices.
pub(crate) fn binary(
    op: BinaryOperator,
    left: &AbstractValue,
    right: &AbstractValue,
) -> AbstractValue {
    use BinaryOperator as B;
    use Scalar::{Bool, Number};
    if let (B::LogicalAnd | B::LogicalOr, Some(known)) = (op, one_sided(op, left, right)) {
        return known;
    }
    AbstractValue::zip(&[left, right], &|s| match s {
        [Number(kind, a), Number(other, b)] if kind == other => match op {
            B::Add | B::Subtract | B::Multiply => {
                Scalar::number(*kind, arithmetic(*kind).binary(op, *a, *b)?)
            }
            B::Divide if *kind == ScalarKind::Float => {
                Scalar::number(*kind, Arithmetic::Adapter.binary(op, *a, *b)?)
            }
            _ => match Interval::holds(op, *a, *b) {
                Some(truth) => Some(Bool(truth)),
                None => single(*kind, integer(op, s[0].integer()?, s[1].integer()?)?),
            },
        },
        [Number(ScalarKind::Sint, _), Number(ScalarKind::Uint, _)] => match op {
            B::ShiftLeft | B::ShiftRight => single(
                ScalarKind::Sint,
                integer(op, s[0].integer()?, s[1].integer()?)?,
            ),
            _ => None,
        },
        [Bool(a), Bool(b)] => Some(Bool(match op {
            B::LogicalAnd | B::And => *a && *b,
            B::LogicalOr | B::InclusiveOr => *a || *b,
            B::Equal => a == b,
            B::NotEqual | B::ExclusiveOr => a != b,
            _ => return None,
        })),
        _ => None,
    })
}

/// Integers are exact: [`Scalar::number`] rejects those that do not fit.
fn arithmetic(kind: ScalarKind) -> Arithmetic {
    match kind {
        ScalarKind::Float => Arithmetic::Adapter,
        _ => Arithmetic::Real,
    }
}

fn single(kind: ScalarKind, value: i64) -> Option<Scalar> {
    Scalar::number(kind, Interval::exactly(value as f64))
}

/// `false && x` and `true || x`: one known operand suffices.
fn one_sided(
    op: BinaryOperator,
    left: &AbstractValue,
    right: &AbstractValue,
) -> Option<AbstractValue> {
    let decides = op == BinaryOperator::LogicalOr;
    [left, right]
        .into_iter()
        .find(|k| k.truth() == Some(decides))
        .cloned()
}

fn integer(op: BinaryOperator, a: i64, b: i64) -> Option<i64> {
    use BinaryOperator as B;
    let bits = || u32::try_from(b).ok().filter(|b| *b < 32);
    Some(match op {
        B::Divide => a.checked_div(b)?,
        B::Modulo => a.checked_rem(b)?,
        B::And => a & b,
        B::InclusiveOr => a | b,
        B::ExclusiveOr => a ^ b,
        B::ShiftLeft => a.checked_shl(bits()?)?,
        B::ShiftRight => a >> bits()?,
        _ => return None,
    })
}

/// Applies a math function, component by component if it works so.
pub(crate) fn math(fun: MathFunction, arguments: &[&AbstractValue]) -> AbstractValue {
    use MathFunction as M;
    match (fun, arguments) {
        (M::Abs | M::Sign | M::Saturate | M::Floor | M::Ceil | M::Trunc, _)
        | (M::Min | M::Max | M::Clamp | M::Step | M::Mix, _) => {
            AbstractValue::zip(arguments, &|s| of_components(fun, s))
        }
        (M::Dot, [AbstractValue::Parts(x), AbstractValue::Parts(y)]) => x
            .iter()
            .zip(y)
            .map(|(x, y)| binary(BinaryOperator::Multiply, x, y))
            .reduce(|a, b| binary(BinaryOperator::Add, &a, &b))
            .unwrap_or_default(),
        _ => AbstractValue::Unknown,
    }
}

fn of_components(fun: MathFunction, scalars: &[Scalar]) -> Option<Scalar> {
    let Scalar::Number(kind, _) = *scalars.first()? else {
        return None;
    };
    let intervals = scalars.iter().map(|s| match s {
        Scalar::Number(_, interval) => Some(*interval),
        Scalar::Bool(_) => None,
    });
    let intervals = intervals.collect::<Option<Vec<_>>>()?;
    match (fun, intervals.as_slice()) {
        // If the bounds cross, the languages leave the result open.
        (MathFunction::Clamp, [_, low, high]) if low.high > high.low => None,
        _ => Scalar::number(kind, arithmetic(kind).call(fun, &intervals)?),
    }
}

/// Converts a value to 32 bits or to `bool`.
pub(crate) fn converted(kind: ScalarKind, operand: &AbstractValue) -> AbstractValue {
    AbstractValue::zip(&[operand], &|s| {
        let [s] = s else { return None };
        match (kind, *s) {
            (ScalarKind::Bool, Scalar::Bool(_)) => Some(*s),
            (ScalarKind::Bool, Scalar::Number(_, x)) => {
                let zero = Interval::exactly(0.0);
                Interval::holds(BinaryOperator::NotEqual, x, zero).map(Scalar::Bool)
            }
            (_, Scalar::Bool(b)) => single(kind, i64::from(b)),
            (ScalarKind::Float, Scalar::Number(from, x)) => {
                let is_exact = from == ScalarKind::Float || x.magnitude() <= f64::from(1 << 24);
                match is_exact {
                    true => Scalar::number(kind, x),
                    false => Scalar::number(kind, x.rounded(Accuracy::ROUNDED)),
                }
            }
            // Overflow wraps.
            (_, Scalar::Number(_, x)) => Scalar::number(kind, x.rising(f64::trunc)),
        }
    })
}

pub(crate) fn relational(fun: RelationalFunction, argument: &AbstractValue) -> AbstractValue {
    let op = match fun {
        RelationalFunction::All => BinaryOperator::LogicalAnd,
        RelationalFunction::Any => BinaryOperator::LogicalOr,
        RelationalFunction::IsNan | RelationalFunction::IsInf => return AbstractValue::Unknown,
    };
    match argument {
        AbstractValue::Parts(parts) => parts
            .iter()
            .cloned()
            .reduce(|a, b| binary(op, &a, &b))
            .unwrap_or_default(),
        scalar => scalar.clone(),
    }
}

/// Whether an integer literal may replace `operand` in `expression`. If the value flows into other
/// numbers we keep the read: it may become a float, and front ends fold float literals on the CPU.
pub(crate) fn takes_literal(expression: &Expression, operand: naga::Handle<Expression>) -> bool {
    use BinaryOperator as B;
    match expression {
        Expression::Binary { op, .. } => matches!(
            op,
            B::Equal | B::NotEqual | B::Less | B::LessEqual | B::Greater | B::GreaterEqual
        ),
        Expression::ImageLoad {
            array_index,
            sample,
            level,
            ..
        } => [array_index, sample, level].contains(&&Some(operand)),
        Expression::ImageSample { array_index, .. } => *array_index == Some(operand),
        _ => false,
    }
}
