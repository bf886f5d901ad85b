//! Compares the auxiliary pictures of a variant: their depth with that of the author's whole
//! program, and velocities with the positions of two frames.
//!
//! The positions are independent of the variant: the interpreter runs the author's whole vertex
//! stage in both frames, and triangles are rasterised here. A pixel is compared where a triangle has
//! the depth that was drawn. Of a draw with very many instances, the first ones are drawn and
//! compared.

use std::collections::BTreeMap;

use naga::{Binding, BuiltIn, ShaderStage};
use preshade_passes::contract::Verdict;
use preshade_passes::evaluate::Lookup;
use preshade_passes::plan::{GpuPass, Phase, Plan};
use preshade_passes::reflect;
use serde::{Deserialize, Serialize};

use super::error::counted;
use super::verify::{Settings, Timed, Variant};
use super::vertices::{self, Vertices};
use super::{Error, ErrorLadder, Estimate, FrameTime, Session, compare, shadow, texels, time};
use crate::render::{
    ColorImage, FrameSettings, Prepared, Rendered, SceneInputs, Variant as RenderVariant,
};
use crate::scene::{Camera, DrawOrder, Frame, Scene, bind};

/// The auxiliary pictures of a variant, in one frame of each camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OutputsReport {
    /// Materials with such pictures. No other material is drawn.
    pub materials: Vec<String>,
    /// Pixels with anything in them, over all cameras.
    pub covered: u64,
    /// Pixels whose depth bits differ from those of the whole programs, over all cameras.
    pub changed_depth: u64,
    /// Largest distance of two depths, in steps between neighbouring 32-bit floats.
    pub depth_max_ulp: u64,
    /// Camera, column and row of the first depth that differs.
    pub first_difference: Option<(String, [u32; 2])>,
    /// Velocities; `None`: none are drawn.
    pub velocity: Option<VelocityReport>,
    /// Milliseconds a frame of the main passes of the same materials; `None`: not timed.
    pub main_ms: Option<FrameTime>,
    /// Milliseconds a frame of the auxiliary passes.
    pub time_ms: Option<FrameTime>,
    /// The main passes' time over the auxiliary passes'.
    pub speedup: Option<Estimate>,
}

/// Velocities against positions.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct VelocityReport {
    /// Pixels compared.
    pub pixels: u64,
    /// Covered pixels that were not compared: of a triangle that was not evaluated, that reaches
    /// behind the camera, or that a filtered texture moves. Adapters filter with as few as 8 bits,
    /// so that they and the interpreter disagree on where such a triangle is.
    pub left_out: u64,
    /// Largest way of a pixel between the frames, in pixels.
    pub longest: f64,
    /// Largest difference in pixels, less half a step of the target's format.
    pub worst: f64,
    /// Camera, column and row of the largest difference.
    pub at: Option<(String, [u32; 2])>,
    /// Why the first position that was not evaluated was not.
    pub not_evaluated: Option<String>,
}

/// The part of a pixel that a velocity may be wrong by.
pub const TOLERANCE: f64 = 1.0 / 256.0;

impl OutputsReport {
    /// Whether depths are equal and velocities right. `invariant`: every material drawn marks its
    /// position `@invariant`. Without it, two programs may round positions differently.
    pub fn verdict(&self, invariant: bool) -> Verdict {
        let wrong = self
            .velocity
            .as_ref()
            .filter(|v| v.worst.is_nan() || v.worst > TOLERANCE);
        if let Some(velocity) = wrong {
            let at = velocity.at.as_ref();
            let at = at.map(|(camera, [x, y])| format!(" at camera `{camera}`, {x}, {y}"));
            return Verdict::Broken {
                r#where: format!(
                    "a velocity is wrong by {:.4} pixels{}",
                    velocity.worst,
                    at.unwrap_or_default()
                ),
            };
        }
        let Some((camera, [x, y])) = &self.first_difference else {
            return match self.covered {
                0 => Verdict::NotMeasured {
                    why: "no camera sees anything that has auxiliary pictures".to_owned(),
                },
                _ => self
                    .not_compared()
                    .map_or(Verdict::Holds, |why| Verdict::NotMeasured { why }),
            };
        };
        let r#where = format!(
            "the auxiliary depth at camera `{camera}`: {} differ by up to {}, the first at {x}, {y}",
            counted(self.changed_depth, "depth"),
            counted(self.depth_max_ulp, "step")
        );
        match invariant {
            true => Verdict::Broken { r#where },
            false => Verdict::NotMeasured {
                why: format!(
                    "its auxiliary depth is exact against an original whose position is \
                     @invariant, and this one's is not (--invariant marks it): {where}"
                ),
            },
        }
    }
}

impl OutputsReport {
    /// Why no velocity was compared, if none was.
    fn not_compared(&self) -> Option<String> {
        let velocity = self.velocity.as_ref().filter(|v| v.pixels == 0)?;
        let why = velocity.not_evaluated.as_deref();
        Some(format!(
            "no velocity was compared: {}",
            why.unwrap_or("no triangle is in front of the camera in both frames")
        ))
    }
}

/// Whether a plan draws auxiliary pictures of the camera's view.
pub(super) fn has_outputs(plan: &Plan) -> bool {
    pass_of(plan).is_some()
}

/// The pass of a plan that draws auxiliary pictures.
fn pass_of(plan: &Plan) -> Option<&GpuPass> {
    plan.passes.iter().find(|p| p.phase == Phase::Outputs)
}

/// Two frames one after the other, of each camera: the camera's own, or one moved a little.
fn frames(camera: &Camera) -> Option<[Frame; 2]> {
    match camera.frames[..] {
        [] => None,
        [one] => Some([before(&one), one]),
        [first, second, ..] => Some([first, second]),
    }
}

/// The frame a thirtieth of a second before, from a little aside.
fn before(frame: &Frame) -> Frame {
    let aside = glam::Vec3::new(0.03, 0.02, -0.05);
    Frame {
        view: glam::Mat4::from_rotation_y(0.01) * frame.view * glam::Mat4::from_translation(-aside),
        eye: frame.eye + aside,
        time: frame.time - 1.0 / 30.0,
        ..*frame
    }
}

/// Draws and compares. `earlier`: the scene's draws in the previous frame.
///
/// # Errors
///
/// As [`Session::new`] and [`Session::draw`].
pub fn measure(
    session: &Session<'_>,
    earlier: &Scene,
    variant: &Variant,
    settings: &Settings,
) -> Result<OutputsReport, Error> {
    let (gpu, scene) = (session.gpu(), session.scene());
    let (mut whole, mut main, mut alone, mut materials) =
        (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut location = None;
    for (original, plan) in session.originals().iter().zip(&variant.plans) {
        let Some(pass) = pass_of(plan) else { continue };
        location = location.or_else(|| velocity_of(pass));
        materials.push(plan.material.clone());
        let mut original = original.clone();
        for pass in &mut original.passes {
            pass.multisample = preshade_passes::state::Multisample::default();
        }
        for attachment in &mut original.attachments {
            attachment.samples = 1;
        }
        whole.push(shadow::whole_program(original.clone(), plan, pass));
        main.push(original);
        alone.push(shadow::alone(plan, pass));
    }
    let mut report = OutputsReport {
        materials,
        covered: 0,
        changed_depth: 0,
        depth_max_ulp: 0,
        first_difference: None,
        velocity: location.map(|_| VelocityReport::default()),
        main_ms: None,
        time_ms: None,
        speedup: None,
    };
    for (i, camera) in scene.cameras.iter().enumerate() {
        let Some([before, now]) = frames(camera) else {
            continue;
        };
        let [earlier, scene] = [(earlier, before), (scene, now)].map(|(scene, frame)| {
            let mut scene = scene.clone().with_samples(1);
            scene.cameras = vec![Camera {
                name: camera.name.clone(),
                frames: vec![frame],
            }];
            scene
        });
        let previous = SceneInputs::new(gpu, &earlier)?;
        let inputs = SceneInputs::new(gpu, &scene)?.after(&previous);
        let prepare = |plans: &[Plan]| -> Result<Prepared<'_>, Error> {
            let variant = RenderVariant::new(plans, session.form())?;
            let mut prepared = Prepared::new(&inputs, &variant, &FrameSettings::of(&scene))?;
            prepared.aim(&now, DrawOrder::FrontToBack);
            Ok(prepared)
        };
        let (reference, subject) = (prepare(&whole)?, prepare(&alone)?);
        let depth = |picture: &Rendered| Rendered {
            colors: Vec::new(),
            depth: picture.depth.clone(),
        };
        let (drawn, reference) = (subject.render()?, reference.render()?);
        let (a, b) = (depth(&reference), depth(&drawn));
        report.add(&camera.name, &a, &compare(&a, &b)?);
        if let (Some(location), Some(velocity)) = (location, &mut report.velocity) {
            let positions = Positions {
                scenes: [&earlier, &scene].map(with_few_instances),
                frames: [before, now],
                materials: &report.materials,
                plans: session.originals(),
            };
            positions.compare(session, (&alone, location), velocity)?;
        }
        if i == 0 && settings.timed != Timed::No {
            let main = prepare(&main)?;
            let (_, timings) = time(gpu, &[&main, &subject], &settings.timing, |_| {})?;
            if let [main, outputs] = &timings[..] {
                report.main_ms = Some(main.time.clone());
                report.time_ms = Some(outputs.time.clone());
                report.speedup = Some(outputs.speedup);
            }
        }
    }
    Ok(report)
}

/// The location of the velocities.
fn velocity_of(pass: &GpuPass) -> Option<usize> {
    pass.targets.iter().position(|target| {
        let attachment = target.as_ref().and_then(|t| t.attachment.as_deref());
        attachment == Some("outputs-velocity")
    })
}

impl OutputsReport {
    fn add(&mut self, camera: &str, reference: &Rendered, error: &ErrorLadder) {
        self.covered += covered(reference).filter(|c| *c).count() as u64;
        self.changed_depth += error.changed_depth;
        self.depth_max_ulp = self.depth_max_ulp.max(error.depth_max_ulp);
        if let (None, Some(at)) = (&self.first_difference, error.first_difference) {
            self.first_difference = Some((camera.to_owned(), at));
        }
    }
}

/// Whether each pixel is drawn to. No depth of a surface is exactly that of the clear value, but for
/// those on a plane.
fn covered(picture: &Rendered) -> impl Iterator<Item = bool> {
    let depths = picture.depth.iter().flat_map(|d| &d.values);
    depths.map(|d| *d != 0.0 && *d != 1.0)
}

/// A triangle: clip positions of its corners, each before and now.
type Triangle = [[[f32; 4]; 2]; 3];

/// The scene with so few instances of each draw that all positions can be evaluated.
fn with_few_instances(scene: &Scene) -> Scene {
    let mut scene = scene.clone();
    let meshes = &scene.meshes;
    for draw in &mut scene.draws {
        let vertices = meshes.get(draw.mesh).map_or(1, |mesh| mesh.vertex_count);
        let most = MOST_RUNS / vertices.max(1);
        draw.instances = draw.instances.min(most.max(1));
    }
    scene
}

/// The author's positions.
struct Positions<'a> {
    /// Before and now.
    scenes: [Scene; 2],
    frames: [Frame; 2],
    materials: &'a [String],
    plans: &'a [Plan],
}

/// Most runs of the vertex stage for each draw and frame.
const MOST_RUNS: u32 = 40_000;

impl Positions<'_> {
    /// Draws velocities and compares them.
    fn compare(
        &self,
        session: &Session<'_>,
        (alone, location): (&[Plan], usize),
        report: &mut VelocityReport,
    ) -> Result<(), Error> {
        let [earlier, scene] = &self.scenes;
        let previous = SceneInputs::new(session.gpu(), earlier)?;
        let inputs = SceneInputs::new(session.gpu(), scene)?.after(&previous);
        let variant = RenderVariant::new(alone, session.form())?;
        let mut prepared = Prepared::new(&inputs, &variant, &FrameSettings::of(scene))?;
        prepared.aim(&self.frames[1], DrawOrder::FrontToBack);
        let drawn = prepared.render()?;
        let Some(Some(color)) = drawn.colors.get(location) else {
            return Ok(());
        };
        let mut evaluated = self.evaluated();
        let why = evaluated.why.take();
        report.not_evaluated = report.not_evaluated.take().or(why);
        let camera = scene.cameras.first().map_or("", |c| &c.name);
        report.add(camera, &drawn, color, &evaluated);
        Ok(())
    }

    /// The triangles of all draws.
    fn evaluated(&self) -> Evaluated {
        // A pixel's triangle is found by its depth.
        if self.plans.iter().any(writes_depth) {
            return Evaluated {
                triangles: Vec::new(),
                why: Some(
                    "a material writes its own depth, which is that of no triangle".to_owned(),
                ),
            };
        }
        let (mut found, mut why) = (Vec::new(), None);
        for index in 0..self.scenes[1].draws.len() {
            let corners = [0, 1].map(|when| self.corners(index, when));
            let [before, now] = match corners {
                [Ok(before), Ok(now)] => [before, now],
                [Err(error), _] | [_, Err(error)] => {
                    why = why.or(Some(error));
                    continue;
                }
            };
            let mut both = Vec::new();
            for corner in before.into_iter().zip(now) {
                both.push(match corner {
                    (Ok(before), Ok(now)) => Some([before, now]),
                    (Err(error), _) | (_, Err(error)) => {
                        why = why.or(Some(error));
                        None
                    }
                });
            }
            let triangles = both.as_chunks::<3>().0.iter();
            found.extend(triangles.filter_map(|[a, b, c]| Some([(*a)?, (*b)?, (*c)?])));
        }
        Evaluated {
            triangles: found,
            why,
        }
    }

    /// The position of each corner of a draw, in one of the frames; none of a material that is not
    /// drawn.
    ///
    /// # Errors
    ///
    /// Why the draw cannot be evaluated.
    fn corners(&self, index: usize, when: usize) -> Result<Vec<Position>, String> {
        let (scene, frame) = (&self.scenes[when], &self.frames[when]);
        let missing = || "the scene has no such draw".to_owned();
        let draw = scene.draws.get(index).ok_or_else(missing)?;
        let material = scene.materials.get(draw.material).ok_or_else(missing)?;
        if !self.materials.contains(&material.name) {
            return Ok(Vec::new());
        }
        let plan = self.plans.get(draw.material).ok_or_else(missing)?;
        let pass = plan.main().ok_or("the plan has no main pass")?;
        let bound = bind::draw(scene, material, pass, draw, frame).map_err(|e| e.to_string())?;
        let program = plan.program(pass).ok_or("the main pass has no program")?;
        let entry = program.entry_point(ShaderStage::Vertex, &pass.vertex);
        let (entry, _) = entry.ok_or("the main pass has no vertex stage")?;
        let module = program.module();
        let texture = |lookup: &Lookup<'_>| texels::texel(&bound, lookup);
        let mut vertices = Vertices::new(module, bound.clone(), |_| true);
        vertices.add_arrays(module);
        vertices.environment.texture = &texture;
        let mut positions = Vec::new();
        for instance in 0..draw.instances {
            let mut known: BTreeMap<u32, Position> = BTreeMap::new();
            for corner in 0..bound.call.count {
                let vertex = vertices::index(&bound, corner).ok_or("an index is out of bounds")?;
                let run = || vertices.position(module, entry, vertex, instance);
                positions.push(known.entry(vertex).or_insert_with(run).clone());
            }
        }
        Ok(positions)
    }
}

/// Whether the main pass has a depth of its own.
fn writes_depth(plan: &Plan) -> bool {
    let main = plan
        .main()
        .and_then(|pass| Some((pass, plan.program(pass)?)));
    let Some((pass, program)) = main else {
        return false;
    };
    let name = pass.fragment.as_deref().unwrap_or_default();
    let Some((index, _)) = program.entry_point(ShaderStage::Fragment, name) else {
        return false;
    };
    let module = program.module();
    let outputs = reflect::outputs(module, &module.entry_points[index].function);
    let depth = Some(Binding::BuiltIn(BuiltIn::FragDepth));
    outputs.iter().any(|output| output.binding == depth)
}

/// What the interpreter says of the positions in both frames.
struct Evaluated {
    triangles: Vec<Triangle>,
    /// Why the first position that is not known is not.
    why: Option<String>,
}

/// A clip position, or why it is not known.
type Position = Result<[f32; 4], String>;

/// A point of a triangle at a pixel.
#[derive(Clone, Copy)]
struct Hit {
    /// How far its depth is from the one drawn.
    apart: f64,
    /// Its velocity, in parts of the picture.
    velocity: [f64; 2],
}

impl VelocityReport {
    fn add(&mut self, camera: &str, drawn: &Rendered, color: &ColorImage, all: &Evaluated) {
        let Some(depth) = &drawn.depth else { return };
        let [width, height] = depth.size;
        let mut hits: Vec<Option<Hit>> = vec![None; depth.values.len()];
        // Pixels of which two triangles have the depth and other velocities.
        let mut tied = vec![false; depth.values.len()];
        let sizes = [width, height].map(f64::from);
        let differs = |a: [f64; 2], b: [f64; 2]| {
            (0..2).any(|axis| (a[axis] - b[axis]).abs() * sizes[axis] > TOLERANCE)
        };
        for triangle in &all.triangles {
            rasterise(triangle, depth.size, &mut |pixel, z, velocity| {
                let apart = (z - f64::from(depth.values[pixel])).abs();
                if apart >= SAME_DEPTH {
                    return;
                }
                let known = hits[pixel];
                tied[pixel] |= known.is_some_and(|hit| differs(hit.velocity, velocity));
                if known.is_none_or(|hit| apart < hit.apart) {
                    hits[pixel] = Some(Hit { apart, velocity });
                }
            });
        }
        let half = color.texel_bytes() == 4;
        for (pixel, is_covered) in covered(drawn).enumerate() {
            if !is_covered {
                continue;
            }
            let Some(hit) = hits[pixel].filter(|_| !tied[pixel]) else {
                self.left_out += 1;
                continue;
            };
            self.pixels += 1;
            let [x, y, ..] = color.rgba(pixel).map(f64::from);
            for (value, expected, size) in
                [(x, hit.velocity[0], width), (y, hit.velocity[1], height)]
            {
                let size = f64::from(size);
                // Half a step of 11 bits.
                let rounding = if half { expected.abs() / 2048.0 } else { 0.0 };
                let error = ((value - expected).abs() - rounding).max(0.0) * size;
                self.longest = self.longest.max(expected.abs() * size);
                if error.is_nan() || error > self.worst {
                    self.worst = error;
                    let pixel = pixel as u32;
                    self.at = Some((camera.to_owned(), [pixel % width, pixel / width]));
                }
            }
        }
    }
}

/// Depths that count as equal: an adapter interpolates in 32-bit floats.
const SAME_DEPTH: f64 = 4e-6;

/// Calls `hit` with each pixel whose centre a triangle covers, its depth and its velocity there. A
/// triangle that reaches behind the camera in a frame has none.
fn rasterise(
    triangle: &Triangle,
    [width, height]: [u32; 2],
    hit: &mut dyn FnMut(usize, f64, [f64; 2]),
) {
    let corners = triangle.map(|corner| corner.map(|clip| clip.map(f64::from)));
    if corners
        .iter()
        .flatten()
        .any(|[.., w]| w.is_nan() || *w <= 0.0)
    {
        return;
    }
    let (wide, high) = (f64::from(width), f64::from(height));
    let screen = corners.map(|[_, [x, y, z, w]]| {
        let (x, y) = (x / w, y / w);
        [(x * 0.5 + 0.5) * wide, (0.5 - y * 0.5) * high, z / w]
    });
    let [a, b, c] = screen;
    let area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
    if area == 0.0 || !area.is_finite() {
        return;
    }
    let bounds = |axis: usize, most: f64| {
        let all = screen.map(|s| s[axis]);
        let low = all.iter().copied().fold(f64::INFINITY, f64::min);
        let high = all.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        (low - 1.0).clamp(0.0, most) as usize..(high + 1.0).clamp(0.0, most) as usize
    };
    for row in bounds(1, high) {
        for column in bounds(0, wide) {
            let (x, y) = (column as f64 + 0.5, row as f64 + 0.5);
            let edge = |p: [f64; 3], q: [f64; 3]| {
                ((q[0] - p[0]) * (y - p[1]) - (x - p[0]) * (q[1] - p[1])) / area
            };
            let weights = [edge(b, c), edge(c, a), edge(a, b)];
            // The adapter snaps corners to 1/256 of a pixel: its edges may be a little elsewhere.
            if weights.iter().any(|w| *w < -1e-2) {
                continue;
            }
            let z: f64 = weights.iter().zip(&screen).map(|(w, s)| w * s[2]).sum();
            let shares: [f64; 3] = std::array::from_fn(|i| weights[i] / corners[i][1][3]);
            let total: f64 = shares.iter().sum();
            let clip = |when: usize, axis: usize| -> f64 {
                let terms = shares.iter().zip(&corners);
                terms.map(|(s, corner)| s * corner[when][axis]).sum::<f64>() / total
            };
            let place = |when: usize, axis: usize| clip(when, axis) / clip(when, 3);
            let moved = |axis: usize| place(1, axis) - place(0, axis);
            let velocity = [moved(0) * 0.5, moved(1) * -0.5];
            hit(row * width as usize + column, z, velocity);
        }
    }
}
