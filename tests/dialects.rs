//! WGSL with imports and conditions, naga_oil's and WESL, comes to the programs that it says.
#![cfg(all(feature = "naga-oil", feature = "wesl"))]
#![allow(clippy::unwrap_used, clippy::panic, missing_docs)]

use std::path::{Path, PathBuf};

use preshade::emit::{self, Target};
use preshade::front::{self, Options, Source};
use preshade_passes::plan::Plan;
use preshade_passes::state::MaterialState;

fn source(path: &Path) -> Source {
    let text = std::fs::read_to_string(path).unwrap();
    Source::new(path.display().to_string(), text)
}

/// The WGSL that files come to, read back as it is emitted.
fn wgsl(files: &[PathBuf], options: &Options) -> Result<String, front::Error> {
    let sources: Vec<Source> = files.iter().map(|f| source(f)).collect();
    let parsed = front::parse(&sources, options)?;
    let fragment = parsed.fragment.as_deref();
    // A program that no transform has touched ships as its text.
    let program = parsed.program.with_module(parsed.program.module().clone());
    let state = MaterialState::default();
    let plan = Plan::original("m", program.unwrap(), &parsed.vertex, fragment, &state);
    let files = emit::emit(&plan, &[Target::Wgsl], &emit::Options::default());
    let files = files.unwrap_or_else(|e| panic!("{e}"));
    Ok(String::from_utf8(files[0].bytes.clone()).unwrap())
}

fn ours(path: &str) -> Vec<PathBuf> {
    vec![
        Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("tests/dialects")
            .join(path),
    ]
}

fn defined(all: &[(&str, &str)]) -> Options {
    let defines = all.iter().map(|(n, v)| ((*n).to_owned(), (*v).to_owned()));
    Options {
        defines: defines.collect(),
        ..Options::default()
    }
}

#[test]
fn naga_oils_imports_and_conditions_are_obeyed() {
    let files = ours("oil/material.wgsl");
    let bright = wgsl(&files, &defined(&[("GROUP", "2")])).unwrap();
    assert!(
        bright.contains("@group(2) @binding(0) var<uniform> light"),
        "{bright}"
    );
    assert!(bright.contains("fn lambert("), "{bright}");
    assert!(!bright.contains("0.5"), "{bright}");
    let dim = wgsl(&files, &defined(&[("GROUP", "2"), ("DIM", "true")])).unwrap();
    assert!(dim.contains("0.5"), "{dim}");
    assert!(!dim.contains("naga_oil"), "{dim}");
}

#[test]
fn wesls_imports_and_conditions_are_obeyed() {
    let files = ours("wesl/src/material.wesl");
    let bright = wgsl(&files, &Options::default()).unwrap();
    assert!(
        bright.contains("@group(1) @binding(0) var<uniform> light"),
        "{bright}"
    );
    assert!(!bright.contains("0.5"), "{bright}");
    let dim = wgsl(&files, &defined(&[("DIM", "true")])).unwrap();
    assert!(dim.contains("0.5"), "{dim}");
}

#[test]
fn what_is_missing_is_named() {
    let error = wgsl(&ours("oil/material.wgsl"), &Options::default()).unwrap_err();
    let said = error.render(front::Color::Never);
    assert!(said.contains("GROUP"), "{said}");
    let error = wgsl(&ours("oil/material.wgsl"), &defined(&[("GROUP", "x")])).unwrap_err();
    assert!(
        error.message().contains("`GROUP` is defined as `x`"),
        "{}",
        error.message()
    );
}

/// Bevy's own material: `PRESHADE_BEVY` names a folder with the packages `bevy_pbr`, `bevy_render` and `bevy_core_pipeline` (and `bevy_light`, `bevy_image` and others that those
/// import) as `cargo` unpacks them. They are not ours to keep here.
#[test]
#[ignore = "needs Bevy's packages: PRESHADE_BEVY"]
fn bevys_material_is_read() {
    let folder = PathBuf::from(std::env::var_os("PRESHADE_BEVY").expect("PRESHADE_BEVY"));
    let below = |ending: &str| {
        let entries = std::fs::read_dir(&folder).unwrap();
        let mut all = entries.map(|e| e.unwrap().path().join("src/render"));
        all.find(|p| {
            p.to_string_lossy().contains("bevy_pbr-") && p.join(format!("pbr.{ending}")).is_file()
        })
    };
    let mut options = defined(&[
        ("MATERIAL_BIND_GROUP", "3"),
        ("MAX_CASCADES_PER_LIGHT", "4"),
        ("MAX_DIRECTIONAL_LIGHTS", "10"),
        ("MAX_RECT_LIGHTS", "16"),
        ("AVAILABLE_STORAGE_BUFFER_BINDINGS", "8"),
        ("VERTEX_POSITIONS", "true"),
        ("VERTEX_NORMALS", "true"),
        ("VERTEX_UVS_A", "true"),
        ("VERTEX_UVS", "true"),
        ("VERTEX_OUTPUT_INSTANCE_INDEX", "true"),
        ("TONEMAPPING_LUT_TEXTURE_BINDING_INDEX", "20"),
        ("TONEMAPPING_LUT_SAMPLER_BINDING_INDEX", "21"),
    ]);
    options.include = vec![folder.clone()];
    for ending in ["wgsl", "wesl"] {
        let render = below(ending).unwrap_or_else(|| panic!("no bevy_pbr with pbr.{ending}"));
        let files = ["mesh", "pbr"].map(|n| render.join(format!("{n}.{ending}")));
        match wgsl(&files, &options) {
            Ok(text) => println!("{ending}: {} lines of WGSL", text.lines().count()),
            Err(e) => panic!("{ending}: {}", e.render(front::Color::Never)),
        }
    }
}
