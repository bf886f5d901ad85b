//! Options of the readers.

use std::path::PathBuf;

use crate::limits::Limits;
use crate::memory::Memory;

/// Options of the shader readers.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Options {
    /// Vertex entry point. Required if there are several.
    pub vertex: Option<String>,
    /// Fragment entry point. Required if there are several.
    pub fragment: Option<String>,
    /// GLSL preprocessor definitions: name and value.
    pub defines: Vec<(String, String)>,
    /// Folders to search for GLSL's `#include`, after the including file's own.
    pub include: Vec<PathBuf>,
    /// Files in memory. `#include` and imports find them before those on disk, wherever `root` is.
    pub files: Memory,
    /// Folder that included files may not leave, and base of source names. `None` allows any file.
    pub root: Option<PathBuf>,
    /// The clip space of GLSL positions. `None`: OpenGL's, except for Vulkan's GLSL.
    pub clip_space: Option<ClipSpace>,
    pub limits: Limits,
}

impl Options {
    /// The text of a file in memory. `path` may include `root`.
    pub fn in_memory(&self, path: &std::path::Path) -> Option<&str> {
        let below = |root| path.strip_prefix(root).ok();
        let path = self.root.as_deref().and_then(below).unwrap_or(path);
        self.files.text(path)
    }
}

/// The clip space that GLSL text is written for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum ClipSpace {
    /// Depth from 0 to 1, as in WebGPU and Vulkan. Positions do not change.
    #[serde(rename = "zero-to-one")]
    AsWritten,
    /// Depth from -1 to 1, as in OpenGL. The vertex stage ends by setting `gl_Position.z` to `(z +
    /// w) / 2`.
    #[serde(rename = "minus-one-to-one")]
    OpenGl,
}
