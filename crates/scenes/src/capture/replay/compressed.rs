//! Writes texels to textures. Decodes compressed texels that the adapter does not support.

use std::sync::Arc;

use super::{Replay, depths};
use crate::capture::Error;
use preshade_draw::scene::image::blocks;
use preshade_frames::file::{DataName, Extent, TexelLayout, TexelPlace};
use preshade_frames::folder::get;

impl Replay<'_> {
    /// The format to use on this adapter: that of the decoded texels, if it does not support the
    /// compressed ones.
    pub(super) fn readable(&self, format: wgpu::TextureFormat) -> wgpu::TextureFormat {
        match preshade_draw::render::textures::is_readable(self.gpu, format) {
            true => format,
            false => blocks::decoded_format(format).unwrap_or(format),
        }
    }

    /// Writes texels to a texture of the capture. Decodes them if necessary.
    pub(super) fn write_texture(
        &mut self,
        destination: &TexelPlace,
        data: &DataName,
        layout: &TexelLayout,
        size: &Extent,
        place: &str,
    ) -> Result<(), Error> {
        self.flush()?;
        let texture = self.texture(destination.texture, place)?.clone();
        let bytes = self.capture.data(data)?;
        let is_stencil = destination.aspect == Some(wgpu::TextureAspect::StencilOnly);
        if depths::is_drawn(texture.format()) && !is_stencil {
            return self.write_depths(&texture, destination, &bytes, place);
        }
        let of = get(
            &self.capture.file.textures,
            destination.texture,
            "texture",
            place,
        )?;
        let to = super::texel_copy(&texture, destination);
        self.write_texels(of.format, to, bytes, layout.wgpu(), size.wgpu(), place)
    }

    /// Writes texels of a format. Decodes them if the texture has another format.
    pub(super) fn write_texels(
        &self,
        format: wgpu::TextureFormat,
        to: wgpu::TexelCopyTextureInfo<'_>,
        mut bytes: Arc<[u8]>,
        mut layout: wgpu::TexelCopyBufferLayout,
        mut size: wgpu::Extent3d,
        place: &str,
    ) -> Result<(), Error> {
        if to.texture.format() != format {
            // Blocks may extend beyond the level, but texels may not.
            let level = to.texture.size();
            let level = level.mip_level_size(to.mip_level, to.texture.dimension());
            size.width = size.width.min(level.width.saturating_sub(to.origin.x));
            size.height = size.height.min(level.height.saturating_sub(to.origin.y));
            let texels = blocks::decode_layers(format, size, &bytes, &layout);
            let few = || Error::broken(place, format!("texels of {format:?} have too few bytes"));
            bytes = texels.ok_or_else(few)?.into();
            layout = wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(size.width * 4),
                rows_per_image: Some(size.height),
            };
        }
        let queue = &self.gpu.queue;
        let write = || queue.write_texture(to, &bytes, layout, size);
        self.gpu.checked(place, write)?;
        Ok(())
    }
}
