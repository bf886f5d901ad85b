//! Why a frame cannot be read.

use shader_text::limits::Exceeded;
use shader_text::read_limited::ReadError;

/// Why a frame cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file of the folder cannot be read.
    #[error("cannot read `{file}`: {error}")]
    Read {
        /// Name in the folder.
        file: String,
        /// Cause of the failure.
        error: ReadError,
    },
    /// `frame.json` is not in the format that this version reads.
    #[error("`frame.json`: {0}")]
    File(String),
    /// The file refers to an object that it lacks or that does not fit.
    #[error("{place}: {message}")]
    Broken {
        /// The command or object with the fault.
        place: String,
        /// Text of the fault.
        message: String,
    },
    /// A limit is exceeded.
    #[error(transparent)]
    Limit(#[from] Exceeded),
}

impl Error {
    /// The error for a fault of the file at `place`.
    pub fn broken(place: impl Into<String>, message: impl Into<String>) -> Self {
        Self::Broken {
            place: place.into(),
            message: message.into(),
        }
    }
}
