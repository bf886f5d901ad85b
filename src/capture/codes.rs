//! The error codes of captured frames.

use preshade_passes::core::refusals::refusals;

refusals! {
    CAPTURE = "capture":
        "A frame folder, or a file in it, cannot be read or replayed. The message shows the place.",
        "docs/reference/frames.md describes the folder. Capture the frame again.";
}
