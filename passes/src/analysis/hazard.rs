//! Operations that may return NaN or infinity for finite operands.

use naga::common::wgsl::TryToWgsl;
use naga::{BinaryOperator, Expression, Handle, Literal, MathFunction, Scalar, ScalarKind};

use crate::analysis::range::AllRanges;
use crate::analysis::values::{ValueId, Values};
use naga_interp::Number as _;
use naga_interp::accuracy::LARGEST_TANH;

/// Name of the operation, if it may return NaN or infinity for finite operands. `ranges` bound the
/// numbers that adapters compute (`AllRanges::computed`): a difference that is above 0 may be
/// rounded to 0.
pub(crate) fn undefined(
    values: &Values<'_, '_>,
    ranges: &AllRanges,
    context: usize,
    e: Handle<Expression>,
) -> Option<&'static str> {
    let f = values.function(context);
    let of = |o: Handle<Expression>| ranges.operand(values, context, o);
    let is_positive = |o: Handle<Expression>| of(o).low >= SMALLEST;
    match &f.function.expressions[e] {
        Expression::Binary { op, right, .. }
            if f.ty(values.graph.module(), e).scalar_kind() == Some(ScalarKind::Float) =>
        {
            let is_safe = of(*right).least() >= SMALLEST || is_nonzero(values, context, *right);
            match op {
                BinaryOperator::Divide if !is_safe => Some("/"),
                BinaryOperator::Modulo if !is_safe => Some("%"),
                _ => None,
            }
        }
        Expression::Math { fun, arg, arg1, .. } => match fun {
            // 0 / 0, if the edges may be the same.
            MathFunction::SmoothStep
                if arg1.is_none_or(|high| of(*arg).plus(of(high).negated()).least() < SMALLEST) =>
            {
                Some("smoothstep")
            }
            MathFunction::Atan2
                if of(*arg).least() < SMALLEST && arg1.is_none_or(|x| of(x).least() < SMALLEST) =>
            {
                Some("atan2")
            }
            MathFunction::Sqrt if of(*arg).low < 0.0 => Some("sqrt"),
            MathFunction::InverseSqrt if !is_positive(*arg) => Some("inverseSqrt"),
            MathFunction::Log | MathFunction::Log2 if !is_positive(*arg) => Some("log"),
            // 0 to the power of 0 or less is NaN or infinite.
            MathFunction::Pow
                if of(*arg).low < 0.0
                    || (!is_positive(*arg) && arg1.is_none_or(|y| !is_positive(y))) =>
            {
                Some("pow")
            }
            MathFunction::Normalize
                if shortest(values, ranges, context, *arg) < SMALLEST_LENGTH =>
            {
                Some("normalize")
            }
            MathFunction::Acos if of(*arg).magnitude() > 1.0 => Some("acos"),
            MathFunction::Asin if of(*arg).magnitude() > 1.0 => Some("asin"),
            MathFunction::Acosh => Some("acosh"),
            MathFunction::Atanh => Some("atanh"),
            MathFunction::Tan => Some("tan"),
            MathFunction::Inverse => Some("inverse"),
            MathFunction::Refract => Some("refract"),
            _ => None,
        },
        _ => None,
    }
}

/// Smallest safe divisor: its inverse is far from overflow.
const SMALLEST: f64 = 1e-30;

/// Smallest safe length of a vector: its square is far from the numbers that adapters flush to 0.
const SMALLEST_LENGTH: f64 = 1e-15;

/// A length that a vector is never shorter than: one component that stays away from 0 suffices.
fn shortest(
    values: &Values<'_, '_>,
    ranges: &AllRanges,
    context: usize,
    e: Handle<Expression>,
) -> f64 {
    let least = ranges.operand(values, context, e).least();
    let made = values
        .named(context, e)
        .and_then(|id| values.expression(id));
    let (context, e) = made.map_or((context, e), |(context, e, _)| (context, e));
    match &values.function(context).function.expressions[e] {
        Expression::Compose { components, .. } => components
            .iter()
            .map(|c| shortest(values, ranges, context, *c))
            .fold(least, f64::max),
        Expression::Literal(Literal::F32(x)) => f64::from(x.abs()),
        _ => least,
    }
}

/// Whether a value is a literal other than 0.
fn is_nonzero(values: &Values<'_, '_>, context: usize, e: Handle<Expression>) -> bool {
    match &values.function(context).function.expressions[e] {
        Expression::Literal(Literal::F32(x)) => f64::from(x.abs()) >= SMALLEST,
        Expression::Splat { value, .. } => is_nonzero(values, context, *value),
        Expression::Compose { components, .. } => {
            components.iter().all(|c| is_nonzero(values, context, *c))
        }
        _ => false,
    }
}

/// Assumed magnitude of unknown varyings, draw constants and texels: 2^20, a million scene units. A
/// varying of a real scene is finite; this assumes that it is not extremely large.
pub(crate) const LARGEST_INPUT: f64 = (1 << 20) as f64;

/// Name of the operation, if it may overflow `f32` for smaller operands. Infinity is one step from
/// NaN: `inf * 0`, `inf - inf`.
pub(crate) fn overflow(
    values: &Values<'_, '_>,
    ranges: &AllRanges,
    id: ValueId,
) -> Option<&'static str> {
    // Ranges are real numbers; leave room for rounding.
    let fits = |id: ValueId| ranges.of(id).magnitude() < 0.99 * f64::from(f32::MAX);
    let (context, e, _) = values.expression(id)?;
    let f = values.function(context);
    let expression = &f.function.expressions[e];
    let ty = |e: Handle<Expression>| f.ty(values.graph.module(), e);
    let is_float = ty(e).scalar_kind() == Some(ScalarKind::Float);
    let is_f32 = |e| ty(e).scalar() == Some(Scalar::F32);
    let of = |e| ranges.operand(values, context, e).magnitude();
    let squares_fit = |m: f64| 4.0 * m * m < f64::from(f32::MAX);
    // Some operations compute a larger number than their result.
    let steps_fit = match expression {
        Expression::Math { fun, arg, arg1, .. } => match (fun, arg1) {
            (MathFunction::Length | MathFunction::Normalize | MathFunction::Asinh, _) => {
                squares_fit(of(*arg))
            }
            (MathFunction::Distance, Some(other)) => squares_fit(of(*arg) + of(*other)),
            (MathFunction::Tanh, _) => of(*arg) < LARGEST_TANH,
            _ => true,
        },
        // By definition `a - b * trunc(a / b)`.
        Expression::Binary {
            op: BinaryOperator::Modulo,
            left,
            right,
        } => {
            let least = match is_nonzero(values, context, *right) {
                true => SMALLEST,
                false => 0.0,
            };
            let least = ranges.operand(values, context, *right).least().max(least);
            of(*left) / least < 0.99 * f64::from(f32::MAX)
        }
        _ => true,
    };
    if !is_float || (fits(id) && steps_fit) {
        return None;
    }
    Some(match expression {
        Expression::Binary { op, .. } => match op {
            BinaryOperator::Add => "+",
            BinaryOperator::Subtract => "-",
            BinaryOperator::Multiply => "*",
            BinaryOperator::Divide => "/",
            BinaryOperator::Modulo => "%",
            _ => return None,
        },
        // `f16` overflows at 65504, and `f64` holds more than `f32`.
        Expression::As {
            expr,
            convert: Some(_),
            ..
        } if ![*expr, e].iter().all(|e| is_f32(*e)) => "conversion",
        Expression::Math { fun, .. } => match fun {
            MathFunction::Outer => "outer product",
            MathFunction::Exp
            | MathFunction::Exp2
            | MathFunction::Pow
            | MathFunction::Sinh
            | MathFunction::Cosh
            | MathFunction::Tanh
            | MathFunction::Ldexp
            | MathFunction::Dot
            | MathFunction::Cross
            | MathFunction::Asinh
            | MathFunction::Length
            | MathFunction::Normalize
            | MathFunction::Distance
            | MathFunction::Fma
            | MathFunction::Mix
            | MathFunction::Reflect
            | MathFunction::Determinant
            | MathFunction::Degrees
            | MathFunction::InverseSqrt => fun.try_to_wgsl()?,
            _ => return None,
        },
        _ => return None,
    })
}
