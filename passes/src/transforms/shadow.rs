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

use naga::{AddressSpace, TypeInner, VectorSize};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::analysis::coverage;
use crate::analysis::implicit_inputs::PassEffect;
use crate::analysis::opaque::Opaque;
use crate::analysis::refusals as shared;
use crate::core::contract::Contract;
use crate::core::pass::{Example, Facts, Outcome, Pass, PassInfo, Refusal, Refused, Use};
use crate::core::plan::{Attachment, Phase, Plan, Role, Step};
use crate::core::program::Program;
use crate::core::refusals::RefusalInfo;
use crate::core::state::{
    AttachmentOps, CompareFunction, DepthBias, DepthDirection, DepthFormat, DepthState, Multisample,
};
use crate::rebuild::depth_only::{self, VertexStage};
use crate::rebuild::depth_pass;
use crate::rebuild::place::PositionInvariance;

/// Name of the depth attachment that the shadow pass writes.
pub const SHADOW_DEPTH: &str = "shadow-depth";

/// The pass.
pub struct Shadow;

/// Parameters.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct Params {
    /// Format of the shadow map.
    pub format: DepthFormat,
}

impl Pass for Shadow {
    type Params = Params;

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
                caption: "the main pass is as it was; what is new is drawn under the light alone",
                rows: 1,
            },
        ],
    }];

    fn run(plan: &Plan, _facts: &Facts, params: &Params) -> Result<Outcome, Refused> {
        let opaque = check(plan)?;
        let slice = depth_only::slice(&opaque, VertexStage::Sliced);
        // A light's view promises no picture of the author's: only what it cannot draw counts.
        slice.assumptions(&opaque, plan, Self::INFO.name, &[PassEffect::SlicesForView])?;
        let mut next = plan.clone();
        let placed = slice.place(&opaque, "shadow", PositionInvariance::AsWritten, None);
        // A shadow map is a frame of its own, with forward depth and one sample.
        let depth = DepthState {
            attachment: SHADOW_DEPTH.to_owned(),
            compare: CompareFunction::Less,
            write: true,
            // The camera's bias is in units of the camera's format and direction. A light needs its
            // own, which the host knows.
            bias: DepthBias::default(),
            read_only: false,
            ops: AttachmentOps::default(),
            stencil_ops: params.format.has_stencil().then(AttachmentOps::default),
        };
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
        next.steps.push(Step {
            pass: Self::INFO.name.to_owned(),
            site: slice.key(&opaque),
            params: serde_json::to_value(params).unwrap_or_default(),
            contract: Contract::exact(),
        });
        let decided = opaque.fragment.filter(|_| opaque.decides.anything());
        if decided.is_some_and(|fragment| {
            let slice = opaque.decides.slice(&opaque.graph, fragment);
            coverage::reads_rasterised_depth(opaque.program, &slice)
        }) {
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
                .map(view_dependent)
                .unwrap_or_default();
        }
        let what = "depth-only vertex and fragment stage for a light's view".to_owned();
        Ok(slice.outcome(&opaque, what, next))
    }
}

/// A light's view has one sample and no colour, so alpha to coverage does not apply.
fn check(plan: &Plan) -> Result<Opaque<'_>, Vec<Refusal>> {
    let opaque = Opaque::examine(plan, Shadow::INFO.name)?;
    if opaque.decides.alpha {
        return Err(vec![Refusal::new(
            Shadow::INFO.name,
            &shared::ALPHA_TO_COVERAGE,
            "coverage comes from alpha, sample by sample, and a shadow map has one sample and no \
             colour target to take alpha from",
            "test alpha by discard",
        )]);
    }
    Ok(opaque)
}

/// Uniforms with camera, view, eye or projection in their name or a member's, and members of such
/// structs that give its place or range. The name is all that a shader reveals about a matrix.
/// `verify` takes these from the light and all others from the camera. If no name tells, all
/// matrices that the pass reads count, except those of an object.
fn view_dependent(program: &Program) -> Vec<String> {
    let module = program.module();
    let says_view = |name: &str| {
        let name = name.to_lowercase();
        let part_of = [
            "camera", "view", "eye", "proj", "mvp", "screen", "clip", "znear", "zfar",
        ];
        let whole = ["vp", "near", "far", "near_plane", "far_plane", "transform"];
        part_of.iter().any(|w| name.contains(w)) || whole.contains(&name.trim_start_matches("u_"))
    };
    let says_place = |name: &str| {
        let name = name.to_lowercase();
        ["pos", "origin", "near", "far", "matrix", "vp"]
            .iter()
            .any(|w| name.contains(w))
    };
    let mut found = Vec::new();
    for (_, global) in module
        .global_variables
        .iter()
        .filter(|(_, g)| g.space == AddressSpace::Uniform)
    {
        let variable = global.name.clone().unwrap_or_default();
        let struct_name = module.types[global.ty].name.as_deref().unwrap_or("");
        let of_view = says_view(&variable) || says_view(struct_name);
        let members = match &module.types[global.ty].inner {
            TypeInner::Struct { members, .. } => members.as_slice(),
            _ => &[],
        };
        if says_view(&variable) && members.is_empty() {
            found.push(variable.clone());
        }
        found.extend(
            members
                .iter()
                .filter_map(|m| m.name.as_deref())
                .filter(|m| says_view(m) || (of_view && says_place(m)))
                .map(|m| format!("{variable}.{m}")),
        );
    }
    if found.is_empty() {
        return matrices(module);
    }
    found
}

/// Matrices of uniforms whose names are not those of an object. Where no name tells the camera's
/// matrix, it is among them.
fn matrices(module: &naga::Module) -> Vec<String> {
    let is_of_object = |name: &str| {
        let name = name.to_lowercase();
        let of_object = [
            "model", "world", "object", "local", "bone", "joint", "instance",
        ];
        of_object.iter().any(|w| name.contains(w))
    };
    let is_matrix = |ty: naga::Handle<naga::Type>| {
        let inner = &module.types[ty].inner;
        matches!(inner, TypeInner::Matrix { columns, rows, .. }
            if (*columns, *rows) == (VectorSize::Quad, VectorSize::Quad))
    };
    let uniforms = module.global_variables.iter().map(|(_, global)| global);
    let uniforms = uniforms.filter(|global| global.space == AddressSpace::Uniform);
    let paths = uniforms.flat_map(|global| {
        let variable = global.name.clone().unwrap_or_default();
        match &module.types[global.ty].inner {
            TypeInner::Struct { members, .. } => {
                let matrices = members.iter().filter(|m| is_matrix(m.ty));
                let names = matrices.filter_map(|m| m.name.as_deref());
                names.map(|name| format!("{variable}.{name}")).collect()
            }
            _ if is_matrix(global.ty) => vec![variable],
            _ => Vec::new(),
        }
    });
    paths.filter(|path| !is_of_object(path)).collect()
}
