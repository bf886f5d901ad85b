//! Tests of the passes, without an adapter.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    clippy::too_many_lines,
    missing_docs
)]

mod common;
mod metamorphic_support;
mod uniformity_cases;

mod agree;
mod agree_claims;
mod agree_planted;
mod agree_products;
mod agree_ties;
mod bound;
mod bounded;
mod budgets;
mod contraction;
mod effects;
mod evaluation;
mod evaluation_bounds;
mod finite;
mod fixtures;
mod graph;
mod half_rate;
mod hoist;
mod hoist_interpolated;
mod implicit_inputs;
mod loop_guards;
mod metamorphic;
mod outputs;
mod outputs_drop;
mod outputs_light;
mod outputs_params;
mod preamble;
mod skip_taps;
mod slices;
mod specialize;
mod specialize_random;
mod tessellate;
mod trim_loop;
mod uniformity;
mod validate;
mod validate_resolve;
