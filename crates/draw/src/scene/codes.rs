//! The error codes of scenes.

use shader_text::refusals::refusals;

refusals! {
    SCENE = "scene":
        "A scene file, or a file that it names, cannot be used. The message shows the place and \
         the known names.",
        "docs/reference/scenes.md lists all keys.";
    GLTF_EXTENSION = "gltf-extension":
        "A glTF file requires an extension that preshade does not read. Without it, the file would \
         be drawn wrongly, or not at all.",
        "Export the file without it. docs/reference/gltf.md lists the extensions that are read.";
}
