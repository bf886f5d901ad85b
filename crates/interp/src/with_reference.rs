//! Shadow values: an `f32` with its `f64` reference (Benz, Hildebrandt and Hack 2012).

use std::cmp::Ordering;

use naga::{BinaryOperator, MathFunction};

use super::number::Number;

/// A number as `f32` and as `f64`, computed from the same inputs. The `f32` decides all branches,
/// selections and conversions to integers, so both follow the same path through the shader.
/// Decisions that the `f64` would change are counted as flips ([`super::RunResult::flips`]).
/// Without flips, both would take this path.
///
/// A discontinuity within a componentwise function (`floor`, `fract`, `step`, `sign`) is not a
/// decision: both evaluate it, and the difference is an ordinary error. `refract` and `faceForward`
/// decide once for all components, and packed words and exponents are integers: there the `f32`
/// decides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shadowed {
    /// Rounded to `f32` after each operation.
    pub value: f32,
    /// Rounded to `f64` after each operation.
    pub truth: f64,
}

impl Shadowed {
    /// The distance between the value and the reference.
    pub fn error(self) -> f64 {
        (f64::from(self.value) - self.truth).abs()
    }
}

/// Distance of two numbers in `f32` units in the last place at `reference`, or at the smallest
/// normal number if that is larger.
pub fn ulps(value: f64, truth: f64) -> f64 {
    let exponent = truth.abs().max(f64::from(f32::MIN_POSITIVE)).log2().floor();
    (value - truth).abs() / 2_f64.powf(exponent - 23.0)
}

impl Number for Shadowed {
    fn of(number: f32) -> Self {
        Self {
            value: number,
            truth: f64::from(number),
        }
    }

    fn is_same(self, other: Self) -> bool {
        self.value.is_same(other.value) && self.truth.is_same(other.truth)
    }

    fn negated(self) -> Self {
        Self {
            value: -self.value,
            truth: -self.truth,
        }
    }

    fn binary(op: BinaryOperator, a: Self, b: Self) -> Option<Self> {
        Some(Self {
            value: f32::binary(op, a.value, b.value)?,
            truth: f64::binary(op, a.truth, b.truth)?,
        })
    }

    fn compare(self, other: Self) -> Option<Option<Ordering>> {
        self.value.compare(other.value)
    }

    fn call(function: MathFunction, arguments: &[Self]) -> Option<Self> {
        let values: Vec<f32> = arguments.iter().map(|a| a.value).collect();
        let truths: Vec<f64> = arguments.iter().map(|a| a.truth).collect();
        Some(Self {
            value: f32::call(function, &values)?,
            truth: f64::call(function, &truths)?,
        })
    }

    fn within(self, _: f32, _: f32) -> Self {
        self
    }

    fn single(self) -> Option<f32> {
        self.value.single()
    }

    fn truncated(self) -> Option<f64> {
        self.value.truncated()
    }

    fn truth(self) -> Option<f64> {
        Some(self.truth)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use naga::{Expression, RelationalFunction};

    use super::{Shadowed, ulps};
    use crate::value::Value;
    use crate::{flips, math};

    /// An overflow is infinite in `f32`, but finite in `f64`.
    #[test]
    fn a_truth_beyond_f32_is_finite() {
        let mut arena = naga::Arena::new();
        let zero = naga::Literal::F32(0.0);
        let argument = arena.append(Expression::Literal(zero), naga::Span::UNDEFINED);
        let fun = RelationalFunction::IsInf;
        let overflowed = Value::number(Shadowed {
            value: f32::INFINITY,
            truth: 1e39,
        });
        let decided = math::relational(fun, &overflowed).unwrap();
        assert!(decided.truth().unwrap());
        let expression = Expression::Relational { fun, argument };
        assert_eq!(flips::of(&expression, &[&overflowed], &decided), 1);
    }

    #[test]
    fn a_unit_is_that_of_the_truth() {
        let next = f64::from(f32::from_bits(1_f32.to_bits() + 1));
        assert_eq!(ulps(next, 1.0), 1.0);
        assert_eq!(ulps(1.0, 1.0), 0.0);
        // Below a power of two the unit is half as large.
        assert_eq!(ulps(1.0, f64::from(1_f32.next_down())), 1.0);
        assert_eq!(ulps(0.0, 0.0), 0.0);
        assert!(ulps(f64::NAN, 1.0).is_nan());
    }
}
