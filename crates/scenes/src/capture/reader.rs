//! What a captured program is read for, and why it is left out.

use super::Error;
use preshade_draw::scene::Rows;
use preshade_frames::folder::Capture;

/// Why a draw is not in the scene.
pub(super) enum Left {
    /// It is left out, and everything else is drawn.
    Out(String),
    /// The capture is broken, or the device is lost.
    Broken(Error),
}

impl From<Error> for Left {
    fn from(error: Error) -> Self {
        Self::Broken(error)
    }
}

impl From<preshade_frames::error::Error> for Left {
    fn from(error: preshade_frames::error::Error) -> Self {
        Self::Broken(error.into())
    }
}

/// What a program is read for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Reader {
    /// Its text: it is as the author wrote it.
    Author,
    /// A scene, which draws it at any size.
    Scene,
    /// The replay, which draws it at the frame's size, to the bit.
    Replay,
}

impl Reader {
    /// The order of rows in what is drawn. With the rows of WebGL, positions have their y negated.
    pub(super) fn rows(self, capture: &Capture) -> Rows {
        match self != Self::Author && capture.file.source.api.is_webgl() {
            true => Rows::FromBottom,
            false => Rows::FromTop,
        }
    }
}
