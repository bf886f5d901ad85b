//! The reports of `verify`, `plan` and `explore` in headless Chromium: no rule of axe broken, by
//! keyboard, in light and dark, narrow and on paper. Screenshots go to `out/page`.
//!
//! Needed: node 18 or later with npm, and Chromium (`scripts/setup.sh three`). What is missing is a
//! failure, never a skipped test.

use std::fs;
use std::path::Path;

use crate::browser_support::{Project, run};

const SCENE: &str = "../fixtures/scenes/overdraw-5.toml";
const MUSEUM: &str = "../fixtures/scenes/museum.toml";

#[test]
fn the_reports_can_be_read_by_everyone() {
    let project = Project::installed("page");
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let out = Path::new(env!("CARGO_TARGET_TMPDIR")).join("page");
    let _ = fs::remove_dir_all(&out);
    let runs: [(&str, &[&str]); 4] = [
        (
            "verify",
            &[
                "verify",
                SCENE,
                "--size",
                "160x90",
                "--seconds",
                "0.1",
                "--frames",
                "2",
                "--variant",
                "depth-prepass",
                "--variant",
                "early-discard",
                "--variant",
                "hoist:budget=1,threshold=1",
            ],
        ),
        (
            "plan",
            &[
                "plan",
                SCENE,
                "--size",
                "160x90",
                "--seconds",
                "0.1",
                "--frames",
                "1",
                "--runners",
                "2",
            ],
        ),
        (
            "plan-museum",
            &[
                "plan", MUSEUM, "--size", "160x90", "--time", "no", "--frames", "1",
            ],
        ),
        (
            "explore",
            &[
                "explore",
                SCENE,
                "--size",
                "96x54",
                "--seconds",
                "8",
                "--variant",
                "depth-prepass",
                "--variant",
                "hoist:budget=1,threshold=1",
            ],
        ),
    ];
    let mut reports = Vec::new();
    for (name, arguments) in runs {
        let folder = out.join(name);
        let mut arguments = arguments.to_vec();
        arguments.extend(["--out", folder.to_str().unwrap()]);
        run(env!("CARGO_BIN_EXE_preshade"), &arguments, here);
        reports.push(folder.join("report.html"));
        // What a spreadsheet gets has as many cells in each line as names above them.
        let csv = fs::read_to_string(folder.join("report.csv")).unwrap();
        assert!(csv.lines().count() > 1, "{name}: {csv}");
    }
    let screenshots = project.path("../../out/page");
    let mut arguments = vec!["check.mjs", screenshots.to_str().unwrap()];
    arguments.extend(reports.iter().map(|r| r.to_str().unwrap()));
    println!("{}", project.run("node", &arguments));
}
