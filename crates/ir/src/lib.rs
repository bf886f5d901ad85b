//! Edits of naga IR: the one writer and the one copier of functions, linking of two modules, the author's declarations
//! that the IR lacks, and repairs of modules that readers produce.

pub mod beyond_wgsl;
pub mod binding_arrays;
pub mod copy;
pub mod declared;
pub mod fall_through;
pub mod global_parameters;
pub mod inline_main;
pub mod interface;
pub mod killed_loops;
pub mod lengths;
pub mod link;
pub mod map_spans;
pub mod missing_returns;
pub mod returns;
pub mod variable;
pub mod wrapped_main;
pub mod writer;
