//! WGSL with imports and conditions, naga_oil's and WESL, comes to the programs that it says.
#![cfg(all(feature = "naga-oil", feature = "wesl"))]

use std::path::{Path, PathBuf};

use preshade_compiler::emit;
use preshade_compiler::front::{self, Source};
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::Target;
use preshade_plan::state::MaterialState;
use shader_text::memory::Memory;
use shader_text::options::Options;

fn source(path: &Path) -> Source {
    let text = std::fs::read_to_string(path).unwrap();
    Source::new(path.display().to_string(), text)
}

/// The WGSL that files come to, read back as it is emitted.
pub fn wgsl(files: &[PathBuf], options: &Options) -> Result<String, shader_text::error::Error> {
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

/// As Bevy 0.20 writes it: blocks of items and statements under a condition, constants that the host
/// defines, and packages that import each other's types.
#[test]
fn wesls_blocks_constants_and_packages_are_read() {
    let files = ours("packages/app/src/material.wesl");
    let read = |all| {
        let mut options = defined(all);
        options.include = ours("packages");
        wgsl(&files, &options)
    };
    let bound = read(&[("BOUND", "true"), ("GROUP", "2")]).unwrap();
    assert!(bound.contains("@group(2) @binding(0)"), "{bound}");
    assert!(bound.contains("0.125"), "{bound}");
    // Two packages import one struct.
    assert_eq!(bound.matches("struct ").count(), 1, "{bound}");
    let front = read(&[("FRONT", "true")]).unwrap();
    assert!(front.contains("@builtin(front_facing)"), "{front}");
    assert!(
        front.contains("0.25") && !front.contains("@binding"),
        "{front}"
    );
    let plain = read(&[("FRONT", "false")]).unwrap();
    assert!(
        plain.contains("0.5") && !plain.contains("front_facing"),
        "{plain}"
    );

    let error = read(&[("BOUND", "true")]).unwrap_err();
    assert!(error.message().contains("`GROUP`"), "{}", error.message());
    let error = wgsl(&files, &defined(&[("BOUND", "true"), ("GROUP", "2")])).unwrap_err();
    assert!(error.message().contains("`pa::mid`"), "{}", error.message());
}

#[test]
fn a_wrong_condition_is_shown_in_its_file() {
    let name = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/dialects/wesl/src/wrong.wesl");
    let source = Source::new(name.display().to_string(), "@if(A +) const a = 1;\n");
    let error = front::parse(&[source], &Options::default()).unwrap_err();
    let said = error.render(shader_text::error::Color::Never);
    assert!(said.contains("a condition consists of names"), "{said}");
    assert!(said.contains("@if(A +)"), "{said}");
}

#[test]
fn what_is_missing_is_named() {
    let error = wgsl(&ours("oil/material.wgsl"), &Options::default()).unwrap_err();
    let said = error.render(shader_text::error::Color::Never);
    assert!(said.contains("GROUP"), "{said}");
    let error = wgsl(&ours("oil/material.wgsl"), &defined(&[("GROUP", "x")])).unwrap_err();
    assert!(
        error.message().contains("`GROUP` is defined as `x`"),
        "{}",
        error.message()
    );
}

/// As Bevy has it: a file for meshes, with a fragment stage for want of a better one and imports of
/// other pipelines, and a file for the material.
#[test]
fn a_file_of_one_stage_goes_before_the_other_files_own() {
    let files = ["oil/mesh.wgsl", "oil/shade.wgsl"].map(|f| ours(f).remove(0));
    let mut reversed = files.clone();
    reversed.reverse();
    for files in [files, reversed] {
        let text = wgsl(&files, &defined(&[("GROUP", "2")])).unwrap();
        assert!(text.contains("fn lambert("), "{text}");
        assert_eq!(text.matches("@fragment").count(), 1, "{text}");
        assert!(!text.contains("previous"), "{text}");
    }
}

#[test]
fn wesls_own_errors_are_plain_text() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/dialects/wesl/src/broken.wesl");
    let source = Source::new(folder.display().to_string(), "fn (");
    let error = front::parse(&[source], &Options::default()).unwrap_err();
    assert!(error.message().contains("broken.wesl: error"), "{error}");
    assert!(
        !error
            .render(shader_text::error::Color::Never)
            .contains("[0m"),
        "{error}"
    );
}

#[test]
fn two_versions_of_a_module_are_told() {
    let error = wgsl(&ours("twice/material.wgsl"), &Options::default()).unwrap_err();
    let said = error.render(shader_text::error::Color::Never);
    assert!(said.contains("are both `own::shared`"), "{said}");
}

/// The same in WESL (0.20): `PRESHADE_BEVY` names a folder with the packages `bevy_pbr`, `bevy_render`
/// and those that they import, as `cargo` unpacks them. They are not ours to keep here, and cargo does
/// not fetch them for a compiler older than theirs.
#[test]
#[ignore = "needs Bevy's packages: PRESHADE_BEVY"]
fn bevys_material_in_wesl_is_read() {
    let folder = PathBuf::from(std::env::var_os("PRESHADE_BEVY").expect("PRESHADE_BEVY"));
    let entries = std::fs::read_dir(folder).unwrap();
    let mut packages: Vec<PathBuf> = entries.map(|e| e.unwrap().path()).collect();
    packages.retain(|p| p.to_string_lossy().contains("-0.20."));
    bevys_material(packages, "wesl");
}

/// What Bevy's pipeline defines for a mesh with normals, tangents and texture coordinates, on an adapter
/// with storage buffers and without arrays of bindings.
pub fn bevys_definitions() -> Options {
    let flags = [
        "MESH_PIPELINE",
        "VERTEX_OUTPUT_INSTANCE_INDEX",
        "VERTEX_POSITIONS",
        "VERTEX_NORMALS",
        "VERTEX_UVS",
        "VERTEX_UVS_A",
        "VERTEX_TANGENTS",
        "VIEW_PROJECTION_PERSPECTIVE",
        "SHADOW_FILTER_METHOD_GAUSSIAN",
        "STANDARD_MATERIAL_NORMAL_MAP",
        "TONEMAP_IN_SHADER",
        "TONEMAP_METHOD_ACES_FITTED",
        "DEBAND_DITHER",
    ];
    let numbers = [
        ("MATERIAL_BIND_GROUP", "3"),
        ("MAX_CASCADES_PER_LIGHT", "4"),
        ("MAX_DIRECTIONAL_LIGHTS", "10"),
        ("MAX_RECT_LIGHTS", "8"),
        ("AVAILABLE_STORAGE_BUFFER_BINDINGS", "8"),
        ("SCREEN_SPACE_SPECULAR_TRANSMISSION_BLUR_TAPS", "8"),
    ];
    let mut all = flags.map(|f| (f, "true")).to_vec();
    all.extend(numbers);
    defined(&all)
}

fn bevys_material(packages: Vec<PathBuf>, ending: &str) {
    let render = packages.iter().map(|p| p.join("src/render"));
    let render = render
        .clone()
        .find(|p| p.join(format!("pbr.{ending}")).is_file());
    let render = render.unwrap_or_else(|| panic!("no bevy_pbr in {packages:?}"));
    let mut options = bevys_definitions();
    options.include = packages;
    let files = ["mesh", "pbr"].map(|n| render.join(format!("{n}.{ending}")));
    let text = wgsl(&files, &options)
        .unwrap_or_else(|e| panic!("{}", e.render(shader_text::error::Color::Never)));
    println!("{} lines of WGSL", text.lines().count());
    assert!(text.contains("apply_pbr_lighting("), "{text}");
    assert_eq!(text.matches("@fragment").count(), 1, "{text}");
    // Each of the author's choices changes the program.
    options
        .defines
        .retain(|(name, _)| name != "TONEMAP_IN_SHADER");
    let without = wgsl(&files, &options).unwrap();
    assert!(!without.contains("tone_mapping("), "{without}");
    assert!(text.contains("tone_mapping("), "{text}");
}

/// The files below a folder of ours, by paths in a folder that is not on disk.
fn in_memory(folder: &str) -> Memory {
    let root = ours(folder).remove(0);
    let (mut folders, mut files) = (vec![root.clone()], Vec::new());
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let below = path.strip_prefix(&root).unwrap();
            let text = std::fs::read_to_string(&path).unwrap();
            files.push((Path::new("nowhere").join(below), text));
        }
    }
    files.into_iter().collect()
}

#[test]
fn imports_are_found_in_memory() {
    for (folder, file) in [("oil", "material.wgsl"), ("wesl", "src/material.wesl")] {
        let files = in_memory(folder);
        let name = format!("nowhere/{file}");
        let text = files.text(Path::new(&name)).unwrap().to_owned();
        let parse = |files: Memory| {
            let options = Options {
                files,
                ..defined(&[("GROUP", "2"), ("DIM", "true")])
            };
            front::parse(&[Source::new(&name, &text)], &options)
        };
        let parsed = parse(files)
            .unwrap_or_else(|e| panic!("{}", e.render(shader_text::error::Color::Never)));
        let read = parsed.program.sources().files();
        let texts: String = read.iter().map(|f| f.text.as_str()).collect();
        assert!(texts.contains("lambert"), "{texts}");
        assert_eq!(
            parse(Memory::default()).unwrap_err().code(),
            shader_text::error::Code::Parse
        );
    }
}

#[test]
fn includes_are_found_in_memory() {
    let vertex = "#version 300 es\nin vec3 p;\nvoid main() { gl_Position = vec4(p, 1.0); }\n";
    let fragment = "#version 300 es\nprecision highp float;\n#include \"../lib/tint.glsl\"\nout vec4 c;\n\
                    void main() { c = tint(); }\n";
    let sources = [
        Source::new("a/m.vert", vertex),
        Source::new("a/m.frag", fragment),
    ];
    let parse = |files: &[(&str, &str)], limits: &str| {
        let files = files.iter().map(|(name, text)| (*name, (*text).to_owned()));
        let options = Options {
            files: files.collect(),
            limits: shader_text::limits::Limits::parse(limits).unwrap(),
            ..Options::default()
        };
        front::parse(&sources, &options)
    };
    let tint = "#include \"red.glsl\"\nvec4 tint() { return RED; }\n";
    let red = "#define RED vec4(1.0, 0.0, 0.0, 1.0)\n";
    let both = [("lib/tint.glsl", tint), ("./lib/../lib/red.glsl", red)];
    let parsed = parse(&both, "")
        .unwrap_or_else(|e| panic!("{}", e.render(shader_text::error::Color::Never)));
    let names = parsed
        .program
        .sources()
        .files()
        .iter()
        .map(|f| f.name.clone());
    let names: Vec<String> = names.collect();
    assert!(
        names.contains(&"a/../lib/tint.glsl".to_owned()),
        "{names:?}"
    );
    let lacks = parse(&both[..1], "").unwrap_err();
    assert!(lacks.message().contains("there is no file"), "{lacks}");
    let endless = [("lib/tint.glsl", "#include \"tint.glsl\"\n")];
    let endless = parse(&endless, "").unwrap_err();
    assert!(endless.message().contains("without end"), "{endless}");
    let large = "/".repeat(1000);
    let large = parse(&[("lib/tint.glsl", &large)], "source-bytes=500").unwrap_err();
    assert!(large.message().contains("source-bytes"), "{large}");
}

/// Each takes seconds: `make check` skips them.
mod slow {
    use super::*;

    /// Bevy's own material in naga_oil's dialect.
    #[test]
    fn bevys_material_is_read() {
        bevys_material(crate::bevy::packages(), "wgsl");
    }
}
