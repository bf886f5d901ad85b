//! Converts the modules of GLSL and SPIR-V to the form of hand-written WGSL.

use naga::Module;
use naga::valid::{Capabilities, ValidationFlags, Validator};

use super::{fall_through, global_parameters, inline_main, missing_returns};

/// Inlines `main` into its caller, and removes constructs that WGSL lacks.
pub fn inline(module: &mut Module) {
    fall_through::remove(module);
    // Leave an invalid module unchanged for the validator's message.
    if is_valid(module) {
        global_parameters::pass_globals(module);
        inline_main::inline_main(module);
        missing_returns::add(module);
    }
}

/// Whether naga's validator accepts a module.
pub(super) fn is_valid(module: &Module) -> bool {
    Validator::new(ValidationFlags::all(), Capabilities::all())
        .validate(module)
        .is_ok()
}
