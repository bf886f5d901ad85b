//! Validates the resolve of the visibility buffer: the passes that draw and read ids, on made-up
//! draws ([`Drawn`]).
//!
//! For each input we run the id pass at a covered pixel and write its id into the id texture. The
//! resolve then shades that pixel from the draw's buffers. The original shades it from the inputs
//! that a rasteriser would provide ([`super::quad`]). Each comparison is made twice:
//!
//! - in `f32`, by the step's budget, on the values that the target stores;
//! - in `f64`, where the two may differ by rounding only. The resolve is the same function as the
//!   original, whatever its budget, so a larger difference is a fault.
//!
//! If `f32` exceeds the budget and `f64` agrees, the two differ by rounding, which is counted and
//! reported.

use std::collections::BTreeMap;

use super::compare::{self, Difference, text};
use super::environment::{PassStages, TestPoint};
use super::inputs::{self, Inputs, Profile, Random};
use super::made_up_draw::Drawn;
use super::promise::NOT_DRAWN;
use super::quad::{Float, Triangle};
use super::stage::Ran;
use super::trial::{QUOTA, inputs_as_text, of_compared, unfilled};
use super::verdict::{Counterexample, Verdict, not_evaluated};
use super::visibility_buffer::{Split, positions};
use super::{By, Check};
use naga_interp::{Scalar, Stuck, Value};
use preshade_passes::analysis::rounding;
use preshade_plan::contract::Contract;
use preshade_plan::draw_table::DRAWS;
use preshade_plan::plan::{GpuPass, Plan, Step};
use preshade_plan::program::Program;
use preshade_plan::state::ColorTarget;

/// The largest difference of colours in `f64`, relative to the largest component or 1.
const SAME_FUNCTION: f64 = 1e-6;

/// The most seeds for each of the effort's inputs (many triangles are behind the viewer, or
/// discarded), and the number of inputs that one compared pixel counts for.
const MORE_SEEDS: u64 = 4;
const COSTLIER: u64 = 6;

/// Inputs on which we check that a draw shades its own pixels.
const FEW: u64 = 24;

const COLORS: &str = "colours of covered pixels";
const PIXELS: &str = "which pixels it shades";

/// Checks the promises of a resolve pass.
pub(super) fn checks<'a>(
    variant: &'a Plan,
    programs: &'a BTreeMap<String, Program>,
    (main, own): (&'a GpuPass, &'a Program),
    pass: &'a GpuPass,
    by: By<'_>,
) -> Vec<Check> {
    let check = |promise: &str, verdict| Check {
        role: pass.role,
        promise: promise.to_owned(),
        verdict,
    };
    let split = match Split::new(variant, programs, (main, own), pass, by.effort) {
        Ok(split) => split,
        Err(why) => return vec![check(COLORS, Verdict::NotEvaluable { why })],
    };
    if by.runner.is_some() {
        return vec![check(COLORS, not_evaluated(NOT_DRAWN))];
    }
    (by.told)(pass.role, PIXELS);
    let pixels = check(PIXELS, split.pixels());
    (by.told)(pass.role, COLORS);
    let colors = match budget(variant) {
        Ok(budget) => split.colors(budget),
        Err(why) => Verdict::NotEvaluable { why },
    };
    vec![pixels, check(COLORS, colors)]
}

/// The largest difference that is promised of a channel.
fn budget(variant: &Plan) -> Result<f64, String> {
    let mut most = 0.0;
    for Step { pass, contract, .. } in &variant.steps {
        match contract {
            Contract::Exact { .. } => {}
            Contract::Rounding { .. } => most += rounding::MOST,
            Contract::Approximate { budget, .. } if pass == "visibility-buffer" => {
                most += budget.limit;
            }
            Contract::Approximate { .. } | Contract::Budgets { .. } => {
                return Err(format!(
                    "`{pass}` may change them too, within a budget of the picture, and nobody \
                     draws it here: `verify` does"
                ));
            }
        }
    }
    Ok(most)
}

/// The result of an input.
enum Tried {
    Same {
        is_compared: bool,
    },
    /// They differ by rounding.
    Apart,
    /// No pixel shows the triangle: it is behind the viewer, or thin.
    Unseen,
    Differs(Box<Counterexample>),
}

impl Split<'_> {
    /// Seeds of ordinary numbers, for which budgets hold.
    fn seeds(&self) -> impl Iterator<Item = u64> {
        let seeds = self.effort.seed..self.effort.seed + MORE_SEEDS * self.effort.inputs;
        seeds.filter(|seed| inputs::profile(*seed) == Profile::Ordinary)
    }

    fn colors(&self, budget: f64) -> Verdict {
        let module = self.original.stages.vertex.module();
        let originals = self.original.stages;
        let read = std::iter::once(originals.vertex).chain(originals.fragment);
        if let Some(why) = unfilled(read, module, self.variant.guard.as_ref()) {
            return not_evaluated(&why);
        }
        let (mut tried, mut agreed, mut compared, mut apart, mut why) = (0, 0, 0, 0, None);
        for seed in self.seeds() {
            if COSTLIER * (compared + apart) >= self.effort.inputs {
                break;
            }
            tried += 1;
            match self.try_colors(seed, budget) {
                Ok(Tried::Same { is_compared }) => {
                    agreed += 1;
                    compared += u64::from(is_compared);
                }
                Ok(Tried::Apart) => apart += 1,
                Ok(Tried::Unseen) => tried -= 1,
                Ok(Tried::Differs(found)) => return Verdict::Counterexample(found),
                Err(stuck) => {
                    why.get_or_insert(stuck.to_string());
                }
            }
            // An obstacle for every input.
            if agreed == 0 && why.is_some() && tried > FEW {
                break;
            }
        }
        match (agreed, why) {
            (0, Some(why)) => Verdict::NotEvaluable { why },
            (0, None) if tried == 0 => {
                not_evaluated("no triangle covers a pixel: all are behind the viewer, or thin")
            }
            (few, Some(why)) if (few + apart) * QUOTA < tried => Verdict::NotEvaluable {
                why: format!("only {few} of {tried} inputs came to an end: {why}"),
            },
            (_, _) if compared < apart => Verdict::NotEvaluable {
                why: format!(
                    "on {apart} inputs the roundings of 32 bits alone exceed the budget, and on \
                     {compared} they do not"
                ),
            },
            (inputs, _) => of_compared(inputs, compared, apart),
        }
    }

    fn try_colors(&self, seed: u64, budget: f64) -> Result<Tried, Stuck> {
        let inputs = self.inputs(seed);
        let mut drawn = self.drawn(&inputs);
        let corners = self.corners::<f32>(&inputs, &drawn)?;
        let mut random = Random::new(seed, "covered");
        let Some(Triangle { viewport, .. }) = Triangle::covering(
            positions(&corners)?,
            self.like.corners,
            drawn.center(),
            self.is_linear(),
            &mut random,
        ) else {
            return Ok(Tried::Unseen);
        };
        drawn.entry.viewport = viewport;
        let unseen = Ok(Tried::Same { is_compared: false });
        let Some(single) = self.shaded::<f32>(&inputs, &drawn, corners)? else {
            return unseen;
        };
        let corners = self.corners::<f64>(&inputs, &drawn)?;
        let Some(double) = self.shaded::<f64>(&inputs, &drawn, corners)? else {
            return unseen;
        };
        let slots = || single.original.outputs.keys().copied();
        let apart = slots().find(|slot| {
            let values = [&double.original, &double.resolved].map(|ran| ran.outputs.get(slot));
            !matches!(values, [Some(a), Some(b)] if !is_finite(a) || compare::is_close(a, b, SAME_FUNCTION))
        });
        if let Some(slot) = apart {
            let said = |ran: &Ran<f64>| ran.outputs.get(&slot).map_or("nothing".to_owned(), text);
            return Ok(Tried::Differs(Box::new(self.found(
                &inputs,
                &drawn,
                Difference {
                    output: slot.to_string(),
                    original: said(&double.original),
                    variant: said(&double.resolved),
                },
            ))));
        }
        let is_within = slots().all(|slot| {
            let [a, b] = [&single.original, &single.resolved].map(|ran| ran.outputs.get(&slot));
            let target = self.target(slot);
            matches!((a, b), (Some(a), Some(b)) if is_within(a, b, budget, target))
        });
        Ok(match is_within {
            true => Tried::Same { is_compared: true },
            false => Tried::Apart,
        })
    }

    /// Whether a draw's resolve shades the pixels that show the draw, and no others.
    fn pixels(&self) -> Verdict {
        let mut inputs = 0;
        for seed in self.seeds().take(FEW as usize) {
            match self.try_pixels(seed) {
                Ok(None) => inputs += 1,
                Ok(Some(found)) => return Verdict::Counterexample(Box::new(found)),
                Err(stuck) => return not_evaluated(&stuck.to_string()),
            }
        }
        of_compared(inputs, inputs, 0)
    }

    fn try_pixels(&self, seed: u64) -> Result<Option<Counterexample>, Stuck> {
        let inputs = self.inputs(seed);
        let drawn = self.drawn(&inputs);
        let of = (&inputs, &drawn);
        let entry = &drawn.entry;
        let x = 1 + entry.first_id + drawn.instance - entry.first_instance;
        let own = match entry.triangle_bits {
            0 => [x, drawn.triangle, 0, 1],
            bits => [(x << bits) | drawn.triangle, 0, 0, 1],
        };
        for (id, is_own) in [(own, true), (drawn.other, false)] {
            let is_shaded = match self.resolve.pass.depth.as_ref() {
                Some(depth) if depth.attachment == DRAWS => self.is_classified(of, id)?,
                _ => !self.resolved::<f32>(of, id)?.discarded,
            };
            if is_shaded != is_own {
                let said = |is: bool| if is { "shaded" } else { "left" }.to_owned();
                let difference = Difference {
                    output: format!("the pixel that shows the id {id:?}"),
                    original: said(is_own),
                    variant: said(is_shaded),
                };
                return Ok(Some(self.found(&inputs, &drawn, difference)));
            }
        }
        Ok(None)
    }

    fn found(&self, inputs: &Inputs, drawn: &Drawn<'_>, found: Difference) -> Counterexample {
        let vertex = PassStages {
            fragment: None,
            ..self.original.stages
        };
        let mut told = inputs_as_text(vertex, inputs, TestPoint::Inside);
        told.extend(drawn.as_text());
        Counterexample {
            seed: inputs.seed,
            inputs: told,
            output: found.output,
            original: found.original,
            variant: found.variant,
            first: None,
        }
    }
}

fn scalars<F: Float>(value: &Value<F>) -> Vec<Scalar<F>> {
    match value {
        Value::Scalar(scalar) => vec![*scalar],
        Value::Composite(parts) => parts.iter().flat_map(scalars).collect(),
        _ => Vec::new(),
    }
}

fn is_finite<F: Float>(value: &Value<F>) -> bool {
    scalars(value).iter().all(|scalar| match scalar {
        Scalar::F32(x) => x.exactly().is_finite(),
        _ => true,
    })
}

/// Whether the stored values of two colours differ by at most `most`.
fn is_within(a: &Value, b: &Value, most: f64, target: Option<&ColorTarget>) -> bool {
    let format = target.map_or("", |t| t.format.as_str());
    let stored = |channel: usize, number: f32| {
        let number = f64::from(number);
        match (format.contains("unorm"), format.ends_with("-srgb")) {
            (true, is_srgb) => {
                let held = number.clamp(0.0, 1.0);
                // IEC 61966-2-1.
                match is_srgb && channel < 3 {
                    true if held <= 0.003_130_8 => 12.92 * held,
                    true => 1.055 * held.powf(1.0 / 2.4) - 0.055,
                    false => held,
                }
            }
            (false, _) => number,
        }
    };
    let (a, b) = (scalars(a), scalars(b));
    let pairs = a.iter().zip(&b).enumerate();
    a.len() == b.len()
        && pairs.into_iter().all(|(channel, pair)| match pair {
            (Scalar::F32(a), Scalar::F32(b)) if a.is_finite() => {
                (stored(channel, *a) - stored(channel, *b)).abs() <= most
            }
            (Scalar::F32(_), Scalar::F32(_)) => true,
            (a, b) => a == b,
        })
}
