//! Runs the passes of a visibility buffer for a made-up draw, one after the other.

use std::collections::BTreeMap;
use std::sync::Arc;

use naga::{BuiltIn, Interpolation, ShaderStage};

use super::Effort;
use super::environment::PassStages;
use super::inputs::Inputs;
use super::levels::{Levels, Reading};
use super::made_up_draw::{Drawn, Id, words};
use super::promise::{effort, stages};
use super::quad::{Float, Quad, Triangle};
use super::stage::{self, POSITION, Ran, Slot, Stage};
use naga_edit::interface::Io;
use naga_interp::bound::exactly;
use naga_interp::{Environment, Scalar, Stuck, Value};
use preshade_geometry::visibility_buffer;
use preshade_plan::geometry::Geometry;
use preshade_plan::plan::{
    BindingSource, BindingUse, ComputePass, GeometryPart, GpuPass, Plan, Role,
};
use preshade_plan::program::Program;
use preshade_plan::rasterizer::Rasterizer;
use preshade_plan::state::ColorTarget;

/// The resolve runs three vertices and several pixels in one invocation.
const MORE_STEPS: u64 = 16;

/// Whether the resolve's check runs a compute pass.
pub(super) fn runs(plan: &Plan, pass: &ComputePass) -> bool {
    pass.geometry == Geometry::Vertices && plan.passes.iter().any(|p| p.role == Role::Resolve)
}

#[derive(Clone, Copy)]
pub(super) struct Staged<'a> {
    pub(super) pass: &'a GpuPass,
    pub(super) stages: PassStages<'a>,
}

/// The passes of a split material.
pub(super) struct Split<'a> {
    pub(super) variant: &'a Plan,
    pub(super) original: Staged<'a>,
    ids: Staged<'a>,
    classify: Option<Staged<'a>>,
    pub(super) resolve: Staged<'a>,
    /// The stage that stores vertices.
    kept: Option<(Stage<'a>, &'a ComputePass)>,
    pub(super) like: Rasterizer,
    pub(super) effort: Effort,
}

/// The results at a covered pixel.
pub(super) struct Shaded<F> {
    pub(super) original: Ran<F>,
    pub(super) resolved: Ran<F>,
}

impl<'a> Split<'a> {
    pub(super) fn new(
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

    pub(super) fn inputs(&self, seed: u64) -> Inputs {
        let module = self.original.stages.vertex.module();
        let levels = Arc::new(Levels::all(Reading::Level));
        Inputs::new(module, self.variant.guard.as_ref(), seed).with_levels(&levels)
    }

    pub(super) fn drawn<'d>(&'d self, inputs: &'d Inputs) -> Drawn<'d> {
        let cull = self.original.pass.primitive.cull;
        Drawn::new(
            inputs,
            self.original.stages.vertex,
            self.variant,
            cull,
            false,
        )
    }

    /// Whether a varying is interpolated without perspective.
    pub(super) fn is_linear(&self) -> bool {
        let fragment = self.original.stages.fragment.into_iter();
        let mut kinds = fragment
            .flat_map(Stage::inputs)
            .filter_map(|io| stage::kind(io.binding.as_ref()?));
        kinds.any(|(interpolation, _)| interpolation == Interpolation::Linear)
    }

    /// The target of an output.
    pub(super) fn target(&self, slot: Slot) -> Option<&ColorTarget> {
        let Slot::Location(location, _) = slot else {
            return None;
        };
        let target = self.resolve.pass.targets.get(location as usize)?;
        target.as_ref()
    }

    /// The results of the original's vertex stage at the corners.
    pub(super) fn corners<F: Float>(
        &self,
        inputs: &Inputs,
        drawn: &Drawn<'_>,
    ) -> Result<[Ran<F>; 3], Stuck> {
        let stage = self.original.stages.vertex;
        let module = stage.module();
        let resources = self.resources::<F>(inputs);
        let run = |corner| {
            let input = |io: &_| drawn.attribute(module, io, corner).map(|v| exactly(&v));
            let mut ran = self.run(inputs, &resources, stage, &input)?;
            // The buffer of vertices holds 32 bits a number.
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
        input: &dyn Fn(&Io) -> Option<Value<F>>,
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
    pub(super) fn shaded<F: Float>(
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
            let input = |io: &Io| {
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
    pub(super) fn resolved<F: Float>(
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
        let input = |io: &Io| {
            let slot = Slot::of(io.binding.as_ref()?);
            (slot == POSITION).then(|| Value::composite(&position))
        };
        self.run(inputs, &resources, stage, &input)
    }

    /// The buffer of vertices after the compute pass stored the three of the triangle.
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
            let input = |io: &Io| match Slot::of(io.binding.as_ref()?) {
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

    /// Whether the resolve passes the depth test where the classifying pass read this id.
    pub(super) fn is_classified(
        &self,
        (inputs, drawn): (&Inputs, &Drawn<'_>),
        id: Id,
    ) -> Result<bool, Stuck> {
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
}

type Resources<F> = BTreeMap<(u32, u32), Value<F>>;

/// The clip-space positions of a triangle.
pub(super) fn positions<F: Float>(corners: &[Ran<F>; 3]) -> Result<[[f64; 4]; 3], Stuck> {
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

/// The binding of the buffer of vertices.
fn vertices_at(bindings: &[BindingUse]) -> Option<(u32, u32)> {
    let is_it = |b: &&BindingUse| {
        let part = match &b.source {
            BindingSource::Geometry { part } => part,
            _ => return false,
        };
        matches!(part, GeometryPart::Vertices { .. })
    };
    bindings.iter().find(is_it).map(|b| (b.group, b.binding))
}
