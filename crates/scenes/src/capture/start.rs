//! Finds the contents of a captured pass's attachments before its first draw, and the direction of
//! its depth.

use std::sync::Arc;

use preshade_plan::state::{DepthDirection, DepthFormat};

use super::maker::Maker;
use super::{Error, material};
use preshade_draw::scene::{Image, Initial};
use preshade_frames::contents::Contents;
use preshade_frames::file::{self, Load, View};
use preshade_frames::folder::get;
use preshade_frames::pass::Pass;

impl Maker<'_> {
    pub(super) fn target(&mut self) -> Result<Target, Error> {
        let capture = self.capture;
        let texture = |view: &View| get(&capture.file.textures, view.texture, "texture", "a pass");
        let colors = self.pass.descriptor.color_attachments.iter().flatten();
        let first = colors.clone().next();
        let depth = self.pass.descriptor.depth_stencil_attachment.as_ref();
        let view = first.map(|c| &c.view).or(depth.map(|d| &d.view));
        let view = view.ok_or_else(|| Error::broken("a render pass", "it has no attachment"))?;
        let of = texture(view)?;
        let [width, height, _] = of.size.0;
        let level = view.view.base_mip_level;
        let size = [width, height].map(|s| (s >> level).max(1));
        let mut made = Target {
            size,
            samples: of.sample_count,
            clear: [0.0; 4],
            depth: None,
            direction: DepthDirection::Forward,
            initial: Initial::default(),
        };
        for color in &self.pass.descriptor.color_attachments {
            let (clear, image) = match color {
                Some(color) => self.start_color(color)?,
                None => ([0.0; 4], None),
            };
            made.initial.clear_colors.push(clear);
            made.initial.colors.push(image);
        }
        let drawn = self
            .pass
            .descriptor
            .color_attachments
            .iter()
            .position(Option::is_some);
        made.clear = drawn.map_or([0.0; 4], |location| made.initial.clear_colors[location]);
        if let Some(depth) = depth {
            let format = texture(&depth.view)?.format;
            let format = material::same(format);
            made.depth = Some(format.map_err(|e| Error::broken("a render pass", e))?);
            let cleared = match depth.depth_load_op {
                Some(Load::Clear) => Some(depth.depth_clear_value.unwrap_or(0.0)),
                _ => match self.earlier(&depth.view)? {
                    Earlier::Cleared(clears) => clears.depth,
                    Earlier::Drawn => None,
                },
            };
            made.direction = self.direction(cleared, depth.view.texture);
            made.initial.depth = match cleared {
                Some(to) if to == made.direction.clear_depth() => None,
                Some(to) => self.filled(to, size, of.sample_count, made.direction),
                None => {
                    let view = aspect(&depth.view, wgpu::TextureAspect::DepthOnly);
                    self.loaded(&view, "depth")?
                }
            };
            if texture(&depth.view)?.format.has_stencil_aspect() {
                let (clear, image) = self.start_stencil(depth)?;
                made.initial.clear_stencil = clear;
                made.initial.stencil = image;
            }
        }
        Ok(made)
    }

    /// Direction in which depth grows in the pass. A clear of depth to 0 or 1 decides it. Otherwise
    /// the comparisons of draws that write depth do, then the last clear of the texture, then the
    /// comparisons of draws that only test.
    fn direction(&self, cleared: Option<f32>, texture: usize) -> DepthDirection {
        let clears_to = |clear: f32| {
            let both = [DepthDirection::Forward, DepthDirection::Reversed];
            both.into_iter().find(|d| d.clear_depth() == clear)
        };
        let compared = |writes: bool| {
            let all = &self.capture.file.render_pipelines;
            let mut vertices = [0_u64; 2];
            for draw in self.pass.draws.iter().take(self.pass.before_clear) {
                let depth = all
                    .get(draw.pipeline)
                    .and_then(|p| p.depth_stencil.as_ref());
                let Some(depth) = depth else { continue };
                let compare = depth.depth_compare.and_then(|c| material::same(c).ok());
                let compare = compare.and_then(preshade_plan::state::CompareFunction::direction);
                if depth.depth_write_enabled.unwrap_or(false) == writes
                    && let Some(direction) = compare
                {
                    vertices[usize::from(direction == DepthDirection::Reversed)] +=
                        draw.call.vertices();
                }
            }
            match vertices {
                [0, 0] => None,
                [forward, reversed] if forward < reversed => Some(DepthDirection::Reversed),
                _ => Some(DepthDirection::Forward),
            }
        };
        cleared
            .and_then(clears_to)
            .or_else(|| compared(true))
            .or_else(|| self.last_clear(texture).and_then(clears_to))
            .or_else(|| compared(false))
            .unwrap_or_default()
    }

    /// The last depth to which the frame cleared a texture before the pass or at its start.
    fn last_clear(&self, texture: usize) -> Option<f32> {
        let mut own = self.pass.leading_clears.iter().filter_map(|c| c.depth);
        let earlier = self.before.iter().rev().filter_map(|pass| {
            let depth = pass.descriptor.depth_stencil_attachment.as_ref()?;
            let clears = depth.view.texture == texture && depth.depth_load_op == Some(Load::Clear);
            clears.then(|| depth.depth_clear_value.unwrap_or(0.0))
        });
        own.next_back().or_else(|| earlier.into_iter().next())
    }

    /// An image of one depth that is neither the near nor the far plane. `None`, with a note, if
    /// multisampled.
    fn filled(
        &mut self,
        depth: f32,
        [width, height]: [u32; 2],
        samples: u32,
        direction: DepthDirection,
    ) -> Option<Arc<Image>> {
        if samples > 1 {
            self.notes.insert(format!(
                "the pass clears its depth to {depth}, and the scene to {}",
                direction.clear_depth()
            ));
            return None;
        }
        Some(Arc::new(Image {
            size: [width, height],
            layers: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Depth32Float,
            levels: vec![depth.to_le_bytes().repeat((width * height) as usize)],
        }))
    }

    /// The clear value of a colour target. If the pass loads it, also the content that earlier
    /// passes left.
    fn start_color(
        &mut self,
        of: &file::ColorAttachment,
    ) -> Result<([f64; 4], Option<Arc<Image>>), Error> {
        let own = of.clear_value.map_or([0.0; 4], file::Color::numbers);
        if of.load_op == Load::Clear {
            return Ok((own, None));
        }
        match self.earlier(&of.view)? {
            Earlier::Cleared(Clears {
                color: Some(color), ..
            }) => Ok((color, None)),
            _ => Ok((own, self.loaded(&of.view, "picture")?)),
        }
    }

    /// As [`Self::start_color`], for the stencil.
    fn start_stencil(
        &mut self,
        of: &file::DepthAttachment,
    ) -> Result<(u32, Option<Arc<Image>>), Error> {
        if of.stencil_load_op == Some(Load::Clear) {
            return Ok((of.stencil_clear_value, None));
        }
        match self.earlier(&of.view)? {
            Earlier::Cleared(Clears {
                stencil: Some(stencil),
                ..
            }) => Ok((stencil, None)),
            _ => {
                let view = aspect(&of.view, wgpu::TextureAspect::StencilOnly);
                Ok((0, self.loaded(&view, "stencil")?))
            }
        }
    }

    /// Finds how the earlier commands of the frame left a view.
    fn earlier(&self, view: &View) -> Result<Earlier, Error> {
        let frame = get(
            &self.capture.file.frames,
            self.frame,
            "frame",
            "the capture",
        )?;
        let commands = frame.commands.iter().enumerate().take(self.pass.command);
        for (index, command) in commands.rev() {
            let pass = self.before.iter().find(|p| p.command == index);
            let mut writes = Contents::default();
            let draws = pass.map_or(&[][..], |p| &p.draws);
            writes.writes_of_gpu(self.capture, command, draws);
            if writes.is_as_at_start(view.texture) {
                continue;
            }
            return Ok(match pass.and_then(|p| cleared(p, view)) {
                Some(clears) => Earlier::Cleared(clears),
                None => Earlier::Drawn,
            });
        }
        Ok(Earlier::Drawn)
    }

    /// The content that earlier passes left in an attachment. `None`, with a note, if it cannot be
    /// read back.
    fn loaded(&mut self, view: &View, what: &str) -> Result<Option<Arc<Image>>, Error> {
        let of = get(
            &self.capture.file.textures,
            view.texture,
            "texture",
            "a pass",
        )?;
        if of.sample_count > 1 {
            self.notes.insert(format!(
                "the pass draws onto an earlier {what} of several samples, which the scene clears"
            ));
            return Ok(None);
        }
        let image = self.replayed()?.map(|replay| replay.read_view(view));
        Ok(image.transpose()?.map(Arc::new))
    }
}

/// How the commands before a pass left a view.
enum Earlier {
    /// Cleared to these values everywhere.
    Cleared(Clears),
    /// Any other content, such as an earlier frame's.
    Drawn,
}

/// The values to which a pass clears an attachment.
struct Clears {
    color: Option<[f64; 4]>,
    depth: Option<f32>,
    stencil: Option<u32>,
}

/// The clear values, if clearing is all that the pass does to the view.
fn cleared(pass: &Pass<'_>, view: &View) -> Option<Clears> {
    if !pass.draws.is_empty() || !pass.leading_clears.is_empty() {
        return None;
    }
    let same = |other: &View| other.texture == view.texture && other.view == view.view;
    let of = pass.descriptor;
    let mut colors = of.color_attachments.iter().flatten();
    let color = colors.find(|c| same(&c.view) && c.load_op == Load::Clear);
    let depth = of
        .depth_stencil_attachment
        .as_ref()
        .filter(|d| same(&d.view));
    let clears = |op| op == Some(Load::Clear);
    Some(Clears {
        color: color.map(|c| c.clear_value.map_or([0.0; 4], file::Color::numbers)),
        depth: depth
            .filter(|d| clears(d.depth_load_op))
            .map(|d| d.depth_clear_value.unwrap_or(0.0)),
        stencil: depth
            .filter(|d| clears(d.stencil_load_op))
            .map(|d| d.stencil_clear_value),
    })
}

fn aspect(view: &View, aspect: wgpu::TextureAspect) -> View {
    let mut view = view.clone();
    view.view.aspect = Some(aspect);
    view
}

/// The pass's targets with their initial contents.
pub(super) struct Target {
    pub size: [u32; 2],
    pub samples: u32,
    pub clear: [f64; 4],
    pub depth: Option<DepthFormat>,
    pub direction: DepthDirection,
    pub initial: Initial,
}
