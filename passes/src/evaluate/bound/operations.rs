//! The operations of the interpreter on [`Affine`] numbers.

use std::cmp::Ordering;

use naga::{BinaryOperator, MathFunction};

use super::accuracy::{Accuracy, SMALLEST};
use super::affine::{Affine, Shape};
use crate::evaluate::Number;

impl Number for Affine {
    fn of(number: f32) -> Self {
        match number {
            _ if !number.is_finite() => Self::ANYTHING,
            // An adapter may flush it.
            _ if number.is_subnormal() => Self::constant(f64::from(number)).off_by(SMALLEST),
            _ => Self::constant(f64::from(number)),
        }
    }

    fn is_same(self, other: Self) -> bool {
        self == other
    }

    fn negated(self) -> Self {
        Self::combined(-1.0, self, 0.0, ZERO)
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
        if let (Some(a), Some(b)) = (self.exact(), other.exact()) {
            return Some(a.partial_cmp(&b));
        }
        let ([low, high], [other_low, other_high]) = (self.range(), other.range());
        if high < other_low {
            Some(Some(Ordering::Less))
        } else if low > other_high {
            Some(Some(Ordering::Greater))
        } else {
            None
        }
    }

    fn call(function: MathFunction, arguments: &[Self]) -> Option<Self> {
        use MathFunction as M;
        Some(match (function, arguments) {
            (M::Abs, [x]) => abs(*x),
            (M::Sign, [x]) => x.through(sign, Accuracy::EXACT, |[low, high]| {
                Some(match sign(low) == sign(high) {
                    true => Shape::straight(0.0, [sign(low); 2]),
                    false => Shape::jumping([sign(low), sign(high)]),
                })
            }),
            (M::Min, [a, b]) => min(*a, *b),
            (M::Max, [a, b]) => max(*a, *b),
            (M::Clamp, [x, low, high]) => min(max(*x, *low), *high),
            (M::Saturate, [x]) => saturate(*x),
            (M::Sin, [x]) => wave(*x, f64::sin),
            (M::Cos, [x]) => wave(*x, f64::cos),
            (M::Tan, [x]) => quotient(wave(*x, f64::sin), wave(*x, f64::cos)),
            (M::Sinh, [x]) => hyperbolic(*x, f64::sinh),
            (M::Cosh, [x]) => hyperbolic(*x, f64::cosh),
            // The second derivative of tanh is at most 4 / (3 sqrt 3), that of atan 3 sqrt 3 / 8.
            (M::Tanh, [x]) => x.through(
                f64::tanh,
                Accuracy::hyperbolic_tangent(x.magnitude()),
                // A quotient of two infinities beyond.
                |[low, high]| {
                    (low > -88.0 && high < 88.0).then(|| Shape::smooth(1.0, 0.7699, [-1.0, 1.0]))
                },
            ),
            (M::Atan, [x]) => x.through(f64::atan, Accuracy::ulps(4096.0), |_| {
                Some(Shape::smooth(1.0, 0.6496, [-1.571, 1.571]))
            }),
            (M::Acos, [x]) => arc(*x, f64::acos),
            (M::Asin, [x]) => arc(*x, f64::asin),
            (M::Exp, [x]) => exponential(*x, 1.0),
            (M::Exp2, [x]) => exponential(*x, std::f64::consts::LN_2),
            (M::Log, [x]) => logarithm(*x, 1.0),
            (M::Log2, [x]) => logarithm(*x, std::f64::consts::LOG2_E),
            (M::Sqrt, [x]) => square_root(*x),
            (M::InverseSqrt, [x]) => {
                x.through(|x| 1.0 / x.sqrt(), Accuracy::ulps(2.0), |r| power(r, -0.5))
            }
            (M::Pow, [x, y]) => match y.exact() {
                Some(y) => {
                    let [low, high] = x.range();
                    let exponent = y.abs() * low.log2().abs().max(high.log2().abs());
                    // Of 0 it is 0, as the power of two of minus infinity.
                    let exponent = if low == 0.0 {
                        150.0 * y.abs()
                    } else {
                        exponent
                    };
                    let largest = low.powf(y).max(high.powf(y));
                    let accuracy = Accuracy::power(y.abs(), exponent, largest);
                    let power = x.through(|x| x.powf(y), accuracy, |r| power(r, y));
                    power.intersected([0.0, f64::INFINITY])
                }
                // WGSL section 17.5: pow is exp2(y * log2(x)).
                None => {
                    let exponent = product(*y, logarithm(*x, std::f64::consts::LOG2_E));
                    return Self::call(M::Exp2, &[exponent]);
                }
            },
            (M::Radians, [x]) => scaled(1_f64.to_radians(), *x),
            (M::Degrees, [x]) => scaled(1_f64.to_degrees(), *x),
            (M::Floor, [x]) => steps(*x, f64::floor),
            (M::Ceil, [x]) => steps(*x, f64::ceil),
            (M::Round, [x]) => steps(*x, f64::round_ties_even),
            (M::Trunc, [x]) => steps(*x, f64::trunc),
            (M::Fract, [x]) => x.through(|x| x - x.floor(), Accuracy::ROUNDED, remainder_floor),
            (M::Step, [edge, x]) => {
                let of = |d: f64| f64::from(u8::from(d >= 0.0));
                let past = Self::combined(1.0, *x, -1.0, *edge);
                past.through(of, Accuracy::EXACT, |[low, high]| {
                    Some(match of(low) == of(high) {
                        true => Shape::straight(0.0, [of(low); 2]),
                        false => Shape::jumping([of(low), of(high)]),
                    })
                })
            }
            (M::Mix, [a, b, t]) => {
                // Rounded as the sum that it is by definition, and bent as the one product that it
                // can be written with.
                let rest = sum(Self::constant(1.0), t.negated());
                let as_defined = sum(product(*a, rest), product(*b, *t));
                let along = Self::combined(1.0, *b, -1.0, *a).times(*t);
                let as_one = Self::combined(1.0, *a, 1.0, along);
                match as_defined.is_known() {
                    true => as_one
                        .off_by(as_defined.error())
                        .intersected(as_defined.range()),
                    false => Self::ANYTHING,
                }
            }
            (M::Fma, [a, b, c]) => sum(product(*a, *b), *c),
            (M::SmoothStep, [low, high, x]) => {
                let difference = |a: Self, b: Self| sum(a, b.negated());
                let t = quotient(difference(*x, *low), difference(*high, *low));
                // 3 t^2 - 2 t^3: a slope of 3/2 in the middle, a second derivative of 6 at the
                // ends. Two products and a difference are rounded.
                saturate(t).through(
                    |t| t * t * (3.0 - 2.0 * t),
                    Accuracy::ulps(4.0),
                    |_| Some(Shape::smooth(1.5, 6.0, [0.0, 1.0])),
                )
            }
            // Something else of numbers has some value.
            (M::Atan2 | M::Asinh | M::Acosh | M::Atanh, _) => Self::ANYTHING,
            _ => return None,
        })
    }

    fn within(self, least: f32, largest: f32) -> Self {
        let beyond = 2_f64.powi(-20);
        self.intersected([f64::from(least) - beyond, f64::from(largest) + beyond])
    }

    fn single(self) -> Option<f32> {
        self.exact().map(|x| x as f32)
    }

    fn truncated(self) -> Option<f64> {
        let [low, high] = self.range().map(f64::trunc);
        (self.is_known() && low == high).then_some(low)
    }
}

const ZERO: Affine = Affine::constant(0.0);

/// A sum as an adapter rounds it; where nothing is added, there is nothing to round.
fn sum(a: Affine, b: Affine) -> Affine {
    if let Some(exact) = a.exact_sum(b) {
        return Affine::constant(exact);
    }
    let sum = Affine::combined(1.0, a, 1.0, b);
    match a.exact() == Some(0.0) || b.exact() == Some(0.0) {
        true => sum,
        false => sum.rounded(Accuracy::ROUNDED),
    }
}

/// A product as an adapter rounds it; 0 and 1 leave nothing to round.
fn product(a: Affine, b: Affine) -> Affine {
    if let Some(exact) = a.exact_product(b) {
        return Affine::constant(exact);
    }
    let is_plain = |x: Affine| x.exact().is_some_and(|x| x == 0.0 || x.abs() == 1.0);
    match is_plain(a) || is_plain(b) {
        true => a.times(b),
        false => a.times(b).rounded(Accuracy::ROUNDED),
    }
}

/// A quotient, good where the divisor is at most 2^126.
fn quotient(a: Affine, b: Affine) -> Affine {
    match b.magnitude() <= 2_f64.powi(126) {
        true => a.times(reciprocal(b)).rounded(Accuracy::ulps(2.5)),
        false => Affine::ANYTHING,
    }
}

/// By definition `a - b trunc(a / b)`.
fn modulo(a: Affine, b: Affine) -> Affine {
    let Some(divisor) = b.single() else {
        return Affine::ANYTHING;
    };
    let [low, high] = quotient(a, b).range().map(f64::trunc);
    if !(low.is_finite() && high.is_finite()) {
        return Affine::ANYTHING;
    }
    if low == high {
        // The same multiple everywhere and on every adapter.
        return sum(a, product(Affine::constant(-low), b));
    }
    // Of the sign of the dividend and less than the divisor, but for roundings.
    let most = b.magnitude() + Accuracy::ulps(8.0).of(a.magnitude() + b.magnitude());
    a.through(
        |x| x % divisor,
        Accuracy::EXACT,
        |_| Some(Shape::jumping([-most, most])),
    )
}

/// Its product with a constant that is rounded too.
fn scaled(factor: f64, x: Affine) -> Affine {
    Affine::combined(factor, x, 0.0, ZERO).rounded(Accuracy::ulps(2.0))
}

fn wave(x: Affine, function: fn(f64) -> f64) -> Affine {
    let accuracy = Accuracy::wave(x.magnitude());
    x.through(function, accuracy, |_| {
        Some(Shape::smooth(1.0, 1.0, [-1.0, 1.0]))
    })
}

fn sign(x: f64) -> f64 {
    if x == 0.0 { 0.0 } else { x.signum() }
}

fn abs(x: Affine) -> Affine {
    x.through(f64::abs, Accuracy::EXACT, |[low, high]| {
        Some(match low < 0.0 && high > 0.0 {
            true => Shape::smooth(1.0, f64::INFINITY, [0.0, high.max(-low)]),
            false => Shape::straight(1.0, [low.abs().min(high.abs()), low.abs().max(high.abs())]),
        })
    })
}

/// `max(a, b)` is `b` and as much as `a` is above it. It is one of the two, and as far off as one
/// of them at most.
fn max(a: Affine, b: Affine) -> Affine {
    let above = Affine::combined(1.0, a, -1.0, b);
    let [low, high] = above.range();
    if low >= 0.0 {
        return a;
    }
    if high <= 0.0 {
        return b;
    }
    let above = above.through(
        |x| x.max(0.0),
        Accuracy::EXACT,
        |[_, high]| Some(Shape::smooth(1.0, f64::INFINITY, [0.0, high])),
    );
    let larger = Affine::combined(1.0, b, 1.0, above);
    let ([low, high], [other_low, other_high]) = (a.range(), b.range());
    match larger.is_known() {
        true => Affine::new(
            larger.corners(),
            larger.remainder(),
            a.error().max(b.error()),
            [low.max(other_low), high.max(other_high)],
        ),
        false => larger,
    }
}

fn min(a: Affine, b: Affine) -> Affine {
    max(a.negated(), b.negated()).negated()
}

fn saturate(x: Affine) -> Affine {
    x.through(
        |x| x.clamp(0.0, 1.0),
        Accuracy::EXACT,
        |[low, high]| {
            Some(if low >= 0.0 && high <= 1.0 {
                Shape::straight(1.0, [low, high])
            } else if low >= 1.0 || high <= 0.0 {
                Shape::straight(0.0, [low.clamp(0.0, 1.0); 2])
            } else {
                Shape::smooth(1.0, f64::INFINITY, [low.max(0.0), high.min(1.0)])
            })
        },
    )
}

/// Exactly: a quotient is rounded once.
fn reciprocal(x: Affine) -> Affine {
    x.through(
        |x| 1.0 / x,
        Accuracy::EXACT,
        |[low, high]| {
            let least = low.abs().min(high.abs());
            (low > 0.0 || high < 0.0).then(|| {
                Shape::smooth(
                    least.powi(-2),
                    2.0 * least.powi(-3),
                    [1.0 / high, 1.0 / low],
                )
            })
        },
    )
}

fn exponential(x: Affine, rate: f64) -> Affine {
    let accuracy = Accuracy::exponential(x.magnitude());
    x.through(
        |x| (rate * x).exp(),
        accuracy,
        |[low, high]| {
            let at = |x: f64| (rate * x).exp();
            Some(Shape::smooth(
                rate * at(high),
                rate * rate * at(high),
                [at(low), at(high)],
            ))
        },
    )
}

fn hyperbolic(x: Affine, function: fn(f64) -> f64) -> Affine {
    let argument = x.magnitude();
    x.through(function, Accuracy::hyperbolic(argument), |_| {
        let largest = argument.cosh();
        Some(Shape::smooth(largest, largest, [-largest, largest]))
    })
}

fn logarithm(x: Affine, scale: f64) -> Affine {
    x.through(
        |x| scale * x.ln(),
        Accuracy::logarithm(),
        |[low, high]| {
            (low > 0.0).then(|| {
                Shape::smooth(
                    scale / low,
                    scale / (low * low),
                    [scale * low.ln(), scale * high.ln()],
                )
            })
        },
    )
}

/// By definition `1 / inverseSqrt(x)`. Two roots are no further apart than the root of what their
/// squares are.
fn square_root(x: Affine) -> Affine {
    let accuracy = Accuracy::ulps(5.0);
    let root = x.through(f64::sqrt, accuracy, |[low, high]| match low == 0.0 {
        true => Some(Shape::jumping([0.0, high.sqrt()])),
        false => power([low, high], 0.5),
    });
    if !root.is_known() {
        return root;
    }
    let (bend, off) = (root.remainder(), root.error());
    let flushed = x.error() + SMALLEST;
    let error = off.min(flushed.sqrt() + accuracy.of(root.magnitude()));
    Affine::new(root.corners(), bend, error, root.range())
}

/// Of `x^y` for a base above 0; of whole powers from 2 on for 0 too. A base below 0 has no power.
fn power([low, high]: [f64; 2], y: f64) -> Option<Shape> {
    if low < 0.0 || (low == 0.0 && y < 2.0) {
        return match low == 0.0 && y > 0.0 {
            true => Some(Shape::jumping([0.0, high.powf(y)])),
            false => None,
        };
    }
    let ends =
        |factor: f64, exponent: f64| factor.abs() * low.powf(exponent).max(high.powf(exponent));
    let (a, b) = (low.powf(y), high.powf(y));
    Some(Shape::smooth(
        ends(y, y - 1.0),
        ends(y * (y - 1.0), y - 2.0),
        [a.min(b), a.max(b)],
    ))
}

fn arc(x: Affine, function: fn(f64) -> f64) -> Affine {
    let accuracy = Accuracy::arc(x.magnitude());
    x.through(function, accuracy, |[low, high]| {
        let largest = low.abs().max(high.abs());
        (largest <= 1.0).then(|| {
            let rest = 1.0 - largest * largest;
            let (a, b) = (function(low), function(high));
            Shape::smooth(
                rest.powf(-0.5),
                largest * rest.powf(-1.5),
                [a.min(b), a.max(b)],
            )
        })
    })
}

/// A staircase: level where the range meets one step only.
fn steps(x: Affine, function: fn(f64) -> f64) -> Affine {
    x.through(function, Accuracy::EXACT, |[low, high]| {
        let (a, b) = (function(low), function(high));
        Some(match a == b {
            true => Shape::straight(0.0, [a, b]),
            false => Shape::jumping([a, b]),
        })
    })
}

fn remainder_floor([low, high]: [f64; 2]) -> Option<Shape> {
    Some(match low.floor() == high.floor() {
        true => Shape::straight(1.0, [low - low.floor(), high - low.floor()]),
        false => Shape::jumping([0.0, 1.0]),
    })
}
