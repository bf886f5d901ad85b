//! Errors of a lock that cannot be read, or that does not match the shader.

use std::io;
use std::path::PathBuf;

use preshade_plan::pass::Refusal;

use super::{TOOL, codes};
use crate::emit;

/// A lock file that cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LockError {
    /// The file cannot be opened or read.
    #[error("{}: {error}", path.display())]
    Io {
        path: PathBuf,
        #[source]
        error: io::Error,
    },
    /// It is not a lock file, or has unknown keys.
    #[error("{}: not a lock file that {TOOL} can read: {message}", path.display())]
    Syntax {
        /// The file. Empty if a text was read.
        path: PathBuf,
        /// The place and the reason.
        message: String,
    },
    /// Another version of preshade wrote it, with unknown keys or an unknown schema.
    #[error("{}: written by another preshade ({by}), and this is {TOOL}: {message}", path.display())]
    Foreign {
        /// The file. Empty if a text was read.
        path: PathBuf,
        /// Its schema or its writer.
        by: String,
        message: String,
    },
}

impl LockError {
    /// The kind of error, as messages print it in brackets. Stable.
    pub fn code(&self) -> &'static str {
        match self {
            Self::Io { .. } => codes::FILE.code,
            Self::Syntax { .. } => codes::SYNTAX.code,
            Self::Foreign { .. } => codes::FOREIGN.code,
        }
    }
}

/// A lock does not match the shader as it is now.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Mismatch {
    /// The lock has no entry for the material.
    #[error("preshade.lock says nothing of `{material}`")]
    NoMaterial { material: String },
    /// Another version of preshade chose.
    #[error("preshade.lock was written by {locked}, and this is {TOOL}")]
    Tool {
        /// The version of preshade that wrote it.
        locked: String,
    },
    /// The material has other files.
    #[error("preshade.lock was written for {locked}, not for {now}")]
    Files {
        /// Names of the files when it was locked.
        locked: String,
        /// Names of the files now.
        now: String,
    },
    /// The file was edited since.
    #[error("{file} was edited after preshade.lock was written")]
    Source { file: String },
    /// A definition was added, removed or changed.
    #[error("preshade.lock was written with other definitions ({names})")]
    Defines {
        /// Definitions that differ.
        names: String,
    },
    #[error("preshade.lock was written for other entry points")]
    EntryPoints,
    /// The material has another pipeline state.
    #[error("preshade.lock was written for another pipeline state: {fields}")]
    State {
        /// Fields that differ, with their old and new values.
        fields: String,
    },
    /// A step does not apply any more.
    #[error("a step of preshade.lock no longer applies: {0}")]
    Refused(Box<Refusal>),
    /// The same recipe makes other shaders now.
    #[error("the recipe of preshade.lock makes other shaders than were measured")]
    Shaders,
    /// The result cannot be emitted.
    #[error(transparent)]
    Emit(#[from] emit::EmitError),
}

impl Mismatch {
    /// The kind of mismatch, as messages print it in brackets. Stable.
    pub fn code(&self) -> &'static str {
        match self {
            Self::NoMaterial { .. } => codes::MATERIAL.code,
            Self::Tool { .. } => codes::TOOL.code,
            Self::Files { .. } => codes::FILES.code,
            Self::Source { .. } => codes::SOURCE.code,
            Self::Defines { .. } => codes::DEFINES.code,
            Self::EntryPoints => codes::ENTRY_POINTS.code,
            Self::State { .. } => codes::STATE.code,
            Self::Refused(_) => codes::STEP.code,
            Self::Shaders => codes::SHADERS.code,
            Self::Emit(error) => error.code(),
        }
    }
}
