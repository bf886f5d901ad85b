//! The passes: one file or folder each. No transform imports another.

pub mod depth_prepass;
pub mod early_alpha;
pub mod early_discard;
pub mod half_rate;
pub mod hoist;
pub mod outputs;
pub mod preamble;
pub mod shadow;
pub mod skip_taps;
pub mod specialize;
pub mod tessellate;
pub mod trim_loop;
pub mod visibility_buffer;

use crate::analysis;
use preshade_plan as core;
use preshade_plan::pass::{AnyPass, Erased, Use};
use shader_text::refusals::RefusalInfo;

/// Every pass, in the order in which `explain` lists them.
pub const PASSES: &[&dyn AnyPass] = &[
    &Erased::<specialize::Specialize>::NEW,
    &Erased::<depth_prepass::DepthPrepass>::NEW,
    &Erased::<early_alpha::EarlyAlpha>::NEW,
    &Erased::<early_discard::EarlyDiscard>::NEW,
    &Erased::<shadow::Shadow>::NEW,
    &Erased::<outputs::Outputs>::NEW,
    &Erased::<hoist::Hoist>::NEW,
    &Erased::<preamble::Preamble>::NEW,
    &Erased::<tessellate::Tessellate>::NEW,
    &Erased::<skip_taps::SkipTaps>::NEW,
    &Erased::<trim_loop::TrimLoop>::NEW,
    &Erased::<half_rate::HalfRate>::NEW,
    &Erased::<visibility_buffer::VisibilityBuffer>::NEW,
];

/// Every refusal of a pass, of a shared analysis or of a recipe.
pub fn refusals() -> impl Iterator<Item = &'static RefusalInfo> {
    let shared = [core::refusals::REFUSALS, analysis::refusals::REFUSALS];
    let own = PASSES.iter().map(|pass| pass.refusals());
    shared.into_iter().chain(own).flatten()
}

/// The recipes of all passes that have a use, each with the use.
pub fn examples() -> impl Iterator<Item = (&'static str, &'static Use)> {
    let all = PASSES.iter().flat_map(|pass| pass.examples());
    all.flat_map(|example| example.uses.iter().map(|of| (example.recipe, of)))
}
