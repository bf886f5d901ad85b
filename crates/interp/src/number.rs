//! The interpreter's float types.

use std::fmt::Debug;

use half::f16;
use naga::{BinaryOperator, MathFunction};

use super::Stuck;
use super::scalar::Scalar;

/// A float of the interpreter: `f32`, `f64`, or a representation of several numbers.
///
/// Integers and booleans are always single values: a float that cannot be converted to one stops
/// the evaluation.
pub trait Number: Copy + Debug {
    /// Whether it records comparisons and reads ([`Self::compared`], [`Self::read`]).
    const NOTES: bool = false;

    /// Records a comparison of two scalars. `site` identifies it: a hash of its text, which is
    /// equal in other programs, and a number for the component of a vector or the case of a switch.
    fn compared(_site: (u64, usize), _op: BinaryOperator, _sides: [Scalar<Self>; 2]) {}

    /// Records a read of a scalar in a buffer: group and binding, and the path to it.
    fn read(_at: (u32, u32), _way: &[usize], _scalar: Scalar<Self>) {}

    /// A number from the shader's text or a buffer.
    fn of(number: f32) -> Self;

    /// Whether both are bitwise equal.
    fn is_same(self, other: Self) -> bool;

    /// `-x`.
    fn negated(self) -> Self;

    /// `+`, `-`, `*`, `/` or `%`. `None` for other operators.
    fn binary(op: BinaryOperator, a: Self, b: Self) -> Option<Self>;

    /// Compares two numbers. `Some(None)` if one is NaN, `None` if undecided.
    fn compare(self, other: Self) -> Option<Option<std::cmp::Ordering>>;

    /// The result of a comparison. `None` if undecided or not a comparison.
    fn holds(op: BinaryOperator, a: Self, b: Self) -> Option<bool> {
        use std::cmp::Ordering::{Equal, Greater, Less};
        let order = a.compare(b)?;
        Some(match op {
            BinaryOperator::Equal => order == Some(Equal),
            BinaryOperator::NotEqual => order != Some(Equal),
            BinaryOperator::Less => order == Some(Less),
            BinaryOperator::LessEqual => matches!(order, Some(Less | Equal)),
            BinaryOperator::Greater => order == Some(Greater),
            BinaryOperator::GreaterEqual => matches!(order, Some(Greater | Equal)),
            _ => return None,
        })
    }

    /// A componentwise function. `None` for other or unsupported functions.
    fn call(function: MathFunction, arguments: &[Self]) -> Option<Self>;

    /// The same number, known to lie between two bounds, such as a component of a direction.
    #[must_use]
    fn within(self, least: f32, largest: f32) -> Self;

    /// Its value as one `f32`. `None` if it stands for several.
    fn single(self) -> Option<f32>;

    /// The truncated value, for a conversion to an integer. `None` if it stands for several. `f64`
    /// can represent every 32-bit integer, which the reference may need.
    fn truncated(self) -> Option<f64>;

    /// Whether it is infinite. `None` if it stands for several.
    fn is_infinity(self) -> Option<bool> {
        self.single().map(f32::is_infinite)
    }

    /// The unrounded reference, if it is tracked. Decisions that it would change are counted
    /// ([`super::RunResult::flips`]).
    fn truth(self) -> Option<f64> {
        None
    }
}

/// [`Number::single`] as a result.
///
/// # Errors
///
/// The number stands for several values.
pub(crate) fn single<F: Number>(number: F) -> Result<f32, Stuck> {
    number
        .single()
        .ok_or_else(|| Stuck::Undecided(format!("{number:?}")))
}

/// [`Number::truncated`] as a result.
///
/// # Errors
///
/// The number stands for several values.
pub(crate) fn truncated<F: Number>(number: F) -> Result<f64, Stuck> {
    number
        .truncated()
        .ok_or_else(|| Stuck::Undecided(format!("{number:?}")))
}

macro_rules! float {
    ($float:ty) => {
        impl Number for $float {
            fn of(number: f32) -> Self {
                Self::from(number)
            }

            fn is_same(self, other: Self) -> bool {
                self.to_bits() == other.to_bits()
            }

            fn negated(self) -> Self {
                -self
            }

            fn binary(op: BinaryOperator, a: Self, b: Self) -> Option<Self> {
                Some(match op {
                    BinaryOperator::Add => a + b,
                    BinaryOperator::Subtract => a - b,
                    BinaryOperator::Multiply => a * b,
                    BinaryOperator::Divide => a / b,
                    BinaryOperator::Modulo => a % b,
                    _ => return None,
                })
            }

            fn compare(self, other: Self) -> Option<Option<std::cmp::Ordering>> {
                Some(self.partial_cmp(&other))
            }

            fn call(function: MathFunction, arguments: &[Self]) -> Option<Self> {
                use MathFunction as M;
                Some(match (function, arguments) {
                    (M::Abs, [v]) => v.abs(),
                    (M::Sign, [v]) if *v == 0.0 => 0.0,
                    (M::Sign, [v]) => v.signum(),
                    (M::Min, [a, b]) => a.min(*b),
                    (M::Max, [a, b]) => a.max(*b),
                    (M::Clamp, [v, low, high]) => v.max(*low).min(*high),
                    (M::Saturate, [v]) => v.clamp(0.0, 1.0),
                    (M::Cos, [v]) => v.cos(),
                    (M::Cosh, [v]) => v.cosh(),
                    (M::Sin, [v]) => v.sin(),
                    (M::Sinh, [v]) => v.sinh(),
                    (M::Tan, [v]) => v.tan(),
                    (M::Tanh, [v]) => v.tanh(),
                    (M::Acos, [v]) => v.acos(),
                    (M::Acosh, [v]) => v.acosh(),
                    (M::Asin, [v]) => v.asin(),
                    (M::Asinh, [v]) => v.asinh(),
                    (M::Atan, [v]) => v.atan(),
                    (M::Atanh, [v]) => v.atanh(),
                    (M::Atan2, [y, x]) => y.atan2(*x),
                    (M::Radians, [v]) => v.to_radians(),
                    (M::Degrees, [v]) => v.to_degrees(),
                    (M::Ceil, [v]) => v.ceil(),
                    (M::Floor, [v]) => v.floor(),
                    (M::Round, [v]) => v.round_ties_even(),
                    (M::Fract, [v]) => v - v.floor(),
                    (M::Trunc, [v]) => v.trunc(),
                    (M::Exp, [v]) => v.exp(),
                    (M::Exp2, [v]) => v.exp2(),
                    (M::Log, [v]) => v.ln(),
                    (M::Log2, [v]) => v.log2(),
                    (M::Pow, [v, y]) => v.powf(*y),
                    (M::Sqrt, [v]) => v.sqrt(),
                    (M::InverseSqrt, [v]) => 1.0 / v.sqrt(),
                    (M::Step, [edge, v]) => {
                        Self::from(u8::from(v >= edge || v.is_nan() || edge.is_nan()))
                    }
                    (M::Mix, [a, b, t]) => a * (1.0 - t) + b * t,
                    (M::Fma, [a, b, c]) => a.mul_add(*b, *c),
                    (M::QuantizeToF16, [v]) => f16::from_f32(*v as f32).into(),
                    (M::SmoothStep, [low, high, v]) => {
                        let t = ((v - low) / (high - low)).clamp(0.0, 1.0);
                        t * t * (3.0 - 2.0 * t)
                    }
                    _ => return None,
                })
            }

            fn within(self, _: f32, _: f32) -> Self {
                self
            }

            fn single(self) -> Option<f32> {
                Some(self as f32)
            }

            fn truncated(self) -> Option<f64> {
                Some(f64::from(self.trunc()))
            }

            // A finite `f64` may be beyond the range of `f32`.
            fn is_infinity(self) -> Option<bool> {
                Some(self.is_infinite())
            }
        }
    };
}

float!(f32);
float!(f64);
