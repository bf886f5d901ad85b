//! Pictures of one variant beside the original, as PNG files.

use std::sync::Arc;

use image::{ExtendedColorType, ImageEncoder};

use super::sheet;
use crate::emit::File;
use crate::measure::{ErrorLadder, Shading};
use crate::render::Rendered;

/// How much a difference picture amplifies: a step of 1/255 shows as 16/255, and never as less than [`FAINTEST`].
pub const DIFFERENCE_FACTOR: u32 = 16;

/// The least any changed pixel is drawn with, of 255, so that none goes unseen.
pub const FAINTEST: u8 = 64;

/// An 8-bit RGBA picture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Texels row by row.
    pub rgba: Vec<u8>,
}

/// The pictures of one variant in the headline view.
#[derive(Clone, Debug, PartialEq)]
pub struct Pictures {
    /// Variant's name.
    pub name: String,
    /// Colour target 0 of the original.
    pub original: Picture,
    /// Colour target 0 of the variant.
    pub variant: Picture,
    /// Their difference, amplified by [`DIFFERENCE_FACTOR`]; black where nothing differs.
    pub difference: Picture,
    /// The view with the largest error, where that is another one.
    pub worst: Option<Worst>,
    /// Of each other camera the view with the largest error, in the scene's order.
    pub elsewhere: Vec<Elsewhere>,
    /// What the original shades, where it was counted.
    pub overdraw_before: Option<Shading>,
    /// What the variant shades.
    pub overdraw_after: Option<Shading>,
}

/// A variant where it is most off.
#[derive(Clone, Debug, PartialEq)]
pub struct Worst {
    /// Camera, frame and order in words.
    pub view: String,
    /// Against the original.
    pub error: ErrorLadder,
    /// Colour target 0 of the original.
    pub original: Picture,
    /// Colour target 0 of the variant.
    pub variant: Picture,
    /// Its difference from the original, amplified as that of the headline view.
    pub difference: Picture,
}

/// What another camera than the headline's sees, where the variant is most off.
#[derive(Clone, Debug, PartialEq)]
pub struct Elsewhere {
    /// Camera.
    pub camera: String,
    /// Camera, frame and order in words.
    pub view: String,
    /// Against the original.
    pub error: ErrorLadder,
    /// Colour target 0 of the original.
    pub original: Arc<Picture>,
    /// Colour target 0 of the variant; `None`: the same bits.
    pub variant: Option<Picture>,
}

/// The FLIP error map (Andersson et al. 2020) of two pictures of one size, from black where no eye sees a difference over magenta to white.
pub fn flip(original: &Picture, variant: &Picture) -> Picture {
    let rgb = |picture: &Picture| {
        let texels = picture.rgba.as_chunks::<4>().0.iter();
        let bytes: Vec<u8> = texels.flat_map(|[r, g, b, _]| [*r, *g, *b]).collect();
        nv_flip::FlipImageRgb8::with_data(picture.size[0], picture.size[1], &bytes)
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
    /// Pictures of colour target 0; `None` where there is none, or the two do not match.
    pub fn new(name: &str, original: &Rendered, variant: &Rendered) -> Option<Self> {
        let (Some(Some(a)), Some(Some(b))) = (original.colors.first(), variant.colors.first())
        else {
            return None;
        };
        if a.size != b.size || a.format != b.format {
            return None;
        }
        let (left, right) = (a.to_rgba8(), b.to_rgba8());
        let difference = left
            .as_chunks::<4>()
            .0
            .iter()
            .zip(right.as_chunks::<4>().0)
            .enumerate()
            .flat_map(|(i, (p, q))| difference(*p, *q, a.texel(i) != b.texel(i)))
            .collect();
        let picture = |rgba| Picture { size: a.size, rgba };
        Some(Self {
            name: name.to_owned(),
            original: picture(left),
            variant: picture(right),
            difference: picture(difference),
            worst: None,
            elsewhere: Vec::new(),
            overdraw_before: None,
            overdraw_after: None,
        })
    }

    /// The PNG files: `original.png`, `NAME.png`, `NAME.difference.png`, `original.overdraw.png`, `NAME.overdraw.png`, where another view
    /// than the headline's is the worst `NAME.worst.png` and `NAME.worst.difference.png`, and the contact sheet `NAME.sheet.png`. [`crate::emit::write`] puts them on the disk, all or none.
    ///
    /// # Errors
    /// What the PNG encoder says.
    pub fn files(&self) -> Result<Vec<File>, image::ImageError> {
        let name = file_name(&self.name);
        let mut files = vec![
            self.original.file("original.png")?,
            self.variant.file(&format!("{name}.png"))?,
            self.difference.file(&format!("{name}.difference.png"))?,
        ];
        let scale = self.overdraw_scale();
        if let Some(shading) = &self.overdraw_before {
            files.push(sheet::overdraw(shading, scale).file("original.overdraw.png")?);
        }
        if let Some(shading) = &self.overdraw_after {
            files.push(sheet::overdraw(shading, scale).file(&format!("{name}.overdraw.png"))?);
        }
        if let Some(worst) = &self.worst {
            files.push(worst.variant.file(&format!("{name}.worst.png"))?);
            let difference = format!("{name}.worst.difference.png");
            files.push(worst.difference.file(&difference)?);
        }
        files.push(sheet::contact(self).file(&format!("{name}.sheet.png"))?);
        Ok(files)
    }

    /// The count that both overdraw pictures show as the ramp's end.
    pub(super) fn overdraw_scale(&self) -> f32 {
        [&self.overdraw_before, &self.overdraw_after]
            .into_iter()
            .flatten()
            .flat_map(|s| &s.counts.values)
            .fold(sheet::LEAST_SCALE, |m, v| m.max(*v))
    }
}

/// Absolute difference, amplified; opaque. A change of alpha alone shows as grey.
fn difference(a: [u8; 4], b: [u8; 4], changed: bool) -> [u8; 4] {
    let amplify = |c: usize| {
        let d = u32::from(a[c].abs_diff(b[c])) * DIFFERENCE_FACTOR;
        d.min(255) as u8
    };
    let mut out = [amplify(0), amplify(1), amplify(2), 255];
    if changed && out[..3].iter().all(|v| *v < FAINTEST) {
        let grey = amplify(3).max(FAINTEST);
        for v in &mut out[..3] {
            *v = (*v).max(grey);
        }
    }
    out
}

impl Picture {
    /// Colour target 0 of what was drawn; `None` where there is none.
    pub fn of(drawn: &Rendered) -> Option<Self> {
        let image = drawn.colors.first()?.as_ref()?;
        Some(Self {
            size: image.size,
            rgba: image.to_rgba8(),
        })
    }

    /// A picture of one colour.
    pub fn filled(size: [u32; 2], color: [u8; 4]) -> Self {
        let pixels = size[0] as usize * size[1] as usize;
        Self {
            size,
            rgba: color.repeat(pixels),
        }
    }

    /// The picture as a PNG file.
    ///
    /// # Errors
    /// What the PNG encoder says.
    pub fn file(&self, name: &str) -> Result<File, image::ImageError> {
        let mut bytes = Vec::new();
        image::codecs::png::PngEncoder::new(&mut bytes).write_image(
            &self.rgba,
            self.size[0],
            self.size[1],
            ExtendedColorType::Rgba8,
        )?;
        Ok(File {
            name: name.to_owned(),
            bytes,
        })
    }
}

/// Longest part of a file name: file systems allow 255 bytes for the whole, endings included.
const LONGEST: usize = 100;

/// A variant's name as a part of a file name: letters, digits, dots and dashes. The end of a long one is its hash.
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
        // All of it is ASCII.
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
