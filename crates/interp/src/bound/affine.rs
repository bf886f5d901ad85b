//! A number that is affine over a triangle, up to a remainder and roundings.

use naga::MathFunction;

use crate::Number;
use crate::accuracy::{Accuracy, LARGEST, SMALLEST};
use crate::interval::{Arithmetic, Interval};

/// A number over a triangle: its value at each corner, the largest distance (`remainder`) from the
/// interpolation of the corners, the largest distance (`error`) between an adapter's number and the
/// exact one, and an interval that contains both.
///
/// Corners and remainder describe the exact function over real numbers. Adapters compute other
/// numbers, even different ones in each stage, but all within `error`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Affine {
    corners: [f64; 3],
    remainder: f64,
    error: f64,
    /// A tighter bound than the remainder gives. For example, a square is not negative.
    interval: Interval,
}

/// Slopes of a function with a discontinuity.
pub(super) const JUMP: [f64; 2] = [f64::INFINITY; 2];

impl Affine {
    /// Nothing is known, not even that it is no NaN.
    pub const ANYTHING: Self = Self {
        corners: [0.0; 3],
        remainder: f64::INFINITY,
        error: f64::INFINITY,
        interval: Interval::ANYTHING,
    };

    /// Exactly the same number everywhere.
    pub const fn constant(number: f64) -> Self {
        Self {
            corners: [number; 3],
            remainder: 0.0,
            error: 0.0,
            interval: Interval::ANYTHING,
        }
    }

    /// The exact interpolation between the corners.
    pub const fn between(corners: [f64; 3]) -> Self {
        Self {
            corners,
            remainder: 0.0,
            error: 0.0,
            interval: Interval::ANYTHING,
        }
    }

    /// The number with these values at the corners. `remainder`: its largest distance from their
    /// interpolation. `error`: the largest distance of an adapter's number from it. Both numbers
    /// lie in `interval`. Returns [`Self::ANYTHING`] if it may be NaN, infinite or beyond the range
    /// of `f32`.
    pub fn new(corners: [f64; 3], remainder: f64, error: f64, interval: Interval) -> Self {
        if !corners.iter().all(|c| c.is_finite()) || remainder.is_nan() || error.is_nan() {
            return Self::ANYTHING;
        }
        // Two points of an interval, and every point between them, are no further apart than its
        // width.
        let width = interval.high - interval.low;
        let number = Self {
            corners,
            remainder: remainder.min(width),
            error: error.min(width),
            interval,
        };
        match number.magnitude() <= LARGEST {
            true => number,
            false => Self::ANYTHING,
        }
    }

    /// Whether a bound is known.
    pub fn is_known(self) -> bool {
        self.remainder.is_finite()
    }

    /// The same number, which is known to lie in this interval too.
    #[must_use]
    pub fn intersected(self, other: Interval) -> Self {
        match self.is_known() {
            true => {
                let interval = self.interval.and(other);
                Self::new(self.corners, self.remainder, self.error, interval)
            }
            // An unknown number may be NaN, which no interval excludes.
            false => self,
        }
    }

    /// The same number, after an adapter rounded it with this accuracy.
    #[must_use]
    pub fn rounded(self, accuracy: Accuracy) -> Self {
        if !self.is_known() {
            return self;
        }
        let interval = self.range().rounded(accuracy);
        let error = self.error + accuracy.of(self.magnitude());
        Self::new(self.corners, self.remainder, error, interval)
    }

    /// The same number, with a further error of an adapter.
    #[must_use]
    pub fn off_by(self, error: f64) -> Self {
        if !self.is_known() {
            return self;
        }
        let Interval { low, high } = self.range();
        let more = (error - self.error).max(0.0);
        let interval = Interval::new(low - more, high + more);
        Self::new(self.corners, self.remainder, error, interval)
    }

    /// The values at the corners.
    pub fn corners(self) -> [f64; 3] {
        self.corners
    }

    /// Largest distance from the interpolation of its corners. Infinite if unbounded.
    pub fn remainder(self) -> f64 {
        self.remainder
    }

    /// Largest distance between an adapter's number and the exact one. Infinite if unbounded.
    pub fn error(self) -> f64 {
        self.error
    }

    /// All values that an adapter may compute.
    pub fn range(self) -> Interval {
        let [least, largest] = self.ends();
        let off = self.remainder + self.error;
        Interval::new(least - off, largest + off).and(self.interval)
    }

    /// Largest absolute value that an adapter may compute.
    pub fn magnitude(self) -> f64 {
        self.range().magnitude()
    }

    /// Least and largest corner.
    pub fn ends(self) -> [f64; 2] {
        let least = self.corners.into_iter().fold(f64::INFINITY, f64::min);
        let largest = self.corners.into_iter().fold(f64::NEG_INFINITY, f64::max);
        [least, largest]
    }

    /// Difference between the largest and the smallest corner.
    pub fn width(self) -> f64 {
        let [least, largest] = self.ends();
        largest - least
    }

    /// Its exact value, if that is the same everywhere.
    pub fn single(self) -> Option<f64> {
        let [a, b, c] = self.corners;
        (a == b && b == c && self.remainder == 0.0).then_some(a)
    }

    /// Its value, if that is the same everywhere and on every adapter.
    pub fn exact(self) -> Option<f64> {
        self.single().filter(|_| self.error == 0.0)
    }

    /// `a x + b y`, before rounding.
    pub fn combined(a: f64, x: Self, b: f64, y: Self) -> Self {
        if !(x.is_known() && y.is_known()) {
            return Self::ANYTHING;
        }
        let corners = [0, 1, 2].map(|i| a * x.corners[i] + b * y.corners[i]);
        let scaled = |a: f64, x: Self| x.range().times(Interval::exactly(a));
        let sum = |of: fn(Self) -> f64| a.abs() * of(x) + b.abs() * of(y);
        Self::new(
            corners,
            sum(Self::remainder),
            sum(Self::error),
            scaled(a, x).plus(scaled(b, y)),
        )
    }

    /// The product with another number, before rounding.
    ///
    /// If `f` and `g` are affine, `f g` differs from the interpolation of its corners by the sum of
    /// `b_i b_j (f_i - f_j)(g_i - g_j)` over the three edges, where `b` are the barycentric
    /// coordinates. A product of two of them is at most 1/4, and the sum of these products at most
    /// 1/3.
    pub fn times(self, other: Self) -> Self {
        if !(self.is_known() && other.is_known()) {
            return Self::ANYTHING;
        }
        let (f, g) = (self.corners, other.corners);
        let corners = [0, 1, 2].map(|i| f[i] * g[i]);
        let edges = [(0, 1), (1, 2), (2, 0)].map(|(i, j)| ((f[i] - f[j]) * (g[i] - g[j])).abs());
        let bend =
            (edges.iter().sum::<f64>() / 4.0).min(edges.into_iter().fold(0.0, f64::max) / 3.0);
        let largest = |x: Self| x.corners.into_iter().fold(0.0, |m: f64, c| m.max(c.abs()));
        let (r, s) = (self.remainder, other.remainder);
        let remainder = bend + largest(self) * s + largest(other) * r + r * s;
        // The error of one factor times the adapter's value of the other, plus the error of the
        // other times the exact value of the first.
        let error = self.error * other.magnitude() + other.error * self.magnitude();
        // Two factors with equal corners and no remainder are the same number, except for rounding.
        let interval = match self == other && r == 0.0 {
            true => self.range().squared(),
            false => self.range().times(other.range()),
        };
        Self::new(corners, remainder, error, interval)
    }

    /// A function of it, as accurate as WGSL requires.
    pub fn apply(self, function: MathFunction, slopes: [f64; 2]) -> Self {
        let called = |arithmetic: Arithmetic| {
            let values = arithmetic.call(function, &[self.range()]);
            values.unwrap_or(Interval::ANYTHING)
        };
        let promised = called(Arithmetic::Adapter);
        if !promised.is_known() {
            return Self::ANYTHING;
        }
        let accuracy = Accuracy::of_function(function, self.magnitude());
        let exact = |x: f64| f64::call(function, &[x]).unwrap_or(f64::NAN);
        self.through(exact, accuracy, called(Arithmetic::Real), slopes)
            .intersected(promised)
    }

    /// A function of it as accurate as this, whose exact values are in `values`. Nothing is known
    /// if these are unbounded. The slopes are the largest absolute first and second derivatives
    /// over the range of arguments, infinite where it has a discontinuity or a corner.
    pub fn through(
        self,
        function: impl Fn(f64) -> f64,
        accuracy: Accuracy,
        values: Interval,
        [slope, curvature]: [f64; 2],
    ) -> Self {
        if !(self.is_known() && values.is_known()) {
            return Self::ANYTHING;
        }
        let times = |factor: f64, by: f64| if by == 0.0 { 0.0 } else { factor * by };
        let width = self.width();
        // Half the width is the largest mean distance of two corners from a point between them, a
        // quarter of its square their largest variance.
        let bend = times(curvature, width * width / 8.0).min(times(slope, width / 2.0));
        let remainder = bend + times(slope, self.remainder);
        let error = times(slope, self.error);
        Self::new(self.corners.map(function), remainder, error, values).rounded(accuracy)
    }

    /// The sum of exact numbers that is an `f32`, where no adapter has anything to round: sums and
    /// products of such are the same however they are fused.
    pub(super) fn exact_sum(self, other: Self) -> Option<f64> {
        let (a, b) = (self.exact()?, other.exact()?);
        let sum = a + b;
        // What the sum lost (Knuth's two-sum).
        let rest = sum - a;
        let lost = (a - (sum - rest)) + (b - rest);
        (lost == 0.0 && is_f32(sum)).then_some(sum)
    }

    /// The product, likewise: two of 24 bits have 48, which an `f64` holds.
    pub(super) fn exact_product(self, other: Self) -> Option<f64> {
        let (a, b) = (self.exact()?, other.exact()?);
        (is_f32(a) && is_f32(b) && is_f32(a * b)).then_some(a * b)
    }
}

/// Whether an `f32` is this number, and a normal one or 0.
fn is_f32(number: f64) -> bool {
    f64::from(number as f32) == number && (number == 0.0 || number.abs() >= SMALLEST)
}
