//! A plan's self-test, executed as its data says.

use preshade_passes::frame::{ColorAttachments, FrameLoad, FrameOps, FramePass};
use preshade_passes::plan::{GpuPass, Phase, Plan, SamplesPassed, SelfTest, SelfTestDraw};
use preshade_passes::state::{DepthFormat, StoreOp};
use serde::{Deserialize, Serialize};

use super::{Error, FrameSettings, Prepared, SceneInputs, ShaderForm, Variant};
use crate::scene::DrawOrder;

/// What a self-test said. Samples are as the adapter's occlusion queries give them: WebGPU promises of a query no more than whether it is 0.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "result", rename_all = "kebab-case")]
pub enum SelfTestResult {
    /// Every run passed, and each saw something.
    Held {
        /// Samples that the draws laid which must lay some.
        samples: u64,
    },
    /// Samples passed where none must: the plan's fallback is to be taken.
    Failed {
        /// What the plan says of it.
        failure: String,
        /// Camera.
        camera: String,
        /// Samples that passed.
        samples: u64,
    },
    /// It said nothing.
    NotRun {
        /// Why.
        why: String,
    },
}

/// Runs the self-test of `plan` on the scene's draws of its material, in the first frame of each camera. `None` for a plan without one. Changes the
/// uniforms that [`SceneInputs::set_frame`] set.
///
/// # Errors
/// As [`Prepared::new`] and [`Prepared::draw`], and [`Error::Plan`] for a self-test that names a pass the plan does not have.
pub fn self_test(
    inputs: &SceneInputs<'_>,
    plan: &Plan,
    form: ShaderForm,
) -> Result<Option<SelfTestResult>, Error> {
    let Some(test) = &plan.self_test else {
        return Ok(None);
    };
    let (scene, settings) = (inputs.scene(), FrameSettings::of(inputs.scene()));
    let variant = variant(plan, test, form)?;
    let mut prepared = Prepared::new(inputs, &variant, &settings)?;
    let mut laid = vec![0; test.runs.len()];
    for camera in &scene.cameras {
        let Some(frame) = camera.frames.first() else {
            continue;
        };
        inputs.set_frame(frame)?;
        prepared.aim(frame, DrawOrder::AsGiven);
        let mut passed = prepared.draw_occluded()?.into_iter();
        for (run, laid) in test.runs.iter().zip(&mut laid) {
            let queries: Vec<u64> = passed.by_ref().take(run.draws.len()).collect();
            let of = |what: SamplesPassed| {
                let draws = run.draws.iter().zip(&queries);
                draws
                    .filter(move |(draw, _)| draw.samples == what)
                    .map(|(_, n)| *n)
            };
            let failed: u64 = of(SamplesPassed::None).sum();
            if failed > 0 {
                return Ok(Some(SelfTestResult::Failed {
                    failure: run.failure.clone(),
                    camera: camera.name.clone(),
                    samples: failed,
                }));
            }
            // A camera that some draw of the run does not see says nothing of the others.
            if of(SamplesPassed::Some).all(|n| n > 0) {
                *laid += of(SamplesPassed::Some).sum::<u64>();
            }
        }
    }
    Ok(Some(match laid.iter().all(|n| *n > 0) {
        true => SelfTestResult::Held {
            samples: laid.iter().sum(),
        },
        false => SelfTestResult::NotRun {
            why: "no camera sees the material".to_owned(),
        },
    }))
}

/// The plan with the draws of its self-test for passes, each a render pass of its own.
fn variant(plan: &Plan, test: &SelfTest, form: ShaderForm) -> Result<Variant, Error> {
    let mut drawn = plan.clone();
    drawn.self_test = None;
    for (key, program) in plan.original.iter().flat_map(|o| &o.programs) {
        let own = drawn.programs.entry(key.clone());
        own.or_insert_with(|| program.clone());
    }
    drawn.attachments.push(test.attachment.clone());
    drawn.passes.clear();
    let mut passes = Vec::new();
    let format = test.attachment.format.depth();
    let stencil = format.is_some_and(DepthFormat::has_stencil);
    let operations = |first: bool| FrameOps {
        load: match first {
            true => FrameLoad::Clear,
            false => FrameLoad::Load,
        },
        store: StoreOp::Store,
    };
    for run in &test.runs {
        let mut cleared: Vec<&str> = Vec::new();
        for draw in &run.draws {
            let pass = pass(plan, draw)?;
            let first = !cleared.contains(&draw.attachment.as_str());
            if first {
                cleared.push(&draw.attachment);
            }
            passes.push(FramePass {
                phase: pass.phase,
                depth: Some(draw.attachment.clone()),
                depth_read_only: false,
                depth_ops: Some(operations(first)),
                stencil_ops: stencil.then(|| operations(first)),
                colors: colors(&pass),
                // Nobody looks at the colours.
                color_ops: pass
                    .targets
                    .iter()
                    .map(|t| t.as_ref().map(|_| operations(true)))
                    .collect(),
                members: vec![(plan.material.clone(), drawn.passes.len())],
            });
            drawn.passes.push(pass);
        }
    }
    Ok(Variant::new(&[drawn], form)?.in_passes(passes))
}

/// The pass as the test draws it.
fn pass(plan: &Plan, draw: &SelfTestDraw) -> Result<GpuPass, Error> {
    let failed = |message: &str| Error::Plan {
        material: plan.material.clone(),
        message: format!("its self-test draws a {} pass {message}", draw.role.name()),
    };
    let original = plan.original.iter().flat_map(|o| &o.passes);
    let mut pass = plan
        .passes
        .iter()
        .chain(original)
        .find(|p| p.role == draw.role)
        .cloned()
        .ok_or_else(|| failed("that it does not have"))?;
    let depth = pass
        .depth
        .as_mut()
        .ok_or_else(|| failed("without a depth state"))?;
    depth.attachment.clone_from(&draw.attachment);
    depth.compare = draw.compare;
    depth.write = draw.write;
    depth.read_only = false;
    pass.stencil = None;
    pass.phase = Phase::Opaque;
    Ok(pass)
}

/// The colour attachments that a pass has by itself.
fn colors(pass: &GpuPass) -> ColorAttachments {
    let names: Vec<Option<String>> = pass
        .targets
        .iter()
        .map(|t| t.as_ref()?.attachment.clone())
        .collect();
    if names.iter().any(Option::is_some) {
        ColorAttachments::Named(names)
    } else if names.is_empty() {
        ColorAttachments::None
    } else {
        ColorAttachments::Scene
    }
}
