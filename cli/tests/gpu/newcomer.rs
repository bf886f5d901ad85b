//! What a newcomer ran into, where something is drawn. Pictures are small, and nothing is timed.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

use crate::hostile_support::{run, stderr};

fn here(name: &str, files: &[(&str, &str)]) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join("newcomer-drawn")
        .join(name);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    for (file, text) in files {
        fs::write(folder.join(file), text).unwrap();
    }
    folder
}

fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// A leaf by no telling name: its alpha test depends on a texture and two uniforms.
const LEAF: &str = "
struct Camera { view_proj: mat4x4f }
struct Material { base_color: vec4f, alpha_cutoff: f32 }
@group(0) @binding(0) var<uniform> camera: Camera;
@group(1) @binding(0) var<uniform> material: Material;
@group(1) @binding(1) var base_color_texture: texture_2d<f32>;
@group(1) @binding(2) var base_color_sampler: sampler;
@group(2) @binding(0) var<uniform> model: mat4x4f;
struct V { @builtin(position) p: vec4f, @location(0) uv: vec2f }
@vertex fn vs(@location(0) position: vec3f, @location(1) uv: vec2f) -> V {
    return V(camera.view_proj * model * vec4f(position, 1.0), uv);
}
@fragment fn fs(in: V) -> @location(0) vec4f {
    let base = textureSample(base_color_texture, base_color_sampler, in.uv) * material.base_color;
    if base.a < material.alpha_cutoff { discard; }
    return vec4f(base.rgb, 1.0);
}
";

/// A vertex and a fragment file are one input of `plan`, alone and among others.
#[test]
fn a_pair_of_files_is_planned_as_one() {
    let vertex = "#version 300 es
in vec3 position; in vec3 normal; out vec3 n; uniform mat4 modelViewProjection;
void main() { n = normal; gl_Position = modelViewProjection * vec4(position, 1.0); }
";
    let fragment = "#version 300 es
precision highp float; in vec3 n; out vec4 color; uniform int bands;
void main() { color = vec4(floor(n * float(bands)) / float(bands), 1.0); }
";
    let files = [
        ("toon.vert", vertex),
        ("toon.frag", fragment),
        ("leaf.wgsl", LEAF),
        ("broken.wgsl", "fn"),
    ];
    let folder = here("pair", &files);
    let size = ["--time", "no", "--size", "64x36"];
    let plan = |given: &[&str]| run(&folder, &[&["plan"], given, &size].concat());
    let alone = plan(&["toon.vert", "toon.frag"]);
    assert_eq!(alone.status.code(), Some(0), "{}", stderr(&alone));
    let told = stderr(&alone);
    assert!(told.contains("uniforms.bands"), "{told}");
    assert!(told.contains("4, by its use"), "{told}");
    let three = plan(&["toon.vert", "leaf.wgsl", "toon.frag", "broken.wgsl"]);
    let told = stderr(&three);
    assert_eq!(three.status.code(), Some(2), "{told}");
    assert!(
        told.ends_with("error: 1 of 3 inputs failed: broken.wgsl\n"),
        "{told}"
    );
}

/// Bugs 1 and 10: nothing that preshade made up removes the alpha test; and no time stands beside
/// a speedup of another pair.
#[test]
fn a_made_up_texture_removes_no_discard() {
    let folder = here("discard", &[("leaf.wgsl", LEAF)]);
    let size = ["--time", "no", "--size", "64x36"];
    let planned = run(
        &folder,
        &[&["plan", "leaf.wgsl", "--out", "x"][..], &size].concat(),
    );
    assert_eq!(planned.status.code(), Some(0), "{}", stderr(&planned));
    let text = fs::read_to_string(folder.join("x/leaf.main.wgsl")).unwrap();
    assert!(text.contains("discard;"), "{text}");
    let table = stdout(&planned);
    let (_, views) = table.split_once("speedup by view").unwrap();
    let plans = views.lines().filter(|l| l.starts_with("  "));
    assert!(plans.clone().count() > 0, "{table}");
    for line in plans {
        assert!(!line.contains(" ms"), "{line}");
    }
    let args = [&["verify", "leaf.wgsl", "--pass", "specialize"][..], &size].concat();
    let verified = run(&folder, &args);
    assert_eq!(verified.status.code(), Some(3), "{}", stdout(&verified));
    assert!(stdout(&verified).starts_with("Not measured: every material refuses it: no value"));
}

/// Bug 4: a bare alpha-tested shader is drawn with its discard at work.
#[test]
fn a_bare_alpha_test_discards_fragments() {
    let whole = LEAF.replace("{ discard; }", "{ }");
    let folder = here("alpha", &[("leaf.wgsl", LEAF), ("whole.wgsl", &whole)]);
    let picture = |name: &str| {
        let file = format!("{name}.wgsl");
        let args = [
            "verify",
            &file,
            "--time",
            "no",
            "--size",
            "96x54",
            "--pass",
            "depth-prepass",
            "--out",
            name,
            "--format",
            "json",
        ];
        let output = run(&folder, &args);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(report["untested"].as_array().map_or(0, Vec::len), 0);
        fs::read(folder.join(name).join("original.png")).unwrap()
    };
    assert!(picture("leaf") != picture("whole"));
}

/// Bugs 5, 11 and 14: objects have places of their own where a shader has no model matrix, a normal
/// matrix is none of the identity, and an adapter that is not there is all that is said.
#[test]
fn made_up_scenes_are_sensible() {
    let terrain = "
@group(0) @binding(0) var<uniform> view_proj: mat4x4f;
@vertex fn vs(@location(0) position: vec3f) -> @builtin(position) vec4f {
    return view_proj * vec4f(position, 1.0);
}
@fragment fn fs() -> @location(0) vec4f { return vec4f(1.0, 0.5, 0.2, 1.0); }
";
    let lit = "
struct Model { model: mat4x4f, normal: mat4x4f }
@group(0) @binding(0) var<uniform> view_proj: mat4x4f;
@group(0) @binding(1) var<uniform> model: Model;
struct V { @builtin(position) p: vec4f, @location(0) n: vec3f }
@vertex fn vs(@location(0) position: vec3f, @location(1) normal: vec3f) -> V {
    return V(
        view_proj * model.model * vec4f(position, 1.0),
        (model.normal * vec4f(normal, 0.0)).xyz,
    );
}
@fragment fn fs(in: V) -> @location(0) vec4f { return vec4f(in.n, 1.0); }
";
    let folder = here("made-up", &[("terrain.wgsl", terrain), ("lit.wgsl", lit)]);
    let verify = |args: &[&str]| {
        let given = ["verify", "--time", "no", "--size", "64x36"];
        run(&folder, &[&given[..], args].concat())
    };
    let output = verify(&["terrain.wgsl", "--pass", "depth-prepass:form=equal"]);
    let said = stdout(&output);
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(said.contains("same picture"), "{said}");
    assert!(!said.contains("depth ties: at"), "{said}");
    let said = stderr(&verify(&["lit.wgsl", "--pass", "depth-prepass"]));
    assert!(said.contains("model.normal  $normalmatrix"), "{said}");
    for command in ["verify", "plan", "explore"] {
        let args = [command, "lit.wgsl", "--adapter", "no such adapter"];
        let output = run(&folder, &args);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.starts_with("error[no-adapter]"), "{command}: {said}");
    }
}

/// Two boxes of which one stands in the other: one pixel ties at 960x540, and none in a small
/// picture.
const TIE: &str = r#"
size = [960, 540]
[materials.m]
shader = "tie.wgsl"
values."u.tint" = [1, 0.5, 0.2, 1]
[meshes]
p.box = {}
q.box = { size = [0.9, 0.9, 0.9] }
[[draws]]
mesh = "p"
material = "m"
[[draws]]
mesh = "q"
material = "m"
translate = [0.031, 0.017, 0.0501]
rotate = [7, 13, 5]
[[cameras]]
eye = [1, 1.3, 1.9]
target = [0, 0, 0]
"#;

const TIED: &str = "
struct U { view_proj: mat4x4f, model: mat4x4f, tint: vec4f, exposure: f32 }
@group(0) @binding(0) var<uniform> u: U;
struct V { @builtin(position) p: vec4f, @location(0) n: vec3f }
@vertex fn vs(@location(0) position: vec3f, @location(1) normal: vec3f) -> V {
    return V(u.view_proj * u.model * vec4f(position, 1.0), normal);
}
@fragment fn fs(in: V) -> @location(0) vec4f {
    return u.tint * u.exposure * (0.3 + max(dot(normalize(in.n), vec3f(0.3, 0.8, 0.5)), 0.0));
}
";

/// Bug 2: a choice counts ties at the scene's own size, however small it draws.
#[test]
fn ties_count_at_the_scenes_own_size() {
    let folder = here("ties", &[("tie.toml", TIE), ("tie.wgsl", TIED)]);
    let size = ["--time", "no", "--size", "64x36"];
    let args = [&["plan", "tie.toml", "--format", "json"][..], &size].concat();
    let output = run(&folder, &args);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let decision: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let plans = decision["plans"].as_array().unwrap();
    for plan in plans {
        let recipes = plan["recipes"].to_string();
        assert!(!recipes.contains("form=equal"), "{recipes}");
    }
}

/// What a scene file leaves open is told as lines that can be added to it, and they work.
#[test]
fn open_values_of_a_scene_are_told_as_its_lines() {
    let folder = here("open", &[("tie.toml", TIE), ("tie.wgsl", TIED)]);
    let args = |file| {
        [
            "verify", file, "--time", "no", "--size", "64x36", "--pass", "hoist",
        ]
    };
    let said = stderr(&run(&folder, &args("tie.toml")));
    let line = "values.\"u.exposure\" = ";
    let open: Vec<&str> = said.lines().filter(|l| l.starts_with(line)).collect();
    assert_eq!(open.len(), 1, "{said}");
    assert!(said.contains("\n[materials.m]\n"), "{said}");
    let place = "[materials.m]\n";
    let closed = TIE.replace(place, &format!("{place}{}\n", open[0]));
    fs::write(folder.join("closed.toml"), closed).unwrap();
    let said = stderr(&run(&folder, &args("closed.toml")));
    assert!(!said.contains("made these up"), "{said}");
    assert!(!said.contains("error"), "{said}");
}

/// Bug 12: `explain --scene` prints a value once. Bug 13: nothing is said twice.
#[test]
fn nothing_is_told_twice() {
    let thrice = "
@group(0) @binding(0) var<uniform> view_proj: mat4x4f;
struct V { @builtin(position) p: vec4f, @location(0) n: vec3f }
@vertex fn vs(@location(0) position: vec3f, @location(1) normal: vec3f) -> V {
    return V(view_proj * vec4f(position, 1.0), normal);
}
@fragment fn fs(in: V) -> @location(0) vec4f {
    let w = in.n * in.n;
    return vec4f(w / (w.x + w.y + w.z), 1.0);
}
";
    let immediate = "
var<immediate> mvp: mat4x4f;
@vertex fn vs(@location(0) position: vec3f) -> @builtin(position) vec4f {
    return mvp * vec4f(position, 1.0);
}
@fragment fn fs() -> @location(0) vec4f { return vec4f(1.0); }
";
    let files = [("thrice.wgsl", thrice), ("immediate.wgsl", immediate)];
    let folder = here("twice", &files);
    let output = run(
        &folder,
        &["explain", "thrice.wgsl", "--scene", "-v", "--size", "32x18"],
    );
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let said = stdout(&output);
    let values: Vec<&str> = said
        .lines()
        .filter_map(|l| l.split_once("  `").map(|(_, value)| value))
        .filter(|v| v.ends_with(')') && v.contains("thrice.wgsl:"))
        .collect();
    assert!(values.len() > 1, "{said}");
    for value in &values {
        assert_eq!(values.iter().filter(|v| *v == value).count(), 1, "{said}");
    }
    let args = [
        "verify",
        "immediate.wgsl",
        "--time",
        "no",
        "--size",
        "32x18",
    ];
    let said = stderr(&run(&folder, &args));
    let lines: Vec<&str> = said.lines().filter(|l| l.contains("mvp")).collect();
    for line in &lines {
        assert_eq!(lines.iter().filter(|l| *l == line).count(), 1, "{said}");
    }
}

/// Bug 15: a choice that names a value which is gone is a warning.
#[test]
fn a_stale_choice_is_a_warning() {
    let folder = here("stale", &[("tie.toml", TIE), ("tie.wgsl", TIED)]);
    let args = [
        "verify",
        "tie.toml",
        "--time",
        "no",
        "--size",
        "64x36",
        "--pass",
        "hoist:budget=0.1",
    ];
    let said = stderr(&run(&folder, &args));
    let (_, recipe) = said.split_once("`rewrite` makes the same of ").unwrap();
    let recipe = recipe.lines().next().unwrap();
    let step = recipe
        .trim()
        .trim_start_matches("--pass ")
        .trim_matches('\'');
    let rewritten = |step: &str| {
        let output = run(&folder, &["rewrite", "tie.toml", "--pass", step]);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        stderr(&output)
    };
    assert!(!rewritten(step).contains("`carry` names"), "{step}");
    let stale = step.replacen("carry=", "carry=0123456789abcdef+", 1);
    let said = rewritten(&stale);
    assert!(
        said.contains("warning: `m`: `carry` names values"),
        "{said}"
    );
    assert!(said.contains("choose again with `verify`"), "{said}");
}

/// `u.debug` is made up as 0, so no draw takes the branch.
const DEBUG: &str = "
struct U { view_proj: mat4x4f, debug: u32 }
@group(0) @binding(0) var<uniform> u: U;
struct V { @builtin(position) p: vec4f, @location(0) n: vec3f }
@vertex fn vs(@location(0) position: vec3f, @location(1) normal: vec3f) -> V {
    return V(u.view_proj * vec4f(position, 1.0), normal);
}
@fragment fn fs(in: V) -> @location(0) vec4f {
    if u.debug == 1u { return vec4f(1.0, 0.0, 0.0, 1.0); }
    return vec4f(normalize(in.n) * 0.5 + 0.5, 1.0);
}
";

/// A bare shader decides nothing about shipping, and a branch that no draw takes voids no exact
/// promise, whichever command looks at it.
#[test]
fn a_bare_shader_is_measured_and_not_decided() {
    let folder = here("debug", &[("debug.wgsl", DEBUG)]);
    let verify = |args: &[&str]| {
        let given = ["verify", "debug.wgsl", "--size", "64x36"];
        run(&folder, &[&given[..], args].concat())
    };
    let output = verify(&["--time", "no"]);
    let said = stdout(&output);
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(
        said.starts_with("On a made-up scene (2 guessed inputs): nothing was timed. Give your"),
        "{said}"
    );
    let notes = stderr(&output);
    assert!(
        notes.contains("note: pipeline state assumed of `debug`: opaque "),
        "{notes}"
    );
    let output = verify(&["--every-pass", "--format", "json"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(report["held"].as_u64().unwrap() > 5, "{report}");
}

/// A step that needs a budget and has none takes that of `--budget`.
#[test]
fn a_step_without_a_budget_takes_the_one_that_is_asked_for() {
    let output = run(
        Path::new(env!("CARGO_MANIFEST_DIR")),
        &[
            "verify",
            "../fixtures/scenes/cobbles.toml",
            "--variant",
            "skip-taps",
            "--budget",
            "flip_mean=0.02",
            "--time",
            "no",
            "--size",
            "64x36",
            "--format",
            "json",
        ],
    );
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let variant = &report["variants"][1];
    let name = variant["name"].as_str().unwrap();
    assert!(name.contains("budget=0.02"), "{name}");
    assert_eq!(variant["verdict"]["kind"], "holds", "{variant}");
}
