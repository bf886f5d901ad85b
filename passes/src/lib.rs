//! The dataflow graph over naga IR, the backward slicer, and one file or folder for each transform.
//!
//! The folders depend on each other in this order, and never backwards:
//!
//! 1. [`graph`]: the dataflow graph (dependence, rate, effect, cost);
//! 2. [`mod@slice`]: the statements that decide a value, an output or an effect;
//! 3. [`analysis`]: questions that any pass may ask (ranges, discontinuities, uniformity,
//!    legality);
//! 4. [`rebuild`]: new programs out of slices;
//! 5. [`transforms`]: the passes, each a [`Pass`](preshade_plan::pass::Pass) from plan to plan.
//!
//! Nothing in here reads a file, touches a GPU or asks the time.

pub mod analysis;
pub mod graph;
pub mod rebuild;
pub mod slice;
pub mod transforms;

pub use analysis::{checks, coverage, neighbours, opaque, uniformity};
pub use rebuild::{bounded, count, depth_only, place};
pub use transforms::{
    depth_prepass, early_discard, half_rate, hoist, outputs, preamble, shadow, skip_taps,
    specialize, tessellate, trim_loop, visibility_buffer,
};

pub use transforms::{PASSES, examples, refusals};

pub fn pass_named(name: &str) -> Option<&'static dyn preshade_plan::pass::AnyPass> {
    PASSES.iter().copied().find(|p| p.info().name == name)
}
