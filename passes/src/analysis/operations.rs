//! How each operation responds to a small difference of its operands: its discontinuities, its
//! largest slope, the operands at which the slope has no bound, and its accuracy. The analyses of
//! discontinuities, slopes and rounding share this table.

use std::f64::consts::{LN_2, LOG2_E};

use naga::{BinaryOperator, Expression, MathFunction, ScalarKind};

use naga_interp::accuracy::Accuracy;
use naga_interp::interval::Interval;

/// A discontinuity of an operation.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Break {
    /// Name of the operation in messages.
    pub name: &'static str,
    pub at: Threshold,
}

/// The operands at which an operation has a discontinuity.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Threshold {
    /// Wherever this function of the first operand, or of the quotient of both, has a step.
    Steps(fn(f64) -> f64),
    /// Where both operands are equal, or the only one is 0.
    Equal,
    /// The cut of `atan2(y, x)`: `x` is negative and `y` is 0.
    Cut,
    /// At one place that no range excludes.
    Once,
    /// At many places that no range excludes.
    Many,
    /// Nowhere: the operand is an integer, which had a discontinuity before.
    Earlier,
}

impl Threshold {
    /// Whether the discontinuity repeats: then a small error of an operand that was scaled up
    /// before decides everything.
    pub fn repeats(self) -> bool {
        matches!(self, Self::Steps(_) | Self::Many | Self::Earlier)
    }

    /// Whether operands in these ranges stay away from the discontinuity, rounding included.
    pub fn is_avoided(self, x: Interval, y: Interval) -> bool {
        match self {
            Self::Steps(function) => same(x, function),
            Self::Equal => are_distinct(x, y),
            Self::Cut => (y.low > 0.0 && are_distinct(y, ZERO)) || are_distinct(x, ZERO),
            Self::Once | Self::Many => false,
            Self::Earlier => true,
        }
    }
}

/// The least and largest number of an operand that is 0, or that is missing.
pub(crate) const ZERO: Interval = Interval::new(0.0, 0.0);

/// The error of an operation itself.
#[derive(Clone, Copy, Debug)]
pub(crate) enum OwnError {
    /// Each stage is as accurate as WGSL requires.
    Within(Accuracy),
    /// So many roundings in both stages together. The terms of a sum that is rounded within may be
    /// larger than the result: up to this number.
    Roundings(f64, f64),
}

/// An operation on operands in given ranges.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Operation {
    pub discontinuity: Option<Break>,
    /// Largest slope in each operand; `None` if one is unbounded or unknown.
    pub slopes: Option<[f64; 3]>,
    pub error: OwnError,
}

impl Operation {
    const fn within(slopes: Option<[f64; 3]>, accuracy: Accuracy) -> Self {
        Self {
            discontinuity: None,
            slopes,
            error: OwnError::Within(accuracy),
        }
    }

    const fn broken(name: &'static str, at: Threshold) -> Self {
        Self {
            discontinuity: Some(Break { name, at }),
            ..Self::within(None, Accuracy::EXACT)
        }
    }

    const fn rounded(slopes: Option<[f64; 3]>, roundings: f64, term: f64) -> Self {
        Self {
            error: OwnError::Roundings(roundings, term),
            ..Self::within(slopes, Accuracy::EXACT)
        }
    }
}

/// A math function of arguments in these ranges, with `dimension` components, whose result is at
/// most `magnitude`.
pub(crate) fn math(
    fun: MathFunction,
    [x, y, z]: [Interval; 3],
    dimension: f64,
    magnitude: f64,
) -> Operation {
    use MathFunction as M;
    use Threshold::{Cut, Equal, Many, Once, Steps};
    let (a, b, c) = (x.magnitude(), y.magnitude(), z.magnitude());
    let broken = Operation::broken;
    let rounded = |slopes, count, term| Operation::rounded(Some(slopes), count, term);
    let bounded = |is_bounded: bool, slope: f64, accuracy| {
        Operation::within(is_bounded.then_some([slope, 0.0, 0.0]), accuracy)
    };
    let within = |slope: f64, accuracy| bounded(true, slope, accuracy);
    let (exact, ulps) = (Accuracy::EXACT, Accuracy::ulps(8.0));
    match fun {
        M::Floor => broken("floor", Steps(f64::floor)),
        M::Fract => broken("fract", Steps(f64::floor)),
        M::Ceil => broken("ceil", Steps(f64::ceil)),
        M::Trunc => broken("trunc", Steps(f64::trunc)),
        M::Round => broken("round", Steps(f64::round_ties_even)),
        M::Step => broken("step", Equal),
        M::Sign => broken("sign", Equal),
        M::Atan2 => broken("atan2", Cut),
        // At total reflection, and where the side changes.
        M::Refract => broken("refract", Once),
        M::FaceForward => broken("faceForward", Once),
        M::Modf | M::Frexp => broken("modf", Many),
        M::QuantizeToF16 => broken("quantizeToF16", Many),
        M::Pack4x8snorm
        | M::Pack4x8unorm
        | M::Pack2x16snorm
        | M::Pack2x16unorm
        | M::Pack2x16float => broken("packing", Many),
        M::Abs | M::Saturate | M::Transpose => within(1.0, exact),
        M::Min | M::Max | M::Clamp => Operation::within(Some([1.0; 3]), exact),
        M::Sin | M::Cos => within(1.0, Accuracy::wave(a)),
        M::Tanh => within(1.0, Accuracy::hyperbolic_tangent(a)),
        // The logarithm of a sum with a root.
        M::Asinh => within(1.0, Accuracy::logarithm()),
        M::Atan => within(1.0, Accuracy::ulps(4096.0)),
        M::Sinh | M::Cosh => within(a.cosh(), Accuracy::hyperbolic(a)),
        M::Exp => within(x.high.exp(), Accuracy::exponential(a)),
        M::Exp2 => within(LN_2 * x.high.exp2(), Accuracy::exponential(a)),
        M::Log => bounded(x.low > 0.0, 1.0 / x.low, Accuracy::logarithm()),
        M::Log2 => bounded(x.low > 0.0, LOG2_E / x.low, Accuracy::logarithm()),
        M::Sqrt | M::InverseSqrt => {
            let power = if fun == M::Sqrt { -0.5 } else { -1.5 };
            bounded(x.low > 0.0, 0.5 * x.low.powf(power), ulps)
        }
        M::Acos | M::Asin => {
            let slope = (1.0 - a * a).powf(-0.5);
            bounded(a < 1.0, slope, Accuracy::arc(a))
        }
        M::Pow => {
            // The slope is known for a non-negative base and a constant exponent.
            let is_known = x.low >= 0.0 && y.low == y.high && y.low >= 1.0;
            let slopes = [y.low * a.powf(y.low - 1.0), f64::INFINITY, 0.0];
            // The error decreases with the power: e 2^-e is largest at 1 / ln 2.
            let largest = magnitude.max(1.0);
            let accuracy = Accuracy::power(b, largest.log2().max(1.443), largest);
            Operation::within(is_known.then_some(slopes), accuracy)
        }
        M::Radians => within(1_f64.to_radians(), Accuracy::ROUNDED),
        M::Degrees => within(1_f64.to_degrees(), Accuracy::ROUNDED),
        M::Length => within(dimension.sqrt(), ulps),
        M::Distance => {
            let slope = dimension.sqrt();
            Operation::within(Some([slope, slope, 0.0]), ulps)
        }
        M::Outer => Operation::within(Some([b, a, 0.0]), ulps),
        // Three halves of the ramp's slope.
        M::SmoothStep => {
            let slopes = [f64::INFINITY, f64::INFINITY, 1.5 / (y.low - x.high)];
            Operation::within((y.low > x.high).then_some(slopes), ulps)
        }
        M::Dot => {
            let slopes = [dimension * b, dimension * a, 0.0];
            rounded(slopes, 4.0 * dimension, 2.0 * a * b)
        }
        M::Cross => rounded([2.0 * b, 2.0 * a, 0.0], 4.0 * dimension, 2.0 * a * b),
        // i - 2 dot(n, i) n.
        M::Reflect => {
            let slopes = [1.0 + 2.0 * dimension * b * b, 4.0 * dimension * a * b, 0.0];
            rounded(slopes, 4.0 * dimension, 0.0)
        }
        M::Fma => rounded([b, a, 1.0], 8.0, (2.0 * a * b).max(c)),
        M::Mix => {
            let rest = (1.0 - z.low).abs().max((1.0 - z.high).abs());
            rounded([rest, c, a + b], 8.0, (a + b) * c.max(1.0))
        }
        _ => Operation::within(None, exact),
    }
}

/// A binary operation on operands in these ranges. `terms` products are added for a component of a
/// product, and `inverse` is the range of the reciprocal of the right operand.
pub(crate) fn binary(
    op: BinaryOperator,
    [left, right]: [Interval; 2],
    inverse: Interval,
    terms: f64,
) -> Operation {
    use BinaryOperator as B;
    let (a, b, inverse) = (left.magnitude(), right.magnitude(), inverse.magnitude());
    let slopes = match op {
        B::Add | B::Subtract => Some([1.0, 1.0, 0.0]),
        B::Multiply => Some([terms * b, terms * a, 0.0]),
        B::Divide => Some([inverse, a * inverse * inverse, 0.0]),
        _ => None,
    };
    Operation {
        discontinuity: broken_operator(op),
        ..Operation::rounded(slopes, 2.0 * terms, 0.0)
    }
}

fn broken_operator(op: BinaryOperator) -> Option<Break> {
    use BinaryOperator as B;
    let (name, at) = match op {
        B::Modulo => ("%", Threshold::Steps(f64::trunc)),
        B::Equal | B::NotEqual | B::Less | B::LessEqual | B::Greater | B::GreaterEqual => {
            ("a comparison", Threshold::Equal)
        }
        B::And | B::ExclusiveOr | B::InclusiveOr | B::ShiftLeft | B::ShiftRight => {
            ("a bit operation", Threshold::Many)
        }
        _ => return None,
    };
    Some(Break { name, at })
}

/// The discontinuity of an operation on numbers.
pub(crate) fn discontinuity(expression: &Expression) -> Option<Break> {
    let (name, at) = match expression {
        Expression::Math { fun, .. } => {
            return math(*fun, [Interval::ANYTHING; 3], 1.0, f64::INFINITY).discontinuity;
        }
        Expression::Binary { op, .. } => return broken_operator(*op),
        Expression::As { kind, convert, .. } => match (kind, convert) {
            (_, None) => ("bitcast", Threshold::Many),
            // A conversion to 32 bits or more loses nothing that fits.
            (ScalarKind::Float, Some(4..)) => ("a conversion", Threshold::Earlier),
            (ScalarKind::Float, Some(_)) => ("a conversion", Threshold::Many),
            (ScalarKind::Sint | ScalarKind::Uint, Some(_)) => {
                ("a conversion to an integer", Threshold::Steps(f64::trunc))
            }
            _ => ("a conversion to an integer", Threshold::Many),
        },
        Expression::Relational { .. } => ("a test", Threshold::Once),
        _ => return None,
    };
    Some(Break { name, at })
}

/// The discontinuity of a texture sample in its coordinates, whatever its sampler is.
pub(crate) fn of_sample(expression: &Expression) -> Option<Break> {
    let (name, at) = match expression {
        Expression::ImageSample {
            gather: Some(_), ..
        } => ("a gathered texel", Threshold::Many),
        Expression::ImageSample {
            depth_ref: Some(_), ..
        } => ("a depth comparison", Threshold::Once),
        _ => return None,
    };
    Some(Break { name, at })
}

/// Relative error of a range's bounds by rounding. Ranges are real numbers, and rounding is
/// monotonic.
const ROUNDED: f64 = 1e-5;

fn widened(range: Interval) -> Interval {
    let by = |end: f64| ROUNDED * end.abs();
    Interval::new(range.low - by(range.low), range.high + by(range.high))
}

/// Whether a monotonic function has the same value at both ends, including rounding. Whole numbers
/// are exact.
fn same(range: Interval, function: fn(f64) -> f64) -> bool {
    let wide = widened(range);
    let ends = [(range.low, wide.low), (range.high, wide.high)];
    let [low, high] = ends.map(|(end, wide)| if end.fract() == 0.0 { end } else { wide });
    low.is_finite() && high.is_finite() && function(low) == function(high)
}

/// Whether the distance of two ranges exceeds their rounding.
fn are_distinct(a: Interval, b: Interval) -> bool {
    let (a, b) = (widened(a), widened(b));
    a.high < b.low || b.high < a.low
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_discontinuity_outside_of_the_range_is_avoided() {
        let range = Interval::new;
        assert!(same(range(1.25, 1.75), f64::floor));
        assert!(same(range(1.0, 1.75), f64::floor));
        assert!(!same(range(1.25, 2.0), f64::floor));
        assert!(!same(range(1.25, 1.999_999_9), f64::floor));
        assert!(same(range(-0.25, 0.25), f64::trunc));
        assert!(!same(Interval::ANYTHING, f64::floor));
        assert!(are_distinct(range(0.0, 1.0), range(1.5, 2.0)));
        assert!(!are_distinct(range(0.0, 1.0), range(1.0, 2.0)));
        assert!(!are_distinct(Interval::ANYTHING, range(1.0, 2.0)));
    }
}
