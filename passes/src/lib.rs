//! One file or folder for each transform, and the code that transforms share.
//!
//! The folders depend on each other in this order, and never backwards:
//!
//! 1. [`analysis`]: questions that any pass may ask (ranges, discontinuities, uniformity,
//!    legality);
//! 2. [`rebuild`]: new programs out of slices;
//! 3. [`transforms`]: the passes, each a [`Pass`](preshade_plan::pass::Pass) from plan to plan.
//!
//! Nothing in here reads a file, touches a GPU or reads the clock.

pub mod analysis;
pub mod rebuild;
pub mod transforms;
