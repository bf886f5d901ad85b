//! The passes: one file or folder each. No transform imports another.

pub mod depth_prepass;
pub mod early_discard;
pub mod hoist;
pub mod shadow;
pub mod skip_taps;
pub mod specialize;
pub mod tessellate;
pub mod trim_loop;
pub mod visibility_buffer;
