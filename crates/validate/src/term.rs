//! Terms, which represent every number. They are hash-consed, so two terms are equal only if they
//! apply the same operations to the same inputs (value numbering; Cocke 1969, Click 1995, and for
//! translation validation Necula 2000).
//!
//! The interpreter runs on them as on any other [`Number`]. If a branch depends on a comparison of
//! terms, [`proved`] runs once for each combination of outcomes. Dependent comparisons yield
//! impossible combinations too; these cost runs, but equality in them is only a stronger result.
//!
//! We assume of an operation only that equal operands give equal results: a sum is not commutative,
//! and `x - x` is not 0. Equal terms are therefore equal bits on any adapter that computes an
//! operation consistently, even for NaN and infinite inputs.

use std::cell::RefCell;
use std::cmp::Ordering;
use std::collections::HashMap;

use naga::{BinaryOperator, MathFunction};

use naga_interp::{Number, Stuck};

/// A float, as the term that computes it. It is valid within its [`proved`] call and thread.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Symbolic(u32);

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
enum TermNode {
    /// Bits of an `f32`.
    Constant(u32),
    Input(String),
    Negated(Symbolic),
    Binary(BinaryOperator, Symbolic, Symbolic),
    Call(MathFunction, Vec<Symbolic>),
    /// A function of terms that the environment provides: a texel, a derivative, an interpolated
    /// number.
    Given(String, Vec<Symbolic>),
}

/// A comparison that a branch may use.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Question {
    Equal(Symbolic, Symbolic),
    Less(Symbolic, Symbolic),
    LessEqual(Symbolic, Symbolic),
}

#[derive(Default)]
struct Arena {
    nodes: Vec<TermNode>,
    terms: HashMap<TermNode, Symbolic>,
    answers: HashMap<Question, bool>,
    /// The outcomes of this run in order: prescribed ones, then `false`.
    path: Vec<bool>,
    asked: usize,
}

/// Most terms of a run.
const MOST_TERMS: usize = 400_000;

thread_local! {
    static ARENA: RefCell<Arena> = RefCell::default();
}

impl Arena {
    fn term(&mut self, node: TermNode) -> Symbolic {
        if let Some(known) = self.terms.get(&node) {
            return *known;
        }
        let term = Symbolic(self.nodes.len() as u32);
        self.nodes.push(node.clone());
        self.terms.insert(node, term);
        term
    }

    fn constant(&self, term: Symbolic) -> Option<f32> {
        match self.nodes.get(term.0 as usize)? {
            TermNode::Constant(bits) => Some(f32::from_bits(*bits)),
            _ => None,
        }
    }

    fn answer(&mut self, question: Question) -> bool {
        if let Some(known) = self.answers.get(&question) {
            return *known;
        }
        if self.asked == self.path.len() {
            self.path.push(false);
        }
        let answer = self.path[self.asked];
        self.asked += 1;
        self.answers.insert(question, answer);
        answer
    }

    /// Advances to the next combination of outcomes; `false` after the last.
    fn next(&mut self) -> bool {
        self.answers.clear();
        self.asked = 0;
        while let Some(last) = self.path.pop() {
            if !last {
                self.path.push(true);
                return true;
            }
        }
        false
    }
}

/// Runs `same` for each combination of outcomes that comparisons of terms may have, and returns
/// their number. `None` if a run finds a difference, an evaluation depends on something that terms
/// don't express, or there are more than `most` combinations.
pub(crate) fn proved(most: u64, mut same: impl FnMut() -> Result<bool, Stuck>) -> Option<u64> {
    ARENA.with_borrow_mut(|arena| *arena = Arena::default());
    let mut paths = 0;
    loop {
        paths += 1;
        let fits = ARENA.with_borrow(|arena| arena.nodes.len() <= MOST_TERMS);
        if paths > most || !fits || !same().unwrap_or(false) {
            return None;
        }
        if !ARENA.with_borrow_mut(Arena::next) {
            return Some(paths);
        }
    }
}

impl Symbolic {
    pub fn input(name: &str) -> Self {
        ARENA.with_borrow_mut(|arena| arena.term(TermNode::Input(name.to_owned())))
    }

    /// A function of terms that the environment provides, by name.
    pub fn given(name: &str, of: &[Self]) -> Self {
        ARENA.with_borrow_mut(|arena| arena.term(TermNode::Given(name.to_owned(), of.to_vec())))
    }

    /// A node; folded to a number if all `operands` are numbers and every adapter has the same
    /// result, so that float counters count.
    fn folded(
        operands: &[Self],
        node: impl FnOnce() -> TermNode,
        fold: impl FnOnce(&[f32]) -> Option<f32>,
    ) -> Option<Self> {
        ARENA.with_borrow_mut(|arena| {
            if arena.nodes.len() > MOST_TERMS {
                return None;
            }
            let constants: Option<Vec<f32>> = operands.iter().map(|t| arena.constant(*t)).collect();
            let node = match constants.filter(|c| !c.is_empty()) {
                Some(constants) => match fold(&constants) {
                    Some(number) if is_settled(&constants, number) => {
                        TermNode::Constant(number.to_bits())
                    }
                    _ => node(),
                },
                None => node(),
            };
            Some(arena.term(node))
        })
    }
}

/// Whether every adapter computes this result: subnormals may be flushed on input and output, and
/// an overflow need not be infinite.
fn is_settled(operands: &[f32], result: f32) -> bool {
    let is_plain = |x: &f32| x.is_normal() || *x == 0.0;
    operands.iter().chain([&result]).all(is_plain)
}

impl Number for Symbolic {
    fn of(number: f32) -> Self {
        ARENA.with_borrow_mut(|arena| arena.term(TermNode::Constant(number.to_bits())))
    }

    fn is_same(self, other: Self) -> bool {
        self == other
    }

    fn negated(self) -> Self {
        ARENA.with_borrow_mut(|arena| {
            let node = match arena.constant(self) {
                Some(number) => TermNode::Constant((-number).to_bits()),
                None => TermNode::Negated(self),
            };
            arena.term(node)
        })
    }

    fn binary(op: BinaryOperator, a: Self, b: Self) -> Option<Self> {
        use BinaryOperator as B;
        let node = || TermNode::Binary(op, a, b);
        match op {
            B::Add | B::Subtract => Self::folded(&[a, b], node, |n| f32::binary(op, n[0], n[1])),
            B::Multiply => Self::folded(&[a, b], node, |n| {
                // A 0 may have been subnormal before rounding.
                let product = n[0] * n[1];
                (product != 0.0 || n.contains(&0.0)).then_some(product)
            }),
            B::Divide | B::Modulo => Self::folded(&[], node, |_| None),
            _ => None,
        }
    }

    /// Orders constants only. [`Number::holds`] decides more.
    fn compare(self, other: Self) -> Option<Option<Ordering>> {
        ARENA.with_borrow(|arena| {
            let (a, b) = (arena.constant(self)?, arena.constant(other)?);
            Some(a.partial_cmp(&b))
        })
    }

    fn holds(op: BinaryOperator, a: Self, b: Self) -> Option<bool> {
        use BinaryOperator as B;
        ARENA.with_borrow_mut(|arena| {
            if let (Some(a), Some(b)) = (arena.constant(a), arena.constant(b)) {
                return f32::holds(op, a, b);
            }
            // Equality is symmetric.
            let (first, second) = if a.0 <= b.0 { (a, b) } else { (b, a) };
            Some(match op {
                B::Equal => arena.answer(Question::Equal(first, second)),
                B::NotEqual => !arena.answer(Question::Equal(first, second)),
                B::Less => arena.answer(Question::Less(a, b)),
                B::Greater => arena.answer(Question::Less(b, a)),
                B::LessEqual => arena.answer(Question::LessEqual(a, b)),
                B::GreaterEqual => arena.answer(Question::LessEqual(b, a)),
                _ => return None,
            })
        })
    }

    fn call(function: MathFunction, arguments: &[Self]) -> Option<Self> {
        use MathFunction as M;
        let node = || TermNode::Call(function, arguments.to_vec());
        match function {
            // Each adapter has the same result for these.
            M::Abs
            | M::Sign
            | M::Min
            | M::Max
            | M::Clamp
            | M::Saturate
            | M::Floor
            | M::Ceil
            | M::Trunc
            | M::Round => Self::folded(arguments, node, |n| f32::call(function, n)),
            _ => Self::folded(&[], node, |_| None),
        }
    }

    fn within(self, _: f32, _: f32) -> Self {
        self
    }

    fn single(self) -> Option<f32> {
        ARENA.with_borrow(|arena| arena.constant(self))
    }

    fn truncated(self) -> Option<f64> {
        self.single().map(|x| f64::from(x.trunc()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sum(a: Symbolic, b: Symbolic) -> Symbolic {
        Symbolic::binary(BinaryOperator::Add, a, b).unwrap_or(a)
    }

    #[test]
    fn the_same_operations_on_the_same_inputs_are_one_term() {
        let paths = proved(8, || {
            let (a, b) = (Symbolic::input("a"), Symbolic::input("b"));
            Ok(sum(a, b) == sum(a, b))
        });
        assert_eq!(paths, Some(1));
        let paths = proved(8, || {
            let (a, b) = (Symbolic::input("a"), Symbolic::input("b"));
            Ok(sum(a, b) == sum(b, a))
        });
        assert_eq!(paths, None);
    }

    #[test]
    fn comparisons_are_answered_both_ways_and_the_same_way_twice() {
        let less = |a, b| Symbolic::holds(BinaryOperator::Less, a, b).unwrap_or_default();
        let mut seen = Vec::new();
        let paths = proved(8, || {
            let (a, b) = (Symbolic::input("a"), Symbolic::input("b"));
            let answers = [less(a, b), less(b, a), less(a, b)];
            seen.push(answers);
            Ok(answers[0] == answers[2])
        });
        assert_eq!(paths, Some(4));
        seen.sort_unstable();
        seen.dedup();
        assert_eq!(seen.len(), 4);
        // One differing combination is enough.
        let other = proved(8, || {
            let (a, b) = (Symbolic::input("a"), Symbolic::input("b"));
            Ok(!(less(a, b) && less(b, a)))
        });
        assert_eq!(other, None);
        // And so are too many combinations.
        let many = proved(8, || {
            let all = (0..9).map(|i| less(Symbolic::input("a"), Symbolic::input(&i.to_string())));
            Ok(all.fold(true, |all, _| all))
        });
        assert_eq!(many, None);
    }

    #[test]
    fn constants_count() {
        let paths = proved(1, || {
            let mut turns = 0;
            let mut x = Symbolic::of(0.0);
            while Symbolic::holds(BinaryOperator::Less, x, Symbolic::of(3.0)).unwrap_or_default() {
                x = sum(x, Symbolic::of(1.0));
                turns += 1;
            }
            Ok(turns == 3 && x.single() == Some(3.0))
        });
        assert_eq!(paths, Some(1));
    }
}
