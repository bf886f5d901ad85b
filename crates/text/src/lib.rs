//! Shared by all shader readers: sources and their locations, options, errors that point at the
//! author's text, and limits on untrusted input.

pub mod codes;
pub mod error;
pub mod excerpt;
pub mod files;
pub mod limits;
pub mod memory;
pub mod nearest;
pub mod nesting;
pub mod options;
pub mod panics;
pub mod read_limited;
pub mod refusals;
pub mod source;
pub mod tokens;
pub mod unsupported;
