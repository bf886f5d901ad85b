//! Frames of pages and apps, as `docs/reference/frames.md` describes them: the format of their folders, and recorders.
//!
//! 1. [`mod@file`] holds the data of `frame.json`;
//! 2. [`folder`] reads it with the files that it names, and checks sizes;
//! 3. [`pass`] finds the render passes and their draws;
//! 4. [`contents`] computes the contents of buffers and textures at a command, as far as the queue alone decides.
#![warn(missing_docs)]

#[cfg(feature = "record")]
pub mod browser;
pub mod codes;
pub mod contents;
pub mod error;
pub mod file;
pub mod folder;
pub mod page;
pub mod pass;
pub mod ranges;
#[cfg(feature = "record")]
pub mod trace;
#[cfg(feature = "record")]
pub mod writer;

/// The example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
