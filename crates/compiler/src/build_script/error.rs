//! Errors that fail a build.

use std::path::PathBuf;
use std::{fmt, io};

use crate::emit;
use crate::lock::LockError;
use crate::recipe::RecipeError;

/// A material was not compiled. The debug form is readable, since a `main` that returns the error
/// prints it.
#[derive(thiserror::Error)]
#[non_exhaustive]
pub enum BuildError {
    /// A file cannot be read.
    #[error("{}: {error}", path.display())]
    Read {
        path: PathBuf,
        #[source]
        error: io::Error,
    },
    /// The shader cannot be parsed.
    #[error("{}", .0.render(shader_text::error::Color::Never))]
    Shader(shader_text::error::Error),
    /// The generated module cannot express something that the shader or the state needs.
    #[error("{file}: {why}")]
    Module {
        file: String,
        /// The feature that cannot be expressed.
        why: String,
    },
    /// A recipe cannot be parsed.
    #[error(transparent)]
    Recipe(#[from] RecipeError),
    /// The lock file cannot be read.
    #[error(transparent)]
    Lock(#[from] LockError),
    /// The pipeline state is not given, and the lock that has it cannot be read.
    #[error(
        "{0}; it has the pipeline state that the material is drawn with, and nothing else says it: \
         say it by `.state(..)`, or run `preshade plan SCENE --one --lock` again"
    )]
    State(String),
    /// A plan cannot be emitted as WGSL.
    #[error(transparent)]
    Emit(#[from] emit::EmitError),
    /// A file cannot be written.
    #[error("{}: {error}", path.display())]
    Write {
        /// The file or its folder.
        path: PathBuf,
        #[source]
        error: io::Error,
    },
    /// A material's name must be valid in a file name, and a variant's name must be a valid module
    /// name.
    #[error(
        "`{0}` cannot be the name of a material (it begins a file's: no `/ \\ : * ? \" < > |`, no \
         point at either end, no `.rs`) or of a variant (it is a module's: small letters, digits \
         and `_`, no word of Rust's, and not `original`, `variant` or `wgpu`)"
    )]
    Name(String),
    /// Two variants of a material have the same name.
    #[error("two variants are called `{0}`")]
    Twice(String),
    /// A build script compiles two materials to the same module.
    #[error(
        "`{name}` is compiled twice, of {first} and of {second}, with other options or of other \
         files: the module of one would take the other's place; give one of them another `name`"
    )]
    Taken {
        name: String,
        /// Files of the first material.
        first: String,
        /// Files of the second material.
        second: String,
    },
    /// Cargo does not run the build, and no folder is given.
    #[error("OUT_DIR is not set: call this from a build script, or give `out_dir`")]
    NoOutDir,
}

impl fmt::Debug for BuildError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{self}")
    }
}
