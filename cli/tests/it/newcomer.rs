//! What a newcomer ran into, as far as nothing is drawn for it. `cli/tests/gpu/newcomer.rs` has the
//! rest.

use std::fs;
use std::path::{Path, PathBuf};

use crate::hostile_support::{ended, run, stderr};
use crate::trees::fixture;

/// A folder with these files.
fn here(name: &str, files: &[(&str, &str)]) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join("newcomer")
        .join(name);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    for (file, text) in files {
        fs::write(folder.join(file), text).unwrap();
    }
    folder
}

/// What `explain` prints.
fn explained(folder: &Path, args: &[&str]) -> String {
    let args = [&["explain"], args].concat();
    let output = run(folder, &args);
    ended(&output, 0, &args);
    String::from_utf8(output.stdout).unwrap()
}

const VERTEX: &str = "
struct V { @builtin(position) p: vec4f, @location(0) uv: vec2f, @location(1) w: vec2f }
@vertex fn vs(@location(0) position: vec3f, @location(1) uv: vec2f) -> V {
    return V(vec4f(position, 1.0), uv, uv * 0.5 + 0.2);
}
";

/// Blended samples at an implicit level of detail, and no loop.
fn taps() -> String {
    format!(
        "{VERTEX}
@group(0) @binding(1) var t0: texture_2d<f32>;
@group(0) @binding(2) var t1: texture_2d<f32>;
@group(0) @binding(3) var s: sampler;
@fragment fn fs(in: V) -> @location(0) vec4f {{
    let a = textureSample(t0, s, in.uv);
    let b = textureSample(t1, s, in.uv * 2.0);
    return a * in.w.x + b * in.w.y;
}}
"
    )
}

/// Bug 8: what `explain` advises works, or is no advice.
#[test]
fn advice_works() {
    let folder = here("advice", &[("taps.wgsl", &taps())]);
    // threshold=0 is refused for samples at an implicit level.
    let said = explained(&folder, &["taps.wgsl", "--pass", "skip-taps"]);
    assert!(said.contains("set budget=0.01"), "{said}");
    assert!(!said.contains("threshold=0"), "{said}");
    let args = ["rewrite", "taps.wgsl", "--pass", "skip-taps:budget=0.01"];
    let told = ended(&run(&folder, &args), 0, &args);
    assert!(!told.contains("does not apply"), "{told}");
    // Without a loop, no budget helps.
    let said = explained(&folder, &["taps.wgsl", "--pass", "trim-loop"]);
    assert!(said.contains("trim-loop/no-loop"), "{said}");
    assert!(!said.contains("budget=0.01"), "{said}");
    // `explain` does not advise to run `explain`.
    let said = explained(&folder, &["taps.wgsl", "-v"]);
    assert!(!said.contains("`preshade explain` lists"), "{said}");
}

/// Bug 8: a scene is not advised to be a scene.
#[test]
fn a_scene_is_not_told_to_be_one() {
    let scene = "../fixtures/scenes/simple.toml";
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let said = explained(folder, &[scene, "--pass", "specialize"]);
    assert!(!said.contains("give it a scene"), "{said}");
}

/// Bug 9: `--print-config` needs no file.
#[test]
fn the_configuration_is_printed_without_a_file() {
    let folder = here("config", &[]);
    let args = ["--print-config"];
    let told = ended(&run(&folder, &args), 0, &args);
    assert_eq!(told, "");
}

/// Bug 9: the README does not deny what the command line does.
#[test]
fn the_readme_denies_no_target() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let readme = fs::read_to_string(root.join("README.md")).unwrap();
    let denied = readme
        .split("\n\n")
        .filter(|part| part.contains("does not") || part.contains("not yet"));
    for part in denied {
        assert!(!part.contains("ES 1.00"), "{part}");
    }
}

/// A triangle as two primitives of two materials, at two nodes, and a mesh that no node has.
const TREES: &str = r#"{
  "asset": { "version": "2.0" }, "scene": 0,
  "scenes": [{ "nodes": [0, 1] }],
  "nodes": [{ "name": "near", "mesh": 0 }, { "name": "far", "mesh": 0, "translation": [9, 0, 0] }],
  "meshes": [
    { "name": "Tree", "primitives": [
      { "attributes": { "POSITION": 0 }, "material": 0 },
      { "attributes": { "POSITION": 0 }, "material": 1 }] },
    { "name": "Canopy", "primitives": [{ "attributes": { "POSITION": 0 } }] }],
  "materials": [{ "name": "Bark" }, { "name": "Leaf" }],
  "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
    "min": [0, 0, 0], "max": [0, 0, 0] }],
  "bufferViews": [{ "buffer": 0, "byteLength": 36 }],
  "buffers": [{ "byteLength": 36, "uri": "data:application/octet-stream;base64,DATA" }]
}"#;

fn scene_of(gltf: &str) -> String {
    format!(
        "[materials.m]\nshader = \"a.wgsl\"\n[meshes]\nm.gltf = {{ file = \"a.gltf\"{gltf} }}\n\
         [[draws]]\nmesh = \"m\"\nmaterial = \"m\"\n[[cameras]]\neye = [0, 0, 3]\n\
         target = [0, 0, 0]\n"
    )
}

/// Bugs 6 and 7: a part of a glTF file is selected by mesh, node, material and primitive; what is
/// not there is named.
#[test]
fn parts_of_a_gltf_file_are_selected() {
    let shader = format!("{VERTEX}@fragment fn fs(in: V) -> @location(0) vec4f {{ return in.p; }}");
    let gltf = TREES.replace("DATA", &"A".repeat(48));
    let folder = here("gltf", &[("a.wgsl", &shader), ("a.gltf", &gltf)]);
    let load = |selection: &str| {
        fs::write(folder.join("a.toml"), scene_of(selection)).unwrap();
        run(&folder, &["explain", "a.toml"])
    };
    for selection in [
        "",
        ", mesh = \"Canopy\"",
        ", node = \"far\", material = \"Leaf\"",
        ", mesh = \"Tree\", primitive = 1",
    ] {
        let output = load(selection);
        assert_eq!(
            output.status.code(),
            Some(0),
            "{selection}: {}",
            stderr(&output)
        );
    }
    for (selection, said) in [
        (", mesh = \"Canopi\"", "did you mean `Canopy`?"),
        (", node = \"fart\"", "did you mean `far`?"),
        (", material = \"Leaves\"", "there is no material `Leaves`"),
        (
            ", primitive = 2",
            "there are: 0 of `Bark`, 1 of `Leaf`, 0 of `Bark`, 1 of `Leaf`",
        ),
        (
            ", node = \"far\", mesh = \"Canopy\"",
            "neither the node `far` nor one below it has the mesh `Canopy`",
        ),
    ] {
        let output = load(selection);
        let told = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{selection}: {told}");
        assert!(told.contains(said), "{selection}: {told}");
    }
}

/// A switch is a value of the host; a loop's counter is none, nor is a loop of a fixed length.
#[test]
fn switches_are_values_of_the_host() {
    let shader = format!(
        "{VERTEX}
struct U {{ octaves: i32, fog_density: f32 }}
@group(0) @binding(0) var<uniform> u: U;
@fragment fn fs(in: V) -> @location(0) vec4f {{
    var c = vec3f(0.0);
    for (var i = 0; i < u.octaves; i++) {{ c += sin(in.uv.xyx * f32(i + 1)) / f32(i + 1); }}
    for (var k = 0; k < 4; k++) {{ c += cos(in.uv.yxx * f32(k + 1)) / f32(k + 1); }}
    if u.fog_density > 0.0 {{ c = mix(c, vec3f(0.5), exp(-u.fog_density * in.uv.x)); }}
    return vec4f(c, 1.0);
}}
"
    );
    let folder = here("switches", &[("a.wgsl", &shader)]);
    let said = explained(&folder, &["a.wgsl"]);
    let line = said.lines().find(|l| l.contains("`specialize` removes"));
    let line = line.unwrap_or_else(|| panic!("{said}"));
    assert!(line.contains("octaves ("), "{line}");
    assert!(line.contains("fog ("), "{line}");
    for counter in [" i (", " k (", "unnamed"] {
        assert!(!line.contains(counter), "{line}");
    }
}

const LEGACY: &str = "#version 120\nvoid main() { gl_Position = ftransform(); }\n";
const LIT_VERT: &str = "#version 330\nin vec3 position; out vec3 n; uniform mat4 mvp;\n\
                        void main() { n = position; gl_Position = mvp * vec4(position, 1.0); }\n";
const LIT_FRAG: &str = "#version 330\nin vec3 n; out vec4 c;\nvoid main() { c = vec4(n, 1.0); }\n";

#[test]
fn what_is_no_input_is_told_with_a_way_on() {
    let files = [
        ("legacy.vert", LEGACY),
        ("tree/lit.vert", LIT_VERT),
        ("tree/lit.frag", LIT_FRAG),
        ("tree/lit.geom", "void main() {}\n"),
    ];
    let folder = here("ways-on", &[]);
    fs::create_dir(folder.join("tree")).unwrap();
    for (file, text) in files {
        fs::write(folder.join(file), text).unwrap();
    }
    let told = |args: &[&str], status: i32| ended(&run(&folder, args), status, args);
    let no_frame = told(&["profile", "tree"], 2);
    assert!(no_frame.contains("it has no frame.json"), "{no_frame}");
    let legacy = told(&["explain", "legacy.vert"], 2);
    assert!(legacy.contains("declare `in vec4 position`"), "{legacy}");
    let alone = told(&["explain", "tree/lit.vert"], 0);
    assert!(alone.contains("`lit` has no fragment stage"), "{alone}");
    for args in [
        &["explain", "tree/lit.vert", "tree/lit.frag"][..],
        &["rewrite", "tree/lit.vert", "tree/lit.frag"],
        &["rewrite", "tree", "--out-dir", "out"],
    ] {
        let between = told(args, 0);
        assert!(between.contains("left out: `tree/lit.geom`"), "{between}");
    }
}

#[test]
fn of_variants_that_draw_the_same_one_is_listed() {
    let shader = fixture("shaders/pbr.wgsl");
    let folder = here("jobs", &[]);
    let args = ["jobs", shader.to_str().unwrap(), "--explore"];
    let output = run(&folder, &args);
    ended(&output, 0, &args);
    let lines = String::from_utf8(output.stdout).unwrap();
    assert!(lines.contains("\"variant\":\"depth-prepass\""), "{lines}");
    // Nothing can be hoisted exactly, and a bare shader has no values to specialise by.
    for same in ["hoist + depth-prepass", "specialize"] {
        assert!(!lines.contains(same), "{same}: {lines}");
    }
}

/// Each takes seconds: `make check` skips them.
mod slow {
    use super::*;

    /// What `rewrite` makes for the draws of a scene, `explain` offers.
    #[test]
    fn versions_for_groups_of_draws_are_offered() {
        let museum = fixture("scenes/museum.toml");
        let museum = museum.to_str().unwrap();
        let folder = here("versions", &[]);
        let brief = explained(&folder, &[museum]);
        assert!(
            brief.contains("8 versions, one for each group of draws"),
            "{brief}"
        );
        assert!(!brief.contains("nothing-known"), "{brief}");
        let asked = explained(
            &folder,
            &[museum, "--pass", "specialize", "--material", "museum"],
        );
        assert_eq!(asked.matches("applies to `fs_main`").count(), 8, "{asked}");
    }
}
