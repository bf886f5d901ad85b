//! Counts shaded fragments per covered pixel, alike on every adapter. The frame is drawn with its
//! own depth states, and each shaded fragment adds 1 to a float target. The result is also the
//! overdraw picture.
//!
//! The adapter's pipeline statistics would not do: software adapters count fragments before the
//! early depth test.

use naga::{Expression, Literal, ShaderStage};
use naga_edit::interface;
use preshade_geometry::visibility_buffer;
use preshade_passes::rebuild::color;
use preshade_plan::pass::Facts;
use preshade_plan::plan::{BindingSource, BindingUse, GpuPass, Phase, Plan, Role};
use preshade_plan::program::Program;
use preshade_plan::reflect;
use preshade_plan::state::{Blend, ColorTarget, CompareFunction, DepthDirection};
use serde::{Deserialize, Serialize};

use super::{Error, Session, counting};
use preshade_compiler::command::rewrite::discards;
use preshade_draw::render::{self, DepthImage, FrameSettings, Gpu, Prepared, SceneInputs};
use preshade_draw::scene::{DrawOrder, Frame};
use preshade_scenes::ShaderForm;

/// Replaces a pass's fragment stage while fragments are counted.
#[derive(Clone, Debug)]
pub enum CountProgram {
    /// Counts every fragment that passes the depth test. For materials that neither discard nor
    /// write depth.
    Constant,
    /// A program with the pass's discards, depth output and coverage alpha, which returns 1 at
    /// location 0 instead of a colour.
    Sliced {
        /// It has both stages.
        program: Program,
        /// Vertex entry point; the same position bits as the pass's own.
        vertex: String,
        fragment: String,
    },
}

/// How often each pixel was shaded.
#[derive(Clone, Debug, PartialEq)]
pub struct Shading {
    /// Fragments shaded in opaque main passes. With MSAA these are samples: a fragment that covers
    /// three samples counts three times.
    pub fragments: u64,
    /// Pixels (samples, under MSAA) with at least one.
    pub covered: u64,
    /// Count of each sample, laid out as in [`DepthImage::values`].
    pub counts: DepthImage,
}

/// [`Shading`] as it is reported.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ShadingSummary {
    /// Under MSAA, samples.
    pub fragments: u64,
    /// Under MSAA, samples.
    pub covered: u64,
    /// Fragments a covered pixel: 1.00 is the least there can be. 0 where nothing is covered.
    pub per_pixel: f64,
}

impl Shading {
    fn of(counts: DepthImage) -> Self {
        Self {
            fragments: counts.values.iter().map(|v| f64::from(*v)).sum::<f64>() as u64,
            covered: counts.values.iter().filter(|v| **v > 0.0).count() as u64,
            counts,
        }
    }

    /// The figures without the picture.
    pub fn summary(&self) -> ShadingSummary {
        ShadingSummary {
            fragments: self.fragments,
            covered: self.covered,
            per_pixel: match self.covered {
                0 => 0.0,
                n => self.fragments as f64 / n as f64,
            },
        }
    }
}

/// A frame whose main passes add 1 instead of shading.
#[derive(Debug)]
pub struct Counter<'a> {
    prepared: Prepared<'a>,
    /// For ties: the fragments that the original draws.
    passed: Option<Prepared<'a>>,
}

impl<'a> Counter<'a> {
    /// Prepares counting the fragments of the opaque main passes. `count` makes the counting stage
    /// of a pass. Earlier passes are drawn as they are, blended draws are left out.
    pub fn shaded(
        inputs: &'a SceneInputs<'a>,
        plans: &[Plan],
        form: ShaderForm,
        count: impl Fn(&Plan, &GpuPass) -> CountProgram,
    ) -> Result<Self, Error> {
        let format = count_format(inputs.gpu(), plans);
        let plans = plans
            .iter()
            .map(|plan| Ok(every_late_fragment(counting_plan(plan, format, &count)?)))
            .collect::<Result<Vec<_>, Error>>()?;
        Ok(Self {
            prepared: Self::prepare(inputs, &plans, form)?,
            passed: None,
        })
    }

    /// Prepares counting depth ties: fragments that share the winning depth of their pixel. One
    /// fragment at the cleared depth is a tie too. `plans` are the original ones, drawn first with
    /// their own state, then with EQUAL.
    pub fn ties(
        inputs: &'a SceneInputs<'a>,
        plans: &[Plan],
        form: ShaderForm,
        discarded: Discarded,
        count: impl Fn(&Plan, &GpuPass) -> CountProgram,
    ) -> Result<Self, Error> {
        let format = count_format(inputs.gpu(), plans);
        let passed = Self::shaded(inputs, plans, form, &count)?.prepared;
        let plans = plans
            .iter()
            .map(|original| {
                let mut plan = counting_plan(original, format, &count)?;
                let counted = match discarded {
                    Discarded::LeftOut => plan.passes.clone(),
                    Discarded::Counted => {
                        let all = counting_plan(original, format, &|_: &Plan, _: &GpuPass| {
                            CountProgram::Constant
                        })?;
                        let key = |key: &str| format!("{key}-all");
                        plan.programs
                            .extend(all.programs.into_iter().map(|(k, p)| (key(&k), p)));
                        let rename = |mut pass: GpuPass| {
                            pass.program = key(&pass.program);
                            pass
                        };
                        all.passes.into_iter().map(rename).collect()
                    }
                };
                plan.passes = plan
                    .passes
                    .iter()
                    .zip(counted)
                    .flat_map(|(pass, mut equal)| {
                        let mut depth_only = pass.clone();
                        depth_only.phase = Phase::Depth;
                        for target in depth_only.targets.iter_mut().flatten() {
                            target.write_mask = 0;
                        }
                        if let Some(depth) = &mut equal.depth {
                            depth.compare = CompareFunction::Equal;
                            depth.write = false;
                        }
                        [depth_only, equal]
                    })
                    .collect();
                Ok(plan)
            })
            .collect::<Result<Vec<_>, Error>>()?;
        Ok(Self {
            prepared: Self::prepare(inputs, &plans, form)?,
            passed: Some(passed),
        })
    }

    fn prepare(
        inputs: &'a SceneInputs<'a>,
        plans: &[Plan],
        form: ShaderForm,
    ) -> Result<Prepared<'a>, Error> {
        let variant = preshade_scenes::variant(plans, form)?;
        let settings = FrameSettings {
            clear_color: [0.0; 4],
            initial_colors: false,
        };
        Ok(Prepared::new(inputs, &variant, &settings)?.keeping_samples())
    }

    /// Counts in one frame. Uniforms are those last set by [`SceneInputs::set_frame`].
    pub fn count(&mut self, frame: &Frame, order: DrawOrder) -> Result<Shading, Error> {
        Ok(Shading::of(counted(&mut self.prepared, frame, order)?))
    }

    /// Number of depth ties, for a counter made by [`Counter::ties`]: samples counted twice or
    /// more, or once where the original draws nothing.
    pub fn ties_in(&mut self, frame: &Frame, order: DrawOrder) -> Result<u64, Error> {
        let equal = counted(&mut self.prepared, frame, order)?.values;
        let passed = match &mut self.passed {
            Some(passed) => counted(passed, frame, order)?.values,
            None => Vec::new(),
        };
        let is_tie = |(i, n): &(usize, &f32)| {
            let most = passed.get(*i).map_or(1.0, |p| p.min(1.0));
            **n > most
        };
        Ok(equal.iter().enumerate().filter(is_tie).count() as u64)
    }
}

/// The counts of a frame, by sample.
fn counted(
    prepared: &mut Prepared<'_>,
    frame: &Frame,
    order: DrawOrder,
) -> Result<DepthImage, Error> {
    prepared.aim(frame, order);
    Ok(prepared.render_red()?.unwrap_or(DepthImage {
        size: [0, 0],
        samples: 1,
        values: Vec::new(),
    }))
}

/// Measures the facts that passes need: depth ties over every frame of every camera, pixels at the
/// near plane, vertices per fragment, and the adapter's rasteriser. That a made-up scene has no ties
/// and no such pixels is no evidence.
pub fn facts(session: &Session<'_>) -> Result<Facts, Error> {
    let (ties, undiscarded) = depth_ties(session)?;
    // The real scene may have ties where a made-up one has none.
    let evidence = |n: &u64| *n > 0 || !session.scene().is_made_up;
    Ok(Facts {
        depth_ties: Some(ties).filter(evidence),
        undiscarded_depth_ties: Some(undiscarded).filter(evidence),
        near_plane_pixels: near_plane_pixels(session)?.filter(evidence),
        vertices_per_fragment: vertices_per_fragment(session)?,
        // If an adapter's rasteriser cannot be tested, the usual one is assumed.
        rasterizer: Error::unless_lost(super::rasterizer(session.gpu()))?,
        ..super::known(session.scene())
    })
}

/// [`facts`] for a choice that is shipped: if the scene was made smaller, depth ties are counted at
/// its own size too. A smaller picture has fewer pixels in which surfaces can tie.
pub fn facts_for_choice(session: &Session<'_>) -> Result<Facts, Error> {
    let facts = facts(session)?;
    let scene = session.scene();
    let pixels = |size: [u32; 2]| size.map(u64::from).iter().product::<u64>();
    let larger = scene
        .own_size
        .filter(|own| pixels(*own) > pixels(scene.size));
    let Some(own) = larger.filter(|_| !scene.is_made_up) else {
        return Ok(facts);
    };
    let whole = scene.clone().resized(own);
    let (ties, undiscarded) = depth_ties(&Session::new(session.gpu(), &whole, session.form())?)?;
    let most = |here: Option<u64>, there: u64| here.map(|n| n.max(there));
    Ok(Facts {
        depth_ties: most(facts.depth_ties, ties),
        undiscarded_depth_ties: most(facts.undiscarded_depth_ties, undiscarded),
        ..facts
    })
}

/// Depth ties over every frame of every camera, without and with the fragments that are discarded.
fn depth_ties(session: &Session<'_>) -> Result<(u64, u64), Error> {
    let (inputs, plans, form) = (session.inputs(), session.originals(), session.form());
    let counter = |discarded| Counter::ties(inputs, plans, form, discarded, counting);
    let mut kept = counter(Discarded::LeftOut)?;
    // Where nothing is discarded both are the same.
    let mut all = match plans.iter().any(discards) {
        true => Some(counter(Discarded::Counted)?),
        false => None,
    };
    let (mut ties, mut undiscarded) = (0, 0);
    for (_, frame) in session.scene().frames() {
        inputs.set_frame(frame)?;
        let here = kept.ties_in(frame, DrawOrder::AsGiven)?;
        ties += here;
        undiscarded += match &mut all {
            Some(all) => all.ties_in(frame, DrawOrder::AsGiven)?,
            None => here,
        };
    }
    Ok((ties, undiscarded))
}

/// Vertices of the scene's draws per shaded fragment in the first frame of every camera, each index
/// once. `None`: no camera sees anything.
fn vertices_per_fragment(session: &Session<'_>) -> Result<Option<f64>, Error> {
    let (scene, inputs) = (session.scene(), session.inputs());
    let vertices: f64 = scene
        .draws
        .iter()
        .filter_map(|d| {
            Some(f64::from(scene.meshes.get(d.mesh)?.vertex_count) * f64::from(d.instances))
        })
        .sum();
    let mut counter = Counter::shaded(inputs, session.originals(), session.form(), counting)?;
    let (mut shaded, mut frames) = (0.0, 0.0);
    for frame in scene.cameras.iter().filter_map(|c| c.frames.first()) {
        inputs.set_frame(frame)?;
        shaded += counter.count(frame, DrawOrder::AsGiven)?.fragments as f64;
        frames += 1.0;
    }
    // Samples are counted; a fragment is shaded once for all of its own.
    let fragments = shaded / f64::from(scene.samples.max(1));
    Ok((fragments > 0.0).then(|| vertices * frames / fragments))
}

/// Pixels of the original at the depth of the near plane, in the first frame of every camera.
fn near_plane_pixels(session: &Session<'_>) -> Result<Option<u64>, Error> {
    let scene = session.scene();
    let near = match scene.depth_direction {
        DepthDirection::Forward => 0.0,
        DepthDirection::Reversed => 1.0,
    };
    let mut prepared = session.prepare(session.originals())?;
    let mut pixels = 0;
    for frame in scene.cameras.iter().filter_map(|c| c.frames.first()) {
        let Some(depth) = session
            .draw(&mut prepared, frame, DrawOrder::AsGiven)?
            .depth
        else {
            return Ok(None);
        };
        pixels += depth.values.iter().filter(|d| **d == near).count() as u64;
    }
    Ok(Some(pixels))
}

/// Whether fragments that a material discards count as tying.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Discarded {
    LeftOut,
    /// All, as if nothing were discarded.
    Counted,
}

/// A float format with exact additive blending: to 2^24 if the adapter blends 32-bit floats,
/// otherwise to 2^11. Alpha to coverage needs an alpha channel, which only a 16-bit format has with
/// several samples.
pub(super) fn count_format(gpu: &Gpu, plans: &[Plan]) -> &'static str {
    let mut passes = plans.iter().flat_map(|p| &p.passes);
    if passes.any(|p| p.multisample.alpha_to_coverage) {
        return "rgba16float";
    }
    match gpu.require("counting", "float32-blendable") {
        Ok(()) => "r32float",
        Err(_) => "r16float",
    }
}

/// A stage that writes depth runs before its depth test, so it is counted whenever it is drawn. A
/// second pass then writes its depth.
fn every_late_fragment(mut plan: Plan) -> Plan {
    plan.passes = plan
        .passes
        .iter()
        .flat_map(|pass| {
            if pass.role != Role::Main || !writes_depth(&plan, pass) {
                return vec![pass.clone()];
            }
            let mut counted = pass.clone();
            if let Some(depth) = &mut counted.depth {
                depth.compare = CompareFunction::Always;
                depth.write = false;
            }
            let mut tested = pass.clone();
            for target in tested.targets.iter_mut().flatten() {
                target.write_mask = 0;
            }
            vec![counted, tested]
        })
        .collect();
    plan
}

/// Whether the fragment stage of a pass writes its depth.
pub(crate) fn writes_depth(plan: &Plan, pass: &GpuPass) -> bool {
    let entry = plan
        .program(pass)
        .zip(pass.fragment.as_deref())
        .and_then(|(p, f)| Some((p.module(), p.entry_point(ShaderStage::Fragment, f)?.1)));
    entry.is_some_and(|(module, entry)| {
        let depth = Some(naga::Binding::BuiltIn(naga::BuiltIn::FragDepth));
        let outputs = interface::outputs(module, &entry.function);
        outputs.iter().any(|o| o.binding == depth)
    })
}

/// The plan with every opaque main pass counting instead of shading, and no other colour.
pub(super) fn counting_plan(
    plan: &Plan,
    format: &str,
    count: &impl Fn(&Plan, &GpuPass) -> CountProgram,
) -> Result<Plan, Error> {
    let mut out = plan.clone();
    out.passes.clear();
    for pass in &plan.passes {
        if pass.phase == Phase::Blended {
            continue;
        }
        let mut pass = pass.clone();
        // A pre-pass under alpha to coverage keeps a colour target, for its alpha's sake.
        let covers = pass.multisample.alpha_to_coverage.then(|| {
            Some(ColorTarget {
                write_mask: 0,
                ..ColorTarget::opaque(format)
            })
        });
        // A pre-pass that draws to an attachment of its own still does.
        let is_own = |t: &ColorTarget| t.attachment.is_some();
        pass.targets.retain(|t| t.as_ref().is_some_and(is_own));
        pass.targets.extend(covers);
        if pass.role.shades() && pass.fragment.is_some() {
            let key = format!("count-{}", out.passes.len());
            let (program, vertex, fragment) = match count(plan, &pass) {
                CountProgram::Sliced {
                    program,
                    vertex,
                    fragment,
                } => (program, vertex, fragment),
                CountProgram::Constant => {
                    let program = plan.program(&pass).ok_or_else(|| render::Error::Plan {
                        material: plan.material.clone(),
                        message: format!("it has no program `{}`", pass.program),
                    })?;
                    let (program, fragment) = constant(plan, program)?;
                    (program, pass.vertex.clone(), fragment)
                }
            };
            pass.program = key.clone();
            pass.vertex = vertex;
            pass.fragment = Some(fragment);
            pass.targets = vec![Some(ColorTarget {
                blend: Some(Blend::ADD),
                ..ColorTarget::opaque(format)
            })];
            reflect::fill(&mut pass, &program);
            out.programs.insert(key, program);
        }
        out.passes.push(pass);
    }
    // A pass over the same pixels counts for a compute pass.
    for compute in std::mem::take(&mut out.compute) {
        let shades = |b: &BindingUse| matches!(b.source, BindingSource::SceneColor { .. });
        if !compute.bindings.iter().any(shades) {
            out.compute.push(compute);
            continue;
        }
        let (mut pass, program) =
            visibility_buffer::counted(plan, &compute).map_err(|message| render::Error::Plan {
                material: plan.material.clone(),
                message,
            })?;
        pass.targets = vec![Some(ColorTarget {
            blend: Some(Blend::ADD),
            ..ColorTarget::opaque(format)
        })];
        out.passes.retain(|p| p.role != Role::Clear);
        out.programs.insert(pass.program.clone(), program);
        out.passes.push(pass);
    }
    Ok(out)
}

/// `program` with one more fragment stage, which returns 1.
fn constant(plan: &Plan, program: &Program) -> Result<(Program, String), Error> {
    let mut module = program.module().clone();
    let mut name = "preshade_count".to_owned();
    while module.entry_points.iter().any(|e| e.name == name) {
        name.push('_');
    }
    let entry = module.entry_points.len();
    module.entry_points.push(color::empty_fragment(&name));
    color::return_color(&mut module, entry, ["", ""], None, &mut |writer, _, _| {
        let value = writer.expression(Expression::Literal(Literal::F32(1.0)));
        let size = naga::VectorSize::Quad;
        Some((writer.expression(Expression::Splat { size, value }), None))
    });
    let program = program
        .with_module(module)
        .map_err(|e| render::Error::Plan {
            material: plan.material.clone(),
            message: format!("its counting program is invalid: {e}"),
        })?;
    Ok((program, name))
}
