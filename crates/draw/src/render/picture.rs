//! Pictures that were read back: colour as bytes, depth as floats, per sample.

use half::f16;

/// The contents of a colour target.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ColorImage {
    /// Width and height in pixels.
    pub size: [u32; 2],
    pub format: wgpu::TextureFormat,
    /// Texels row by row, without padding.
    pub bytes: Vec<u8>,
}

impl ColorImage {
    /// Reverses the order of rows.
    pub fn turn_over(&mut self) {
        turn_over(&mut self.bytes, self.size[1]);
    }
}

/// Reverses the order of rows of equal length.
fn turn_over<T>(values: &mut [T], rows: u32) {
    let row = values.len() / rows.max(1) as usize;
    values.reverse();
    for row in values.chunks_mut(row.max(1)) {
        row.reverse();
    }
}

/// Depth at full precision. A unorm depth is the float nearest to `n / (2^bits - 1)`; distinct
/// values map to distinct floats.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthImage {
    /// Width and height in pixels.
    pub size: [u32; 2],
    pub samples: u32,
    /// Values row by row; the samples of a pixel follow each other.
    pub values: Vec<f32>,
}

impl DepthImage {
    /// Reverses the order of rows.
    pub fn turn_over(&mut self) {
        turn_over(&mut self.values, self.size[1]);
    }
}

/// The encoding of a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Channel {
    Unorm8,
    Uint8,
    Float16,
    Float32,
    Uint16,
    Uint32,
    Sint32,
}

impl ColorImage {
    pub fn texel_bytes(&self) -> usize {
        self.format.block_copy_size(None).unwrap_or(4) as usize
    }

    /// The bytes of pixel `index`, counting row by row.
    pub fn texel(&self, index: usize) -> &[u8] {
        let n = self.texel_bytes();
        self.bytes.get(index * n..(index + 1) * n).unwrap_or(&[])
    }

    /// The channels of pixel `index` of an integer target. Missing channels are 0. `None` for other
    /// formats.
    pub fn integers(&self, index: usize) -> Option<[i64; 4]> {
        let (channel, width) = self.channel();
        let mut out = [0; 4];
        for (value, bytes) in out.iter_mut().zip(self.texel(index).chunks_exact(width)) {
            *value = match (channel, bytes) {
                (Channel::Uint8, [b]) => i64::from(*b),
                (Channel::Uint16, [a, b]) => i64::from(u16::from_le_bytes([*a, *b])),
                (Channel::Uint32, [a, b, c, d]) => i64::from(u32::from_le_bytes([*a, *b, *c, *d])),
                (Channel::Sint32, [a, b, c, d]) => i64::from(i32::from_le_bytes([*a, *b, *c, *d])),
                _ => return None,
            };
        }
        let integer = [
            Channel::Uint8,
            Channel::Uint16,
            Channel::Uint32,
            Channel::Sint32,
        ];
        integer.contains(&channel).then_some(out)
    }

    /// Number of channels that the format stores.
    pub fn channels(&self) -> u8 {
        self.format.components()
    }

    /// Red, green, blue and alpha of pixel `index` as stored: values of an sRGB target stay
    /// encoded. Missing channels are 0, a missing alpha is 1.
    pub fn rgba(&self, index: usize) -> [f32; 4] {
        let texel = self.texel(index);
        let mut out = [0.0, 0.0, 0.0, 1.0];
        if let Some(packed) = self.packed(texel) {
            return packed;
        }
        let (channel, width) = self.channel();
        for (value, bytes) in out.iter_mut().zip(texel.chunks_exact(width)) {
            *value = match (channel, bytes) {
                (Channel::Unorm8, [b]) => f32::from(*b) / 255.0,
                (Channel::Uint8, [b]) => f32::from(*b),
                (Channel::Float16, [a, b]) => f16::from_le_bytes([*a, *b]).to_f32(),
                (Channel::Uint16, [a, b]) => f32::from(u16::from_le_bytes([*a, *b])),
                (Channel::Float32, [a, b, c, d]) => f32::from_le_bytes([*a, *b, *c, *d]),
                (Channel::Uint32, [a, b, c, d]) => u32::from_le_bytes([*a, *b, *c, *d]) as f32,
                (Channel::Sint32, [a, b, c, d]) => i32::from_le_bytes([*a, *b, *c, *d]) as f32,
                _ => 0.0,
            };
        }
        if self.is_bgra() {
            out.swap(0, 2);
        }
        out
    }

    /// Whether the format is a float format and can hold NaN or infinity.
    pub fn is_float(&self) -> bool {
        matches!(self.channel().0, Channel::Float16 | Channel::Float32)
            || self.format == wgpu::TextureFormat::Rg11b10Ufloat
    }

    /// 8-bit RGBA for viewing. Floats are clamped to 0..1 and encoded as sRGB. Other formats keep
    /// their values: a `rgba8unorm` target holds display values.
    pub fn to_rgba8(&self) -> Vec<u8> {
        let pixels = (self.size[0] as usize) * (self.size[1] as usize);
        let mut out = Vec::with_capacity(pixels * 4);
        for i in 0..pixels {
            let rgba = self.rgba(i);
            for (channel, v) in rgba.into_iter().enumerate() {
                let v = v.clamp(0.0, 1.0);
                let v = if self.is_float() && channel < 3 {
                    srgb_encode(v)
                } else {
                    v
                };
                out.push((v * 255.0).round() as u8);
            }
        }
        out
    }

    fn is_bgra(&self) -> bool {
        use wgpu::TextureFormat as W;
        matches!(self.format, W::Bgra8Unorm | W::Bgra8UnormSrgb)
    }

    fn packed(&self, texel: &[u8]) -> Option<[f32; 4]> {
        let bits = || match texel {
            [a, b, c, d] => u32::from_le_bytes([*a, *b, *c, *d]),
            _ => 0,
        };
        match self.format {
            wgpu::TextureFormat::Rgb10a2Unorm => {
                let v = bits();
                let ten = |shift: u32| ((v >> shift) & 0x3ff) as f32 / 1023.0;
                Some([ten(0), ten(10), ten(20), (v >> 30) as f32 / 3.0])
            }
            wgpu::TextureFormat::Rg11b10Ufloat => {
                let v = bits();
                // A small unsigned float is a half float without its low mantissa bits.
                let float = |bits: u32, cut: u32| f16::from_bits((bits << cut) as u16).to_f32();
                Some([
                    float(v & 0x7ff, 4),
                    float((v >> 11) & 0x7ff, 4),
                    float(v >> 22, 5),
                    1.0,
                ])
            }
            _ => None,
        }
    }

    fn channel(&self) -> (Channel, usize) {
        use wgpu::TextureFormat as W;
        match self.format {
            W::R16Float | W::Rg16Float | W::Rgba16Float => (Channel::Float16, 2),
            W::R32Float | W::Rg32Float | W::Rgba32Float => (Channel::Float32, 4),
            W::R8Uint | W::Rgba8Uint => (Channel::Uint8, 1),
            W::R16Uint | W::Rg16Uint | W::Rgba16Uint => (Channel::Uint16, 2),
            W::R32Uint | W::Rg32Uint | W::Rgba32Uint => (Channel::Uint32, 4),
            W::R32Sint | W::Rgba32Sint => (Channel::Sint32, 4),
            _ => (Channel::Unorm8, 1),
        }
    }
}

impl DepthImage {
    /// Depth of sample `sample` of pixel `x`, `y`.
    pub fn at(&self, x: u32, y: u32, sample: u32) -> Option<f32> {
        let index = (y as usize * self.size[0] as usize + x as usize) * self.samples as usize
            + sample as usize;
        self.values.get(index).copied()
    }
}

/// The sRGB transfer function (IEC 61966-2-1).
pub fn srgb_encode(linear: f32) -> f32 {
    if linear <= 0.003_130_8 {
        linear * 12.92
    } else {
        1.055 * linear.powf(1.0 / 2.4) - 0.055
    }
}
