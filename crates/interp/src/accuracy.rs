//! Accuracy of an adapter's operations: WGSL section 15.7.4, accuracy of concrete floating point
//! expressions.
//!
//! An adapter may fuse and reassociate operations if the result is at least as accurate (section
//! 15.7.5), and may flush a subnormal number to zero (section 15.7.2).

use naga::MathFunction;

/// Largest distance between the result of an operation and the exact result: a relative part plus
/// an absolute part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Accuracy {
    relative: f64,
    absolute: f64,
}

/// Upper bound of one unit in the last place, relative to the number. Slightly larger than exact,
/// to cover the roundings of this analysis in `f64`.
const ULP: f64 = 1.000_001 * f32::EPSILON as f64;
/// Smallest normal `f32`. An adapter may flush smaller numbers.
pub(crate) const SMALLEST: f64 = f32::MIN_POSITIVE as f64;
/// From this magnitude of its argument on, the quotient that defines `tanh` may overflow.
pub const LARGEST_TANH: f64 = 88.0;
/// Largest `f32`.
pub(crate) const LARGEST: f64 = f32::MAX as f64;

impl Accuracy {
    /// The exact number, if an `f32` can represent it: `floor`, `abs`, `max`.
    pub const EXACT: Self = Self {
        relative: 0.0,
        absolute: 0.0,
    };

    /// Correctly rounded, up or down: `+`, `-`, `*`.
    pub const ROUNDED: Self = Self::ulps(1.0);

    /// Division, by divisors from 2^-126 to 2^126.
    pub const QUOTIENT: Self = Self::ulps(2.5);

    /// WGSL guarantees nothing.
    pub const UNKNOWN: Self = Self {
        relative: f64::INFINITY,
        absolute: f64::INFINITY,
    };

    /// Accuracy of a function that WGSL does not define by other operations. The first argument has
    /// at most this magnitude.
    pub fn of_function(function: MathFunction, argument: f64) -> Self {
        use MathFunction as M;
        match function {
            M::Abs | M::Sign | M::Min | M::Max | M::Clamp | M::Saturate => Self::EXACT,
            M::Floor | M::Ceil | M::Round | M::Trunc | M::Step => Self::EXACT,
            M::Fract => Self::ROUNDED,
            M::Sin | M::Cos => Self::wave(argument),
            M::Sinh | M::Cosh => Self::hyperbolic(argument),
            M::Tanh => Self::hyperbolic_tangent(argument),
            M::Asin | M::Acos => Self::arc(argument),
            M::Atan => Self::ulps(4096.0),
            M::Exp | M::Exp2 => Self::exponential(argument),
            M::Log | M::Log2 => Self::logarithm(),
            // By definition `1 / inverseSqrt(x)`.
            M::Sqrt => Self::ulps(5.0),
            M::InverseSqrt | M::Radians | M::Degrees => Self::ulps(2.0),
            // The definition is `t * t * (3 - 2 * t)`: two products and a difference.
            M::SmoothStep => Self::ulps(4.0),
            _ => Self::UNKNOWN,
        }
    }

    /// An error of this many units in the last place.
    pub const fn ulps(count: f64) -> Self {
        Self {
            relative: count * ULP,
            absolute: SMALLEST,
        }
    }

    /// An error of this much, independent of the number.
    pub const fn absolute(error: f64) -> Self {
        Self {
            relative: ULP,
            absolute: error,
        }
    }

    /// Accuracy of sine and cosine for arguments of at most this magnitude. Beyond half a turn WGSL
    /// guarantees nothing. There we assume that the argument is reduced by a multiple of a period
    /// that is accurate to 2^-22: within a hundred turns, about as Direct3D requires.
    pub fn wave(argument: f64) -> Self {
        let beyond = (argument - std::f64::consts::PI).max(0.0);
        Self::absolute(2_f64.powi(-11) + beyond * 2_f64.powi(-22))
    }

    /// Accuracy of a power with a constant base and an exponent of at most this magnitude.
    pub fn exponential(exponent: f64) -> Self {
        Self::ulps(3.0 + 2.0 * exponent)
    }

    /// Accuracy of a logarithm: 2^-21 near 1, 3 units elsewhere.
    pub fn logarithm() -> Self {
        Self {
            relative: 3.0 * ULP,
            absolute: 2_f64.powi(-21),
        }
    }

    /// Accuracy of `exp2(y log2(x))`. The arguments bound the magnitudes of `y`, of `y log2(x)`,
    /// and of the power.
    pub fn power(y: f64, exponent: f64, largest: f64) -> Self {
        // The logarithm has an error of 2^-21 near 1, and with the product of 4 units of the
        // exponent. The power of two adds 3 units, and 2 for each unit of its exponent.
        let off = std::f64::consts::LN_2 * (y * 2_f64.powi(-21) + 4.0 * ULP * exponent);
        let growth = off.exp();
        // Errors in proportion to the exponent grow with the power too. Below 1 their product is at
        // most 1 / (e ln 2).
        let weighed = (largest * largest.log2()).max(0.54);
        Self {
            relative: growth * (std::f64::consts::LN_2 * y * 2_f64.powi(-21)) + 4.0 * ULP,
            absolute: growth * 6.0 * ULP * weighed + SMALLEST,
        }
    }

    /// Accuracy of `sinh` and `cosh`, half a sum of two exponentials, for arguments of at most this
    /// magnitude.
    pub fn hyperbolic(argument: f64) -> Self {
        Self::absolute((6.0 + 2.0 * argument) * ULP * argument.cosh())
    }

    /// Accuracy of `tanh`: the worse of 1e-5 and the quotient that defines it.
    pub fn hyperbolic_tangent(argument: f64) -> Self {
        Self::absolute(1e-5 + 2.0 * (8.0 + 2.0 * argument) * ULP)
    }

    /// Accuracy of `asin` and `acos` for arguments of at most this magnitude: the worse of 6.81e-5
    /// and `atan2(sqrt(1 - x x), x)`, which has 4096 units of at most half a turn.
    pub fn arc(argument: f64) -> Self {
        let rest = (1.0 - argument * argument).max(0.0);
        let off = 2.0 * ULP;
        let root = (off / rest.sqrt()).min(off.sqrt()) + 5.0 * ULP;
        Self::absolute(6.81e-5 + root + 4096.0 * ULP * std::f64::consts::PI)
    }

    /// Largest error of a result of at most this magnitude.
    pub fn of(self, magnitude: f64) -> f64 {
        self.relative * magnitude + self.absolute
    }

    /// Lower bound of a result whose exact value is `least`. A relative error and a flush do not
    /// change its sign.
    pub fn lower_bound(self, least: f64) -> f64 {
        self.beyond(least, -1.0)
    }

    /// Upper bound of a result whose exact value is `largest`.
    pub fn above(self, largest: f64) -> f64 {
        self.beyond(largest, 1.0)
    }

    fn beyond(self, end: f64, side: f64) -> f64 {
        if end.is_infinite() {
            return end;
        }
        // All subnormal numbers have the unit of the smallest normal number.
        let part = match end == 0.0 {
            true => 0.0,
            false => self.relative * end.abs().max(SMALLEST),
        };
        let moved = end + side * part;
        match self.absolute <= SMALLEST {
            true if end * side < 0.0 && moved * -side < 2.0 * self.absolute => 0.0,
            true => moved,
            false => moved + side * self.absolute,
        }
    }
}
