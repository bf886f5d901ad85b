//! `shadow`: the depth-only version of a material, for drawing from a light's view.
//!
//! Goal: a shadow pass that agrees with the picture in alpha test and displacement, because it is a
//! slice of the same shader. Hand-written shadow passes in engines forget one or the other (Bevy
//! 8464, Godot 84211).
//!
//! ```text
//! before:  main     vs + fs
//!
//! after:   shadow   vs_shadow (+ fs_shadow)        depth only, the host binds the light's view in place of the camera's
//!          main     vs + fs                        as it was
//! ```
//!
//! The plan lists the camera uniforms that the slices read (`view_dependent`). The host must
//! replace the projection of the vertex stage. An alpha or a displacement that depends on the
//! camera would follow the light.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::analysis::implicit_inputs::PassEffect;
use crate::analysis::view::{self, StatedUniforms};
use crate::rebuild::depth_only::{self, VertexStage};
use crate::rebuild::depth_pass;
use crate::rebuild::place::PositionInvariance;
use preshade_plan::contract::Contract;
use preshade_plan::pass::{Example, Facts, Outcome, Pass, PassInfo, Refused, Use};
use preshade_plan::plan::{Attachment, Phase, Plan, Role};
use preshade_plan::state::{DepthDirection, DepthFormat, Multisample};
use shader_text::refusals::RefusalInfo;

/// Name of the depth attachment that the shadow pass writes.
pub(crate) const SHADOW_DEPTH: &str = "shadow-depth";

pub struct Shadow;

/// Parameters.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct ShadowParams {
    /// Format of the shadow map.
    pub format: DepthFormat,
}

impl Pass for Shadow {
    type Params = ShadowParams;

    const INFO: PassInfo = PassInfo {
        name: "shadow",
        summary: "the depth-only version of the material, to be drawn under a light's view",
        source: "falls out of depth-prepass: the same slices",
        when: "a light needs a shadow map of a material that cuts out or displaces",
        hurts: "never by itself: the main pass is untouched and the host decides which lights draw \
                it",
        reads_scene: false,
    };

    const REFUSALS: &'static [RefusalInfo] = &[];

    const EXAMPLES: &'static [Example] = &[Example {
        recipe: "shadow",
        uses: &[
            Use::Snapshot,
            Use::Inject,
            Use::Break,
            Use::Pictures(4),
            Use::Fuzz,
            Use::Growth,
            Use::Page("pages/leaf"),
            Use::Picture {
                scene: "fixtures/scenes/lit-room.toml --size 256x144 --frames 1 --order \
                        front-to-back",
                caption: "the main pass is as it was; the new pass is drawn under the light alone",
                rows: 1,
            },
        ],
    }];

    fn run(plan: &Plan, _facts: &Facts, params: &ShadowParams) -> Result<Outcome, Refused> {
        let opaque = depth_pass::alone(plan, Self::INFO.name)?;
        let slice = depth_only::slice(&opaque, VertexStage::Sliced, &[]);
        // A light's view promises no picture of the author's, so only refusals count.
        slice.assumptions(&opaque, plan, Self::INFO.name, &[PassEffect::SlicesForView])?;
        let mut next = plan.clone();
        let placed = slice.place(&opaque, "shadow", PositionInvariance::AsWritten, None);
        let depth = depth_pass::of_light(SHADOW_DEPTH.to_owned(), params.format);
        depth_pass::insert_own(
            &mut next,
            &opaque,
            placed,
            Role::Shadow,
            Phase::Shadow,
            depth,
            Self::INFO.name,
        )?;
        next.attachments.push(Attachment {
            sampled: true,
            ..Attachment::depth(SHADOW_DEPTH, params.format, DepthDirection::Forward, 1)
        });
        let step = slice.step(&opaque, Self::INFO.name, params, Contract::exact());
        next.steps.push(step);
        if opaque.reads_rasterised_depth() {
            next.notes.push(
                "what the shadow pass discards, or writes as depth, depends on the z of \
                 @builtin(position): there that is the light's depth, on some APIs with the bias \
                 in it that the host sets"
                    .to_owned(),
            );
        }
        depth_pass::finish(&mut next, "original");
        if let Some(pass) = next.passes.iter_mut().find(|p| p.role == Role::Shadow) {
            pass.multisample = Multisample::default();
            pass.view_dependent = next
                .programs
                .get(Role::Shadow.name())
                .map(|program| view::view_dependent(program, &StatedUniforms::default()))
                .unwrap_or_default();
        }
        let what = "depth-only vertex and fragment stage for a light's view".to_owned();
        Ok(slice.outcome(&opaque, what, next))
    }
}
