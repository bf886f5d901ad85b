//! The operations of the interpreter on [`Affine`] numbers.

use std::cmp::Ordering;

use naga::{BinaryOperator, MathFunction};

use super::affine::{Affine, Shape};
use crate::evaluate::Number;

impl Number for Affine {
    fn of(number: f32) -> Self {
        match number.is_finite() {
            true => Self::constant(f64::from(number)),
            false => Self::ANYTHING,
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
            BinaryOperator::Add => Self::combined(1.0, a, 1.0, b),
            BinaryOperator::Subtract => Self::combined(1.0, a, -1.0, b),
            BinaryOperator::Multiply => a.times(b),
            BinaryOperator::Divide => a.times(reciprocal(b)),
            BinaryOperator::Modulo => match b.single() {
                // Of the sign of the dividend, and less than the divisor.
                Some(m) => a.through(|x| x % m, |range| remainder(range, m.abs())),
                None => Self::ANYTHING,
            },
            _ => return None,
        })
    }

    fn compare(self, other: Self) -> Option<Option<Ordering>> {
        if let (Some(a), Some(b)) = (self.single(), other.single()) {
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
            (M::Sign, [x]) => x.through(sign, |[low, high]| {
                Some(Shape::jumping([sign(low), sign(high)]))
            }),
            (M::Min, [a, b]) => min(*a, *b),
            (M::Max, [a, b]) => max(*a, *b),
            (M::Clamp, [x, low, high]) => min(max(*x, *low), *high),
            (M::Saturate, [x]) => saturate(*x),
            (M::Sin, [x]) => x.through(f64::sin, |_| Some(WAVE)),
            (M::Cos, [x]) => x.through(f64::cos, |_| Some(WAVE)),
            (M::Sinh, [x]) => x.through(f64::sinh, |r| Some(hyperbolic(r))),
            (M::Cosh, [x]) => x.through(f64::cosh, |r| Some(hyperbolic(r))),
            // The second derivative of tanh is at most 4 / (3 sqrt 3), that of atan 3 sqrt 3 / 8.
            (M::Tanh, [x]) => {
                x.through(f64::tanh, |_| Some(Shape::smooth(1.0, 0.7699, [-1.0, 1.0])))
            }
            (M::Atan, [x]) => x.through(f64::atan, |_| {
                Some(Shape::smooth(1.0, 0.6496, [-1.571, 1.571]))
            }),
            (M::Acos, [x]) => x.through(f64::acos, |r| arc(r, f64::acos)),
            (M::Asin, [x]) => x.through(f64::asin, |r| arc(r, f64::asin)),
            (M::Exp, [x]) => x.through(f64::exp, |r| Some(exponential(r, 1.0))),
            (M::Exp2, [x]) => {
                x.through(f64::exp2, |r| Some(exponential(r, std::f64::consts::LN_2)))
            }
            (M::Log, [x]) => logarithm(*x, 1.0),
            (M::Log2, [x]) => logarithm(*x, std::f64::consts::LOG2_E),
            (M::Sqrt, [x]) => x.through(f64::sqrt, square_root),
            (M::InverseSqrt, [x]) => x.through(|x| 1.0 / x.sqrt(), |r| power(r, -0.5)),
            (M::Pow, [x, y]) => match y.single() {
                Some(y) => x.through(|x| x.powf(y), |r| power(r, y)),
                // WGSL section 17.5: pow is exp2(y * log2(x)).
                None => {
                    let exponent = y.times(logarithm(*x, std::f64::consts::LOG2_E));
                    return Self::call(M::Exp2, &[exponent]);
                }
            },
            (M::Radians, [x]) => Self::combined(1_f64.to_radians(), *x, 0.0, ZERO),
            (M::Degrees, [x]) => Self::combined(1_f64.to_degrees(), *x, 0.0, ZERO),
            (M::Floor, [x]) => steps(*x, f64::floor),
            (M::Ceil, [x]) => steps(*x, f64::ceil),
            (M::Round, [x]) => steps(*x, f64::round_ties_even),
            (M::Trunc, [x]) => steps(*x, f64::trunc),
            (M::Fract, [x]) => x.through(|x| x - x.floor(), remainder_floor),
            (M::Step, [edge, x]) => {
                let past = Self::combined(1.0, *x, -1.0, *edge);
                past.through(
                    |d| f64::from(u8::from(d >= 0.0)),
                    |[low, high]| {
                        let of = |d: f64| f64::from(u8::from(d >= 0.0));
                        Some(Shape::jumping([of(low), of(high)]))
                    },
                )
            }
            (M::Mix, [a, b, t]) => {
                Self::combined(1.0, *a, 1.0, Self::combined(1.0, *b, -1.0, *a).times(*t))
            }
            (M::Fma, [a, b, c]) => Self::combined(1.0, a.times(*b), 1.0, *c),
            (M::SmoothStep, [low, high, x]) => {
                let along = Self::combined(1.0, *x, -1.0, *low);
                let t = along.times(reciprocal(Self::combined(1.0, *high, -1.0, *low)));
                // 3 t^2 - 2 t^3: a slope of 3/2 in the middle, a second derivative of 6 at the ends.
                saturate(t).through(
                    |t| t * t * (3.0 - 2.0 * t),
                    |_| Some(Shape::smooth(1.5, 6.0, [0.0, 1.0])),
                )
            }
            // Something else of numbers has some value.
            (M::Tan | M::Atan2 | M::Asinh | M::Acosh | M::Atanh, _) => Self::ANYTHING,
            _ => return None,
        })
    }

    fn within(self, least: f32, largest: f32) -> Self {
        self.intersected([least, largest].map(f64::from))
    }

    fn single(self) -> Option<f32> {
        Affine::single(self).map(|x| x as f32)
    }
}

const ZERO: Affine = Affine::constant(0.0);

/// Of sine and cosine, whatever the argument.
const WAVE: Shape = Shape {
    slope: 1.0,
    curvature: 1.0,
    values: [-1.0, 1.0],
};

fn sign(x: f64) -> f64 {
    if x == 0.0 { 0.0 } else { x.signum() }
}

fn abs(x: Affine) -> Affine {
    x.through(f64::abs, |[low, high]| {
        Some(match low < 0.0 && high > 0.0 {
            true => Shape::smooth(1.0, f64::INFINITY, [0.0, high.max(-low)]),
            false => Shape::straight(1.0, [low.abs().min(high.abs()), low.abs().max(high.abs())]),
        })
    })
}

/// `max(a, b)` is `b` and as much as `a` is above it.
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
        |[_, high]| Some(Shape::smooth(1.0, f64::INFINITY, [0.0, high])),
    );
    Affine::combined(1.0, b, 1.0, above)
}

fn min(a: Affine, b: Affine) -> Affine {
    max(a.negated(), b.negated()).negated()
}

fn saturate(x: Affine) -> Affine {
    x.through(
        |x| x.clamp(0.0, 1.0),
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

fn reciprocal(x: Affine) -> Affine {
    x.through(
        |x| 1.0 / x,
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

fn exponential([low, high]: [f64; 2], rate: f64) -> Shape {
    let at = |x: f64| (rate * x).exp();
    Shape::smooth(rate * at(high), rate * rate * at(high), [at(low), at(high)])
}

fn hyperbolic([low, high]: [f64; 2]) -> Shape {
    let largest = low.abs().max(high.abs()).cosh();
    Shape::smooth(largest, largest, [-largest, largest])
}

fn logarithm(x: Affine, scale: f64) -> Affine {
    x.through(
        |x| scale * x.ln(),
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

fn square_root([low, high]: [f64; 2]) -> Option<Shape> {
    if low == 0.0 {
        return Some(Shape::jumping([0.0, high.sqrt()]));
    }
    power([low, high], 0.5)
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

fn arc([low, high]: [f64; 2], function: fn(f64) -> f64) -> Option<Shape> {
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
}

/// A staircase: level where the range meets one step only.
fn steps(x: Affine, function: fn(f64) -> f64) -> Affine {
    x.through(function, |[low, high]| {
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

fn remainder([low, high]: [f64; 2], modulus: f64) -> Option<Shape> {
    if modulus == 0.0 {
        return None;
    }
    let turns = |x: f64| (x / modulus).trunc();
    Some(
        match turns(low) == turns(high) && (low >= 0.0) == (high >= 0.0) {
            true => Shape::straight(1.0, [low % modulus, high % modulus]),
            false => Shape::jumping([-modulus, modulus]),
        },
    )
}
