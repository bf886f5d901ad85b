//! `agree --scene`: both programs drawn in a scene.

use std::fs;
use std::path::{Path, PathBuf};

use crate::hostile_support::{run, stderr};

const SCENE: &str = r#"
size = [64, 64]
light = { direction = [0.2, 0.3, 1.0], map = 96 }
[materials.leaf]
shader = "leaf.wgsl"
state = { primitive = { cull = "none" } }
values = { "material.tint" = [1, 1, 1, 0.9], "material.uv_scale" = [2, 2], "material.opacity" = 1, "camera.time" = 0.7 }
textures.leaf = { pattern = "leaf", size = 32, scale = 5 }
[meshes]
card.plane = { size = [2, 2] }
[[draws]]
mesh = "card"
material = "leaf"
rotate = [90, 0, 0]
[[cameras]]
name = "front"
eye = [0, 0, 3]
target = [0, 0, 0]
"#;

/// A folder with the leaf, a shadow pass of another hand, and a scene.
fn folder(name: &str, shadow: impl Fn(&str) -> String) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    fs::copy("../fixtures/agree/leaf.wgsl", folder.join("leaf.wgsl")).unwrap();
    let text = fs::read_to_string("../fixtures/agree/leaf.shadow.wgsl").unwrap();
    fs::write(folder.join("shadow.wgsl"), shadow(&text)).unwrap();
    fs::write(folder.join("scene.toml"), SCENE).unwrap();
    folder
}

/// What the light sees: depths of either, of the first alone, of the second alone.
fn counts(folder: &Path, seconds: &str) -> (serde_json::Value, [u64; 3]) {
    let output = run(
        folder,
        &[
            "agree",
            "leaf.wgsl",
            "--with",
            "shadow.wgsl",
            "--as",
            "shadow",
            "--scene",
            "scene.toml",
            "--out",
            "pictures",
            "--seconds",
            seconds,
            "--format",
            "json",
        ],
    );
    let report: serde_json::Value = serde_json::from_slice(&output.stdout)
        .unwrap_or_else(|e| panic!("{e}: {}", stderr(&output)));
    let drawn = report["pairs"][0]["drawn"][0].clone();
    assert_eq!(drawn["camera"], "light");
    let count = |name: &str| drawn[name].as_u64().unwrap();
    let counts = [count("covered"), count("lost"), count("kept")];
    (drawn, counts)
}

#[test]
fn a_shadow_that_agrees_draws_what_the_main_pass_draws() {
    let folder = folder("agree-scene-same", str::to_owned);
    let (drawn, [covered, lost, kept]) = counts(&folder, "0.01");
    assert!(covered > 500, "{covered}");
    assert_eq!([lost, kept], [0, 0]);
    assert!(drawn["times"]["speedup"]["median"].as_f64().unwrap() > 0.0);
    for name in ["light.first.png", "light.difference.png"] {
        assert!(folder.join("pictures").join(name).is_file(), "{name}");
    }
}

#[test]
fn a_shadow_that_drifts_draws_elsewhere() {
    let folder = folder("agree-scene-drift", |shadow| {
        shadow.replace("uv * material.uv_scale", "uv")
    });
    let (drawn, [_, lost, kept]) = counts(&folder, "0");
    assert!(lost > 50 && kept > 50, "{lost}, {kept}");
    assert!(drawn["times"].is_null());
}

#[test]
fn a_scene_without_the_first_program_is_one_error() {
    let folder = folder("agree-scene-other", str::to_owned);
    let other = SCENE.replace(
        "[meshes]",
        "[materials.leaf2]\nshader = \"leaf.wgsl\"\n[meshes]",
    );
    fs::write(folder.join("scene.toml"), other).unwrap();
    fs::copy(folder.join("leaf.wgsl"), folder.join("copy.wgsl")).unwrap();
    let output = run(
        &folder,
        &[
            "agree",
            "copy.wgsl",
            "--with",
            "shadow.wgsl",
            "--as",
            "shadow",
            "--scene",
            "scene.toml",
        ],
    );
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(
        said.contains("has copy.wgsl as its shader: leaf, leaf2"),
        "{said}"
    );
}

/// What the scene counts is a finding, and decides the status.
#[test]
fn what_is_drawn_otherwise_is_a_finding() {
    let folder = Path::new("../fixtures/cases/adv");
    let output = run(
        folder,
        &[
            "agree",
            "agree-forced-early.wgsl",
            "--with",
            "agree-forced-early-b.wgsl",
            "--as",
            "same",
            "--scene",
            "agree-forced-early.toml",
            "--seconds",
            "0",
            "--fail-on",
            "drawn",
        ],
    );
    let said = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("error[drawn]: seen by"), "{said}");
    assert!(
        said.contains("note[depth]: the second tests the depth"),
        "{said}"
    );
}
