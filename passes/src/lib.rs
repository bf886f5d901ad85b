//! The GPU-free heart of preshade: the dataflow graph over naga IR, the backward slicer, and one file
//! for each transform.
//!
//! Data flows through the modules in this order:
//!
//! 1. [`program`]: a validated naga module with the author's source beside it;
//! 2. [`graph`]: an analysis overlay on it (dependence, rate, effect, cost);
//! 3. [`mod@slice`]: what decides a value, an output or an effect;
//! 4. [`place`]: a slice rebuilt as an entry point of its own;
//! 5. [`mod@specialize`], [`depth_prepass`], [`early_discard`], [`hoist`], [`tessellate`], [`skip_taps`], [`trim_loop`], [`visibility_buffer`]: the transforms, each a [`pass::Pass`] from [`plan::Plan`] to [`plan::Plan`];
//! 6. [`frame`]: the plans of several materials merged into one frame.
//!
//! Nothing in here reads a file, touches a GPU or asks the time.

pub mod bound;
pub mod calls;
pub mod channels;
pub mod contract;
pub mod count;
pub mod coverage;
pub mod declared;
pub mod depth_only;
pub mod depth_prepass;
pub mod draw_table;
pub mod early_discard;
pub mod evaluate;
pub mod features;
mod fetch;
pub mod frame;
pub mod geometry;
pub mod graph;
pub mod guard;
pub mod hoist;
pub mod limits;
pub mod link;
mod near_plane;
pub mod neighbours;
pub mod opaque;
pub mod pass;
pub mod place;
pub mod plan;
pub mod program;
pub mod rasterizer;
pub mod reflect;
pub mod returns;
pub mod self_test;
pub mod shadow;
mod simplify;
pub mod skip_taps;
pub mod slice;
pub mod specialize;
pub mod state;
pub mod tessellate;
pub mod trim_loop;
pub mod uniformity;
pub mod validate;
pub mod visibility_buffer;

pub use naga;

/// Every pass, in the order `explain` tells of them.
pub const PASSES: &[&dyn pass::AnyPass] = &[
    &pass::Erased::<specialize::Specialize>::NEW,
    &pass::Erased::<depth_prepass::DepthPrepass>::NEW,
    &pass::Erased::<early_discard::EarlyDiscard>::NEW,
    &pass::Erased::<shadow::Shadow>::NEW,
    &pass::Erased::<hoist::Hoist>::NEW,
    &pass::Erased::<tessellate::Tessellate>::NEW,
    &pass::Erased::<skip_taps::SkipTaps>::NEW,
    &pass::Erased::<trim_loop::TrimLoop>::NEW,
    &pass::Erased::<visibility_buffer::VisibilityBuffer>::NEW,
];

/// The pass of that name.
pub fn pass_named(name: &str) -> Option<&'static dyn pass::AnyPass> {
    PASSES.iter().copied().find(|p| p.info().name == name)
}
