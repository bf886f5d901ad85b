//! Load and store operations of a frame's render passes, merged from the passes of the plans.

use super::{ColorAttachments, FrameError, FrameLoad, FrameOps, FramePass};
use crate::plan::{BindingSource, GpuPass, Plan, SCENE_COLOR};
use crate::state::{AttachmentOps, LoadOp, StencilState, StoreOp};

#[derive(Clone, Debug, PartialEq, Eq)]
enum OperationTarget {
    Depth(String),
    Stencil(String),
    /// The scene's colour at a location.
    Scene(usize),
    /// A colour attachment of the plans.
    Named(String),
}

impl std::fmt::Display for OperationTarget {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Depth(name) | Self::Named(name) => write!(f, "`{name}`"),
            Self::Stencil(name) => write!(f, "the stencil of `{name}`"),
            Self::Scene(0) => write!(f, "`{SCENE_COLOR}`"),
            Self::Scene(location) => write!(f, "`{SCENE_COLOR}-{location}`"),
        }
    }
}

/// A member of a render pass.
#[derive(Clone, Copy)]
struct MergedPass<'p> {
    plan: &'p Plan,
    pass: &'p GpuPass,
}

/// The effects of earlier passes on each attachment.
#[derive(Default)]
struct Before<'p> {
    drawn: Vec<OperationTarget>,
    /// Discarded attachments, and the member that discarded each.
    discarded: Vec<(OperationTarget, MergedPass<'p>)>,
}

impl<'p> Before<'p> {
    /// Fails if an earlier pass discarded `slot`.
    fn need(&self, slot: &OperationTarget) -> Result<(), FrameError> {
        match self.discarded.iter().find(|(s, _)| s == slot) {
            None => Ok(()),
            Some((_, by)) => Err(FrameError::Discarded {
                material: by.plan.material.clone(),
                role: by.pass.role.name(),
                attachment: slot.to_string(),
            }),
        }
    }

    /// Merges the members' operations on `slot`.
    fn draw(
        &mut self,
        slot: OperationTarget,
        asked: &[(MergedPass<'p>, AttachmentOps)],
    ) -> Result<FrameOps, FrameError> {
        self.need(&slot)?;
        let loads = asked.iter().find(|(_, ops)| ops.load == LoadOp::Load);
        let clears = asked.iter().any(|(_, ops)| ops.load == LoadOp::ClearFirst);
        let load = match loads {
            _ if self.drawn.contains(&slot) => FrameLoad::Load,
            Some((by, _)) if clears => {
                return Err(FrameError::LoadMismatch {
                    material: by.plan.material.clone(),
                    role: by.pass.role.name(),
                    attachment: slot.to_string(),
                });
            }
            Some(_) => FrameLoad::Load,
            None => FrameLoad::Clear,
        };
        let stores = asked.iter().any(|(_, ops)| ops.store == StoreOp::Store);
        let store = match asked.first() {
            Some((by, _)) if !stores => {
                self.discarded.push((slot.clone(), *by));
                StoreOp::Discard
            }
            _ => StoreOp::Store,
        };
        self.drawn.push(slot);
        Ok(FrameOps { load, store })
    }
}

/// Fills in the operations of `passes`.
///
/// # Errors
/// [`FrameError::LoadMismatch`], [`FrameError::Discarded`].
pub(crate) fn resolve<'p>(
    plans: impl IntoIterator<Item = &'p Plan> + Clone,
    passes: &mut [FramePass],
) -> Result<(), FrameError> {
    let members: Vec<Vec<MergedPass<'p>>> = passes
        .iter()
        .map(|pass| {
            let find = |(material, index): &(String, usize)| {
                let mut all = plans.clone().into_iter();
                let plan = all.find(|p| p.material == *material)?;
                let pass = plan.passes.get(*index)?;
                Some(MergedPass { plan, pass })
            };
            pass.members.iter().filter_map(find).collect()
        })
        .collect();
    // Every pass that draws to the scene's colour gets all of its targets.
    let scene_targets = passes
        .iter()
        .zip(&members)
        .filter(|(pass, _)| pass.colors == ColorAttachments::Scene)
        .flat_map(|(_, members)| members.iter().map(|m| m.pass.targets.len()))
        .max()
        .unwrap_or(0);
    let mut before = Before::default();
    for (pass, members) in passes.iter_mut().zip(&members) {
        for binding in members.iter().flat_map(|m| &m.pass.bindings) {
            if let BindingSource::Attachment { name } = &binding.source {
                before.need(&OperationTarget::Depth(name.clone()))?;
                before.need(&OperationTarget::Named(name.clone()))?;
            }
        }
        depth(pass, members, &mut before)?;
        colors(pass, members, &mut before, scene_targets)?;
    }
    Ok(())
}

fn depth<'p>(
    pass: &mut FramePass,
    members: &[MergedPass<'p>],
    before: &mut Before<'p>,
) -> Result<(), FrameError> {
    let Some(name) = &pass.depth else {
        return Ok(());
    };
    let asked = |of: fn(&crate::state::DepthState) -> AttachmentOps| -> Vec<_> {
        let states = members
            .iter()
            .filter_map(|m| Some((*m, m.pass.depth.as_ref()?)));
        states.map(|(m, depth)| (m, of(depth))).collect()
    };
    let slot = OperationTarget::Depth(name.clone());
    if pass.depth_read_only {
        before.need(&slot)?;
    } else {
        pass.depth_ops = Some(before.draw(slot, &asked(|d| d.ops))?);
    }
    let has_stencil = |m: &MergedPass<'_>| {
        let format = m.plan.depth_format(name);
        format.is_some_and(crate::state::DepthFormat::has_stencil)
    };
    if !members.iter().any(has_stencil) {
        return Ok(());
    }
    let writes = |m: &MergedPass<'_>| m.pass.stencil.as_ref().is_some_and(StencilState::writes);
    let slot = OperationTarget::Stencil(name.clone());
    if pass.depth_read_only && !members.iter().any(writes) {
        before.need(&slot)?;
    } else {
        pass.stencil_ops = Some(before.draw(slot, &asked(|d| d.stencil_ops.unwrap_or_default()))?);
    }
    Ok(())
}

fn colors<'p>(
    pass: &mut FramePass,
    members: &[MergedPass<'p>],
    before: &mut Before<'p>,
    scene_targets: usize,
) -> Result<(), FrameError> {
    let slots: Vec<Option<OperationTarget>> = match &pass.colors {
        ColorAttachments::None => Vec::new(),
        ColorAttachments::Scene => (0..scene_targets)
            .map(|i| Some(OperationTarget::Scene(i)))
            .collect(),
        ColorAttachments::Named(names) => names
            .iter()
            .map(|name| name.clone().map(OperationTarget::Named))
            .collect(),
    };
    pass.color_ops = slots
        .into_iter()
        .enumerate()
        .map(|(location, slot)| {
            let Some(slot) = slot else { return Ok(None) };
            let target = |m: &MergedPass<'p>| {
                let target = m.pass.targets.get(location)?.as_ref()?;
                Some((*m, target.ops))
            };
            let asked: Vec<_> = members.iter().filter_map(target).collect();
            before.draw(slot, &asked).map(Some)
        })
        .collect::<Result<_, FrameError>>()?;
    Ok(())
}
