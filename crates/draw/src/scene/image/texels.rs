//! Texels of an image as numbers, for every uncompressed format.

use wgpu::{TextureDimension, TextureFormat};

use super::super::Image;

/// Decodes the bytes of one texel to red, green, blue and alpha.
type Decode = fn(&[u8]) -> [f32; 4];

/// The texels of an image as numbers.
#[derive(Clone, Copy)]
pub struct Texels<'a> {
    image: &'a Image,
    decode: Decode,
    bytes: usize,
}

impl Image {
    /// An image with four bytes per texel.
    pub fn rgba8(size: [u32; 2], layers: u32, srgb: bool, levels: Vec<Vec<u8>>) -> Self {
        Self {
            size,
            layers,
            dimension: TextureDimension::D2,
            format: match srgb {
                true => TextureFormat::Rgba8UnormSrgb,
                false => TextureFormat::Rgba8Unorm,
            },
            levels,
        }
    }

    /// Level 0 at another size, by nearest neighbour. `None` if the format is compressed.
    pub(crate) fn resampled(&self, size: [u32; 2]) -> Option<Self> {
        let ([row, rows], texel) = (self.rows(0)?, self.block_bytes()? as usize);
        let layer = (row as usize * rows as usize).max(1);
        let from = |i: u32, axis: usize| {
            let [of, to] = [self.size[axis], size[axis]].map(u64::from);
            ((2 * u64::from(i) + 1) * of / (2 * to)) as usize
        };
        let mut texels = Vec::new();
        for layer in self.levels.first()?.chunks(layer) {
            for y in 0..size[1] {
                let row = layer.chunks(row.max(1) as usize).nth(from(y, 1))?;
                for x in 0..size[0] {
                    let at = from(x, 0) * texel;
                    texels.extend_from_slice(row.get(at..at + texel)?);
                }
            }
        }
        Some(Self {
            size,
            levels: vec![texels],
            ..self.clone()
        })
    }

    /// Width, height, and layers or depth of a level.
    pub fn extent(&self, level: u32) -> [u32; 3] {
        let at = |side: u32| side.checked_shr(level).unwrap_or(0).max(1);
        let depth = match self.dimension {
            TextureDimension::D3 => at(self.layers),
            _ => self.layers,
        };
        [at(self.size[0]), at(self.size[1]), depth]
    }

    /// Bytes of a row of blocks of a level, and the number of these rows in a layer. `None` if the
    /// format has no defined layout.
    pub fn rows(&self, level: u32) -> Option<[u32; 2]> {
        let block = self.block_bytes()?;
        let (across, down) = self.format.block_dimensions();
        let [width, height, _] = self.extent(level);
        let row = width.div_ceil(across).checked_mul(block)?;
        Some([row, height.div_ceil(down)])
    }

    /// Bytes of a block. In an uncompressed format, a block is one texel.
    fn block_bytes(&self) -> Option<u32> {
        match self.format {
            // WebGPU defines no layout for it. Here its values are stored as floats.
            TextureFormat::Depth24Plus => Some(4),
            format => format.block_copy_size(None),
        }
    }

    /// The texels as numbers. `None` if the format is compressed or has none.
    pub fn texels(&self) -> Option<Texels<'_>> {
        Some(Texels {
            image: self,
            decode: decode(self.format)?,
            bytes: self.block_bytes()? as usize,
        })
    }
}

impl<'a> Texels<'a> {
    /// The texel at x, y, and the layer or depth.
    pub fn at(&self, level: u32, [x, y, z]: [u32; 3]) -> Option<[f32; 4]> {
        let [width, height, depth] = self.image.extent(level);
        if x >= width || y >= height || z >= depth {
            return None;
        }
        let [x, y, z, width, height] = [x, y, z, width, height].map(|n| n as usize);
        let index = ((z * height + y) * width + x).checked_mul(self.bytes)?;
        let level = self.image.levels.get(level as usize)?;
        let bytes = level.get(index..index.checked_add(self.bytes)?)?;
        Some((self.decode)(bytes))
    }

    /// The texels of all levels.
    pub fn all(&self) -> impl Iterator<Item = [f32; 4]> + use<'a> {
        let (decode, bytes) = (self.decode, self.bytes);
        let levels = self.image.levels.iter();
        levels.flat_map(move |level| level.chunks_exact(bytes).map(decode))
    }
}

/// Values of missing channels.
const NONE: [f32; 4] = [0.0, 0.0, 0.0, 1.0];

/// The channels of a texel, of `N` bytes each.
fn channels<const N: usize>(bytes: &[u8], read: fn([u8; N]) -> f32) -> [f32; 4] {
    let mut out = NONE;
    for (channel, bytes) in out.iter_mut().zip(bytes.as_chunks::<N>().0) {
        *channel = read(*bytes);
    }
    out
}

fn unorm8(b: &[u8]) -> [f32; 4] {
    channels(b, |[b]| f32::from(b) / 255.0)
}

fn srgb8(b: &[u8]) -> [f32; 4] {
    let [r, g, b, a] = unorm8(b);
    [srgb_to_linear(r), srgb_to_linear(g), srgb_to_linear(b), a]
}

fn blue_first([b, g, r, a]: [f32; 4]) -> [f32; 4] {
    [r, g, b, a]
}

/// Extracts `bits` bits of a word, starting at bit `at`.
fn field(word: u32, at: u32, bits: u32) -> u32 {
    (word >> at) & ((1 << bits) - 1)
}

fn word(b: &[u8]) -> u32 {
    b.first_chunk().map_or(0, |b| u32::from_le_bytes(*b))
}

/// An unsigned float with five exponent bits and `mantissa` mantissa bits.
fn small_float(bits: u32, mantissa: u32) -> f32 {
    half::f16::from_bits((bits << (10 - mantissa)) as u16).to_f32()
}

/// The decoder of a format's texels. `None` if they are compressed.
fn decode(format: TextureFormat) -> Option<Decode> {
    use TextureFormat as F;
    Some(match format {
        F::R8Unorm | F::Rg8Unorm | F::Rgba8Unorm => unorm8,
        F::Rgba8UnormSrgb => srgb8,
        F::Bgra8Unorm => |b| blue_first(unorm8(b)),
        F::Bgra8UnormSrgb => |b| blue_first(srgb8(b)),
        F::R8Snorm | F::Rg8Snorm | F::Rgba8Snorm => {
            |b| channels(b, |b| (f32::from(i8::from_le_bytes(b)) / 127.0).max(-1.0))
        }
        F::R8Uint | F::Rg8Uint | F::Rgba8Uint => |b| channels(b, |[b]| f32::from(b)),
        F::R8Sint | F::Rg8Sint | F::Rgba8Sint => {
            |b| channels(b, |b| f32::from(i8::from_le_bytes(b)))
        }
        F::R16Unorm | F::Rg16Unorm | F::Rgba16Unorm | F::Depth16Unorm => {
            |b| channels(b, |b| f32::from(u16::from_le_bytes(b)) / 65_535.0)
        }
        F::R16Snorm | F::Rg16Snorm | F::Rgba16Snorm => |b| {
            channels(b, |b| {
                (f32::from(i16::from_le_bytes(b)) / 32_767.0).max(-1.0)
            })
        },
        F::R16Uint | F::Rg16Uint | F::Rgba16Uint => {
            |b| channels(b, |b| f32::from(u16::from_le_bytes(b)))
        }
        F::R16Sint | F::Rg16Sint | F::Rgba16Sint => {
            |b| channels(b, |b| f32::from(i16::from_le_bytes(b)))
        }
        F::R16Float | F::Rg16Float | F::Rgba16Float => {
            |b| channels(b, |b| half::f16::from_le_bytes(b).to_f32())
        }
        F::R32Uint | F::Rg32Uint | F::Rgba32Uint => {
            |b| channels(b, |b| u32::from_le_bytes(b) as f32)
        }
        F::R32Sint | F::Rg32Sint | F::Rgba32Sint => {
            |b| channels(b, |b| i32::from_le_bytes(b) as f32)
        }
        F::R32Float | F::Rg32Float | F::Rgba32Float | F::Depth32Float | F::Depth24Plus => {
            |b| channels(b, f32::from_le_bytes)
        }
        F::Rgb10a2Unorm => |b| {
            let [r, g, b, a] = [(0, 10), (10, 10), (20, 10), (30, 2)]
                .map(|(at, bits)| field(word(b), at, bits) as f32 / ((1 << bits) - 1) as f32);
            [r, g, b, a]
        },
        F::Rgb10a2Uint => |b| {
            [(0, 10), (10, 10), (20, 10), (30, 2)].map(|(at, bits)| field(word(b), at, bits) as f32)
        },
        F::Rg11b10Ufloat => |b| {
            let [r, g, b] = [(0, 6), (11, 6), (22, 5)]
                .map(|(at, mantissa)| small_float(field(word(b), at, mantissa + 5), mantissa));
            [r, g, b, 1.0]
        },
        F::Rgb9e5Ufloat => |b| {
            let scale = (field(word(b), 27, 5) as f32 - 24.0).exp2();
            let [r, g, b] = [0, 9, 18].map(|at| field(word(b), at, 9) as f32 * scale);
            [r, g, b, 1.0]
        },
        _ => return None,
    })
}

/// IEC 61966-2-1.
pub(super) fn srgb_to_linear(v: f32) -> f32 {
    if v <= 0.04045 {
        v / 12.92
    } else {
        ((v + 0.055) / 1.055).powf(2.4)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_texel_stands_for_each() {
        let image = Image {
            size: [4, 2],
            layers: 1,
            dimension: TextureDimension::D2,
            format: TextureFormat::R8Unorm,
            levels: vec![vec![0, 1, 2, 3, 10, 11, 12, 13]],
        };
        let small = image.resampled([2, 1]).map(|image| image.levels);
        assert_eq!(small, Some(vec![vec![11, 13]]));
        let large = image.resampled([8, 2]).map(|image| image.levels);
        let rows = [[0, 0, 1, 1, 2, 2, 3, 3], [10, 10, 11, 11, 12, 12, 13, 13]];
        assert_eq!(large, Some(vec![rows.concat()]));
        let compressed = Image {
            format: TextureFormat::Bc1RgbaUnorm,
            levels: vec![vec![0; 8]],
            ..image
        };
        assert!(compressed.resampled([2, 2]).is_none());
    }
}
