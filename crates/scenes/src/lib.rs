//! Makes scenes for the renderer from scene files, glTF files, bare shaders, and frames captured
//! from a page or an app.

pub mod asset;
mod camera;
pub mod capture;
mod file;
pub mod image;
pub mod mesh;
mod shader;
pub mod stand_in;
mod variant;

pub use asset::mesh::Gltf;
pub use file::gltf::{Shading, load_gltf};
pub use file::load::{load, load_with, load_within, read};
pub use file::place::{Access, Outside};
pub use file::variables::{Variable, Variables};
pub use shader::flow::StageFlow;
pub use shader::synthesise::synthesise;
pub use stand_in::{StandIn, stand_in};
pub use variant::{ShaderForm, from_files, self_test, variant};
