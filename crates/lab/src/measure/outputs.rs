//! Compares the auxiliary pictures of a variant: their depth with that of the author's whole
//! program, and velocities with the positions of two frames.
//!
//! The positions are independent of the variant: the interpreter runs the author's whole vertex
//! stage in both frames, and triangles are rasterised here. A second program draws the numbers of
//! draws and instances, which show the triangles that a pixel may belong to. For velocities, no
//! texture is filtered.

use preshade_passes::transforms::outputs::{self, Outputs};
use preshade_plan::contract::Verdict;
use preshade_plan::pass::{Facts, Pass};
use preshade_plan::plan::{GpuPass, Phase, Plan};
use serde::{Deserialize, Serialize};

use super::depth_maps::{self, DepthReport, Words};
use super::{Error, Estimate, FrameTime, Session, Settings, Timed, Variant, time};
use preshade_draw::render::{FrameSettings, Prepared, Rendered, SceneInputs};
use preshade_draw::scene::{Camera, DrawOrder, Filter, Frame, Scene};

mod earlier;
mod pictures;
mod positions;

pub use earlier::{allowed, earlier};
pub(crate) use pictures::pictures;
use positions::{Drawn, Positions};

/// The auxiliary pictures of a variant, in one frame of each camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OutputsReport {
    #[serde(flatten)]
    pub depths: DepthReport,
    /// Velocities; `None`: none are drawn.
    pub velocity: Option<VelocityReport>,
    /// Milliseconds a frame of the main passes of the same materials; `None`: not timed.
    pub main_ms: Option<FrameTime>,
    /// Milliseconds a frame of the auxiliary passes.
    pub time_ms: Option<FrameTime>,
    /// The main passes' time over the auxiliary passes'.
    pub speedup: Option<Estimate>,
}

/// The comparison of velocities with positions.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct VelocityReport {
    pub pixels: u64,
    /// Covered pixels that were not compared: of a triangle that was not evaluated, of a point that
    /// was behind the camera, or where triangles of one instance lie so close that the depth does
    /// not identify the drawn one.
    pub left_out: u64,
    /// Largest way of a pixel between the frames, in pixels.
    pub longest: f64,
    /// Largest difference in pixels, less the adapter's freedom: a step of a half float where the
    /// target holds these, roundings of positions, and the snapping of corners to 1/256 of a pixel.
    pub worst: f64,
    /// Camera, column and row of the largest difference.
    pub at: Option<(String, [u32; 2])>,
    /// Why the first position that was not evaluated was not.
    pub not_evaluated: Option<String>,
}

/// The part of a pixel that a velocity may be wrong by.
pub const TOLERANCE: f64 = 1.0 / 256.0;

/// The part of the covered pixels that may be left out. With fewer compared, there is no verdict.
pub const MOST_LEFT_OUT: f64 = 0.05;

/// Beyond this part, a difference is no evidence either: another triangle may have been taken for
/// the one drawn.
const MOST_BY_CHANCE: f64 = 0.5;

impl OutputsReport {
    /// Whether depths are equal and velocities right. `invariant`: every material drawn marks its
    /// position `@invariant`. Without it, two programs may round positions differently.
    pub fn verdict(&self, invariant: bool) -> Verdict {
        let wrong = self
            .velocity
            .as_ref()
            .filter(|v| v.worst.is_nan() || v.worst > TOLERANCE);
        // Where few pixels could be matched, those may be matched by chance.
        let is_by_chance = |v: &VelocityReport| v.share_left_out() > MOST_BY_CHANCE;
        if let Some(velocity) = wrong.filter(|v| !is_by_chance(v)) {
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
        match self.depths.verdict(invariant, &WORDS) {
            Verdict::Holds => self
                .not_compared()
                .map_or(Verdict::Holds, |why| Verdict::NotMeasured { why }),
            verdict => verdict,
        }
    }

    /// Why too few velocities were compared, if so.
    fn not_compared(&self) -> Option<String> {
        let velocity = self.velocity.as_ref()?;
        let why = velocity.not_evaluated.as_deref();
        let why = why.map(|why| format!(": {why}")).unwrap_or_default();
        match velocity.share_left_out() {
            _ if velocity.pixels == 0 => Some(format!("no velocity was compared{why}")),
            share if share > MOST_LEFT_OUT => Some(format!(
                "the velocities of {:.1} % of the pixels were not compared{why}",
                share * 100.0
            )),
            _ => None,
        }
    }
}

const WORDS: Words = Words {
    pass: "pass",
    exact: "auxiliary depth",
    unseen: "no camera sees anything that has auxiliary pictures",
    at: "the auxiliary depth at",
};

impl VelocityReport {
    /// The part of the covered pixels that was not compared.
    pub fn share_left_out(&self) -> f64 {
        let all = self.pixels + self.left_out;
        self.left_out as f64 / all.max(1) as f64
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

/// The plans that draw auxiliary pictures, each with them alone.
fn alone(plans: &[Plan]) -> Vec<Plan> {
    let passes = plans.iter().filter_map(|plan| Some((plan, pass_of(plan)?)));
    passes
        .map(|(plan, pass)| depth_maps::alone(plan, pass))
        .collect()
}

/// Plans that draw the numbers of draws and instances. They are derived from the author's program,
/// and not from the variant that is judged.
fn numbered(session: &Session<'_>) -> Vec<Plan> {
    let params = outputs::OutputsParams {
        write: "id".to_owned(),
        ..outputs::OutputsParams::default()
    };
    let run = |plan: &Plan| Outputs::run(plan, &Facts::default(), &params).ok();
    let made = session.originals().iter().filter_map(run);
    alone(&made.map(|outcome| outcome.plan).collect::<Vec<_>>())
}

/// Draws and compares. `earlier`: the scene's draws in the previous frame.
pub fn measure(
    session: &Session<'_>,
    earlier: &Scene,
    variant: &Variant,
    settings: &Settings,
) -> Result<OutputsReport, Error> {
    let (gpu, scene) = (session.gpu(), session.scene());
    let (mut whole, mut main) = (Vec::new(), Vec::new());
    let mut location = None;
    let mut depths = DepthReport::default();
    for (original, plan) in session.originals().iter().zip(&variant.plans) {
        let Some(pass) = pass_of(plan) else { continue };
        location = location.or_else(|| velocity_of(pass));
        depths.materials.push(plan.material.clone());
        depths.left_out.extend(pass.left_out.iter().cloned());
        let mut original = original.clone();
        for pass in &mut original.passes {
            pass.multisample = preshade_plan::state::Multisample::default();
        }
        for attachment in &mut original.attachments {
            attachment.samples = 1;
        }
        whole.push(depth_maps::whole_program(original.clone(), plan, pass));
        main.push(original);
    }
    let alone = alone(&variant.plans);
    let numbered = location.map(|_| numbered(session));
    let mut report = OutputsReport {
        depths,
        velocity: location.map(|_| VelocityReport::default()),
        main_ms: None,
        time_ms: None,
        speedup: None,
    };
    for (i, camera) in scene.cameras.iter().enumerate() {
        let Some([before, now]) = frames(camera) else {
            continue;
        };
        let [earlier, scene] =
            [(earlier, before), (scene, now)].map(|(scene, frame)| seen_in(scene, camera, frame));
        let previous = SceneInputs::new(gpu, &earlier)?;
        let inputs = SceneInputs::new(gpu, &scene)?.after(&previous);
        let prepare = |plans: &[Plan]| -> Result<Prepared<'_>, Error> {
            let variant = preshade_scenes::variant(plans, session.form())?;
            let mut prepared = Prepared::new(&inputs, &variant, &FrameSettings::of(&scene))?;
            prepared.aim(&now, DrawOrder::FrontToBack);
            Ok(prepared)
        };
        let (reference, subject) = (prepare(&whole)?, prepare(&alone)?);
        let (drawn, reference) = (subject.render()?, reference.render()?);
        let depths = &mut report.depths;
        depths.add(&camera.name, [&reference, &drawn], is_covered)?;
        if let (Some(location), Some(velocity), Some(numbered)) =
            (location, &mut report.velocity, &numbered)
        {
            let scenes = [&earlier, &scene].map(unfiltered);
            let previous = SceneInputs::new(gpu, &scenes[0])?;
            let inputs = SceneInputs::new(gpu, &scenes[1])?.after(&previous);
            let [drawn, numbers] = [&alone, numbered].map(|plans| -> Result<Rendered, Error> {
                let variant = preshade_scenes::variant(plans, session.form())?;
                let settings = FrameSettings::of(&scenes[1]);
                let mut prepared = Prepared::new(&inputs, &variant, &settings)?;
                prepared.aim(&now, DrawOrder::FrontToBack);
                Ok(prepared.render()?)
            });
            let (drawn, numbers) = (drawn?, numbers?);
            let drawn = Drawn::new(&drawn, location, &numbers);
            let positions = Positions {
                scenes: scenes.each_ref(),
                frames: [before, now],
                plans: session.originals(),
            };
            positions.compare(&camera.name, drawn.as_ref(), velocity);
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

/// The scene without filtered textures. Adapters filter with as few as 8 bits, and so they and the
/// interpreter would disagree on where a texture moves a vertex.
fn unfiltered(scene: &Scene) -> Scene {
    let mut scene = scene.clone();
    for material in &mut scene.materials {
        let module = material.program.module();
        let samplers = module.global_variables.iter().filter(|(_, global)| {
            let inner = &module.types[global.ty].inner;
            matches!(inner, naga::TypeInner::Sampler { .. })
        });
        let names = samplers.filter_map(|(_, global)| global.name.clone());
        for name in names.collect::<Vec<_>>() {
            let sampler = material.samplers.entry(name).or_default();
            sampler.filter = Filter::Nearest;
            (sampler.min_filter, sampler.mip_filter) = (None, None);
        }
    }
    scene
}

/// The location of the velocities.
fn velocity_of(pass: &GpuPass) -> Option<usize> {
    pass.targets.iter().position(|target| {
        let attachment = target.as_ref().and_then(|t| t.attachment.as_deref());
        attachment == Some("outputs-velocity")
    })
}

/// Whether a pixel of that depth is drawn to. No depth of a surface is exactly that of the clear value, but for
/// those on a plane.
fn is_covered(depth: f32) -> bool {
    depth != 0.0 && depth != 1.0
}

/// Whether each pixel is drawn to.
fn covered(picture: &Rendered) -> impl Iterator<Item = bool> {
    let depths = picture.depth.iter().flat_map(|d| &d.values);
    depths.map(|d| is_covered(*d))
}

/// A scene with one frame of a camera alone, and one sample a pixel.
fn seen_in(scene: &Scene, camera: &Camera, frame: Frame) -> Scene {
    let mut scene = scene.clone().with_samples(1);
    scene.cameras = vec![Camera {
        name: camera.name.clone(),
        frames: vec![frame],
    }];
    scene
}
