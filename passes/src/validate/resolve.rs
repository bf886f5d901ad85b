//! Validates the resolve of the visibility buffer: the passes that draw and read ids, on made-up
//! draws ([`Drawn`]).
//!
//! For each input we run the id pass at a covered pixel and write its id into the id texture. The
//! resolve then shades that pixel from the draw's buffers. The original shades it from what a
//! rasteriser gives it ([`Quad`]). Each comparison is made twice:
//!
//! - in `f32`, by the step's budget, on the values that the target stores;
//! - in `f64`, where the two may differ by rounding only. The resolve is the same function as the
//!   original, whatever its budget, so a larger difference is a fault.
//!
//! If `f32` exceeds the budget and `f64` agrees, the two are rounded apart, which is counted and
//! reported.

use std::collections::BTreeMap;
use std::sync::Arc;

use naga::{BuiltIn, Interpolation, ShaderStage};

use super::compare::{self, Difference, text};
use super::drawn::{Drawn, Id, words};
use super::inputs::{self, Inputs, Profile, Random};
use super::levels::{Levels, Reading};
use super::promise::{NOT_DRAWN, effort, stages};
use super::quad::{Float, Quad, Triangle};
use super::stage::{POSITION, Ran, Slot, Stage};
use super::trial::{QUOTA, of_compared, said, unfilled};
use super::verdict::{Counterexample, Verdict, not_evaluated};
use super::world::{PassStages, TestPoint};
use super::{By, Check, Effort};
use crate::analysis::rounding;
use crate::core::contract::Contract;
use crate::core::draw_table::DRAWS;
use crate::core::geometry::Geometry;
use crate::core::plan::{
    BindingSource, BindingUse, ComputePass, GeometryPart, GpuPass, Plan, Role, Step,
};
use crate::core::program::Program;
use crate::core::rasterizer::Rasterizer;
use crate::core::state::ColorTarget;
use crate::evaluate::bound::exactly;
use crate::evaluate::{Environment, Scalar, Stuck, Value};
use crate::transforms::visibility_buffer;

/// The largest difference of colours in `f64`, relative to the largest component or 1.
const SAME_FUNCTION: f64 = 1e-6;

/// The resolve runs three vertices and several pixels in one invocation.
const MORE_STEPS: u64 = 16;

/// Inputs on which we check that a draw shades its own pixels.
const FEW: u64 = 24;

const COLORS: &str = "colours of covered pixels";
const PIXELS: &str = "which pixels it shades";

/// A pass and its stages.
#[derive(Clone, Copy)]
struct Staged<'a> {
    pass: &'a GpuPass,
    stages: PassStages<'a>,
}

/// The passes of a split material.
struct Split<'a> {
    variant: &'a Plan,
    original: Staged<'a>,
    ids: Staged<'a>,
    classify: Option<Staged<'a>>,
    resolve: Staged<'a>,
    /// The stage that stores vertices.
    kept: Option<(Stage<'a>, &'a ComputePass)>,
    like: Rasterizer,
    effort: Effort,
}

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

/// Whether the resolve's check runs a compute pass.
pub(super) fn runs(plan: &Plan, pass: &ComputePass) -> bool {
    pass.geometry == Geometry::Vertices && plan.passes.iter().any(|p| p.role == Role::Resolve)
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
    /// No pixel shows the triangle.
    Unseen,
    Differs(Box<Counterexample>),
}

/// The results at a covered pixel.
struct Shaded<F> {
    original: Ran<F>,
    resolved: Ran<F>,
}

impl<'a> Split<'a> {
    fn new(
        variant: &'a Plan,
        programs: &'a BTreeMap<String, Program>,
        (main, own): (&'a GpuPass, &'a Program),
        pass: &'a GpuPass,
        effort_of: &Effort,
    ) -> Result<Self, String> {
        let staged = |pass: &'a GpuPass| {
            let program = programs.get(&pass.program).ok_or("it has no program")?;
            let stages = stages(pass, program)?;
            Ok::<_, String>(Staged { pass, stages })
        };
        let of_role = |role| variant.passes.iter().find(|p| p.role == role);
        let stored = variant.compute.iter().find(|p| runs(variant, p));
        let kept = stored.map(|compute| {
            let program = programs.get(&compute.program);
            let entry = &compute.entry_point;
            let stage = program.and_then(|p| Stage::new(p, ShaderStage::Compute, entry));
            stage.map(|stage| (stage, compute))
        });
        let original = stages(main, own)?;
        Ok(Self {
            variant,
            original: Staged {
                pass: main,
                stages: original,
            },
            ids: staged(of_role(Role::Ids).ok_or("no pass draws its ids")?)?,
            classify: of_role(Role::Classify).map(staged).transpose()?,
            resolve: staged(pass)?,
            kept: match kept {
                Some(None) => return Err("the stage that stores vertices is missing".to_owned()),
                Some(kept) => kept,
                None => None,
            },
            like: visibility_buffer::assumed(variant).ok_or("it has no step")?,
            effort: effort(original, effort_of),
        })
    }

    fn inputs(&self, seed: u64) -> Inputs {
        let module = self.original.stages.vertex.module();
        let levels = Arc::new(Levels::all(Reading::Level));
        Inputs::new(module, self.variant.guard.as_ref(), seed).with_levels(&levels)
    }

    fn drawn<'d>(&'d self, inputs: &'d Inputs) -> Drawn<'d> {
        let cull = self.original.pass.primitive.cull;
        Drawn::new(
            inputs,
            self.original.stages.vertex,
            self.variant,
            cull,
            false,
        )
    }

    /// Seeds of ordinary numbers, for which budgets hold.
    fn seeds(&self) -> impl Iterator<Item = u64> {
        let seeds = self.effort.seed..self.effort.seed + self.effort.inputs;
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
            (0, None) if tried == 0 => not_evaluated("no triangle is in front of the viewer"),
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
        let fragment = self.original.stages.fragment;
        let is_linear = fragment.into_iter().flat_map(Stage::inputs).any(|io| {
            let linear = Some(Interpolation::Linear);
            matches!(io.binding, Some(naga::Binding::Location { interpolation, .. }) if interpolation == linear)
        });
        let mut random = Random::new(seed, "covered");
        let Some(Triangle { viewport, .. }) = Triangle::covering(
            positions(&corners)?,
            self.like.corners,
            drawn.center(),
            is_linear,
            &mut random,
        ) else {
            return Ok(Tried::Unseen);
        };
        drawn.entry.viewport = viewport;
        let single = self.shaded::<f32>(&inputs, &drawn, corners)?;
        let corners = self.corners::<f64>(&inputs, &drawn)?;
        let double = self.shaded::<f64>(&inputs, &drawn, corners)?;
        let (Some(single), Some(double)) = (single, double) else {
            return Ok(Tried::Same { is_compared: false });
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

    fn target(&self, slot: Slot) -> Option<&ColorTarget> {
        let Slot::Location(location, _) = slot else {
            return None;
        };
        let target = self.resolve.pass.targets.get(location as usize)?;
        target.as_ref()
    }

    /// The results of the original's vertex stage at the corners.
    fn corners<F: Float>(&self, inputs: &Inputs, drawn: &Drawn<'_>) -> Result<[Ran<F>; 3], Stuck> {
        let stage = self.original.stages.vertex;
        let module = stage.module();
        let resources = self.resources::<F>(inputs);
        let run = |corner| {
            let input = |io: &_| drawn.attribute(module, io, corner).map(|v| exactly(&v));
            let mut ran = self.run(inputs, &resources, stage, &input)?;
            // Kept vertices are stored in 32 bits.
            if self.kept.is_some() {
                for value in ran.outputs.values_mut() {
                    *value = value.map(&mut |scalar| {
                        Ok(match scalar {
                            Scalar::F32(x) => {
                                Scalar::F32(F::rounded(f64::from(x.exactly() as f32)))
                            }
                            other => other,
                        })
                    })?;
                }
            }
            Ok(ran)
        };
        Ok([run(0)?, run(1)?, run(2)?])
    }

    /// The author's resources.
    fn resources<F: Float>(&self, inputs: &Inputs) -> Resources<F> {
        let all = inputs.resources.iter();
        all.map(|(at, value)| (*at, exactly(value))).collect()
    }

    /// The author's resources, and those of a pass that reads the draw.
    fn resources_of<F: Float>(
        &self,
        inputs: &Inputs,
        drawn: &Drawn<'_>,
        (bindings, stage): (&[BindingUse], Stage<'_>),
        id: Id,
    ) -> Result<Resources<F>, Stuck> {
        let mut all = self.resources(inputs);
        let more = drawn.resources(bindings, stage.module(), id);
        all.extend(more.map_err(Stuck::Unsupported)?);
        Ok(all)
    }

    /// Runs a stage that has no derivatives.
    fn run<F: Float>(
        &self,
        inputs: &Inputs,
        resources: &Resources<F>,
        stage: Stage<'_>,
        input: &dyn Fn(&crate::core::reflect::Io) -> Option<Value<F>>,
    ) -> Result<Ran<F>, Stuck> {
        let environment = Environment {
            resources: Arc::new(resources.clone()),
            texture: &|lookup| inputs.texel(lookup),
            derivative: None,
            trace: None,
            steps: MORE_STEPS * self.effort.steps,
        };
        stage.run(input, &environment)
    }

    /// Runs a fragment stage of the author's geometry at the drawn pixel.
    fn rasterized<F: Float>(
        &self,
        (inputs, drawn): (&Inputs, &Drawn<'_>),
        triangle: &Triangle,
        corners: &[Ran<F>; 3],
        (stage, resources): (Stage<'_>, Resources<F>),
    ) -> Result<Ran<F>, Stuck> {
        Quad {
            stage,
            triangle,
            corners: corners.each_ref(),
            drawn,
            inputs,
            resources: Arc::new(resources),
            like: self.like,
            steps: self.effort.steps,
        }
        .run()
    }

    /// The colours of original and resolve; `None` if the fragment is discarded.
    fn shaded<F: Float>(
        &self,
        inputs: &Inputs,
        drawn: &Drawn<'_>,
        corners: [Ran<F>; 3],
    ) -> Result<Option<Shaded<F>>, Stuck> {
        let triangle = Triangle {
            corners: positions(&corners)?,
            viewport: drawn.entry.viewport,
            place: self.like.corners,
        };
        let Some(fragment) = self.original.stages.fragment else {
            return Ok(None);
        };
        let resources = self.resources(inputs);
        let of = (inputs, drawn);
        let mut original = self.rasterized(of, &triangle, &corners, (fragment, resources))?;
        if original.discarded {
            return Ok(None);
        }
        let Some(id) = self.id::<F>(of, &triangle)? else {
            return Ok(None);
        };
        let resolved = self.resolved(of, id)?;
        original
            .outputs
            .retain(|slot, _| self.target(*slot).is_some());
        Ok(Some(Shaded { original, resolved }))
    }

    /// The id that the id pass writes at the drawn pixel; `None` if it discards the fragment.
    fn id<F: Float>(
        &self,
        (inputs, drawn): (&Inputs, &Drawn<'_>),
        triangle: &Triangle,
    ) -> Result<Option<Id>, Stuck> {
        let missing = || Stuck::Type("the id pass writes no id".to_owned());
        let PassStages { vertex, fragment } = self.ids.stages;
        let fragment = fragment.ok_or_else(missing)?;
        let bindings = &self.ids.pass.bindings[..];
        let resources = self.resources_of::<F>(inputs, drawn, (bindings, vertex), [0; 4])?;
        let run = |corner: u32| {
            let input = |io: &crate::core::reflect::Io| {
                let slot = io.binding.as_ref().map(Slot::of);
                let is_index = slot == Some(Slot::BuiltIn(BuiltIn::VertexIndex));
                // Its vertices are not the mesh's.
                if is_index && self.ids.pass.geometry == Geometry::Unindexed {
                    return Some(Value::u32(3 * drawn.triangle + corner));
                }
                let value = drawn.attribute(vertex.module(), io, corner as usize);
                value.map(|v| exactly(&v))
            };
            self.run(inputs, &resources, vertex, &input)
        };
        let corners = [run(0)?, run(1)?, run(2)?];
        let of = (inputs, drawn);
        let ran = self.rasterized(of, triangle, &corners, (fragment, resources))?;
        if ran.discarded {
            return Ok(None);
        }
        let written = ran.outputs.get(&Slot::Location(0, None));
        let mut id = [0, 0, 0, 1];
        let parts = match written.ok_or_else(missing)? {
            Value::Composite(parts) => parts.clone(),
            one => vec![one.clone()],
        };
        for (to, part) in id.iter_mut().zip(parts) {
            let Scalar::U32(word) = part.scalar()? else {
                return Err(missing());
            };
            *to = word;
        }
        Ok(Some(id))
    }

    /// The resolve's result at the drawn pixel, which shows this id.
    fn resolved<F: Float>(
        &self,
        (inputs, drawn): (&Inputs, &Drawn<'_>),
        id: Id,
    ) -> Result<Ran<F>, Stuck> {
        let missing = || Stuck::Type("it has no fragment stage".to_owned());
        let stage = self.resolve.stages.fragment.ok_or_else(missing)?;
        let bindings = &self.resolve.pass.bindings[..];
        let mut resources = self.resources_of::<F>(inputs, drawn, (bindings, stage), id)?;
        if let Some((kept, compute)) = self.kept {
            let stored = self.stored((inputs, drawn), kept, compute)?;
            let at = vertices_at(bindings).ok_or_else(missing)?;
            resources.insert(at, stored);
        }
        let [x, y] = drawn.center();
        let position = [x, y, 0.0, 1.0].map(F::of);
        let input = |io: &crate::core::reflect::Io| {
            let slot = Slot::of(io.binding.as_ref()?);
            (slot == POSITION).then(|| Value::composite(&position))
        };
        self.run(inputs, &resources, stage, &input)
    }

    /// The buffer of kept vertices, after the three of the triangle were stored.
    fn stored<F: Float>(
        &self,
        (inputs, drawn): (&Inputs, &Drawn<'_>),
        stage: Stage<'_>,
        compute: &ComputePass,
    ) -> Result<Value<F>, Stuck> {
        let missing = || Stuck::Type("no buffer keeps its vertices".to_owned());
        let bindings = &compute.bindings[..];
        let mut resources = self.resources_of::<F>(inputs, drawn, (bindings, stage), [0; 4])?;
        let at = vertices_at(bindings).ok_or_else(missing)?;
        let entry = &drawn.entry;
        let stride: u32 = self
            .variant
            .vertex_buffers
            .iter()
            .map(|b| b.stride / 4)
            .sum();
        let length = stride * entry.vertices * entry.instances;
        resources.insert(at, words(&vec![0; length as usize]));
        for vertex in drawn.vertices {
            let before = (drawn.instance - entry.first_instance) * entry.vertices;
            let number = before + vertex;
            let input = |io: &crate::core::reflect::Io| match Slot::of(io.binding.as_ref()?) {
                Slot::BuiltIn(BuiltIn::WorkGroupId) => {
                    Some(words(&[number / compute.workgroup, 0, 0]))
                }
                Slot::BuiltIn(BuiltIn::LocalInvocationIndex) => {
                    Some(Value::u32(number % compute.workgroup))
                }
                _ => None,
            };
            let mut ran = self.run(inputs, &resources, stage, &input)?;
            resources.insert(at, ran.stored.remove(&at).ok_or_else(missing)?);
        }
        resources.remove(&at).ok_or_else(missing)
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

    /// Whether the resolve passes the depth test where the classifying pass read this id.
    fn is_classified(&self, (inputs, drawn): (&Inputs, &Drawn<'_>), id: Id) -> Result<bool, Stuck> {
        let missing = || Stuck::Type("no pass separates the draws".to_owned());
        let classify = self.classify.ok_or_else(missing)?;
        let stage = classify.stages.fragment.ok_or_else(missing)?;
        let bindings = &classify.pass.bindings[..];
        let resources = drawn.resources::<f32>(bindings, stage.module(), id);
        let resources = resources.map_err(Stuck::Unsupported)?;
        let [x, y] = drawn.center();
        let position = |_: &_| Some(Value::vector(&[x, y, 0.0, 1.0]));
        let written = self.run(inputs, &resources, stage, &position)?;
        if written.discarded {
            return Ok(false);
        }
        let depth = written.outputs.get(&Slot::BuiltIn(BuiltIn::FragDepth));
        let depth = depth.ok_or_else(missing)?.float()?;
        let stage = self.resolve.stages.vertex;
        let bindings = &self.resolve.pass.bindings[..];
        let resources = self.resources_of::<f32>(inputs, drawn, (bindings, stage), id)?;
        let vertex = |_: &_| Some(Value::u32(0));
        let vertex = self.run(inputs, &resources, stage, &vertex)?;
        let at = vertex
            .outputs
            .get(&POSITION)
            .ok_or_else(missing)?
            .floats()?;
        // The steps of a 16-bit depth.
        let step = |depth: f32| (depth * 65535.0).round();
        Ok(step(depth) == step(at[2] / at[3]))
    }

    fn found(&self, inputs: &Inputs, drawn: &Drawn<'_>, found: Difference) -> Counterexample {
        let vertex = PassStages {
            fragment: None,
            ..self.original.stages
        };
        let mut told = said(vertex, inputs, TestPoint::Inside);
        told.extend(drawn.said());
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

type Resources<F> = BTreeMap<(u32, u32), Value<F>>;

/// The clip-space positions of a triangle.
fn positions<F: Float>(corners: &[Ran<F>; 3]) -> Result<[[f64; 4]; 3], Stuck> {
    let mut all = [[0.0; 4]; 3];
    for (to, corner) in all.iter_mut().zip(corners) {
        let missing = || Stuck::Type("it has no position".to_owned());
        let position = corner
            .outputs
            .get(&POSITION)
            .ok_or_else(missing)?
            .floats()?;
        for (to, x) in to.iter_mut().zip(position) {
            *to = x.exactly();
        }
    }
    Ok(all)
}

/// The binding of kept vertices.
fn vertices_at(bindings: &[BindingUse]) -> Option<(u32, u32)> {
    let is_it = |b: &&BindingUse| {
        let part = GeometryPart::Vertices {
            buffer: String::new(),
        };
        matches!(&b.source, BindingSource::Geometry { part: p } if std::mem::discriminant(p) == std::mem::discriminant(&part))
    };
    bindings.iter().find(is_it).map(|b| (b.group, b.binding))
}

/// The scalars of a value.
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
