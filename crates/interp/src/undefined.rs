//! Operations that WGSL defines and GLSL does not (GLSL 4.60, sections 5.4.1 and 5.9).

use std::fmt;

use naga::{BinaryOperator, Expression, ScalarKind};

use super::number::Number;
use super::value::{Scalar, Value};

/// An operation with an undefined result in GLSL.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Undefined {
    /// `%` with a negative operand.
    Remainder,
    /// A division or a remainder by zero.
    Division,
    /// A shift by the width of the type or more.
    Shift,
    /// A conversion of a float that the integer type cannot represent.
    Conversion,
}

impl fmt::Display for Undefined {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Remainder => "`%` of a negative number",
            Self::Division => "a division by zero",
            Self::Shift => "a shift by 32 bits or more",
            Self::Conversion => "the conversion of a float that the integer type does not hold",
        })
    }
}

/// The reason why an operation on these operands is undefined in GLSL.
pub(crate) fn of<F: Number>(operation: &Expression, operands: &[&Value<F>]) -> Option<Undefined> {
    match (operation, operands) {
        (Expression::Binary { op, .. }, [a, b]) => {
            use BinaryOperator as B;
            let is_asked = matches!(op, B::Divide | B::Modulo | B::ShiftLeft | B::ShiftRight);
            if !is_asked {
                return None;
            }
            let (a, b) = (scalars(a), scalars(b));
            let count = a.len().max(b.len());
            let mut pairs = (0..count).filter_map(|i| {
                let of = |all: &[Scalar<F>]| all.get(i).or(all.first()).copied();
                Some((of(&a)?, of(&b)?))
            });
            pairs.find_map(|(a, b)| of_binary(*op, integer(a)?, integer(b)?))
        }
        (Expression::As { kind, convert, .. }, [x]) => {
            let range = match kind {
                ScalarKind::Sint => -2_147_483_649.0..2_147_483_648.0,
                ScalarKind::Uint => -1.0..4_294_967_296.0,
                _ => return None,
            };
            let is_outside = |x: &Scalar<F>| match x {
                Scalar::F32(x) => x.single().is_some_and(|x| {
                    let x = f64::from(x);
                    !(x > range.start && range.contains(&x))
                }),
                _ => false,
            };
            let outside = convert.is_some() && scalars(x).iter().any(is_outside);
            outside.then_some(Undefined::Conversion)
        }
        _ => None,
    }
}

fn of_binary(op: BinaryOperator, a: i64, b: i64) -> Option<Undefined> {
    use BinaryOperator as B;
    match op {
        B::Divide | B::Modulo if b == 0 => Some(Undefined::Division),
        B::Modulo if a < 0 || b < 0 => Some(Undefined::Remainder),
        B::ShiftLeft | B::ShiftRight if !(0..32).contains(&b) => Some(Undefined::Shift),
        _ => None,
    }
}

fn integer<F>(scalar: Scalar<F>) -> Option<i64> {
    match scalar {
        Scalar::I32(x) => Some(i64::from(x)),
        Scalar::U32(x) => Some(i64::from(x)),
        _ => None,
    }
}

fn scalars<F: Copy>(value: &Value<F>) -> Vec<Scalar<F>> {
    match value {
        Value::Scalar(scalar) => vec![*scalar],
        Value::Composite(parts) => parts.iter().flat_map(scalars).collect(),
        _ => Vec::new(),
    }
}
