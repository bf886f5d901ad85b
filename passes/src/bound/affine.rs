//! A number that is affine over a triangle, up to a remainder.

/// The value at each corner, how far it is at most from what lies between them, and an interval that holds it all the same.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Affine {
    corners: [f64; 3],
    remainder: f64,
    /// A square is not below 0, a sine not above 1, whatever the remainder would allow.
    interval: [f64; 2],
}

const EVERYWHERE: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

impl Affine {
    /// Nothing is known.
    pub const ANYTHING: Self = Self {
        corners: [0.0; 3],
        remainder: f64::INFINITY,
        interval: EVERYWHERE,
    };

    /// The same number everywhere.
    pub const fn constant(number: f64) -> Self {
        Self {
            corners: [number; 3],
            remainder: 0.0,
            interval: EVERYWHERE,
        }
    }

    /// Interpolated between the corners.
    pub const fn between(corners: [f64; 3]) -> Self {
        Self {
            corners,
            remainder: 0.0,
            interval: EVERYWHERE,
        }
    }

    /// The number with these values at the corners, `remainder` at most from what lies between them and within `interval`. Nothing is known of one that is NaN or infinite
    /// at a corner.
    pub fn new(corners: [f64; 3], remainder: f64, interval: [f64; 2]) -> Self {
        let interval = interval.map(|end| if end.is_nan() { None } else { Some(end) });
        let interval = match interval {
            [Some(least), Some(largest)] => [least, largest],
            _ => EVERYWHERE,
        };
        if !corners.iter().all(|c| c.is_finite()) || remainder.is_nan() {
            return Self::ANYTHING;
        }
        // Nor is anything further from what lies between two points of an interval than these are from one another.
        Self {
            corners,
            remainder: remainder.min(interval[1] - interval[0]),
            interval,
        }
    }

    /// Itself, which lies in this interval too.
    #[must_use]
    pub fn intersected(self, [least, largest]: [f64; 2]) -> Self {
        match self.remainder.is_finite() {
            true => {
                let [a, b] = self.interval;
                Self::new(self.corners, self.remainder, [a.max(least), b.min(largest)])
            }
            // Of what is not known it is not known either that it is a number.
            false => self,
        }
    }

    /// The values at the corners.
    pub fn corners(self) -> [f64; 3] {
        self.corners
    }

    /// How far it is at most from the interpolation of its corners; infinite where there is no bound.
    pub fn remainder(self) -> f64 {
        self.remainder
    }

    /// Least and largest value that it may have.
    pub fn range(self) -> [f64; 2] {
        let [least, largest] = self.ends();
        [
            (least - self.remainder).max(self.interval[0]),
            (largest + self.remainder).min(self.interval[1]),
        ]
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

    /// The number it is everywhere, if it is one.
    pub fn single(self) -> Option<f64> {
        let [a, b, c] = self.corners;
        (a == b && b == c && self.remainder == 0.0).then_some(a)
    }

    /// `a x + b y`, exactly affine.
    pub fn combined(a: f64, x: Self, b: f64, y: Self) -> Self {
        let corners = [0, 1, 2].map(|i| a * x.corners[i] + b * y.corners[i]);
        let scaled = |a: f64, x: Self| {
            let [low, high] = x.range();
            [(a * low).min(a * high), (a * low).max(a * high)]
        };
        let ([low, high], [other_low, other_high]) = (scaled(a, x), scaled(b, y));
        let remainder = a.abs() * x.remainder + b.abs() * y.remainder;
        Self::new(corners, remainder, [low + other_low, high + other_high])
    }

    /// Its product with another.
    ///
    /// With `f` and `g` affine, `f g` is off the interpolation of its corners by the sum of `b_i b_j (f_i - f_j)(g_i - g_j)` over the three edges, `b` being the
    /// barycentric coordinates: the products of two of them are at most a quarter, and a third together.
    pub fn times(self, other: Self) -> Self {
        if let (Some(a), _) | (_, Some(a)) = (self.single(), other.single()) {
            let varying = if self.single().is_some() { other } else { self };
            // Nothing times nothing known is still nothing.
            return match a == 0.0 && varying.remainder.is_finite() {
                true => Self::constant(0.0),
                false => Self::combined(a, varying, 0.0, Self::constant(0.0)),
            };
        }
        let (f, g) = (self.corners, other.corners);
        let edges = [(0, 1), (1, 2), (2, 0)].map(|(i, j)| ((f[i] - f[j]) * (g[i] - g[j])).abs());
        let bend =
            (edges.iter().sum::<f64>() / 4.0).min(edges.into_iter().fold(0.0, f64::max) / 3.0);
        let largest = |x: Self| x.corners.into_iter().fold(0.0, |m: f64, c| m.max(c.abs()));
        let (r, s) = (self.remainder, other.remainder);
        let remainder = bend + largest(self) * s + largest(other) * r + r * s;
        let [low, high] = self.range();
        let ends = other.range().map(|end| [low * end, high * end]);
        let ends = ends.as_flattened();
        // Without a remainder two that are the same at the corners are the same everywhere.
        let is_square = self == other && r == 0.0;
        let least = ends.iter().copied().fold(f64::INFINITY, f64::min);
        let largest = ends.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let interval = match ends.iter().any(|e| e.is_nan()) {
            true => EVERYWHERE,
            false => [if is_square { least.max(0.0) } else { least }, largest],
        };
        Self::new([0, 1, 2].map(|i| f[i] * g[i]), remainder, interval)
    }

    /// A function of it, of which `shape` tells over a range of arguments how it bends there; nothing is known where that is `None`.
    pub fn through(
        self,
        function: impl Fn(f64) -> f64,
        shape: impl Fn([f64; 2]) -> Option<Shape>,
    ) -> Self {
        if let Some(number) = self.single() {
            return Self::new([function(number); 3], 0.0, EVERYWHERE);
        }
        let range = self.range();
        let Some(shape) = shape(range).filter(|_| range.iter().all(|x| x.is_finite())) else {
            return Self::ANYTHING;
        };
        let width = self.width();
        // Half the width is the largest mean distance of two corners from a point between them, a quarter of its square their largest variance.
        let bend = (shape.curvature * width * width / 8.0).min(shape.slope * width / 2.0);
        let smooth = match self.remainder {
            0.0 => bend,
            r => bend + shape.slope * r,
        };
        let corners = self.corners.map(function);
        let remainder = if smooth.is_nan() {
            f64::INFINITY
        } else {
            smooth
        };
        Self::new(corners, remainder, shape.values)
    }
}

/// How a function bends over a range of its argument.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shape {
    /// Largest absolute slope; infinite where it jumps.
    pub slope: f64,
    /// Largest absolute second derivative; infinite where it has a corner.
    pub curvature: f64,
    /// Least and largest value.
    pub values: [f64; 2],
}

impl Shape {
    /// Of a straight line between two values.
    pub fn straight(slope: f64, values: [f64; 2]) -> Self {
        Self {
            slope: slope.abs(),
            curvature: 0.0,
            values,
        }
    }

    /// Of something that jumps between two values.
    pub fn jumping(values: [f64; 2]) -> Self {
        Self {
            slope: f64::INFINITY,
            curvature: f64::INFINITY,
            values,
        }
    }

    /// Of something smooth between two values.
    pub fn smooth(slope: f64, curvature: f64, values: [f64; 2]) -> Self {
        Self {
            slope,
            curvature,
            values,
        }
    }
}
