//! Solves a tape backwards for one of its inputs.

use std::cell::RefCell;
use std::cmp::Ordering;

use naga::{BinaryOperator, MathFunction};

use super::{Computation, Decision, Source, Tape, Taped};
use naga_interp::Number;

/// The most candidates of one search.
const MOST_CANDIDATES: usize = 12;

impl Tape {
    /// Values of single inputs at which a number is about `target`, if all others stay.
    pub(crate) fn inverse(&self, number: Taped, target: f32) -> Vec<(Source, f32)> {
        let mut found = Vec::new();
        self.back(number, f64::from(target), 64, &mut found);
        found
    }

    fn back(&self, number: Taped, target: f64, depth: u32, found: &mut Vec<(Source, f32)>) {
        let Some(node) = self.nodes.get(number.at as usize) else {
            return;
        };
        if depth == 0 || found.len() >= MOST_CANDIDATES || !target.is_finite() {
            return;
        }
        let mut to = |operand: Taped, target: f64| self.back(operand, target, depth - 1, found);
        let of = |x: Taped| f64::from(x.value);
        match node.made {
            Computation::Input(source) => found.push((source, target as f32)),
            Computation::Negated(x) => to(x, -target),
            Computation::Binary(op, a, b) => {
                use BinaryOperator as B;
                match op {
                    B::Add => {
                        to(a, target - of(b));
                        to(b, target - of(a));
                    }
                    B::Subtract => {
                        to(a, target + of(b));
                        to(b, of(a) - target);
                    }
                    B::Multiply => {
                        // A square.
                        if a.at == b.at {
                            to(a, target.sqrt().copysign(of(a)));
                        } else {
                            to(a, target / of(b));
                            to(b, target / of(a));
                        }
                    }
                    B::Divide => {
                        to(a, target * of(b));
                        to(b, of(a) / target);
                    }
                    B::Modulo => {
                        let turns = (of(a) / of(b)).trunc();
                        // The remainder has the sign of the dividend.
                        let is_alike = of(a) * target >= 0.0;
                        to(
                            a,
                            if is_alike {
                                turns * of(b) + target
                            } else {
                                target
                            },
                        );
                    }
                    _ => {}
                }
            }
            Computation::Call(function, arguments, count) => {
                let arguments = &arguments[..count];
                for (operand, target) in undone(function, arguments, target) {
                    to(operand, target);
                }
            }
        }
    }
}

impl Decision {
    /// Inputs that may bring its sides together, and about which value.
    pub(crate) fn solutions(&self, tape: &Tape) -> Vec<(Source, f32)> {
        let [a, b] = self.sides;
        let mut all = tape.inverse(a, b.value);
        all.extend(tape.inverse(b, a.value));
        all.retain(|(_, value)| value.is_finite());
        all.dedup();
        all
    }
}

/// The values of operands at which a function has a value.
fn undone(function: MathFunction, arguments: &[Taped], target: f64) -> Vec<(Taped, f64)> {
    use MathFunction as M;
    let of = |x: &Taped| f64::from(x.value);
    match (function, arguments) {
        (M::Abs, [x]) => vec![(*x, target.copysign(of(x))), (*x, -target.copysign(of(x)))],
        (M::Min | M::Max, [a, b]) => vec![(*a, target), (*b, target)],
        (M::Clamp, [x, low, high]) => vec![(*x, target), (*low, target), (*high, target)],
        (M::Saturate | M::Round | M::Floor | M::Ceil | M::Trunc | M::QuantizeToF16, [x]) => {
            vec![(*x, target)]
        }
        (M::Fract, [x]) => vec![(*x, of(x).floor() + target), (*x, target)],
        (M::Sqrt, [x]) => vec![(*x, target * target)],
        (M::InverseSqrt, [x]) => vec![(*x, 1.0 / (target * target))],
        (M::Exp, [x]) => vec![(*x, target.ln())],
        (M::Exp2, [x]) => vec![(*x, target.log2())],
        (M::Log, [x]) => vec![(*x, target.exp())],
        (M::Log2, [x]) => vec![(*x, target.exp2())],
        (M::Sin, [x]) => {
            let turn = std::f64::consts::TAU;
            let start = ((of(x) / turn).round()) * turn;
            vec![(*x, start + target.asin())]
        }
        (M::Cos, [x]) => vec![(*x, target.acos().copysign(of(x))), (*x, target.acos())],
        (M::Tan, [x]) => vec![(*x, target.atan())],
        (M::Asin, [x]) => vec![(*x, target.sin())],
        (M::Acos, [x]) => vec![(*x, target.cos())],
        (M::Atan, [x]) => vec![(*x, target.tan())],
        (M::Radians, [x]) => vec![(*x, target.to_degrees())],
        (M::Degrees, [x]) => vec![(*x, target.to_radians())],
        (M::Pow, [x, y]) => vec![
            (*x, target.powf(1.0 / of(y))),
            (*y, target.ln() / of(x).ln()),
        ],
        (M::Mix, [a, b, t]) => {
            let (low, high, part) = (of(a), of(b), of(t));
            vec![
                (*t, (target - low) / (high - low)),
                (*a, (target - high * part) / (1.0 - part)),
                (*b, (target - low * (1.0 - part)) / part),
            ]
        }
        (M::Fma, [a, b, c]) => vec![
            (*c, target - of(a) * of(b)),
            (*a, (target - of(c)) / of(b)),
            (*b, (target - of(c)) / of(a)),
        ],
        (M::SmoothStep, [low, high, x]) => {
            // The inverse of 3t^2 - 2t^3.
            let t = 0.5 - ((1.0 - 2.0 * target).asin() / 3.0).sin();
            vec![(*x, of(low) + t * (of(high) - of(low)))]
        }
        _ => Vec::new(),
    }
}

/// A part of a tape as a function of one input.
pub(crate) struct Along<'t> {
    tape: &'t Tape,
    sides: [Taped; 2],
    /// The operations that depend on it, in order.
    own: Vec<u32>,
    /// The numbers of all operations at the last value.
    numbers: RefCell<Vec<f32>>,
}

impl<'t> Along<'t> {
    /// The sides of a decision as functions of an input.
    pub(crate) fn new(tape: &'t Tape, sides: [Taped; 2], source: Source) -> Self {
        let last = sides
            .iter()
            .filter(|s| !s.is_constant())
            .map(|s| s.at)
            .max();
        let last = last.map_or(0, |at| at as usize + 1);
        let mut depends = vec![false; last];
        let mut own = Vec::new();
        for (i, node) in tape.nodes.iter().enumerate().take(last) {
            let is_on = |x: &Taped| depends.get(x.at as usize).copied().unwrap_or(false);
            let is_own = match &node.made {
                Computation::Input(other) => *other == source,
                Computation::Negated(x) => is_on(x),
                Computation::Binary(_, a, b) => is_on(a) || is_on(b),
                Computation::Call(_, arguments, count) => arguments[..*count].iter().any(is_on),
            };
            depends[i] = is_own;
            if is_own {
                own.push(i as u32);
            }
        }
        let numbers = tape.nodes.iter().take(last).map(|node| node.value);
        Self {
            tape,
            sides,
            own,
            numbers: RefCell::new(numbers.collect()),
        }
    }

    /// The sides at a value of the input, by the same operations.
    pub(crate) fn at(&self, value: f32) -> [f32; 2] {
        let mut numbers = self.numbers.borrow_mut();
        for at in &self.own {
            let of = |x: &Taped| numbers.get(x.at as usize).copied().unwrap_or(x.value);
            let node = &self.tape.nodes[*at as usize];
            let new = match &node.made {
                Computation::Input(_) => Some(value),
                Computation::Negated(x) => Some(-of(x)),
                Computation::Binary(op, a, b) => f32::binary(*op, of(a), of(b)),
                Computation::Call(function, arguments, count) => {
                    let mut values = [0.0; 3];
                    for (to, from) in values.iter_mut().zip(&arguments[..*count]) {
                        *to = of(from);
                    }
                    f32::call(*function, &values[..*count])
                }
            };
            numbers[*at as usize] = new.unwrap_or(node.value);
        }
        self.sides
            .map(|side| numbers.get(side.at as usize).copied().unwrap_or(side.value))
    }

    /// Values of the input near `start`: one at which the sides are equal, if there is any, and those
    /// just below and above.
    pub(crate) fn around(&self, start: f32) -> Vec<f32> {
        let order = |x: f32| {
            let [a, b] = self.at(x);
            a.partial_cmp(&b)
        };
        let mut found = Vec::new();
        let ends = match order(start) {
            Some(Ordering::Equal) => [start; 2],
            _ => match self.crossing(start) {
                Some(ends) => ends,
                None => return found,
            },
        };
        if ends[0] == ends[1] {
            found.push(ends[0]);
        }
        // The first values on both sides where they are not equal.
        for (end, is_up) in ends.into_iter().zip([false, true]) {
            let mut x = end;
            let mut bits = 1;
            let mut seen = order(x);
            while seen == Some(Ordering::Equal) && bits < 1 << 24 {
                x = moved(end, if is_up { bits } else { -bits });
                seen = order(x);
                bits *= 2;
            }
            found.push(x);
        }
        found
    }

    /// Two neighbours around `start` between which the order of the sides changes; or one value at
    /// which they are equal, twice.
    fn crossing(&self, start: f32) -> Option<[f32; 2]> {
        let order = |x: f32| {
            let [a, b] = self.at(x);
            a.partial_cmp(&b)
        };
        let own = order(start)?;
        let mut found = None;
        'search: for exponent in 0..26 {
            for by in [1_i64 << exponent, -(1_i64 << exponent)] {
                let x = moved(start, by);
                match order(x) {
                    Some(Ordering::Equal) => return Some([x, x]),
                    Some(other) if other != own => {
                        found = Some(x);
                        break 'search;
                    }
                    _ => {}
                }
            }
        }
        let (mut a, mut b) = (ordinal(start), ordinal(found?));
        while (a - b).abs() > 1 {
            let middle = i64::midpoint(a, b);
            match order(from_ordinal(middle)) {
                Some(Ordering::Equal) => {
                    let x = from_ordinal(middle);
                    return Some([x, x]);
                }
                Some(other) if other == own => a = middle,
                _ => b = middle,
            }
        }
        let (low, high) = (a.min(b), a.max(b));
        Some([from_ordinal(low), from_ordinal(high)])
    }
}

/// The position of a float among all, 0 at 0.
fn ordinal(x: f32) -> i64 {
    let bits = i64::from(x.to_bits() & 0x7fff_ffff);
    if x.is_sign_negative() { -bits } else { bits }
}

fn from_ordinal(at: i64) -> f32 {
    let most = i64::from(f32::MAX.to_bits());
    let size = f32::from_bits(at.abs().min(most) as u32);
    if at < 0 { -size } else { size }
}

/// The float that is `by` steps away.
fn moved(x: f32, by: i64) -> f32 {
    from_ordinal(ordinal(x) + by)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::panic)]
mod tests {
    use super::super::taped;
    use super::*;

    const A: Source = Source::Texel((0, 0), 0);

    /// The values around the tie of the comparison in `compare`, for an input of this value.
    fn around(value: f32, compare: impl Fn(Taped)) -> Vec<f32> {
        let ((), tape) = taped(|| compare(Taped::input(A, value)));
        let decision = tape.decisions[0];
        let solutions = decision.solutions(&tape);
        let (source, start) = solutions[0];
        Along::new(&tape, decision.sides, source).around(start)
    }

    fn binary(op: BinaryOperator, a: Taped, b: f32) -> Taped {
        Taped::binary(op, a, Taped::of(b)).unwrap()
    }

    fn equals(a: Taped, b: f32) {
        Taped::holds(BinaryOperator::Equal, a, Taped::of(b));
    }

    #[test]
    fn a_comparison_is_solved_for_its_input() {
        use BinaryOperator as B;
        let tie = around(2.0, |a| {
            let scaled = binary(B::Multiply, a, 10.0);
            equals(binary(B::Subtract, scaled, 3.7), 0.0);
        });
        assert_eq!(tie[0] * 10.0 - 3.7, 0.0, "{tie:?}");
        assert!(tie[1] * 10.0 < 3.7 && tie[2] * 10.0 > 3.7, "{tie:?}");
        let rest = around(2.0, |a| equals(binary(B::Modulo, a, 3.0), -1.0));
        assert_eq!(rest[0] % 3.0, -1.0);
        let cutoff = around(0.2, |a| equals(a, 0.5));
        assert_eq!(cutoff, [0.5, 0.5_f32.next_down(), 0.5_f32.next_up()]);
        let root = around(2.0, |a| {
            let root = Taped::call(MathFunction::Sqrt, &[a]).unwrap();
            equals(root, 1.75);
        });
        assert_eq!(root[0].sqrt(), 1.75);
    }

    #[test]
    fn a_number_that_no_float_reaches_has_neighbours() {
        // Above 2, every product with 3 skips floats.
        let near = around(2.5, |a| {
            let product = binary(BinaryOperator::Multiply, a, 3.0);
            equals(product, 7.000_000_5);
        });
        let [low, high] = near[near.len() - 2..] else {
            panic!("{near:?}")
        };
        assert!(
            low * 3.0 < 7.000_000_5 && high * 3.0 > 7.000_000_5,
            "{near:?}"
        );
    }
}
