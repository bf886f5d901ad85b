//! Textures of a scene's draws: images of any format, uploaded unchanged.

use std::sync::Arc;

use wgpu::{
    BindingType, Extent3d, TextureDimension, TextureFormat, TextureSampleType, TextureUsages,
    TextureViewDimension,
};

use super::gpu::Gpu;
use super::upload::{depth_cleared, one_layer, upload};
use super::{Error, depths};
use crate::scene::Image;
use crate::scene::bind::{TextureBinding, TextureContent};

/// Textures so far, each with the view and layout of a binding.
#[derive(Default)]
pub(super) struct Textures(Vec<(Key, (wgpu::TextureView, BindingType))>);

/// The image's address, which identifies its content while the scene lives, and the way of reading
/// it.
#[derive(Clone, PartialEq)]
struct Key {
    image: Option<*const Image>,
    depth: Option<([u32; 2], u32)>,
    view: TextureViewDimension,
    sample_type: TextureSampleType,
    multisampled: bool,
}

impl Textures {
    /// The view of a binding's texture, and its binding type.
    ///
    /// # Errors
    /// [`Error::Unsupported`] if the adapter lacks the format, [`Error::Scene`] if the shader
    /// cannot read this kind of image, or the image has too few bytes. `draw` is for messages.
    pub fn view(
        &mut self,
        gpu: &Gpu,
        binding: &TextureBinding,
        draw: &str,
    ) -> Result<(wgpu::TextureView, BindingType), Error> {
        let key = Key {
            image: match &binding.content {
                TextureContent::Image(image) => Some(Arc::as_ptr(image)),
                _ => None,
            },
            depth: match &binding.content {
                TextureContent::Depth { size, value } => Some((*size, value.to_bits())),
                _ => None,
            },
            view: binding.view,
            sample_type: binding.sample_type,
            multisampled: binding.multisampled,
        };
        if let Some((_, made)) = self.0.iter().find(|(k, _)| *k == key) {
            return Ok(made.clone());
        }
        let failed = |message: String| Error::Scene {
            draw: draw.to_owned(),
            message,
        };
        let (texture, sample_type) = match &binding.content {
            TextureContent::Image(image) if !binding.multisampled => {
                let decoded = match is_readable(gpu, image.format) {
                    true => None,
                    false => image.decoded(),
                };
                let image = decoded.as_ref().unwrap_or(image);
                let (format, sample_type) = fitting(gpu, image, binding).map_err(failed)?;
                for (_, feature) in format.required_features().iter_names() {
                    let what = format!("the texture of {format:?} that draw `{draw}` binds");
                    let lacks = !gpu.device.features().contains(feature);
                    if lacks {
                        return Err(gpu.unsupported(&what, feature.as_str().unwrap_or("more")));
                    }
                }
                let texture = match format.is_depth_stencil_format() {
                    true => depths::texture(gpu, image, binding.view),
                    false => upload(gpu, image, binding.view, format),
                };
                (texture.map_err(failed)?, sample_type)
            }
            TextureContent::Image(image) => {
                let format = match binding.sample_type {
                    TextureSampleType::Depth => TextureFormat::Depth32Float,
                    TextureSampleType::Uint => TextureFormat::Rgba8Uint,
                    TextureSampleType::Sint => TextureFormat::Rgba8Sint,
                    TextureSampleType::Float { .. } => TextureFormat::Rgba8Unorm,
                };
                (
                    cleared(gpu, image.size, binding, format, 1.0),
                    binding.sample_type,
                )
            }
            TextureContent::Depth { size, value } => (
                cleared(gpu, *size, binding, TextureFormat::Depth32Float, *value),
                binding.sample_type,
            ),
            TextureContent::Storage { .. } => {
                return Err(failed(
                    "it binds a storage texture, which preshade's renderer does not draw with"
                        .to_owned(),
                ));
            }
        };
        let view = texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(binding.view),
            ..Default::default()
        });
        let ty = BindingType::Texture {
            sample_type,
            view_dimension: binding.view,
            multisampled: binding.multisampled,
        };
        self.0.push((key, (view.clone(), ty)));
        Ok((view, ty))
    }
}

/// Whether the device supports a format.
pub fn is_readable(gpu: &Gpu, format: TextureFormat) -> bool {
    gpu.device.features().contains(format.required_features())
}

/// The format in which an image is uploaded for a binding, and how the binding reads it.
fn fitting(
    gpu: &Gpu,
    image: &Image,
    binding: &TextureBinding,
) -> Result<(TextureFormat, TextureSampleType), String> {
    use TextureSampleType as S;
    let is_bytes = image.format.remove_srgb_suffix() == TextureFormat::Rgba8Unorm;
    let features = Some(gpu.device.features());
    match (binding.sample_type, image.format) {
        // Bytes are read as numbers of the shader's type.
        (S::Uint, _) if is_bytes => Ok((TextureFormat::Rgba8Uint, S::Uint)),
        (S::Sint, _) if is_bytes => Ok((TextureFormat::Rgba8Sint, S::Sint)),
        (S::Depth, format) if image.texels().is_some() && format.components() == 1 => {
            Ok((TextureFormat::Depth32Float, S::Depth))
        }
        // Depths that a shader reads are not filtered.
        (S::Float { .. }, format) if format.is_depth_stencil_format() => {
            Ok((TextureFormat::Depth32Float, S::Depth))
        }
        (wanted, format) => match (wanted, format.sample_type(None, features)) {
            (S::Float { .. }, Some(is @ S::Float { .. })) => Ok((format, is)),
            (wanted, Some(is)) if wanted == is => Ok((format, is)),
            _ => Err(format!(
                "the shader reads a texture at group {} binding {} as {wanted:?}, and its image \
                 has the format {format:?}",
                binding.group, binding.binding
            )),
        },
    }
}

/// A texture cleared to white, or to a depth, by a render pass: depth and multisampled textures
/// cannot be uploaded.
fn cleared(
    gpu: &Gpu,
    size: [u32; 2],
    binding: &TextureBinding,
    format: TextureFormat,
    depth: f32,
) -> wgpu::Texture {
    let layers = match binding.view {
        TextureViewDimension::Cube | TextureViewDimension::CubeArray => 6,
        _ => 1,
    };
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: Extent3d {
            width: size[0],
            height: size[1],
            depth_or_array_layers: layers,
        },
        mip_level_count: 1,
        sample_count: if binding.multisampled { 4 } else { 1 },
        dimension: TextureDimension::D2,
        format,
        usage: TextureUsages::TEXTURE_BINDING | TextureUsages::RENDER_ATTACHMENT,
        view_formats: &[],
    });
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    for layer in 0..layers {
        let view = one_layer(&texture, 0, layer);
        let color = [Some(wgpu::RenderPassColorAttachment {
            view: &view,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations {
                load: wgpu::LoadOp::Clear(wgpu::Color::WHITE),
                store: wgpu::StoreOp::Store,
            },
        })];
        let is_depth = format.is_depth_stencil_format();
        encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: None,
            color_attachments: if is_depth { &[] } else { &color },
            depth_stencil_attachment: is_depth.then_some(depth_cleared(&view, depth)),
            ..Default::default()
        });
    }
    gpu.queue.submit([encoder.finish()]);
    texture
}
