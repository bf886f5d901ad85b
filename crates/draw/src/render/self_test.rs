//! Runs a plan's self-test.

use preshade_plan::frame::{ColorAttachments, FrameLoad, FrameOps, FramePass};
use preshade_plan::plan::{GpuPass, Phase, Plan, SamplesPassed, SelfTest, SelfTestDraw};
use preshade_plan::state::{DepthFormat, StoreOp};
use serde::{Deserialize, Serialize};

use super::{Error, FrameSettings, Prepared, SceneInputs, Variant};
use crate::scene::DrawOrder;

/// The result of a self-test. WebGPU guarantees only whether an occlusion query is 0, so sample
/// counts are informative.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "result", rename_all = "kebab-case")]
pub enum SelfTestResult {
    /// Every run passed, and each drew something.
    Held {
        /// Number of samples in draws that must draw some.
        samples: u64,
    },
    /// Samples passed that should not have: the host must use the plan's fallback.
    Failed {
        /// The plan's description of this failure.
        failure: String,
        camera: String,
        /// Number of samples that passed.
        samples: u64,
    },
    /// The test could not decide.
    NotRun { why: String },
}

/// The draws of a plan's self-test as a plan: each draw is a pass, in a render pass of its own.
#[derive(Debug)]
pub struct SelfTestPlan<'a> {
    test: &'a SelfTest,
    /// The plan to emit for [`Self::run`].
    pub plan: Plan,
    passes: Vec<FramePass>,
}

impl<'a> SelfTestPlan<'a> {
    /// The draws of the self-test of `plan`. `None` if it has none.
    ///
    /// # Errors
    /// [`Error::Plan`] if the self-test names a missing pass.
    pub fn of(plan: &'a Plan) -> Result<Option<Self>, Error> {
        plan.self_test
            .as_ref()
            .map(|test| draws(plan, test))
            .transpose()
    }

    /// Runs the self-test on its material's draws, in the first frame of each camera. `variant`
    /// comes from [`Self::plan`]. Overwrites the uniforms of [`SceneInputs::set_frame`].
    ///
    /// # Errors
    /// As [`Prepared::new`] and [`Prepared::draw`].
    pub fn run(self, inputs: &SceneInputs<'_>, variant: Variant) -> Result<SelfTestResult, Error> {
        let (scene, settings) = (inputs.scene(), FrameSettings::of(inputs.scene()));
        let variant = variant.in_passes(self.passes);
        let mut prepared = Prepared::new(inputs, &variant, &settings)?;
        let mut laid = vec![0; self.test.runs.len()];
        for camera in &scene.cameras {
            let Some(frame) = camera.frames.first() else {
                continue;
            };
            inputs.set_frame(frame)?;
            prepared.aim(frame, DrawOrder::AsGiven);
            let mut passed = prepared.draw_occluded()?.into_iter();
            for (run, laid) in self.test.runs.iter().zip(&mut laid) {
                let queries: Vec<u64> = passed.by_ref().take(run.draws.len()).collect();
                let of = |what: SamplesPassed| {
                    let draws = run.draws.iter().zip(&queries);
                    draws
                        .filter(move |(draw, _)| draw.samples == what)
                        .map(|(_, n)| *n)
                };
                let failed: u64 = of(SamplesPassed::None).sum();
                if failed > 0 {
                    return Ok(SelfTestResult::Failed {
                        failure: run.failure.clone(),
                        camera: camera.name.clone(),
                        samples: failed,
                    });
                }
                // A draw of the run may be invisible to this camera; then the camera has no result.
                if of(SamplesPassed::Some).all(|n| n > 0) {
                    *laid += of(SamplesPassed::Some).sum::<u64>();
                }
            }
        }
        Ok(match laid.iter().all(|n| *n > 0) {
            true => SelfTestResult::Held {
                samples: laid.iter().sum(),
            },
            false => SelfTestResult::NotRun {
                why: "no camera sees the material".to_owned(),
            },
        })
    }
}

fn draws<'a>(plan: &Plan, test: &'a SelfTest) -> Result<SelfTestPlan<'a>, Error> {
    let mut drawn = plan.clone();
    drawn.self_test = None;
    for (key, program) in plan.original.iter().flat_map(|o| &o.programs) {
        drawn.programs.insert(of_original(key), program.clone());
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
                // The test does not look at colours.
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
    Ok(SelfTestPlan {
        test,
        plan: drawn,
        passes,
    })
}

/// The key of a program of the original, distinct from those of the plan.
fn of_original(key: &str) -> String {
    format!("original-{key}")
}

/// The pass as the test draws it.
fn pass(plan: &Plan, draw: &SelfTestDraw) -> Result<GpuPass, Error> {
    let failed = |message: &str| Error::Plan {
        material: plan.material.clone(),
        message: format!("its self-test draws a {} pass {message}", draw.role.name()),
    };
    let is_drawn = |p: &&GpuPass| p.role == draw.role;
    let own = plan.passes.iter().filter(|_| !draw.original).find(is_drawn);
    let original = || {
        let pass = plan.original.as_ref()?.passes.iter().find(is_drawn)?;
        let program = of_original(&pass.program);
        Some(GpuPass {
            program,
            ..pass.clone()
        })
    };
    let pass = own.cloned().or_else(original);
    let mut pass = pass.ok_or_else(|| failed("that it does not have"))?;
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

/// The colour attachments of a pass.
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
