//! The dataflow graph of a shader, and backward slices over it.
//!
//! - [`graph`]: dependence, rate, effect and cost of every statement and expression;
//! - [`mod@slice`]: the statements that affect a value, an output or an effect.

pub mod graph;
pub mod slice;
