//! The shares of a view's time, by experiment: one kind of work after the other is left out, and
//! the frame is timed against the original.
//!
//! A part is the time that the frame is shorter by, over its time. Work that runs side by side on
//! the adapter overlaps, so parts need not add up to 1.

use std::collections::BTreeMap;
use std::sync::Arc;

use preshade_passes::rebuild::count;
use preshade_plan::plan::{BindingKind, BindingUse, GpuPass, Plan};
use preshade_plan::program::Program;
use preshade_plan::reflect;
use preshade_plan::state::{CompareFunction, StencilOperation};
use serde::Serialize;

use super::{Clock, Error, Estimate, Session, Timing, TimingSettings, View, check_seen, time};
use preshade_draw::render::{AdapterReport, Gpu, Prepared};
use preshade_draw::scene::bind::TextureContent;
use preshade_draw::scene::{Frame, Image, Scene};
use preshade_scenes::ShaderForm;

/// Version of the JSON that [`Profile`] serialises to.
pub(crate) const SCHEMA: &str = "preshade.profile.v1";

/// Where the time of a scene's views goes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Profile {
    pub schema: String,
    pub scene: String,
    /// The part of a captured frame that it is, with its share of the frame's time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub part: Option<String>,
    /// Width and height, in pixels.
    pub resolution: [u32; 2],
    /// The command that measured it.
    pub command: String,
    pub adapter: AdapterReport,
    pub views: Vec<ViewProfile>,
}

/// Where the time of one view goes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ViewProfile {
    #[serde(flatten)]
    pub view: View,
    pub clock: Clock,
    /// Milliseconds a frame.
    pub time_ms: Estimate,
    /// The part of the pass itself and its draw calls: the rest, if each draws one triangle that
    /// fails the depth test. The attachments are cleared, resolved and stored all the same. `None`:
    /// a pass without depth.
    pub draws: Option<Estimate>,
    /// The part of all further vertices and triangles.
    pub vertices: Option<Estimate>,
    /// The materials with the largest parts, largest first.
    pub materials: Vec<MaterialProfile>,
    /// Materials whose fragments, or whose decisions about coverage, could not be left out. No part
    /// has that time.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub kept: Vec<String>,
}

/// The time that the fragments of one material take.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MaterialProfile {
    pub material: String,
    pub draws: usize,
    /// The part of its fragments, except decisions about coverage: it still writes depth, but no
    /// colour. A driver that compiles both stages together also leaves out the vertex stage's work
    /// for them. If the fragment stage writes depth, it is the part of the whole stage.
    pub fragments: Estimate,
    /// The part of decisions about coverage, a discard for example. It is at least this: the frame
    /// draws the parts that the material hid. `None`: nothing decides, or it was not measured
    /// separately.
    pub coverage: Option<Estimate>,
    /// The part of its textures' texels: their time beyond one texel each. `None`: they decide
    /// coverage, or the vertex stage reads them.
    pub textures: Option<Estimate>,
    /// The part of the rest of its fragment stage, except discards. `None`: not measured
    /// separately.
    pub arithmetic: Option<Estimate>,
    /// The part of writing its colours.
    pub fill: Option<Estimate>,
}

impl ViewProfile {
    /// The largest part, with its name. `None`: none is above 0 beyond noise.
    pub fn bound_by(&self) -> Option<(String, Estimate)> {
        let frame = [
            ("the pass and its draw calls", self.draws),
            ("vertices", self.vertices),
        ];
        let frame = frame.map(|(what, part)| (what.to_owned(), part));
        let materials = self.materials.iter().flat_map(|m| {
            let whole = m.arithmetic.is_none() && m.fill.is_none();
            let parts = [
                ("fragments", whole.then_some(m.fragments)),
                ("the discards", m.coverage),
                ("arithmetic", m.arithmetic),
                ("textures", m.textures),
                ("fill", m.fill),
            ];
            parts.map(|(what, part)| (format!("{what} of `{}`", m.material), part))
        });
        let all = frame.into_iter().chain(materials);
        all.filter_map(|(what, part)| Some((what, part?)))
            .filter(|(_, part)| part.low > 0.0)
            .max_by(|a, b| a.1.median.total_cmp(&b.1.median))
    }
}

/// Most materials whose fragments are left out one after the other.
const LOOKED_AT: usize = 32;

/// Most materials whose parts are measured separately.
const TOLD_APART: usize = 6;

/// Profiles the first frame of each camera, in the scene's first order.
///
/// # Errors
/// The original cannot be drawn or timed, or the adapter is lost.
pub fn profile(
    gpu: &Gpu,
    scene: &Scene,
    timing: &TimingSettings,
    command: &str,
) -> Result<Profile, Error> {
    let session = Session::new(gpu, scene, ShaderForm::Text)?;
    let all = View::all(scene, 1);
    let first = all.first().map(|(view, _)| view.order);
    let views = all.into_iter().filter(|(v, _)| Some(v.order) == first);
    let views: Vec<(View, &Frame)> = views.collect();
    let frames: Vec<_> = views.iter().map(|(v, frame)| (*frame, v.order)).collect();
    check_seen(&session, &frames)?;
    Ok(Profile {
        schema: SCHEMA.to_owned(),
        scene: scene.name.clone(),
        part: scene.part.clone(),
        resolution: scene.size,
        command: command.to_owned(),
        adapter: gpu.adapter().clone(),
        views: views
            .into_iter()
            .map(|(view, frame)| profiled(&session, (view, frame), timing))
            .collect::<Result<_, _>>()?,
    })
}

fn profiled(
    session: &Session<'_>,
    (view, frame): (View, &Frame),
    timing: &TimingSettings,
) -> Result<ViewProfile, Error> {
    let originals = session.originals();
    let aimed = |session: &Session<'_>| session.inputs().set_frame(frame);
    aimed(session)?;
    let mut frames = Frames::new(session, frame, &view);
    frames.add(Some(originals.to_vec()))?;
    let untested: Option<Vec<Plan>> = originals.iter().map(gone).collect();
    frames.add(untested.clone())?;
    frames.add_with(untested, Prepared::one_triangle_a_draw)?;
    let scene = session.scene();
    let draws = |material: usize| {
        scene
            .draws
            .iter()
            .filter(|d| d.material == material)
            .count()
    };
    let looked_at: Vec<usize> = (0..originals.len())
        .filter(|m| draws(*m) > 0)
        .take(LOOKED_AT)
        .collect();
    for m in &looked_at {
        frames.add(with(originals, *m, depth_only))?;
        let decides = decides(&originals[*m]);
        frames.add(decides.then(|| with(originals, *m, gone)).flatten())?;
    }
    let (clock, times) = frames.time(timing)?;
    let mut parts = times.iter().skip(1).map(|t| t.as_ref().map(part));
    let mut next = || parts.next().flatten();
    let (fragments, all) = (next(), next());
    let mut found: Vec<(usize, Estimate, Option<Estimate>)> = Vec::new();
    let mut kept = Vec::new();
    for m in looked_at {
        let (colors, gone) = (next(), next());
        let coverage = gone.zip(colors).map(|(gone, colors)| less(gone, colors));
        found.extend(colors.or(gone).map(|part| (m, part, coverage)));
        if gone.is_none() && (colors.is_none() || decides(&originals[m])) {
            kept.push(originals[m].material.clone());
        }
    }
    let whole = |(_, part, coverage): &(usize, Estimate, Option<Estimate>)| {
        part.median + coverage.map_or(0.0, |c| c.median)
    };
    found.sort_by(|a, b| whole(b).total_cmp(&whole(a)));
    found.truncate(TOLD_APART);
    let mut materials = Vec::new();
    for (m, fragments, coverage) in found {
        let [flat, still] = told_apart(session, m, (&view, frame), timing)?;
        materials.push(MaterialProfile {
            material: originals[m].material.clone(),
            draws: draws(m),
            fragments,
            coverage,
            textures: still,
            arithmetic: flat.map(|flat| still.map_or(flat, |still| less(flat, still))),
            fill: flat.map(|flat| less(fragments, flat)),
        });
    }
    aimed(session)?;
    let time_ms = match times.into_iter().next().flatten() {
        Some(original) => original.time.estimate,
        None => return Err(Error::Clock),
    };
    let whole = Estimate {
        median: 1.0,
        low: 1.0,
        high: 1.0,
    };
    Ok(ViewProfile {
        view,
        clock,
        time_ms,
        draws: all.map(|all| less(whole, all)),
        vertices: all.zip(fragments).map(|(all, f)| less(all, f)),
        materials,
        kept,
    })
}

/// The parts of a material's fragment stage, and of its textures.
fn told_apart(
    session: &Session<'_>,
    material: usize,
    (view, frame): (&View, &Frame),
    timing: &TimingSettings,
) -> Result<[Option<Estimate>; 2], Error> {
    let is_texel =
        |b: &BindingUse| matches!(b.kind, BindingKind::Texture | BindingKind::DepthTexture);
    let in_vertex = |b: &BindingUse| is_texel(b) && b.visibility.vertex;
    let plan = &session.originals()[material];
    let mut bindings = plan.passes.iter().flat_map(|pass| &pass.bindings);
    let is_needed = bindings.any(in_vertex) || decides(plan);
    let scene = (!is_needed).then(|| small_textures(session.scene(), material));
    let small = scene.as_ref();
    let small = small.map(|scene| Session::new(session.gpu(), scene, session.form()));
    let small = small.transpose()?;
    session.inputs().set_frame(frame)?;
    let originals = session.originals();
    let mut frames = Frames::new(session, frame, view);
    frames.add(Some(originals.to_vec()))?;
    frames.add(with(originals, material, flat))?;
    if let Some(small) = &small {
        small.inputs().set_frame(frame)?;
        let mut still = Frames::new(small, frame, view);
        still.add(Some(small.originals().to_vec()))?;
        frames.prepared.extend(still.prepared);
    }
    let (_, times) = frames.time(timing)?;
    let part_of = |i: usize| times.get(i)?.as_ref().map(part);
    Ok([part_of(1), part_of(2)])
}

/// Frames to be timed together. `None`: one that the adapter does not draw.
struct Frames<'s> {
    session: &'s Session<'s>,
    frame: &'s Frame,
    view: &'s View,
    prepared: Vec<Option<Prepared<'s>>>,
}

impl<'s> Frames<'s> {
    fn new(session: &'s Session<'s>, frame: &'s Frame, view: &'s View) -> Self {
        Self {
            session,
            frame,
            view,
            prepared: Vec::new(),
        }
    }

    fn add(&mut self, plans: Option<Vec<Plan>>) -> Result<(), Error> {
        self.add_with(plans, |prepared| prepared)
    }

    /// Adds a frame. The first must be drawn.
    fn add_with(
        &mut self,
        plans: Option<Vec<Plan>>,
        change: fn(Prepared<'s>) -> Prepared<'s>,
    ) -> Result<(), Error> {
        let Some(plans) = plans else {
            self.prepared.push(None);
            return Ok(());
        };
        let is_first = self.prepared.is_empty();
        let prepared = match self.session.prepare(&plans).map(change) {
            Ok(mut prepared) => {
                prepared.aim(self.frame, self.view.order);
                Some(prepared)
            }
            Err(error) if is_first || error.is_lost() => {
                return Err(error.into());
            }
            Err(_) => None,
        };
        self.prepared.push(prepared);
        Ok(())
    }

    fn time(&self, timing: &TimingSettings) -> Result<(Clock, Vec<Option<Timing>>), Error> {
        let ready: Vec<&Prepared<'_>> = self.prepared.iter().flatten().collect();
        let (clock, times) = time(self.session.gpu(), &ready, timing, |_| {})?;
        let mut times = times.into_iter();
        let each = self.prepared.iter();
        Ok((
            clock,
            each.map(|p| p.as_ref().and_then(|_| times.next()))
                .collect(),
        ))
    }
}

/// The part of the original's time that a frame is shorter by.
fn part(timing: &Timing) -> Estimate {
    let of = |speedup: f64| 1.0 - 1.0 / speedup;
    let speedup = timing.speedup;
    Estimate {
        median: of(speedup.median),
        low: of(speedup.low),
        high: of(speedup.high),
    }
}

/// A part without another one. The interval is the widest that the two allow.
fn less(of: Estimate, without: Estimate) -> Estimate {
    Estimate {
        median: of.median - without.median,
        low: of.low - without.high,
        high: of.high - without.low,
    }
}

/// The plans, one of them changed. `None`: it cannot be.
fn with(plans: &[Plan], material: usize, change: fn(&Plan) -> Option<Plan>) -> Option<Vec<Plan>> {
    let mut plans = plans.to_vec();
    plans[material] = change(&plans[material])?;
    Some(plans)
}

/// Whether a discard, a depth or an alpha decides where a material draws.
fn decides(plan: &Plan) -> bool {
    plan.passes.iter().any(|pass| decides_in(plan, pass))
}

fn decides_in(plan: &Plan, pass: &GpuPass) -> bool {
    plan.program(pass).is_some_and(|p| count::decides(p, pass))
}

/// The plan with no fragment that passes the depth test, or is shaded. `None`: a pass does not test depth, or its
/// fragments do more than to draw.
fn gone(plan: &Plan) -> Option<Plan> {
    let mut out = plan.clone();
    for (pass, authored) in out.passes.iter_mut().zip(&plan.passes) {
        let stores = authored.bindings.iter().any(|b| b.kind.is_writable());
        let faces = authored.stencil.iter().flat_map(|s| [&s.front, &s.back]);
        let mut fails = faces.map(|face| face.depth_fail);
        if stores || fails.any(|f| f != StencilOperation::Keep) {
            return None;
        }
        let depth = pass.depth.as_mut()?;
        depth.compare = CompareFunction::Never;
        depth.write = false;
        // An adapter may test depth after such a fragment stage, so it has to go.
        if decides_in(plan, authored) {
            let program = count::nothing(plan, authored).ok()?;
            replace(pass, program, &mut out.programs);
            mask(pass);
        }
    }
    Some(out)
}

/// Draws a pass with the blank fragment stage of `program`.
fn replace(pass: &mut GpuPass, program: Program, programs: &mut BTreeMap<String, Program>) {
    let name = format!("blank-{}", programs.len());
    pass.program.clone_from(&name);
    pass.fragment = Some(count::ENTRY.to_owned());
    reflect::fill(pass, &program);
    programs.insert(name, program);
}

/// Disables colour writes.
fn mask(pass: &mut GpuPass) {
    for target in pass.targets.iter_mut().flatten() {
        target.write_mask = 0;
        target.blend = None;
    }
}

/// The plan with the cheapest fragment stage that covers the same pixels.
fn flat(plan: &Plan) -> Option<Plan> {
    let mut out = plan.clone();
    for pass in &mut out.passes {
        let program = count::blank(plan, pass).ok()?;
        replace(pass, program, &mut out.programs);
    }
    Some(out)
}

/// Like [`flat`], and without colour writes.
fn depth_only(plan: &Plan) -> Option<Plan> {
    let mut out = flat(plan)?;
    out.passes.iter_mut().for_each(mask);
    Some(out)
}

/// The scene with textures of one texel in each layer for one material.
fn small_textures(scene: &Scene, material: usize) -> Scene {
    let mut scene = scene.clone();
    for image in scene.materials[material].textures.values_mut() {
        *image = Arc::new(one_texel(image));
    }
    for draw in scene.draws.iter_mut().filter(|d| d.material == material) {
        let Some(captured) = &mut draw.captured else {
            continue;
        };
        for texture in &mut Arc::make_mut(captured).textures {
            if let TextureContent::Image(image) = &mut texture.content {
                *image = Arc::new(one_texel(image));
            }
        }
    }
    scene
}

/// The first block of each layer.
fn one_texel(image: &Image) -> Image {
    let (width, height) = image.format.block_dimensions();
    let blocks = image.size[0].div_ceil(width) * image.size[1].div_ceil(height) * image.layers;
    let level = image.levels.first().map_or(&[][..], Vec::as_slice);
    let bytes = level.len() / blocks.max(1) as usize;
    let layers = match image.dimension {
        wgpu::TextureDimension::D3 => 1,
        _ => image.layers,
    };
    let layer = level.len() / image.layers.max(1) as usize;
    let first = (0..layers as usize).filter_map(|i| level.get(i * layer..i * layer + bytes));
    Image {
        size: [width, height],
        layers,
        levels: vec![first.flatten().copied().collect()],
        ..image.clone()
    }
}
