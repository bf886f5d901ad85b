//! Compares shadow passes under the scene's light: the depth of a material's whole program and of
//! its depth-only version.
//!
//! The reference draws everything from the light. The variant draws with the cameras' uniforms,
//! except those its plan lists as [`view_dependent`](GpuPass::view_dependent). So a plan that
//! forgets one breaks its own shadow.

use std::collections::BTreeMap;

use naga_edit::interface;
use preshade_plan::contract::Verdict;
use preshade_plan::plan::{Attachment, GpuPass, Phase, Plan, SCENE_DEPTH};
use preshade_plan::state::{DepthDirection, Multisample};
use serde::{Deserialize, Serialize};

use super::error::counted;
use super::verify::{Settings, Timed, Variant};
use super::{Error, ErrorLadder, Estimate, FrameTime, Session, compare, time};
use preshade_draw::render::Rendered;
use preshade_draw::scene::DrawOrder;

/// The shadow passes of a variant, in the first frame of each camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ShadowReport {
    /// Width and height of the shadow map, in pixels.
    pub map: [u32; 2],
    /// Materials with a shadow pass. No other material is drawn.
    pub materials: Vec<String>,
    /// What the passes leave out of the author's decisions about coverage.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub left_out: Vec<String>,
    /// Pixels of the maps with anything in them, over all cameras.
    pub covered: u64,
    /// Pixels whose depth bits differ, over all cameras.
    pub changed_depth: u64,
    /// Largest distance of two depths, in steps between neighbouring 32-bit floats.
    pub depth_max_ulp: u64,
    /// Camera, column and row of the first pixel that differs.
    pub first_difference: Option<(String, [u32; 2])>,
    /// Milliseconds a map with the materials' whole programs (colours masked out); `None`: not
    /// timed.
    pub whole_ms: Option<FrameTime>,
    /// Milliseconds a map with the shadow passes.
    pub time_ms: Option<FrameTime>,
    /// The whole programs' time over the shadow passes'.
    pub speedup: Option<Estimate>,
}

impl ShadowReport {
    /// Whether the maps keep the promise to be equal. `invariant`: every material drawn marks its
    /// position `@invariant`. Without it, two programs may round positions differently.
    pub fn verdict(&self, invariant: bool) -> Verdict {
        if !self.left_out.is_empty() {
            return Verdict::NotMeasured {
                why: format!(
                    "its shadow leaves out what decides coverage in the original: {}",
                    self.left_out.join("; ")
                ),
            };
        }
        let Some((camera, [x, y])) = &self.first_difference else {
            return match self.covered {
                0 => Verdict::NotMeasured {
                    why: "the light sees nothing that has a shadow pass".to_owned(),
                },
                _ => Verdict::Holds,
            };
        };
        let r#where = format!(
            "the light's view, at camera `{camera}`: {} differ by up to {}, the first at {x}, {y}",
            counted(self.changed_depth, "depth"),
            counted(self.depth_max_ulp, "step")
        );
        match invariant {
            true => Verdict::Broken { r#where },
            false => Verdict::NotMeasured {
                why: format!(
                    "its shadow pass is exact against an original whose position is @invariant, \
                     and this one's is not (--invariant marks it): {where}"
                ),
            },
        }
    }
}

/// Whether a plan has a shadow pass.
pub(super) fn has_shadow(plan: &Plan) -> bool {
    shadow_pass(plan).is_some()
}

/// Whether the main pass of a plan marks its position `@invariant`.
pub(super) fn has_invariant_position(plan: &Plan) -> bool {
    let entry = plan.main().and_then(|pass| {
        let program = plan.program(pass)?;
        let (_, entry) = program.entry_point(naga::ShaderStage::Vertex, &pass.vertex)?;
        Some((program.module(), &entry.function))
    });
    let invariant = naga::Binding::BuiltIn(naga::BuiltIn::Position { invariant: true });
    entry.is_some_and(|(module, function)| {
        interface::outputs(module, function)
            .iter()
            .any(|io| io.binding.as_ref() == Some(&invariant))
    })
}

fn shadow_pass(plan: &Plan) -> Option<&GpuPass> {
    plan.passes.iter().find(|p| p.phase == Phase::Shadow)
}

/// Draws the shadow passes and the whole programs under the light, and compares their depths. Times
/// them in the first camera.
pub fn measure(
    session: &Session<'_>,
    variant: &Variant,
    settings: &Settings,
) -> Result<ShadowReport, Error> {
    let (gpu, scene) = (session.gpu(), session.scene());
    let (mut whole, mut shadows) = (Vec::new(), Vec::new());
    let mut listed = BTreeMap::new();
    let mut left_out = Vec::new();
    for (original, plan) in session.originals().iter().zip(&variant.plans) {
        if let Some(pass) = shadow_pass(plan) {
            listed.insert(plan.material.clone(), pass.view_dependent.clone());
            left_out.extend(pass.left_out.iter().cloned());
            whole.push(whole_program(original.clone(), plan, pass));
            shadows.push(alone(plan, pass));
        }
    }
    let mut report = ShadowReport {
        map: [scene.light.map; 2],
        materials: listed.keys().cloned().collect(),
        left_out,
        covered: 0,
        changed_depth: 0,
        depth_max_ulp: 0,
        first_difference: None,
        whole_ms: None,
        time_ms: None,
        speedup: None,
    };
    for (i, camera) in scene.cameras.iter().enumerate() {
        let Some(frame) = camera.frames.first() else {
            continue;
        };
        let lit = scene.seen_from_light(frame.time);
        let light = lit.light_frame(frame.time);
        let mut fed = lit.clone();
        fed.cameras = vec![camera.clone()];
        let fed = fed.with_uniforms_from(&light, &listed).map_err(|e| {
            preshade_draw::render::Error::Scene {
                draw: scene.name.clone(),
                message: e.to_string(),
            }
        })?;
        let on = |scene| Session::new(gpu, scene, session.form());
        let (lit, fed) = (on(&lit)?, on(&fed)?);
        let (mut reference, mut subject) = (lit.prepare(&whole)?, fed.prepare(&shadows)?);
        reference.aim(&light, DrawOrder::FrontToBack);
        subject.aim(&light, DrawOrder::FrontToBack);
        let depth = |picture: Rendered| Rendered {
            colors: Vec::new(),
            ..picture
        };
        let (before, after) = (depth(reference.render()?), depth(subject.render()?));
        report.add(&camera.name, &before, &compare(&before, &after)?);
        if i == 0 && settings.timed != Timed::No {
            let (_, timings) = time(gpu, &[&reference, &subject], &settings.timing, |_| {})?;
            if let [whole, shadow] = &timings[..] {
                report.whole_ms = Some(whole.time.clone());
                report.time_ms = Some(shadow.time.clone());
                report.speedup = Some(shadow.speedup);
            }
        }
    }
    Ok(report)
}

impl ShadowReport {
    fn add(&mut self, camera: &str, reference: &Rendered, error: &ErrorLadder) {
        let clear = DepthDirection::Forward.clear_depth();
        let depths = reference.depth.iter().flat_map(|d| &d.values);
        self.covered += depths.filter(|d| **d != clear).count() as u64;
        self.changed_depth += error.changed_depth;
        self.depth_max_ulp = self.depth_max_ulp.max(error.depth_max_ulp);
        if let (None, Some(at)) = (&self.first_difference, error.first_difference) {
            self.first_difference = Some((camera.to_owned(), at));
        }
    }
}

/// The map as the frame's only depth: the renderer reads that one back.
fn map_of(plan: &Plan, pass: &GpuPass) -> Vec<Attachment> {
    let map = pass
        .depth
        .as_ref()
        .and_then(|d| plan.attachment(&d.attachment));
    let rename = |map: &Attachment| Attachment {
        name: SCENE_DEPTH.to_owned(),
        ..map.clone()
    };
    map.map(rename).into_iter().collect()
}

fn into_map(mut pass: GpuPass) -> GpuPass {
    pass.phase = Phase::Depth;
    // Its pictures are the frame's own colours.
    for target in pass.targets.iter_mut().flatten() {
        target.attachment = None;
    }
    if let Some(depth) = &mut pass.depth {
        depth.attachment = SCENE_DEPTH.to_owned();
    }
    pass
}

/// A pass outside of the frame by itself: its depth and its pictures are those of the frame.
pub(super) fn alone(plan: &Plan, pass: &GpuPass) -> Plan {
    let mut alone = plan.clone();
    alone.attachments = map_of(plan, pass);
    alone.programs.retain(|key, _| *key == pass.program);
    alone.passes = vec![into_map(pass.clone())];
    alone.self_test = None;
    alone
}

/// The author's program as a host without preshade draws it into the map: with the pass's depth
/// state and without colours.
pub(super) fn whole_program(mut original: Plan, plan: &Plan, shadow: &GpuPass) -> Plan {
    original.attachments = map_of(plan, shadow);
    for pass in &mut original.passes {
        pass.depth.clone_from(&shadow.depth);
        pass.stencil = None;
        pass.multisample = Multisample::default();
        for target in pass.targets.iter_mut().flatten() {
            target.write_mask = 0;
        }
        *pass = into_map(pass.clone());
    }
    original
}
