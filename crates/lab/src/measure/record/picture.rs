//! Pictures of one variant and of the original.

use std::sync::Arc;

use crate::measure::{ErrorLadder, Shading};
use preshade_draw::render::Rendered;

/// Factor of a difference picture: 1/255 shows as 16/255, and no difference as less than
/// [`FAINTEST`].
pub const DIFFERENCE_FACTOR: u32 = 16;

/// The least any changed pixel is drawn with, of 255, so that none goes unseen.
pub const FAINTEST: u8 = 64;

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
    /// Its auxiliary pictures in the first camera, by name.
    pub outputs: Vec<(String, Picture)>,
    /// Fragments of the original, if they were counted.
    pub overdraw_before: Option<Shading>,
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

/// A variant where it is worst for a camera other than the headline's.
#[derive(Clone, Debug, PartialEq)]
pub struct Elsewhere {
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
            outputs: Vec::new(),
            overdraw_before: None,
            overdraw_after: None,
        })
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
    /// Colour target 0 of a frame. `None`: it has none.
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
}
