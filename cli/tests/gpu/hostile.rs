//! Shaders that never end, processes that are killed, full disks and names that are markup, in
//! commands that draw.

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use crate::hostile_support::{SCENE, folder, kill, preshade, run, slow, stderr, wait};

#[test]
fn a_shader_that_takes_too_long_is_stopped() {
    let here = folder("slow", SCENE, &slow());
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
        "--variant",
        "depth-prepass",
        "--variant",
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

/// `verify` of the scene in `here` by three passes, each in a process of its own, with a report in
/// `out`.
#[cfg(target_os = "linux")]
fn measured_apart(here: &Path) -> Command {
    let mut command = preshade(here);
    command.args(["verify", "a.toml", "--time", "no"]);
    command.args(["--limits", "seconds=300", "--out", "out"]);
    command.args([
        "--variant",
        "depth-prepass",
        "--variant",
        "depth-prepass:form=equal",
    ]);
    command.args(["--variant", "early-discard"]);
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
    // A file of more than 512 bytes cannot be written: neither what is kept on the way nor the
    // report.
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
        told.contains("depth-prepass") && told.contains("same picture"),
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
        assert!(told.contains("pass a copy and store it back"), "{told}");
        assert!(!told.contains("panicked"), "{told}");
    }
    let wgsl = run(
        &here,
        &["rewrite", "a.wgsl", "--pass", "depth-prepass", "-o", "out"],
    );
    assert_eq!(wgsl.status.code(), Some(0), "{}", stderr(&wgsl));
}
