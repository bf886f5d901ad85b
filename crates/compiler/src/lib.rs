//! Shaders in, variants out: readers of WGSL and its dialects, recipes, the one pipeline that applies them, emission with its
//! checks, locks and build scripts.

pub mod build_script;
pub mod command;
pub mod emit;
pub mod front;
pub mod lock;
pub mod parameters;
pub mod pipeline;
pub mod recipe;
pub mod sweep;
pub mod wgsl;
