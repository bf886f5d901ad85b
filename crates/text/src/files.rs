//! Writes files to disk atomically.

use std::fs;
use std::hash::{BuildHasher as _, Hasher as _, RandomState};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

/// An emitted file. `name` has no folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct File {
    pub name: String,
    pub bytes: Vec<u8>,
}

impl File {
    pub fn text(name: impl Into<String>, text: String) -> Self {
        Self {
            name: name.into(),
            bytes: text.into_bytes(),
        }
    }
}

/// Writes `files` into `dir` and creates it if necessary. All files are first written to temporary
/// files and then renamed, so a failure leaves the old files in place. A file with the same bytes
/// is not touched, so builds that watch it do not run again.
///
/// Returns the paths of the changed files.
///
/// # Errors
/// The file system's error with the path. Temporary files are removed.
pub fn write(dir: &Path, files: &[File]) -> io::Result<Vec<PathBuf>> {
    staged(dir, files, |path, bytes| fs::write(path, bytes))
}

/// As [`write()`], for one file. Even after a power cut, the file is complete or missing.
///
/// # Errors
/// As [`write()`].
pub fn write_file(path: &Path, bytes: Vec<u8>) -> io::Result<()> {
    let name = path.file_name().unwrap_or_default();
    let file = File {
        name: name.to_string_lossy().into_owned(),
        bytes,
    };
    let folder = path.parent().filter(|folder| *folder != Path::new(""));
    staged(folder.unwrap_or(Path::new(".")), &[file], |path, bytes| {
        let mut file = fs::File::create(path)?;
        file.write_all(bytes)?;
        file.sync_all()
    })?;
    Ok(())
}

fn staged(
    dir: &Path,
    files: &[File],
    store: fn(&Path, &[u8]) -> io::Result<()>,
) -> io::Result<Vec<PathBuf>> {
    // The system would only report "File exists".
    if let Some(file) = dir.ancestors().find(|a| a.is_file()) {
        let message = format!("{} is a file, not a folder", file.display());
        return Err(io::Error::new(io::ErrorKind::NotADirectory, message));
    }
    fs::create_dir_all(dir).map_err(|e| at(dir, &e))?;
    let mut staged = Staged(Vec::new());
    for file in files {
        let target = dir.join(&file.name);
        if fs::read(&target).is_ok_and(|old| old == file.bytes) {
            continue;
        }
        if target.is_dir() {
            return Err(at(&target, &io::Error::from(io::ErrorKind::IsADirectory)));
        }
        let temporary = dir.join(format!(".{}.{}.tmp", file.name, unique()));
        staged.0.push((temporary.clone(), target));
        store(&temporary, &file.bytes).map_err(|e| at(&temporary, &e))?;
    }
    let mut changed = Vec::new();
    while let Some((temporary, target)) = staged.0.first().cloned() {
        fs::rename(&temporary, &target).map_err(|e| at(&target, &e))?;
        staged.0.remove(0);
        changed.push(target);
    }
    Ok(changed)
}

/// A name that no other process uses, even on machines that share a disk.
fn unique() -> String {
    let random = RandomState::new().build_hasher().finish();
    format!("{}-{random:x}", std::process::id())
}

/// Temporary files and their destinations. Dropping it removes the remaining files.
struct Staged(Vec<(PathBuf, PathBuf)>);

impl Drop for Staged {
    fn drop(&mut self) {
        for (temporary, _) in &self.0 {
            // Best effort: the write has already failed.
            let _ = fs::remove_file(temporary);
        }
    }
}

fn at(path: &Path, error: &io::Error) -> io::Error {
    io::Error::new(error.kind(), format!("{}: {error}", path.display()))
}

/// Whether the name is a valid file and folder name on all systems and does not collide with
/// generated Rust modules (`lit.rs`).
pub fn is_material_name(name: &str) -> bool {
    let amiss = |c: char| c.is_control() || "/\\:*?\"<>|".contains(c);
    !name.is_empty()
        && !name.contains(amiss)
        && !name.starts_with('.')
        && !name.ends_with(['.', ' '])
        && !name.to_lowercase().ends_with(".rs")
}
