//! `agree` over all fixtures, and the script of the GitHub Action.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::hostile_support::{self, stderr};

fn preshade() -> Command {
    hostile_support::preshade(Path::new(env!("CARGO_MANIFEST_DIR")))
}

fn nowhere(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&path);
    fs::create_dir_all(&path).unwrap();
    path
}

/// Fixtures and the texts that preshade makes of them are two texts of one material.
#[test]
fn no_fixture_raises_a_false_alarm_against_its_own_passes() {
    let mut compared = 0;
    let mut fixtures: Vec<PathBuf> = fs::read_dir("../fixtures/shaders")
        .unwrap()
        .map(|e| e.unwrap().path())
        .filter(|p| p.extension().is_some_and(|e| e == "wgsl"))
        .collect();
    fixtures.sort();
    for fixture in fixtures {
        let name = fixture.file_stem().unwrap().to_str().unwrap().to_owned();
        for (pass, role) in [("depth-prepass", "prepass"), ("shadow", "shadow")] {
            let out = nowhere(&format!("agree-{name}-{role}"));
            let mut rewrite = preshade();
            rewrite
                .arg("rewrite")
                .arg(&fixture)
                .args(["--pass", pass, "--name", "m"]);
            let made = rewrite.arg("-o").arg(&out).output().unwrap();
            assert_eq!(made.status.code(), Some(0), "{}", stderr(&made));
            let second = out.join(format!("m.{role}.wgsl"));
            if !second.exists() {
                // Refused.
                continue;
            }
            let mut agree = preshade();
            agree.arg("agree").arg(&fixture).arg("--with").arg(&second);
            let held = agree
                .args(["--as", role, "--inputs", "60"])
                .output()
                .unwrap();
            let said = String::from_utf8_lossy(&held.stdout).into_owned();
            assert!(!said.contains("error["), "{name}, {role}: {said}");
            compared += 1;
        }
    }
    assert!(compared > 40, "{compared}");
}

/// The same material in WGSL, and in what preshade writes of it in other languages.
#[test]
fn a_cross_compiled_shader_is_the_same() {
    for name in ["toon", "foliage", "pbr", "grid"] {
        let fixture = format!("../fixtures/shaders/{name}.wgsl");
        let out = nowhere(&format!("agree-{name}-languages"));
        let mut rewrite = preshade();
        rewrite.args(["rewrite", &fixture, "--name", "m", "--emit", "glsl,spirv"]);
        let made = rewrite.arg("-o").arg(&out).output().unwrap();
        assert_eq!(made.status.code(), Some(0), "{}", stderr(&made));
        let file = |name: &str| out.join(name).display().to_string();
        let glsl = format!("{},{}", file("m.main.vert"), file("m.main.frag"));
        let spirv = format!("{},{}", file("m.main.vert.spv"), file("m.main.frag.spv"));
        for with in [glsl, spirv] {
            let mut agree = preshade();
            agree.args([
                "agree", &fixture, "--with", &with, "--as", "discard", "--inputs", "60",
            ]);
            let held = agree.output().unwrap();
            let said = String::from_utf8_lossy(&held.stdout).into_owned();
            assert_eq!(
                held.status.code(),
                Some(0),
                "{with}: {said}{}",
                stderr(&held)
            );
        }
    }
}

fn git(folder: &Path, args: &[&str]) -> Output {
    let mut git = Command::new("git");
    git.args(["-c", "user.name=a", "-c", "user.email=a@example.org"]);
    let run = git.args(args).current_dir(folder).output().unwrap();
    assert!(run.status.success(), "{}", stderr(&run));
    run
}

/// The Action's script in a repository of two commits.
#[test]
fn the_action_reports_what_a_commit_changes() {
    let repository = nowhere("agree-action");
    let shaders = repository.join("shaders");
    fs::create_dir_all(&shaders).unwrap();
    let leaf = fs::read_to_string("../fixtures/agree/leaf.wgsl").unwrap();
    fs::write(shaders.join("leaf.wgsl"), &leaf).unwrap();
    let toon = fs::read_to_string("../fixtures/shaders/toon.wgsl").unwrap();
    fs::write(shaders.join("toon.wgsl"), toon).unwrap();
    git(&repository, &["init", "-q"]);
    git(&repository, &["add", "."]);
    git(&repository, &["commit", "-q", "-m", "one"]);
    let run = |fail_on: &str| {
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scripts/agree-action.sh");
        let summary = repository.join("summary.md");
        let _ = fs::remove_file(&summary);
        let mut bash = Command::new("bash");
        bash.arg(script).args(["shaders", "HEAD~1", "HEAD"]);
        bash.env("PRESHADE", env!("CARGO_BIN_EXE_preshade"));
        bash.env("GITHUB_STEP_SUMMARY", &summary)
            .env("FAIL_ON", fail_on);
        let ran = bash.current_dir(&repository).output().unwrap();
        (
            ran.status.code(),
            fs::read_to_string(&summary).unwrap_or_else(|_| stderr(&ran)),
        )
    };
    fs::write(repository.join("README"), "nothing of shaders").unwrap();
    git(&repository, &["add", "."]);
    git(&repository, &["commit", "-q", "-m", "two"]);
    assert_eq!(
        run("all"),
        (Some(0), "### Shaders: none changed\n".to_owned())
    );
    fs::write(
        shaders.join("leaf.wgsl"),
        leaf.replace("alpha < 0.5", "alpha < 0.4"),
    )
    .unwrap();
    git(&repository, &["commit", "-q", "-a", "-m", "three"]);
    let (status, summary) = run("all");
    assert_eq!(status, Some(1), "{summary}");
    assert!(summary.contains("### Shaders: 1 of 1 differ"), "{summary}");
    assert!(summary.contains("Unchanged: 1."), "{summary}");
    assert!(
        summary.contains("its threshold is 0.5, not 0.4"),
        "{summary}"
    );
    assert!(summary.contains("HEAD:shaders/leaf.wgsl:30"), "{summary}");
    assert_eq!(run("none").0, Some(0));
}
