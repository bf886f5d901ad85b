//! A tree of shaders in a folder of its own.
#![allow(dead_code)] // Each test binary uses its own part.

use std::fs;
use std::path::{Path, PathBuf};

pub fn fixture(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../fixtures")
        .join(path)
}

/// A tree of shaders: `lit.wgsl`, and below `sub` another and a GLSL pair.
pub fn tree(name: &str) -> PathBuf {
    let tree = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&tree);
    fs::create_dir_all(tree.join("shaders/sub")).unwrap();
    for (from, to) in [
        ("shaders/toon.wgsl", "lit.wgsl"),
        ("shaders/grid.wgsl", "sub/grid.wgsl"),
        ("glsl/phong.vert", "sub/phong.vert"),
        ("glsl/phong.frag", "sub/phong.frag"),
    ] {
        fs::copy(fixture(from), tree.join("shaders").join(to)).unwrap();
    }
    tree
}
