//! Writes texels to textures. Compressed ones that the adapter cannot read are decoded.

use super::Replay;
use crate::capture::Error;
use crate::capture::file::{DataName, Extent, TexelLayout, TexelPlace};
use crate::capture::folder::get;
use crate::scene::image::blocks;

impl Replay<'_> {
    /// The format that stands for one on this adapter: compressed texels that it cannot read are decoded.
    pub(super) fn readable(&self, format: wgpu::TextureFormat) -> wgpu::TextureFormat {
        match crate::render::textures::is_readable(self.gpu, format) {
            true => format,
            false => blocks::decoded_format(format).unwrap_or(format),
        }
    }

    /// Writes texels, decoded where the adapter cannot read them as they are.
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
        if texture.format() == wgpu::TextureFormat::Depth32Float {
            return self.write_depths(&texture, destination, &bytes, place);
        }
        let of = get(
            &self.capture.file.textures,
            destination.texture,
            "texture",
            place,
        )?;
        let (mut bytes, mut layout, size) = (bytes, layout.wgpu(), size.wgpu());
        if texture.format() != of.format {
            let texels = decoded(of.format, size, &bytes, Some(&layout));
            bytes = texels.map_err(|why| Error::broken(place, why))?.into();
            layout = wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(size.width * 4),
                rows_per_image: Some(size.height),
            };
        }
        self.gpu.checked(place, || {
            let to = super::texel_copy(&texture, destination);
            self.gpu.queue.write_texture(to, &bytes, layout, size);
        })?;
        Ok(())
    }
}

/// Texels of compressed ones, layer by layer. Without a layout, the rows of blocks have no padding.
pub(super) fn decoded(
    format: wgpu::TextureFormat,
    size: wgpu::Extent3d,
    bytes: &[u8],
    layout: Option<&wgpu::TexelCopyBufferLayout>,
) -> Result<Vec<u8>, String> {
    let few = || format!("texels of {format:?} have too few bytes");
    let (across, down) = format.block_dimensions();
    let block = format.block_copy_size(None).unwrap_or(16) as usize;
    let (row, rows) = (
        size.width.div_ceil(across) as usize * block,
        size.height.div_ceil(down) as usize,
    );
    let given = |f: fn(&wgpu::TexelCopyBufferLayout) -> Option<u32>| layout.and_then(f);
    let pitch = given(|l| l.bytes_per_row).map_or(row, |p| p as usize);
    let layer_rows = given(|l| l.rows_per_image).map_or(rows, |r| r as usize);
    let first = layout.map_or(0, |l| l.offset as usize);
    let mut texels = Vec::new();
    for layer in 0..size.depth_or_array_layers as usize {
        let mut blocks = Vec::new();
        for index in 0..rows {
            let from = (layer * layer_rows + index)
                .checked_mul(pitch)
                .and_then(|from| from.checked_add(first));
            let from = from.ok_or_else(few)?;
            blocks.extend_from_slice(bytes.get(from..from + row).ok_or_else(few)?);
        }
        texels.extend(blocks::decode(format, [size.width, size.height], &blocks).ok_or_else(few)?);
    }
    Ok(texels)
}
