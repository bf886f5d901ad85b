//! Shaders and scenes come from strangers: what is too large, reaches too far, or never ends is
//! refused or stopped, and told; what was measured stays.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use crate::hostile_support::{
    SCENE, SHADER, accepted, ended, folder, refused, run, run_within, stderr,
};

#[test]
fn a_scene_stays_in_its_root_unless_it_is_allowed_out() {
    let outside = SCENE.replace("\"a.wgsl\"", "\"../../secret.wgsl\"");
    let here = folder("outside", &outside, "");
    let told = refused(&here, &["explain", "a.toml"]);
    assert!(
        told.contains("lies outside of the scene's root folder"),
        "{told}"
    );
    assert!(told.contains("--allow-outside"), "{told}");
    accepted(&here, &["explain", "a.toml", "--allow-outside"]);
    // Nor is a device read, which has no end.
    let device = SCENE.replace("\"a.wgsl\"", "\"/dev/zero\"");
    let here = folder("device", &device, "");
    let told = refused(&here, &["explain", "a.toml", "--allow-outside"]);
    assert!(told.contains("`/dev/zero`: it is no file"), "{told}");
}

#[test]
fn outside_of_a_repository_a_scene_stays_in_its_folder() {
    let name = format!("preshade-root-{}", std::process::id());
    let all = std::env::temp_dir().join(name);
    let here = all.join("scenes");
    fs::create_dir_all(&here).unwrap();
    let outside = SCENE.replace("\"a.wgsl\"", "\"../a.wgsl\"");
    fs::write(here.join("a.toml"), outside).unwrap();
    fs::write(all.join("a.wgsl"), SHADER.replace("BODY", "")).unwrap();
    let told = refused(&here, &["explain", "a.toml"]);
    assert!(
        told.contains("outside of the scene's root folder"),
        "{told}"
    );
    // Where the folder above says that it is the root, it is.
    fs::write(all.join("preshade.toml"), "").unwrap();
    accepted(&here, &["explain", "a.toml"]);
    fs::remove_dir_all(all).unwrap();
}

#[test]
fn what_is_no_file_or_claims_to_be_huge_is_not_read() {
    let here = folder("no-file", SCENE, "");
    let made = Command::new("mkfifo").arg(here.join("pipe.wgsl")).status();
    assert!(made.unwrap().success() || here.join("pipe.wgsl").exists());
    fs::create_dir_all(here.join("folder.wgsl")).unwrap();
    let sparse = fs::File::create(here.join("sparse.wgsl")).unwrap();
    sparse.set_len(1 << 40).unwrap();
    let pipe = SCENE.replace("a.wgsl", "pipe.wgsl");
    fs::write(here.join("pipe.toml"), pipe).unwrap();
    for (args, told) in [
        (&["explain", "pipe.wgsl"][..], "a device or a pipe"),
        (&["explain", "pipe.toml"], "a device or a pipe"),
        (
            &["explain", "/dev/zero", "--lang", "wgsl"],
            "a device or a pipe",
        ),
        (
            &["explain", "a.wgsl", "--state", "/dev/zero"],
            "a device or a pipe",
        ),
        (&["explain", "folder.wgsl"], "is a folder"),
        (
            &["explain", "sparse.wgsl"],
            "the limit `source-bytes` is 4194304",
        ),
        (
            &["explain", "a.wgsl", "--state", "sparse.wgsl"],
            "the limit `source-bytes`",
        ),
    ] {
        let said = ended(&run_within(&here, args, Duration::from_secs(20)), 2, args);
        assert!(said.contains(told), "{args:?}: {said}");
    }
}

#[test]
fn a_file_that_only_lies_here_lifts_no_protection() {
    let here = folder("found", SCENE, "");
    let link = here.join("link");
    if !link.exists() {
        std::os::unix::fs::symlink("/tmp", &link).unwrap();
    }
    for (text, told) in [
        ("limits = \"none\"", Some("`limits`, which allows more")),
        (
            "limits = \"strict,vertices=100G\"",
            Some("`limits`, which allows more"),
        ),
        ("limits = \"nesting=20\"", None),
        ("allow-outside = true", Some("`allow-outside` is not taken")),
        (
            "out = \"/tmp/elsewhere\"",
            Some("`out`, which would write outside"),
        ),
        (
            "[verify]\nout = \"../elsewhere\"",
            Some("`out`, which would write outside"),
        ),
        (
            "[rewrite]\nout-dir = \"link/below\"",
            Some("`out-dir`, which would write outside"),
        ),
        ("[rewrite]\nout-dir = \"new/below\"", None),
    ] {
        fs::write(here.join("preshade.toml"), text).unwrap();
        let output = run(&here, &["explain", "a.wgsl"]);
        let said = stderr(&output);
        match told {
            Some(told) => {
                assert_eq!(output.status.code(), Some(2), "{text}: {said}");
                assert!(said.contains(told), "{text}: {said}");
                // Who names it takes it.
                accepted(&here, &["explain", "a.wgsl", "--config", "preshade.toml"]);
            }
            None => assert_eq!(output.status.code(), Some(0), "{text}: {said}"),
        }
    }
}

/// GLSL beside the scene: its fragment stage begins with `first`.
fn with_glsl(name: &str, first: &str) -> PathBuf {
    let scene = SCENE.replace(
        "shader = \"a.wgsl\"",
        "vertex = \"a.vert\"\nfragment = \"a.frag\"",
    );
    let here = folder(name, &scene, "");
    let vertex = "#version 450\nlayout(location = 0) in vec3 position;\n\
                  void main() { gl_Position = vec4(position, 1.0); }\n";
    let fragment = format!(
        "#version 450\n#extension GL_GOOGLE_include_directive : enable\n{first}\n\
         layout(location = 0) out vec4 color;\nvoid main() {{ color = vec4(0.5); }}\n"
    );
    fs::write(here.join("a.vert"), vertex).unwrap();
    fs::write(here.join("a.frag"), fragment).unwrap();
    here
}

#[test]
fn included_files_stay_in_the_root_and_come_to_an_end() {
    let here = with_glsl("include", "#include \"../../secret.txt\"");
    let told = refused(&here, &["explain", "a.toml"]);
    assert!(told.contains("outside of the root folder"), "{told}");
    assert!(!told.contains("not to be read"), "{told}");
    // A file beside the shader is found from whatever folder the command runs in.
    let here = with_glsl("beside", "#include \"part.glsl\"");
    fs::write(here.join("part.glsl"), "const float half_of_it = 0.5;\n").unwrap();
    let scene = here.join("a.toml");
    accepted(Path::new("/"), &["explain", scene.to_str().unwrap()]);
    // One that includes itself, and some that include each other more and more often.
    let here = with_glsl("itself", "#include \"part.glsl\"");
    fs::write(
        here.join("part.glsl"),
        "#if 1\n#include \"part.glsl\"\n#endif\n",
    )
    .unwrap();
    let told = refused(&here, &["explain", "a.toml"]);
    assert!(told.contains("part.glsl includes itself"), "{told}");
    let here = with_glsl("more", "#include \"0.glsl\"");
    for i in 0..40 {
        let twice = format!("#include \"{}.glsl\"\n", i + 1).repeat(2);
        fs::write(here.join(format!("{i}.glsl")), twice).unwrap();
    }
    fs::write(here.join("40.glsl"), "").unwrap();
    let told = refused(&here, &["explain", "a.toml"]);
    assert!(told.contains("more than 10000 times"), "{told}");
    // What is guarded may: it is empty the second time.
    let here = with_glsl("guarded", "#include \"part.glsl\"");
    let guarded =
        "#ifndef PART\n#define PART\n#include \"part.glsl\"\nconst float one = 1.0;\n#endif\n";
    fs::write(here.join("part.glsl"), guarded).unwrap();
    accepted(&here, &["explain", "a.toml"]);
}

#[test]
fn what_is_too_large_is_refused_by_the_limit_s_name() {
    let body = "var<private> a: array<array<vec4<f32>, 4096>, 8192>;";
    for (name, from, to, args, told) in [
        (
            "plane",
            "size = [2, 2]",
            "segments = [4000000000, 4000000000]",
            &[][..],
            "the limit `vertices`",
        ),
        (
            "ball",
            "plane = { size = [2, 2] }",
            "sphere = { segments = 100000, rings = 100000 }",
            &[],
            "the limit `vertices`",
        ),
        (
            "few",
            "size = [2, 2]",
            "segments = [30, 30]",
            &["--limits", "vertices=500"],
            "the vertices of all meshes would be 961; the limit `vertices` is 500",
        ),
        (
            "copies",
            "rotate = [90, 0, 0]",
            "field = { count = [4294967295, 4294967295, 4294967295], spacing = [1, 1, 1] }",
            &[],
            "4000000 are allowed",
        ),
        (
            "pixels",
            "size = [48, 32]",
            "size = [8192, 8192]",
            &["--limits", "strict"],
            "the limit `pixels`",
        ),
        (
            "deep",
            "size = [48, 32]",
            &format!("clear = {}1{}", "[".repeat(3000), "]".repeat(3000)),
            &[],
            "nested more than 180 deep",
        ),
    ] {
        assert!(SCENE.contains(from), "{name}");
        let here = folder(name, &SCENE.replace(from, to), "");
        let said = refused(&here, &[&["explain", "a.toml"], args].concat());
        assert!(said.contains(told), "{name}: {said}");
    }
    let here = folder("array", SCENE, "");
    let shader = fs::read_to_string(here.join("a.wgsl")).unwrap();
    fs::write(here.join("a.wgsl"), format!("{body}\n{shader}")).unwrap();
    let told = refused(&here, &["explain", "a.wgsl"]);
    assert!(told.contains("`array-elements`"), "{told}");
    let told = refused(&here, &["explain", "a.wgsl", "--limits", "verticess=3"]);
    assert!(told.contains("did you mean `vertices`?"), "{told}");
}

/// Each takes seconds: `make check` skips them.
mod slow {
    use super::*;

    #[test]
    fn what_does_not_end_before_it_is_measured_is_stopped() {
        // naga reads a function of that many expressions in quadratic time.
        let body: String = (0..40_000)
            .map(|i| format!("let a{i} = f32({i}) * at.x;\n"))
            .collect();
        let here = folder("slow", SCENE, &body);
        for command in [
            &["explain", "a.toml"][..],
            &["rewrite", "a.wgsl", "--pass", "depth-prepass"],
            &["verify", "a.toml", "--time", "no"],
            &["plan", "a.toml", "--time", "no"],
        ] {
            let start = Instant::now();
            let limits = ["--limits", "seconds=1,statements=100k", "--format", "json"];
            let output = run(&here, &[command, &limits].concat());
            let told = ended(&output, 2, command);
            assert!(told.contains("stopped after 1 s"), "{command:?}: {told}");
            let said: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
            assert_eq!(said["schema"], "preshade.error.v1", "{command:?}");
            assert!(start.elapsed() < Duration::from_secs(8), "{command:?}");
        }
    }
}
