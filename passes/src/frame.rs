//! The plans of several materials merged into one frame: all pre-passes before any main pass, blended draws last, one shared depth.

use serde::{Deserialize, Serialize};

use crate::plan::{Attachment, Phase, Plan};

/// One render pass of a frame: a set of material passes that share their attachments. The host sorts draws within it as it likes
/// (opaque draws in any order, blended ones in its own).
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct FramePass {
    /// Phase of all its members.
    pub phase: Phase,
    /// Depth attachment; `None`: no depth.
    pub depth: Option<String>,
    /// Depth is bound read-only.
    pub depth_read_only: bool,
    /// Clear the depth attachment first: no earlier pass of the frame wrote it.
    pub clear_depth: bool,
    /// The pass has the scene's colour attachments.
    pub color: bool,
    /// Clear the colour attachments first.
    pub clear_color: bool,
    /// `(material, index in that material's plan.passes)`.
    pub members: Vec<(String, usize)>,
}

/// A frame.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct FramePlan {
    /// All depth attachments, each once.
    pub attachments: Vec<Attachment>,
    /// Render passes in order.
    pub passes: Vec<FramePass>,
}

/// Plans that cannot share a frame.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FrameError {
    /// Two plans describe an attachment of one name differently.
    #[error("attachment `{name}` is {a} in material `{first}` and {b} in material `{second}`")]
    AttachmentMismatch {
        /// Attachment.
        name: String,
        /// First material.
        first: String,
        /// Its description.
        a: String,
        /// Second material.
        second: String,
        /// Its description.
        b: String,
    },
}

impl FramePlan {
    /// Merges plans. Shadow passes are left out: they run under the host's light view, outside the camera's frame.
    ///
    /// # Errors
    /// When two plans disagree on an attachment's format or sample count.
    pub fn merge<'a>(
        plans: impl IntoIterator<Item = &'a Plan> + Clone,
    ) -> Result<Self, FrameError> {
        let mut attachments: Vec<(Attachment, String)> = Vec::new();
        for plan in plans.clone() {
            let bound = |name: &str| {
                plan.passes.iter().any(|p| {
                    p.phase != Phase::Shadow
                        && p.depth.as_ref().is_some_and(|d| d.attachment == name)
                })
            };
            for a in plan.attachments.iter().filter(|a| bound(&a.name)) {
                match attachments.iter_mut().find(|(b, _)| b.name == a.name) {
                    None => attachments.push((a.clone(), plan.material.clone())),
                    Some((b, first)) => {
                        if (a.format, a.samples) != (b.format, b.samples) {
                            let describe = |a: &Attachment| {
                                format!("{:?} x{}", a.format, a.samples).to_lowercase()
                            };
                            return Err(FrameError::AttachmentMismatch {
                                name: a.name.clone(),
                                first: first.clone(),
                                a: describe(b),
                                second: plan.material.clone(),
                                b: describe(a),
                            });
                        }
                        b.sampled |= a.sampled;
                    }
                }
            }
        }
        let mut passes: Vec<FramePass> = Vec::new();
        for phase in [Phase::Depth, Phase::Opaque, Phase::Blended] {
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
                    let color = phase != Phase::Depth || !pass.targets.is_empty();
                    let member = (plan.material.clone(), index);
                    let same = passes[first_of_phase..].iter_mut().find(|f| {
                        f.depth == depth && f.depth_read_only == read_only && f.color == color
                    });
                    match same {
                        Some(f) => f.members.push(member),
                        None => passes.push(FramePass {
                            phase,
                            depth,
                            depth_read_only: read_only,
                            clear_depth: false,
                            color,
                            clear_color: false,
                            members: vec![member],
                        }),
                    }
                }
            }
        }
        // The first pass to touch an attachment clears it.
        let mut cleared: Vec<&str> = Vec::new();
        let mut color_cleared = false;
        for pass in &mut passes {
            if let Some(name) = attachments
                .iter()
                .map(|(a, _)| a.name.as_str())
                .find(|n| Some(*n) == pass.depth.as_deref())
                && !cleared.contains(&name)
            {
                cleared.push(name);
                pass.clear_depth = true;
            }
            if pass.color && !color_cleared {
                color_cleared = true;
                pass.clear_color = true;
            }
        }
        Ok(Self {
            attachments: attachments.into_iter().map(|(a, _)| a).collect(),
            passes,
        })
    }
}
