//! Every command in the README runs as it stands in a checkout.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .unwrap()
        .to_owned()
}

/// A folder with the fixtures, as in a checkout.
fn project() -> PathBuf {
    let project = Path::new(env!("CARGO_TARGET_TMPDIR")).join("readme");
    let _ = fs::remove_dir_all(&project);
    copy(&root().join("fixtures"), &project.join("fixtures"));
    project
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let to = to.join(entry.file_name());
        match entry.file_type().unwrap().is_dir() {
            true => copy(&entry.path(), &to),
            false => drop(fs::copy(entry.path(), to).unwrap()),
        }
    }
}

/// The lines of the README's shell blocks that call preshade, without comments and what the output
/// is piped to.
fn commands() -> Vec<String> {
    let readme = fs::read_to_string(root().join("README.md")).unwrap();
    let blocks = readme.split("```sh\n").skip(1);
    let lines = blocks.flat_map(|b| b.split("```").next().unwrap().lines());
    let lines = lines.filter(|l| l.starts_with("preshade "));
    lines
        .map(|l| {
            l.split(" #")
                .next()
                .unwrap()
                .split(" | ")
                .next()
                .unwrap()
                .trim()
                .to_owned()
        })
        .collect()
}

#[test]
fn every_command_in_the_readme_runs() {
    let project = project();
    let commands = commands();
    assert!(commands.len() >= 6, "{commands:?}");
    for command in commands {
        let words: Vec<&str> = command.split_whitespace().skip(1).collect();
        let mut run = Command::new(env!("CARGO_BIN_EXE_preshade"));
        run.args(&words).current_dir(&project).stdin(Stdio::null());
        let draws = ["verify", "explore", "plan"].contains(&words[0]) || words.contains(&"--scene");
        if draws {
            // As small as it gets: what is shown elsewhere is that the figures are right.
            run.env("PRESHADE_SIZE", "32x24");
            run.envs([("PRESHADE_FRAMES", "1"), ("PRESHADE_SECONDS", "0.05")]);
            run.env("PRESHADE_ORDER", "front-to-back");
        }
        let output = run.output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{command}\n{said}");
        let quiet = words[0] == "rewrite";
        assert!(quiet || !output.stdout.is_empty(), "{command} says nothing");
    }
}
