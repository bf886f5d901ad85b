//! preshade rewrites a material's shaders into faster variants and proves each by picture and clock.
//!
//! Text becomes a program in [`front`], a recipe of passes makes a plan of it in [`recipe`], and [`emit`] writes the plan out. With the
//! feature `verify`, [`scene`], [`render`], [`measure`] and [`report`] draw the result and say what it costs and gains.

#[cfg(feature = "compiler")]
pub mod build_script;
#[cfg(feature = "compiler")]
pub mod emit;
#[cfg(feature = "compiler")]
pub mod front;
#[cfg(feature = "compiler")]
pub mod limits;
#[cfg(feature = "compiler")]
pub mod lock;
#[cfg(feature = "compiler")]
pub mod nearest;
#[cfg(feature = "compiler")]
mod panics;
#[cfg(feature = "compiler")]
pub mod parameters;
#[cfg(feature = "compiler")]
pub mod recipe;
#[cfg(feature = "compiler")]
pub mod regular;
#[cfg(feature = "compiler")]
pub mod sweep;
#[cfg(feature = "compiler")]
mod wgsl;

#[cfg(feature = "verify")]
pub mod decide;
#[cfg(feature = "verify")]
pub mod frontier;
#[cfg(feature = "verify")]
pub mod measure;
#[cfg(feature = "verify")]
pub mod render;
#[cfg(feature = "verify")]
pub mod report;
#[cfg(feature = "verify")]
pub mod scene;

#[cfg(feature = "compiler")]
pub use build_script::{compile, configure};
#[cfg(feature = "compiler")]
pub use preshade_passes as passes;

/// The items of a material that the build script compiled: `mod lit { preshade::include_variant!("lit"); }`.
#[macro_export]
macro_rules! include_variant {
    ($material:literal) => {
        include!(concat!(env!("OUT_DIR"), "/", $material, ".rs"));
    };
}
