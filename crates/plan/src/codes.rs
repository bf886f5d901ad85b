//! The error codes of plans.

use shader_text::refusals::refusals;

refusals! {
    BROKEN_PLAN = "broken-plan":
        "The plan names a program, an entry point or an attachment that it does not contain.",
        "If preshade made the plan, this is a bug: please report the shader.";
}
