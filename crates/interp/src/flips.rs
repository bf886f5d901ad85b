//! Counts decisions that exact arithmetic would make differently.

use naga::{BinaryOperator, Expression, MathFunction, RelationalFunction, ScalarKind};

use super::math;
use super::number::Number;
use super::value::{Scalar, Value};

/// The number of components of `decided` that change if `expression` is evaluated on the references
/// of its operands ([`Number::truth`]). 0 if it makes no decision, or the operands have no
/// references.
pub(crate) fn of<F: Number>(
    expression: &Expression,
    operands: &[&Value<F>],
    decided: &Value<F>,
) -> u64 {
    use BinaryOperator as B;
    use MathFunction as M;
    let is_decision = match expression {
        Expression::Binary { op, .. } => matches!(
            op,
            B::Equal | B::NotEqual | B::Less | B::LessEqual | B::Greater | B::GreaterEqual
        ),
        Expression::Relational { fun, .. } => {
            matches!(fun, RelationalFunction::IsNan | RelationalFunction::IsInf)
        }
        Expression::As { kind, .. } => *kind != ScalarKind::Float,
        Expression::Math { fun, .. } => matches!(
            fun,
            M::Refract
                | M::FaceForward
                | M::Frexp
                | M::Pack4x8snorm
                | M::Pack4x8unorm
                | M::Pack2x16snorm
                | M::Pack2x16unorm
                | M::Pack2x16float
        ),
        _ => false,
    };
    if !is_decision {
        return 0;
    }
    let Some(truths) = operands
        .iter()
        .map(|o| truths(o))
        .collect::<Option<Vec<_>>>()
    else {
        return 0;
    };
    let by_truth: Vec<&Value<f64>> = truths.iter().collect();
    if let Expression::Math { fun, .. } = expression
        && let (Ok(Some(a)), Ok(Some(b))) =
            (math::turns(*fun, operands), math::turns(*fun, &by_truth))
    {
        return u64::from(a != b);
    }
    math::operation(expression, &by_truth).map_or(0, |other| differing(decided, &other))
}

fn truths<F: Number>(value: &Value<F>) -> Option<Value<f64>> {
    Some(match value {
        Value::Scalar(scalar) => Value::Scalar(match scalar {
            Scalar::F32(x) => Scalar::F32(x.truth()?),
            Scalar::I32(x) => Scalar::I32(*x),
            Scalar::U32(x) => Scalar::U32(*x),
            Scalar::Bool(x) => Scalar::Bool(*x),
        }),
        Value::Composite(parts) => {
            Value::Composite(parts.iter().map(truths).collect::<Option<_>>()?)
        }
        Value::Pointer { .. } | Value::Resource(_) => return None,
    })
}

fn differing<F: Number>(a: &Value<F>, b: &Value<f64>) -> u64 {
    match (a, b) {
        (Value::Composite(a), Value::Composite(b)) => {
            a.iter().zip(b).map(|(a, b)| differing(a, b)).sum()
        }
        (Value::Scalar(a), Value::Scalar(b)) => u64::from(match (a, b) {
            (Scalar::I32(a), Scalar::I32(b)) => a != b,
            (Scalar::U32(a), Scalar::U32(b)) => a != b,
            (Scalar::Bool(a), Scalar::Bool(b)) => a != b,
            _ => false,
        }),
        _ => 0,
    }
}
