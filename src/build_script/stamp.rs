//! What a build was made of and came to, so that a material that did not change is not compiled again when a build script runs for another.

use std::collections::BTreeSet;
use std::io;
use std::path::{Path, PathBuf};

use preshade_passes::program::Searched;
use serde::{Deserialize, Serialize};

use super::Builder;
use crate::emit::{self, File};
use crate::front;
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
    /// Searches of folders for them.
    searched: Vec<Searched>,
    /// Path below the folder for output, and BLAKE3.
    files: Vec<(String, String)>,
}

/// What a build rests on beside the files that it was given, and what it has to tell.
#[derive(Default)]
pub(super) struct Trace {
    /// What was asked for and is not made, in a line each.
    pub warnings: Vec<String>,
    /// Files that the material's own include, each with the text that was read.
    pub included: Vec<(PathBuf, String)>,
    /// Files that were looked for before those were found, and were not there.
    pub absent: Vec<PathBuf>,
    /// Searches of folders for them.
    pub searched: Vec<Searched>,
}

impl Trace {
    /// The files that were read, each once.
    pub fn included(&self) -> Vec<PathBuf> {
        // Both stages may include one.
        let mut paths: Vec<PathBuf> = self.included.iter().map(|(p, _)| p.clone()).collect();
        paths.sort();
        paths.dedup();
        paths
    }
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
}

/// What the last build told, if it was of the same and its files are all still there.
pub(super) fn still_holds(folder: &Path, key: &str, out: &Path) -> Option<Kept> {
    let stamp = read(folder)?;
    let is_there = |path: &Path, wanted: &String| {
        let bytes = std::fs::read(path);
        bytes.is_ok_and(|bytes| hash(&bytes) == *wanted)
    };
    let holds = stamp.key == key
        && stamp.included.iter().all(|(p, h)| is_there(p, h))
        && !stamp.absent.iter().any(|p| p.exists())
        && stamp.searched.iter().all(front::still_finds)
        && stamp.files.iter().all(|(p, h)| is_there(&out.join(p), h));
    holds.then(|| Kept {
        warnings: stamp.warnings,
        included: stamp.included.into_iter().map(|(path, _)| path).collect(),
    })
}

/// Removes what the last build wrote into a material's folder and this one did not: a variant that is not asked for any more, or a pass that is refused now. Who lists the folder would ship it.
pub(super) fn sweep(folder: &Path, out: &Path, files: &[(String, String)]) {
    let Some(stamp) = read(folder) else {
        return;
    };
    let gone = stamp
        .files
        .iter()
        .filter(|(old, _)| !files.iter().any(|(new, _)| new == old));
    for (path, _) in gone {
        let path = out.join(path);
        // Nothing rests on its being gone; and a stamp is a file that may hold anything.
        let is_below = path.starts_with(folder)
            && path
                .components()
                .all(|c| !matches!(c, std::path::Component::ParentDir));
        if is_below && std::fs::remove_file(&path).is_ok() {
            // Empty or not.
            let _ = path.parent().map(std::fs::remove_dir);
        }
    }
}

fn read(folder: &Path) -> Option<Stamp> {
    let text = std::fs::read(folder.join(FILE)).ok()?;
    serde_json::from_slice(&text).ok()
}

/// Keeps what a build came to.
pub(super) fn write(
    folder: &Path,
    key: &str,
    trace: &Trace,
    files: Vec<(String, String)>,
) -> io::Result<()> {
    // Of a file that is gone by now, or was saved since it was read, the next build knows nothing: it begins anew.
    let hashed = |(path, read): &(PathBuf, String)| {
        let bytes = std::fs::read(path).ok()?;
        // The preprocessor ends a last line.
        let text = read.as_bytes();
        let is_as_read = bytes == text || text.strip_suffix(b"\n") == Some(&bytes);
        is_as_read.then(|| (path.clone(), hash(&bytes)))
    };
    let included: Option<BTreeSet<_>> = trace.included.iter().map(hashed).collect();
    let stamp = Stamp {
        key: match included {
            Some(_) => key.to_owned(),
            None => String::new(),
        },
        warnings: trace.warnings.clone(),
        included: included.into_iter().flatten().collect(),
        absent: trace.absent.clone(),
        searched: trace.searched.clone(),
        files,
    };
    let file = File {
        name: FILE.to_owned(),
        bytes: serde_json::to_vec(&stamp).unwrap_or_default(),
    };
    emit::write(folder, &[file]).map(|_| ())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// A variant that went away is not shipped by who lists the folder.
    #[test]
    fn what_is_not_made_any_more_is_removed() {
        let out = std::env::temp_dir().join(format!("preshade-sweep-{}", std::process::id()));
        let folder = out.join("lit");
        for variant in ["variant", "cheap"] {
            std::fs::create_dir_all(folder.join(variant)).unwrap();
            std::fs::write(folder.join(variant).join("lit.main.wgsl"), "text").unwrap();
        }
        std::fs::write(out.join("kept.rs"), "text").unwrap();
        let file = |path: &str| (path.to_owned(), hash(b"text"));
        let (variant, cheap) = (
            file("lit/variant/lit.main.wgsl"),
            file("lit/cheap/lit.main.wgsl"),
        );
        let before = vec![
            variant.clone(),
            cheap,
            file("kept.rs"),
            file("lit/../kept.rs"),
        ];
        write(&folder, "key", &Trace::default(), before).unwrap();
        sweep(&folder, &out, &[variant]);
        assert!(folder.join("variant/lit.main.wgsl").is_file());
        assert!(!folder.join("cheap").exists());
        assert!(out.join("kept.rs").is_file());
        std::fs::remove_dir_all(&out).unwrap();
    }

    /// What was saved while it was compiled is not what was compiled.
    #[test]
    fn a_file_that_is_not_as_it_was_read_leaves_no_stamp_that_holds() {
        let folder = std::env::temp_dir().join(format!("preshade-stamp-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let included = folder.join("tint.glsl");
        std::fs::write(&included, "#define TINT 0.5").unwrap();
        let holds = |read: &str| {
            let trace = Trace {
                included: vec![(included.clone(), read.to_owned())],
                ..Trace::default()
            };
            write(&folder, "key", &trace, Vec::new()).unwrap();
            still_holds(&folder, "key", &folder).map(|kept| kept.included)
        };
        assert_eq!(holds("#define TINT 0.5"), Some(vec![included.clone()]));
        // Its last line is ended where something is pasted in it.
        assert_eq!(holds("#define TINT 0.5\n"), Some(vec![included.clone()]));
        assert_eq!(holds("#define TINT 0.25"), None);
        assert_eq!(holds(""), None);
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
