//! What the commands answer that need no GPU: data in; records and text out. The command line and the
//! npm package in `hosts/web` print the same answers, so what both need is here. Nothing in this folder
//! reads a flag or a file.

pub mod agree;
pub mod agree_text;
pub mod explain;
pub mod explain_text;
pub mod material;
pub mod passes;
pub mod refusal;
pub mod rewrite;
