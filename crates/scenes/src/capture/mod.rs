//! Frames captured from a page or an app, as `docs/reference/frames.md` describes them.
//!
//! Data flows through the modules in this order:
//!
//! 1. [`preshade_frames::file`] holds the data of `frame.json`;
//! 2. [`preshade_frames::folder`] reads it with the files that it names, and checks sizes;
//! 3. [`replay`] executes the original commands on wgpu, and reads contents back;
//! 4. [`preshade_frames::pass`] finds the render passes and their draws;
//! 5. [`scene`] makes a [`preshade_draw::scene::Scene`] of one pass: its pipelines are the materials.

mod alpha;
pub mod check;
mod draw_id;
mod maker;
mod material;
mod measured;
mod noise;
mod points;
mod reader;
pub mod replay;
mod scene;
mod share;
mod start;
mod texels;
mod unknown;
mod webgl;

pub use check::{Check, Compared, check, pictures};
pub use preshade_frames::folder::{Capture, file_of, is_file, is_folder};
pub use preshade_frames::pass::{Kind, Pass, passes};
pub use scene::{Choice, scene};
pub use share::Share;
pub use unknown::{UnknownDepth, unknown_depths};

use preshade_draw::render;
use shader_text::limits::Exceeded;

/// Why a capture cannot be read or replayed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The folder cannot be read, or is broken.
    #[error(transparent)]
    Frame(#[from] preshade_frames::error::Error),
    #[error(transparent)]
    Limit(#[from] Exceeded),
    /// A shader of the capture does not compile.
    #[error("shader {shader}: {error}")]
    Shader {
        shader: usize,
        error: Box<shader_text::error::Error>,
    },
    #[error(transparent)]
    Render(#[from] render::Error),
}

impl Error {
    pub fn code(&self) -> &'static str {
        match self {
            Self::Render(error) => error.code(),
            _ => preshade_frames::codes::CAPTURE.code,
        }
    }

    fn broken(place: impl Into<String>, message: impl Into<String>) -> Self {
        preshade_frames::error::Error::broken(place, message).into()
    }
}
