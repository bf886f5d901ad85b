//! Reads image files.

pub mod decode;
mod ktx;

pub use decode::decode;

use preshade_draw::scene::SceneError;
use preshade_draw::scene::image::Recipe;

/// How to read texels of a file that does not specify it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Reading {
    /// Whether 8-bit texels are sRGB-encoded. Ignored for floats and KTX2 files.
    pub srgb: bool,
    /// Whether to generate mip levels if the file has none.
    pub mips: bool,
}

impl Reading {
    /// The reading that a scene file's texture entry specifies.
    pub fn of(recipe: &Recipe) -> Self {
        Self {
            srgb: recipe.srgb.unwrap_or(true),
            mips: recipe.mips,
        }
    }
}

/// Checks the size of an image in bytes before it is allocated.
pub(crate) type Hold<'a> = &'a dyn Fn(u64) -> Result<(), SceneError>;
