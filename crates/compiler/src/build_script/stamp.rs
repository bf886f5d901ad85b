//! Inputs and outputs of a build, so that a build script compiles only materials that changed.

use std::collections::BTreeSet;
use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use shader_text::source::Searched;

use super::BuildConfig;
use crate::front;
use crate::lock::TOOL;
use shader_text::files::File;

const FILE: &str = "preshade.stamp";

#[derive(Serialize, Deserialize)]
struct Stamp {
    key: String,
    warnings: Vec<String>,
    /// Included files with the BLAKE3 of their text.
    included: Vec<(PathBuf, String)>,
    /// Files that did not exist when includes were searched for.
    absent: Vec<PathBuf>,
    /// Searches of folders for them.
    searched: Vec<Searched>,
    /// Output files, by their path below the folder for output, with BLAKE3.
    files: Vec<(String, String)>,
}

/// The inputs of a build other than the given files, and its warnings.
#[derive(Default)]
pub(super) struct Trace {
    /// One a line.
    pub warnings: Vec<String>,
    /// Included files with their text.
    pub included: Vec<(PathBuf, String)>,
    /// Files that did not exist when includes were searched for.
    pub absent: Vec<PathBuf>,
    /// Searches of folders for them.
    pub searched: Vec<Searched>,
}

impl Trace {
    /// The files that were read, without duplicates.
    pub fn included(&self) -> Vec<PathBuf> {
        // Both stages may include one.
        let mut paths: Vec<PathBuf> = self.included.iter().map(|(p, _)| p.clone()).collect();
        paths.sort();
        paths.dedup();
        paths
    }
}

/// Hash of everything that determines a build. It includes the running program: a build script that
/// was compiled again may contain another version of preshade.
pub(super) fn key(
    builder: &BuildConfig,
    name: &str,
    files: &[&Path],
    sources: &[front::Source],
    lock: Option<&str>,
) -> String {
    let program = std::env::current_exe().and_then(std::fs::metadata);
    let program = program.map(|m| (m.len(), m.modified().ok())).ok();
    let all = format!("{TOOL} {program:?} {builder:?} {name:?} {files:?} {sources:?} {lock:?}");
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

/// Messages of the last build.
pub(super) struct LastMessages {
    pub warnings: Vec<String>,
    pub included: Vec<PathBuf>,
}

/// Messages of the last build, if it had the same inputs and its files still exist.
pub(super) fn still_holds(folder: &Path, key: &str, out: &Path) -> Option<LastMessages> {
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
    holds.then(|| LastMessages {
        warnings: stamp.warnings,
        included: stamp.included.into_iter().map(|(path, _)| path).collect(),
    })
}

/// Removes files of the last build that this one did not write, such as those of a removed variant.
/// A host that lists the folder would ship them.
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
        // Errors are ignored: nothing depends on the removal, and a stamp may contain anything.
        let is_below = path.starts_with(folder)
            && path
                .components()
                .all(|c| !matches!(c, std::path::Component::ParentDir));
        if is_below && std::fs::remove_file(&path).is_ok() {
            // Fails if the folder is not empty.
            let _ = path.parent().map(std::fs::remove_dir);
        }
    }
}

fn read(folder: &Path) -> Option<Stamp> {
    let text = std::fs::read(folder.join(FILE)).ok()?;
    serde_json::from_slice(&text).ok()
}

/// Keeps the inputs and outputs of a build.
pub(super) fn write(
    folder: &Path,
    key: &str,
    trace: &Trace,
    files: Vec<(String, String)>,
) -> io::Result<()> {
    // If a file was saved since it was read, or is gone, the next build compiles again.
    let hashed = |(path, read): &(PathBuf, String)| {
        let bytes = std::fs::read(path).ok()?;
        // The preprocessor adds a missing newline at the end.
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
    shader_text::files::write(folder, &[file]).map(|_| ())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// A removed variant is not shipped by a host that lists the folder.
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

    /// A file that is saved during a build is compiled again.
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
        // The preprocessor adds a newline at the end if it pastes anything.
        assert_eq!(holds("#define TINT 0.5\n"), Some(vec![included.clone()]));
        assert_eq!(holds("#define TINT 0.25"), None);
        assert_eq!(holds(""), None);
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
