//! Transcripts of commands that draw, and a scene made up for a bare shader.

use std::fs;
use std::path::Path;

use crate::capture_support;
use crate::hostile_support::{run, stderr};

const TOON: &str = "../fixtures/shaders/toon.wgsl";

/// Every transcript in `tests/cmd/gpu`. `TRYCMD=overwrite` updates them.
#[test]
fn transcripts() {
    trycmd::TestCases::new()
        .env("COLUMNS", "100")
        .env("NO_COLOR", "1")
        .env("PRESHADE_PROGRESS", "no")
        .case("tests/cmd/gpu/*.md");
}

#[test]
fn explore_takes_another_pass_of_a_captured_frame() {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let frame = capture_support::folder().write("explored");
    // The first pass fills a texture, the second draws the quads.
    for (pass, found) in [("0", "pipeline-0"), ("1", "quads")] {
        let explore = ["explore", frame.to_str().unwrap(), "--render-pass", pass];
        let output = run(here, &[&explore[..], &["--seconds", "3"]].concat());
        let said = stderr(&output);
        assert!(matches!(output.status.code(), Some(0 | 3)), "{said}");
        assert!(said.contains(&format!("take: `{found}`")), "{said}");
    }
    fs::remove_dir_all(frame).unwrap();
}

#[test]
fn what_a_bare_shader_was_given_is_told() {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let output = run(
        here,
        &[
            "verify", TOON, "--size", "32x32", "--time", "no", "--pass", "shadow", "--format",
            "json",
        ],
    );
    let said = stderr(&output);
    // In so small a picture the noise has one level, by which no fragment is discarded: not measured.
    assert!(matches!(output.status.code(), Some(0 | 3)), "{said}");
    assert!(
        said.starts_with("note: a scene was made up for `toon`, with these inputs guessed"),
        "{said}"
    );
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let assumed = report["assumed"].as_array().unwrap();
    let of = |guess: &str| assumed.iter().filter(|a| a["guess"] == guess).count();
    assert!(
        of("uniform-by-name") > 0 && of("uniform-made-up") > 0,
        "{assumed:?}"
    );
    for a in assumed {
        assert!(said.contains(a["name"].as_str().unwrap()), "{a}");
    }
}
