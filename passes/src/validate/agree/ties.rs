//! Inputs at which a comparison of either program is a tie, and their neighbours.
//!
//! `<` and `<=` differ at a tie alone, and a condition behind an equality never holds on random
//! numbers. So a few inputs are run on a tape; each comparison on it is solved for one of its inputs.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use super::draws::Point;
use super::fed::{self, Rule};
use super::trial::Two;
use crate::evaluate::Stuck;
use crate::validate::inputs::Inputs;
use crate::validate::stage::Ran;
use crate::validate::tape::{Along, Decision, Kind, Source, Tape, Taped, taped};
use crate::validate::world::{self, PassStages, TestPoint};

/// Inputs from which a comparison is solved.
const TRIES: usize = 3;

/// Comparisons behind comparisons that are solved.
const DEPTH: usize = 3;

/// Inputs of a promise, and places, that are run on a tape.
const TAPES: u64 = 48;

/// Inputs that are solved for in an expensive pair.
const FEW: u64 = 24;

/// Integers that a conversion is solved for.
const INTEGERS: usize = 8;

/// What was solved, and what is to be tried.
pub(super) struct Ties {
    /// How often each comparison was solved.
    tries: BTreeMap<u64, usize>,
    /// Inputs to try.
    queue: VecDeque<Solved>,
    /// Inputs that may still be added, and that may be run on a tape.
    left: u64,
    tapes: u64,
}

/// An input that was solved for.
pub(super) struct Solved {
    pub(super) point: Point,
    /// Comparisons that were solved for it, one behind the other.
    pub(super) depth: usize,
    /// It may lead where no other input does.
    is_tie: bool,
}

impl Ties {
    /// For at most so many inputs.
    pub(super) fn new(left: u64) -> Self {
        Self {
            tries: BTreeMap::new(),
            queue: VecDeque::new(),
            left,
            tapes: TAPES,
        }
    }

    /// Leaves at most a few more, of a pair that is expensive.
    pub(super) fn save(&mut self) {
        self.left = self.left.min(FEW);
    }

    /// The next input.
    pub(super) fn next(&mut self) -> Option<Solved> {
        self.queue.pop_front()
    }

    /// Whether the comparisons on an input are wanted.
    pub(super) fn wants(&self, solved: Option<&Solved>) -> bool {
        let leads = solved.is_none_or(|solved| solved.is_tie && solved.depth < DEPTH);
        self.left > 0 && self.tapes > 0 && leads
    }

    fn add(&mut self, (point, depth): (&Point, usize), source: Source, values: Vec<f32>) {
        // The tie is the first of three.
        let has_tie = values.len() != 2;
        for (i, value) in values.into_iter().enumerate() {
            if self.left == 0 {
                return;
            }
            self.left -= 1;
            let mut pins = (*point.pins).clone();
            pins.insert(source, value);
            let point = Point {
                seed: point.seed,
                pins: Arc::new(pins),
            };
            self.queue.push_back(Solved {
                point,
                depth: depth + 1,
                is_tie: has_tie && i == 0,
            });
        }
    }

    /// Adds the inputs near `point` that decide a comparison otherwise.
    fn solve(&mut self, tape: &Tape, decision: &Decision, at: (&Point, usize), integers: &[u32]) {
        let site = tape.site(decision);
        let tries = self.tries.entry(site).or_default();
        let count = *tries;
        // Behind another comparison, only new ones count.
        if count >= TRIES || at.1 > 0 && count > 0 {
            return;
        }
        *tries += 1;
        if decision.kind == Kind::Truncated {
            return self.truncate(tape, decision, at, integers);
        }
        let all = decision.solutions(tape);
        for i in 0..all.len() {
            let (source, start) = all[(i + count) % all.len()];
            let values = Along::new(tape, decision.sides, source).around(start);
            if !values.is_empty() {
                return self.add(at, source, values);
            }
        }
    }

    /// Adds inputs that become other integers.
    fn truncate(&mut self, tape: &Tape, decision: &Decision, at: (&Point, usize), all: &[u32]) {
        let [number, _] = decision.sides;
        for integer in all.iter().take(INTEGERS) {
            let wanted = *integer as i32 as f32;
            let middle = wanted + if wanted < 0.0 { -0.5 } else { 0.5 };
            let fits = |(source, start): &(Source, f32)| {
                let [there, _] = Along::new(tape, decision.sides, *source).at(*start);
                there.trunc() == wanted
            };
            let found = tape.inverse(number, middle).into_iter().find(fits);
            if let Some((source, start)) = found {
                self.add(at, source, vec![start]);
            }
        }
    }
}

impl Two<'_> {
    /// Runs stages on a tape.
    pub(super) fn on_tape(
        &self,
        stages: PassStages<'_>,
        inputs: &Inputs,
        rules: &[Rule],
        place: TestPoint,
    ) -> (Result<Ran<Taped>, Stuck>, Tape) {
        let steps = 4 * self.effort.steps;
        let (ran, tape) = taped(|| {
            let mut resources = world::taped_buffers(inputs);
            fed::feed(rules, &mut resources);
            world::taped(inputs, resources).run(stages, place, steps, None)
        });
        self.budget
            .spend(ran.as_ref().map_or(steps, |ran| ran.steps));
        (ran, tape)
    }

    /// Adds the inputs near those of `point` at which either program decides otherwise.
    pub(super) fn near_ties(
        &self,
        ties: &mut Ties,
        (point, depth): (&Point, usize),
        (stages, inputs, rules): ([PassStages<'_>; 2], &Inputs, &[Rule]),
        place: TestPoint,
    ) {
        ties.tapes = ties.tapes.saturating_sub(1);
        let tapes = stages.map(|stages| self.on_tape(stages, inputs, rules, place).1);
        // What decides for certain comes first.
        for kind in [Kind::Compared, Kind::Truncated, Kind::Bent] {
            for tape in &tapes {
                let own = tape.decisions.iter().filter(|d| d.kind == kind);
                for decision in own {
                    if ties.left == 0 {
                        return;
                    }
                    ties.solve(tape, decision, (point, depth), self.numbers.integers());
                }
            }
        }
    }
}
