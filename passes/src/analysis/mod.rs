//! Questions that any pass may ask about a program. An analysis reads the graph and changes nothing.

pub mod checks;
pub mod contraction;
pub mod coverage;
pub mod cut;
pub(crate) mod effects;
pub mod hazard;
pub mod implicit_inputs;
pub mod loops;
pub mod named;
pub mod neighbours;
pub mod opaque;
pub(crate) mod operations;
pub(crate) mod range;
pub mod reach;
pub mod refusals;
pub mod rounding;
pub(crate) mod simplify;
pub mod subnormal;
pub mod transitive_cost;
pub mod uniformity;
pub(crate) mod users;
pub mod values;
pub mod view;
pub mod zero;
