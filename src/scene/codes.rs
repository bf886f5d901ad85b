//! The error codes of scenes.

use preshade_passes::core::refusals::refusals;

refusals! {
    SCENE = "scene":
        "A scene file, or a file that it names, cannot be used. The message shows the place and \
         the known names.",
        "docs/reference/scenes.md lists all keys.";
}
