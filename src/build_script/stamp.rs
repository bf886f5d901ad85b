//! What a build was made of and came to, so that a material that did not change is not compiled again when a build script runs for another.

use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::Builder;
use crate::emit::{self, File};
use crate::lock::TOOL;

const FILE: &str = "preshade.stamp";

#[derive(Serialize, Deserialize)]
struct Stamp {
    key: String,
    warnings: Vec<String>,
    /// Files that the material's own include, and BLAKE3.
    included: Vec<(PathBuf, String)>,
    /// Files that were looked for before those were found, and were not there.
    absent: Vec<PathBuf>,
    /// Path below the folder for output, and BLAKE3.
    files: Vec<(String, String)>,
}

/// Hash of all that decides what a build comes to. Which preshade it is, is told by the running program: a build script that was compiled again is another.
pub(super) fn key(
    builder: &Builder,
    name: &str,
    files: &[&Path],
    texts: &[String],
    lock: Option<&str>,
) -> String {
    let program = std::env::current_exe().and_then(std::fs::metadata);
    let program = program.map(|m| (m.len(), m.modified().ok())).ok();
    let all = format!("{TOOL} {program:?} {builder:?} {name:?} {files:?} {texts:?} {lock:?}");
    hash(all.as_bytes())
}

fn hash(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex().to_string()
}

/// A file below the folder for output, by its hash.
pub(super) fn hashed(folder: &Path, file: &File) -> (String, String) {
    let path = folder.join(&file.name).to_string_lossy().into_owned();
    (path, hash(&file.bytes))
}

/// What the last build told.
pub(super) struct Kept {
    pub warnings: Vec<String>,
    pub included: Vec<PathBuf>,
    pub absent: Vec<PathBuf>,
}

/// What the last build told, if it was of the same and its files are all still there.
pub(super) fn still_holds(folder: &Path, key: &str, out: &Path) -> Option<Kept> {
    let text = std::fs::read(folder.join(FILE)).ok()?;
    let stamp: Stamp = serde_json::from_slice(&text).ok()?;
    let is_there = |path: &Path, wanted: &String| {
        let bytes = std::fs::read(path);
        bytes.is_ok_and(|bytes| hash(&bytes) == *wanted)
    };
    let holds = stamp.key == key
        && stamp.included.iter().all(|(p, h)| is_there(p, h))
        && !stamp.absent.iter().any(|p| p.exists())
        && stamp.files.iter().all(|(p, h)| is_there(&out.join(p), h));
    holds.then(|| Kept {
        warnings: stamp.warnings,
        included: stamp.included.into_iter().map(|(path, _)| path).collect(),
        absent: stamp.absent,
    })
}

/// Keeps what a build came to.
pub(super) fn write(
    folder: &Path,
    key: &str,
    Kept {
        warnings,
        included,
        absent,
    }: Kept,
    files: Vec<(String, String)>,
) -> io::Result<()> {
    // A file that is gone by now has no bytes: the next build, too, begins anew.
    let hashed = |path: PathBuf| {
        let bytes = std::fs::read(&path).ok()?;
        Some((path, hash(&bytes)))
    };
    let all = included.len();
    let included: Vec<_> = included.into_iter().filter_map(hashed).collect();
    let stamp = Stamp {
        key: match included.len() == all {
            true => key.to_owned(),
            false => String::new(),
        },
        warnings,
        included,
        absent,
        files,
    };
    let file = File {
        name: FILE.to_owned(),
        bytes: serde_json::to_vec(&stamp).unwrap_or_default(),
    };
    emit::write(folder, &[file]).map(|_| ())
}
