//! Numbers that record how they were computed: a tape (Griewank and Walther 2008, section 3.2).
//!
//! After a run on them, the tape holds each operation that depends on an input, each comparison,
//! and each lookup. An input that makes a comparison a tie is found backwards along it (`inverse`).
//! Each number also has its reference in `f64` along the same path, to distinguish a difference
//! from rounding.

use std::cell::RefCell;
use std::cmp::Ordering;

use naga::{BinaryOperator, MathFunction};

mod inverse;

pub(super) use inverse::Along;

use super::stage::Slot;
use naga_interp::{Lookup, Number, Sampling, Scalar};

/// Most operations on a tape.
const MOST: usize = 1 << 16;

/// Steps from a buffer to a scalar in it: members, elements, columns, components.
pub(super) type Steps = [u32; 8];

pub(super) const NO_STEP: u32 = u32::MAX;

/// Where a float of a draw comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Source {
    /// A scalar of a buffer, by group and binding.
    Buffer((u32, u32), Steps),
    /// A component of an attribute of a vertex.
    Attribute(Slot, usize, u32),
    /// A component of a builtin input of the fragment stage.
    Fragment(Slot, u32),
    /// A channel of a texture by group and binding, everywhere.
    Texel((u32, u32), u32),
}

/// A number, and the operation that computed it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Taped {
    pub(super) value: f32,
    /// The value in `f64`, from the same inputs and by the same decisions.
    pub(super) truth: f64,
    /// The value or the reference was rounded on the way.
    pub(super) is_rounded: bool,
    /// Its index on the tape; [`CONSTANT`] if it depends on no input.
    at: u32,
}

const CONSTANT: u32 = u32::MAX;

/// How a number was computed.
#[derive(Clone, Copy, Debug)]
enum Computation {
    Input(Source),
    Negated(Taped),
    Binary(BinaryOperator, Taped, Taped),
    Call(MathFunction, [Taped; 3], usize),
}

#[derive(Clone, Copy, Debug)]
struct Node {
    made: Computation,
    value: f32,
    /// Hash of the operations and sources, without the numbers of inputs.
    hash: u64,
}

/// The kind of a decision.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Kind {
    /// A comparison of two numbers.
    Compared,
    /// A function with a bend or a jump there: `min`, `step`, `clamp`.
    Bent,
    /// A conversion to an integer.
    Truncated,
}

/// Two numbers that were compared.
#[derive(Clone, Copy, Debug)]
pub struct Decision {
    pub(super) kind: Kind,
    pub(super) sides: [Taped; 2],
    /// Whether the first was less, equal or greater; `None` for NaN.
    pub(super) order: Option<Ordering>,
    /// The operator of a comparison.
    op: Option<BinaryOperator>,
}

/// Two scalars that were compared, and that the tape knows by their values alone: integers, and floats
/// made of them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plain {
    /// The comparison, and which component or case.
    pub(super) site: (u64, usize),
    pub(super) op: BinaryOperator,
    pub(super) sides: [f64; 2],
    /// The integers that were read before.
    pub(super) reads: usize,
    /// The decisions that were made before.
    pub(super) decisions: usize,
}

impl Plain {
    pub(super) fn is_equality(&self) -> bool {
        matches!(self.op, BinaryOperator::Equal | BinaryOperator::NotEqual)
    }

    /// The result of the comparison with these sides.
    pub(super) fn holds(&self, [a, b]: [f64; 2]) -> bool {
        f64::holds(self.op, a, b).unwrap_or_default()
    }
}

/// A texture access, as numbers.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct TextureAccess {
    pub(super) binding: Option<(u32, u32)>,
    pub(super) sampling: Sampling,
    pub(super) coordinates: Vec<u32>,
    pub(super) footprint: Vec<u32>,
}

impl TextureAccess {
    /// Whether a program that has one list of accesses samples a place at another level than one that
    /// has the other.
    pub(super) fn differ_in_level(ours: &[Self], theirs: &[Self]) -> bool {
        let place = |seen: &Self| {
            let mut place = seen.coordinates.clone();
            if let Some(level) = seen.sampling.level.filter(|level| *level < place.len()) {
                place.remove(level);
            }
            (seen.binding, seen.sampling.axes, place)
        };
        let own = ours.iter().filter(|seen| !theirs.contains(seen));
        let other: Vec<_> = theirs.iter().filter(|seen| !ours.contains(seen)).collect();
        let mut own = own.map(place);
        own.any(|place_of_ours| other.iter().any(|seen| place(seen) == place_of_ours))
    }
}

/// The record of a run.
#[derive(Default)]
pub(super) struct Tape {
    nodes: Vec<Node>,
    pub(super) decisions: Vec<Decision>,
    pub(super) plain: Vec<Plain>,
    /// The integers of inputs that were read.
    pub(super) reads: Vec<(Source, Scalar)>,
    pub(super) lookups: Vec<TextureAccess>,
}

thread_local! {
    static TAPE: RefCell<Tape> = RefCell::default();
}

/// Runs something on a fresh tape.
pub(super) fn taped<T>(run: impl FnOnce() -> T) -> (T, Tape) {
    TAPE.take();
    let result = run();
    (result, TAPE.take())
}

fn mixed(hash: u64, more: u64) -> u64 {
    let mut z = (hash ^ more).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z ^= z >> 32;
    z.wrapping_mul(0x94d0_49bb_1331_11eb) ^ (z >> 29)
}

/// A hash that is the same in each run and build.
fn hashed(value: &impl std::hash::Hash) -> u64 {
    struct Fold(u64);
    impl std::hash::Hasher for Fold {
        fn finish(&self) -> u64 {
            self.0
        }
        fn write(&mut self, bytes: &[u8]) {
            self.0 = bytes.iter().fold(self.0, |h, b| mixed(h, u64::from(*b)));
        }
    }
    let mut fold = Fold(0);
    value.hash(&mut fold);
    fold.0
}

impl Tape {
    fn push(&mut self, made: Computation, value: f32, hash: u64) -> u32 {
        if self.nodes.len() >= MOST {
            return CONSTANT;
        }
        self.nodes.push(Node { made, value, hash });
        (self.nodes.len() - 1) as u32
    }

    fn hash(&self, number: Taped) -> u64 {
        match self.nodes.get(number.at as usize) {
            Some(node) => node.hash,
            None => mixed(1, u64::from(number.value.to_bits())),
        }
    }

    /// A hash of the compared operations, independent of the numbers of inputs.
    pub(super) fn site(&self, decision: &Decision) -> u64 {
        let [a, b] = decision.sides.map(|side| self.hash(side));
        mixed(mixed(a.max(b), a.min(b)), decision.kind as u64)
    }
}

impl Taped {
    pub(super) fn input(source: Source, value: f32) -> Self {
        // All corners are alike.
        let of = match source {
            Source::Attribute(slot, _, component) => Source::Attribute(slot, 0, component),
            other => other,
        };
        let at = TAPE.with_borrow_mut(|tape| {
            tape.push(Computation::Input(source), value, mixed(2, hashed(&of)))
        });
        Self {
            at,
            ..Self::of(value)
        }
    }

    /// Notes that an integer of an input was read.
    pub(super) fn read_integer(source: Source, value: Scalar) {
        if matches!(value, Scalar::I32(_) | Scalar::U32(_)) {
            TAPE.with_borrow_mut(|tape| {
                if tape.reads.len() < MOST {
                    tape.reads.push((source, value));
                }
            });
        }
    }

    /// Records a texture access.
    pub(super) fn looked_up(lookup: &Lookup<'_, Self>) {
        let bits = |all: &[Self]| all.iter().map(|x| x.value.to_bits()).collect();
        let seen = TextureAccess {
            binding: lookup.binding,
            sampling: lookup.sampling,
            coordinates: bits(lookup.coordinates),
            footprint: bits(lookup.footprint),
        };
        TAPE.with_borrow_mut(|tape| tape.lookups.push(seen));
    }

    fn is_constant(self) -> bool {
        self.at == CONSTANT
    }

    fn made(
        made: Computation,
        operands: &[Self],
        value: f32,
        (truth, is_rounded): (f64, bool),
    ) -> Self {
        let at = match operands.iter().all(|o| o.is_constant()) {
            true => CONSTANT,
            false => TAPE.with_borrow_mut(|tape| {
                let kind = match made {
                    Computation::Input(_) => 3,
                    Computation::Negated(_) => 4,
                    Computation::Binary(op, ..) => 16 + op as u64,
                    Computation::Call(function, ..) => 64 + function as u64,
                };
                let hashes = operands.iter().map(|o| tape.hash(*o));
                let hash = hashes.fold(kind, mixed);
                tape.push(made, value, hash)
            }),
        };
        let is_rounded = is_rounded || operands.iter().any(|o| o.is_rounded);
        Self {
            value,
            truth,
            is_rounded,
            at,
        }
    }

    fn decided(kind: Kind, op: Option<BinaryOperator>, sides: [Self; 2]) {
        if sides.iter().all(|side| side.is_constant()) {
            return;
        }
        let order = sides[0].value.partial_cmp(&sides[1].value);
        let decision = Decision {
            kind,
            sides,
            order,
            op,
        };
        TAPE.with_borrow_mut(|tape| {
            if tape.decisions.len() < MOST {
                tape.decisions.push(decision);
            }
        });
    }
}

impl Decision {
    /// Whether its comparison has the other result with these sides.
    pub(super) fn flips(&self, [a, b]: [f32; 2]) -> bool {
        let own = self.sides.map(|side| side.value);
        let holds = |[a, b]: [f32; 2]| self.op.and_then(|op| f32::holds(op, a, b));
        holds([a, b]) != holds(own)
    }

    pub(super) fn is_equality(&self) -> bool {
        matches!(
            self.op,
            Some(BinaryOperator::Equal | BinaryOperator::NotEqual)
        )
    }

    /// Whether another program made it with the same numbers.
    pub(super) fn is_shared(&self, others: &[Self]) -> bool {
        let numbers = |decision: &Self| {
            let bits = decision.sides.map(|side| side.value.to_bits());
            [bits[0].min(bits[1]), bits[0].max(bits[1])]
        };
        let own = numbers(self);
        others.iter().any(|other| numbers(other) == own)
    }

    /// Whether another program compared the same numbers likewise, and came to another end.
    pub(super) fn is_opposed(&self, others: &[Self]) -> bool {
        use BinaryOperator as B;
        let (Some(op), Kind::Compared) = (self.op, self.kind) else {
            return false;
        };
        let is_equality = |op: B| matches!(op, B::Equal | B::NotEqual);
        let bits = |d: &Self| d.sides.map(|side| side.value.to_bits());
        let (own, is_tie) = (bits(self), self.order == Some(Ordering::Equal));
        let mirrored = |op: B| match op {
            B::Less => B::Greater,
            B::LessEqual => B::GreaterEqual,
            B::Greater => B::Less,
            B::GreaterEqual => B::LessEqual,
            other => other,
        };
        // `a < b` and `b >= a` make the same comparison with opposite results.
        let is_upward = |op: B| matches!(op, B::Greater | B::GreaterEqual);
        let reaches = |op: B| matches!(op, B::LessEqual | B::GreaterEqual);
        others.iter().any(|other| {
            let Some(theirs) = other.op.filter(|o| is_equality(*o) == is_equality(op)) else {
                return false;
            };
            let theirs = match bits(other) {
                b if b == own => theirs,
                [b, a] if [a, b] == own => mirrored(theirs),
                _ => return false,
            };
            // At a tie, `<` and `>=` draw one line, and so do `<=` and `>`.
            let line = |op: B| is_upward(op) == reaches(op);
            is_tie && !is_equality(op) && line(theirs) != line(op)
        })
    }

    /// Whether rounding decided it: the references are in another order, or equal by rounding alone.
    pub(super) fn is_of_rounding(&self) -> bool {
        let [a, b] = self.sides;
        let truth = a.truth.partial_cmp(&b.truth);
        (a.is_rounded || b.is_rounded) && (truth != self.order || truth == Some(Ordering::Equal))
    }

    /// Whether its references are equal by rounding alone.
    pub(super) fn is_of_rounded_truths(&self) -> bool {
        let [a, b] = self.sides;
        self.is_of_rounding() && a.truth == b.truth
    }
}

/// Whether `f32` or `f64` rounded a sum or product of numbers that themselves are not rounded.
fn is_rounded(op: BinaryOperator, [a, b]: [f64; 2], value: f32, truth: f64) -> bool {
    use BinaryOperator as B;
    let is_inexact = match op {
        B::Add | B::Subtract => {
            let b = if op == B::Add { b } else { -b };
            // The error of the sum (Knuth 1969).
            let part = truth - a;
            (a - (truth - part)) + (b - part) != 0.0
        }
        B::Multiply => a.mul_add(b, -truth) != 0.0,
        B::Divide => truth.mul_add(b, -a) != 0.0,
        _ => false,
    };
    is_inexact || f64::from(value) != truth
}

impl Number for Taped {
    const NOTES: bool = true;

    fn compared(site: (u64, usize), op: BinaryOperator, sides: [Scalar<Self>; 2]) {
        use Scalar::{F32, I32, U32};
        let sides = match sides {
            [I32(a), I32(b)] => [a, b].map(f64::from),
            [U32(a), U32(b)] => [a, b].map(f64::from),
            [F32(a), F32(b)] if a.is_constant() && b.is_constant() => {
                [a.value, b.value].map(f64::from)
            }
            _ => return,
        };
        TAPE.with_borrow_mut(|tape| {
            if tape.plain.len() < MOST {
                tape.plain.push(Plain {
                    site,
                    op,
                    sides,
                    reads: tape.reads.len(),
                    decisions: tape.decisions.len(),
                });
            }
        });
    }

    fn read(at: (u32, u32), way: &[usize], scalar: Scalar<Self>) {
        let value = match scalar {
            Scalar::I32(n) => Scalar::I32(n),
            Scalar::U32(n) => Scalar::U32(n),
            _ => return,
        };
        let mut steps = [NO_STEP; 8];
        if way.len() <= steps.len() {
            steps
                .iter_mut()
                .zip(way)
                .for_each(|(to, step)| *to = *step as u32);
            Self::read_integer(Source::Buffer(at, steps), value);
        }
    }

    fn of(number: f32) -> Self {
        Self {
            value: number,
            truth: f64::from(number),
            is_rounded: false,
            at: CONSTANT,
        }
    }

    fn is_same(self, other: Self) -> bool {
        self.value.is_same(other.value)
    }

    fn negated(self) -> Self {
        let truth = (-self.truth, false);
        Self::made(Computation::Negated(self), &[self], -self.value, truth)
    }

    fn binary(op: BinaryOperator, a: Self, b: Self) -> Option<Self> {
        let value = f32::binary(op, a.value, b.value)?;
        let mut truth = f64::binary(op, a.truth, b.truth)?;
        if op == BinaryOperator::Modulo {
            // The quotient's whole part is decided.
            let turns = (f64::from(a.value) / f64::from(b.value)).trunc();
            truth = a.truth - turns * b.truth;
        }
        let rounded = is_rounded(op, [a.truth, b.truth], value, truth);
        Some(Self::made(
            Computation::Binary(op, a, b),
            &[a, b],
            value,
            (truth, rounded),
        ))
    }

    fn compare(self, other: Self) -> Option<Option<Ordering>> {
        Some(self.value.partial_cmp(&other.value))
    }

    fn holds(op: BinaryOperator, a: Self, b: Self) -> Option<bool> {
        let holds = f32::holds(op, a.value, b.value)?;
        Self::decided(Kind::Compared, Some(op), [a, b]);
        Some(holds)
    }

    fn call(function: MathFunction, arguments: &[Self]) -> Option<Self> {
        use MathFunction as M;
        let values: Vec<f32> = arguments.iter().map(|a| a.value).collect();
        let truths: Vec<f64> = arguments.iter().map(|a| a.truth).collect();
        let value = f32::call(function, &values)?;
        let bend = |a: Self, b: Self| Self::decided(Kind::Bent, None, [a, b]);
        let whole = |x: Self| bend(x, Self::of(x.value.round()));
        match (function, arguments) {
            (M::Min | M::Max | M::Step, [a, b]) => bend(*a, *b),
            (M::Clamp, [x, low, high]) | (M::SmoothStep, [low, high, x]) => {
                bend(*x, *low);
                bend(*x, *high);
            }
            (M::Saturate, [x]) => {
                bend(*x, Self::of(0.0));
                bend(*x, Self::of(1.0));
            }
            (M::Sign | M::Abs, [x]) => bend(*x, Self::of(0.0)),
            (M::Floor | M::Ceil | M::Trunc | M::Fract, [x]) => whole(*x),
            (M::Round, [x]) => bend(*x, Self::of(x.value.floor() + 0.5)),
            _ => {}
        }
        let truth = match function {
            // A jump is decided.
            M::Step | M::Sign | M::Floor | M::Ceil | M::Trunc | M::Round => f64::from(value),
            M::Fract => truths[0] - f64::from(values[0].floor()),
            _ => f64::call(function, &truths)?,
        };
        let is_exact = match function {
            M::Step | M::Sign | M::Abs | M::Min | M::Max | M::Clamp | M::Saturate => true,
            // Beyond its edges.
            M::SmoothStep => truth == 0.0 || truth == 1.0,
            M::Sqrt => truth.mul_add(truth, -truths[0]) == 0.0 && truth == f64::from(value),
            _ => false,
        };
        let mut kept = [Self::of(0.0); 3];
        for (to, from) in kept.iter_mut().zip(arguments) {
            *to = *from;
        }
        let made = Computation::Call(function, kept, arguments.len().min(3));
        Some(Self::made(made, arguments, value, (truth, !is_exact)))
    }

    fn within(self, _: f32, _: f32) -> Self {
        self
    }

    fn single(self) -> Option<f32> {
        Some(self.value)
    }

    fn truncated(self) -> Option<f64> {
        let whole = self.value.trunc();
        Self::decided(Kind::Truncated, None, [self, Self::of(whole)]);
        Some(f64::from(whole))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_is_told_from_ties() {
        let ((), tape) = taped(|| {
            let a = Taped::input(Source::Texel((0, 0), 0), 1e-9);
            let sum = Taped::binary(BinaryOperator::Add, a, Taped::of(1.0)).unwrap_or(a);
            Taped::holds(BinaryOperator::Equal, sum, Taped::of(1.0));
            Taped::holds(BinaryOperator::Equal, a, Taped::of(1e-9));
        });
        let told = tape.decisions.iter().map(Decision::is_of_rounding);
        assert_eq!(told.collect::<Vec<_>>(), [true, false]);
    }
}
