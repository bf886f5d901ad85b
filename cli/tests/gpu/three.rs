//! The client of `tests/three`: three.js in headless Chromium draws what preshade makes of its
//! materials, and its pictures are compared. Screenshots go to `out/three`.
//!
//! Needed: node 18 or later with npm, and Chromium (`scripts/setup.sh three`). What is missing is a
//! failure, never a skipped test.

use crate::browser_support::Project;

#[test]
fn three_js_draws_the_same_pictures() {
    let project = Project::installed("three");
    project.run(
        project.path("node_modules/.bin/prettier"),
        &["--check", "."],
    );
    let made = project.run("node", &["build.mjs", env!("CARGO_BIN_EXE_preshade")]);
    for material in ["stone", "leaf", "bronze"] {
        let applied =
            format!("prepass-equal of {material}: dist/prepass-equal/{material}.plan.json");
        assert!(made.contains(&applied), "{made}");
    }
    let screenshots = project.path("../../out/three");
    println!(
        "{}",
        project.run("node", &["test.mjs", screenshots.to_str().unwrap()])
    );
}

/// What is written for WebGL 1 is drawn by WebGL 1, beside the author's text.
#[test]
fn webgl_1_draws_what_is_written_for_it() {
    let project = Project::installed("three");
    let fixture = |e: &str| format!("../../fixtures/glsl/dialects/es100-textured.{e}");
    let preshade = env!("CARGO_BIN_EXE_preshade");
    let arguments = ["webgl1.mjs", preshade, &fixture("vert"), &fixture("frag")];
    println!("{}", project.run("node", &arguments));
}
