//! What ends a build.

use std::fmt;
use std::io;
use std::path::PathBuf;

use crate::emit;
use crate::front;
use crate::lock::LockError;
use crate::recipe::RecipeError;

/// Why a material was not compiled. Its debug form is fit to read, since that is what a `main` that returns it prints.
#[derive(thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file cannot be read.
    #[error("{}: {error}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why not.
        #[source]
        error: io::Error,
    },
    /// The shader is not one that preshade can read.
    #[error("{}", .0.render(front::Color::Never))]
    Shader(front::Error),
    /// The module has no words for what the shader or the state needs.
    #[error("{file}: {why}")]
    Module {
        /// The shader.
        file: String,
        /// What there is no word for.
        why: String,
    },
    /// A pass cannot be read.
    #[error(transparent)]
    Recipe(#[from] RecipeError),
    /// The lock file cannot be read.
    #[error(transparent)]
    Lock(#[from] LockError),
    /// The pipeline state is not said, and the lock that has it cannot be read.
    #[error(
        "{0}; it has the pipeline state that the material is drawn with, and nothing else says it: say it by `.state(..)`, or run `preshade plan SCENE --one --lock` again"
    )]
    State(String),
    /// A plan cannot be written as WGSL.
    #[error(transparent)]
    Emit(#[from] emit::Error),
    /// A file cannot be written.
    #[error("{}: {error}", path.display())]
    Write {
        /// The file, or the folder that it should be in.
        path: PathBuf,
        /// Why not.
        #[source]
        error: io::Error,
    },
    /// A material's name must be able to begin a file's, and a variant's to be a module's.
    #[error(
        "`{0}` cannot be the name of a material (it begins a file's: no `/ \\ : * ? \" < > |`, no point at either end, no `.rs`) or of a variant (it is a module's: small letters, digits and `_`, no word of Rust's, and not `original`, `variant` or `wgpu`)"
    )]
    Name(String),
    /// Two variants of a material have one name.
    #[error("two variants are called `{0}`")]
    Twice(String),
    /// A build script compiles two materials to one module.
    #[error(
        "`{name}` is compiled twice, of {first} and of {second}, with other options or of other files: the module of one would take the other's place; give one of them another `name`"
    )]
    Taken {
        /// The material's name.
        name: String,
        /// Files of the one that came first.
        first: String,
        /// Files of the other.
        second: String,
    },
    /// Not run by cargo, and no folder is given.
    #[error("OUT_DIR is not set: call this from a build script, or give `out_dir`")]
    NoOutDir,
}

impl fmt::Debug for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{self}")
    }
}
