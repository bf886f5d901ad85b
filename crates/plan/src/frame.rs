//! Merges the plans of several materials into one frame: all pre-passes before any main pass,
//! blended draws last, one shared depth.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

use crate::plan::{Attachment, Draws, GpuPass, Phase, Plan};
use crate::state::StoreOp;

mod operations;

/// The colour attachments of a render pass.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ColorAttachments {
    /// None.
    None,
    /// The scene's own, which the host owns.
    Scene,
    /// Attachments of the plans, by location.
    Named(Vec<Option<String>>),
}

impl ColorAttachments {
    fn of(plan: &Plan, pass: &GpuPass) -> Result<Self, FrameError> {
        let names: Vec<Option<String>> = pass
            .targets
            .iter()
            .map(|t| t.as_ref()?.attachment.clone())
            .collect();
        let named = names.iter().flatten().count();
        if named == 0 {
            let scene =
                !matches!(pass.phase, Phase::Depth | Phase::Classify) || !pass.targets.is_empty();
            return Ok(if scene { Self::Scene } else { Self::None });
        }
        if named < pass.targets.iter().flatten().count() {
            return Err(FrameError::MixedTargets {
                material: plan.material.clone(),
                role: pass.role.name(),
            });
        }
        Ok(Self::Named(names))
    }

    /// The names of the plans' attachments.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        let names: &[Option<String>] = match self {
            Self::Named(names) => names,
            Self::None | Self::Scene => &[],
        };
        names.iter().flatten().map(String::as_str)
    }
}

/// Load operation of an attachment in a render pass of a frame (`GPULoadOp`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum FrameLoad {
    /// Clears to the attachment's clear value, the scene's colour to the host's, stencil to 0.
    Clear,
    /// Keeps the content of the earlier passes, or of the time before the frame.
    Load,
}

/// Operations of an attachment in a render pass of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct FrameOps {
    /// Before the pass.
    pub load: FrameLoad,
    /// After the pass: `discard` only if every member discards.
    pub store: StoreOp,
}

/// One render pass of a frame: a set of material passes that share their attachments. The host may
/// sort opaque draws within it freely; blended ones keep the host's order.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct FramePass {
    /// Phase of all its members.
    pub phase: Phase,
    /// Depth attachment, if any.
    pub depth: Option<String>,
    /// Depth is bound read-only.
    pub depth_read_only: bool,
    /// Operations of the depth aspect; `None` without depth or if it is read-only.
    pub depth_ops: Option<FrameOps>,
    /// Operations of the stencil aspect; `None` if the format has none or it is read-only.
    pub stencil_ops: Option<FrameOps>,
    /// Colour attachments.
    pub colors: ColorAttachments,
    /// Operations of the colour attachments by location, `None` in a hole. For the scene's colour,
    /// all locations that any pass of the frame has.
    pub color_ops: Vec<Option<FrameOps>>,
    /// `(material, index in that material's plan.passes)`.
    pub members: Vec<(String, usize)>,
}

/// A frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct FramePlan {
    /// All attachments, each once; the scene's colour is the host's.
    pub attachments: Vec<Attachment>,
    /// Render passes in order.
    pub passes: Vec<FramePass>,
}

/// Plans that cannot share a frame.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FrameError {
    /// Two plans describe an attachment of the same name differently.
    #[error("attachment `{name}` is {a} in material `{first}` and {b} in material `{second}`")]
    AttachmentMismatch {
        name: String,
        first: String,
        /// The attachment as the first material describes it.
        a: String,
        second: String,
        /// The attachment as the second material describes it.
        b: String,
    },
    /// A pass draws both to the scene's colour and to attachments of its own.
    #[error(
        "the {role} pass of material `{material}` draws to the scene's colour and to attachments \
         of its own"
    )]
    MixedTargets {
        material: String,
        role: &'static str,
    },
    /// Passes share a render pass and an attachment, and only some of them clear it.
    #[error(
        "the {role} pass of material `{material}` loads {attachment}, and another that shares its \
         render pass clears it"
    )]
    LoadMismatch {
        /// The material that loads it.
        material: String,
        role: &'static str,
        /// With the aspect.
        attachment: String,
    },
    /// Two plans define a pass that runs once per frame differently.
    #[error(
        "the {role} pass runs once for the frame, and those of materials `{first}` and `{second}` \
         are not the same"
    )]
    OnceMismatch {
        role: &'static str,
        first: String,
        second: String,
    },
    /// A pass discards an attachment that a later pass uses.
    #[error(
        "the {role} pass of material `{material}` discards {attachment}, which a later pass of the \
         frame needs"
    )]
    Discarded {
        /// The material that discards it.
        material: String,
        role: &'static str,
        /// With the aspect.
        attachment: String,
    },
}

impl FramePlan {
    /// Merges plans. Passes of shadow maps and auxiliary pictures are skipped: they run outside the
    /// camera's frame.
    ///
    /// # Errors
    ///
    /// If two plans disagree on an attachment's format, sample count or clear value, a
    /// pass mixes the scene's colour with attachments, or load and store operations contradict each
    /// other.
    pub fn merge<'a>(
        plans: impl IntoIterator<Item = &'a Plan> + Clone,
    ) -> Result<Self, FrameError> {
        let mut attachments: Vec<(Attachment, String)> = Vec::new();
        for plan in plans.clone() {
            let bound = |name: &str| {
                let targets = |p: &GpuPass| {
                    p.targets
                        .iter()
                        .flatten()
                        .any(|t| t.attachment.as_deref() == Some(name))
                };
                plan.passes.iter().any(|p| {
                    p.phase.is_of_frame()
                        && (p.depth.as_ref().is_some_and(|d| d.attachment == name) || targets(p))
                })
            };
            for a in plan.attachments.iter().filter(|a| bound(&a.name)) {
                match attachments.iter_mut().find(|(b, _)| b.name == a.name) {
                    None => attachments.push((a.clone(), plan.material.clone())),
                    Some((b, first)) => {
                        if !a.is_like(b) {
                            return Err(FrameError::AttachmentMismatch {
                                name: a.name.clone(),
                                first: first.clone(),
                                a: b.description(),
                                second: plan.material.clone(),
                                b: a.description(),
                            });
                        }
                        b.sampled |= a.sampled;
                    }
                }
            }
        }
        let mut passes: Vec<FramePass> = Vec::new();
        let phases = (plans.clone().into_iter())
            .flat_map(|plan| &plan.passes)
            .map(|p| p.phase);
        let phases: BTreeSet<Phase> = phases.filter(|phase| phase.is_of_frame()).collect();
        for phase in phases {
            let first_of_phase = passes.len();
            for plan in plans.clone() {
                for (index, pass) in plan
                    .passes
                    .iter()
                    .enumerate()
                    .filter(|(_, p)| p.phase == phase)
                {
                    let depth = pass.depth.as_ref().map(|d| d.attachment.clone());
                    let read_only = pass.depth.as_ref().is_some_and(|d| d.read_only);
                    let colors = ColorAttachments::of(plan, pass)?;
                    let member = (plan.material.clone(), index);
                    if pass.draws == Draws::Once
                        && let Some((first, stands)) = passes[first_of_phase..]
                            .iter()
                            .filter(|f| f.depth == depth && f.colors == colors)
                            .find_map(|f| once(plans.clone(), f))
                    {
                        if stands != pass {
                            return Err(FrameError::OnceMismatch {
                                role: pass.role.name(),
                                first,
                                second: plan.material.clone(),
                            });
                        }
                        continue;
                    }
                    let same = passes[first_of_phase..].iter_mut().find(|f| {
                        f.depth == depth && f.depth_read_only == read_only && f.colors == colors
                    });
                    match same {
                        Some(f) => f.members.push(member),
                        None => passes.push(FramePass {
                            phase,
                            depth,
                            depth_read_only: read_only,
                            depth_ops: None,
                            stencil_ops: None,
                            colors,
                            color_ops: Vec::new(),
                            members: vec![member],
                        }),
                    }
                }
            }
        }
        operations::resolve(plans, &mut passes)?;
        Ok(Self {
            attachments: attachments.into_iter().map(|(a, _)| a).collect(),
            passes,
        })
    }
}

/// The member that runs once per frame, with its material.
fn once<'a>(
    plans: impl IntoIterator<Item = &'a Plan>,
    frame: &FramePass,
) -> Option<(String, &'a GpuPass)> {
    let (material, index) = frame.members.first()?;
    let plan = plans.into_iter().find(|p| p.material == *material)?;
    let pass = plan.passes.get(*index)?;
    (pass.draws == Draws::Once).then(|| (material.clone(), pass))
}
