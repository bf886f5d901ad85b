//! The purposes of reading a captured program, and reasons to leave out a draw.

use super::Error;
use preshade_draw::scene::Rows;
use preshade_frames::folder::Capture;

/// Why a draw is not in the scene.
pub(super) enum Left {
    /// Only this draw is left out, for this reason.
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

/// The purpose of reading a program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Reader {
    /// To show or rewrite its text: it stays as the author wrote it.
    Author,
    /// For a scene, which can have any size.
    Scene,
    /// For the replay, which has the frame's size and must be exact to the bit.
    Replay,
}

impl Reader {
    /// The row order of the drawn targets. WebGL's order needs a negated y in positions.
    pub(super) fn rows(self, capture: &Capture) -> Rows {
        match self != Self::Author && capture.file.source.api.is_webgl() {
            true => Rows::FromBottom,
            false => Rows::FromTop,
        }
    }
}
