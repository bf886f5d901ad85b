//! Why a lock cannot be read, and why it does not fit.

use std::io;
use std::path::PathBuf;

use preshade_passes::pass::Refusal;

use super::TOOL;
use crate::emit;

/// A lock file that cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LockError {
    /// What the file system says.
    #[error("{}: {error}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Why not.
        #[source]
        error: io::Error,
    },
    /// It is no lock file, or one with keys that this preshade does not know.
    #[error("{}: not a lock file that {TOOL} can read: {message}", path.display())]
    Syntax {
        /// The file, or nothing where a text was read.
        path: PathBuf,
        /// Where and why.
        message: String,
    },
    /// Another preshade wrote it, with keys or a schema that this one does not know.
    #[error("{}: written by another preshade ({by}), and this is {TOOL}: {message}", path.display())]
    Foreign {
        /// The file, or nothing where a text was read.
        path: PathBuf,
        /// Its schema, or who wrote it.
        by: String,
        /// What is not known.
        message: String,
    },
}

impl LockError {
    /// What kind of error it is, as messages have it in brackets; stable.
    pub fn code(&self) -> &'static str {
        match self {
            Self::Io { .. } => "lock-file",
            Self::Syntax { .. } => "lock-syntax",
            Self::Foreign { .. } => "lock-foreign",
        }
    }
}

/// A lock does not fit what is there now.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Mismatch {
    /// It says nothing of the material.
    #[error("preshade.lock says nothing of `{material}`")]
    NoMaterial {
        /// The material.
        material: String,
    },
    /// Another preshade chose.
    #[error("preshade.lock was written by {locked}, and this is {TOOL}")]
    Tool {
        /// Who wrote it.
        locked: String,
    },
    /// There are other files than there were.
    #[error("preshade.lock was written for {locked}, not for {now}")]
    Files {
        /// Names of the files then.
        locked: String,
        /// Names of the files now.
        now: String,
    },
    /// A file was edited.
    #[error("{file} was edited after preshade.lock was written")]
    Source {
        /// Name of the file.
        file: String,
    },
    /// Another value of a definition, or none.
    #[error("preshade.lock was written with other definitions ({names})")]
    Defines {
        /// Names that differ.
        names: String,
    },
    /// Another entry point.
    #[error("preshade.lock was written for other entry points")]
    EntryPoints,
    /// Another pipeline state.
    #[error("preshade.lock was written for another pipeline state: {fields}")]
    State {
        /// Fields that differ, with what each was and is.
        fields: String,
    },
    /// A step does not apply any more.
    #[error("a step of preshade.lock no longer applies: {0}")]
    Refused(Box<Refusal>),
    /// The same recipe makes something else now.
    #[error("the recipe of preshade.lock makes other shaders than were measured")]
    Shaders,
    /// What it makes cannot be written.
    #[error(transparent)]
    Emit(#[from] emit::Error),
}

impl Mismatch {
    /// What kind of mismatch it is, as messages have it in brackets; stable.
    pub fn code(&self) -> &'static str {
        match self {
            Self::NoMaterial { .. } => "lock-material",
            Self::Tool { .. } => "lock-tool",
            Self::Files { .. } => "lock-files",
            Self::Source { .. } => "lock-source",
            Self::Defines { .. } => "lock-defines",
            Self::EntryPoints => "lock-entry-points",
            Self::State { .. } => "lock-state",
            Self::Refused(_) => "lock-step",
            Self::Shaders => "lock-shaders",
            Self::Emit(error) => error.code(),
        }
    }
}
