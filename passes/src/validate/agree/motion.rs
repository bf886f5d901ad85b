//! Whether a velocity follows what moves.
//!
//! Between two frames, the main pass itself says how far a point moves: its position is evaluated
//! with the values of both. A velocity may be scaled, flipped, clamped or encoded. But if a point
//! moves further along an axis, its velocity must not fall there, or it must not rise.

use std::collections::BTreeSet;
use std::sync::Arc;

use super::budget::Draw;
use super::fed::{self, Rule, part, part_mut};
use super::quote::digits;
use super::trial::Two;
use super::words::Sliced;
use super::{Class, Finding, Outcome, reads};
use crate::core::mapping;
use crate::evaluate::Value;
use crate::validate::inputs::Inputs;
use crate::validate::levels::Reading;
use crate::validate::stage::{POSITION, Slot};
use crate::validate::world::TestPoint;

/// Frames that are compared.
const FRAMES: u64 = 64;

/// Every sixth seed has ordinary numbers.
const ORDINARY: u64 = 6;

/// What makes a difference of velocities, and of motions, in shares of their largest difference.
const NOTABLE: f32 = 1e-3;

/// Names of what differs between frames by itself.
const TIME: [&str; 4] = ["time", "elapsed", "clock", "seconds"];

/// How far a vertex moves on the screen, and its velocity.
#[derive(Clone, Copy, Debug)]
struct Sample {
    motion: [f32; 2],
    velocity: [f32; 2],
}

impl Two<'_> {
    /// Whether the velocity in a slot follows the motion of the main pass, and what it does not follow.
    pub(super) fn motion(
        &self,
        promise: &str,
        slot: Slot,
        sliced: &[Sliced; 2],
    ) -> (Outcome, Vec<Finding>) {
        let previous: Vec<&Rule> = self
            .matching
            .rules
            .iter()
            .filter(|r| r.is_previous)
            .collect();
        let fragment = sliced[1].stages(self.second).fragment;
        let mut inputs = fragment.iter().flat_map(|f| f.inputs());
        if inputs.any(|io| io.binding.as_ref().map(Slot::of) == Some(POSITION)) {
            let why = "the velocity pass computes it from the pixel's place".to_owned();
            return (Outcome::NotEvaluated { why }, Vec::new());
        }
        let mut findings = self.still(promise, &previous, sliced);
        if previous.is_empty() {
            let words = "the velocity pass reads nothing of a previous frame: no name has `prev`, `last` or \
                         `old` in it (`--map THEIRS=OURS` names the value of this frame that it was)";
            findings.push(moves(promise, words.to_owned()));
        } else {
            let samples: Vec<Sample> = (0..FRAMES)
                .filter_map(|n| self.sample(n, slot, &previous))
                .collect();
            if samples.len() < 8 {
                let why = match self.budget.is_below(0) {
                    true => "it takes too many steps: too expensive",
                    false => "too few vertices were inside the view in both frames",
                };
                let why = why.to_owned();
                return (Outcome::NotEvaluated { why }, findings);
            }
            if let Some(words) = wrong(&samples) {
                findings.push(moves(promise, words));
            } else if findings.is_empty() {
                return (
                    Outcome::Agreed {
                        inputs: samples.len() as u64,
                    },
                    findings,
                );
            }
        }
        (Outcome::Differs, findings)
    }

    /// What the position depends on that changes with time, and has no previous value.
    fn still(&self, promise: &str, previous: &[&Rule], sliced: &[Sliced; 2]) -> Vec<Finding> {
        let stage = sliced[0].stages(self.first).vertex;
        let module = stage.module();
        let read = reads::parts(stage, &|_| true);
        let names: BTreeSet<String> = read
            .iter()
            .filter(|(at, steps)| {
                let mut rules = previous.iter();
                !rules.any(|r| r.from == *at && reads::overlap(&r.from_steps, steps))
            })
            .filter_map(|(at, steps)| {
                let mut globals = module.global_variables.iter();
                let (global, _) = globals.find(|(_, g)| crate::evaluate::place(g) == Some(*at))?;
                let path = mapping::name_of(module, global, steps);
                let last = path.members.last().unwrap_or(&path.variable).to_lowercase();
                TIME.iter()
                    .any(|word| last.contains(word))
                    .then(|| path.to_string())
            })
            .collect();
        let of = |name: String| {
            let words = format!(
                "the position depends on `{name}`, and the velocity pass reads no previous value of it"
            );
            moves(promise, words)
        };
        names.into_iter().map(of).collect()
    }

    /// A vertex in two frames. What has no previous value stays the same in all samples, as a scale
    /// would.
    fn sample(&self, n: u64, slot: Slot, previous: &[&Rule]) -> Option<Sample> {
        if self.budget.is_below(0) {
            return None;
        }
        let first = self.effort.seed.next_multiple_of(ORDINARY);
        let rules = &self.matching.rules;
        let read = self.read(rules);
        let of = |n: u64| self.inputs(first + ORDINARY * n, Reading::Level, rules, &read);
        let constant = of(0);
        let [now, before] = [n, n + FRAMES].map(|n| {
            let mut inputs = of(n);
            let moved = std::mem::replace(&mut inputs.resources, Arc::clone(&constant.resources));
            let resources = Arc::make_mut(&mut inputs.resources);
            for rule in previous {
                let value = moved
                    .get(&rule.from)
                    .and_then(|v| part(v, &rule.from_steps));
                let own = resources
                    .get_mut(&rule.from)
                    .and_then(|v| part_mut(v, &rule.from_steps));
                if let (Some(value), Some(own)) = (value, own) {
                    own.clone_from(value);
                }
            }
            inputs
        });
        // The same vertices, with the values of the other frame.
        let resources = before.resources;
        let mut before = now.clone();
        before.resources = resources;
        let mut both = now.clone();
        let resources = Arc::make_mut(&mut both.resources);
        let current: Vec<Rule> = rules.iter().filter(|r| !r.is_previous).cloned().collect();
        fed::feed(&current, resources);
        for rule in previous {
            let from = before
                .resources
                .get(&rule.from)
                .and_then(|v| part(v, &rule.from_steps));
            let to = resources
                .get_mut(&rule.to)
                .and_then(|v| part_mut(v, &rule.to_steps));
            if let (Some(from), Some(to)) = (from, to) {
                fed::overlay(to, from, &rule.cast);
            }
        }
        let stages = [self.first, self.second];
        let corner = now.corner();
        let at = |inputs: &Inputs, program, place, slot| {
            let ran = Draw::new(inputs, stages, self.budget)
                .run(program, place, 4 * self.effort.steps)
                .ok()?;
            let value: &Value = ran.outputs.get(&slot)?;
            let numbers = value.floats().ok()?;
            (!ran.discarded && numbers.iter().all(|x| x.is_finite())).then_some(numbers)
        };
        let on_screen = |inputs: &Inputs| match at(inputs, 0, TestPoint::Vertex, POSITION)?[..] {
            [x, y, _, w] if w.abs() > 0.05 => Some([x / w, y / w]),
            _ => None,
        };
        let (now, before) = (on_screen(&now)?, on_screen(&before)?);
        let velocity = at(&both, 1, TestPoint::Corner(corner), slot)?;
        Some(Sample {
            motion: [now[0] - before[0], now[1] - before[1]],
            velocity: [*velocity.first()?, *velocity.get(1)?],
        })
    }
}

fn moves(promise: &str, words: String) -> Finding {
    Finding::general(Class::Moves, promise, words)
}

/// What is wrong with the velocities, in words.
fn wrong(samples: &[Sample]) -> Option<String> {
    let range = |of: &dyn Fn(&Sample) -> f32| {
        let all = samples.iter().map(of);
        let [low, high] = all.fold([f32::MAX, f32::MIN], |[low, high], x| {
            [low.min(x), high.max(x)]
        });
        high - low
    };
    let text = |[x, y]: [f32; 2]| format!("({}, {})", digits(x), digits(y));
    for axis in [0, 1] {
        let moved = range(&|s| s.motion[axis]);
        let seen = range(&|s| s.velocity[axis]);
        if seen <= f32::EPSILON && moved > 0.0 {
            let velocity = text(samples[0].velocity);
            return Some(format!(
                "the velocity is {velocity} along {} whatever moves",
                ["x", "y"][axis]
            ));
        }
        // Samples whose motions and velocities are in opposite orders, and in the same.
        let mut pairs: [Option<[Sample; 2]>; 2] = [None; 2];
        for (i, a) in samples.iter().enumerate() {
            for b in &samples[i + 1..] {
                let further = b.motion[axis] - a.motion[axis];
                let faster = b.velocity[axis] - a.velocity[axis];
                if further.abs() > NOTABLE * moved && faster.abs() > NOTABLE * seen {
                    pairs[usize::from(further * faster > 0.0)].get_or_insert([*a, *b]);
                }
            }
        }
        if let [Some([a, b]), Some(_)] = pairs {
            return Some(format!(
                "the velocity does not follow the motion: where a point moves by {} on the screen it is {}, and \
                 where one moves by {} it is {}",
                text(a.motion),
                text(a.velocity),
                text(b.motion),
                text(b.velocity)
            ));
        }
    }
    None
}
