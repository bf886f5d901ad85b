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
pub mod trim_loop;

use preshade_plan::pass::{AnyPass, Erased};

/// Every pass of this crate, in the order in which `explain` lists them.
pub const PASSES: &[&dyn AnyPass] = &[
    &Erased::<specialize::Specialize>::NEW,
    &Erased::<depth_prepass::DepthPrepass>::NEW,
    &Erased::<early_alpha::EarlyAlpha>::NEW,
    &Erased::<early_discard::EarlyDiscard>::NEW,
    &Erased::<shadow::Shadow>::NEW,
    &Erased::<outputs::Outputs>::NEW,
    &Erased::<hoist::Hoist>::NEW,
    &Erased::<preamble::Preamble>::NEW,
    &Erased::<skip_taps::SkipTaps>::NEW,
    &Erased::<trim_loop::TrimLoop>::NEW,
    &Erased::<half_rate::HalfRate>::NEW,
];
