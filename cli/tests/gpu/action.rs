//! The script of the GitHub Action, which draws a scene.

use std::path::Path;
use std::process::Command;

use crate::hostile_support::stderr;

#[test]
fn the_action_tells_whether_a_variant_breaks_its_promise() {
    let scripts = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scripts");
    let run = |scene: &str, passes: &str| {
        let mut bash = Command::new("bash");
        bash.arg(scripts.join("action.sh"))
            .args(["verify", scene, passes]);
        bash.env("PRESHADE", env!("CARGO_BIN_EXE_preshade"));
        bash.env("PRESHADE_SIZE", "48x32");
        bash.env_remove("GITHUB_STEP_SUMMARY");
        let ran = bash.output().unwrap();
        let report = String::from_utf8_lossy(&ran.stdout).into_owned();
        (ran.status.code(), report + &stderr(&ran))
    };
    let scene = "../fixtures/scenes/first.toml";
    let (status, said) = run(scene, "depth-prepass early-alpha,depth-prepass");
    assert_eq!(status, Some(0), "{said}");
    assert!(
        said.starts_with(&format!("### `{scene}`: no promise is broken\n\n```text\n")),
        "{said}"
    );
    assert!(
        said.contains("early-alpha + depth-prepass  same picture"),
        "{said}"
    );
    let shader = "../fixtures/pages/rock.wgsl";
    let (status, said) = run(shader, "skip-taps:budget=0.000001,threshold=0.1");
    assert_eq!(status, Some(1), "{said}");
    let broken = format!("### `{shader}`: a variant broke its promise\n");
    assert!(said.starts_with(&broken), "{said}");
    let (status, said) = run("absent.toml", "");
    assert_eq!(status, Some(2), "{said}");
    assert!(
        said.starts_with("### `absent.toml`: could not be drawn"),
        "{said}"
    );
}
