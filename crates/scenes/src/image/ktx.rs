//! Reads KTX2: textures in GPU formats with all their mip levels.

use std::io::Read as _;

use ktx2::{ColorModel, Format, Header, Reader, SupercompressionScheme, TransferFunction};
use wgpu::{AstcBlock, AstcChannel, TextureDimension, TextureFormat};

use super::{Hold, Reading};
use preshade_draw::scene::image::mip_chain;
use preshade_draw::scene::{Image, SceneError};
use shader_text::limits::Limits;

/// The first bytes of a file.
pub(super) const MAGIC: [u8; 12] = *b"\xabKTX 20\xbb\r\n\x1a\n";

/// Reads a KTX2 file.
///
/// # Errors
/// The file is broken or too large, or has a format that WebGPU lacks.
pub fn decode(
    name: &str,
    bytes: &[u8],
    reading: Reading,
    limits: &Limits,
    hold: Hold<'_>,
) -> Result<Image, SceneError> {
    let wrong = |what: String| SceneError::new(format!("`{name}`: {what}"));
    let reader = Reader::new(bytes).map_err(|e| wrong(format!("no KTX2 that can be read: {e}")))?;
    let header = reader.header();
    let (width, height) = (header.pixel_width, header.pixel_height.max(1));
    let depth = header.pixel_depth.max(1);
    let side = u64::from(width.max(height).max(depth));
    limits.check("texture-size", side, format!("the side of `{name}`"))?;
    let layers = u64::from(header.layer_count.max(1))
        .saturating_mul(header.face_count.max(1).into())
        .saturating_mul(depth.into());
    // No format has more than 16 bytes per texel.
    let most = (u64::from(width) * u64::from(height)).saturating_mul(layers);
    let most = most.saturating_mul(16).saturating_mul(4) / 3;
    let stored = reader.levels().fold(0, |sum: u64, level| {
        sum.saturating_add(level.uncompressed_byte_length.max(level.data.len() as u64))
    });
    if stored > most.saturating_add(1024) {
        return Err(wrong(format!("its levels would have {stored} bytes")));
    }
    hold(stored.saturating_mul(4))?;
    let mut levels = Vec::new();
    for level in reader.levels() {
        levels.push(
            uncompressed(&header, level.data, level.uncompressed_byte_length).map_err(wrong)?,
        );
    }
    let mut image = Image {
        layers: u32::try_from(layers).unwrap_or(u32::MAX),
        dimension: match header.pixel_depth {
            0 => TextureDimension::D2,
            _ => TextureDimension::D3,
        },
        ..Image::rgba8([width, height], 1, false, levels)
    };
    match header.format {
        Some(format) => {
            image.format = texture_format(format)
                .ok_or_else(|| wrong(format!("WebGPU has no format {format:?}")))?;
        }
        None if reader.color_model() == Some(ColorModel::UASTC) => {
            let srgb = reader.transfer_function() == Some(TransferFunction::SRGB);
            uastc(&mut image, srgb).map_err(wrong)?;
        }
        None => {
            return Err(
                wrong("its texels are compressed as ETC1S, which is not read".to_owned()).help(
                    "compress it as UASTC: `toktx --encode uastc`, or `ktx create --encode uastc`",
                ),
            );
        }
    }
    for (i, level) in (0..).zip(&image.levels) {
        let [_, _, depth] = image.extent(i);
        let rows = image.rows(i).unwrap_or([0, 0]);
        let needed = rows.iter().chain([&depth]).map(|n| u64::from(*n));
        let needed = needed.fold(1, u64::saturating_mul);
        if (level.len() as u64) < needed {
            let has = level.len();
            return Err(wrong(format!("level {i} has {has} of {needed} bytes")));
        }
    }
    let is_bytes = image.format.remove_srgb_suffix() == TextureFormat::Rgba8Unorm;
    // Only a file that asks for levels to be generated has none.
    if let ([_], true, 1, true) = (
        image.levels.as_slice(),
        is_bytes,
        image.layers,
        reading.mips,
    ) {
        let level0 = image.levels.remove(0);
        image.levels = mip_chain(image.size, level0, image.format.is_srgb());
    }
    Ok(image)
}

/// The decompressed bytes of a level.
fn uncompressed(header: &Header, data: &[u8], length: u64) -> Result<Vec<u8>, String> {
    let mut out = Vec::new();
    let failed = |e: std::io::Error| format!("a level cannot be decompressed: {e}");
    match header.supercompression_scheme {
        None => return Ok(data.to_vec()),
        Some(SupercompressionScheme::Zstandard) => {
            let decoder = ruzstd::decoding::StreamingDecoder::new(data)
                .map_err(|e| format!("a level cannot be decompressed: {e}"))?;
            decoder.take(length).read_to_end(&mut out).map_err(failed)?;
        }
        Some(SupercompressionScheme::ZLIB) => {
            let decoder = flate2::read::ZlibDecoder::new(data);
            decoder.take(length).read_to_end(&mut out).map_err(failed)?;
        }
        // The caller refuses this scheme, because its texels are ETC1S.
        Some(SupercompressionScheme::BasisLZ) => {}
        Some(other) => return Err(format!("its levels are compressed as {other:?}")),
    }
    Ok(out)
}

/// Transcodes blocks of UASTC to BC7, which have the same size.
#[cfg(feature = "basis")]
fn uastc(image: &mut Image, srgb: bool) -> Result<(), String> {
    use basis_universal::{
        DecodeFlags, LowLevelUastcTranscoder, SliceParametersUastc, TranscoderBlockFormat,
    };
    let transcoder = LowLevelUastcTranscoder::new();
    let mut levels = Vec::new();
    for (i, data) in (0..).zip(&image.levels) {
        let [width, height, layers] = image.extent(i);
        let [across, down] = [width, height].map(|n| n.div_ceil(4));
        let layer_bytes = across as usize * down as usize * 16;
        let mut level = Vec::new();
        for layer in 0..layers as usize {
            let blocks = data
                .get(layer * layer_bytes..(layer + 1) * layer_bytes)
                .ok_or_else(|| format!("level {i} has {} bytes", data.len()))?;
            let slice = SliceParametersUastc {
                num_blocks_x: across,
                num_blocks_y: down,
                has_alpha: true,
                // A whole number of blocks, because the crate allocates no more.
                original_width: across * 4,
                original_height: down * 4,
            };
            let (flags, format) = (DecodeFlags::empty(), TranscoderBlockFormat::BC7);
            let made = transcoder.transcode_slice(blocks, slice, flags, format);
            let made = made.map_err(|e| format!("level {i} of UASTC: {e:?}"))?;
            level.extend(made.get(..layer_bytes).ok_or("too few blocks of BC7")?);
        }
        levels.push(level);
    }
    image.levels = levels;
    image.format = match srgb {
        true => TextureFormat::Bc7RgbaUnormSrgb,
        false => TextureFormat::Bc7RgbaUnorm,
    };
    Ok(())
}

#[cfg(not(feature = "basis"))]
fn uastc(_: &mut Image, _: bool) -> Result<(), String> {
    Err(
        "its texels are compressed as UASTC, which this preshade was built without: build it with \
         the feature `basis`"
            .to_owned(),
    )
}

/// WebGPU's format for one of Vulkan's.
fn texture_format(format: Format) -> Option<TextureFormat> {
    use TextureFormat as T;
    let astc = |block, srgb| T::Astc {
        block,
        channel: match srgb {
            true => AstcChannel::UnormSrgb,
            false => AstcChannel::Unorm,
        },
    };
    Some(match format {
        Format::R8_UNORM => T::R8Unorm,
        Format::R8_SNORM => T::R8Snorm,
        Format::R8_UINT => T::R8Uint,
        Format::R8_SINT => T::R8Sint,
        Format::R8G8_UNORM => T::Rg8Unorm,
        Format::R8G8_SNORM => T::Rg8Snorm,
        Format::R8G8_UINT => T::Rg8Uint,
        Format::R8G8_SINT => T::Rg8Sint,
        Format::R8G8B8A8_UNORM => T::Rgba8Unorm,
        Format::R8G8B8A8_SRGB => T::Rgba8UnormSrgb,
        Format::R8G8B8A8_SNORM => T::Rgba8Snorm,
        Format::R8G8B8A8_UINT => T::Rgba8Uint,
        Format::R8G8B8A8_SINT => T::Rgba8Sint,
        Format::B8G8R8A8_UNORM => T::Bgra8Unorm,
        Format::B8G8R8A8_SRGB => T::Bgra8UnormSrgb,
        Format::A2B10G10R10_UNORM_PACK32 => T::Rgb10a2Unorm,
        Format::B10G11R11_UFLOAT_PACK32 => T::Rg11b10Ufloat,
        Format::E5B9G9R9_UFLOAT_PACK32 => T::Rgb9e5Ufloat,
        Format::R16_UNORM => T::R16Unorm,
        Format::R16_UINT => T::R16Uint,
        Format::R16_SINT => T::R16Sint,
        Format::R16_SFLOAT => T::R16Float,
        Format::R16G16_UNORM => T::Rg16Unorm,
        Format::R16G16_UINT => T::Rg16Uint,
        Format::R16G16_SINT => T::Rg16Sint,
        Format::R16G16_SFLOAT => T::Rg16Float,
        Format::R16G16B16A16_UNORM => T::Rgba16Unorm,
        Format::R16G16B16A16_UINT => T::Rgba16Uint,
        Format::R16G16B16A16_SINT => T::Rgba16Sint,
        Format::R16G16B16A16_SFLOAT => T::Rgba16Float,
        Format::R32_UINT => T::R32Uint,
        Format::R32_SINT => T::R32Sint,
        Format::R32_SFLOAT => T::R32Float,
        Format::R32G32_SFLOAT => T::Rg32Float,
        Format::R32G32B32A32_SFLOAT => T::Rgba32Float,
        Format::BC1_RGB_UNORM_BLOCK | Format::BC1_RGBA_UNORM_BLOCK => T::Bc1RgbaUnorm,
        Format::BC1_RGB_SRGB_BLOCK | Format::BC1_RGBA_SRGB_BLOCK => T::Bc1RgbaUnormSrgb,
        Format::BC2_UNORM_BLOCK => T::Bc2RgbaUnorm,
        Format::BC2_SRGB_BLOCK => T::Bc2RgbaUnormSrgb,
        Format::BC3_UNORM_BLOCK => T::Bc3RgbaUnorm,
        Format::BC3_SRGB_BLOCK => T::Bc3RgbaUnormSrgb,
        Format::BC4_UNORM_BLOCK => T::Bc4RUnorm,
        Format::BC4_SNORM_BLOCK => T::Bc4RSnorm,
        Format::BC5_UNORM_BLOCK => T::Bc5RgUnorm,
        Format::BC5_SNORM_BLOCK => T::Bc5RgSnorm,
        Format::BC6H_UFLOAT_BLOCK => T::Bc6hRgbUfloat,
        Format::BC6H_SFLOAT_BLOCK => T::Bc6hRgbFloat,
        Format::BC7_UNORM_BLOCK => T::Bc7RgbaUnorm,
        Format::BC7_SRGB_BLOCK => T::Bc7RgbaUnormSrgb,
        Format::ETC2_R8G8B8_UNORM_BLOCK => T::Etc2Rgb8Unorm,
        Format::ETC2_R8G8B8_SRGB_BLOCK => T::Etc2Rgb8UnormSrgb,
        Format::ETC2_R8G8B8A1_UNORM_BLOCK => T::Etc2Rgb8A1Unorm,
        Format::ETC2_R8G8B8A1_SRGB_BLOCK => T::Etc2Rgb8A1UnormSrgb,
        Format::ETC2_R8G8B8A8_UNORM_BLOCK => T::Etc2Rgba8Unorm,
        Format::ETC2_R8G8B8A8_SRGB_BLOCK => T::Etc2Rgba8UnormSrgb,
        Format::EAC_R11_UNORM_BLOCK => T::EacR11Unorm,
        Format::EAC_R11G11_UNORM_BLOCK => T::EacRg11Unorm,
        Format::ASTC_4x4_UNORM_BLOCK => astc(AstcBlock::B4x4, false),
        Format::ASTC_4x4_SRGB_BLOCK => astc(AstcBlock::B4x4, true),
        Format::ASTC_6x6_UNORM_BLOCK => astc(AstcBlock::B6x6, false),
        Format::ASTC_6x6_SRGB_BLOCK => astc(AstcBlock::B6x6, true),
        Format::ASTC_8x8_UNORM_BLOCK => astc(AstcBlock::B8x8, false),
        Format::ASTC_8x8_SRGB_BLOCK => astc(AstcBlock::B8x8, true),
        _ => return None,
    })
}
