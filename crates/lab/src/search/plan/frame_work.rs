//! Computes the work of a frame from its plans. This module knows no pass by name: it reads each
//! [`GpuPass`] and [`ComputePass`] as a host would.
//!
//! The number of fragments of a pass depends on its place: before everything else, behind a pass
//! that wrote the same material's depth, or over the whole screen. Each view has three counts for a
//! material: rasterised fragments, fragments that pass the depth test in draw order, and visible
//! fragments.

use std::collections::{BTreeMap, BTreeSet};

use naga::Expression;
use preshade_dataflow::graph::{FunctionId, Graph};
use preshade_passes::transforms::specialize::as_drawn;
use preshade_plan::frame::{ColorAttachments, FrameError, FrameOps, FramePlan};
use preshade_plan::geometry::Geometry;
use preshade_plan::pass::Facts;
use preshade_plan::plan::{
    Attachment, AttachmentFormat, BindingKind, BindingSource, BindingUse, ComputePass, Draws,
    FrameWords, GpuPass, Phase, Plan, Role, SCENE_DEPTH, When,
};
use preshade_plan::state::{ColorTarget, CompareFunction, DepthFormat, StoreOp, Topology};

use super::terms::{Term, Work};
use crate::measure::shading::writes_depth;
use preshade_draw::scene::Scene;

/// The draws of one material, in numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DrawCounts {
    pub draws: f64,
    /// Each index counts once.
    pub vertices: f64,
    pub triangles: f64,
    pub instances: f64,
}

/// The draws of each material, in the scene's order.
pub fn drawn(scene: &Scene) -> Vec<DrawCounts> {
    let mut all = vec![DrawCounts::default(); scene.materials.len()];
    for (index, draw) in scene.draws.iter().enumerate() {
        let (Some(of), Some(counts)) = (all.get_mut(draw.material), of_draw(scene, index)) else {
            continue;
        };
        of.draws += counts.draws;
        of.vertices += counts.vertices;
        of.triangles += counts.triangles;
        of.instances += counts.instances;
    }
    all
}

/// One draw of a scene. `None`: it has no mesh or material.
pub(crate) fn of_draw(scene: &Scene, draw: usize) -> Option<DrawCounts> {
    let draw = scene.draws.get(draw)?;
    let mesh = scene.meshes.get(draw.mesh)?;
    let all = mesh
        .indices
        .as_ref()
        .map_or(mesh.vertex_count, |i| i.len() as u32);
    let corners = draw
        .range
        .count
        .unwrap_or(all.saturating_sub(draw.range.first));
    let vertices = mesh.vertex_count.min(corners);
    let corners = f64::from(corners);
    let material = scene.materials.get(draw.material)?;
    let triangles = match material.state.primitive.topology {
        Topology::TriangleStrip => (corners - 2.0).max(0.0),
        _ => corners / 3.0,
    };
    let instances = f64::from(draw.instances);
    Some(DrawCounts {
        draws: 1.0,
        vertices: f64::from(vertices) * instances,
        triangles: triangles * instances,
        instances,
    })
}

/// Fragments of one material in one view, in pixels. With multisampling these are fractions.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Fragments {
    /// Fragments of all its triangles, whatever lies in front.
    pub rasterised: f64,
    /// Those that pass the depth test, in the order of the draws.
    pub drawn: f64,
    /// Those that nothing hides in the end.
    pub visible: f64,
}

impl Fragments {
    fn scaled(self, by: f64) -> Self {
        Self {
            rasterised: self.rasterised * by,
            drawn: self.drawn * by,
            visible: self.visible * by,
        }
    }
}

/// The counts in one view.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Counted {
    /// Width and height of the frame.
    pub size: [u32; 2],
    /// One for each material, in the scene's order.
    pub materials: Vec<Fragments>,
}

impl Counted {
    fn pixels(&self) -> f64 {
        f64::from(self.size[0]) * f64::from(self.size[1])
    }

    /// Fragments of the original's opaque draws that pass the depth test, divided by the pixels of
    /// the frame. The measure of a [`super::Switch`].
    pub fn shaded_per_pixel(&self) -> f64 {
        let shaded: f64 = self.materials.iter().map(|m| m.drawn).sum();
        shaded / self.pixels().max(1.0)
    }

    /// Shaded fragments for each visible one: 1 where nothing is shaded in vain.
    pub fn overdraw(&self) -> f64 {
        let sum = |of: fn(&Fragments) -> f64| self.materials.iter().map(of).sum::<f64>();
        let visible = sum(|m| m.visible);
        match visible > 0.0 {
            true => sum(|m| m.drawn) / visible,
            false => 0.0,
        }
    }
}

/// The static cost of an entry point.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Cost {
    /// Without texture samples.
    ops: f64,
    samples: f64,
}

impl Cost {
    /// The cost of every entry point of a program, by name.
    fn of(graph: &Graph<'_>) -> BTreeMap<String, Self> {
        let module = graph.module();
        let mut ops: BTreeMap<FunctionId, f64> = BTreeMap::new();
        for f in graph.functions() {
            let is_sample = |e| matches!(f.function.expressions[e], Expression::ImageSample { .. });
            let called: f64 = f
                .calls()
                .map(|(at, callee)| {
                    let callee = ops.get(&FunctionId::Function(callee));
                    callee.copied().unwrap_or_default() * f.times[at.index()]
                })
                .sum();
            ops.insert(
                f.id,
                called + f.own_cost(module, |_| true, |e| !is_sample(e)),
            );
        }
        let entries = module.entry_points.iter().enumerate();
        entries
            .map(|(i, entry)| {
                let ops = ops.get(&FunctionId::EntryPoint(i)).copied();
                let ops = ops.unwrap_or_default();
                let samples = graph.entry_cost(i) - ops;
                (entry.name.clone(), Self { ops, samples })
            })
            .collect()
    }

    /// The cost of a stage that mostly leaves out a part, if it has it.
    fn without(self, part: Self) -> Self {
        let less = |own: f64, part: f64| match own < part {
            true => own,
            false => own - part * (1.0 - UNLIKE),
        };
        Self {
            ops: less(self.ops, part.ops),
            samples: less(self.samples, part.samples),
        }
    }
}

/// Which fragments a pass runs for.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Reach {
    /// Every one that is rasterised.
    All,
    /// Fragments that pass the test among earlier draws.
    Drawn,
    /// Those that nothing hides: depth is there already.
    Visible,
    /// As `Drawn` (or `All`), but hidden fragments read a depth texture and leave after so many
    /// operations.
    Looked { prologue: f64, late: bool },
    /// Each pixel of the screen for each draw. Only pixels that show the draw continue.
    Screen,
    /// Each pixel of the screen, once for the frame.
    Once,
}

/// A pass without its program: everything for computing its work in any view.
#[derive(Clone, Debug, PartialEq)]
struct PassShape {
    /// Program and entry point. Equal keys let one pass stand in for another.
    key: String,
    /// Whether it runs before any main pass.
    is_early: bool,
    reach: Reach,
    geometry: Geometry,
    vertex: Cost,
    /// `None` without a fragment stage.
    fragment: Option<Cost>,
    /// A compute pass: no vertices, no tests.
    is_compute: bool,
    /// Bytes that a fragment writes to colour.
    color_bytes: f64,
    /// Bytes that one that passes the test writes to depth.
    depth_bytes: f64,
    /// Bytes of attachments that each fragment reads.
    read_bytes: f64,
    /// Fragments for each pixel: less than 1 where it draws to smaller attachments.
    share: f64,
}

/// A material's plan, ready to be counted.
#[derive(Clone, Debug)]
pub struct Counting {
    shapes: Vec<PassShape>,
    /// Whether its depth is in the scene's depth before any main pass runs.
    is_ahead: bool,
    /// Bytes of buffers that are cleared for each pixel of the frame.
    cleared_bytes: f64,
}

/// The part of the pixels that compute values themselves where neighbours have them at half the rate:
/// a guess, which measuring corrects.
const UNLIKE: f64 = 0.1;

impl Counting {
    /// Operations of a pixel in all passes.
    pub fn fragment_ops(&self) -> f64 {
        let ops = |s: &PassShape| s.fragment.map_or(0.0, |c| (c.ops + c.samples) * s.share);
        self.shapes.iter().map(ops).sum()
    }

    /// Operations of a vertex and of a fragment in the passes that are drawn ahead of every main
    /// pass. `None`: there are none.
    pub fn ahead_ops(&self) -> Option<[f64; 2]> {
        let early: Vec<&PassShape> = self.shapes.iter().filter(|s| s.is_early).collect();
        let ops = |cost: Cost| cost.ops + cost.samples;
        let vertex = early.iter().map(|s| ops(s.vertex)).sum();
        let fragment = early.iter().filter_map(|s| s.fragment).map(ops).sum();
        (!early.is_empty()).then_some([vertex, fragment])
    }

    /// Reads the passes of a plan. Each program is counted as the draws in `facts` run it.
    pub fn of(plan: &Plan, facts: &Facts) -> Self {
        let graph = |key: &str, program| {
            let mut passes = plan.passes.iter();
            match passes.find(|p| p.program == key) {
                Some(pass) => as_drawn(program, pass, &plan.material, facts),
                None => Graph::build(program),
            }
        };
        let costs: BTreeMap<&str, BTreeMap<String, Cost>> = plan
            .programs
            .iter()
            .map(|(key, program)| (key.as_str(), Cost::of(&graph(key, program))))
            .collect();
        let cost = |program: &str, entry: &str| {
            let found = costs.get(program).and_then(|c| c.get(entry));
            found.copied().unwrap_or_default()
        };
        let authored = plan.original.as_deref().and_then(|original| {
            let main = original.main()?;
            let program = original.program(main)?;
            let costs = Cost::of(&as_drawn(program, main, &plan.material, facts));
            costs.get(main.fragment.as_deref()?).copied()
        });
        let stage = |p: &GpuPass| p.fragment.as_deref().map(|f| cost(&p.program, f));
        let halved = plan.passes.iter().find(|p| p.role == Role::HalfRate);
        let halved = halved.and_then(stage).unwrap_or_default();
        let raster = plan
            .passes
            .iter()
            .filter(|p| p.phase.is_of_frame())
            .map(|pass| {
                let mut fragment = stage(pass);
                if let Some(cost) = fragment.as_mut().filter(|_| pass.role.shades()) {
                    *cost = cost.without(halved);
                }
                PassShape {
                    key: format!("{} {}", pass.program, pass.vertex),
                    is_early: pass.phase == Phase::Depth,
                    reach: reach(plan, pass, fragment, authored),
                    geometry: pass.geometry.clone(),
                    vertex: cost(&pass.program, &pass.vertex),
                    fragment,
                    is_compute: false,
                    color_bytes: color_bytes(pass),
                    depth_bytes: depth_bytes(plan, pass),
                    read_bytes: read_bytes(plan, &pass.bindings),
                    share: share(plan, pass),
                }
            });
        let compute = plan
            .compute
            .iter()
            .filter(|c| !matches!(c.when, When::Load { .. }))
            .map(|compute| PassShape {
                key: format!("{} {}", compute.program, compute.entry_point),
                is_early: false,
                reach: match (compute.draws, &compute.geometry) {
                    (Draws::Once, _) => Reach::Once,
                    (_, Geometry::FullScreen) => Reach::Screen,
                    _ => Reach::Visible,
                },
                geometry: compute.geometry.clone(),
                vertex: Cost::default(),
                fragment: Some(cost(&compute.program, &compute.entry_point)),
                is_compute: true,
                color_bytes: stored_bytes(compute),
                depth_bytes: 0.0,
                read_bytes: read_bytes(plan, &compute.bindings),
                share: 1.0,
            });
        Self {
            shapes: raster.chain(compute).collect(),
            is_ahead: plan.passes.iter().any(|p| is_ahead(p, SCENE_DEPTH)),
            cleared_bytes: plan
                .frame_buffers
                .iter()
                .filter(|b| b.holds == FrameWords::Pixels)
                .count() as f64
                * 4.0,
        }
    }
}

/// Texels of a pass's targets, for each pixel.
fn share(plan: &Plan, pass: &GpuPass) -> f64 {
    let mut names = pass
        .targets
        .iter()
        .flatten()
        .filter_map(|t| t.attachment.as_deref());
    let attachment = names.next().and_then(|name| plan.attachment(name));
    attachment.map_or(1.0, texels)
}

/// Texels of an attachment for each pixel.
fn texels(attachment: &Attachment) -> f64 {
    f64::from(attachment.divisor.max(1)).powi(-2)
}

/// Whether a pass lays a material's depth before any of its main passes.
fn is_ahead(pass: &GpuPass, attachment: &str) -> bool {
    pass.phase == Phase::Depth
        && pass
            .depth
            .as_ref()
            .is_some_and(|d| d.write && d.attachment == attachment)
}

fn reach(plan: &Plan, pass: &GpuPass, fragment: Option<Cost>, authored: Option<Cost>) -> Reach {
    let compare = pass.depth.as_ref().map(|d| d.compare);
    match (&pass.geometry, pass.draws) {
        (_, Draws::Once) => return Reach::Once,
        (Geometry::FullScreen, _) if compare == Some(CompareFunction::Equal) => {
            return Reach::Visible;
        }
        (Geometry::FullScreen, _) => return Reach::Screen,
        (Geometry::Indirect { .. }, _) => return Reach::Visible,
        _ => {}
    }
    if pass.phase == Phase::Blended {
        return Reach::All;
    }
    // A fragment that writes depth runs before it is tested.
    let late = writes_depth(plan, pass);
    let Some(depth) = &pass.depth else {
        return Reach::All;
    };
    if pass.phase == Phase::Depth {
        return if late { Reach::All } else { Reach::Drawn };
    }
    let looks = |b: &BindingUse| {
        b.kind == BindingKind::DepthTexture && matches!(b.source, BindingSource::Attachment { .. })
    };
    if pass.bindings.iter().any(looks) {
        let before = authored.unwrap_or_default();
        let prologue = fragment.map_or(0.0, |f| f.ops - before.ops).max(1.0);
        return match depth.read_only {
            // The hardware's own test hides everything that it would find.
            true if !late => Reach::Visible,
            _ => Reach::Looked { prologue, late },
        };
    }
    if late {
        return Reach::All;
    }
    let laid = plan.passes.iter().any(|p| is_ahead(p, &depth.attachment));
    match laid || depth.read_only || depth.compare == CompareFunction::Equal {
        true => Reach::Visible,
        false => Reach::Drawn,
    }
}

fn color_bytes(pass: &GpuPass) -> f64 {
    let bytes = |t: &ColorTarget| match (t.write_mask, &t.blend) {
        (0, _) => 0.0,
        (_, None) => format_bytes(&t.format),
        (_, Some(_)) => 2.0 * format_bytes(&t.format),
    };
    let samples = f64::from(pass.multisample.count.max(1));
    pass.targets.iter().flatten().map(bytes).sum::<f64>() * samples
}

fn depth_bytes(plan: &Plan, pass: &GpuPass) -> f64 {
    let depth = pass.depth.as_ref().filter(|d| d.write);
    let format = depth.and_then(|d| plan.depth_format(&d.attachment));
    let samples = f64::from(pass.multisample.count.max(1));
    format.map_or(0.0, depth_format_bytes) * samples
}

fn read_bytes(plan: &Plan, bindings: &[BindingUse]) -> f64 {
    let bytes = |b: &BindingUse| match &b.source {
        BindingSource::Attachment { name } => plan.attachment(name).map(attachment_bytes),
        _ => None,
    };
    bindings.iter().filter_map(bytes).sum()
}

fn stored_bytes(compute: &ComputePass) -> f64 {
    let stores = |b: &&BindingUse| matches!(b.source, BindingSource::SceneColor { .. });
    4.0 * compute.bindings.iter().filter(stores).count() as f64
}

fn attachment_bytes(attachment: &Attachment) -> f64 {
    let samples = f64::from(attachment.samples.max(1));
    samples
        * match &attachment.format {
            AttachmentFormat::Depth(format) => depth_format_bytes(*format),
            AttachmentFormat::Color(format) => format_bytes(format),
        }
}

fn depth_format_bytes(format: DepthFormat) -> f64 {
    match format {
        DepthFormat::Depth16unorm => 2.0,
        DepthFormat::Depth32floatStencil8 => 5.0,
        _ => 4.0,
    }
}

/// Bytes of a texel of a colour format, by its name in WebGPU: channels, then bits of each.
fn format_bytes(name: &str) -> f64 {
    let channels = name.chars().take_while(char::is_ascii_alphabetic).count();
    let digits = name.chars().skip(channels);
    let bits: String = digits.take_while(char::is_ascii_digit).collect();
    match (channels, bits.parse::<f64>()) {
        // Packed: `rgb10a2unorm`, `rg11b10ufloat`, `rgb9e5ufloat`.
        (2, Ok(11.0)) | (3, _) => 4.0,
        (n, Ok(bits)) => n as f64 * bits / 8.0,
        _ => 4.0,
    }
}

/// Operations of a fragment that reads an ID and leaves.
const LOOK: f64 = 4.0;

/// The work of a frame of these plans in a view. `counting`, `drawn` and `counted` have the same
/// materials in the same order.
///
/// A material without early depth saves those hidden fragments that lie behind a material with
/// early depth. Their share is the part of the picture that such materials cover.
pub(crate) fn frame(
    plans: &[&Plan],
    counting: &[&Counting],
    drawn: &[DrawCounts],
    counted: &Counted,
) -> Result<Work, FrameError> {
    let merged = FramePlan::merge(plans.iter().copied())?;
    let mut work = Work::default();
    work.add(Term::Frames, 1.0);
    work.add(Term::Passes, merged.passes.len() as f64);
    let attachment = |name: &str| {
        let of = merged.attachments.iter().find(|a| a.name == name);
        of.map_or(4.0, |a| attachment_bytes(a) * texels(a))
    };
    let scene_color = plans.iter().flat_map(|p| &p.passes).find_map(|p| {
        let bytes = color_bytes(p);
        (p.role.shades() && bytes > 0.0).then_some(bytes)
    });
    for pass in &merged.passes {
        let named = pass.colors.names().map(attachment).sum::<f64>();
        let color = match pass.colors {
            ColorAttachments::Scene => scene_color.unwrap_or(4.0),
            _ => named,
        };
        let depth = pass.depth.as_deref().map_or(0.0, attachment);
        // Cleared or loaded, and stored.
        let times = |ops: &FrameOps| match ops.store {
            StoreOp::Store => 2.0,
            StoreOp::Discard => 1.0,
        };
        let color_times = pass.color_ops.iter().flatten().next().map_or(0.0, times);
        let depth_times = pass.depth_ops.as_ref().map_or(0.0, times);
        let bytes = color * color_times + depth * depth_times;
        work.add(Term::AttachmentBytes, bytes * counted.pixels());
    }
    let seen: f64 = counted.materials.iter().map(|m| m.visible).sum();
    let ahead: f64 = counting
        .iter()
        .zip(&counted.materials)
        .filter(|(c, _)| c.is_ahead)
        .map(|(_, m)| m.visible)
        .sum();
    let covered = if seen > 0.0 { ahead / seen } else { 0.0 };
    let (mut once, mut cleared) = (BTreeSet::new(), 0.0_f64);
    for ((counting, drawn), fragments) in counting.iter().zip(drawn).zip(&counted.materials) {
        let mut left = *fragments;
        if !counting.is_ahead {
            left.drawn -= (left.drawn - left.visible).max(0.0) * covered;
        }
        cleared = cleared.max(counting.cleared_bytes);
        for shape in &counting.shapes {
            // One such pass serves all materials.
            if shape.reach == Reach::Once && !once.insert(&shape.key) {
                continue;
            }
            let fragments = if shape.is_early { fragments } else { &left };
            let fragments = fragments.scaled(shape.share);
            work += shape.work(drawn, &fragments, counted.pixels() * shape.share);
        }
    }
    work.add(Term::AttachmentBytes, cleared * counted.pixels());
    Ok(work)
}

impl PassShape {
    fn work(&self, drawn: &DrawCounts, fragments: &Fragments, pixels: f64) -> Work {
        let mut work = Work::default();
        let draws = match self.reach {
            Reach::Once => 1.0,
            _ => drawn.draws,
        };
        // Launched fragments, and how many run to the end. The others leave early.
        let (tested, launched, whole, look) = match self.reach {
            Reach::All => {
                let n = fragments.rasterised;
                (n, n, n, 0.0)
            }
            Reach::Drawn => (fragments.rasterised, fragments.drawn, fragments.drawn, 0.0),
            Reach::Visible => {
                let n = fragments.visible;
                (fragments.rasterised, n, n, 0.0)
            }
            Reach::Looked { prologue, late } => {
                let n = if late {
                    fragments.rasterised
                } else {
                    fragments.drawn
                };
                (fragments.rasterised, n, fragments.visible, prologue)
            }
            Reach::Screen => {
                let n = pixels * draws;
                (n, n, fragments.visible, LOOK)
            }
            Reach::Once => (pixels, pixels, pixels, 0.0),
        };
        let mesh = self.geometry.subdivision();
        if self.is_compute {
            let invocations = match (&self.geometry, mesh) {
                (Geometry::Instances, _) => drawn.instances,
                (Geometry::Vertices, _) => drawn.vertices,
                (Geometry::Draw, _) => draws,
                (_, Some(subdivision)) => {
                    drawn.triangles * subdivision.indices.len() as f64 / 6.0 + drawn.vertices
                }
                _ => launched,
            };
            let whole = match self.geometry {
                Geometry::FullScreen | Geometry::Indirect { .. } => whole,
                _ => invocations,
            };
            let cost = self.fragment.unwrap_or_default();
            let ops = whole * (cost.ops + cost.samples) + (invocations - whole).max(0.0) * LOOK;
            work.add(Term::Dispatches, draws);
            work.add(Term::ComputeInvocations, invocations);
            work.add(Term::ComputeOps, ops);
            let bytes = whole * self.color_bytes + invocations * self.read_bytes;
            work.add(Term::Bytes, bytes);
            return work;
        }
        let (vertices, triangles) = match (&self.geometry, mesh) {
            (Geometry::FullScreen, _) => (3.0 * draws, draws),
            (_, Some(subdivision)) => {
                let triangles = drawn.triangles * subdivision.indices.len() as f64 / 3.0;
                let vertices = match subdivision.form.is_indexed() {
                    true => triangles / 2.0 + drawn.vertices,
                    false => drawn.triangles * subdivision.vertices.len() as f64,
                };
                (vertices, triangles)
            }
            (Geometry::Unindexed, _) => (3.0 * drawn.triangles, drawn.triangles),
            (Geometry::Indirect { .. }, _) => (6.0 * draws, 2.0 * draws),
            _ => (drawn.vertices, drawn.triangles),
        };
        work.add(Term::Draws, draws);
        work.add(Term::Vertices, vertices);
        work.add(
            Term::VertexOps,
            vertices * (self.vertex.ops + self.vertex.samples),
        );
        work.add(Term::Triangles, triangles);
        work.add(Term::Tested, tested);
        if let Some(cost) = self.fragment {
            work.add(Term::Fragments, launched);
            let left = (launched - whole).max(0.0);
            work.add(Term::FragmentOps, whole * cost.ops + left * look);
            work.add(Term::SampleOps, whole * cost.samples);
        }
        let passed = match self.reach {
            Reach::Looked { .. } | Reach::Screen => whole,
            _ => launched,
        };
        let written = passed * (self.color_bytes + self.depth_bytes);
        work.add(Term::Bytes, written + launched * self.read_bytes);
        work
    }
}

#[cfg(test)]
mod tests {
    use super::format_bytes;

    #[test]
    fn texels_by_name() {
        for (name, bytes) in [
            ("rgba8unorm", 4.0),
            ("bgra8unorm-srgb", 4.0),
            ("rgba16float", 8.0),
            ("rg32uint", 8.0),
            ("r32float", 4.0),
            ("rgb10a2unorm", 4.0),
            ("rg11b10ufloat", 4.0),
        ] {
            assert!((format_bytes(name) - bytes).abs() < 1e-9, "{name}");
        }
    }
}
