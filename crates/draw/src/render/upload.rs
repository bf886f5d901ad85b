//! Images as textures.

use wgpu::{Extent3d, TextureDimension, TextureFormat, TextureUsages, TextureViewDimension};

use super::gpu::Gpu;
use crate::scene::Image;

/// Size of a texture for an image that is read as `view`. A cube repeats its layers if there are
/// too few.
pub(super) fn size(image: &Image, view: TextureViewDimension) -> Result<Extent3d, String> {
    let dimension = view.compatible_texture_dimension();
    if image.dimension == TextureDimension::D3 && dimension != TextureDimension::D3 {
        return Err(format!(
            "the shader reads as {view:?} an image that is a volume"
        ));
    }
    let depth_or_array_layers = match view {
        TextureViewDimension::Cube | TextureViewDimension::CubeArray => {
            image.layers.next_multiple_of(6)
        }
        _ => image.layers,
    };
    Ok(Extent3d {
        width: image.size[0],
        height: match dimension {
            TextureDimension::D1 => 1,
            _ => image.size[1],
        },
        depth_or_array_layers,
    })
}

/// A texture with an image's content, to be read as `view`.
///
/// # Errors
/// The reason as text: the image has too few bytes, or its size does not fit the format.
pub(super) fn upload(
    gpu: &Gpu,
    image: &Image,
    view: TextureViewDimension,
    format: TextureFormat,
) -> Result<wgpu::Texture, String> {
    let dimension = view.compatible_texture_dimension();
    let size = size(image, view)?;
    // If the texture has another dimension than the image, it gets only level 0.
    let levels = match image.dimension == dimension {
        true => image.levels.len() as u32,
        false => 1,
    };
    let (across, down) = format.block_dimensions();
    if size.width % across != 0 || size.height % down != 0 {
        return Err(format!(
            "a texture of {}x{} texels cannot have the format {format:?}, whose blocks have \
             {across}x{down}",
            size.width, size.height
        ));
    }
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size,
        mip_level_count: levels,
        sample_count: 1,
        dimension,
        format,
        usage: TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_DST | TextureUsages::COPY_SRC,
        view_formats: &[],
    });
    for (level, texels) in (0..levels).zip(&image.levels) {
        let [row, rows] = image
            .rows(level)
            .ok_or_else(|| format!("a texture of {format:?} cannot be filled"))?;
        let rows = match dimension {
            TextureDimension::D1 => 1,
            _ => rows,
        };
        let [width, height, depth] = image.extent(level);
        let layers = match dimension {
            TextureDimension::D3 => depth,
            _ => size.depth_or_array_layers,
        };
        let layer_bytes = row as usize * rows as usize;
        for layer in 0..layers {
            let from = (layer % depth.max(1)) as usize * layer_bytes;
            let data = texels.get(from..from + layer_bytes).ok_or_else(|| {
                format!(
                    "level {level} of a texture of {width}x{height} texels ({format:?}) has {} \
                     bytes, and needs {}",
                    texels.len(),
                    layer_bytes * depth as usize
                )
            })?;
            gpu.queue.write_texture(
                wgpu::TexelCopyTextureInfo {
                    texture: &texture,
                    mip_level: level,
                    origin: wgpu::Origin3d {
                        x: 0,
                        y: 0,
                        z: layer,
                    },
                    aspect: wgpu::TextureAspect::All,
                },
                data,
                wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(row),
                    rows_per_image: Some(rows),
                },
                // Compressed levels are copied by whole blocks.
                Extent3d {
                    width: width.next_multiple_of(across),
                    height: match dimension {
                        TextureDimension::D1 => 1,
                        _ => height.next_multiple_of(down),
                    },
                    depth_or_array_layers: 1,
                },
            );
        }
    }
    Ok(texture)
}

pub(super) fn one_layer(texture: &wgpu::Texture, level: u32, layer: u32) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(TextureViewDimension::D2),
        base_mip_level: level,
        mip_level_count: Some(1),
        base_array_layer: layer,
        array_layer_count: Some(1),
        ..Default::default()
    })
}

pub(super) fn depth_cleared(
    view: &wgpu::TextureView,
    depth: f32,
) -> wgpu::RenderPassDepthStencilAttachment<'_> {
    wgpu::RenderPassDepthStencilAttachment {
        view,
        depth_ops: Some(wgpu::Operations {
            load: wgpu::LoadOp::Clear(depth),
            store: wgpu::StoreOp::Store,
        }),
        stencil_ops: None,
    }
}
