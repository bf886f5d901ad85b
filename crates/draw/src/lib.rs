//! Scenes as data, and the renderer that executes plans on wgpu.

pub mod render;
pub mod scene;
