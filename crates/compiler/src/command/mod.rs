//! The commands that need no GPU, as functions: data in; records and text out. The command line and
//! the npm package in `hosts/web` print the same answers, so the shared code is here. Nothing in
//! this folder reads a flag or a file.

pub mod agree;
pub mod agree_text;
pub mod explain;
pub mod explain_text;
pub mod material;
pub mod passes;
pub mod refusal;
pub mod rewrite;
