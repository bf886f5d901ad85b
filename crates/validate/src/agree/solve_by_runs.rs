//! Solves a comparison that the tape knows by its values alone, of integers most of all, for one of the
//! integers that were read before it. Programs mask, shift and divide integers, so the search runs the
//! program with other values of one and looks at both sides.

use std::cell::Cell;

use super::ties;
use crate::tape::{Decision, Kind, Plain, Source, Tape};
use naga_interp::Scalar;

/// The last integers read that are tried as unknowns.
const LEAVES: usize = 8;

/// Rounds of the secant method.
const ROUNDS: usize = 6;

/// A value of an input to try, and whether it decides the comparison otherwise.
pub(super) type Solution = (Source, Scalar, bool);

/// The search for one comparison.
pub(super) struct Probed<'r> {
    tape: &'r Tape,
    /// Index of the comparison.
    at: usize,
    run: &'r dyn Fn(Source, Scalar) -> Option<Tape>,
    /// The nearest value so far that decides otherwise, and the distance of the sides there.
    nearest: Cell<Option<(Leaf, i64, f64)>>,
}

/// An integer to solve for: one of an input, or one that a float was converted to.
#[derive(Clone, Copy)]
enum Leaf {
    Read(Source, Scalar),
    Converted(Decision),
}

impl Leaf {
    fn now(self) -> i64 {
        match self {
            Self::Read(_, Scalar::I32(n)) => n.into(),
            Self::Read(_, Scalar::U32(n)) => n.into(),
            Self::Read(..) => 0,
            Self::Converted(decision) => decision.sides[1].value as i64,
        }
    }

    /// The input that makes it another integer.
    fn with(self, tape: &Tape, integer: i64) -> Option<(Source, Scalar)> {
        match self {
            Self::Read(source, Scalar::I32(_)) => Some((source, Scalar::I32(integer as i32))),
            Self::Read(source, _) => Some((source, Scalar::U32(integer as u32))),
            Self::Converted(decision) => {
                let (source, start) = ties::converted(tape, &decision, integer as f32)?;
                Some((source, Scalar::F32(start)))
            }
        }
    }
}

impl<'r> Probed<'r> {
    /// A search for a comparison on a tape. `run` returns the tape with another value of an input,
    /// or `None` if no runs are left.
    pub(super) fn new(
        (tape, at): (&'r Tape, usize),
        run: &'r dyn Fn(Source, Scalar) -> Option<Tape>,
    ) -> Self {
        Self {
            tape,
            at,
            run,
            nearest: Cell::default(),
        }
    }

    fn own(&self) -> &Plain {
        &self.tape.plain[self.at]
    }

    /// The integers that it may depend on, the last ones first.
    fn leaves(&self) -> Vec<Leaf> {
        let mut known = Vec::new();
        let mut is_new = |source: Source| {
            let is_new = !known.contains(&source);
            known.push(source);
            is_new
        };
        let read = self.tape.reads[..self.own().reads].iter().rev();
        let read = read.filter(|(source, _)| is_new(*source));
        let read = read.map(|(source, value)| Leaf::Read(*source, *value));
        let mut leaves: Vec<Leaf> = read.take(LEAVES).collect();
        let made = self.tape.decisions[..self.own().decisions].iter().rev();
        let made = made.filter(|d| d.kind == Kind::Truncated);
        leaves.extend(made.take(LEAVES).map(|d| Leaf::Converted(*d)));
        leaves
    }

    /// The sides if a leaf is another integer, and all earlier comparisons have the same results.
    fn sides(&self, leaf: Leaf, integer: i64) -> Option<[f64; 2]> {
        let (source, scalar) = leaf.with(self.tape, integer)?;
        let tape = (self.run)(source, scalar)?;
        let own = self.own();
        let new = tape.plain.get(self.at).filter(|p| p.site == own.site)?;
        let mut before = self.tape.plain[..self.at].iter().zip(&tape.plain);
        // One selector has one of the cases.
        let stays = before.all(|(a, b)| {
            a.site == b.site && (a.site.0 == own.site.0 || a.holds(a.sides) == b.holds(b.sides))
        });
        if !stays {
            return None;
        }
        let apart = (new.sides[0] - new.sides[1]).abs();
        let is_nearer = self.nearest.get().is_none_or(|(_, _, least)| apart < least);
        if own.holds(new.sides) != own.holds(own.sides) && is_nearer {
            self.nearest.set(Some((leaf, integer, apart)));
        }
        Some(new.sides)
    }

    /// Solves by the secant method: at once for sums and masks, and for a product that is a
    /// multiple.
    fn secant(&self, leaf: Leaf) -> Steps {
        let [a, b] = self.own().sides;
        let (mut last, mut gap) = (leaf.now(), a - b);
        let mut slope = 1.0;
        for round in 0..ROUNDS {
            let step = (gap / slope).round();
            if !step.is_finite() || step == 0.0 || step.abs() > 1e10 {
                return Steps::Failed;
            }
            let next = last - step as i64;
            let Some([a, b]) = self.sides(leaf, next) else {
                return Steps::Failed;
            };
            let moved = (a - b) - gap;
            if a == b {
                return Steps::Solved(next);
            } else if moved == 0.0 && round == 0 {
                return Steps::Still;
            }
            slope = moved / (next - last) as f64;
            (last, gap) = (next, a - b);
        }
        Steps::Failed
    }

    /// Solves a sum with one term for each bit, such as masks, shifts, fields and inverted bits:
    /// from the least sum on, it adds the largest terms that fit.
    fn by_bits(&self, leaf: Leaf) -> Option<i64> {
        let own = self.own().sides;
        let mut least = (own[0] - own[1], leaf.now());
        let mut terms = Vec::new();
        for bit in (0..32).map(|bit| 1 << bit) {
            let Some([a, b]) = self.sides(leaf, leaf.now() ^ bit) else {
                continue;
            };
            let more = (a - b) - (own[0] - own[1]);
            if more < 0.0 {
                least = (least.0 + more, least.1 ^ bit);
            }
            terms.push((more.abs(), bit));
        }
        terms.sort_by(|(a, _), (b, _)| b.total_cmp(a));
        let (mut gap, mut integer) = least;
        for (term, bit) in terms {
            if term > 0.0 && gap + term <= 0.0 {
                (gap, integer) = (gap + term, integer ^ bit);
            }
        }
        let [a, b] = self.sides(leaf, integer)?;
        (a == b).then_some(integer)
    }

    /// A leaf, and an integer at which the sides are equal.
    fn tie(&self) -> Option<(Leaf, i64)> {
        let mut moving = Vec::new();
        for leaf in self.leaves() {
            match self.secant(leaf) {
                Steps::Solved(integer) => return Some((leaf, integer)),
                Steps::Failed => moving.push(leaf),
                // The secant's first step may change bits that are masked out.
                Steps::Still if self.moves(leaf) => moving.push(leaf),
                Steps::Still => {}
            }
        }
        let is_read = |leaf: &&Leaf| matches!(leaf, Leaf::Read(..));
        let mut read = moving.iter().filter(is_read);
        read.find_map(|leaf| Some((*leaf, self.by_bits(*leaf)?)))
    }

    /// Whether the sides change if all of a leaf's bits do, or that is unknown.
    fn moves(&self, leaf: Leaf) -> bool {
        self.sides(leaf, !leaf.now()) != Some(self.own().sides)
    }

    /// Values of an input near which the comparison has the other result.
    pub(super) fn solutions(&self) -> Vec<Solution> {
        let own = self.own();
        let [a, b] = own.sides;
        if a == b || !(a - b).is_finite() {
            return Vec::new();
        }
        let tie = self.tie();
        let is_flipped = |sides: [f64; 2]| own.holds(sides) != own.holds(own.sides);
        let with = |leaf: Leaf, integer: i64, is_lead: bool| {
            let (source, scalar) = leaf.with(self.tape, integer)?;
            Some((source, scalar, is_lead))
        };
        let Some((leaf, integer)) = tie else {
            let nearest = self.nearest.get();
            let nearest = nearest.and_then(|(leaf, integer, _)| with(leaf, integer, true));
            return nearest.into_iter().collect();
        };
        let mut found = Vec::from_iter(with(leaf, integer, is_flipped([a, a])));
        if !own.is_equality() {
            for next in [integer - 1, integer + 1] {
                let is_lead = self.sides(leaf, next).is_some_and(is_flipped);
                found.extend(with(leaf, next, is_lead));
            }
        }
        found
    }
}

/// How the secant method ended.
enum Steps {
    Solved(i64),
    /// Its first step changes no side.
    Still,
    Failed,
}
