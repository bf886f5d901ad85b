//! A run that is killed, runs out of disk or meets a scene that is no good keeps every finished
//! result, and says what is missing.
#![cfg(unix)]

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use preshade_lab::search::plan::Model;
use serde_json::Value;

use crate::hostile_support::{SCENE, folder, kill, preshade, run, stderr, wait};

/// Three views, so that there is something to be in the middle of.
const ORDERS: (&str, &str) = (
    "orders = [\"as-given\"]",
    "orders = [\"as-given\", \"front-to-back\", \"back-to-front\"]",
);

/// A cost model, so that none is fitted.
fn with_model(here: &Path) {
    let model = Model::nominal().to_json().unwrap();
    fs::write(here.join("model.json"), model).unwrap();
}

fn json(path: &Path) -> Option<Value> {
    serde_json::from_str(&fs::read_to_string(path).ok()?).ok()
}

fn list<'v>(value: &'v Value, key: &str) -> &'v [Value] {
    value[key].as_array().map_or(&[], Vec::as_slice)
}

/// The binary in a shell that first does `first`.
fn shell(here: &Path, first: &str, args: &str) -> Output {
    let script = format!("{first} exec {} {args}", env!("CARGO_BIN_EXE_preshade"));
    let mut command = Command::new("sh");
    command.args(["-c", &script]).current_dir(here);
    command.stdin(Stdio::null()).output().unwrap()
}

/// No file may be longer than 512 bytes: what a full disk does to a report, without filling one.
const FULL: &str = "trap '' XFSZ; ulimit -f 1;";

#[test]
fn a_plan_that_is_killed_leaves_the_views_it_measured() {
    let here = folder("plan-killed", &SCENE.replace(ORDERS.0, ORDERS.1), "");
    fs::copy(here.join("a.toml"), here.join("b.toml")).unwrap();
    with_model(&here);
    let mut child = preshade(&here)
        .args(["plan", "a.toml", "b.toml", "--out", "out"])
        .args(["--model", "model.json", "--seconds", "0.2"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let kept = here.join("out/plan.unfinished.json");
    let process = child.id();
    wait(&mut child, "a first view", || kept.exists().then_some(()));
    kill(process);
    child.wait().unwrap();
    let unfinished = json(&kept).unwrap();
    assert_eq!(unfinished["schema"], "preshade.plan-unfinished.v1");
    let scene = &unfinished["scenes"][0];
    assert_eq!(scene["scene"], "a.toml");
    // Every view is there, or is said to be missing; so is every scene.
    let (views, missing) = (list(scene, "views"), list(scene, "missing"));
    assert_eq!(views.len() + missing.len(), 3, "{unfinished}");
    let scenes = list(&unfinished, "scenes").len() + list(&unfinished, "missing").len();
    assert_eq!(scenes, 2, "{unfinished}");
    let finished = missing.is_empty() && list(&unfinished, "missing").is_empty();
    assert!(!finished, "{unfinished}");
    // What was measured is whole: samples of the original, and of what was drawn beside it.
    let original = &views[0]["plans"][0];
    assert_eq!(original["name"], "original");
    assert!(!list(&original["time"], "samples").is_empty(), "{original}");
}

#[test]
fn an_exhaustive_plan_that_is_killed_goes_on_with_the_scenes_that_are_missing() {
    let here = folder("exhaustive-killed", SCENE, "");
    fs::copy(here.join("a.toml"), here.join("b.toml")).unwrap();
    with_model(&here);
    let args = [
        "plan",
        "a.toml",
        "b.toml",
        "--exhaustive",
        "--out",
        "out",
        "--model",
        "model.json",
        "--seconds",
        "0.2",
        "--workers",
        "1",
    ];
    let results = || -> Vec<_> {
        let entries = fs::read_dir(here.join("out/outcomes"))
            .into_iter()
            .flatten();
        let files = entries.map(|e| e.unwrap().path());
        let whole = files.filter(|f| f.to_string_lossy().ends_with(".outcome.json"));
        whole
            .map(|f| (fs::metadata(&f).unwrap().modified().unwrap(), f))
            .collect()
    };
    let mut child = preshade(&here)
        .args(args)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let process = child.id();
    wait(&mut child, "a first scene", || {
        (!results().is_empty()).then_some(())
    });
    kill(process);
    child.wait().unwrap();
    let before = results();
    let output = run(&here, &args);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let after = results();
    assert_eq!((before.len(), after.len()), (1, 2), "{}", stderr(&output));
    assert!(after.contains(&before[0]), "measured twice: {after:?}");
    let regret = json(&here.join("out/regret.json")).unwrap();
    assert_eq!(list(&regret, "scenes").len(), 2);
}

#[test]
fn an_exhaustive_plan_reports_regret() {
    let here = folder("exhaustive", SCENE, "");
    with_model(&here);
    fs::create_dir(here.join("out")).unwrap();
    let args = "plan a.toml --exhaustive --model model.json --seconds 0.1 --out out";
    let output = run(&here, &args.split(' ').collect::<Vec<_>>());
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let regret = json(&here.join("out/regret.json")).unwrap();
    assert_eq!(list(&regret, "scenes").len(), 1);
    assert!(here.join("out/regret.csv").is_file());
}

#[test]
fn a_scene_that_is_no_good_takes_no_other_with_it() {
    let here = folder("no-good", SCENE, "");
    fs::write(
        here.join("0.toml"),
        SCENE.replace("a.wgsl", "not-there.wgsl"),
    )
    .unwrap();
    let scenes = here.parent().unwrap();
    let plan: &[&str] = &["plan", "scenes", "--time", "no", "--out", "plan"];
    let explore: &[&str] = &["explore", "scenes", "--seconds", "3", "--out", "explore"];
    let beside: &[&str] = &[
        "explore",
        "scenes",
        "--seconds",
        "3",
        "--out",
        "beside",
        "--workers",
        "2",
    ];
    let pass: &[&str] = &["--pass", "depth-prepass"];
    for (args, file) in [
        (plan.to_vec(), "plan/a/decision.json"),
        ([explore, pass].concat(), "explore/a/report.json"),
        ([beside, pass].concat(), "beside/a/report.json"),
    ] {
        let output = run(scenes, &args);
        let told = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{told}");
        assert!(told.contains("scenes/0.toml: "), "{told}");
        assert!(told.contains("not-there.wgsl"), "{told}");
        assert!(told.contains("1 of 2 inputs failed"), "{told}");
        assert!(scenes.join(file).is_file(), "{told}");
    }
}

#[test]
fn a_search_that_is_killed_goes_on_from_what_it_measured() {
    let here = folder("explore-killed", SCENE, "");
    let args = ["explore", "a.toml", "--out", "out", "--size", "32x24"];
    let mut child = preshade(&here)
        .args(args)
        .args(["--seconds", "120"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let journal = here.join("out/measured.jsonl");
    let lines = |with: &str| {
        let text = fs::read_to_string(&journal).unwrap_or_default();
        text.lines().filter(|l| l.contains(with)).count()
    };
    let process = child.id();
    wait(&mut child, "a first candidate", || {
        (lines("\"error\"") > 0).then_some(())
    });
    kill(process);
    child.wait().unwrap();
    // Every whole line is one that the next search reads.
    let text = fs::read_to_string(&journal).unwrap();
    let whole = text.lines().filter(|l| !l.is_empty());
    let unreadable = whole.filter(|l| serde_json::from_str::<Value>(l).is_err());
    assert!(unreadable.count() <= 1, "{text}");
    let again = run(&here, &[&args[..], &["--seconds", "4"]].concat());
    assert_eq!(again.status.code(), Some(0), "{}", stderr(&again));
    let told = stderr(&again);
    assert!(
        told.contains("a search before this one ended without"),
        "{told}"
    );
    assert!(here.join("out/report.json").is_file());
}

#[test]
fn a_full_disk_is_told_and_what_was_printed_stands() {
    let here = folder("full-disk", SCENE, "");
    with_model(&here);
    for (args, printed) in [
        (
            "plan a.toml --model model.json --seconds 0.1 --out out",
            "stone",
        ),
        (
            "explore a.toml --seconds 3 --pass depth-prepass --out out",
            "original",
        ),
    ] {
        let output = shell(&here, FULL, args);
        let told = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{args}: {told}");
        let out = String::from_utf8_lossy(&output.stdout);
        assert!(out.contains(printed), "{args}: {out}\n{told}");
        assert!(
            told.contains("what was measured is on stdout"),
            "{args}: {told}"
        );
        assert!(told.contains("is not kept"), "{args}: {told}");
    }
    // A result of a job is there whole or not at all.
    let exhaustive = "plan a.toml --exhaustive --model model.json --seconds 0.1 --out out";
    let output = shell(&here, FULL, exhaustive);
    let told = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{told}");
    assert!(told.contains(".outcome.json"), "{told}");
    assert_eq!(
        fs::read_dir(here.join("out/outcomes")).unwrap().count(),
        0,
        "{told}"
    );
    // A shader of more than 512 bytes: none of its files is there, whole or cut off.
    let output = shell(
        &here,
        FULL,
        "rewrite a.wgsl --pass depth-prepass -o shaders",
    );
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    let left = fs::read_dir(here.join("shaders")).map_or(0, Iterator::count);
    assert_eq!(left, 0, "{}", stderr(&output));
}

#[test]
fn of_many_materials_those_that_fit_are_written() {
    let here = folder("full-disk-many", SCENE, "");
    let small = "@vertex fn v() -> @builtin(position) vec4<f32> { return vec4(0.0); }\n";
    fs::write(here.join("b.wgsl"), small).unwrap();
    // The plan of a material is longer than 512 bytes, but not longer than 16 KiB; its shader is.
    let long = "// nothing\n".repeat(4000);
    fs::write(here.join("a.wgsl"), long + small).unwrap();
    let first = "trap '' XFSZ; ulimit -f 32;";
    let output = shell(&here, first, "rewrite a.wgsl b.wgsl --out-dir shaders");
    let told = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{told}");
    assert!(told.contains("1 failed"), "{told}");
    assert!(here.join("shaders/b.plan.json").is_file(), "{told}");
    assert!(!here.join("shaders/a.plan.json").exists(), "{told}");
}

#[cfg(target_os = "linux")]
#[test]
fn an_output_that_is_full_does_not_keep_the_report_from_its_folder() {
    let here = folder("full-stdout", SCENE, "");
    with_model(&here);
    for (args, file) in [
        (
            "verify a.toml --time no --pass depth-prepass --out verify",
            "verify/report.json",
        ),
        ("plan a.toml --time no --out plan", "plan/decision.json"),
        (
            "explore a.toml --seconds 3 --pass depth-prepass --out explore",
            "explore/report.json",
        ),
    ] {
        let output = shell(&here, "exec >/dev/full;", args);
        let told = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{args}: {told}");
        assert!(told.contains("what was measured is in"), "{args}: {told}");
        assert!(here.join(file).is_file(), "{args}: {told}");
    }
}
