//! Finds draws that depend on a depth or stencil that the capture lacks.

use std::collections::{BTreeMap, BTreeSet};

use super::Error;
use preshade_frames::file::{CaptureFile, Command, DepthStencil, Extent, Load, TexelPlace};
use preshade_frames::folder::Capture;
use preshade_frames::pass::{self, PassDraw};

/// Texture, mip level, layer, and whether the stencil is meant.
type Subresource = (usize, u32, u32, bool);

/// An unknown depth or stencil that draws of a frame test or read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnknownDepth {
    /// Frame, from 0.
    pub frame: usize,
    pub texture: usize,
    /// Whether the stencil is meant.
    pub is_stencil: bool,
    /// Indices of the render passes with such draws.
    pub passes: BTreeSet<usize>,
    /// Number of these draws.
    pub draws: usize,
}

/// The unknown depths and stencils that each frame tests or reads before it writes them.
///
/// # Errors
/// A draw comes before its pipeline.
pub fn unknown_depths(capture: &Capture) -> Result<Vec<UnknownDepth>, Error> {
    let file = &capture.file;
    let mut unknown = at_start(file);
    for command in &file.setup {
        write(file, command, &mut unknown);
    }
    let mut found = Vec::new();
    for (frame, of) in file.frames.iter().enumerate() {
        let mut used: BTreeMap<(usize, bool), UnknownDepth> = BTreeMap::new();
        let mut number = 0;
        for (index, command) in of.commands.iter().enumerate() {
            write(file, command, &mut unknown);
            let Command::RenderPass { descriptor, .. } = command else {
                continue;
            };
            let draws = pass::draws(command, &format!("frame {frame}, command {index}"))?;
            let target = descriptor.depth_stencil_attachment.as_ref();
            let target = target.map(|d| {
                let view = &d.view.view;
                (d.view.texture, view.base_mip_level, view.base_array_layer)
            });
            let textures: BTreeSet<(usize, bool)> = unknown.iter().map(|p| (p.0, p.3)).collect();
            for (texture, is_stencil) in textures {
                let tests = target.is_some_and(|(of, level, layer)| {
                    of == texture && unknown.contains(&(of, level, layer, is_stencil))
                });
                let depends = |draw: &&PassDraw| {
                    (tests && is_tested(file, draw, is_stencil))
                        || (!is_stencil && pass::sampled(capture, draw).contains(&texture))
                };
                let count = draws.iter().filter(depends).count();
                if count > 0 {
                    let entry = used.entry((texture, is_stencil));
                    let entry = entry.or_insert_with(|| UnknownDepth {
                        frame,
                        texture,
                        is_stencil,
                        passes: BTreeSet::new(),
                        draws: 0,
                    });
                    entry.passes.insert(number);
                    entry.draws += count;
                }
            }
            number += 1;
        }
        found.extend(used.into_values());
    }
    Ok(found)
}

fn at_start(file: &CaptureFile) -> BTreeSet<Subresource> {
    let mut unknown = BTreeSet::new();
    for entry in file.unknown.iter().filter(|entry| !entry.as_captured) {
        let Some((index, of)) = entry
            .texture
            .and_then(|index| Some((index, file.textures.get(index)?)))
        else {
            continue;
        };
        let has = [of.format.has_depth_aspect(), of.format.has_stencil_aspect()];
        let is_meant = match entry.aspect {
            Some(wgpu::TextureAspect::DepthOnly) => [true, false],
            Some(wgpu::TextureAspect::StencilOnly) => [false, true],
            _ => [true, true],
        };
        for is_stencil in [false, true] {
            let aspect = usize::from(is_stencil);
            if has[aspect] && is_meant[aspect] {
                unknown.extend(parts(
                    index,
                    0..of.mip_level_count,
                    0..of.size.0[2],
                    is_stencil,
                ));
            }
        }
    }
    unknown
}

fn parts(
    texture: usize,
    levels: std::ops::Range<u32>,
    layers: std::ops::Range<u32>,
    is_stencil: bool,
) -> impl Iterator<Item = Subresource> {
    levels.flat_map(move |level| {
        layers
            .clone()
            .map(move |layer| (texture, level, layer, is_stencil))
    })
}

/// Updates the unknown parts after a command, or for a pass before its draws.
fn write(file: &CaptureFile, command: &Command, unknown: &mut BTreeSet<Subresource>) {
    if unknown.is_empty() {
        return;
    }
    match command {
        Command::WriteTexture {
            destination, size, ..
        }
        | Command::CopyBufferToTexture {
            destination, size, ..
        } if is_whole(file, destination, *size) => {
            let of = file.textures.get(destination.texture);
            let is_stencil = destination.aspect == Some(wgpu::TextureAspect::StencilOnly)
                || of.is_some_and(|t| !t.format.has_depth_aspect());
            for part in copied(destination, *size, is_stencil) {
                unknown.remove(&part);
            }
        }
        Command::CopyTextureToTexture {
            source,
            destination,
            size,
        } if is_whole(file, destination, *size) => {
            for is_stencil in [false, true] {
                transfer(source, destination, *size, is_stencil, unknown);
            }
        }
        Command::CopyDepth {
            source,
            destination,
            size,
        } if is_whole(file, destination, *size) => {
            transfer(source, destination, *size, false, unknown);
        }
        Command::RenderPass { descriptor, .. } => {
            if let Some(of) = &descriptor.depth_stencil_attachment {
                let view = &of.view.view;
                for (is_stencil, load) in [(false, of.depth_load_op), (true, of.stencil_load_op)] {
                    if load == Some(Load::Clear) {
                        let at = (view.base_mip_level, view.base_array_layer);
                        unknown.remove(&(of.view.texture, at.0, at.1, is_stencil));
                    }
                }
            }
        }
        _ => {}
    }
}

fn copied(place: &TexelPlace, size: Extent, is_stencil: bool) -> impl Iterator<Item = Subresource> {
    let ([_, _, layer], level) = (place.origin.0, place.mip_level);
    let layers = layer..layer.saturating_add(size.0[2]);
    parts(place.texture, level..level + 1, layers, is_stencil)
}

fn transfer(
    source: &TexelPlace,
    destination: &TexelPlace,
    size: Extent,
    is_stencil: bool,
    unknown: &mut BTreeSet<Subresource>,
) {
    let to = copied(destination, size, is_stencil);
    for (from, to) in copied(source, size, is_stencil).zip(to) {
        match unknown.contains(&from) {
            true => unknown.insert(to),
            false => unknown.remove(&to),
        };
    }
}

/// Whether a copy fills the width and height of a level.
fn is_whole(file: &CaptureFile, place: &TexelPlace, size: Extent) -> bool {
    file.textures.get(place.texture).is_some_and(|of| {
        let level = of.size.wgpu();
        let level = level.mip_level_size(place.mip_level, of.dimension);
        place.origin.0[..2] == [0, 0]
            && size.0[..2] == [level.width, level.height]
            && size.0[2] <= of.size.0[2]
    })
}

/// Whether a draw's depth or stencil test can fail.
fn is_tested(file: &CaptureFile, draw: &PassDraw, is_stencil: bool) -> bool {
    let always = |compare| compare == wgpu::CompareFunction::Always;
    let tests = |state: &DepthStencil| match is_stencil {
        false => !state.depth_compare.is_none_or(always),
        true => ![&state.stencil_front, &state.stencil_back]
            .iter()
            .all(|face| always(face.compare)),
    };
    let pipeline = file.render_pipelines.get(draw.pipeline);
    pipeline
        .and_then(|p| p.depth_stencil.as_ref())
        .is_some_and(tests)
}
