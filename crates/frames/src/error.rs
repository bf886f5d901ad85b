//! Why a frame cannot be read.

use shader_text::limits::Exceeded;
use shader_text::regular::ReadError;

/// A frame that cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file of the folder cannot be read.
    #[error("cannot read `{file}`: {error}")]
    Read {
        /// Name in the folder.
        file: String,
        /// Why.
        error: ReadError,
    },
    /// `frame.json` is no capture that this version reads.
    #[error("`frame.json`: {0}")]
    File(String),
    /// The file names an object that it does not have, or one that does not fit.
    #[error("{place}: {message}")]
    Broken {
        /// The command or object.
        place: String,
        /// What is wrong.
        message: String,
    },
    /// A limit is exceeded.
    #[error(transparent)]
    Limit(#[from] Exceeded),
}

impl Error {
    /// A fault of the file at a place in it.
    pub fn broken(place: impl Into<String>, message: impl Into<String>) -> Self {
        Self::Broken {
            place: place.into(),
            message: message.into(),
        }
    }
}
