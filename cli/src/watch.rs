//! `--watch`: a command again, whenever a file that it read changes.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::mpsc;
use std::time::Duration;

use notify_debouncer_full::new_debouncer;
use notify_debouncer_full::notify::{EventKind, RecursiveMode};

use crate::output;
use crate::{Failure, Outcome};

/// How long a burst of changes is gathered.
const QUIET: Duration = Duration::from_millis(80);

/// Runs a command until the process is ended. What fails is told, and tried again at the next change. `reads` tells the command's files; `None` where they cannot change.
pub fn run(
    reads: impl Fn() -> Option<Vec<PathBuf>>,
    command: impl Fn() -> Result<Outcome, Failure>,
) -> Result<Outcome, Failure> {
    let (send, changes) = mpsc::channel();
    let mut watcher = new_debouncer(QUIET, None, send)?;
    let mut folders: BTreeSet<PathBuf> = BTreeSet::new();
    let mut files: BTreeSet<PathBuf> = BTreeSet::new();
    loop {
        let Some(now) = reads() else {
            return Err(Failure(
                "error: --watch needs files to watch: stdin is read once".to_owned(),
            ));
        };
        // A file that is gone for a moment, as editors have it, is waited for.
        files.extend(now.iter().map(|f| whole(f)));
        for file in &files {
            let folder = file.parent().unwrap_or(Path::new(".")).to_owned();
            if folder.is_dir() && !folders.contains(&folder) {
                watcher.watch(&folder, RecursiveMode::NonRecursive)?;
                folders.insert(folder);
            }
        }
        match command() {
            Ok(Outcome::Fine) => {}
            Ok(Outcome::ContractBroken) => output::message("a contract broke"),
            Err(Failure(message)) => output::message(&message),
        }
        output::message(&format!("watching {} files", files.len()));
        wait(&changes, &files)?;
    }
}

type Changes = mpsc::Receiver<notify_debouncer_full::DebounceEventResult>;

/// Waits until one of `files` changes.
fn wait(changes: &Changes, files: &BTreeSet<PathBuf>) -> Result<(), Failure> {
    loop {
        let events = changes.recv()?.map_err(|errors| {
            let errors: Vec<String> = errors.iter().map(ToString::to_string).collect();
            Failure(format!("error: {}", errors.join("; ")))
        })?;
        let changed = events.iter().any(|e| {
            !matches!(e.kind, EventKind::Access(_))
                && e.paths.iter().any(|p| files.contains(&whole(p)))
        });
        if changed {
            return Ok(());
        }
    }
}

/// A path that names the same file however it is written; the file may be gone.
fn whole(path: &Path) -> PathBuf {
    let parent = match path.parent() {
        Some(parent) if parent != Path::new("") => parent,
        _ => Path::new("."),
    };
    let parent = parent.canonicalize().unwrap_or_else(|_| parent.to_owned());
    path.file_name()
        .map_or(parent.clone(), |name| parent.join(name))
}
