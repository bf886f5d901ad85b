//! Decodes compressed texels for adapters that cannot read them. No desktop GPU supports ETC2 and
//! ASTC, which pages and apps for phones use.

use wgpu::{AstcChannel, TextureFormat};

use super::super::Image;

/// Format of the decoded texels: 8 bits per channel. `None` if [`decode`] does not support the
/// format.
pub fn decoded_format(format: TextureFormat) -> Option<TextureFormat> {
    use TextureFormat as F;
    match format {
        F::Etc2Rgb8Unorm | F::Etc2Rgb8A1Unorm | F::Etc2Rgba8Unorm => Some(F::Rgba8Unorm),
        F::Etc2Rgb8UnormSrgb | F::Etc2Rgb8A1UnormSrgb | F::Etc2Rgba8UnormSrgb => {
            Some(F::Rgba8UnormSrgb)
        }
        F::Astc { channel, .. } => match channel {
            AstcChannel::Unorm => Some(F::Rgba8Unorm),
            AstcChannel::UnormSrgb => Some(F::Rgba8UnormSrgb),
            AstcChannel::Hdr => None,
        },
        _ => None,
    }
}

/// Decodes one layer of a level, from rows of blocks to rows of texels, both without padding.
/// `None` if [`decoded_format`] does not list the format, or there are too few bytes.
fn decode(format: TextureFormat, size: [u32; 2], blocks: &[u8]) -> Option<Vec<u8>> {
    use TextureFormat as F;
    use texture2ddecoder as of;
    let [width, height] = size.map(|side| side as usize);
    let (across, down) = format.block_dimensions();
    let count = size[0].div_ceil(across) as usize * size[1].div_ceil(down) as usize;
    let bytes = count.checked_mul(format.block_copy_size(None)? as usize)?;
    let blocks = blocks.get(..bytes)?;
    let mut texels = vec![0_u32; width.checked_mul(height)?];
    let done = match format {
        F::Etc2Rgb8Unorm | F::Etc2Rgb8UnormSrgb => {
            of::decode_etc2_rgb(blocks, width, height, &mut texels)
        }
        F::Etc2Rgb8A1Unorm | F::Etc2Rgb8A1UnormSrgb => {
            of::decode_etc2_rgba1(blocks, width, height, &mut texels)
        }
        F::Etc2Rgba8Unorm | F::Etc2Rgba8UnormSrgb => {
            of::decode_etc2_rgba8(blocks, width, height, &mut texels)
        }
        F::Astc { channel, .. } if channel != AstcChannel::Hdr => {
            let (across, down) = (across as usize, down as usize);
            of::decode_astc(blocks, width, height, across, down, &mut texels)
        }
        _ => return None,
    };
    done.ok()?;
    // The decoder writes blue first.
    let rgba = texels.into_iter().flat_map(|texel| {
        let [b, g, r, a] = texel.to_le_bytes();
        [r, g, b, a]
    });
    Some(rgba.collect())
}

/// Decodes the layers of a level. Rows of blocks may have padding, as in WebGPU's texel buffers.
/// `None` as for [`decode`].
pub fn decode_layers(
    format: TextureFormat,
    size: wgpu::Extent3d,
    bytes: &[u8],
    layout: &wgpu::TexelCopyBufferLayout,
) -> Option<Vec<u8>> {
    let (across, down) = format.block_dimensions();
    let row = size.width.div_ceil(across) as usize * format.block_copy_size(None)? as usize;
    let rows = size.height.div_ceil(down) as usize;
    let pitch = layout.bytes_per_row.map_or(row, |p| p as usize);
    let layer_rows = layout.rows_per_image.map_or(rows, |r| r as usize);
    let first = usize::try_from(layout.offset).ok()?;
    let mut texels = Vec::new();
    for layer in 0..size.depth_or_array_layers as usize {
        let mut blocks = Vec::new();
        for index in 0..rows {
            let from = (layer * layer_rows + index)
                .checked_mul(pitch)?
                .checked_add(first)?;
            blocks.extend_from_slice(bytes.get(from..from.checked_add(row)?)?);
        }
        texels.extend(decode(format, [size.width, size.height], &blocks)?);
    }
    Some(texels)
}

impl Image {
    /// A decoded copy of the image. `None` if its format is not compressed, or cannot be decoded.
    pub(crate) fn decoded(&self) -> Option<Self> {
        let format = decoded_format(self.format)?;
        let mut levels = Vec::new();
        for (level, blocks) in (0..).zip(&self.levels) {
            let [width, height, layers] = self.extent(level);
            let size = wgpu::Extent3d {
                width,
                height,
                depth_or_array_layers: layers,
            };
            levels.push(decode_layers(
                self.format,
                size,
                blocks,
                &Default::default(),
            )?);
        }
        Some(Self {
            format,
            levels,
            ..self.clone()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An ETC2 block of one colour: individual mode, both halves with base 15, 0, 8 of 15 and table 0.
    #[test]
    fn etc2_of_one_colour_and_too_few_bytes() {
        let block = [0xff, 0x00, 0x88, 0x00, 0, 0, 0, 0];
        let texels = decode(TextureFormat::Etc2Rgb8Unorm, [3, 2], &block).unwrap_or_default();
        assert_eq!(texels.len(), 3 * 2 * 4);
        // Every selector is 0: the table's smaller step, 2, is added to each channel.
        assert!(
            texels.chunks(4).all(|t| t == [255, 2, 138, 255]),
            "{texels:?}"
        );
        assert_eq!(decode(TextureFormat::Etc2Rgb8Unorm, [5, 2], &block), None);
        assert_eq!(decode(TextureFormat::Bc1RgbaUnorm, [4, 4], &block), None);
    }
}
