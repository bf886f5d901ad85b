//! What `preshade plan --out` leaves behind: shaders, plans, the decision.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

const SCENE: &str = "../fixtures/scenes/overdraw-5.toml";

/// A folder below which nothing is yet.
fn nowhere(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&path);
    path
}

/// `preshade plan` of the scene, without a clock: what it chooses is the same everywhere.
fn plan(args: &[&str]) {
    let output = Command::new(env!("CARGO_BIN_EXE_preshade"))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(["plan", SCENE, "--size", "320x180", "--time", "no"])
        .args(args)
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
}

#[test]
fn a_switch_has_a_folder_for_either_side() {
    let out = nowhere("plan-switch");
    plan(&["--out", out.to_str().unwrap()]);
    for file in [
        "decision.json",
        "report.csv",
        "report.html",
        "below/marble.main.wgsl",
        "below/marble.plan.json",
        "above/marble.main.wgsl",
        "above/marble.plan.json",
    ] {
        assert!(out.join(file).is_file(), "{file}");
    }
    let text = fs::read_to_string(out.join("decision.json")).unwrap();
    let decision: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(decision["schema"], "preshade.decision.v2");
    assert_eq!(decision["clock"], serde_json::Value::Null);
    let policy = &decision["policy"][0];
    assert_eq!(policy["kind"], "switch");
    assert_eq!(policy["orders"].as_array().unwrap().len(), 3);
    assert!(policy["off"].as_f64().unwrap() < policy["on"].as_f64().unwrap());
    let above = &decision["plans"][policy["above"].as_u64().unwrap() as usize];
    assert!(
        above["recipes"]["marble"]
            .as_str()
            .unwrap()
            .starts_with("depth-prepass")
    );
    assert_eq!(
        decision["materials"][0]["draws"].as_array().unwrap().len(),
        5
    );
}
