//! Reads glTF files: meshes, materials, cameras, lights.

pub(super) mod accessors;
pub(super) mod built_in;
pub(super) mod cameras_and_lights;
pub(super) mod file;
pub(super) mod mapping;
pub(super) mod material;
pub mod mesh;
pub(super) mod primitive;
pub(super) mod requirements;
