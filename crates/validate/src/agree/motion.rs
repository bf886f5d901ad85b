//! Whether a velocity follows the motion.
//!
//! The main pass itself gives the motion of a point between two frames: its position is evaluated
//! with the values of both. A velocity may be scaled, flipped, clamped or encoded. But if a point
//! moves further along an axis, its velocity must not fall there, or it must not rise.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::budget::Draw;
use super::buffers::{self, BufferLeaf};
use super::fed::{self, Rule, part, part_mut};
use super::quote::digits;
use super::trial::{Two, What};
use super::wording::Sliced;
use super::{Class, Finding, Outcome, reads};
use crate::environment::{PassStages, TestPoint};
use crate::inputs::Inputs;
use crate::levels::Reading;
use crate::stage::{POSITION, Slot};
use preshade_plan::mapping;

const FRAMES: usize = 64;

/// Frames that are tried: in about a quarter, a vertex is in front of the camera in both.
const TRIES: u64 = 320;

/// Every sixth seed has ordinary numbers.
const ORDINARY: u64 = 6;

/// The least difference of velocities, and of motions, that counts, relative to their largest
/// difference.
const NOTABLE: f32 = 1e-3;

/// Parts of names of values that change with time by themselves.
const TIME: [&str; 4] = ["time", "elapsed", "clock", "seconds"];

/// How far a vertex moves on the screen, and its velocity.
#[derive(Clone, Copy, Debug)]
struct Sample {
    motion: [f32; 2],
    velocity: [f32; 2],
    /// The vertex is in view.
    is_seen: bool,
}

impl Two<'_> {
    /// Whether the velocity in a slot follows the motion of the main pass, and findings where it
    /// does not.
    pub(super) fn motion(
        &self,
        promise: &str,
        slot: Slot,
        sliced: &[Sliced; 2],
    ) -> (Outcome, Vec<Finding>) {
        let previous = self.previous(&sliced[1]);
        let fragment = sliced[1].stages(self.second).fragment;
        let mut inputs = fragment.iter().flat_map(|f| f.inputs());
        if inputs.any(|io| io.binding.as_ref().map(Slot::of) == Some(POSITION)) {
            let why = "the velocity pass computes it from the pixel's place".to_owned();
            return (Outcome::NotEvaluated { why }, Vec::new());
        }
        let is_moved = !previous.is_empty() || !self.matching.previous_inputs.is_empty();
        let mut findings = self.still(promise, &previous, sliced);
        if !is_moved && !findings.is_empty() {
            // The values that it does not read are named.
        } else if !is_moved {
            let words = "the velocity pass reads nothing of a previous frame: no name has `prev`, `last` or \
                         `old` in it (`--map THEIRS=OURS` names the value of this frame that it was)";
            findings.push(moves(promise, words.to_owned()));
        } else {
            let samples = (0..TRIES).filter_map(|n| self.sample(n, slot, &previous, &sliced[1]));
            let samples: Vec<Sample> = samples.take(FRAMES).collect();
            let (samples, endless): (Vec<_>, Vec<_>) = samples
                .into_iter()
                .partition(|s| s.velocity.iter().all(|x| x.is_finite()));
            if let Some(one) = endless.iter().find(|s| s.is_seen) {
                let words = format!(
                    "the velocity is {} where a point in view moves by {} on the screen",
                    pair(one.velocity),
                    pair(one.motion)
                );
                findings.push(moves(promise, words));
            } else if samples.len() < 8 {
                let why = match self.budget.is_below(0) {
                    true => "it takes too many steps: too expensive",
                    false => "too few vertices were in front of the camera in both frames",
                };
                let why = why.to_owned();
                return (Outcome::NotEvaluated { why }, findings);
            }
            if let Some(words) = wrong(&samples)
                && endless.is_empty()
            {
                findings.push(moves(promise, words));
            } else if findings.is_empty() {
                return (
                    Outcome::Agreed {
                        inputs: samples.len() as u64,
                        cut_from: None,
                    },
                    findings,
                );
            }
        }
        (Outcome::Differs, findings)
    }

    /// Values of the previous frame that a slice of the velocity pass reads.
    fn previous(&self, sliced: &Sliced) -> Vec<&Rule> {
        let read = read_by(sliced.stages(self.second));
        let is_read = |rule: &&Rule| {
            let mut read = read.iter();
            read.any(|(at, steps)| *at == rule.to && reads::overlap(steps, &rule.to_steps))
        };
        let rules = self.matching.rules.iter().filter(|r| r.is_previous);
        rules.filter(is_read).collect()
    }

    /// Values that the main pass's position reads from buffers, and whose previous value the
    /// velocity pass does not read: path, and last name.
    fn unmoved(&self, previous: &[&Rule]) -> BTreeMap<String, String> {
        let position = Sliced::of(self.first, &[], true);
        let stage = position.stages(self.first).vertex;
        let module = stage.module();
        let read = reads::parts(stage, &|_| true).into_iter();
        let read = read.filter(|(at, steps)| {
            let mut rules = previous.iter();
            !rules.any(|r| r.from == *at && reads::overlap(&r.from_steps, steps))
        });
        let named = read.filter_map(|(at, steps)| {
            let mut globals = module.global_variables.iter();
            let (global, variable) = globals.find(|(_, g)| naga_interp::place(g) == Some(at))?;
            if variable.space == naga::AddressSpace::Handle {
                return None;
            }
            let path = mapping::name_of(module, global, &steps);
            let last = buffers::last_name(&path).to_owned();
            Some((path.to_string(), last))
        });
        named.collect()
    }

    /// A finding for each value that moves the position, but not the velocity. Either a previous
    /// value is declared and unread, or the name is one of a time.
    fn still(&self, promise: &str, previous: &[&Rule], sliced: &[Sliced; 2]) -> Vec<Finding> {
        let read = read_by(sliced[1].stages(self.second));
        let second = self.second.vertex.module();
        let is_read = |module: &naga::Module, leaf: &BufferLeaf| {
            let at = naga_interp::place(&module.global_variables[leaf.global]);
            let mut read = read.iter();
            std::ptr::eq(module, second)
                && read
                    .any(|(place, steps)| Some(*place) == at && reads::overlap(steps, &leaf.steps))
        };
        let declared = |name: &str| {
            [second, self.first.vertex.module()]
                .into_iter()
                .find_map(|module| {
                    let leaves = buffers::leaves(module);
                    let mut leaves = leaves.iter().filter(|leaf| !is_read(module, leaf));
                    leaves.find_map(|leaf| {
                        let path = mapping::name_of(module, leaf.global, &leaf.steps);
                        buffers::is_previous_of(&path, name).then(|| path.to_string())
                    })
                })
        };
        let of = |(path, last): (String, String)| {
            let lower = last.to_lowercase();
            let words = match declared(&last) {
                // A velocity leaves the jitter of both frames out.
                _ if lower.contains("jitter") => return None,
                Some(unread) => format!(
                    "the velocity pass does not read `{unread}`, so it takes `{path}` as unmoved"
                ),
                None if TIME.iter().any(|word| lower.contains(word)) => format!(
                    "the position depends on `{path}`, and the velocity pass reads no previous value of it"
                ),
                None => return None,
            };
            Some(moves(promise, words))
        };
        self.unmoved(previous).into_iter().filter_map(of).collect()
    }

    /// The values that count as unmoved because no previous value is declared, as a sentence.
    pub(super) fn unmoved_note(&self) -> Option<String> {
        let Ok(What::Moving(slot)) = self.velocity().map(What::Moving) else {
            return None;
        };
        let criteria = self.criteria(What::Moving(slot));
        let sliced = Sliced::of_both(self, &criteria, false);
        let previous = self.previous(&sliced[1]);
        // A finding names some of them.
        let found = self.still("", &previous, &sliced);
        let names = self.unmoved(&previous).into_keys();
        let names = names.map(|name| format!("`{name}`"));
        let is_left = |name: &String| !found.iter().any(|f| f.words.contains(name));
        let names: Vec<String> = names.filter(is_left).collect();
        let is_silent = previous.is_empty() || names.is_empty();
        (!is_silent).then(|| {
            format!(
                "the velocity pass reads no previous value of {}: that counts as static",
                names.join(", ")
            )
        })
    }

    /// A vertex in two frames. A value without a previous one is constant in all samples, like a
    /// scale.
    fn sample(&self, n: u64, slot: Slot, previous: &[&Rule], sliced: &Sliced) -> Option<Sample> {
        if self.budget.is_below(0) {
            return None;
        }
        let first = self.effort.seed.next_multiple_of(ORDINARY);
        let rules = &self.matching.rules;
        let read = self.read(rules);
        let of = |n: u64| self.inputs(&(first + ORDINARY * n).into(), Reading::Level, rules, &read);
        let constant = of(0);
        let [now, before] = [n, n + TRIES].map(|n| {
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
        // The velocity pass reads the attributes of both frames.
        both.same_numbers(&[]);
        let swapped = self.matching.previous_inputs.iter();
        let swapped: Vec<_> = swapped.map(|(own, ours)| (*ours, *own)).collect();
        before.same_numbers(&swapped);
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
        // A discard does not change a velocity.
        let stages = [self.first, sliced.stages(self.second)];
        let corner = now.corner();
        let at = |inputs: &Inputs, program, place, slot| {
            let ran = Draw::new(inputs, stages, self.budget)
                .run(program, place, 4 * self.effort.steps)
                .ok()?;
            ran.outputs.get(&slot)?.floats().ok()
        };
        // Behind the camera there is no place on the screen.
        let on_screen = |inputs: &Inputs| match at(inputs, 0, TestPoint::Vertex, POSITION)?[..] {
            [x, y, z, w] if w > 0.05 && [x, y, z, w].iter().all(|n| n.is_finite()) => {
                let is_seen = x.abs() <= w && y.abs() <= w && (0.0..=w).contains(&z);
                Some(([x / w, y / w], is_seen))
            }
            _ => None,
        };
        let ((now, is_seen), (before, _)) = (on_screen(&now)?, on_screen(&before)?);
        let velocity = at(&both, 1, TestPoint::Corner(corner), slot)?;
        Some(Sample {
            motion: [now[0] - before[0], now[1] - before[1]],
            velocity: [*velocity.first()?, *velocity.get(1)?],
            is_seen,
        })
    }
}

/// The parts of buffers that stages read.
fn read_by(stages: PassStages<'_>) -> BTreeSet<((u32, u32), Vec<usize>)> {
    let stages = [Some(stages.vertex), stages.fragment].into_iter().flatten();
    stages
        .flat_map(|stage| reads::parts(stage, &|_| true))
        .collect()
}

fn pair([x, y]: [f32; 2]) -> String {
    format!("({}, {})", digits(x), digits(y))
}

fn moves(promise: &str, words: String) -> Finding {
    Finding::general(Class::Moves, promise, words)
}

/// The fault in the velocities, in words.
fn wrong(samples: &[Sample]) -> Option<String> {
    let range = |of: &dyn Fn(&Sample) -> f32| {
        let all = samples.iter().map(of);
        let [low, high] = all.fold([f32::MAX, f32::MIN], |[low, high], x| {
            [low.min(x), high.max(x)]
        });
        high - low
    };
    for axis in [0, 1] {
        let moved = range(&|s| s.motion[axis]);
        let seen = range(&|s| s.velocity[axis]);
        if seen <= f32::EPSILON && moved > 0.0 {
            let velocity = pair(samples[0].velocity);
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
                pair(a.motion),
                pair(a.velocity),
                pair(b.motion),
                pair(b.velocity)
            ));
        }
    }
    None
}
