//! The client of `tests/three`: three.js in headless Chromium draws what preshade makes of its
//! materials, and its pictures are compared. Screenshots go to `out/three`.
//!
//! Needed: node 18 or later with npm, and Chromium (`scripts/setup.sh three`). What is missing is a
//! failure, never a skipped test.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Mutex;

fn project() -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    root.join("tests/three")
}

/// Runs it in the project's folder, and gives back what it said.
fn run(program: impl AsRef<Path>, arguments: &[&str]) -> String {
    let program = program.as_ref();
    let mut command = Command::new(program);
    let output = command.args(arguments).current_dir(project()).output();
    let output =
        output.unwrap_or_else(|e| panic!("{}: {e} (scripts/setup.sh three)", program.display()));
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    let complained = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{command:?}\n{said}\n{complained}");
    said
}

/// The packages of the lock file, where those that are there are not newer. One test at a time puts
/// them there.
fn install() {
    static ONE: Mutex<()> = Mutex::new(());
    let _one = ONE.lock();
    let modified = |path: &str| fs::metadata(project().join(path)).and_then(|m| m.modified());
    let locked = modified("package-lock.json").unwrap();
    if modified("node_modules/.package-lock.json").map_or(true, |there| there < locked) {
        run("npm", &["ci", "--no-audit", "--no-fund", "--silent"]);
    }
}

#[test]
fn three_js_draws_the_same_pictures() {
    install();
    run(
        project().join("node_modules/.bin/prettier"),
        &["--check", "."],
    );
    let made = run("node", &["build.mjs", env!("CARGO_BIN_EXE_preshade")]);
    for material in ["stone", "leaf", "bronze"] {
        let applied =
            format!("prepass-equal of {material}: dist/prepass-equal/{material}.plan.json");
        assert!(made.contains(&applied), "{made}");
    }
    let screenshots = project().join("../../out/three");
    println!(
        "{}",
        run("node", &["test.mjs", screenshots.to_str().unwrap()])
    );
}

/// What is written for WebGL 1 is drawn by WebGL 1, beside the author's text.
#[test]
fn webgl_1_draws_what_is_written_for_it() {
    install();
    let fixture = |e: &str| format!("../../fixtures/glsl/dialects/es100-textured.{e}");
    let preshade = env!("CARGO_BIN_EXE_preshade");
    let arguments = ["webgl1.mjs", preshade, &fixture("vert"), &fixture("frag")];
    println!("{}", run("node", &arguments));
}
