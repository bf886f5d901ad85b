//! A HyperQueue server with three workers runs a list as one machine does, though a worker is killed.
//!
//! Needed: HyperQueue's Python package in `tests/fleet/.venv`, a C compiler and Vulkan's headers
//! (`scripts/setup.sh fleet`). What is missing is a failure, never a skipped test.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use serde_json::Value;

use crate::hostile_support::{accepted, ended, preshade, slow, stderr, wait};
use crate::schedulers::{INSTALL, empty, list, program, python, results, scene, script, support};

/// A process that ends with the test.
struct Ends(Child);

impl Drop for Ends {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Variables for a driver that loses the device of jobs of `lost.toml`.
fn losing(dir: &Path) -> [(&'static str, PathBuf); 2] {
    let layer = dir.join("layer");
    fs::create_dir_all(&layer).unwrap();
    fs::copy(support().join("lost.json"), layer.join("lost.json")).unwrap();
    let mut cc = Command::new("cc");
    cc.args(["-shared", "-fPIC", "-Wall", "-Wextra", "-Werror", "-o"]);
    cc.arg(layer.join("lost.so")).arg(support().join("lost.c"));
    let built = cc.output().unwrap_or_else(|e| panic!("cc: {e}: {INSTALL}"));
    assert!(built.status.success(), "{}: {INSTALL}", stderr(&built));
    [
        ("VK_LAYER_PATH", layer),
        ("VK_INSTANCE_LAYERS", "VK_LAYER_PRESHADE_lost".into()),
    ]
}

/// Notes which process starts which job, and runs it.
const NOTES: &str = r#"#!/bin/sh
job=$(cat)
key=$(printf '%s' "$job" | sed 's/.*"key":"\([0-9a-f]*\)".*/\1/')
echo "$PPID $key" >> "$STARTS"
exec "$PRESHADE_PROGRAM" "$@" <<END
$job
END
"#;

/// The starts that [`NOTES`] noted: process and key.
fn starts(file: &Path) -> Vec<(u32, String)> {
    let text = fs::read_to_string(file).unwrap_or_default();
    let words = text.lines().filter_map(|line| line.split_once(' '));
    words
        .map(|(process, key)| (process.parse().unwrap(), key.to_owned()))
        .collect()
}

#[test]
fn hyperqueue_runs_a_list_as_one_machine_does_though_a_worker_is_killed() {
    let dir = empty("hyperqueue");
    let mut scenes = Vec::new();
    for i in 0..99 {
        let name = format!("a {i}");
        scene(
            &dir,
            &name,
            &format!("if at.x < {i}.0 {{ return vec4(0.1); }}"),
        );
        scenes.push(format!("{name}.toml"));
    }
    let mut args = vec!["--variant", "depth-prepass"];
    args.extend(["--variant", "depth-prepass:form=equal"]);
    args.extend(scenes.iter().map(String::as_str));
    let jobs = "the 'jobs'.jsonl";
    list(&dir, jobs, &args);
    scene(&dir, "lost", "");
    scene(&dir, "slow", &slow());
    list(&dir, jobs, &["--variant", "depth-prepass", "lost.toml"]);
    let limited = ["--limits", "seconds=6", "--variant", "depth-prepass"];
    let count = list(&dir, jobs, &[&limited[..], &["slow.toml"]].concat());
    assert_eq!(count, 200);
    let text = fs::read_to_string(dir.join(jobs)).unwrap();
    let key = |line: &str| serde_json::from_str::<Value>(line).unwrap()["key"].clone();
    let keys: Vec<String> = text
        .lines()
        .map(|line| key(line).as_str().unwrap().to_owned())
        .collect();
    let layer = losing(&dir);

    // One machine.
    let whole = ["evaluate", "--jobs", jobs, "--out", "whole"];
    let output = preshade(&dir)
        .args(whole)
        .args(["--workers", "2"])
        .envs(layer.clone())
        .output()
        .unwrap();
    let said = ended(&output, 0, &whole);
    assert!(
        said.contains("200 jobs: 198 measured, 0 of them broken; 2 failed"),
        "{said}"
    );
    accepted(&dir, &["merge", "whole", "-o", "whole.json"]);

    // A server and three workers.
    let server = dir.join("server");
    let log = dir.join("starts");
    let path = program(&dir, "preshade", NOTES);
    let start = |args: &[&str]| {
        let mut command = python();
        command.arg(support().join("cluster.py")).args(args);
        command.current_dir(&dir).envs(layer.clone());
        command.env("PATH", &path).env("STARTS", &log);
        command.env("PRESHADE_PROGRAM", env!("CARGO_BIN_EXE_preshade"));
        command.stdin(Stdio::piped()).stdout(Stdio::null());
        Ends(command.spawn().unwrap())
    };
    let mut first = start(&["server", "server"]);
    let access = server.join("hq-current/access.json");
    wait(&mut first.0, "the server", || access.exists().then_some(()));
    let mut workers = ["w1", "w2", "w3"].map(|own| start(&["worker", "server", own]));
    let printed = script(
        &dir,
        &["hyperqueue", "--jobs", jobs, "--out", "the results"],
    );
    fs::write(dir.join("fleet.py"), printed).unwrap();
    let mut tasks = python();
    tasks
        .arg("fleet.py")
        .current_dir(&dir)
        .env("HQ_SERVER_DIR", &server);
    tasks.stderr(fs::File::create(dir.join("progress")).unwrap());
    let mut tasks = Ends(tasks.spawn().unwrap());

    // A worker is killed while it runs a job.
    let out = dir.join("the results");
    let is_plain = |key: &String| keys[..198].contains(key);
    let (worker, lost) = wait(&mut tasks.0, "a job in the middle", || {
        let (worker, key) = starts(&log).pop().filter(|(_, key)| is_plain(key))?;
        let done = results(&out);
        (done.len() >= 60 && !done.contains_key(&key)).then_some((worker, key))
    });
    let killed = workers.iter_mut().find(|w| w.0.id() == worker).unwrap();
    killed.0.kill().unwrap();
    killed.0.wait().unwrap();
    let before = results(&out);
    let status = tasks.0.wait().unwrap();
    let said = fs::read_to_string(dir.join("progress")).unwrap();
    assert!(status.success(), "{said}");

    // No other job ran twice, and none is missing.
    assert!(before.len() < 190, "the worker was killed at the end");
    let after = results(&out);
    for (key, time) in &before {
        assert_eq!(after.get(key), Some(time), "{key} was written twice");
    }
    let mut times: BTreeMap<String, usize> = BTreeMap::new();
    for (_, key) in starts(&log) {
        *times.entry(key).or_default() += 1;
    }
    let twice: Vec<&String> = times
        .iter()
        .filter(|(_, n)| **n > 1)
        .map(|(k, _)| k)
        .collect();
    assert_eq!((twice, times[&lost]), (vec![&lost], 2));
    let ran: BTreeSet<&String> = times.keys().collect();
    assert_eq!(ran, keys.iter().collect());
    accepted(&dir, &["merge", "the results", "-o", "parts.json"]);
    // On a machine that is busy, the slow job may be stopped before it draws its original.
    let read = |name: &str| {
        let text = fs::read_to_string(dir.join(name)).unwrap();
        text.replace(
            "the original was not measured: it was stopped",
            "it was stopped",
        )
    };
    let (merged, parts) = (read("whole.json"), read("parts.json"));
    let lines = merged.lines().zip(parts.lines());
    let differ: Vec<_> = lines.filter(|(a, b)| a != b).take(9).collect();
    assert!(merged == parts, "the merges differ: {differ:#?}");
    for reason in ["device-lost", "timed-out"] {
        let said = format!("\"reason\": \"{reason}\"");
        assert_eq!(merged.matches(&said).count(), 1, "{reason}");
    }
    // Messages of tasks are kept only where one failed.
    let mut files = fs::read_dir(&dir).unwrap();
    assert!(!files.any(|f| {
        f.unwrap()
            .file_name()
            .to_string_lossy()
            .ends_with(".stderr")
    }));
}
