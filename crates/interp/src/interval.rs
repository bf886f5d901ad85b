//! Intervals of numbers (Moore 1966), and the effects of operators and functions on them, in one
//! table for all analyses and transforms.

use std::cmp::Ordering;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

use naga::{BinaryOperator, MathFunction};

use super::accuracy::{Accuracy, LARGEST, LARGEST_TANH, SMALLEST};
use super::number::Number;

/// All numbers from `low` to `high`. Either end may be infinite.
///
/// Dependencies between values are not tracked: `x - x` is twice as wide as `x`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// Lower bound.
    pub low: f64,
    /// Upper bound.
    pub high: f64,
}

impl Interval {
    /// All numbers, and NaN.
    pub const ANYTHING: Self = Self {
        low: f64::NEG_INFINITY,
        high: f64::INFINITY,
    };
    /// From 0 to 1.
    pub const UNIT: Self = Self::new(0.0, 1.0);
    /// 0 and above.
    pub const NOT_NEGATIVE: Self = Self::new(0.0, f64::INFINITY);

    /// From `low` to `high`. [`Self::ANYTHING`] if one is NaN or they are not in order.
    pub const fn new(low: f64, high: f64) -> Self {
        match low <= high {
            true => Self { low, high },
            false => Self::ANYTHING,
        }
    }

    /// Only this number.
    pub const fn exactly(number: f64) -> Self {
        Self::new(number, number)
    }

    /// From `-magnitude` to `magnitude`.
    pub const fn up_to(magnitude: f64) -> Self {
        Self::new(-magnitude, magnitude)
    }

    /// An input `f32`: the number itself. If an adapter may flush it, or round it to another
    /// subnormal number, everything from slightly beyond it to 0.
    pub fn input(number: f64) -> Self {
        let most = number.abs() + SUBNORMAL;
        match number {
            _ if number == 0.0 || number.abs() >= SMALLEST => Self::exactly(number),
            _ if number > 0.0 => Self::new(0.0, most),
            _ => Self::new(-most, 0.0),
        }
    }

    /// Whether both ends are finite.
    pub fn is_known(self) -> bool {
        self.low.is_finite() && self.high.is_finite()
    }

    /// Whether it contains a number. An unbounded interval contains NaN too.
    pub fn contains(self, number: f64) -> bool {
        !self.is_known() || (self.low <= number && number <= self.high)
    }

    /// Its only number, if it has one.
    pub fn number(self) -> Option<f64> {
        (self.low == self.high).then_some(self.low)
    }

    /// Largest absolute value.
    pub fn magnitude(self) -> f64 {
        self.low.abs().max(self.high.abs())
    }

    /// Smallest absolute value.
    pub fn least(self) -> f64 {
        match self.low > 0.0 || self.high < 0.0 {
            true => self.low.abs().min(self.high.abs()),
            false => 0.0,
        }
    }

    /// The smallest interval that contains both.
    #[must_use]
    pub fn or(self, other: Self) -> Self {
        Self::new(self.low.min(other.low), self.high.max(other.high))
    }

    /// The numbers that are also in `other`.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self::new(self.low.max(other.low), self.high.min(other.high))
    }

    /// The interval after rounding with this accuracy.
    #[must_use]
    pub fn rounded(self, accuracy: Accuracy) -> Self {
        Self::new(accuracy.lower_bound(self.low), accuracy.above(self.high))
    }

    /// The inverses. Unbounded if 0 is among the numbers.
    #[must_use]
    pub fn inverse(self) -> Self {
        match self.least() > 0.0 {
            true => Self::new(1.0 / self.high, 1.0 / self.low),
            false => Self::ANYTHING,
        }
    }

    /// The quotients by `divisor`, rounded once. Unbounded if the divisor may be 0.
    #[must_use]
    pub fn over(self, divisor: Self) -> Self {
        let quotient = |a: f64, b: f64| if b.is_infinite() { 0.0 } else { a / b };
        match divisor.least() > 0.0 {
            true => self.of_ends(divisor, quotient),
            false => Self::ANYTHING,
        }
    }

    #[must_use]
    /// The exact squares.
    pub fn squared(self) -> Self {
        let (least, most) = (self.least(), self.magnitude());
        Self::new(least * least, most * most)
    }

    /// The results of a function that never decreases.
    #[must_use]
    pub fn rising(self, function: impl Fn(f64) -> f64) -> Self {
        Self::new(function(self.low), function(self.high))
    }

    /// The results of a function that never increases.
    fn falling(self, function: impl Fn(f64) -> f64) -> Self {
        Self::new(function(self.high), function(self.low))
    }

    #[must_use]
    /// The exact sums.
    pub fn plus(self, other: Self) -> Self {
        Self::new(self.low + other.low, self.high + other.high)
    }

    /// The exact products. An infinite end only means unbounded, so 0 times it is 0.
    #[must_use]
    pub fn times(self, other: Self) -> Self {
        self.of_ends(other, |a, b| if a == 0.0 || b == 0.0 { 0.0 } else { a * b })
    }

    /// The results of a function of two numbers that takes its extremes at the ends.
    fn of_ends(self, other: Self, function: impl Fn(f64, f64) -> f64) -> Self {
        let ends = [self.low, self.high].map(|a| [other.low, other.high].map(|b| function(a, b)));
        let ends = ends.as_flattened();
        let low = ends.iter().copied().fold(f64::INFINITY, f64::min);
        let high = ends.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        Self::new(low, high)
    }

    /// The powers with this exponent. No number may be below 0.
    #[must_use]
    pub fn powers(self, exponent: f64) -> Self {
        match exponent >= 0.0 {
            true => self.rising(|x| x.powf(exponent)),
            false => self.falling(|x| x.powf(exponent)),
        }
    }

    /// The results of a sine or cosine that is 1 at `peak`.
    fn wave(self, function: fn(f64) -> f64, peak: f64) -> Self {
        if !self.is_known() {
            return Self::up_to(1.0);
        }
        // Whether the interval contains a point that is a whole number of periods from `at`.
        // Slightly widened for the rounding of this test.
        let holds = |at: f64| {
            let first = ((self.low - at) / TAU - 1e-9).ceil();
            at + first * TAU <= self.high + 1e-6
        };
        let (a, b) = (function(self.low), function(self.high));
        let low = if holds(peak + PI) { -1.0 } else { a.min(b) };
        Self::new(low, if holds(peak) { 1.0 } else { a.max(b) })
    }
}

/// Least `f32` above 0.
const SUBNORMAL: f64 = SMALLEST * f32::EPSILON as f64;

/// The results that an operation on intervals covers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Arithmetic {
    /// Exact results over real numbers.
    Real,
    /// Finite results of any adapter that is as accurate as WGSL requires.
    Finite,
    /// All results of such an adapter. An unbounded interval also contains NaN.
    Adapter,
}

impl Arithmetic {
    /// `+`, `-`, `*`, `/` or `%`. `None` for other operators.
    pub fn binary(self, op: BinaryOperator, a: Interval, b: Interval) -> Option<Interval> {
        Some(match op {
            BinaryOperator::Add => self.sum(a, b),
            BinaryOperator::Subtract => self.sum(a, b.negated()),
            BinaryOperator::Multiply => self.product(a, b),
            BinaryOperator::Divide => self.quotient(a, b),
            BinaryOperator::Modulo => self.remainder(a, b),
            _ => return None,
        })
    }

    /// Covers the results whose exact values lie in `exact`, for these operands.
    pub fn covering(self, operands: &[Interval], exact: Interval, accuracy: Accuracy) -> Interval {
        match self {
            Self::Real => exact,
            Self::Finite => exact.rounded(accuracy),
            Self::Adapter => {
                let rounded = exact.rounded(accuracy);
                let is_finite = operands.iter().all(|o| o.is_known());
                match is_finite && rounded.magnitude() <= LARGEST {
                    true => rounded,
                    false => Interval::ANYTHING,
                }
            }
        }
    }

    fn sum(self, a: Interval, b: Interval) -> Interval {
        // Adding 0 rounds nothing.
        let accuracy = match a.number() == Some(0.0) || b.number() == Some(0.0) {
            true => Accuracy::EXACT,
            false => Accuracy::ROUNDED,
        };
        self.covering(&[a, b], a.plus(b), accuracy)
    }

    fn product(self, a: Interval, b: Interval) -> Interval {
        let is_plain = |x: Interval| x.number().is_some_and(|x| x == 0.0 || x.abs() == 1.0);
        let accuracy = match is_plain(a) || is_plain(b) {
            true => Accuracy::EXACT,
            false => Accuracy::ROUNDED,
        };
        self.covering(&[a, b], a.times(b), accuracy)
    }

    fn quotient(self, a: Interval, b: Interval) -> Interval {
        let is_promised = b.least() > SMALLEST && b.magnitude() <= 2_f64.powi(126);
        match self != Self::Real && !is_promised {
            true => Interval::ANYTHING,
            false => self.covering(&[a, b], a.over(b), Accuracy::QUOTIENT),
        }
    }

    /// Defined as `a - b * trunc(a / b)`. It has the dividend's sign and, except for rounding, is
    /// no larger than the dividend and smaller than the divisor.
    fn remainder(self, a: Interval, b: Interval) -> Interval {
        let quotient = self.quotient(a, b);
        // `f64` rounds this too.
        let quotient = Interval::new(quotient.low.next_down(), quotient.high.next_up());
        let whole = quotient.rising(f64::trunc);
        if let Some(times) = whole.number().filter(|w| w.is_finite()) {
            return self.sum(a, self.product(Interval::exactly(-times), b));
        }
        if self != Self::Real && !whole.is_known() {
            return Interval::ANYTHING;
        }
        let most = a.magnitude().min(b.magnitude());
        let low = if a.low >= 0.0 { 0.0 } else { -most };
        let high = if a.high <= 0.0 { 0.0 } else { most };
        let error = Accuracy::ulps(8.0).of(a.magnitude() + b.magnitude());
        self.covering(&[a, b], Interval::new(low, high), Accuracy::absolute(error))
    }

    /// A componentwise function. `None` for other functions. Missing arguments are unbounded.
    pub fn call(self, function: MathFunction, arguments: &[Interval]) -> Option<Interval> {
        use MathFunction as M;
        let [x, y, z] = [0, 1, 2].map(|i| *arguments.get(i).unwrap_or(&Interval::ANYTHING));
        let is_adapter = self == Self::Adapter;
        let exact = match function {
            M::Tan | M::Mix | M::Fma | M::SmoothStep => return self.composed(function, [x, y, z]),
            M::Pow if is_adapter || (x.low > 0.0 && self != Self::Real) => {
                return self.composed(function, [x, y, z]);
            }
            M::Step => return Some(step(x, y)),
            // WGSL guarantees nothing for these arguments.
            M::InverseSqrt if is_adapter && x.low <= SMALLEST => Interval::ANYTHING,
            M::Asin | M::Acos if is_adapter && x.magnitude() > 1.0 => Interval::ANYTHING,
            M::Tanh if is_adapter && x.magnitude() >= LARGEST_TANH => Interval::ANYTHING,
            M::Pow if x.low >= 0.0 && y.low >= 0.0 => x.powers(y.low).or(x.powers(y.high)),
            M::Min => Interval::new(x.low.min(y.low), x.high.min(y.high)),
            M::Max => Interval::new(x.low.max(y.low), x.high.max(y.high)),
            M::Clamp => clamped(x, y, z),
            M::Atan2 => Interval::up_to(PI),
            M::Pow => Interval::ANYTHING,
            _ => image(function, x)?,
        };
        let accuracy = Accuracy::of_function(function, x.magnitude());
        let covered = self.covering(arguments, exact, accuracy);
        // NaN may be among the results.
        if is_adapter && !covered.is_known() {
            return Some(covered);
        }
        Some(match function {
            M::Sin | M::Cos => covered.and(Interval::up_to(1.0 + 1e-3)),
            M::Exp | M::Exp2 | M::Cosh | M::Sqrt | M::InverseSqrt => {
                covered.and(Interval::NOT_NEGATIVE)
            }
            M::Pow if x.low >= 0.0 => covered.and(Interval::NOT_NEGATIVE),
            _ => covered,
        })
    }

    /// A function that WGSL defines by other operations.
    fn composed(self, function: MathFunction, [x, y, z]: [Interval; 3]) -> Option<Interval> {
        use MathFunction as M;
        let difference = |a: Interval, b: Interval| self.sum(a, b.negated());
        Some(match function {
            M::Tan => self.quotient(self.call(M::Sin, &[x])?, self.call(M::Cos, &[x])?),
            M::Pow => {
                let exponent = self.product(y, self.call(M::Log2, &[x])?);
                self.call(M::Exp2, &[exponent])?
            }
            M::Mix if self != Self::Real => {
                // WGSL allows either formula (section 17.5).
                let rest = difference(Interval::exactly(1.0), z);
                let weighted = self.sum(self.product(x, rest), self.product(y, z));
                weighted.or(self.sum(x, self.product(difference(y, x), z)))
            }
            M::Mix if z.low >= 0.0 && z.high <= 1.0 => x.or(y),
            M::Mix => self.sum(x, self.product(difference(y, x), z)),
            M::Fma => self.sum(self.product(x, y), z),
            M::SmoothStep => {
                let t = self.quotient(difference(z, x), difference(y, x));
                let smooth = t.rising(|t| {
                    let t = t.clamp(0.0, 1.0);
                    t * t * (3.0 - 2.0 * t)
                });
                self.covering(&[t], smooth, Accuracy::of_function(function, 1.0))
            }
            _ => return None,
        })
    }
}

/// `min(max(x, low), high)` or the median of the three: WGSL allows both. They differ if the bounds
/// are not in order.
fn clamped(x: Interval, low: Interval, high: Interval) -> Interval {
    let nested = x.high.max(low.high).min(high.high);
    Interval::new(
        x.low.max(low.low).min(high.low),
        nested.max(x.high.min(low.high)),
    )
}

fn step(edge: Interval, x: Interval) -> Interval {
    match Interval::holds(BinaryOperator::GreaterEqual, x, edge) {
        Some(is_past) => Interval::exactly(f64::from(u8::from(is_past))),
        None => Interval::UNIT,
    }
}

/// The exact results of a function of one argument.
fn image(function: MathFunction, x: Interval) -> Option<Interval> {
    use MathFunction as M;
    Some(match function {
        M::Abs => Interval::new(x.least(), x.magnitude()),
        M::Sign => x.rising(|x| if x == 0.0 { 0.0 } else { x.signum() }),
        M::Saturate => x.rising(|x| x.clamp(0.0, 1.0)),
        M::Sin => x.wave(f64::sin, FRAC_PI_2),
        M::Cos => x.wave(f64::cos, 0.0),
        M::Sinh => x.rising(f64::sinh),
        M::Cosh => Interval::new(x.least(), x.magnitude()).rising(f64::cosh),
        M::Tanh => x.rising(f64::tanh),
        M::Asin => x.rising(|x| x.clamp(-1.0, 1.0).asin()),
        M::Acos => x.falling(|x| x.clamp(-1.0, 1.0).acos()),
        M::Atan => x.rising(f64::atan),
        M::Asinh => x.rising(f64::asinh),
        M::Acosh | M::Atanh => Interval::ANYTHING,
        M::Exp => x.rising(f64::exp),
        M::Exp2 => x.rising(f64::exp2),
        M::Log if x.low > 0.0 => x.rising(f64::ln),
        M::Log2 if x.low > 0.0 => x.rising(f64::log2),
        M::Sqrt if x.low >= 0.0 => x.rising(f64::sqrt),
        M::InverseSqrt if x.low > 0.0 => x.falling(|x| 1.0 / x.sqrt()),
        M::Log | M::Log2 | M::Sqrt | M::InverseSqrt => Interval::ANYTHING,
        M::Radians => x.rising(f64::to_radians),
        M::Degrees => x.rising(f64::to_degrees),
        M::Floor => x.rising(f64::floor),
        M::Ceil => x.rising(f64::ceil),
        M::Round => x.rising(f64::round_ties_even),
        M::Trunc => x.rising(f64::trunc),
        M::Fract if x.low.floor() == x.high.floor() => x.rising(|x| x - x.floor()),
        M::Fract => Interval::UNIT,
        _ => return None,
    })
}

impl Number for Interval {
    fn of(number: f32) -> Self {
        match number.is_finite() {
            true => Self::input(f64::from(number)),
            false => Self::ANYTHING,
        }
    }

    fn is_same(self, other: Self) -> bool {
        self == other
    }

    fn negated(self) -> Self {
        Self::new(-self.high, -self.low)
    }

    fn binary(op: BinaryOperator, a: Self, b: Self) -> Option<Self> {
        Arithmetic::Adapter.binary(op, a, b)
    }

    fn compare(self, other: Self) -> Option<Option<Ordering>> {
        let orders = [
            (BinaryOperator::Less, Ordering::Less),
            (BinaryOperator::Equal, Ordering::Equal),
            (BinaryOperator::Greater, Ordering::Greater),
        ];
        let mut orders = orders.into_iter();
        let found = orders.find(|(op, _)| Self::holds(*op, self, other) == Some(true))?;
        Some(Some(found.1))
    }

    fn holds(op: BinaryOperator, a: Self, b: Self) -> Option<bool> {
        if !(a.is_known() && b.is_known()) {
            return None;
        }
        let is_same = a.number().is_some() && a == b;
        let is_apart = a.high < b.low || b.high < a.low;
        let (yes, no) = match op {
            BinaryOperator::Less => (a.high < b.low, a.low >= b.high),
            BinaryOperator::LessEqual => (a.high <= b.low, a.low > b.high),
            BinaryOperator::Greater => (a.low > b.high, a.high <= b.low),
            BinaryOperator::GreaterEqual => (a.low >= b.high, a.high < b.low),
            BinaryOperator::Equal => (is_same, is_apart),
            BinaryOperator::NotEqual => (is_apart, is_same),
            _ => return None,
        };
        (yes || no).then_some(yes)
    }

    fn call(function: MathFunction, arguments: &[Self]) -> Option<Self> {
        Arithmetic::Adapter.call(function, arguments)
    }

    fn within(self, least: f32, largest: f32) -> Self {
        let beyond = 2_f64.powi(-20);
        let bounds = Self::new(f64::from(least) - beyond, f64::from(largest) + beyond);
        match self.is_known() {
            true => self.and(bounds),
            false => self,
        }
    }

    fn single(self) -> Option<f32> {
        self.number().map(|x| x as f32)
    }

    fn truncated(self) -> Option<f64> {
        self.rising(f64::trunc).number()
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use naga::{BinaryOperator, MathFunction};

    use super::{Arithmetic, Interval};
    use crate::Number;

    /// For all numbers in intervals, each arithmetic's interval contains the number that `f64` gives.
    fn holds(of: impl Fn(Arithmetic, Interval, Interval) -> Interval, by: fn(f64, f64) -> f64) {
        let ends: [f64; 10] = [-9.0, -5.0, -3.0, -0.5, 0.0, 0.5, 2.0, 3.0, 5.0, 10.0];
        let pairs = ends.iter().flat_map(|a| ends.iter().map(move |b| (*a, *b)));
        let all: Vec<Interval> = pairs
            .filter(|(a, b)| a <= b)
            .map(|(a, b)| Interval::new(a, b))
            .collect();
        let inside =
            |r: Interval| (0..=8).map(move |i| r.low + (r.high - r.low) * f64::from(i) / 8.0);
        let found = all.iter().flat_map(|x| all.iter().map(move |y| (*x, *y)));
        for (x, y) in found {
            use Arithmetic::{Adapter, Finite, Real};
            let ranges = [Real, Finite, Adapter].map(|arithmetic| of(arithmetic, x, y));
            for (a, b) in inside(x).flat_map(|a| inside(y).map(move |b| (a, b))) {
                let number = by(a, b);
                for range in ranges {
                    let is_in = number >= range.low - 1e-9 && number <= range.high + 1e-9;
                    assert!(
                        is_in || !number.is_finite(),
                        "{a} {b}: {number} in {range:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn intervals_contain_all_results() {
        use BinaryOperator as B;
        for op in [B::Add, B::Subtract, B::Multiply, B::Divide, B::Modulo] {
            let by = match op {
                B::Add => |a, b| a + b,
                B::Subtract => |a, b| a - b,
                B::Multiply => |a, b| a * b,
                B::Divide => |a, b| a / b,
                _ => |a, b| a % b,
            };
            holds(|with, x, y| with.binary(op, x, y).unwrap(), by);
        }
    }

    #[test]
    fn a_remainder_of_a_whole_quotient_may_be_0() {
        let number = Interval::exactly(49.0);
        for with in [Arithmetic::Real, Arithmetic::Finite, Arithmetic::Adapter] {
            let left = with.binary(BinaryOperator::Modulo, number, number).unwrap();
            assert!(left.contains(0.0), "{with:?}: {left:?}");
        }
        let one = Interval::exactly(1.0);
        assert_eq!(number.over(number), one);
        assert_eq!(one.over(Interval::ANYTHING), Interval::ANYTHING);
        let more = Interval::new(1.0, f64::INFINITY);
        assert_eq!(more.over(more), Interval::NOT_NEGATIVE);
    }

    #[test]
    fn a_subnormal_may_be_kept_rounded_or_flushed() {
        let least = f64::from(f32::from_bits(1));
        for number in [1e-45, -1e-45, 1e-40] {
            let input = Interval::input(number);
            for possible in [0.0, number, f64::from(number as f32)] {
                assert!(
                    input.contains(possible),
                    "{number}: {possible} in {input:?}"
                );
            }
        }
        assert_eq!(Interval::input(0.0), Interval::exactly(0.0));
        // The product is below the least subnormal.
        let (a, b) = (Interval::exactly(2e-20), Interval::exactly(5e-26));
        for with in [Arithmetic::Finite, Arithmetic::Adapter] {
            let product = with.binary(BinaryOperator::Multiply, a, b).unwrap();
            assert!(
                product.contains(0.0) && product.contains(least),
                "{product:?}"
            );
            let product = with.binary(BinaryOperator::Multiply, a.negated(), b);
            let product = product.unwrap();
            assert!(
                product.contains(0.0) && product.contains(-least),
                "{product:?}"
            );
        }
    }

    #[test]
    fn a_mix_may_be_computed_by_either_formula() {
        let [x, y, t] = [1e8, 1.0, 1.0].map(Interval::exactly);
        for with in [Arithmetic::Finite, Arithmetic::Adapter] {
            let mixed = with.call(MathFunction::Mix, &[x, y, t]).unwrap();
            let (x, y, t) = (1e8_f32, 1_f32, 1_f32);
            for formula in [x * (1.0 - t) + y * t, x + (y - x) * t] {
                assert!(mixed.contains(f64::from(formula)), "{formula} in {mixed:?}");
            }
        }
    }

    #[test]
    fn nothing_is_promised_about_a_quotient_by_an_extreme_divisor() {
        let one = Interval::exactly(1.0);
        for divisor in [1e-39, 2_f64.powi(127)].map(Interval::exactly) {
            for op in [BinaryOperator::Divide, BinaryOperator::Modulo] {
                for with in [Arithmetic::Finite, Arithmetic::Adapter] {
                    let found = with.binary(op, one, divisor).unwrap();
                    assert_eq!(found, Interval::ANYTHING, "{with:?} {op:?}");
                }
                let real = Arithmetic::Real.binary(op, one, divisor).unwrap();
                assert!(real.is_known(), "{op:?}");
            }
        }
    }

    #[test]
    fn intervals_of_functions_contain_all_results() {
        use MathFunction as M;
        macro_rules! each {
            ($($function:ident)*) => {$(
                holds(
                    |with, x, y| with.call(M::$function, &[x, y]).unwrap(),
                    |a, b| f64::call(M::$function, &[a, b])
                        .or_else(|| f64::call(M::$function, &[a]))
                        .unwrap(),
                );
            )*};
        }
        each!(Min Max Pow Step Atan2 Abs Sign Saturate Sin Cos Tan Sinh Cosh Tanh Asin Acos Atan
            Asinh Exp Exp2 Log Log2 Sqrt InverseSqrt Radians Degrees Floor Ceil Round Trunc Fract);
        let edge = Interval::exactly(3.0);
        for (low, high) in [(Some(edge), None), (None, Some(edge))] {
            holds(
                |with, x, y| {
                    let bounds = [x, low.unwrap_or(y), high.unwrap_or(y)];
                    with.call(M::Clamp, &bounds).unwrap()
                },
                match low {
                    Some(_) => |a, b| a.max(3.0).min(b),
                    None => |a, b| a.max(b).min(3.0),
                },
            );
        }
        holds(
            |with, x, y| with.call(M::Mix, &[x, y, Interval::UNIT]).unwrap(),
            |a, b| a * 0.25 + b * 0.75,
        );
        holds(
            |with, x, y| with.call(M::SmoothStep, &[x, y, edge]).unwrap(),
            |a, b| f64::call(M::SmoothStep, &[a, b, 3.0]).unwrap(),
        );
    }
}
