//! The built-in frames for fitting a cost model: layers of a grid that face the camera. Each frame
//! has much of one kind of work and little of the others.

use std::collections::BTreeMap;
use std::sync::{Arc, PoisonError, RwLock};
use std::time::Duration;

use glam::{Mat4, Vec3};
use preshade_plan::pass::Facts;
use preshade_plan::state::{CullMode, MaterialState};

use super::PlanError;
use super::assign::Assignment;
use super::choices::choices;
use super::count::{FragmentCounter, is_software};
use super::frame_work::drawn;
use super::model::{Model, Observation};
use crate::measure::{self, Session, TimingSettings, handmade};
use preshade_compiler::front::{self, Source};
use preshade_compiler::recipe::Recipe;
use preshade_draw::render::Gpu;
use preshade_draw::scene::{Draw, DrawOrder, Image, Material, Mesh, Scene, Stream};
use preshade_scenes::ShaderForm;
use shader_text::error::Color;
use shader_text::options::Options;

/// A built-in frame that the cost model is fitted to.
#[derive(Clone, Copy)]
struct Probe {
    vertex: &'static str,
    fragment: &'static str,
    /// Cells along each side of a layer, in 64ths of [`finest`].
    grid: u32,
    /// Part of the frame's width and height that a layer covers.
    scale: f32,
    layers: u32,
    order: DrawOrder,
    recipe: &'static str,
}

const fn probe(
    vertex: &'static str,
    fragment: &'static str,
    [grid, layers]: [u32; 2],
    order: DrawOrder,
    recipe: &'static str,
) -> Probe {
    Probe {
        vertex,
        fragment,
        grid,
        scale: 1.0,
        layers,
        order,
        recipe,
    }
}

/// A layer of that size instead of one that covers the frame.
const fn small(probe: Probe, scale: f32) -> Probe {
    Probe { scale, ..probe }
}

const BACK: DrawOrder = DrawOrder::BackToFront;
const FRONT: DrawOrder = DrawOrder::FrontToBack;

/// Fill, arithmetic, texture samples, vertices, small triangles and draws. Then the work that
/// passes add: depth alone, depth reads, IDs and compute.
const PROBES: &[Probe] = &[
    small(probe("vs_cheap", "fs_flat", [0, 1], BACK, ""), 0.01),
    probe("vs_cheap", "fs_flat", [0, 1], BACK, ""),
    probe("vs_cheap", "fs_flat", [0, 8], BACK, ""),
    probe("vs_cheap", "fs_flat", [0, 32], BACK, ""),
    probe("vs_cheap", "fs_flat", [0, 32], FRONT, ""),
    probe("vs_cheap", "fs_some", [0, 1], BACK, ""),
    probe("vs_cheap", "fs_some", [0, 8], BACK, ""),
    probe("vs_cheap", "fs_some", [0, 8], FRONT, ""),
    probe("vs_cheap", "fs_much", [0, 1], BACK, ""),
    probe("vs_cheap", "fs_much", [0, 4], BACK, ""),
    probe("vs_cheap", "fs_much", [0, 4], FRONT, ""),
    probe("vs_cheap", "fs_taps", [0, 1], BACK, ""),
    probe("vs_cheap", "fs_taps", [0, 8], BACK, ""),
    small(probe("vs_cheap", "fs_flat", [64, 1], BACK, ""), 0.05),
    small(probe("vs_cheap", "fs_flat", [64, 8], BACK, ""), 0.05),
    small(probe("vs_dear", "fs_flat", [64, 1], BACK, ""), 0.05),
    small(probe("vs_dear", "fs_flat", [64, 8], BACK, ""), 0.05),
    probe("vs_cheap", "fs_flat", [64, 1], BACK, ""),
    probe("vs_cheap", "fs_some", [64, 1], BACK, ""),
    probe("vs_cheap", "fs_some", [64, 4], FRONT, ""),
    small(probe("vs_cheap", "fs_flat", [0, 64], BACK, ""), 0.02),
    small(probe("vs_cheap", "fs_flat", [0, 400], BACK, ""), 0.02),
    probe("vs_cheap", "fs_flat", [0, 1], BACK, "depth-prepass"),
    probe("vs_cheap", "fs_much", [0, 4], BACK, "depth-prepass"),
    probe("vs_cheap", "fs_some", [0, 8], FRONT, "depth-prepass"),
    probe("vs_dear", "fs_some", [64, 4], BACK, "depth-prepass"),
    probe("vs_cheap", "fs_some", [0, 1], BACK, "early-discard"),
    probe("vs_cheap", "fs_some", [0, 8], BACK, "early-discard"),
    probe(
        "vs_cheap",
        "fs_flat",
        [0, 1],
        BACK,
        "visibility-buffer:select=id,budget=1",
    ),
    probe(
        "vs_cheap",
        "fs_some",
        [0, 4],
        BACK,
        "visibility-buffer:budget=1",
    ),
    probe(
        "vs_cheap",
        "fs_some",
        [64, 1],
        BACK,
        "visibility-buffer:select=id,budget=1",
    ),
    probe(
        "vs_dear",
        "fs_flat",
        [0, 1],
        BACK,
        "visibility-buffer:select=id,budget=1",
    ),
    probe(
        "vs_cheap",
        "fs_flat",
        [0, 1],
        BACK,
        "visibility-buffer:form=compute,budget=1",
    ),
    probe(
        "vs_cheap",
        "fs_much",
        [0, 1],
        BACK,
        "visibility-buffer:form=compute,budget=1",
    ),
    probe(
        "vs_cheap",
        "fs_some",
        [64, 4],
        BACK,
        "visibility-buffer:form=compute,budget=1",
    ),
];

/// Cells along a layer's side for 64 in the table.
fn finest(gpu: &Gpu) -> u32 {
    if is_software(gpu) { 48 } else { 256 }
}

/// Width and height of the probes.
fn size(gpu: &Gpu) -> [u32; 2] {
    if is_software(gpu) {
        [160, 96]
    } else {
        [1280, 720]
    }
}

/// Draws the probes and fits a model. `progress` gets the part done.
///
/// # Errors
///
/// As [`Session::prepare`] and [`measure::time`]. A probe whose recipe the adapter cannot draw is
/// left out.
pub fn fit(
    gpu: &Gpu,
    progress: &mut dyn FnMut(f64),
) -> Result<(Model, Vec<Observation>), PlanError> {
    let mut observations = Vec::new();
    let mut done = 0;
    for probes in PROBES.chunks(at_once(gpu)) {
        progress(done as f64 / PROBES.len() as f64);
        done += probes.len();
        for (probe, observed) in probes.iter().zip(observe_all(gpu, probes)) {
            match observed {
                Ok(observation) => observations.extend(observation),
                Err(_) if !probe.recipe.is_empty() => {}
                Err(error) => return Err(error),
            }
        }
    }
    Ok((
        Model::fit(&gpu.adapter().title(), &observations),
        observations,
    ))
}

/// Frames to compile at once. A software adapter draws with the cores that compile.
fn at_once(gpu: &Gpu) -> usize {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    match is_software(gpu) {
        true => 1,
        false => cores.min(8),
    }
}

fn observe_all(gpu: &Gpu, probes: &[Probe]) -> Vec<Result<Option<Observation>, PlanError>> {
    let drawing = RwLock::new(());
    std::thread::scope(|scope| {
        let threads: Vec<_> = probes
            .iter()
            .map(|probe| scope.spawn(|| observe(gpu, probe, &drawing)))
            .collect();
        let panicked = |panic| std::panic::resume_unwind(panic);
        threads
            .into_iter()
            .map(|thread| thread.join().unwrap_or_else(panicked))
            .collect()
    })
}

/// Measures a probe. Who draws or compiles reads `drawing`, and who times writes it.
fn observe(
    gpu: &Gpu,
    probe: &Probe,
    drawing: &RwLock<()>,
) -> Result<Option<Observation>, PlanError> {
    let compiling = drawing.read().unwrap_or_else(PoisonError::into_inner);
    let scene = scene(probe, finest(gpu), size(gpu))?;
    let session = Session::new(gpu, &scene, ShaderForm::Ir)?;
    let originals = session.originals();
    let recipes: Vec<Recipe> = match probe.recipe {
        "" => Vec::new(),
        recipe => vec![Recipe::parse_list(recipe)?],
    };
    let choices = choices(originals, &recipes, &Facts::without_ties());
    let pick = recipes.len();
    if choices.iter().any(|c| c.candidates.len() <= pick) {
        return Ok(None);
    }
    let assignment = Assignment(vec![pick; choices.len()]);
    let Some((_, frame)) = scene.frames().next() else {
        return Ok(None);
    };
    let counted = FragmentCounter::new(session.inputs(), originals)?.count(frame, probe.order)?;
    let Some(work) = assignment.work(&choices, &drawn(&scene), &counted) else {
        return Ok(None);
    };
    let mut prepared = session.prepare(&assignment.plans(&choices))?;
    prepared.aim(frame, probe.order);
    drop(compiling);
    let alone = drawing.write().unwrap_or_else(PoisonError::into_inner);
    let timing = TimingSettings {
        budget: Duration::ZERO,
        min_samples: 6,
        submission: Duration::from_millis(8),
        ..TimingSettings::default()
    };
    let times = measure::time(gpu, &[&prepared], &timing, |_| {});
    // Its resources go before the next one is timed.
    drop(prepared);
    drop(alone);
    let (_, times) = times?;
    Ok(times.first().map(|t| Observation {
        work,
        ms: t.time.estimate.median,
    }))
}

/// Layers that cover `scale` of the frame, between depth 0.1 and 0.9.
fn scene(probe: &Probe, finest: u32, size: [u32; 2]) -> Result<Scene, PlanError> {
    let source = Source::new("probes.wgsl", include_str!("probes.wgsl"));
    let options = Options {
        vertex: Some(probe.vertex.to_owned()),
        fragment: Some(probe.fragment.to_owned()),
        ..Options::default()
    };
    let parsed =
        front::parse(&[source], &options).map_err(|e| PlanError::Probe(e.render(Color::Never)))?;
    let mut state = MaterialState::default();
    state.primitive.cull = CullMode::None;
    let cells = (probe.grid * finest / 64).max(1);
    let layer = |i: u32| {
        let depth = 0.1 + 0.8 * (i as f32 + 0.5) / probe.layers as f32;
        Draw {
            transform: Mat4::from_translation(Vec3::new(0.0, 0.0, depth)),
            ..handmade::draw("layers", 1)
        }
    };
    let material = Material {
        textures: BTreeMap::from([("noise".to_owned(), Arc::new(noise()))]),
        ..handmade::material("probe", parsed, state)
    };
    let draws = (0..probe.layers).map(layer).collect();
    Ok(Scene {
        orders: vec![probe.order],
        ..handmade::scene("probe", size, material, grid(cells, probe.scale), draws)
    })
}

/// A square of `cells` by `cells` quads around the origin, in clip space.
fn grid(cells: u32, scale: f32) -> Mesh {
    let at = |i: u32| (2.0 * i as f32 / cells as f32 - 1.0) * scale;
    let corners = (0..=cells).flat_map(|y| (0..=cells).map(move |x| (x, y)));
    let positions = corners.flat_map(|(x, y)| [at(x), at(y), 0.0]).collect();
    let quads = (0..cells).flat_map(|y| (0..cells).map(move |x| y * (cells + 1) + x));
    let up = cells + 1;
    let indices = quads
        .flat_map(|i| [i, i + 1, i + up, i + up, i + 1, i + up + 1])
        .collect();
    let float = |components, data| Stream::Float { components, data };
    Mesh {
        name: "layer".to_owned(),
        vertex_count: (cells + 1) * (cells + 1),
        streams: BTreeMap::from([("position".to_owned(), float(3, positions))]),
        indices: Some(indices),
        bounds: [Vec3::new(-scale, -scale, 0.0), Vec3::new(scale, scale, 0.0)],
    }
}

/// 128 by 128 texels of a multiplicative hash, so that neighbouring samples are of different bytes.
fn noise() -> Image {
    let byte = |i: u32| (i.wrapping_mul(2_654_435_761) >> 24) as u8;
    let texels = (0..128 * 128 * 4).map(byte).collect();
    Image::rgba8([128, 128], 1, false, vec![texels])
}
