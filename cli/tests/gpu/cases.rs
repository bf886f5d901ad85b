//! Cases that were once answered wrongly (`fixtures/cases`), each with the right answer.

use std::process::{Command, Output};

use crate::swiftshader_support::{VARIABLE, swiftshader};

fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_preshade"));
    command
        .current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/cases"))
        .args(arguments);
    command
}

fn run(arguments: &[&str]) -> Output {
    command(arguments).output().unwrap()
}

fn said(output: &Output) -> String {
    let [out, err] = [&output.stdout, &output.stderr].map(|b| String::from_utf8_lossy(b));
    format!("{out}{err}")
}

/// The verdict and the error of the variant of a `verify --format json`.
fn variant(output: &Output) -> (String, serde_json::Value) {
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let variant = &report["variants"][1];
    (
        variant["verdict"]["kind"].to_string(),
        variant["error"].clone(),
    )
}

#[test]
fn a_budget_sees_all_that_a_pass_writes() {
    let hoist = "hoist:budget=0.000001,metric=flip_tile,finite=assumed,jumps=carried";
    let cases = [
        ("adv/flip-hdr.toml", hoist),
        ("adv/flip-gbuffer.toml", hoist),
        ("adv/flip-half-rate.toml", "half-rate:budget=0.001,least=0"),
    ];
    for (scene, recipe) in cases {
        let arguments = [
            "verify",
            scene,
            "--time",
            "no",
            "--format",
            "json",
            "--variant",
            recipe,
        ];
        let output = run(&arguments);
        let code = output.status.code();
        let (verdict, error) = variant(&output);
        // It is over its budget, or it leaves the picture alone.
        let max_abs = error["max_abs"].as_f64().unwrap_or(f64::INFINITY);
        let is_ruined =
            !error.is_null() && max_abs > 0.01 || error["nan_pixels"].as_u64() > Some(0);
        assert!(
            code == Some(1) || (code == Some(3) && error.is_null()) || !is_ruined,
            "{scene}: {verdict} {error}"
        );
        assert!(
            !is_ruined || error["flip_tile"].as_f64() > Some(0.01),
            "{scene}: {error}"
        );
    }
}

/// The headline of a recipe for outputs is about them, and the folder has a picture of each.
#[test]
fn outputs_are_headlined_by_what_they_are_for() {
    let folder = tempfile::tempdir().unwrap();
    let output = command(&[
        "verify",
        "newcomer/outputs-headline.wgsl",
        "--pass",
        "outputs:write=velocity",
        "--size",
        "160x90",
        "--time",
        "no",
        "--out",
    ])
    .arg(folder.path())
    .output()
    .unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    let headline = text.lines().next().unwrap_or_default();
    assert!(
        headline.contains("has velocities right to 0.0000 pixels"),
        "{text}"
    );
    let picture = folder.path().join("outputs-write-velocity.velocity.png");
    assert!(picture.exists(), "{}", said(&output));
}

/// `x / 0` is `x`, for the original as for the variant.
#[test]
fn divisors_of_zero_are_checked_as_in_browsers() {
    let arguments = [
        "verify",
        "adv/division-by-zero.toml",
        "--time",
        "no",
        "--variant",
        "specialize",
    ];
    let output = command(&arguments)
        .env(VARIABLE, swiftshader())
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
}

/// In software: a loop without end hangs a GPU.
#[test]
fn no_command_draws_a_loop_that_may_not_end() {
    let commands: [&[&str]; 4] = [
        &["verify", "--pass", "depth-prepass", "--time", "no"],
        &["plan", "--time", "no"],
        &["profile", "--seconds", "0.1"],
        &["explore", "--seconds", "5"],
    ];
    for arguments in commands {
        let all = [
            arguments,
            &["loop-that-may-not-end.wgsl", "--adapter", "llvmpipe"],
        ]
        .concat();
        let output = run(&all);
        let said = said(&output);
        assert_eq!(output.status.code(), Some(3), "{arguments:?}: {said}");
        assert!(
            said.contains(
                "ot measured: the loop at line 9 of `loop-that-may-not-end.wgsl` did not end"
            ),
            "{arguments:?}: {said}"
        );
    }
}

#[test]
fn nothing_is_decided_on_an_empty_picture() {
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("empty-picture");
    std::fs::create_dir_all(&folder).unwrap();
    let text = "struct U { mvp: mat4x4<f32> }
@group(0) @binding(0) var<uniform> u: U;
@vertex fn vs(@location(0) position: vec3<f32>) -> @builtin(position) vec4<f32> { return u.mvp * vec4(position, 1.0); }
@fragment fn fs() -> @location(0) vec4<f32> { return vec4(1.0); }";
    std::fs::write(folder.join("plain.wgsl"), text).unwrap();
    let scene = |name: &str, target: &str, state: &str| {
        let text = format!(
            "size = [64, 64]
[materials.m]
shader = \"plain.wgsl\"
{state}
[meshes]
ball.sphere = {{ radius = 1.0, segments = 12, rings = 6 }}
[[draws]]
mesh = \"ball\"
material = \"m\"
[[cameras]]
eye = [0, 0, 4]
target = {target}
"
        );
        let file = folder.join(name);
        std::fs::write(&file, text).unwrap();
        file.to_string_lossy().into_owned()
    };
    let cases = [
        (scene("aside.toml", "[0, 0, 9]", ""), "outside"),
        (
            scene(
                "culled.toml",
                "[0, 0, 0]",
                "state.depth_compare = \"greater\"",
            ),
            "depth",
        ),
    ];
    let commands: [&[&str]; 5] = [
        &["verify", "--pass", "depth-prepass", "--time", "no"],
        &["plan", "--time", "no"],
        &["plan", "--seconds", "0.1"],
        &["profile", "--seconds", "0.1"],
        &["explore", "--seconds", "5"],
    ];
    for (scene, reason) in &cases {
        for arguments in commands {
            let output = run(&[arguments, &[scene.as_str()]].concat());
            let said = said(&output);
            assert_eq!(
                output.status.code(),
                Some(3),
                "{arguments:?} {scene}: {said}"
            );
            assert!(
                arguments[0] == "verify" || said.contains(reason),
                "{arguments:?} {scene}: {said}"
            );
        }
    }
}
