//! Shaders and scenes come from strangers: what is too large, reaches too far, or never ends is refused or stopped, and told; what was measured stays.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use crate::hostile_support::{
    SCENE, SHADER, folder, kill, preshade, run, run_within, stderr, wait,
};

#[test]
fn a_scene_stays_in_its_root_unless_it_is_allowed_out() {
    let outside = SCENE.replace("\"a.wgsl\"", "\"../../secret.wgsl\"");
    let here = folder("outside", &outside, "");
    let refused = run(&here, &["explain", "a.toml"]);
    assert_eq!(refused.status.code(), Some(2));
    let told = stderr(&refused);
    assert!(
        told.contains("lies outside of the scene's root folder"),
        "{told}"
    );
    assert!(told.contains("--allow-outside"), "{told}");
    let allowed = run(&here, &["explain", "a.toml", "--allow-outside"]);
    assert_eq!(allowed.status.code(), Some(0), "{}", stderr(&allowed));
    // Nor is a device read, which has no end.
    let device = SCENE.replace("\"a.wgsl\"", "\"/dev/zero\"");
    let here = folder("device", &device, "");
    let refused = run(&here, &["explain", "a.toml", "--allow-outside"]);
    let told = stderr(&refused);
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
    let refused = run(&here, &["explain", "a.toml"]);
    let told = stderr(&refused);
    assert!(
        told.contains("outside of the scene's root folder"),
        "{told}"
    );
    // Where the folder above says that it is the root, it is.
    fs::write(all.join("preshade.toml"), "").unwrap();
    let read = run(&here, &["explain", "a.toml"]);
    assert_eq!(read.status.code(), Some(0), "{}", stderr(&read));
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
        let output = run_within(&here, args, Duration::from_secs(20));
        assert_eq!(output.status.code(), Some(2), "{args:?}");
        let said = stderr(&output);
        assert!(said.contains(told), "{args:?}: {said}");
    }
}

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
        let limits = ["--limits", "seconds=1", "--format", "json"];
        let output = run(&here, &[command, &limits].concat());
        assert_eq!(output.status.code(), Some(2), "{command:?}");
        let told = stderr(&output);
        assert!(told.contains("stopped after 1 s"), "{command:?}: {told}");
        let said: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(said["schema"], "preshade.error.v1", "{command:?}");
        assert!(start.elapsed() < Duration::from_secs(8), "{command:?}");
    }
}

#[test]
fn what_naga_would_panic_at_is_an_error_at_the_author_s_text() {
    let part = "var a = array<f32, 3>(); let sum = half_of(&a[1]);";
    let here = folder("part", SCENE, part);
    let shader = fs::read_to_string(here.join("a.wgsl")).unwrap();
    let half = "fn half_of(p: ptr<function, f32>) -> f32 { return *p / 2.0; }\n";
    fs::write(here.join("a.wgsl"), shader + half).unwrap();
    let spirv = [
        "rewrite",
        "a.wgsl",
        "--pass",
        "depth-prepass",
        "--emit",
        "spirv",
        "-o",
        "out",
    ];
    for args in [&spirv[..], &["verify", "a.toml", "--time", "no"]] {
        let output = run(&here, args);
        let told = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{told}");
        assert!(
            told.contains("a.wgsl:9:") && told.contains("`a[1]`"),
            "{told}"
        );
        assert!(told.contains("pass a variable of its own"), "{told}");
        assert!(!told.contains("panicked"), "{told}");
    }
    let wgsl = run(
        &here,
        &["rewrite", "a.wgsl", "--pass", "depth-prepass", "-o", "out"],
    );
    assert_eq!(wgsl.status.code(), Some(0), "{}", stderr(&wgsl));
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
                let named = run(&here, &["explain", "a.wgsl", "--config", "preshade.toml"]);
                assert_eq!(named.status.code(), Some(0), "{text}: {}", stderr(&named));
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
    let vertex = "#version 450\nlayout(location = 0) in vec3 position;\nvoid main() { gl_Position = vec4(position, 1.0); }\n";
    let fragment = format!(
        "#version 450\n#extension GL_GOOGLE_include_directive : enable\n{first}\nlayout(location = 0) out vec4 color;\nvoid main() {{ color = vec4(0.5); }}\n"
    );
    fs::write(here.join("a.vert"), vertex).unwrap();
    fs::write(here.join("a.frag"), fragment).unwrap();
    here
}

#[test]
fn included_files_stay_in_the_root_and_come_to_an_end() {
    let here = with_glsl("include", "#include \"../../secret.txt\"");
    let refused = run(&here, &["explain", "a.toml"]);
    let told = stderr(&refused);
    assert_eq!(refused.status.code(), Some(2), "{told}");
    assert!(told.contains("outside of the root folder"), "{told}");
    assert!(!told.contains("not to be read"), "{told}");
    // A file beside the shader is found from whatever folder the command runs in.
    let here = with_glsl("beside", "#include \"part.glsl\"");
    fs::write(here.join("part.glsl"), "const float half_of_it = 0.5;\n").unwrap();
    let scene = here.join("a.toml");
    let read = run(Path::new("/"), &["explain", scene.to_str().unwrap()]);
    assert_eq!(read.status.code(), Some(0), "{}", stderr(&read));
    // One that includes itself, and some that include each other more and more often.
    let here = with_glsl("itself", "#include \"part.glsl\"");
    fs::write(
        here.join("part.glsl"),
        "#if 1\n#include \"part.glsl\"\n#endif\n",
    )
    .unwrap();
    let refused = run(&here, &["explain", "a.toml"]);
    assert_eq!(refused.status.code(), Some(2));
    let told = stderr(&refused);
    assert!(told.contains("part.glsl includes itself"), "{told}");
    let here = with_glsl("more", "#include \"0.glsl\"");
    for i in 0..40 {
        let twice = format!("#include \"{}.glsl\"\n", i + 1).repeat(2);
        fs::write(here.join(format!("{i}.glsl")), twice).unwrap();
    }
    fs::write(here.join("40.glsl"), "").unwrap();
    let refused = run(&here, &["explain", "a.toml"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(
        stderr(&refused).contains("more than 10000 times"),
        "{}",
        stderr(&refused)
    );
    // What is guarded may: it is empty the second time.
    let here = with_glsl("guarded", "#include \"part.glsl\"");
    let guarded =
        "#ifndef PART\n#define PART\n#include \"part.glsl\"\nconst float one = 1.0;\n#endif\n";
    fs::write(here.join("part.glsl"), guarded).unwrap();
    let read = run(&here, &["explain", "a.toml"]);
    assert_eq!(read.status.code(), Some(0), "{}", stderr(&read));
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
        let refused = run(&here, &[&["explain", "a.toml"], args].concat());
        assert_eq!(
            refused.status.code(),
            Some(2),
            "{name}: {}",
            stderr(&refused)
        );
        assert!(
            stderr(&refused).contains(told),
            "{name}: {}",
            stderr(&refused)
        );
    }
    let here = folder("array", SCENE, "");
    let shader = fs::read_to_string(here.join("a.wgsl")).unwrap();
    fs::write(here.join("a.wgsl"), format!("{body}\n{shader}")).unwrap();
    let refused = run(&here, &["explain", "a.wgsl"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(
        stderr(&refused).contains("`array-elements`"),
        "{}",
        stderr(&refused)
    );
    let refused = run(&here, &["explain", "a.wgsl", "--limits", "verticess=3"]);
    assert!(
        stderr(&refused).contains("did you mean `vertices`?"),
        "{}",
        stderr(&refused)
    );
}

/// A software adapter lets all loops of a shader have 65,535 turns together, so that each turn takes long.
fn endless() -> String {
    let turn = "n += sin(n + at.x);".repeat(256);
    format!(
        "var n = 0.0;
    loop {{ if at.x < 0.0 {{ break; }} {turn} }}
    if n > 3.0 {{ return vec4(n); }}"
    )
}

#[test]
fn a_shader_that_never_ends_is_stopped() {
    let here = folder("endless", SCENE, &endless());
    let args = [
        "verify",
        "a.toml",
        "--time",
        "no",
        "--pass",
        "depth-prepass",
        "--limits",
        "seconds=6",
    ];
    let stopped = run(&here, &args);
    assert_eq!(stopped.status.code(), Some(2), "{}", stderr(&stopped));
    let told = stderr(&stopped);
    assert!(
        told.contains("the original was not measured: it was stopped after 6 s"),
        "{told}"
    );
}

#[test]
fn variants_apart_are_told_as_variants_together() {
    let here = folder("apart", SCENE, "");
    let args = [
        "verify",
        "a.toml",
        "--time",
        "no",
        "--format",
        "json",
        "--pass",
        "depth-prepass",
        "--pass",
        "early-discard",
        "--out",
        "out",
    ];
    let together = run(&here, &args);
    let apart = run(&here, &[&args[..], &["--limits", "seconds=300"]].concat());
    assert_eq!(apart.status.code(), Some(0), "{}", stderr(&apart));
    let read =
        |output: &Output| serde_json::from_slice::<serde_json::Value>(&output.stdout).unwrap();
    let (together, apart) = (read(&together), read(&apart));
    let told = |report: &serde_json::Value| -> Vec<(String, String)> {
        let variants = report["variants"].as_array().unwrap().iter();
        variants
            .map(|v| (v["name"].to_string(), v["verdict"].to_string()))
            .collect()
    };
    assert_eq!(told(&together), told(&apart));
    assert_eq!(told(&apart).len(), 3);
    assert!(here.join("out/report.json").is_file());
    assert!(!here.join("out/report.unfinished.json").exists());
}

/// The processes that `parent` started.
fn children(parent: u32) -> Vec<u32> {
    let list = fs::read_to_string(format!("/proc/{parent}/task/{parent}/children"));
    let list = list.unwrap_or_default();
    list.split_whitespace()
        .filter_map(|p| p.parse().ok())
        .collect()
}

/// `verify` of the scene in `here` by three passes, each in a process of its own, with a report in `out`.
#[cfg(target_os = "linux")]
fn measured_apart(here: &Path) -> Command {
    let mut command = preshade(here);
    command.args(["verify", "a.toml", "--time", "no"]);
    command.args(["--limits", "seconds=300", "--out", "out"]);
    command.args([
        "--pass",
        "depth-prepass",
        "--pass",
        "depth-prepass:form=equal",
    ]);
    command.args(["--pass", "early-discard"]);
    command
}

#[cfg(target_os = "linux")]
#[test]
fn a_variant_that_is_killed_leaves_the_others() {
    let here = folder("killed-variant", SCENE, "");
    let mut child = measured_apart(&here)
        .args(["--format", "json"])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    // The second process measures the first variant.
    let parent = child.id();
    let first = wait(&mut child, "its first process", || {
        children(parent).first().copied()
    });
    let second = wait(&mut child, "its second process", || {
        children(parent).into_iter().find(|p| *p != first)
    });
    kill(second);
    let output = child.wait_with_output().unwrap();
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let verdict = |n: usize| report["variants"][n]["verdict"].to_string();
    assert!(
        verdict(1).contains("its process ended with signal: 9"),
        "{}",
        verdict(1)
    );
    assert!(
        verdict(2).contains("holds") && verdict(3).contains("holds"),
        "{report}"
    );
}

#[cfg(target_os = "linux")]
#[test]
fn a_run_that_is_killed_leaves_what_it_measured_and_says_what_is_missing() {
    let here = folder("killed", SCENE, "");
    let mut child = measured_apart(&here)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let kept = here.join("out/report.unfinished.json");
    let parent = child.id();
    wait(&mut child, "a first variant", || {
        kept.exists().then_some(())
    });
    let workers = children(parent);
    kill(parent);
    child.wait().unwrap();
    let text = fs::read_to_string(kept).unwrap();
    let unfinished: serde_json::Value = serde_json::from_str(&text).unwrap();
    let missing = unfinished["missing"].as_array().unwrap().len();
    let measured = unfinished["report"]["variants"].as_array().unwrap().len();
    assert_eq!(missing + measured, 4, "{text}");
    assert!(measured > 1 && missing > 0, "{text}");
    assert!(
        unfinished["report"]["variants"][1]["verdict"]
            .to_string()
            .contains("holds")
    );
    // What it started ends with it.
    let start = Instant::now();
    let is_running = |p: &u32| {
        let state = fs::read_to_string(format!("/proc/{p}/stat")).unwrap_or_default();
        !state.is_empty() && !state.contains(") Z")
    };
    while workers.iter().any(is_running) {
        assert!(
            start.elapsed() < Duration::from_secs(60),
            "{workers:?} go on"
        );
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[cfg(unix)]
#[test]
fn a_full_disk_loses_nothing_that_was_told() {
    let here = folder("disk", SCENE, "");
    // A file of more than 512 bytes cannot be written: neither what is kept on the way nor the report.
    let script = format!(
        "trap '' XFSZ; ulimit -f 1; exec {} verify a.toml --time no --pass depth-prepass --out out",
        env!("CARGO_BIN_EXE_preshade")
    );
    let output = Command::new("sh")
        .args(["-c", &script])
        .current_dir(&here)
        .output()
        .unwrap();
    let told = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(
        told.contains("depth-prepass") && told.contains("holds"),
        "{told}\n{}",
        stderr(&output)
    );
    assert_eq!(output.status.code(), Some(2));
    assert!(
        stderr(&output).contains("what is measured so far is not kept"),
        "{}",
        stderr(&output)
    );
    assert!(
        stderr(&output).contains("report.json"),
        "{}",
        stderr(&output)
    );
    let left: Vec<_> = fs::read_dir(here.join("out"))
        .map(|d| d.map(|e| e.unwrap().file_name()).collect())
        .unwrap_or_default();
    assert!(!left.iter().any(|f| f == "report.json"), "{left:?}");
}

#[test]
fn reports_escape_every_name() {
    let evil = "<script>alert(1)<\\\\/script><img src=x onerror=alert(2)>&\\\"'\\u001b[2J\\u202e";
    let of_material = |name: &str| {
        format!("name = \"{evil}\"\n{}", SCENE.replace("MATERIAL", name))
            .replace(
                "mesh = \"wall\"",
                &format!("mesh = \"wall\"\nname = \"{evil}\""),
            )
            .replace("eye =", &format!("name = \"{evil}\"\neye ="))
    };
    let scene = of_material(evil);
    let here = folder("names", &scene, "let drawn_by_script_tag = 1;");
    // Where shaders are written too, a material's name begins their names.
    let output = run(&here, &["plan", "a.toml", "--time", "no", "--out", "plan"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("cannot begin a file name"));
    fs::write(here.join("b.toml"), of_material("alert(1)&'")).unwrap();
    let explore: &[&str] = &["explore", "--seconds", "4", "--pass", "depth-prepass"];
    let verify: &[&str] = &["verify", "--time", "no", "--pass", "depth-prepass"];
    let plan: &[&str] = &["plan", "--time", "no"];
    for command in [explore, verify, plan] {
        let file = if command[0] == "plan" {
            "b.toml"
        } else {
            "a.toml"
        };
        let rest = [file, "--size", "32x24", "--out", command[0]];
        let output = run(&here, &[command, &rest].concat());
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        let page = fs::read_to_string(here.join(command[0]).join("report.html")).unwrap();
        assert!(
            !page.contains("<script>alert") && !page.contains("<img src=x"),
            "a name is markup in the page of {}",
            command[0]
        );
        // Its own two: what it carries as data, and what draws it.
        assert_eq!(page.matches("<script").count(), 2);
        assert!(page.contains("alert(1)"));
        let csv = fs::read_to_string(here.join(command[0]).join("report.csv")).unwrap();
        for text in [page, csv] {
            assert!(!text.contains(['\u{1b}', '\u{202e}']), "{}", command[0]);
        }
    }
}

#[test]
fn under_strict_limits_shaders_are_compiled_with_checks_and_every_report_says_so() {
    let here = folder("checked", SCENE, "");
    let verify = [
        "verify",
        "a.toml",
        "--time",
        "no",
        "--pass",
        "depth-prepass",
    ];
    let plan = ["plan", "a.toml", "--time", "no"];
    for (command, limits, checked) in [
        (&verify[..], "strict", true),
        (&verify, "seconds=100", true),
        (&verify, "default", false),
        (&plan, "strict", true),
    ] {
        let told = run(&here, &[command, &["--limits", limits]].concat());
        let said = String::from_utf8_lossy(&told.stdout).into_owned();
        assert_eq!(
            said.contains("with checked shaders"),
            checked,
            "{limits}: {said}{}",
            stderr(&told)
        );
        let json = run(
            &here,
            &[command, &["--limits", limits, "--format", "json"]].concat(),
        );
        let json: serde_json::Value = serde_json::from_slice(&json.stdout).unwrap();
        let of = json["scenes"].get(0).unwrap_or(&json);
        assert_eq!(
            of["adapter"]["checked_shaders"] == true,
            checked,
            "{limits}: {json}"
        );
    }
}
