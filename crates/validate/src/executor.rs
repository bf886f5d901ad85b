//! Validates promises on another executor: an adapter, whose compiler treats both texts in its own
//! way.
//!
//! The interpreter runs first. It selects inputs on which both terminate and computes, with
//! intervals, the results that WGSL's accuracies allow for the original. The same rule then
//! compares the adapter's results. If they differ but the variant is within the original's
//! permitted range, the adapter has rounded the two texts differently. That is no fault of the
//! variant; it is counted and reported.

use std::collections::BTreeMap;

use super::compare::{self, Colors, Difference, text};
use super::environment::{self, PassStages, TestPoint, Texels};
use super::inputs::{Inputs, Profile};
use super::promise::{Attached, Pair};
use super::stage::Ran;
use super::trial::{color_rule, is_whole, of_compared};
use super::verdict::{Counterexample, Verdict, not_evaluated};
use naga_interp::bound::Interval;
use naga_interp::{Scalar, Stuck, Value};

/// The data of a draw, without its stages.
#[derive(Clone, Copy, Debug)]
pub struct Draw<'a> {
    /// Uniforms, buffers, attributes, and texels from [`Inputs::plain_texel`].
    pub inputs: &'a Inputs,
    /// Contents of attachments, by binding.
    pub attached: &'a BTreeMap<(u32, u32), [f32; 4]>,
}

/// Runs stages on another executor.
pub trait Runner {
    /// Runs stages once for each draw.
    ///
    /// # Errors
    ///
    /// A message with the reason.
    fn run(
        &self,
        stages: PassStages<'_>,
        place: TestPoint,
        draws: &[Draw<'_>],
    ) -> Result<Vec<Ran>, String>;
}

/// An input on which both terminate.
struct Ready {
    inputs: Inputs,
    attached: Attached,
    colors: Colors,
}

impl Pair<'_> {
    /// Tries numbers on the executor.
    pub(super) fn tried_on(
        &self,
        runner: &dyn Runner,
        places: &[TestPoint],
        colors: Colors,
    ) -> Verdict {
        if let Some(why) = self.unfilled(places) {
            return not_evaluated(&why);
        }
        let (mut agreed, mut compared, mut unsure) = (0, 0, 0);
        for place in places {
            let ready = match self.ready(*place, colors) {
                Ok(ready) => ready,
                Err(why) => return Verdict::NotEvaluable { why },
            };
            let draws: Vec<Draw<'_>> = ready
                .iter()
                .map(|r| Draw {
                    inputs: &r.inputs,
                    attached: &r.attached,
                })
                .collect();
            let run = |stages| runner.run(stages, *place, &draws);
            let (original, variant) = match (run(self.original), run(self.other)) {
                (Ok(original), Ok(variant)) => (original, variant),
                (Err(why), _) | (_, Err(why)) => return Verdict::NotEvaluable { why },
            };
            let results = original.iter().zip(&variant);
            for (ready, (original, variant)) in ready.iter().zip(results) {
                match self.judged(ready, *place, original, variant) {
                    PointVerdict::Same => {
                        agreed += 1;
                        let is_kept = !original.discarded;
                        compared += u64::from(is_whole(colors, ready.colors, is_kept));
                    }
                    PointVerdict::Unsure => unsure += 1,
                    PointVerdict::Strange(why) => return Verdict::NotEvaluable { why },
                    PointVerdict::Differs(found) => return Verdict::Counterexample(found),
                }
            }
        }
        let places = places.len() as u64;
        let each = |n: u64| n.div_ceil(places.max(1));
        match (agreed / places.max(1), each(unsure)) {
            (0, _) => not_evaluated("no input could be judged there"),
            (few, many) if few < many => Verdict::NotEvaluable {
                why: format!(
                    "on {many} inputs the adapter rounds the two apart, and on {few} alone it does \
                     not"
                ),
            },
            (inputs, unsure) => of_compared(inputs, each(compared).min(inputs), unsure),
        }
    }

    /// The inputs on which both terminate in the interpreter.
    fn ready(&self, place: TestPoint, colors: Colors) -> Result<Vec<Ready>, String> {
        let module = self.original.vertex.module();
        let (mut ready, mut why) = (Vec::new(), None);
        for seed in self.effort.seed..self.effort.seed + self.effort.inputs {
            let inputs =
                Inputs::new(module, self.variant.guard.as_ref(), seed).with_levels(&self.levels);
            let is_ordinary = inputs.profile == Profile::Ordinary;
            if self.folds_floats() && !is_ordinary {
                continue;
            }
            let colors = color_rule(colors, &inputs);
            let (_, attached) = self.rule(place, colors, Some(&inputs));
            let world = environment::concrete(&inputs, &attached, Texels::Plain);
            let ended = world
                .run(self.original, place, self.effort.steps, None)
                .and_then(|_| world.run(self.other, place, 4 * self.effort.steps, None));
            drop(world);
            match ended {
                Ok(_) => ready.push(Ready {
                    inputs,
                    attached,
                    colors,
                }),
                Err(Stuck::Steps) => {}
                Err(stuck) => {
                    why.get_or_insert(stuck.to_string());
                }
            }
        }
        match (ready.is_empty(), why) {
            (true, Some(why)) => Err(why),
            (true, None) => Err("no input came to an end within the step limit".to_owned()),
            (false, _) => Ok(ready),
        }
    }

    /// Judges the results of one input.
    fn judged(
        &self,
        ready: &Ready,
        place: TestPoint,
        original: &Ran,
        variant: &Ran,
    ) -> PointVerdict {
        let (inputs, attached) = (&ready.inputs, &ready.attached);
        let (rule, _) = self.rule(place, ready.colors, Some(inputs));
        let allowed = environment::ranging(inputs, attached)
            .run(self.original, place, self.effort.steps, None)
            .ok();
        // An adapter that violates WGSL's accuracies proves nothing.
        if let Some(strange) = allowed.as_ref().and_then(|a| outside(a, original)) {
            return PointVerdict::Strange(format!(
                "what the adapter gives of the original is not what WGSL allows: {strange} (inputs \
                 of seed {})",
                inputs.seed
            ));
        }
        let Some(found) = compare::difference(rule, original, variant) else {
            return PointVerdict::Same;
        };
        match &allowed {
            // An intermediate value is NaN, or a rounding decides: the permitted range is unknown.
            None => return PointVerdict::Unsure,
            Some(allowed) if is_allowed(allowed, &found, variant) => return PointVerdict::Unsure,
            Some(_) => {}
        }
        let world = environment::concrete(inputs, attached, Texels::Plain);
        let first = self.first_diverging(&world, place);
        PointVerdict::Differs(Box::new(Counterexample {
            seed: inputs.seed,
            inputs: self.inputs_as_text(inputs, place),
            output: found.output,
            original: found.original,
            variant: found.variant,
            first,
        }))
    }
}

enum PointVerdict {
    Same,
    /// They differ, within the original's permitted range.
    Unsure,
    /// The original is outside of its permitted range.
    Strange(String),
    Differs(Box<Counterexample>),
}

/// The first output of the original outside of its permitted range.
fn outside(allowed: &Ran<Interval>, ran: &Ran) -> Option<String> {
    if allowed.discarded != ran.discarded {
        return Some("it is discarded or kept otherwise".to_owned());
    }
    if ran.discarded {
        return None;
    }
    allowed.outputs.iter().find_map(|(slot, interval)| {
        let value = ran.outputs.get(slot)?;
        let strange = !holds(interval, value);
        strange.then(|| format!("{slot} is {}, of {}", text(value), text(interval)))
    })
}

/// Whether the variant's differing value is within the original's permitted range.
fn is_allowed(allowed: &Ran<Interval>, found: &Difference, variant: &Ran) -> bool {
    let mut slots = allowed.outputs.iter();
    slots
        .find(|(slot, _)| slot.to_string() == found.output)
        .and_then(|(slot, interval)| Some(holds(interval, variant.outputs.get(slot)?)))
        .unwrap_or(false)
}

fn holds(interval: &Value<Interval>, value: &Value) -> bool {
    match (interval, value) {
        (Value::Scalar(Scalar::F32(interval)), Value::Scalar(Scalar::F32(number))) => {
            interval.contains(f64::from(*number))
        }
        (Value::Scalar(Scalar::I32(a)), Value::Scalar(Scalar::I32(b))) => a == b,
        (Value::Scalar(Scalar::U32(a)), Value::Scalar(Scalar::U32(b))) => a == b,
        (Value::Scalar(Scalar::Bool(a)), Value::Scalar(Scalar::Bool(b))) => a == b,
        (Value::Composite(a), Value::Composite(b)) => {
            a.len() == b.len() && a.iter().zip(b).all(|(a, b)| holds(a, b))
        }
        _ => false,
    }
}
