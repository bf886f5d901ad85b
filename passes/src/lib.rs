//! The GPU-free heart of preshade: the dataflow graph over naga IR, the backward slicer, and one
//! file for each transform.
//!
//! The folders depend on each other in this order, and never backwards:
//!
//! 1. [`core`]: a validated naga module with the author's source beside it, and the plan a host
//!    executes;
//! 2. [`graph`]: the dataflow graph (dependence, rate, effect, cost);
//! 3. [`mod@slice`]: the statements that decide a value, an output or an effect;
//! 4. [`analysis`]: questions that any pass may ask (ranges, discontinuities, uniformity,
//!    legality);
//! 5. [`rebuild`]: new programs out of slices;
//! 6. [`transforms`]: the passes, each a [`pass::Pass`] from [`plan::Plan`] to [`plan::Plan`];
//! 7. [`validate`]: a variant compared with its original without a GPU. It and some analyses use
//!    [`evaluate`], an interpreter of naga IR.
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

pub use naga;

pub use transforms::{PASSES, examples, refusals};

pub fn pass_named(name: &str) -> Option<&'static dyn preshade_plan::pass::AnyPass> {
    PASSES.iter().copied().find(|p| p.info().name == name)
}
