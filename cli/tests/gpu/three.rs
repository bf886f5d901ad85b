//! What preshade writes for WebGL 1, drawn by headless Chromium. The page of `tests/three` has a test of
//! its own, which `make hosts` runs: it needs the compiler as WebAssembly.
//!
//! Needed: node 20 or later with npm, and Chromium (`scripts/setup.sh three`). What is missing is a
//! failure, never a skipped test.

use crate::browser_support::Project;

/// What is written for WebGL 1 is drawn by WebGL 1, beside the author's text.
#[test]
fn webgl_1_draws_what_is_written_for_it() {
    let project = Project::installed("three");
    let fixture = |e: &str| format!("../../fixtures/glsl/dialects/es100-textured.{e}");
    let preshade = env!("CARGO_BIN_EXE_preshade");
    let arguments = ["webgl1.mjs", preshade, &fixture("vert"), &fixture("frag")];
    println!("{}", project.run("node", &arguments));
}
