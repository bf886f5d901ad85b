//! Whether anybody sees the alpha that a render pass draws.
//!
//! The page shows an opaque canvas without its alpha. Many pages still blend alpha there, because they took the
//! state from an example. Draws of such a material depend on their order in alpha only, so a scene that leaves
//! alpha out can put them behind a depth pre-pass or sort them.

use std::collections::BTreeSet;

use preshade_passes::state::{Blend, ColorTarget};

use super::file::{AlphaMode, BlendComponent, Command, RenderPassDescriptor, RenderPipeline};
use super::folder::Capture;
use super::pass::{self, Pass};

/// The bit of alpha in a write mask.
const ALPHA: u8 = 0b1000;

/// Whether a scene of the pass leaves alpha out: a draw blends alpha alone, and nobody sees it. Where no draw does,
/// alpha stands in nobody's way, and a write mask could.
pub(super) fn is_left_out(capture: &Capture, pass: &Pass<'_>) -> bool {
    let mut pipelines = pass
        .draws
        .iter()
        .filter_map(|d| capture.file.render_pipelines.get(d.pipeline));
    pipelines.any(blends_alpha_alone) && is_unseen(capture, pass)
}

/// Whether a pipeline replaces colour, and blends alpha.
fn blends_alpha_alone(pipeline: &RenderPipeline) -> bool {
    let replace = BlendComponent::default();
    let targets = pipeline
        .fragment
        .iter()
        .flat_map(|f| f.targets.iter().flatten());
    let mut blends = targets.filter_map(|t| t.blend.as_ref());
    blends.any(|b| b.color == replace && b.alpha != replace)
}

/// Whether nobody sees it: the pass draws to an opaque canvas, no command of the capture reads the pass's colours
/// otherwise, and no draw to them blends colour by the alpha that is there.
fn is_unseen(capture: &Capture, pass: &Pass<'_>) -> bool {
    let frames = &capture.file.frames;
    let opaque = frames
        .iter()
        .filter(|f| f.alpha_mode == Some(AlphaMode::Opaque));
    let opaque: BTreeSet<usize> = opaque.filter_map(|f| f.canvas).collect();
    let drawn = textures(pass.descriptor);
    let shown = pass.descriptor.color_attachments.iter().flatten();
    let mut shown = shown.map(|c| c.resolve_target.as_ref().unwrap_or(&c.view).texture);
    let is_shown = !drawn.is_empty() && shown.all(|texture| opaque.contains(&texture));
    let mut all = capture
        .file
        .setup
        .iter()
        .chain(frames.iter().flat_map(|f| &f.commands));
    is_shown && !all.any(|command| reads_alpha(capture, command, &drawn))
}

/// The textures that a pass draws and resolves to.
fn textures(of: &RenderPassDescriptor) -> BTreeSet<usize> {
    let colors = of.color_attachments.iter().flatten();
    let views = colors.flat_map(|c| std::iter::once(&c.view).chain(&c.resolve_target));
    views.map(|view| view.texture).collect()
}

/// Whether a command reads the alpha of `drawn`, other than by resolving one of them to another.
fn reads_alpha(capture: &Capture, command: &Command, drawn: &BTreeSet<usize>) -> bool {
    let Command::RenderPass {
        descriptor,
        commands,
    } = command
    else {
        let mut read = pass::read_otherwise(capture, command).into_iter();
        return read.any(|texture| drawn.contains(&texture));
    };
    let mut colors = descriptor.color_attachments.iter().flatten();
    let leaves = colors.any(|c| {
        let target = c.resolve_target.as_ref();
        drawn.contains(&c.view.texture) && target.is_some_and(|t| !drawn.contains(&t.texture))
    });
    // A draw without its pipeline is reported where the pass is read.
    let draws = pass::draws(commands, "").unwrap_or_default();
    let is_drawn = !textures(descriptor).is_disjoint(drawn);
    leaves
        || draws.iter().any(|draw| {
            let pipeline = capture.file.render_pipelines.get(draw.pipeline);
            !pass::sampled(capture, draw).is_disjoint(drawn)
                || is_drawn && pipeline.is_some_and(blends_by_alpha)
        })
}

/// Whether a pipeline blends colour by the target's alpha.
fn blends_by_alpha(pipeline: &RenderPipeline) -> bool {
    let targets = pipeline
        .fragment
        .iter()
        .flat_map(|f| f.targets.iter().flatten());
    let mut colors = targets.filter_map(|t| t.blend.as_ref()).map(|b| &b.color);
    colors.any(|c| {
        [c.src_factor, c.dst_factor]
            .into_iter()
            .any(reads_target_alpha)
    })
}

fn reads_target_alpha(factor: wgpu::BlendFactor) -> bool {
    matches!(
        factor,
        wgpu::BlendFactor::DstAlpha
            | wgpu::BlendFactor::OneMinusDstAlpha
            | wgpu::BlendFactor::SrcAlphaSaturated
    )
}

/// Leaves alpha as it is in the target.
pub(super) fn leave_out(target: &mut ColorTarget) {
    target.write_mask &= !ALPHA;
    drop_unwritten(target);
}

/// Drops the blending of alpha that is not written.
pub(super) fn drop_unwritten(target: &mut ColorTarget) {
    if target.write_mask & ALPHA != 0 {
        return;
    }
    if let Some(blend) = &mut target.blend {
        blend.alpha = Blend::REPLACE.alpha;
    }
    if target.blend == Some(Blend::REPLACE) {
        target.blend = None;
    }
}
