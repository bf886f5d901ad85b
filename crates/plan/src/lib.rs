//! The data that every pass reads and writes: programs, plans, states, contracts and parameters.
//! Nothing here depends on a transform.

pub mod budget;
pub mod channels;
pub mod codes;
pub mod contract;
pub mod draw_table;
pub mod features;
pub mod frame;
pub mod geometry;
pub mod guard;
pub mod limits;
pub mod mapping;
mod original_plan;
pub mod overrides;
pub mod pass;
pub mod pattern;
pub mod plan;
pub mod plan_file;
pub mod program;
pub mod rasterizer;
pub mod reflect;
pub mod refusals;
pub mod safety;
pub mod self_test;
mod shared_binding;
pub mod state;
pub mod uniforms;
