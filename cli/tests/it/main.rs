//! Tests of the command line.

#![allow(clippy::unwrap_used, clippy::panic, missing_docs)]

mod hostile_support;

mod cli;
mod hostile;
mod kept;
mod many;
mod page;
mod plan;
mod readme;
mod same_bytes;
mod three;
