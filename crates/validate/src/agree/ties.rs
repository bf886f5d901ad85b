//! Inputs at which a comparison of either program is a tie, and their neighbours.
//!
//! `<` and `<=` differ at a tie alone, and a condition behind an equality never holds on random
//! numbers. So a few inputs are run on a tape, and each comparison there is solved for one of its
//! inputs. An input that decides a comparison otherwise is the start of the next search. Its solved
//! values stay fixed, so conjunctions hold.

use std::cell::Cell;
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use super::draws::Point;
use super::fed::{self, Rule};
use super::solve_by_runs::{Probed, Solution};
use super::trial::Two;
use crate::environment::{self, PassStages, TestPoint};
use crate::inputs::Inputs;
use crate::stage::Ran;
use crate::tape::{Along, Decision, Kind, Plain, Source, Tape, Taped, taped};
use naga_interp::{Scalar, Stuck};

/// Inputs from which a comparison is solved.
const TRIES: usize = 3;

/// Comparisons that are solved one after the other.
const DEPTH: usize = 8;

/// Comparisons right after one that was solved, which may belong to its condition.
const NEAR: usize = 2;

/// Inputs of a promise, and places, that are run on a tape.
const TAPES: u64 = 96;

/// Runs of a promise that look for integers. They take one in [`SHARE`] of its steps at most.
const PROBES: u64 = 512;
const SHARE: u64 = 16;

/// Inputs that are solved for in an expensive pair. Twice as many are run on a tape.
const FEW: u64 = 24;

/// Integers that a conversion is solved for.
const INTEGERS: usize = 8;

/// The comparisons that were solved, and the inputs to try.
pub(super) struct Ties {
    /// How often each comparison was solved.
    tries: BTreeMap<u64, usize>,
    queue: VecDeque<Solved>,
    /// Those that were found last.
    found: Vec<Solved>,
    /// Inputs that may still be added: from random inputs, and from solved ones.
    left: [u64; 2],
    /// Inputs that may be run on a tape.
    tapes: u64,
    /// Runs that may look for integers, and their steps.
    probes: u64,
    steps: u64,
}

/// An input that was solved for.
pub(super) struct Solved {
    pub(super) point: Point,
    /// Comparisons that were solved for it, one after the other.
    pub(super) depth: usize,
    /// The last comparison that was solved for it.
    site: u64,
    /// It may lead where no other input does.
    is_lead: bool,
}

#[derive(Clone, Copy)]
enum Step<'t> {
    Decision(&'t Decision),
    /// A comparison by its index.
    Plain(usize, &'t Plain),
}

impl<'t> Step<'t> {
    /// All of a tape in the order of their making.
    fn all(tape: &'t Tape) -> Vec<Self> {
        let plain = tape.plain.iter().enumerate();
        let plain = plain.map(|(i, plain)| (plain.decisions, Self::Plain(i, plain)));
        let decisions = tape.decisions.iter().enumerate();
        let decisions = decisions.map(|(i, decision)| (i, Self::Decision(decision)));
        let mut all: Vec<_> = plain.chain(decisions).collect();
        all.sort_by_key(|(at, _)| *at);
        all.into_iter().map(|(_, step)| step).collect()
    }

    fn kind(self) -> Kind {
        match self {
            Self::Decision(decision) => decision.kind,
            Self::Plain(..) => Kind::Compared,
        }
    }

    fn site(self, tape: &Tape) -> u64 {
        match self {
            Self::Decision(decision) => tape.site(decision),
            Self::Plain(_, plain) => both(plain.site.0, plain.site.1 as u64),
        }
    }

    fn is_tie(self) -> bool {
        match self {
            Self::Decision(d) => d.sides[0].value == d.sides[1].value,
            Self::Plain(_, plain) => plain.sides[0] == plain.sides[1],
        }
    }

    /// The next comparisons after one, except for ties.
    fn near(all: &[Self], tape: &Tape, site: u64) -> Vec<u64> {
        let mut after = all.iter().skip_while(|step| step.site(tape) != site);
        after.next();
        let compared = after.filter(|s| s.kind() == Kind::Compared && !s.is_tie());
        compared.take(NEAR).map(|s| s.site(tape)).collect()
    }
}

/// A number for two in their order.
fn both(first: u64, second: u64) -> u64 {
    (first ^ second.rotate_left(32)).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ first
}

/// The value of an input with which a float becomes this integer.
pub(super) fn converted(tape: &Tape, decision: &Decision, wanted: f32) -> Option<(Source, f32)> {
    let [number, _] = decision.sides;
    let middle = wanted + if wanted < 0.0 { -0.5 } else { 0.5 };
    let fits = |(source, start): &(Source, f32)| {
        let [there, _] = Along::new(tape, decision.sides, *source).at(*start);
        there.trunc() == wanted
    };
    tape.inverse(number, middle).into_iter().find(fits)
}

impl Ties {
    /// A search for at most `left` inputs of a promise that takes at most `steps` steps.
    pub(super) fn new(left: u64, steps: u64) -> Self {
        Self {
            tries: BTreeMap::new(),
            queue: VecDeque::new(),
            found: Vec::new(),
            left: [left; 2],
            tapes: TAPES,
            probes: PROBES,
            steps: steps / SHARE,
        }
    }

    /// Leaves at most a few more, of a pair that is expensive.
    pub(super) fn save(&mut self) {
        self.left = self.left.map(|left| left.min(FEW / 2));
        self.tapes = self.tapes.min(2 * FEW);
        self.probes = 0;
    }

    pub(super) fn next(&mut self) -> Option<Solved> {
        self.queue.pop_front()
    }

    fn may_add(&self, depth: usize) -> bool {
        self.left[usize::from(depth > 0)] > 0
    }

    /// Whether the comparisons on an input are wanted.
    pub(super) fn wants(&self, solved: Option<&Solved>) -> bool {
        let depth = solved.map_or(0, |solved| solved.depth);
        let leads = solved.is_none_or(|solved| solved.is_lead && depth < DEPTH);
        self.may_add(depth) && self.tapes > 0 && leads
    }

    fn add(&mut self, (point, depth): (&Point, usize), site: u64, solutions: Vec<Solution>) {
        for (source, scalar, is_lead) in solutions {
            if !self.may_add(depth) {
                return;
            }
            self.left[usize::from(depth > 0)] -= 1;
            let mut pins = (*point.pins).clone();
            pins.insert(source, scalar);
            let point = Point {
                seed: point.seed,
                pins: Arc::new(pins),
            };
            self.found.push(Solved {
                point,
                depth: depth + 1,
                site,
                is_lead,
            });
        }
    }

    /// Queues the found inputs. Those that follow from a solved input come first, so that a long
    /// conjunction comes to its end.
    fn queue(&mut self, depth: usize) {
        let found = std::mem::take(&mut self.found);
        match depth {
            0 => self.queue.extend(found),
            _ => found
                .into_iter()
                .rev()
                .for_each(|s| self.queue.push_front(s)),
        }
    }

    /// How often a comparison was solved, if it is to be solved again. From a solved input, a
    /// comparison near the solved one counts separately for it; of the others, only new ones are
    /// solved.
    fn turn(&mut self, site: u64, depth: usize, near: Option<u64>) -> Option<usize> {
        let site = near.map_or(site, |parent| both(parent, site));
        let tries = self.tries.entry(site).or_default();
        let count = *tries;
        let most = if depth > 0 { 1 } else { TRIES };
        *tries += usize::from(count < most);
        (count < most).then_some(count)
    }
}

/// The values near which a decision has the other result. They are values of an input that nothing
/// else was solved for, if there is one.
fn solved(tape: &Tape, decision: &Decision, count: usize, point: &Point) -> Vec<Solution> {
    let mut all = decision.solutions(tape);
    let turned = count % all.len().max(1);
    all.rotate_left(turned);
    all.sort_by_key(|(source, _)| point.pins.contains_key(source));
    let mut best = Vec::new();
    for (source, start) in all {
        let along = Along::new(tape, decision.sides, source);
        let values = along.around(start);
        // The tie is the first of three.
        let has_tie = values.len() != 2;
        if values.is_empty() || !best.is_empty() && !has_tie {
            continue;
        }
        let leads = |(i, value): (usize, f32)| {
            let is_lead = match decision.kind {
                Kind::Compared => decision.flips(along.at(value)),
                Kind::Bent | Kind::Truncated => has_tie && i == 0,
            };
            (source, Scalar::F32(value), is_lead)
        };
        best = values.into_iter().enumerate().map(leads).collect();
        if has_tie || !decision.is_equality() {
            break;
        }
    }
    best
}

/// Inputs that become other integers.
fn truncated(tape: &Tape, decision: &Decision, integers: &[u32]) -> Vec<Solution> {
    let integers = integers.iter().take(INTEGERS);
    let found = integers.filter_map(|n| converted(tape, decision, *n as i32 as f32));
    found
        .map(|(source, x)| (source, Scalar::F32(x), true))
        .collect()
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
            let mut resources = environment::taped_buffers(inputs);
            fed::feed(rules, &mut resources);
            environment::taped(inputs, resources).run(stages, place, steps, None)
        });
        self.budget
            .spend(ran.as_ref().map_or(steps, |ran| ran.steps));
        (ran, tape)
    }

    /// Adds the inputs near those of `point` at which either program decides otherwise.
    pub(super) fn near_ties(
        &self,
        ties: &mut Ties,
        (point, from): (&Point, Option<&Solved>),
        (stages, inputs, rules): ([PassStages<'_>; 2], &Inputs, &[Rule]),
        place: TestPoint,
    ) {
        ties.tapes = ties.tapes.saturating_sub(1);
        let depth = from.map_or(0, |solved| solved.depth);
        let tapes = stages.map(|stages| self.on_tape(stages, inputs, rules, place).1);
        let steps = [&tapes[0], &tapes[1]].map(Step::all);
        let probes = Cell::new((ties.probes, ties.steps));
        // Comparisons decide for certain, so they come first.
        for kind in [Kind::Compared, Kind::Truncated, Kind::Bent] {
            for ((tape, steps), stages) in tapes.iter().zip(&steps).zip(stages) {
                let near = from.map(|solved| Step::near(steps, tape, solved.site));
                let near = near.unwrap_or_default();
                let run = |source: Source, scalar: Scalar| {
                    let (left, steps) = probes.get();
                    let left = left.checked_sub(1).filter(|_| steps > 0)?;
                    let mut pins = (*point.pins).clone();
                    pins.insert(source, scalar);
                    let mut inputs = inputs.clone();
                    inputs.pin(&Arc::new(pins));
                    fed::feed(rules, Arc::make_mut(&mut inputs.resources));
                    let before = self.budget.left();
                    let (_, tape) = self.on_tape(stages, &inputs, rules, place);
                    let spent = before - self.budget.left();
                    probes.set((left, steps.saturating_sub(spent)));
                    Some(tape)
                };
                for step in steps.iter().filter(|step| step.kind() == kind) {
                    if !ties.may_add(depth) {
                        break;
                    }
                    let site = step.site(tape);
                    let parent = from.filter(|_| near.contains(&site)).map(|s| s.site);
                    let Some(count) = ties.turn(site, depth, parent) else {
                        continue;
                    };
                    let solutions = match step {
                        Step::Decision(d) if kind == Kind::Truncated => {
                            truncated(tape, d, self.numbers.integers())
                        }
                        Step::Decision(decision) => solved(tape, decision, count, point),
                        Step::Plain(at, _) => Probed::new((tape, *at), &run).solutions(),
                    };
                    ties.add((point, depth), site, solutions);
                }
            }
        }
        (ties.probes, ties.steps) = probes.get();
        ties.queue(depth);
    }
}
