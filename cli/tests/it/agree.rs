//! The script of `agree`'s GitHub Action.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::hostile_support::stderr;

/// An empty folder for a test.
pub fn nowhere(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&path);
    fs::create_dir_all(&path).unwrap();
    path
}

/// What git does in a folder.
pub fn git(folder: &Path, args: &[&str]) -> Output {
    let mut git = Command::new("git");
    git.args(["-c", "user.name=a", "-c", "user.email=a@example.org"]);
    let run = git.args(args).current_dir(folder).output().unwrap();
    assert!(run.status.success(), "{}", stderr(&run));
    run
}

/// Folders of revisions: what is renamed, and a file of pairs.
#[test]
fn revisions_have_renamed_files_and_pairs() {
    let repository = nowhere("agree-revisions");
    let shaders = repository.join("shaders");
    fs::create_dir_all(&shaders).unwrap();
    let copy = |from: &str, to: &str| {
        fs::copy(format!("../fixtures/{from}"), shaders.join(to)).unwrap();
    };
    copy("agree/leaf.wgsl", "leaf.wgsl");
    copy("agree/leaf.shadow.wgsl", "shadow.wgsl");
    copy("shaders/toon.wgsl", "toon.wgsl");
    git(&repository, &["init", "-q"]);
    git(&repository, &["add", "."]);
    git(&repository, &["commit", "-q", "-m", "one"]);
    git(
        &repository,
        &["mv", "shaders/toon.wgsl", "shaders/comic.wgsl"],
    );
    git(&repository, &["rm", "-q", "shaders/shadow.wgsl"]);
    git(&repository, &["commit", "-q", "-m", "two"]);
    let pairs = "
        [[pair]]
        name = 'leaf'
        first = 'leaf.wgsl'
        second = 'shadow.wgsl'
        as = 'shadow'
        [[waiver]]
        pair = 'leaf'
        class = 'loses'
        reason = 'nobody knows whether it is needed where the pair cannot be read'";
    fs::write(repository.join("agree.toml"), pairs).unwrap();
    let run = |args: &[&str]| {
        let mut preshade = Command::new(env!("CARGO_BIN_EXE_preshade"));
        let ran = preshade.arg("agree").args(args).current_dir(&repository);
        let ran = ran.output().unwrap();
        let said = String::from_utf8_lossy(&ran.stdout).into_owned();
        (ran.status.code(), said + &stderr(&ran))
    };
    let (status, said) = run(&["HEAD~1:shaders", "HEAD:shaders", "--as", "same"]);
    assert_eq!(status, Some(0), "{said}");
    assert!(
        said.contains("toon.wgsl is comic.wgsl in HEAD:shaders"),
        "{said}"
    );
    assert!(
        said.contains("shadow.wgsl is only in HEAD~1:shaders"),
        "{said}"
    );
    let (status, said) = run(&["HEAD~1:shaders", "--pairs", "agree.toml"]);
    assert_eq!(status, Some(0), "{said}");
    assert!(said.contains("not needed any more"), "{said}");
    let (status, said) = run(&["HEAD:shaders", "--pairs", "agree.toml"]);
    assert_eq!(status, Some(2), "{said}");
    assert!(said.contains("HEAD:shaders/shadow.wgsl"), "{said}");
    assert!(!said.contains("waiver"), "{said}");
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
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scripts/action.sh");
        let summary = repository.join("summary.md");
        let _ = fs::remove_file(&summary);
        let mut bash = Command::new("bash");
        bash.arg(script)
            .args(["agree", "shaders", "HEAD~1", "HEAD"]);
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
