//! The interpreter's operations on [`Affine`] numbers.

use std::cmp::Ordering;
use std::f64::consts::{LN_2, LOG2_E};

use naga::{BinaryOperator, MathFunction};

use super::affine::{Affine, JUMP};
use crate::Number;
use crate::accuracy::{Accuracy, SMALLEST};
use crate::interval::{Arithmetic, Interval};

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
        let (a, b) = (self.range(), other.range());
        match () {
            () if a.high < b.low => Some(Some(Ordering::Less)),
            () if a.low > b.high => Some(Some(Ordering::Greater)),
            () => None,
        }
    }

    fn call(function: MathFunction, arguments: &[Self]) -> Option<Self> {
        use MathFunction as M;
        let difference = |a: Self, b: Self| sum(a, b.negated());
        Some(match (function, arguments) {
            (M::Min, [a, b]) => min(*a, *b),
            (M::Max, [a, b]) => max(*a, *b),
            (M::Clamp, [x, low, high]) => min(max(*x, *low), *high),
            (M::Tan, [x]) => {
                let wave = |function| x.apply(function, [1.0, 1.0]);
                quotient(wave(M::Sin), wave(M::Cos))
            }
            (M::Sqrt, [x]) => square_root(*x),
            (M::Pow, [x, y]) => match y.exact() {
                Some(y) => power(*x, y),
                // WGSL section 17.5: pow is exp2(y * log2(x)).
                None => {
                    let exponent = product(*y, Self::call(M::Log2, &[*x])?);
                    return Self::call(M::Exp2, &[exponent]);
                }
            },
            (M::Radians, [x]) => scaled(1_f64.to_radians(), *x),
            (M::Degrees, [x]) => scaled(1_f64.to_degrees(), *x),
            (M::Step, [edge, x]) => {
                let of = |d: f64| f64::from(u8::from(d >= 0.0));
                let past = Self::combined(1.0, *x, -1.0, *edge);
                let values = past.range().rising(of);
                past.through(of, Accuracy::EXACT, values, stairs(values))
            }
            (M::Mix, [a, b, t]) => {
                // Rounded as the sum in its definition, but with the smaller remainder of the
                // equivalent single product.
                let rest = difference(Self::constant(1.0), *t);
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
                let t = quotient(difference(*x, *low), difference(*high, *low));
                let t = Self::call(M::Saturate, &[t])?;
                // 3 t^2 - 2 t^3: a slope of 3/2 in the middle, a second derivative of 6 at the
                // ends.
                let accuracy = Accuracy::of_function(function, 1.0);
                t.through(
                    |t| t * t * (3.0 - 2.0 * t),
                    accuracy,
                    Interval::UNIT,
                    [1.5, 6.0],
                )
            }
            // Other functions with a number as result: the value is unknown.
            (M::Atan2 | M::Asinh | M::Acosh | M::Atanh, _) => Self::ANYTHING,
            (_, [x]) => x.apply(function, slopes(function, x.range())?),
            _ => return None,
        })
    }

    fn within(self, least: f32, largest: f32) -> Self {
        let beyond = 2_f64.powi(-20);
        self.intersected(Interval::new(
            f64::from(least) - beyond,
            f64::from(largest) + beyond,
        ))
    }

    fn single(self) -> Option<f32> {
        self.exact().map(|x| x as f32)
    }

    fn truncated(self) -> Option<f64> {
        let whole = self.range().rising(f64::trunc);
        whole.number().filter(|_| self.is_known())
    }
}

const ZERO: Affine = Affine::constant(0.0);

/// The sum, as an adapter rounds it. Adding 0 rounds nothing.
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

/// The product, as an adapter rounds it. A factor of 0 or 1 rounds nothing.
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

/// The quotient. WGSL's accuracy holds for divisors of at most 2^126.
fn quotient(a: Affine, b: Affine) -> Affine {
    match b.magnitude() <= 2_f64.powi(126) {
        true => a.times(reciprocal(b)).rounded(Accuracy::QUOTIENT),
        false => Affine::ANYTHING,
    }
}

/// Defined as `a - b trunc(a / b)`.
fn modulo(a: Affine, b: Affine) -> Affine {
    let Some(divisor) = b.single() else {
        return Affine::ANYTHING;
    };
    let whole = quotient(a, b).range().rising(f64::trunc);
    if !whole.is_known() {
        return Affine::ANYTHING;
    }
    if let Some(times) = whole.number() {
        // The multiple is the same everywhere and on every adapter.
        return sum(a, product(Affine::constant(-times), b));
    }
    // Except for roundings, it has the dividend's sign and is smaller than the divisor.
    let most = b.magnitude() + Accuracy::ulps(8.0).of(a.magnitude() + b.magnitude());
    let values = Interval::up_to(most);
    a.through(|x| x % divisor, Accuracy::EXACT, values, JUMP)
}

/// The product with a constant that is itself rounded.
fn scaled(factor: f64, x: Affine) -> Affine {
    Affine::combined(factor, x, 0.0, ZERO).rounded(Accuracy::ulps(2.0))
}

/// `max(a, b)` is `b` plus the amount by which `a` exceeds it. Its error is at most the larger of
/// theirs.
fn max(a: Affine, b: Affine) -> Affine {
    let above = Affine::combined(1.0, a, -1.0, b);
    let difference = above.range();
    if difference.low >= 0.0 {
        return a;
    }
    if difference.high <= 0.0 {
        return b;
    }
    let not_below = |x: f64| x.max(0.0);
    let values = difference.rising(not_below);
    let above = above.through(not_below, Accuracy::EXACT, values, [1.0, f64::INFINITY]);
    let larger = Affine::combined(1.0, b, 1.0, above);
    let interval = Arithmetic::Real.call(MathFunction::Max, &[a.range(), b.range()]);
    match larger.is_known() {
        true => Affine::new(
            larger.corners(),
            larger.remainder(),
            a.error().max(b.error()),
            interval.unwrap_or(Interval::ANYTHING),
        ),
        false => larger,
    }
}

fn min(a: Affine, b: Affine) -> Affine {
    max(a.negated(), b.negated()).negated()
}

/// The exact inverse: the quotient is rounded only once.
fn reciprocal(x: Affine) -> Affine {
    let least = x.range().least();
    let slopes = [least.powi(-2), 2.0 * least.powi(-3)];
    x.through(|x| 1.0 / x, Accuracy::EXACT, x.range().inverse(), slopes)
}

/// Defined as `1 / inverseSqrt(x)`. Two roots are no further apart than the root of the distance of
/// their squares.
fn square_root(x: Affine) -> Affine {
    let slopes = match x.range().low > 0.0 {
        true => slopes_of_power(x.range(), 0.5),
        false => JUMP,
    };
    let root = x.apply(MathFunction::Sqrt, slopes);
    if !root.is_known() {
        return root;
    }
    let accuracy = Accuracy::of_function(MathFunction::Sqrt, x.magnitude());
    let flushed = (x.error() + SMALLEST).sqrt() + accuracy.of(root.magnitude());
    let error = root.error().min(flushed);
    Affine::new(root.corners(), root.remainder(), error, root.range())
}

/// The power of a base above 0, or of 0 with an exponent above 0. A negative base has no power.
fn power(x: Affine, y: f64) -> Affine {
    let range = x.range();
    if range.low < 0.0 || (range.low == 0.0 && y <= 0.0) {
        return Affine::ANYTHING;
    }
    let slopes = match range.low == 0.0 && y < 2.0 {
        true => JUMP,
        false => slopes_of_power(range, y),
    };
    let values = range.powers(y);
    // The power of 0 is 0, as exp2 of minus infinity.
    let exponent = match range.low == 0.0 {
        true => 150.0,
        false => range.low.log2().abs().max(range.high.log2().abs()),
    };
    let accuracy = Accuracy::power(y.abs(), y.abs() * exponent, values.high);
    x.through(|x| x.powf(y), accuracy, values, slopes)
        .intersected(Interval::NOT_NEGATIVE)
}

fn slopes_of_power(x: Interval, y: f64) -> [f64; 2] {
    let largest = |factor: f64, exponent: f64| factor.abs() * x.powers(exponent).high;
    [largest(y, y - 1.0), largest(y * (y - 1.0), y - 2.0)]
}

/// Slopes of a step function with these values. Both are 0 if it has only one step.
fn stairs(values: Interval) -> [f64; 2] {
    match values.number() {
        Some(_) => [0.0, 0.0],
        None => JUMP,
    }
}

/// The slopes for [`Affine::through`] of a function of one argument.
fn slopes(function: MathFunction, x: Interval) -> Option<[f64; 2]> {
    use MathFunction as M;
    let corner = f64::INFINITY;
    let most = x.magnitude();
    Some(match function {
        M::Abs if x.low < 0.0 && x.high > 0.0 => [1.0, corner],
        M::Abs => [1.0, 0.0],
        M::Saturate if x.low >= 0.0 && x.high <= 1.0 => [1.0, 0.0],
        M::Saturate if x.low >= 1.0 || x.high <= 0.0 => [0.0, 0.0],
        M::Saturate => [1.0, corner],
        M::Sign | M::Floor | M::Ceil | M::Round | M::Trunc => {
            stairs(Arithmetic::Real.call(function, &[x])?)
        }
        M::Fract if x.low.floor() == x.high.floor() => [1.0, 0.0],
        M::Fract => JUMP,
        M::Sin | M::Cos => [1.0, 1.0],
        M::Sinh | M::Cosh => [most.cosh(); 2],
        // The second derivative of tanh is at most 4 / (3 sqrt 3), that of atan 3 sqrt 3 / 8.
        M::Tanh => [1.0, 0.7699],
        M::Atan => [1.0, 0.6496],
        M::Acos | M::Asin => {
            let rest = 1.0 - most * most;
            [rest.powf(-0.5), most * rest.powf(-1.5)]
        }
        M::Exp => [x.high.exp(); 2],
        M::Exp2 => [LN_2, LN_2 * LN_2].map(|rate| rate * x.high.exp2()),
        M::Log => [1.0 / x.low, 1.0 / (x.low * x.low)],
        M::Log2 => [LOG2_E / x.low, LOG2_E / (x.low * x.low)],
        M::InverseSqrt => slopes_of_power(x, -0.5),
        _ => return None,
    })
}
