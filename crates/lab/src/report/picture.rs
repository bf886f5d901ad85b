//! Pictures as PNG files.

use image::{ExtendedColorType, ImageEncoder};

use super::contact_sheet;
use crate::measure::record::{Picture, Pictures};
use shader_text::files::File;

/// The FLIP error map of two pictures of one size (Andersson et al. 2020): black for no visible
/// difference, then magenta to white.
pub(crate) fn flip(original: &Picture, variant: &Picture) -> Picture {
    let rgb = |picture: &Picture| {
        nv_flip::FlipImageRgb8::with_data(picture.size[0], picture.size[1], &picture.rgb())
    };
    let map = nv_flip::flip(
        rgb(original),
        rgb(variant),
        nv_flip::DEFAULT_PIXELS_PER_DEGREE,
    );
    let colors = map.apply_color_lut(&nv_flip::magma_lut()).to_vec();
    let texels = colors.as_chunks::<3>().0.iter();
    Picture {
        size: original.size,
        rgba: texels.flat_map(|[r, g, b]| [*r, *g, *b, 255]).collect(),
    }
}

impl Pictures {
    /// The PNG files: `original.png`, `NAME.png`, `NAME.difference.png`, `original.overdraw.png`,
    /// `NAME.overdraw.png` and the contact sheet `NAME.sheet.png`. If another view than the
    /// headline's is the worst, also `NAME.worst.png` and `NAME.worst.difference.png`; of auxiliary
    /// pictures `NAME.velocity.png`, `NAME.normal.png` and so on.
    pub fn files(&self) -> Result<Vec<File>, image::ImageError> {
        let name = file_name(&self.name);
        let mut files = vec![
            self.original.file("original.png")?,
            self.variant.file(&format!("{name}.png"))?,
            self.difference.file(&format!("{name}.difference.png"))?,
        ];
        let scale = self.overdraw_scale();
        if let Some(shading) = &self.overdraw_before {
            files.push(contact_sheet::overdraw(shading, scale).file("original.overdraw.png")?);
        }
        if let Some(shading) = &self.overdraw_after {
            files.push(
                contact_sheet::overdraw(shading, scale).file(&format!("{name}.overdraw.png"))?,
            );
        }
        if let Some(worst) = &self.worst {
            files.push(worst.variant.file(&format!("{name}.worst.png"))?);
            let difference = format!("{name}.worst.difference.png");
            files.push(worst.difference.file(&difference)?);
        }
        for (what, picture) in &self.outputs {
            files.push(picture.file(&format!("{name}.{what}.png"))?);
        }
        files.push(contact_sheet::contact(self).file(&format!("{name}.sheet.png"))?);
        Ok(files)
    }

    /// The count that both overdraw pictures show as the ramp's end.
    pub(super) fn overdraw_scale(&self) -> f32 {
        [&self.overdraw_before, &self.overdraw_after]
            .into_iter()
            .flatten()
            .flat_map(|s| &s.counts.values)
            .fold(contact_sheet::LEAST_SCALE, |m, v| m.max(*v))
    }
}

impl Picture {
    /// Without alpha, as an opaque canvas shows it.
    fn rgb(&self) -> Vec<u8> {
        let texels = self.rgba.as_chunks::<4>().0.iter();
        texels.flat_map(|[r, g, b, _]| [*r, *g, *b]).collect()
    }

    /// The picture as a PNG file, without alpha: many materials write an alpha that is not
    /// displayed, and with it a viewer would show them blank.
    pub fn file(&self, name: &str) -> Result<File, image::ImageError> {
        let mut bytes = Vec::new();
        image::codecs::png::PngEncoder::new(&mut bytes).write_image(
            &self.rgb(),
            self.size[0],
            self.size[1],
            ExtendedColorType::Rgb8,
        )?;
        Ok(File {
            name: name.to_owned(),
            bytes,
        })
    }
}

/// Longest part of a file name: file systems allow 255 bytes for the whole, endings included.
const LONGEST: usize = 100;

/// A variant's name as part of a file name: letters, digits, dots and dashes. A long name ends in
/// its hash.
pub fn file_name(name: &str) -> String {
    let mut out = String::new();
    for c in name.chars() {
        if c.is_ascii_alphanumeric() || c == '.' {
            out.push(c);
        } else if !out.ends_with('-') {
            out.push('-');
        }
    }
    let out = out.trim_matches(['-', '.']);
    match out.len() > LONGEST {
        // It is ASCII.
        true => {
            let hash = blake3::hash(name.as_bytes()).to_hex();
            format!("{}-{}", &out[..LONGEST - 17], &hash[..16])
        }
        false => out.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::{LONGEST, file_name};

    #[test]
    fn long_names_stay_apart_and_fit_a_file_system() {
        let carry = |last: char| format!("hoist:budget=0.05,carry={}{last}", "0563cb87".repeat(64));
        let (a, b) = (file_name(&carry('a')), file_name(&carry('b')));
        assert_eq!([a.len(), b.len()], [LONGEST; 2]);
        assert_ne!(a, b);
        assert!(a.starts_with("hoist-budget-0.05-carry-0563cb87"), "{a}");
        assert_eq!(file_name("hoist:budget=0.05"), "hoist-budget-0.05");
    }
}
