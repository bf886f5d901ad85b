//! Initial contents of the scene's attachments.

use wgpu::{Extent3d, TextureDimension, TextureUsages, TextureViewDimension};

use super::gpu::Gpu;
use super::targets::Targets;
use super::upload::upload;
use super::{Error, depths, state};
use crate::scene::{Image, Scene};

/// Textures that are copied to the attachments at the start of each frame.
#[derive(Debug, Default)]
pub(crate) struct Initial {
    colors: Vec<Option<wgpu::Texture>>,
    depth: Option<wgpu::Texture>,
    /// Whether `depth` has depths, and whether it has stencil values.
    has: [bool; 2],
}

impl Initial {
    /// Uploads [`Scene::initial`].
    ///
    /// # Errors
    /// [`Error::Scene`] if an image does not fit, or the adapter fails.
    pub fn new(gpu: &Gpu, scene: &Scene) -> Result<Self, Error> {
        let of = &scene.initial;
        let has = [&of.depth, &of.stencil].map(|image| image.is_some());
        if of.colors.iter().flatten().next().is_none() && !has.contains(&true) {
            return Ok(Self::default());
        }
        let failed = |message: String| Error::Scene {
            draw: scene.name.clone(),
            message: format!("initial content of its attachments: {message}"),
        };
        let flat = TextureViewDimension::D2;
        gpu.checked("initial content", || {
            let color = |image| upload(gpu, image, flat, image.format);
            let colors = of
                .colors
                .iter()
                .map(|c| c.as_deref().map(color).transpose());
            let depth = of.depth.as_ref().or(of.stencil.as_ref()).map(|image| {
                let size = Extent3d {
                    width: image.size[0],
                    height: image.size[1],
                    depth_or_array_layers: 1,
                };
                let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
                    label: Some("initial depth"),
                    size,
                    mip_level_count: 1,
                    sample_count: 1,
                    dimension: TextureDimension::D2,
                    format: state::depth_format(scene.depth_format),
                    usage: TextureUsages::RENDER_ATTACHMENT
                        | TextureUsages::COPY_SRC
                        | TextureUsages::COPY_DST,
                    view_formats: &[],
                });
                if let Some(image) = &of.depth {
                    depths::draw(gpu, image, &texture, 0)?;
                }
                if let Some(image) = &of.stencil {
                    write_stencil(gpu, image, &texture, size)?;
                }
                Ok(texture)
            });
            Ok(Self {
                colors: colors.collect::<Result<_, _>>().map_err(failed)?,
                depth: depth.transpose().map_err(failed)?,
                has,
            })
        })?
    }

    /// The initial depth and stencil for the scene's depth attachment `to`.
    fn depth(&self, to: &wgpu::Texture) -> Option<&wgpu::Texture> {
        self.depth.as_ref().filter(|from| fits(from, to))
    }

    /// Whether the scene's depth attachment `to` starts with depths, and whether with stencil
    /// values.
    pub fn keeps(&self, to: &wgpu::Texture) -> [bool; 2] {
        self.depth(to).map_or([false; 2], |_| self.has)
    }

    /// The initial colour for the scene's colour attachment `to` at a location.
    pub fn color(&self, location: usize, to: &wgpu::Texture) -> Option<&wgpu::Texture> {
        let of = self.colors.get(location)?.as_ref();
        of.filter(|from| fits(from, to))
    }

    /// Copies the initial contents to the attachments.
    pub fn encode(&self, targets: &Targets, colors: bool, encoder: &mut wgpu::CommandEncoder) {
        let mut copy = |from: Option<&wgpu::Texture>, to: &wgpu::Texture| {
            if let Some(from) = from {
                let (source, target) = (from.as_image_copy(), to.as_image_copy());
                encoder.copy_texture_to_texture(source, target, from.size());
            }
        };
        if let Some(target) = targets.depth(preshade_plan::plan::SCENE_DEPTH) {
            copy(self.depth(&target.texture), &target.texture);
        }
        for (location, target) in targets.colors.iter().enumerate() {
            if let Some(target) = target.as_ref().filter(|_| colors) {
                copy(self.color(location, &target.drawn), &target.drawn);
            }
        }
    }
}

fn write_stencil(
    gpu: &Gpu,
    image: &Image,
    texture: &wgpu::Texture,
    size: Extent3d,
) -> Result<(), String> {
    let bytes = image
        .levels
        .first()
        .filter(|_| texture.format().has_stencil_aspect());
    let bytes = bytes.ok_or_else(|| format!("{:?} has no stencil", texture.format()))?;
    gpu.queue.write_texture(
        wgpu::TexelCopyTextureInfo {
            aspect: wgpu::TextureAspect::StencilOnly,
            ..texture.as_image_copy()
        },
        bytes,
        wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(size.width),
            rows_per_image: Some(size.height),
        },
        size,
    );
    Ok(())
}

/// Whether one texture can be copied to the other.
fn fits(from: &wgpu::Texture, to: &wgpu::Texture) -> bool {
    let format = |t: &wgpu::Texture| t.format().remove_srgb_suffix();
    to.sample_count() == 1 && from.size() == to.size() && format(from) == format(to)
}
