//! What every command says to good and bad input, and what it leaves behind: exit status, stdout,
//! stderr, files.

use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use crate::hostile_support::{self, stderr};

/// Every transcript in `tests/cmd`. `TRYCMD=overwrite` updates them. `tests/gpu` runs those that
/// draw.
#[test]
fn transcripts() {
    trycmd::TestCases::new()
        .env("COLUMNS", "100")
        .env("NO_COLOR", "1")
        .env("PRESHADE_PROGRESS", "no")
        .case("tests/cmd/*.md");
}

/// The binary, run in the folder of this crate.
fn preshade() -> Command {
    hostile_support::preshade(Path::new(env!("CARGO_MANIFEST_DIR")))
}

fn run(args: &[&str]) -> Output {
    preshade().args(args).output().unwrap()
}

/// A path below which nothing is yet.
fn nowhere(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&path);
    path
}

fn names(dir: &Path) -> Vec<String> {
    let mut names: Vec<String> = fs::read_dir(dir)
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

const TOON: &str = "../fixtures/shaders/toon.wgsl";

#[test]
fn rewrite_writes_every_target_and_the_plan() {
    let out = nowhere("every-target");
    let dir = out.to_str().unwrap();
    let args = [
        "rewrite",
        TOON,
        "--pass",
        "depth-prepass",
        "--emit",
        "wgsl,spirv,glsl,glsl-es",
        "-o",
        dir,
    ];
    let first = run(&args);
    assert_eq!(first.status.code(), Some(0), "{}", stderr(&first));
    assert!(first.stdout.is_empty());
    let stages = [
        "es.frag", "es.vert", "frag", "frag.spv", "vert", "vert.spv", "wgsl",
    ];
    let mut expected: Vec<String> = ["main", "prepass"]
        .iter()
        .flat_map(|role| stages.iter().map(move |s| format!("toon.{role}.{s}")))
        .chain(["toon.plan.json".to_owned()])
        .collect();
    expected.sort();
    assert_eq!(names(&out), expected);

    let again = run(&args);
    assert_eq!(again.status.code(), Some(0));
    assert_eq!(stderr(&again), format!("{dir} is up to date\n"));
}

#[test]
fn nothing_is_written_on_failure() {
    let cases: [&[&str]; 7] = [
        // The fragment stage could be written in GLSL ES, the vertex stage cannot.
        &[
            "rewrite",
            "../fixtures/shaders/vertex-pulling.wgsl",
            "--pass",
            "depth-prepass",
            "--emit",
            "glsl-es",
        ],
        &["rewrite", TOON, "--pass", "depth-prepass:form=equl"],
        &["rewrite", TOON, "--name", "../toon"],
        &["rewrite", TOON, "--state", "tests/bad/state-key.toml"],
        &["rewrite", "tests/bad/two-fragments.wgsl"],
        &["rewrite", "tests/bad/scene-texture.toml"],
        &["rewrite", "-"],
    ];
    for (i, case) in cases.iter().enumerate() {
        let out = nowhere(&format!("nothing-{i}"));
        let mut args = case.to_vec();
        args.extend(["-o", out.to_str().unwrap()]);
        let output = run(&args);
        assert_eq!(output.status.code(), Some(2), "{args:?}");
        assert!(
            stderr(&output).starts_with("error"),
            "{args:?}: {}",
            stderr(&output)
        );
        assert!(output.stdout.is_empty(), "{args:?}");
        assert!(!out.exists(), "{args:?} left something behind");
    }
}

#[test]
fn an_output_folder_that_is_a_file_is_told() {
    let out = nowhere("a-file");
    fs::write(&out, "in the way").unwrap();
    let dir = out.to_str().unwrap();
    for args in [["rewrite", TOON, "-o", dir], ["verify", TOON, "--out", dir]] {
        let output = run(&args);
        assert_eq!(output.status.code(), Some(2), "{args:?}");
        assert!(
            stderr(&output).starts_with("error: "),
            "{}",
            stderr(&output)
        );
    }
    assert_eq!(fs::read_to_string(&out).unwrap(), "in the way");
    fs::remove_file(&out).unwrap();
}

#[test]
fn a_refused_pass_keeps_the_original() {
    let refused = run(&[
        "rewrite",
        TOON,
        "--pass",
        "depth-prepass",
        "--blend",
        "alpha",
    ]);
    let plain = run(&["rewrite", TOON, "--blend", "alpha"]);
    assert_eq!(refused.status.code(), Some(0));
    assert!(stderr(&refused).starts_with("note[depth-prepass/blended]: does not apply"));
    assert_eq!(refused.stdout, plain.stdout);
    assert_eq!(
        stderr(&plain),
        "note: no --pass is given, so `toon` is written as it is; none applies to it\n"
    );
}

/// A stage that reads which side it draws is drawn from both.
#[test]
fn the_assumed_state_is_told_and_drops_no_side_that_the_shader_reads() {
    let two_sided = "../fixtures/shaders/two-sided.wgsl";
    for (args, told) in [
        (&[TOON][..], "of `toon`: opaque rgba8unorm, cull back, "),
        (
            &[two_sided],
            "of `two-sided`: opaque rgba8unorm, cull none, ",
        ),
        (&[two_sided, "--cull", "back"], "cull back, triangle-list, "),
    ] {
        let output = run(&[&["rewrite", "--pass", "depth-prepass"], args].concat());
        let said = stderr(&output);
        assert!(said.contains("note: pipeline state assumed of"), "{said}");
        assert!(said.contains(told), "{said}");
    }
}

#[test]
fn without_a_pass_those_that_apply_are_named() {
    let output = run(&["rewrite", TOON]);
    assert_eq!(output.status.code(), Some(0));
    assert_eq!(
        stderr(&output),
        "note: no --pass is given, so `toon` is written as it is; \
         these apply to it: depth-prepass, early-discard, shadow, outputs\n"
    );
}

#[test]
fn another_view_s_layout_is_read_from_a_file() {
    let out = nowhere("layout");
    fs::create_dir_all(&out).unwrap();
    let layout = out.join("light.txt");
    let text = "// The light's.\nstruct Light { position: vec3<f32>, view_proj: mat4x4<f32> }\n\
        @group(2) @binding(1) var<uniform> light: Light;\n";
    fs::write(&layout, text).unwrap();
    let pass =
        |layout: &str| format!("outputs:write=shadow,map=light.view_proj=camera,layout={layout}");
    let rewrite = |layout: &str| {
        let (pass, out) = (pass(layout), out.to_str().unwrap());
        run(&[
            "rewrite",
            "../fixtures/pages/leaf.wgsl",
            "--pass",
            &pass,
            "-o",
            out,
        ])
    };
    let output = rewrite(layout.to_str().unwrap());
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let made = fs::read_to_string(out.join("leaf.outputs.wgsl")).unwrap();
    assert!(
        made.contains("@group(2) @binding(1) var<uniform> light: Light;"),
        "{made}"
    );
    assert!(made.contains("light.view_proj * "), "{made}");
    let output = rewrite("none.wgsl");
    assert_eq!(output.status.code(), Some(2));
    let said = stderr(&output);
    assert!(
        said.contains("the layout `none.wgsl` cannot be read: "),
        "{said}"
    );
}

#[test]
fn a_target_that_cannot_say_it_does_not_hold_up_the_others() {
    let out = nowhere("three-of-four");
    let output = run(&[
        "rewrite",
        "../fixtures/adversarial/barycentrics.wgsl",
        "--pass",
        "depth-prepass",
        "--emit",
        "wgsl,glsl,glsl-es,spirv",
        "-o",
        out.to_str().unwrap(),
    ]);
    assert_eq!(output.status.code(), Some(2));
    let said = stderr(&output);
    assert!(
        said.contains(": glsl-es cannot express this: barycentric"),
        "{said}"
    );
    let main = ["frag", "frag.spv", "vert", "vert.spv", "wgsl"].map(|end| format!("main.{end}"));
    let prepass = ["vert", "vert.spv", "wgsl"].map(|end| format!("prepass.{end}"));
    let all = main.into_iter().chain(prepass);
    let mut expected: Vec<String> = all
        .chain(["plan.json".to_owned()])
        .map(|name| format!("barycentrics.{name}"))
        .collect();
    expected.sort();
    assert_eq!(names(&out), expected);
    let plan = fs::read_to_string(out.join("barycentrics.plan.json")).unwrap();
    let plan: serde_json::Value = serde_json::from_str(&plan).unwrap();
    let targets: Vec<&String> = plan["files"][0]["vertex"]
        .as_object()
        .unwrap()
        .keys()
        .collect();
    assert_eq!(targets, ["glsl", "spirv", "wgsl"]);
}

#[test]
fn an_output_folder_that_cannot_be_written_to_is_told_before_anything_is_drawn() {
    // Where nobody may write, root included.
    let locked = Path::new("/proc/preshade/report");
    if !cfg!(target_os = "linux") {
        return;
    }
    let output = run(&["verify", TOON, "--out", locked.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(2));
    let said = stderr(&output);
    assert!(
        said.starts_with("error: /proc/preshade/report: /proc cannot be written to: "),
        "{said}"
    );
}

#[test]
fn frames_of_a_trace_are_told_and_a_trace_that_is_none_is_an_error() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let traces = root.join("fixtures/wgpu-traces");
    let out = nowhere("trace");
    let captured = |trace: &Path, more: &[&str]| {
        let mut args = vec!["capture", "--wgpu-trace", trace.to_str().unwrap()];
        args.extend(["-o", out.to_str().unwrap()]);
        args.extend(more);
        let output = run(&args);
        let told = [&output.stdout[..], &output.stderr].concat();
        (output.status.success(), String::from_utf8(told).unwrap())
    };
    let (is_fine, told) = captured(&traces.join("30"), &["--frames", "2"]);
    assert!(is_fine, "{told}");
    for expected in [
        ": 2 frames of 64x48, 8 draws, 6 render passes, 3 pipelines, ",
        "It holds the app's shaders",
        "The trace of wgpu 30 has 3 frames that the app presented. This is frames 1 to 2, counted from 0.",
    ] {
        assert!(told.contains(expected), "{told}");
    }
    let (is_fine, told) = captured(&root.join("fixtures"), &[]);
    assert!(!is_fine && told.contains("trace.ron`"), "{told}");
    let (is_fine, told) = captured(&traces.join("29"), &["https://example.com"]);
    assert!(!is_fine && told.contains("cannot be used with"), "{told}");
}

#[test]
fn stdin_is_a_file_like_any_other() {
    let output = preshade()
        .args([
            "rewrite",
            "-",
            "--lang",
            "wgsl",
            "--name",
            "toon",
            "--pass",
            "depth-prepass",
        ])
        .stdin(fs::File::open(Path::new(env!("CARGO_MANIFEST_DIR")).join(TOON)).unwrap())
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let from_stdin = String::from_utf8(output.stdout).unwrap();
    let from_file = run(&["rewrite", TOON, "--pass", "depth-prepass"]).stdout;
    let from_file = String::from_utf8(from_file).unwrap();
    assert!(from_stdin.contains("toon.prepass.wgsl"));
    assert_eq!(from_stdin.replace("<stdin>", "toon.wgsl"), from_file);
}

#[test]
fn a_reader_that_has_seen_enough_is_no_failure() {
    let mut child = preshade()
        .args(["graph", "../fixtures/shaders/hex-tiling.wgsl"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut first = [0; 7];
    child.stdout.take().unwrap().read_exact(&mut first).unwrap();
    assert_eq!(&first, b"digraph");
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0));
    assert_eq!(stderr(&output), "");
}

#[test]
fn machine_output_parses_and_names_its_schema() {
    for (args, schema) in [
        (["explain", TOON], "preshade.explain.v1"),
        (["passes", "early-discard"], "preshade.passes.v1"),
    ] {
        let mut args = args.to_vec();
        args.extend(["--format", "json"]);
        let output = run(&args);
        let value: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(value["schema"], schema);
        assert_eq!(stderr(&output), "");
    }
    let graph = run(&["graph", TOON, "--format", "json"]);
    assert!(serde_json::from_slice::<serde_json::Value>(&graph.stdout).is_ok());
}

#[test]
fn without_an_adapter_verify_says_what_to_install() {
    // Vulkan's loader and EGL's find no driver; elsewhere than on Linux the variables mean nothing.
    if !cfg!(target_os = "linux") {
        return;
    }
    let out = nowhere("no-adapter");
    let dir = out.to_str().unwrap();
    for args in [
        &["adapters"][..],
        &[
            "verify", TOON, "--size", "16x16", "--time", "no", "--out", dir,
        ],
    ] {
        let output = preshade()
            .args(args)
            .env("VK_DRIVER_FILES", "/nonexistent")
            .env("VK_ICD_FILENAMES", "/nonexistent")
            .env("__EGL_VENDOR_LIBRARY_FILENAMES", "/nonexistent")
            .output()
            .unwrap();
        assert_eq!(
            output.status.code(),
            Some(2),
            "{args:?}: {}",
            stderr(&output)
        );
        assert!(
            stderr(&output).contains("error[no-adapter]: no graphics adapter was found")
                && stderr(&output).contains("mesa-vulkan-drivers"),
            "{}",
            stderr(&output)
        );
        assert!(output.stdout.is_empty());
    }
    assert!(!out.exists());
}

/// What would exhaust a recursive parser's stack is refused, and soon.
#[test]
fn deep_nesting_is_refused() {
    let deep = 200_000;
    let shaders = [
        format!(
            "@vertex fn vs() -> @builtin(position) vec4<f32> {{ return vec4<f32>({}1.0{}); }}",
            "(".repeat(deep),
            ")".repeat(deep)
        ),
        format!(
            "@vertex fn vs() -> @builtin(position) vec4<f32> {{ {} {} return vec4<f32>(); }}",
            "{".repeat(deep),
            "}".repeat(deep)
        ),
        format!(
            "@vertex fn vs() -> @builtin(position) vec4<f32> {{ return vec4<f32>({}1.0); }}",
            "-".repeat(deep)
        ),
        format!(
            "var<private> a: {}f32{};",
            "array<".repeat(deep),
            ">".repeat(deep)
        ),
    ];
    let file = nowhere("deep.wgsl");
    for shader in shaders {
        fs::write(&file, &shader).unwrap();
        let output = run(&["explain", file.to_str().unwrap()]);
        assert_eq!(
            output.status.code(),
            Some(2),
            "{}...: {}",
            &shader[..60],
            stderr(&output)
        );
        assert!(stderr(&output).starts_with("error["), "{}", stderr(&output));
    }
    fs::remove_file(&file).unwrap();
}

/// A scene's materials are drawn in one frame: what one of them hides, another may need.
#[test]
fn what_a_scene_forbids_is_neither_written_nor_said_to_apply() {
    let out = nowhere("color-mask");
    let scene = "../fixtures/scenes/color-mask.toml";
    for name in ["stone", "tint"] {
        let args = [
            "rewrite",
            scene,
            "--material",
            name,
            "--pass",
            "depth-prepass",
            "-o",
            out.to_str().unwrap(),
        ];
        let output = run(&args);
        assert_eq!(output.status.code(), Some(0));
        let said = stderr(&output);
        assert!(said.contains("depth-prepass/color-mask"), "{said}");
        assert!(!out.join(format!("{name}.prepass.wgsl")).exists());
    }
    let explained = run(&["explain", scene, "--pass", "early-discard"]);
    let said = String::from_utf8(explained.stdout).unwrap();
    assert_eq!(
        said.matches("early-discard/color-mask").count(),
        2,
        "{said}"
    );
    assert!(!said.contains("applies to"), "{said}");
}

/// What a language cannot say is told in the author's words, and not in those of the library that
/// writes it.
#[test]
fn what_a_language_lacks_is_told_in_words() {
    let out = nowhere("lacks");
    fs::create_dir_all(&out).unwrap();
    let write = |name: &str, text: &str| {
        let path = out.join(name);
        fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let vertex =
        "@vertex fn vs(@location(0) p: vec4<f32>) -> @builtin(position) vec4<f32> { return p; }\n";
    let external = write(
        "external.wgsl",
        &format!(
            "@group(0) @binding(0) var video: texture_external;\n\
             @group(0) @binding(1) var s: sampler;\n{vertex}\
             @fragment fn fs(@builtin(position) p: vec4<f32>) -> @location(0) vec4<f32> {{ \
             return textureSampleBaseClampToEdge(video, s, p.xy); }}\n"
        ),
    );
    let storage = write(
        "storage.wgsl",
        &format!(
            "@group(0) @binding(0) var<storage, read> t: array<vec4<f32>>;\n{vertex}\
             @fragment fn fs(@builtin(position) p: vec4<f32>) -> @location(0) vec4<f32> {{ \
             return t[u32(p.x)]; }}\n"
        ),
    );
    for (file, target, told) in [
        (&external, "spirv", "the external texture `video`"),
        (&external, "glsl", "the external texture `video`"),
        (
            &storage,
            "glsl-es",
            "storage buffers, arrays of dynamic length",
        ),
    ] {
        let written = out.join("written");
        let args = ["rewrite", file, "--emit", target, "-o"];
        let output = run(&[&args[..], &[written.to_str().unwrap()]].concat());
        assert_eq!(output.status.code(), Some(2));
        let said = stderr(&output);
        assert!(said.contains(told), "{said}");
        for raw in ["panicked", "naga", "Features("] {
            assert!(!said.contains(raw), "{said}");
        }
        // A file in the place of the folder.
        let output = run(&["rewrite", file, "-o", file]);
        assert_eq!(output.status.code(), Some(2));
        let said = stderr(&output);
        assert!(said.contains("is a file, not a folder"), "{said}");
    }
}

#[test]
fn a_slip_in_a_variable_of_the_environment_is_seen() {
    let with = |name: &str| {
        let mut command = preshade();
        command.args(["passes", "depth-prepass"]).env(name, "glsl");
        let output = command.output().unwrap();
        assert_eq!(output.status.code(), Some(0));
        stderr(&output)
    };
    assert_eq!(
        with("PRESHADE_EMMIT"),
        "warning: the environment has `PRESHADE_EMMIT`, which is no flag's (did you mean \
         `PRESHADE_EMIT`?): nothing reads it\n"
    );
    assert_eq!(with("PRESHADE_EMIT"), "");
    assert_eq!(with("MY_PRESHADE_EMMIT"), "");
}

#[test]
fn each_command_has_a_page_of_its_own() {
    let page = |args: &[&str]| {
        let output = run(&[&["man"], args].concat());
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        String::from_utf8(output.stdout).unwrap()
    };
    assert!(page(&[]).contains("preshade\\-rewrite(1)"));
    let rewrite = page(&["rewrite"]);
    assert!(rewrite.contains(".TH preshade-rewrite 1"), "{rewrite}");
    assert!(rewrite.contains("\\-\\-out\\-dir"), "{rewrite}");
    let unknown = run(&["man", "rewrit"]);
    assert_eq!(unknown.status.code(), Some(2));
    assert!(stderr(&unknown).contains("did you mean `rewrite`?"));
}
