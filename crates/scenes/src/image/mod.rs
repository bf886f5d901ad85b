//! Reads image files.

pub mod decode;
mod ktx;

pub use decode::decode;

use preshade_draw::scene::SceneError;
use preshade_draw::scene::image::Recipe;

/// How to read the texels of a file that does not say it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Reading {
    /// Whether bytes are sRGB-encoded. Floats never are, and a KTX2 file says it.
    pub srgb: bool,
    /// Whether to compute mip levels, where the file has none.
    pub mips: bool,
}

impl Reading {
    /// How a scene file wants its texture's file read.
    pub fn of(recipe: &Recipe) -> Self {
        Self {
            srgb: recipe.srgb.unwrap_or(true),
            mips: recipe.mips,
        }
    }
}

/// Gets the bytes of an image before they are allocated.
pub(crate) type Hold<'a> = &'a dyn Fn(u64) -> Result<(), SceneError>;
