//! `--watch`: a command again, whenever something changes that it read, looked for or would find.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::mpsc;
use std::time::Duration;

use notify_debouncer_full::new_debouncer;
use notify_debouncer_full::notify::{self, EventKind, RecursiveMode};

use same_file::Handle;

use crate::output::{self, count};
use crate::{Failure, Outcome, config, many};

/// How long a burst of changes is gathered.
const QUIET: Duration = Duration::from_millis(80);

/// What a command rests on.
#[derive(Clone, Debug, Default)]
pub struct Reads {
    /// Files by name, there or not.
    pub files: Vec<PathBuf>,
    /// Folders that it finds shaders or scenes in.
    pub trees: Vec<PathBuf>,
    /// Folders that `#include` and `#import` are looked up in.
    pub includes: Vec<PathBuf>,
    /// Where it writes: what changes there is its own doing.
    pub out: Option<PathBuf>,
}

/// What is waited for, in paths that name the same file however it is written.
#[derive(Default)]
struct Awaited {
    files: BTreeSet<PathBuf>,
    trees: BTreeSet<PathBuf>,
    includes: BTreeSet<PathBuf>,
    out: Option<PathBuf>,
}

impl Awaited {
    /// Adds what a round reads. A file that is gone for a moment, as editors have it, stays.
    fn add(&mut self, reads: &Reads) {
        for file in &reads.files {
            self.files.insert(whole(file));
            // Of a link, what it points at too.
            self.files.extend(file.canonicalize());
        }
        self.trees.extend(reads.trees.iter().map(|t| folder(t)));
        self.includes
            .extend(reads.includes.iter().map(|t| folder(t)));
        self.out = reads.out.as_deref().map(folder);
    }

    /// The folders to be told of. Of one that is not there the nearest that is; of each the one above too, for it may be removed and made again.
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

    /// What the system is asked to tell of.
    fn watched(&self) -> Vec<(PathBuf, RecursiveMode)> {
        let trees = self.trees.iter().filter(|t| t.is_dir()).cloned();
        let trees = trees.map(|tree| (tree, RecursiveMode::Recursive));
        let folders = self.folders().into_iter();
        let folders = folders.map(|folder| (folder, RecursiveMode::NonRecursive));
        folders.chain(trees).collect()
    }

    /// Whether a change at `path` can make another outcome, after one that was `last`.
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
        // Where `preshade.toml` is looked for, which every command does, anything may lie.
        let beside = |f: &&PathBuf| f.parent() == path.parent() && !f.ends_with(config::FILE);
        let is_beside = || self.files.iter().find(beside).is_some();
        match last {
            // Whatever was missing may have come.
            Last::Failed => is_below(&self.trees) || is_below(&self.includes) || is_beside(),
            Last::Fine => {
                let is_found = many::is_shader(&path) || many::is_scene(&path) || path.is_dir();
                is_below(&self.trees) && is_found
            }
        }
    }
}

/// How a round ended.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Last {
    Fine,
    Failed,
}

/// Runs a command until the process is ended. What fails is told, and tried again at the next change. Each round is made anew by `round`, from the file with values for flags on:
/// what it reads, and what it does.
///
/// # Errors
/// The system tells of no changes.
pub fn run<C: FnOnce() -> Result<Outcome, Failure>>(
    round: impl Fn() -> Result<(Reads, C), Failure>,
) -> Result<Outcome, Failure> {
    let mut awaited = Awaited::default();
    let mut told = BTreeSet::new();
    loop {
        let now = round();
        if let Ok((reads, _)) = &now {
            awaited.add(reads);
        }
        // Anew each time: a folder that is made again is another one to the system.
        let (send, changes) = mpsc::channel();
        let mut watcher = new_debouncer(QUIET, None, send)?;
        let (mut watched, mut failed) = (0, None);
        for (folder, mode) in awaited.watched() {
            match watcher.watch(&folder, mode) {
                Ok(()) => watched += 1,
                // One that went away meanwhile is told of by the one above.
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
            Ok(Outcome::Fine) => Last::Fine,
            Ok(Outcome::ContractBroken) => {
                output::message("a contract broke");
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

/// Waits until something changes that is awaited.
fn wait(changes: &Changes, awaited: &Awaited, last: Last) -> Result<(), Failure> {
    loop {
        // What the system could not tell may have been anything.
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

/// Whether what this process tells goes into the file: `2> log` beside the shaders would change them with each message.
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

/// A path that names the same file however it is written; the file may be gone.
fn whole(path: &Path) -> PathBuf {
    let parent = match path.parent() {
        Some(parent) if parent != Path::new("") => parent,
        _ => Path::new("."),
    };
    let parent = folder(parent);
    path.file_name()
        .map_or(parent.clone(), |name| parent.join(name))
}

/// The same of a folder, which may be gone and those above it too.
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
