//! Files onto the disk, each whole.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::File;

/// Writes `files` into `dir`, which is made if it is not there. Everything is first written to temporary files in `dir` and only then
/// renamed into place, so that a failure to write (a full disk, a folder in the way) leaves what was there before. A file that already has these bytes is not touched: its time
/// stays, and a build that watches it does not run again.
///
/// Returns the paths of the files that changed.
///
/// # Errors
/// What the file system says, with the path. The temporary files are removed.
pub fn write(dir: &Path, files: &[File]) -> io::Result<Vec<PathBuf>> {
    // "File exists", the system would say.
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
        let temporary = dir.join(format!(".{}.{}.tmp", file.name, std::process::id()));
        staged.0.push((temporary.clone(), target));
        fs::write(&temporary, &file.bytes).map_err(|e| at(&temporary, &e))?;
    }
    let mut changed = Vec::new();
    while let Some((temporary, target)) = staged.0.first().cloned() {
        fs::rename(&temporary, &target).map_err(|e| at(&target, &e))?;
        staged.0.remove(0);
        changed.push(target);
    }
    Ok(changed)
}

/// Temporary files and where they are to go; those still here when it is dropped are removed.
struct Staged(Vec<(PathBuf, PathBuf)>);

impl Drop for Staged {
    fn drop(&mut self) {
        for (temporary, _) in &self.0 {
            // Best effort: the write has failed already and says so.
            let _ = fs::remove_file(temporary);
        }
    }
}

fn at(path: &Path, error: &io::Error) -> io::Error {
    io::Error::new(error.kind(), format!("{}: {error}", path.display()))
}

/// Whether a material may be called so: its name begins those of its files and is a folder's, on any system, and none of them may be another's Rust module (`lit.rs`).
pub fn is_material_name(name: &str) -> bool {
    let amiss = |c: char| c.is_control() || "/\\:*?\"<>|".contains(c);
    !name.is_empty()
        && !name.contains(amiss)
        && !name.starts_with('.')
        && !name.ends_with(['.', ' '])
        && !name.to_lowercase().ends_with(".rs")
}
