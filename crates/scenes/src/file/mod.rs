//! Reads scene files: TOML, and glTF files as they are.

pub(crate) mod entries;
pub(crate) mod gltf;
mod import;
mod light;
pub(crate) mod load;
mod loader;
mod meshes;
pub(crate) mod place;
mod plausible_numbers;
mod range;
mod size;
mod text;
pub(crate) mod variables;
