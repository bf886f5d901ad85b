//! A number that is affine over a triangle, up to a remainder and to roundings.

use naga::MathFunction;

use crate::Number;
use crate::accuracy::{Accuracy, LARGEST, SMALLEST};
use crate::interval::{Arithmetic, Interval};

/// The value at each corner, how far it is at most from what lies between them, how far from that
/// an adapter's number is, and an interval that holds both all the same.
///
/// The first two are of the exact function over real numbers. An adapter computes another number,
/// and not the same one in every stage: it is `error` away at most.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Affine {
    corners: [f64; 3],
    remainder: f64,
    error: f64,
    /// A square is not below 0, a sine hardly above 1, whatever the remainder would allow.
    interval: Interval,
}

/// Slopes of a function that has a discontinuity.
pub(super) const JUMP: [f64; 2] = [f64::INFINITY; 2];

impl Affine {
    /// Nothing is known, not even that it is a number.
    pub const ANYTHING: Self = Self {
        corners: [0.0; 3],
        remainder: f64::INFINITY,
        error: f64::INFINITY,
        interval: Interval::ANYTHING,
    };

    /// The same number everywhere, exactly.
    pub const fn constant(number: f64) -> Self {
        Self {
            corners: [number; 3],
            remainder: 0.0,
            error: 0.0,
            interval: Interval::ANYTHING,
        }
    }

    /// Interpolated between the corners, exactly.
    pub const fn between(corners: [f64; 3]) -> Self {
        Self {
            corners,
            remainder: 0.0,
            error: 0.0,
            interval: Interval::ANYTHING,
        }
    }

    /// The number with these values at the corners, `remainder` at most from what lies between
    /// them; an adapter's is `error` at most from it, and both lie within `interval`. Nothing is
    /// known of one that is NaN or infinite at a corner, or may be beyond the range of `f32`.
    pub fn new(corners: [f64; 3], remainder: f64, error: f64, interval: Interval) -> Self {
        if !corners.iter().all(|c| c.is_finite()) || remainder.is_nan() || error.is_nan() {
            return Self::ANYTHING;
        }
        // Nothing is further from what lies between two points of an interval than these are from
        // one another.
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

    /// Whether anything is known of it.
    pub fn is_known(self) -> bool {
        self.remainder.is_finite()
    }

    /// Itself, which lies in this interval too.
    #[must_use]
    pub fn intersected(self, other: Interval) -> Self {
        match self.is_known() {
            true => {
                let interval = self.interval.and(other);
                Self::new(self.corners, self.remainder, self.error, interval)
            }
            // Of what is not known it is not known either that it is a number.
            false => self,
        }
    }

    /// Itself as an adapter gives it that is as accurate as this.
    #[must_use]
    pub fn rounded(self, accuracy: Accuracy) -> Self {
        if !self.is_known() {
            return self;
        }
        let interval = self.range().rounded(accuracy);
        let error = self.error + accuracy.of(self.magnitude());
        Self::new(self.corners, self.remainder, error, interval)
    }

    /// Itself, of which an adapter's number is this far away at most.
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

    /// How far it is at most from the interpolation of its corners; infinite where there is no
    /// bound.
    pub fn remainder(self) -> f64 {
        self.remainder
    }

    /// How far an adapter's number is at most from the exact one; infinite where there is no bound.
    pub fn error(self) -> f64 {
        self.error
    }

    /// The values that it may have on an adapter.
    pub fn range(self) -> Interval {
        let [least, largest] = self.ends();
        let off = self.remainder + self.error;
        Interval::new(least - off, largest + off).and(self.interval)
    }

    /// Largest absolute value that it may have.
    pub fn magnitude(self) -> f64 {
        self.range().magnitude()
    }

    /// Least and largest corner.
    pub fn ends(self) -> [f64; 2] {
        let least = self.corners.into_iter().fold(f64::INFINITY, f64::min);
        let largest = self.corners.into_iter().fold(f64::NEG_INFINITY, f64::max);
        [least, largest]
    }

    /// Largest difference of two corners.
    pub fn width(self) -> f64 {
        let [least, largest] = self.ends();
        largest - least
    }

    /// The number it is everywhere, roundings apart, if it is one.
    pub fn single(self) -> Option<f64> {
        let [a, b, c] = self.corners;
        (a == b && b == c && self.remainder == 0.0).then_some(a)
    }

    /// The number it is everywhere and on every adapter, if it is one.
    pub fn exact(self) -> Option<f64> {
        self.single().filter(|_| self.error == 0.0)
    }

    /// `a x + b y`, exactly affine, before it is rounded.
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

    /// Its product with another, before it is rounded.
    ///
    /// With `f` and `g` affine, `f g` is off the interpolation of its corners by the sum of
    /// `b_i b_j (f_i - f_j)(g_i - g_j)` over the three edges, `b` being the barycentric
    /// coordinates: the products of two of them are at most a quarter, and a third together.
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
        // One factor's error times what the other is on the adapter, and the reverse with what it
        // is exactly.
        let error = self.error * other.magnitude() + other.error * self.magnitude();
        // Two that are the same in all that is known are the same number, where nothing is left to
        // differ but a rounding.
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
