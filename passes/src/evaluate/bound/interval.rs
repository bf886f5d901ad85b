//! Plain intervals (Moore 1966), rounded outwards.

use std::cmp::Ordering;

use naga::{BinaryOperator, MathFunction};

use super::accuracy::{Accuracy, LARGEST, SMALLEST};
use crate::evaluate::Number;

/// All numbers from `low` to `high`: what the exact function of real numbers gives is among them,
/// and what any adapter gives that is as accurate as WGSL asks. An interval without an end may hold
/// what is no number, too.
///
/// It knows nothing of how two values hang together, so that `x - x` is as wide as twice `x`;
/// [`super::Affine`] does, as far as that is a matter of a triangle's corners.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    low: f64,
    high: f64,
}

impl Interval {
    /// Nothing is known, not even that it is a number.
    pub const ANYTHING: Self = Self {
        low: f64::NEG_INFINITY,
        high: f64::INFINITY,
    };

    /// From one number to another; all there is where one of them is not finite, or beyond the
    /// range of `f32`.
    pub fn new(low: f64, high: f64) -> Self {
        let is_finite = low.abs() <= LARGEST && high.abs() <= LARGEST;
        match is_finite && low <= high {
            true => Self { low, high },
            false => Self::ANYTHING,
        }
    }

    /// The least and the largest number.
    pub fn ends(self) -> [f64; 2] {
        [self.low, self.high]
    }

    /// Whether it holds a number. [`Self::ANYTHING`] holds NaN too.
    pub fn contains(self, number: f64) -> bool {
        !self.is_known() || (self.low <= number && number <= self.high)
    }

    /// Whether it has ends.
    pub fn is_known(self) -> bool {
        self.low.is_finite() && self.high.is_finite()
    }

    fn single(self) -> Option<f64> {
        (self.low == self.high).then_some(self.low)
    }

    fn magnitude(self) -> f64 {
        self.low.abs().max(self.high.abs())
    }

    fn rounded(self, accuracy: Accuracy) -> Self {
        match self.is_known() {
            true => Self::new(accuracy.below(self.low), accuracy.above(self.high)),
            false => self,
        }
    }

    fn within(self, low: f64, high: f64) -> Self {
        match self.is_known() {
            true => Self::new(self.low.max(low), self.high.min(high)),
            false => self,
        }
    }

    /// Through a function that never falls.
    fn rising(self, function: impl Fn(f64) -> f64, accuracy: Accuracy) -> Self {
        match self.is_known() {
            true => Self::new(function(self.low), function(self.high)).rounded(accuracy),
            false => self,
        }
    }

    /// The least interval that holds these.
    fn hull(numbers: &[f64]) -> Self {
        if numbers.iter().any(|n| n.is_nan()) {
            return Self::ANYTHING;
        }
        let low = numbers.iter().copied().fold(f64::INFINITY, f64::min);
        let high = numbers.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        Self::new(low, high)
    }
}

fn sum(a: Interval, b: Interval) -> Interval {
    // Adding nothing rounds nothing.
    let accuracy = match a.single() == Some(0.0) || b.single() == Some(0.0) {
        true => Accuracy::EXACT,
        false => Accuracy::ROUNDED,
    };
    Interval::new(a.low + b.low, a.high + b.high).rounded(accuracy)
}

fn product(a: Interval, b: Interval) -> Interval {
    if !(a.is_known() && b.is_known()) {
        return Interval::ANYTHING;
    }
    let is_plain = |x: Interval| x.single().is_some_and(|x| x == 0.0 || x.abs() == 1.0);
    let accuracy = match is_plain(a) || is_plain(b) {
        true => Accuracy::EXACT,
        false => Accuracy::ROUNDED,
    };
    let ends = [
        a.low * b.low,
        a.low * b.high,
        a.high * b.low,
        a.high * b.high,
    ];
    Interval::hull(&ends).rounded(accuracy)
}

/// Good where the divisor is no 0 and at most 2^126.
fn quotient(a: Interval, b: Interval) -> Interval {
    let is_safe = (b.low > SMALLEST || b.high < -SMALLEST) && b.magnitude() <= 2_f64.powi(126);
    if !(a.is_known() && is_safe) {
        return Interval::ANYTHING;
    }
    let ends = [
        a.low / b.low,
        a.low / b.high,
        a.high / b.low,
        a.high / b.high,
    ];
    Interval::hull(&ends).rounded(Accuracy::ulps(2.5))
}

/// Of the sign of the dividend and less than the divisor, but for the roundings of
/// `a - b trunc(a / b)`.
fn modulo(a: Interval, b: Interval) -> Interval {
    let whole = quotient(a, b);
    if !whole.is_known() {
        return Interval::ANYTHING;
    }
    if whole.low.trunc() == whole.high.trunc() {
        let turns = whole.low.trunc();
        return sum(a, product(Interval::new(-turns, -turns), b));
    }
    let most = b.magnitude() + Accuracy::ulps(8.0).of(a.magnitude() + b.magnitude());
    Interval::new(-most, most)
}

fn wave(x: Interval, function: fn(f64) -> f64, first_peak: f64) -> Interval {
    if !x.is_known() {
        return Interval::ANYTHING;
    }
    let turn = std::f64::consts::TAU;
    // Whether a point a whole number of turns from `at` lies in it; a little wider, for the
    // roundings of the question.
    let holds = |at: f64| {
        let first = ((x.low - at) / turn - 1e-9).ceil();
        at + first * turn <= x.high + 1e-6
    };
    let (a, b) = (function(x.low), function(x.high));
    let high = if holds(first_peak) { 1.0 } else { a.max(b) };
    let low = if holds(first_peak + std::f64::consts::PI) {
        -1.0
    } else {
        a.min(b)
    };
    Interval::new(low, high)
        .rounded(Accuracy::wave(x.magnitude()))
        .within(-1.0 - 1e-3, 1.0 + 1e-3)
}

fn logarithm(x: Interval, scale: f64) -> Interval {
    match x.low > 0.0 {
        true => x.rising(|x| scale * x.ln(), Accuracy::logarithm()),
        false => Interval::ANYTHING,
    }
}

fn exponential(x: Interval, rate: f64) -> Interval {
    x.rising(|x| (rate * x).exp(), Accuracy::exponential(x.magnitude()))
}

fn arc(x: Interval, function: fn(f64) -> f64) -> Interval {
    if !(x.is_known() && x.magnitude() <= 1.0) {
        return Interval::ANYTHING;
    }
    Interval::hull(&[function(x.low), function(x.high)]).rounded(Accuracy::arc(x.magnitude()))
}

fn root(x: Interval, function: impl Fn(f64) -> f64, accuracy: Accuracy) -> Interval {
    match x.is_known() && x.low >= 0.0 {
        true => Interval::hull(&[function(x.low), function(x.high)]).rounded(accuracy),
        false => Interval::ANYTHING,
    }
}

impl Number for Interval {
    fn of(number: f32) -> Self {
        let exact = f64::from(number);
        match number {
            _ if !number.is_finite() => Self::ANYTHING,
            // An adapter may flush it.
            _ if number.is_subnormal() => Self::new(exact.min(0.0), exact.max(0.0)),
            _ => Self::new(exact, exact),
        }
    }

    fn is_same(self, other: Self) -> bool {
        self == other
    }

    fn negated(self) -> Self {
        Self {
            low: -self.high,
            high: -self.low,
        }
    }

    fn binary(op: BinaryOperator, a: Self, b: Self) -> Option<Self> {
        Some(match op {
            BinaryOperator::Add => sum(a, b),
            BinaryOperator::Subtract => sum(a, b.negated()),
            BinaryOperator::Multiply => product(a, b),
            BinaryOperator::Divide => quotient(a, b),
            BinaryOperator::Modulo => modulo(a, b),
            _ => return None,
        })
    }

    fn compare(self, other: Self) -> Option<Option<Ordering>> {
        if let (Some(a), Some(b)) = (self.single(), other.single()) {
            return Some(a.partial_cmp(&b));
        }
        if !(self.is_known() && other.is_known()) {
            return None;
        }
        match () {
            () if self.high < other.low => Some(Some(Ordering::Less)),
            () if self.low > other.high => Some(Some(Ordering::Greater)),
            () => None,
        }
    }

    fn call(function: MathFunction, arguments: &[Self]) -> Option<Self> {
        use MathFunction as M;
        let half_pi = std::f64::consts::FRAC_PI_2;
        Some(match (function, arguments) {
            (M::Abs, [x]) => match x.low <= 0.0 && x.high >= 0.0 {
                true => Self::new(0.0, x.magnitude()),
                false => Self::hull(&[x.low.abs(), x.high.abs()]),
            },
            (M::Sign, [x]) => {
                let sign = |x: f64| if x == 0.0 { 0.0 } else { x.signum() };
                x.rising(sign, Accuracy::EXACT)
            }
            // Of a number and what is none, either may be the result.
            (M::Min | M::Max, [a, b]) if !(a.is_known() && b.is_known()) => Self::ANYTHING,
            (M::Min, [a, b]) => Self::new(a.low.min(b.low), a.high.min(b.high)),
            (M::Max, [a, b]) => Self::new(a.low.max(b.low), a.high.max(b.high)),
            (M::Clamp, [x, low, high]) => {
                let above = Self::call(M::Max, &[*x, *low])?;
                Self::call(M::Min, &[above, *high])?
            }
            (M::Saturate, [x]) => x.rising(|x| x.clamp(0.0, 1.0), Accuracy::EXACT),
            (M::Sin, [x]) => wave(*x, f64::sin, half_pi),
            (M::Cos, [x]) => wave(*x, f64::cos, 0.0),
            (M::Tan, [x]) => quotient(wave(*x, f64::sin, half_pi), wave(*x, f64::cos, 0.0)),
            (M::Sinh, [x]) => x.rising(f64::sinh, Accuracy::hyperbolic(x.magnitude())),
            (M::Cosh, [x]) => {
                Self::call(M::Abs, &[*x])?.rising(f64::cosh, Accuracy::hyperbolic(x.magnitude()))
            }
            (M::Tanh, [x]) if x.magnitude() < 88.0 => {
                x.rising(f64::tanh, Accuracy::hyperbolic_tangent(x.magnitude()))
            }
            (M::Atan, [x]) => x.rising(f64::atan, Accuracy::ulps(4096.0)),
            (M::Acos, [x]) => arc(*x, f64::acos),
            (M::Asin, [x]) => arc(*x, f64::asin),
            (M::Exp, [x]) => exponential(*x, 1.0),
            (M::Exp2, [x]) => exponential(*x, std::f64::consts::LN_2),
            (M::Log, [x]) => logarithm(*x, 1.0),
            (M::Log2, [x]) => logarithm(*x, std::f64::consts::LOG2_E),
            (M::Sqrt, [x]) => {
                let found = root(*x, f64::sqrt, Accuracy::ulps(5.0));
                found.within(0.0, f64::INFINITY)
            }
            (M::InverseSqrt, [x]) if x.low > SMALLEST => {
                root(*x, |x| 1.0 / x.sqrt(), Accuracy::ulps(2.0))
            }
            // By definition `exp2(y log2(x))`.
            (M::Pow, [x, y]) => exponential(
                product(*y, logarithm(*x, std::f64::consts::LOG2_E)),
                std::f64::consts::LN_2,
            ),
            (M::Radians, [x]) => x.rising(f64::to_radians, Accuracy::ulps(2.0)),
            (M::Degrees, [x]) => x.rising(f64::to_degrees, Accuracy::ulps(2.0)),
            (M::Floor, [x]) => x.rising(f64::floor, Accuracy::EXACT),
            (M::Ceil, [x]) => x.rising(f64::ceil, Accuracy::EXACT),
            (M::Round, [x]) => x.rising(f64::round_ties_even, Accuracy::EXACT),
            (M::Trunc, [x]) => x.rising(f64::trunc, Accuracy::EXACT),
            (M::Fract, [x]) if x.is_known() => match x.low.floor() == x.high.floor() {
                true => x.rising(|x| x - x.floor(), Accuracy::ROUNDED),
                false => Self::new(0.0, 1.0),
            },
            (M::Step, [edge, x]) => match x.compare(*edge) {
                Some(Some(Ordering::Less)) => Self::new(0.0, 0.0),
                Some(Some(_)) => Self::new(1.0, 1.0),
                _ => Self::new(0.0, 1.0),
            },
            (M::Mix, [a, b, t]) => {
                let rest = sum(Self::new(1.0, 1.0), t.negated());
                sum(product(*a, rest), product(*b, *t))
            }
            (M::Fma, [a, b, c]) => sum(product(*a, *b), *c),
            (M::SmoothStep, [low, high, x]) => {
                let difference = |a: Self, b: Self| sum(a, b.negated());
                let t = quotient(difference(*x, *low), difference(*high, *low));
                t.rising(
                    |t| {
                        let t = t.clamp(0.0, 1.0);
                        t * t * (3.0 - 2.0 * t)
                    },
                    Accuracy::ulps(4.0),
                )
            }
            // Something else of numbers has some value.
            (M::Tanh | M::InverseSqrt | M::Fract, [_])
            | (M::Atan2 | M::Asinh | M::Acosh | M::Atanh, _) => Self::ANYTHING,
            _ => return None,
        })
    }

    fn within(self, least: f32, largest: f32) -> Self {
        let beyond = 2_f64.powi(-20);
        self.within(f64::from(least) - beyond, f64::from(largest) + beyond)
    }

    fn single(self) -> Option<f32> {
        self.single().map(|x| x as f32)
    }

    fn truncated(self) -> Option<f64> {
        let (low, high) = (self.low.trunc(), self.high.trunc());
        (self.is_known() && low == high).then_some(low)
    }
}
