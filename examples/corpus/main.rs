//! What preshade makes of other people's shaders: folders of WGSL, GLSL or SPIR-V, material by
//! material.
//!
//! ```text
//! cargo run --release --all-features --example corpus -- [--judge] [--json FILE] [--keep DIR] [--limit SECONDS] [--jobs N] [--include DIR].. [--no-passes] [--only EXTENSION].. FOLDER..
//! cargo run --release --all-features --example corpus -- --print FILE [FILE]
//! cargo run --release --all-features --example corpus -- --time FILE [FILE]
//! ```
//!
//! A material is a WGSL or SPIR-V file, a file with `#pragma stage` lines, or two GLSL files of one
//! name: `.vert` and `.frag`, `.vs` and `.fs`. A fragment shader by itself gets a made vertex stage
//! that writes what it reads. Each material prints a line: whether it is read, what each pass and
//! each target says, and what is wrong.
//!
//! `--judge` has every author's text and every written text judged: by Tint, spirv-val and
//! glslangValidator. It also compares the interface that spirv-cross reflects of SPIR-V and Vulkan's
//! GLSL with that of the author's words. All tools must be on the `PATH`. `--json` writes one object
//! a line and a material. `--only` leaves out files that end otherwise. `--keep` keeps what is written. `--print` shows what each is as WGSL;
//! `--time` what reading takes.
//!
//! The exit status is 1 if there is an invalid output, a bug, a difference of reflection, a panic
//! or a material that takes longer than 60 s (`--limit`).
#![allow(
    clippy::unwrap_used,
    clippy::panic,
    reason = "a tool that ends with a message"
)]

mod cases;
mod judges;
mod material;
mod one;
mod record;
mod sayable;
mod summary;

#[path = "../../tests/support/reflection_support.rs"]
mod reflection_support;

use std::io::{Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use cases::Case;
use record::Record;

/// What the command line says.
#[derive(Clone, Debug, Default)]
struct Arguments {
    paths: Vec<PathBuf>,
    include: Vec<PathBuf>,
    json: Option<PathBuf>,
    keep: Option<PathBuf>,
    limit: Option<u64>,
    jobs: Option<usize>,
    judge: bool,
    no_passes: bool,
    /// The extensions of the files to look at; all if empty.
    only: Vec<String>,
    /// `--print`, `--time`, or `--one`, which is how a run starts itself for a material.
    mode: Option<String>,
}

fn arguments() -> Arguments {
    let mut read = Arguments::default();
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut value = || {
            let next = words.next();
            next.unwrap_or_else(|| panic!("{word} needs a value"))
        };
        match word.as_str() {
            "--include" => read.include.push(value().into()),
            "--only" => read.only.push(value()),
            "--json" => read.json = Some(value().into()),
            "--keep" => read.keep = Some(value().into()),
            "--limit" => read.limit = value().parse().ok(),
            "--jobs" => read.jobs = value().parse().ok(),
            "--judge" => read.judge = true,
            "--no-passes" => read.no_passes = true,
            "--print" | "--time" | "--one" => read.mode = Some(word),
            other if other.starts_with("--") => panic!("there is no option {other}"),
            _ => read.paths.push(word.into()),
        }
    }
    assert!(!read.paths.is_empty(), "name a folder or more");
    read
}

fn main() {
    let arguments = arguments();
    match arguments.mode.as_deref() {
        Some("--print") => return one::print(&arguments.paths, &arguments.include),
        Some("--time") => return one::time(&arguments.paths, &arguments.include),
        Some(_) => {
            let record = material::looked_at(&arguments);
            println!("{}", serde_json::to_string(&record).unwrap());
            return;
        }
        None => {}
    }
    if arguments.judge {
        judges::all_there();
    }
    let cases: Vec<Case> = {
        let folders = arguments.paths.iter();
        folders
            .flat_map(|p| cases::of(p, &arguments.only))
            .collect()
    };
    let records = all(&cases, &arguments);
    if let Some(path) = &arguments.json {
        let line = |r: &Record| serde_json::to_string(r).unwrap() + "\n";
        std::fs::write(path, records.iter().map(line).collect::<String>()).unwrap();
    }
    let is_good = summary::print(&records, &arguments.paths);
    if !is_good {
        std::process::exit(1);
    }
}

/// Each case in a process of its own, so that none ends the run: some at a time, told in order.
fn all(cases: &[Case], arguments: &Arguments) -> Vec<Record> {
    let next = AtomicUsize::new(0);
    let found: Mutex<Vec<Option<Record>>> = Mutex::new(vec![None; cases.len()]);
    let printed = Mutex::new(0);
    let processors = std::thread::available_parallelism().map_or(1, Into::into);
    let work = || {
        loop {
            let i = next.fetch_add(1, Ordering::Relaxed);
            let Some(case) = cases.get(i) else { return };
            let record = record_of(case, arguments);
            found.lock().unwrap()[i] = Some(record);
            let mut printed = printed.lock().unwrap();
            let found = found.lock().unwrap();
            while let Some(Some(record)) = found.get(*printed) {
                println!("{record}");
                *printed += 1;
            }
            std::io::stdout().flush().ok();
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..arguments.jobs.unwrap_or(processors).max(1) {
            scope.spawn(work);
        }
    });
    let found = found.into_inner().unwrap();
    found.into_iter().flatten().collect()
}

fn record_of(case: &Case, arguments: &Arguments) -> Record {
    let mut command = Command::new(std::env::current_exe().unwrap());
    command.arg("--one").args(&case.paths);
    for folder in &arguments.include {
        command.arg("--include").arg(folder);
    }
    if arguments.judge {
        command.arg("--judge");
    }
    if arguments.no_passes {
        command.arg("--no-passes");
    }
    if let Some(keep) = &arguments.keep {
        // Folders and all, so that two materials of one name stay apart.
        let name = case.name.replace(['/', '\\', '.'], "-");
        command.arg("--keep").arg(keep.join(name));
    }
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped());
    let child = child.spawn().unwrap();
    let limit = Duration::from_secs(arguments.limit.unwrap_or(60));
    let mut record = match ended(child, limit) {
        Ok(said) => serde_json::from_str(&said).unwrap_or_else(|_| Record {
            ended: Some(format!("crashed: {}", last_lines(&said))),
            ..Record::default()
        }),
        Err(why) => Record {
            ended: Some(why),
            ..Record::default()
        },
    };
    record.name.clone_from(&case.name);
    record.files = case.paths.iter().map(|p| p.display().to_string()).collect();
    record
}

/// What the process printed, within the limit.
fn ended(mut child: Child, limit: Duration) -> Result<String, String> {
    let mut stdout = child.stdout.take().unwrap();
    let mut stderr = child.stderr.take().unwrap();
    let reader = std::thread::spawn(move || {
        let mut text = String::new();
        stdout.read_to_string(&mut text).ok();
        text
    });
    let complaints = std::thread::spawn(move || {
        let mut bytes = Vec::new();
        stderr.read_to_end(&mut bytes).ok();
        String::from_utf8_lossy(&bytes).into_owned()
    });
    let begun = Instant::now();
    loop {
        match child.try_wait().unwrap() {
            Some(status) if status.success() => return Ok(reader.join().unwrap()),
            Some(status) => {
                let said = complaints.join().unwrap();
                return Err(format!("crashed ({status}): {}", last_lines(&said)));
            }
            None if begun.elapsed() > limit => {
                child.kill().ok();
                child.wait().ok();
                return Err("timed out".to_owned());
            }
            None => std::thread::sleep(Duration::from_millis(5)),
        }
    }
}

fn last_lines(text: &str) -> String {
    let lines: Vec<&str> = text.lines().collect();
    lines[lines.len().saturating_sub(3)..].join(" / ")
}

/// The name of a path's last part.
fn file_name(path: &Path) -> String {
    path.file_name()
        .map(|n| n.to_string_lossy().into_owned())
        .unwrap_or_default()
}
