//! `verify` of several inputs: one line each, on the adapter at hand and on a second driver.

use std::fs;
use std::path::Path;
use std::process::Output;

use serde_json::Value;

use crate::hostile_support::{SCENE, folder, preshade, stderr};
use crate::swiftshader_support::{VARIABLE, swiftshader};

fn here() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn verify(folder: &Path, args: &[&str]) -> Output {
    preshade(folder).arg("verify").args(args).output().unwrap()
}

/// The report of a run with this exit status.
fn report(output: &Output, status: i32) -> Value {
    assert_eq!(output.status.code(), Some(status), "{}", stderr(output));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Scenes with what drivers do differently: samples, alpha to coverage, formats, reversed depth.
const SCENES: [&str; 5] = ["msaa", "alpha-coverage", "d16", "reversed-z", "displaced"];

#[test]
fn exact_recipes_hold_on_swiftshader() {
    let scenes = SCENES.map(|name| format!("../fixtures/scenes/{name}.toml"));
    let mut args: Vec<&str> = scenes.iter().map(String::as_str).collect();
    for recipe in [
        "depth-prepass",
        "depth-prepass:form=equal",
        "early-discard",
        "early-discard:attachment=readonly",
        "early-alpha",
        "specialize",
    ] {
        args.extend(["--variant", recipe]);
    }
    args.extend(["--size", "160x90", "--format", "json"]);
    let mut command = preshade(here());
    command.env(VARIABLE, swiftshader()).arg("verify");
    let report = report(&command.args(&args).output().unwrap(), 0);
    let adapter = report["adapter"]["name"].as_str().unwrap();
    assert!(adapter.contains("SwiftShader"), "{adapter}");
    assert_eq!(report["broken"], 0, "{report}");
    for input in report["inputs"].as_array().unwrap() {
        assert!(input["held"].as_u64().unwrap() > 0, "{input}");
    }
}

/// `dpdx` of a value of divergent control flow, which SwiftShader gives otherwise from run to run.
const UNREPEATED: &str = "
struct U { mvp: mat4x4<f32> }
@group(0) @binding(0) var<uniform> u: U;
struct V { @builtin(position) position: vec4<f32>, @location(0) uv: vec2<f32> }
@vertex fn vs(@location(0) position: vec3<f32>, @location(1) uv: vec2<f32>) -> V {
    return V(u.mvp * vec4<f32>(position, 1.0), uv);
}
@fragment fn fs(v: V) -> @location(0) vec4<f32> {
    var x = 0.0;
    for (var i = 0; i < 8; i++) {
        x += v.uv.x;
        if x > 2.5 { discard; }
        if fract(v.uv.x * f32(i + 1) * 7.0) < 0.1 { break; }
    }
    return vec4<f32>(abs(dpdx(x)), x * 0.1, 0.5, 1.0);
}
";

/// What the adapter does with the original is not blamed on the passes.
#[test]
fn an_original_that_does_not_repeat_itself_proves_nothing() {
    let scenes = folder("unrepeated", SCENE, "");
    fs::write(scenes.join("unrepeated.wgsl"), UNREPEATED).unwrap();
    let verify = |args: &[&str]| {
        let mut command = preshade(&scenes);
        command.env(VARIABLE, swiftshader()).arg("verify");
        let given = ["unrepeated.wgsl", "--size", "160x90"];
        command.args(given).args(args).output().unwrap()
    };
    let output = verify(&["--time", "no"]);
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert_eq!(output.status.code(), Some(3), "{said}");
    let first = "Not measured: the original does not repeat itself on this adapter (";
    assert!(said.starts_with(first), "{said}");
    assert!(!said.contains("BROKEN"), "{said}");
    let every = report(&verify(&["--every-pass", "--format", "json"]), 3);
    assert_eq!(
        (&every["held"], &every["broken"]),
        (&0.into(), &0.into()),
        "{every}"
    );
}

#[test]
fn every_declared_recipe_is_counted_once() {
    let scenes = folder("every-pass", SCENE, "");
    let report = report(
        &verify(&scenes, &["a.toml", "--every-pass", "--format", "json"]),
        0,
    );
    let count = |what: &str| report[what].as_u64().unwrap();
    assert_eq!((count("broken"), count("failed")), (0, 0), "{report}");
    assert!(count("held") > 10 && count("refused") > 10, "{report}");
    // Nothing lies behind anything in it, and it has no loop: nothing is near a budget.
    assert_eq!(count("over_budget"), 0, "{report}");
}

#[test]
fn what_cannot_be_read_is_a_line_and_the_next_one_runs() {
    let scenes = folder("unreadable", SCENE, "");
    fs::write(scenes.join("b.wgsl"), "fn nothing() {}\n").unwrap();
    fs::write(scenes.join("c.toml"), "size = [4, 4]\n").unwrap();
    let output = verify(&scenes, &[".", "--variant", "depth-prepass"]);
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert_eq!(output.status.code(), Some(2), "{said}");
    let line = |name: &str| said.lines().find(|l| l.starts_with(name)).unwrap();
    assert!(line("./b.wgsl").contains("left out"), "{said}");
    assert!(line("./c.toml").contains("NOT DRAWN"), "{said}");
    for name in ["./a.toml", "./a.wgsl"] {
        let words: Vec<&str> = line(name).split_whitespace().collect();
        assert_eq!(words[1..], ["1", "0", "0", "0", "0"], "{said}");
    }
    assert!(stderr(&output).contains("1 input could not be drawn"));
}

/// A budget that the user gives is a promise, which too small a one breaks.
#[test]
fn a_broken_promise_names_the_command_that_shows_it() {
    let args = [
        "../fixtures/pages",
        "--variant",
        "skip-taps:budget=0.000001,threshold=0.1",
        "--size",
        "64x36",
    ];
    let output = verify(here(), &args);
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert_eq!(output.status.code(), Some(1), "{said}{}", stderr(&output));
    let mut lines = said.lines().map(str::trim);
    let command = lines.find(|l| l.starts_with("preshade verify"));
    let words = shell_words::split(command.unwrap()).unwrap();
    let words: Vec<&str> = words[2..].iter().map(String::as_str).collect();
    assert!(words.contains(&"../fixtures/pages/rock.wgsl"), "{said}");
    let alone = verify(here(), &words);
    assert_eq!(alone.status.code(), Some(1), "{}", stderr(&alone));
}

#[test]
fn flags_of_a_report_are_for_one_input() {
    for flag in [
        ["--time", "everything"],
        ["--out", "out"],
        ["--format", "csv"],
    ] {
        let args = [&["../fixtures/scenes", "--every-pass"], &flag[..]].concat();
        let output = verify(here(), &args);
        assert_eq!(output.status.code(), Some(2));
        assert!(
            stderr(&output).contains("is for one input"),
            "{}",
            stderr(&output)
        );
    }
}

/// Inputs at the edge of what floats and viewports can do: variants, and what the report says.
const EDGES: [(&str, &[&str], &[&str]); 7] = [
    (
        "two-contracts.toml",
        &[
            "preamble",
            "preamble:allow=rounding",
            "preamble:allow=rounding,hoist:budget=0.02",
        ],
        &["within rounding"],
    ),
    (
        "preamble-subnormal-uniform/scene.toml",
        &[
            "preamble:least=0",
            "preamble:allow=rounding",
            "hoist",
            "specialize,preamble",
            "visibility-buffer:form=compute,budget=0.02",
            "visibility-buffer:form=binned,budget=0.02",
        ],
        &["visibility-buffer[subnormal]"],
    ),
    (
        "preamble-subnormal-select/scene.toml",
        &[
            "preamble",
            "preamble:allow=rounding",
            "hoist",
            "visibility-buffer:form=compute,budget=0.02",
        ],
        &["visibility-buffer[subnormal]"],
    ),
    (
        "skip-taps-negative-zero-atan/scene.toml",
        &["skip-taps:threshold=0"],
        &["skip-taps[no-tap]"],
    ),
    (
        "skip-taps-negative-zero-reciprocal/scene.toml",
        &["skip-taps:threshold=0"],
        &["skip-taps[no-tap]"],
    ),
    (
        "nan-depth-reversed.toml",
        &[
            "early-discard",
            "early-discard:quad=lane",
            "early-discard:texture=packed",
        ],
        &["same picture"],
    ),
    (
        "frame-viewport",
        &[
            "visibility-buffer:budget=0.02",
            "visibility-buffer:select=tiles,budget=0.02",
            "visibility-buffer:form=binned,budget=0.02",
            "visibility-buffer:form=compute,budget=0.02",
        ],
        &["within budget"],
    ),
];

#[test]
fn promises_hold_at_the_edges() {
    let cases = here().join("../fixtures/cases/adv");
    for is_second in [false, true] {
        for (input, variants, says) in EDGES {
            let mut command = preshade(&cases);
            if is_second {
                command.env(VARIABLE, swiftshader());
            }
            // SwiftShader numbers no triangles.
            if is_second && input == "frame-viewport" {
                continue;
            }
            let variants = variants.iter().flat_map(|v| ["--variant", v]);
            let command = command
                .args(["verify", input, "--time", "no"])
                .args(variants);
            let output = command.output().unwrap();
            let text = String::from_utf8_lossy(&output.stdout);
            let status = output.status.code();
            assert!(
                matches!(status, Some(0 | 3)),
                "{input}: {}{text}",
                stderr(&output)
            );
            for word in says {
                assert!(text.contains(word), "{input}: {text}");
            }
        }
    }
}
