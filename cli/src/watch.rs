//! `--watch`: runs a command again whenever its inputs change.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::mpsc;
use std::time::Duration;

use notify_debouncer_full::new_debouncer;
use notify_debouncer_full::notify::{self, EventKind, RecursiveMode};

use same_file::Handle;

use crate::output::{self, count};
use crate::{Ending, Failure, config, file_names, materials};

/// Changes within this time are one change.
const QUIET: Duration = Duration::from_millis(80);

/// The inputs of a command.
#[derive(Clone, Debug, Default)]
pub struct Reads {
    /// Files, which need not exist.
    pub files: Vec<PathBuf>,
    /// Folders that it searches for shaders or scenes.
    pub trees: Vec<PathBuf>,
    /// Folders that it searches for includes and imports.
    pub includes: Vec<PathBuf>,
    /// Its output folder, whose changes are ignored.
    pub out: Option<PathBuf>,
}

/// The watched paths, in canonical form.
#[derive(Default)]
struct Awaited {
    files: BTreeSet<PathBuf>,
    trees: BTreeSet<PathBuf>,
    includes: BTreeSet<PathBuf>,
    out: Option<PathBuf>,
}

impl Awaited {
    /// Adds the inputs of a round. A file stays watched while an editor replaces it.
    fn add(&mut self, reads: &Reads) {
        for file in &reads.files {
            self.files.insert(whole(file));
            // The target of a link too.
            self.files.extend(file.canonicalize());
        }
        self.trees.extend(reads.trees.iter().map(|t| folder(t)));
        self.includes
            .extend(reads.includes.iter().map(|t| folder(t)));
        self.out = reads.out.as_deref().map(folder);
    }

    /// The folders to watch. A missing folder is replaced by its nearest existing parent. Parents are
    /// watched too, since a folder may be removed and created again.
    fn folders(&self) -> BTreeSet<PathBuf> {
        let parents = self.files.iter().filter_map(|f| f.parent());
        let all = parents.chain(
            self.trees
                .iter()
                .chain(&self.includes)
                .map(PathBuf::as_path),
        );
        let there = |folder: &Path| folder.ancestors().find(|a| a.is_dir()).map(Path::to_owned);
        let there: BTreeSet<PathBuf> = all.filter_map(there).collect();
        let above = there.iter().filter_map(|f| f.parent()).map(Path::to_owned);
        above.chain(there.iter().cloned()).collect()
    }

    /// Registers the folders with the system.
    fn watched(&self) -> Vec<(PathBuf, RecursiveMode)> {
        let trees = self.trees.iter().filter(|t| t.is_dir()).cloned();
        let trees = trees.map(|tree| (tree, RecursiveMode::Recursive));
        let folders = self.folders().into_iter();
        let folders = folders.map(|folder| (folder, RecursiveMode::NonRecursive));
        folders.chain(trees).collect()
    }

    /// Whether a change at `path` can change the outcome, after `last`.
    fn concerns(&self, path: &Path, last: Last) -> bool {
        let path = whole(path);
        let is_named = |known: &PathBuf| known.starts_with(&path);
        if self.files.iter().any(is_named) {
            return true;
        }
        if self.out.as_ref().is_some_and(|out| path.starts_with(out)) {
            return false;
        }
        if self.trees.iter().chain(&self.includes).any(is_named) {
            return true;
        }
        let is_below = |folders: &BTreeSet<PathBuf>| folders.iter().any(|f| path.starts_with(f));
        // The folder of `preshade.toml` may contain anything.
        let beside = |f: &&PathBuf| f.parent() == path.parent() && !f.ends_with(config::FILE);
        let is_beside = || self.files.iter().find(beside).is_some();
        match last {
            // A missing file may have appeared.
            Last::Failed => is_below(&self.trees) || is_below(&self.includes) || is_beside(),
            Last::Fine => {
                let is_found =
                    file_names::is_shader(&path) || materials::is_scene(&path) || path.is_dir();
                is_below(&self.trees) && is_found
            }
        }
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Last {
    Fine,
    Failed,
}

/// Runs a command again and again until the process ends. Failures are printed. `round` reads the
/// configuration again, and returns the inputs and the command.
pub fn run<C: FnOnce() -> Result<Ending, Failure>>(
    round: impl Fn() -> Result<(Reads, C), Failure>,
) -> Result<Ending, Failure> {
    let mut awaited = Awaited::default();
    let mut told = BTreeSet::new();
    loop {
        let now = round();
        if let Ok((reads, _)) = &now {
            awaited.add(reads);
        }
        // Register again each time: to the system, a folder that was created again is another one.
        let (send, changes) = mpsc::channel();
        let mut watcher = new_debouncer(QUIET, None, send)?;
        let (mut watched, mut failed) = (0, None);
        for (folder, mode) in awaited.watched() {
            match watcher.watch(&folder, mode) {
                Ok(()) => watched += 1,
                // The parent reports a folder that was removed meanwhile.
                Err(e) if is_gone(&e) => {}
                Err(e) => {
                    let message = format!("{}: {e}", folder.display());
                    if told.insert(message.clone()) {
                        output::message(&format!("warning: not watched: {message}"));
                    }
                    failed = Some(message);
                }
            }
        }
        if let (0, Some(why)) = (watched, failed) {
            return Err(Failure(format!("error: nothing can be watched: {why}")));
        }
        let last = match now.and_then(|(_, command)| command()) {
            Ok(Ending::Fine) => Last::Fine,
            Ok(Ending::ContractBroken) => {
                output::message("a contract broke");
                Last::Fine
            }
            Ok(Ending::NotMeasured) => {
                output::message("nothing was measured");
                Last::Fine
            }
            Err(Failure(message)) => {
                output::message(&message);
                Last::Failed
            }
        };
        output::message(&format!("watching {}", count(awaited.files.len(), "file")));
        wait(&changes, &awaited, last)?;
    }
}

type Changes = mpsc::Receiver<notify_debouncer_full::DebounceEventResult>;

/// Waits for a relevant change.
fn wait(changes: &Changes, awaited: &Awaited, last: Last) -> Result<(), Failure> {
    loop {
        // After an error of the system, anything may have changed.
        let Ok(events) = changes.recv()? else {
            return Ok(());
        };
        let changed = events.iter().any(|e| {
            !matches!(e.kind, EventKind::Access(_))
                && e.paths
                    .iter()
                    .any(|p| awaited.concerns(p, last) && !is_told_to(p))
        });
        if changed {
            return Ok(());
        }
    }
}

/// Whether stdout or stderr is this file: `2> log` in a watched folder changes with each message.
fn is_told_to(path: &Path) -> bool {
    let Ok(file) = Handle::from_path(path) else {
        return false;
    };
    [Handle::stdout(), Handle::stderr()]
        .into_iter()
        .flatten()
        .any(|told| told == file)
}

/// Whether a folder could not be watched because it is not there.
fn is_gone(error: &notify::Error) -> bool {
    match &error.kind {
        notify::ErrorKind::PathNotFound => true,
        notify::ErrorKind::Io(e) => e.kind() == std::io::ErrorKind::NotFound,
        _ => false,
    }
}

/// The canonical path of a file, which need not exist.
fn whole(path: &Path) -> PathBuf {
    let parent = match path.parent() {
        Some(parent) if parent != Path::new("") => parent,
        _ => Path::new("."),
    };
    let parent = folder(parent);
    path.file_name()
        .map_or(parent.clone(), |name| parent.join(name))
}

/// The canonical path of a folder. It and its parents need not exist.
fn folder(path: &Path) -> PathBuf {
    let there = |a: &&Path| *a != Path::new("") && a.exists();
    let (above, from) = match path.ancestors().find(there) {
        Some(above) => (above, above),
        None => (Path::new("."), Path::new("")),
    };
    let rest = path.strip_prefix(from).unwrap_or(path);
    let above = above.canonicalize().unwrap_or_else(|_| above.to_owned());
    match rest == Path::new("") {
        true => above,
        false => above.join(rest),
    }
}
