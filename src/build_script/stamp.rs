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
    /// Path below the folder for output, and BLAKE3.
    files: Vec<(String, String)>,
    /// What the texts include: path and BLAKE3.
    #[serde(default)]
    included: Vec<(PathBuf, String)>,
}

/// What is known of a material that is still as it was.
pub(super) struct Held {
    pub(super) warnings: Vec<String>,
    pub(super) included: Vec<PathBuf>,
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

/// The last build, if it was of the same, included files too, and its files are all still there.
pub(super) fn still_holds(folder: &Path, key: &str, out: &Path) -> Option<Held> {
    let text = std::fs::read(folder.join(FILE)).ok()?;
    let stamp: Stamp = serde_json::from_slice(&text).ok()?;
    let is_there = |(path, wanted): &(String, String)| {
        let bytes = std::fs::read(out.join(path));
        bytes.is_ok_and(|bytes| hash(&bytes) == *wanted)
    };
    let is_same = |(path, wanted): &(PathBuf, String)| {
        std::fs::read(path).is_ok_and(|bytes| hash(&bytes) == *wanted)
    };
    let holds =
        stamp.key == key && stamp.files.iter().all(is_there) && stamp.included.iter().all(is_same);
    holds.then_some(Held {
        warnings: stamp.warnings,
        included: stamp.included.into_iter().map(|(path, _)| path).collect(),
    })
}

/// Keeps what a build came to.
pub(super) fn write(
    folder: &Path,
    key: &str,
    warnings: &[String],
    files: Vec<(String, String)>,
    included: &[(PathBuf, String)],
) -> io::Result<()> {
    let hashed = |(path, text): &(PathBuf, String)| (path.clone(), hash(text.as_bytes()));
    let stamp = Stamp {
        key: key.to_owned(),
        warnings: warnings.to_vec(),
        files,
        included: included.iter().map(hashed).collect(),
    };
    let file = File {
        name: FILE.to_owned(),
        bytes: serde_json::to_vec(&stamp).unwrap_or_default(),
    };
    emit::write(folder, &[file]).map(|_| ())
}
