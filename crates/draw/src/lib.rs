//! Scenes, their assets, captured frames, and the renderer that executes plans on wgpu.

pub mod capture;
pub mod render;
pub mod scene;
