//! Questions that any pass may ask about a program. An analysis reads the graph and changes nothing.

pub mod authored;
pub mod contraction;
pub mod coverage;
pub(crate) mod discontinuity;
pub(crate) mod effects;
pub mod hazard;
pub(crate) mod implicit_inputs;
pub mod lit;
pub(crate) mod near_plane;
pub mod neighbours;
pub mod opaque;
pub(crate) mod operations;
pub(crate) mod range;
pub(crate) mod reach;
pub mod refusals;
pub(crate) mod rounding;
pub(crate) mod simplify;
pub mod uniformity;
pub(crate) mod unwritten;
pub(crate) mod users;
pub mod values;
pub mod view;
pub mod viewer;
pub mod world;
