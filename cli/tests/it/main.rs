//! Tests of the command line that need no adapter.

#![allow(clippy::unwrap_used, clippy::panic, missing_docs)]

#[path = "../support/hostile_support.rs"]
mod hostile_support;
#[path = "../support/trees.rs"]
mod trees;

mod agree;
mod cli;
mod edges;
mod hostile;
mod many;
mod newcomer;
mod release;
mod same_bytes;
mod wrong_inputs;
