//! Compares shadow passes under the scene's light: the depth of a material's whole program and of
//! its depth-only version.
//!
//! The reference draws everything from the light. The variant draws with the cameras' uniforms,
//! except those its plan lists as [`view_dependent`](GpuPass::view_dependent). So a plan that
//! forgets one breaks its own shadow.

use std::collections::BTreeMap;

use naga_edit::interface;
use preshade_plan::contract::Verdict;
use preshade_plan::plan::{GpuPass, Phase, Plan};
use preshade_plan::state::DepthDirection;
use serde::{Deserialize, Serialize};

use super::depth_maps::{DepthReport, Words, alone, whole_program};
use super::{Error, Estimate, FrameTime, Session, Settings, Timed, Variant, time};
use preshade_draw::scene::DrawOrder;

/// The shadow passes of a variant, in the first frame of each camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ShadowReport {
    /// Width and height of the shadow map, in pixels.
    pub map: [u32; 2],
    #[serde(flatten)]
    pub depths: DepthReport,
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
        self.depths.verdict(invariant, &WORDS)
    }
}

const WORDS: Words = Words {
    pass: "shadow",
    exact: "shadow pass",
    unseen: "the light sees nothing that has a shadow pass",
    at: "the light's view, at",
};

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
    let mut depths = DepthReport::default();
    for (original, plan) in session.originals().iter().zip(&variant.plans) {
        if let Some(pass) = shadow_pass(plan) {
            listed.insert(plan.material.clone(), pass.view_dependent.clone());
            depths.left_out.extend(pass.left_out.iter().cloned());
            whole.push(whole_program(original.clone(), plan, pass));
            shadows.push(alone(plan, pass));
        }
    }
    depths.materials = listed.keys().cloned().collect();
    let mut report = ShadowReport {
        map: [scene.light.map; 2],
        depths,
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
        let pictures = [&reference.render()?, &subject.render()?];
        let clear = DepthDirection::Forward.clear_depth();
        report.depths.add(&camera.name, pictures, |d| d != clear)?;
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
