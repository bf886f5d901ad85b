//! Finds materials that only blend alpha, where nobody sees it.
//!
//! The page shows an opaque canvas without its alpha. Many pages still blend alpha there, because
//! they copied the state from an example. For such a material, draw order only affects alpha.
//! Without that blending the material is opaque, so it can be drawn behind a depth pre-pass or
//! sorted.

use std::collections::{BTreeMap, BTreeSet};

use preshade_frames::file::{
    AlphaMode, Blend, BlendComponent, ColorAttachment, ColorTarget, Command, RenderPassDescriptor,
    RenderPipeline,
};
use preshade_frames::folder::Capture;
use preshade_frames::pass::{self, Pass};

/// The pipelines of a pass that a scene draws without blending. They replace the colour, and their
/// alpha is unseen or not written.
pub(super) fn unblended(capture: &Capture, pass: &Pass<'_>) -> BTreeSet<usize> {
    let all = &capture.file.render_pipelines;
    let used: BTreeSet<usize> = pass.draws.iter().map(|d| d.pipeline).collect();
    let blended = |pipeline: &usize| all.get(*pipeline).map(blended_targets).unwrap_or_default();
    let blending: BTreeSet<usize> = used
        .into_iter()
        .filter(|p| !blended(p).is_empty())
        .collect();
    if blending.is_empty() {
        return blending;
    }
    let is_unseen = is_unseen(capture, pass);
    let is_replaced = |pipeline: &usize| {
        let targets = blended(pipeline);
        targets.iter().all(|t| replaces_color(t, is_unseen))
    };
    let mut found: BTreeSet<usize> = blending.iter().copied().filter(is_replaced).collect();
    // A scene draws blended materials last. A material that is drawn over a blended one has to keep
    // its blending.
    loop {
        let (mut is_behind, mut stays) = (false, BTreeSet::new());
        for draw in &pass.draws {
            match found.contains(&draw.pipeline) {
                true if is_behind => drop(stays.insert(draw.pipeline)),
                true => {}
                false => is_behind |= blending.contains(&draw.pipeline),
            }
        }
        if stays.is_empty() {
            return found;
        }
        found.retain(|pipeline| !stays.contains(pipeline));
    }
}

/// Whether a pipeline writes alpha to a target that it blends.
pub(super) fn is_written(pipeline: &RenderPipeline) -> bool {
    blended_targets(pipeline).iter().any(|t| writes_alpha(t))
}

fn writes_alpha(target: &ColorTarget) -> bool {
    target.write_mask & 0b1000 != 0
}

/// The targets that a pipeline blends.
fn blended_targets(pipeline: &RenderPipeline) -> Vec<&ColorTarget> {
    let targets = pipeline.fragment.iter().flat_map(|f| f.targets.iter());
    let is_blended = |b: &Blend| [b.color, b.alpha] != [BlendComponent::default(); 2];
    targets
        .flatten()
        .filter(|t| t.blend.as_ref().is_some_and(is_blended))
        .collect()
}

/// Whether blending affects only alpha that is unseen or not written. Float targets may hold
/// infinity, and 0 times infinity is NaN, so they never qualify.
fn replaces_color(target: &ColorTarget, is_unseen: bool) -> bool {
    let color = target.blend.as_ref().map(|b| b.color);
    let has_infinity = matches!(
        target.format,
        wgpu::TextureFormat::R16Float
            | wgpu::TextureFormat::Rg16Float
            | wgpu::TextureFormat::Rgba16Float
            | wgpu::TextureFormat::R32Float
            | wgpu::TextureFormat::Rg32Float
            | wgpu::TextureFormat::Rgba32Float
            | wgpu::TextureFormat::Rg11b10Ufloat
    );
    color == Some(BlendComponent::default())
        && (is_unseen || !writes_alpha(target))
        && !has_infinity
}

/// Whether nobody sees the alpha of a pass. It draws to an opaque canvas, no command of the capture
/// reads its colours otherwise, and no draw to them blends by the target's alpha.
fn is_unseen(capture: &Capture, pass: &Pass<'_>) -> bool {
    let file = &capture.file;
    let mut canvases = BTreeMap::new();
    for frame in &file.frames {
        let is_opaque = frame.alpha_mode == Some(AlphaMode::Opaque);
        if let Some(canvas) = frame.canvas {
            *canvases.entry(canvas).or_insert(true) &= is_opaque;
        }
    }
    let is_opaque = |texture: &usize| canvases.get(texture) == Some(&true);
    let colors = pass.descriptor.color_attachments.iter().flatten();
    let shown = |c: &ColorAttachment| c.resolve_target.as_ref().unwrap_or(&c.view).texture;
    let mut drawn = textures(pass.descriptor);
    let is_shown = !drawn.is_empty() && colors.clone().all(|c| is_opaque(&shown(c)));
    let frames = || file.frames.iter().flat_map(|f| &f.commands);
    // A multisampled texture is resolved to another canvas in each frame.
    for command in frames() {
        if let Command::RenderPass { descriptor, .. } = command {
            let colors = descriptor.color_attachments.iter().flatten();
            let own = colors.filter(|c| drawn.contains(&c.view.texture));
            let canvases: Vec<usize> = own.map(shown).filter(is_opaque).collect();
            drawn.extend(canvases);
        }
    }
    let mut all = file.setup.iter().chain(frames());
    is_shown && file.is_complete() && !all.any(|command| reads_alpha(capture, command, &drawn))
}

/// The textures that a pass draws or resolves to.
fn textures(of: &RenderPassDescriptor) -> BTreeSet<usize> {
    let colors = of.color_attachments.iter().flatten();
    let views = colors.flat_map(|c| std::iter::once(&c.view).chain(&c.resolve_target));
    views.map(|view| view.texture).collect()
}

/// Whether a command reads the alpha of `drawn`, except to resolve one of them to another.
fn reads_alpha(capture: &Capture, command: &Command, drawn: &BTreeSet<usize>) -> bool {
    let Command::RenderPass { descriptor, .. } = command else {
        let mut read = pass::read_otherwise(capture, command).into_iter();
        return read.any(|texture| drawn.contains(&texture));
    };
    let mut colors = descriptor.color_attachments.iter().flatten();
    let leaves = colors.any(|c| {
        let target = c.resolve_target.as_ref();
        drawn.contains(&c.view.texture) && target.is_some_and(|t| !drawn.contains(&t.texture))
    });
    let Ok(draws) = pass::draws(command, "the capture") else {
        return true;
    };
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
    let targets = blended_targets(pipeline);
    let mut colors = targets.iter().filter_map(|t| Some(t.blend.as_ref()?.color));
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
