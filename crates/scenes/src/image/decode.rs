//! Decodes image files: PNG, JPEG, WebP, Radiance, OpenEXR and KTX2, detected by their first bytes.

use std::io::Cursor;

use image::{ImageFormat, ImageReader};
use wgpu::TextureFormat;

use super::{Hold, Reading, ktx};
use preshade_draw::scene::image::mip_chain;
use preshade_draw::scene::{Image, SceneError};
use shader_text::limits::Limits;

/// Decodes a file of any of these formats. 16-bit channels are rounded to 8 bits, and floats to 16.
/// `name` is for messages.
///
/// # Errors
/// The format is unknown, or the file cannot be read or is too large.
pub fn decode(
    name: &str,
    bytes: &[u8],
    reading: Reading,
    limits: &Limits,
    hold: Hold<'_>,
) -> Result<Image, SceneError> {
    if bytes.starts_with(&ktx::MAGIC) {
        return ktx::decode(name, bytes, reading, limits, hold);
    }
    let format = image::guess_format(bytes).ok().filter(|format| {
        use ImageFormat::{Hdr, Jpeg, OpenExr, Png, WebP};
        matches!(format, Png | Jpeg | WebP | Hdr | OpenExr)
    });
    let Some(format) = format else {
        return Err(
            SceneError::new(format!("`{name}` is no image that can be read"))
                .help("it may be PNG, JPEG, WebP, Radiance (.hdr), OpenEXR or KTX2"),
        );
    };
    let wrong = |e: image::ImageError| {
        let [extension, ..] = format.extensions_str() else {
            return SceneError::new(format!("`{name}` cannot be read: {e}"));
        };
        SceneError::new(format!(
            "`{name}` is not a {} that can be read: {e}",
            extension.to_uppercase()
        ))
    };
    let reader = || ImageReader::with_format(Cursor::new(bytes), format);
    let (width, height) = reader().into_dimensions().map_err(wrong)?;
    let side = u64::from(width.max(height));
    limits.check("texture-size", side, format!("the side of `{name}`"))?;
    let is_float = matches!(format, ImageFormat::Hdr | ImageFormat::OpenExr);
    let texel: u64 = if is_float { 8 } else { 4 };
    let texels = u64::from(width) * u64::from(height);
    hold((texels * texel).saturating_mul(4) / 3)?;
    let mut reader = reader();
    let mut most = image::Limits::default();
    most.max_image_width = Some(limits.of("texture-size").min(u32::MAX.into()) as u32);
    most.max_image_height = most.max_image_width;
    // In addition to its result, a decoder holds the file's own channels of up to four bytes each.
    most.max_alloc = Some(limits.of("scene-bytes").max(texels.saturating_mul(40)));
    reader.limits(most);
    let decoded = reader.decode().map_err(wrong)?;
    let size = [width, height];
    if is_float {
        let floats = decoded.into_rgba32f().into_raw();
        let chain = match reading.mips {
            true => float_chain(size, floats),
            false => vec![floats],
        };
        return Ok(Image {
            format: TextureFormat::Rgba16Float,
            ..Image::rgba8(size, 1, false, chain.iter().map(|l| halves(l)).collect())
        });
    }
    let texels = decoded.into_rgba8().into_raw();
    let levels = match reading.mips {
        true => mip_chain(size, texels, reading.srgb),
        false => vec![texels],
    };
    Ok(Image::rgba8(size, 1, reading.srgb, levels))
}

/// Converts to 16-bit floats, which every adapter can filter. Clamps to the largest one.
fn halves(numbers: &[f32]) -> Vec<u8> {
    let most = half::f16::MAX.to_f32();
    let half = |n: &f32| half::f16::from_f32(n.clamp(-most, most)).to_le_bytes();
    numbers.iter().flat_map(half).collect()
}

/// [`mip_chain`] for floats.
fn float_chain(size: [u32; 2], level0: Vec<f32>) -> Vec<Vec<f32>> {
    let (mut w, mut h) = (size[0].max(1) as usize, size[1].max(1) as usize);
    let mut levels = vec![level0];
    while w > 1 || h > 1 {
        let (nw, nh) = ((w / 2).max(1), (h / 2).max(1));
        let above = &levels[levels.len() - 1];
        let mut next = Vec::with_capacity(nw * nh * 4);
        for (y, x) in (0..nh).flat_map(|y| (0..nw).map(move |x| (y, x))) {
            let columns = (x * w / nw)..((x + 1) * w / nw);
            let rows = (y * h / nh)..((y + 1) * h / nh);
            for c in 0..4 {
                let places = rows
                    .clone()
                    .flat_map(|r| columns.clone().map(move |k| (r, k)));
                let sum: f32 = places.map(|(r, k)| above[(r * w + k) * 4 + c]).sum();
                next.push(sum / (rows.len() * columns.len()) as f32);
            }
        }
        levels.push(next);
        (w, h) = (nw, nh);
    }
    levels
}
