//! Files that the caller holds in memory. `#include` and imports search them before the disk. On a
//! host without a disk, such as a browser, there are no others.

use std::collections::BTreeMap;
use std::collections::BTreeSet;
use std::io;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

/// Texts by path. Paths have the same base folder as the names of sources, and may contain `.` and
/// `..`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Memory(Arc<BTreeMap<PathBuf, String>>);

impl<P: AsRef<Path>> FromIterator<(P, String)> for Memory {
    fn from_iter<I: IntoIterator<Item = (P, String)>>(files: I) -> Self {
        let files = files.into_iter();
        let texts = files.map(|(path, text)| (normal(path.as_ref()), text));
        Self(Arc::new(texts.collect()))
    }
}

impl Memory {
    pub fn text(&self, path: &Path) -> Option<&str> {
        self.0.get(&normal(path)).map(String::as_str)
    }

    /// Whether a file or folder exists, in memory or on disk.
    pub fn exists(&self, path: &Path) -> bool {
        self.has(&normal(path)) || path.exists()
    }

    /// Whether a folder exists at the path, in memory or on disk.
    pub fn is_folder(&self, path: &Path) -> bool {
        self.below(&normal(path)).next().is_some() || path.is_dir()
    }

    /// A unique path for each file or folder, as [`Path::canonicalize`].
    pub fn canonical(&self, path: &Path) -> io::Result<PathBuf> {
        let normal = normal(path);
        match self.has(&normal) {
            true => Ok(normal),
            false => path.canonicalize(),
        }
    }

    /// The direct entries of a folder, sorted.
    pub fn entries(&self, folder: &Path) -> Vec<PathBuf> {
        let normal = normal(folder);
        let own = self.below(&normal).filter_map(|path| {
            let below = path.strip_prefix(&normal).ok()?;
            Some(folder.join(below.components().next()?))
        });
        let read = std::fs::read_dir(folder).into_iter().flatten();
        let on_disk = read.filter_map(|entry| Some(entry.ok()?.path()));
        let all: BTreeSet<PathBuf> = own.chain(on_disk).collect();
        all.into_iter().collect()
    }

    /// Whether memory holds a file or folder with this normalised path.
    fn has(&self, path: &Path) -> bool {
        self.0.contains_key(path) || self.below(path).next().is_some()
    }

    /// The files below a normalised folder. They are adjacent, because paths are sorted by
    /// component.
    fn below<'m>(&'m self, folder: &'m Path) -> impl Iterator<Item = &'m Path> {
        let all = self
            .0
            .range(folder.to_owned()..)
            .map(|(path, _)| path.as_path());
        let all = all.take_while(move |path| path.starts_with(folder));
        // Every path starts with the empty path, which stands for the current folder.
        all.filter(move |path| *path != folder && path.has_root() == folder.has_root())
    }
}

/// The path without `.` and, as far as possible, without `..`.
fn normal(path: &Path) -> PathBuf {
    let mut out = PathBuf::new();
    for component in path.components() {
        match component {
            Component::CurDir => {}
            Component::ParentDir
                if matches!(out.components().next_back(), Some(Component::Normal(_))) =>
            {
                out.pop();
            }
            other => out.push(other),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_found_however_they_are_written() {
        let files = [
            "lib/a.glsl",
            "./b.glsl",
            "/abs/c.glsl",
            "../up.glsl",
            "lib/deep/d.wgsl",
        ];
        let memory: Memory = files
            .map(|name| (name, name.to_owned()))
            .into_iter()
            .collect();
        for path in [
            "lib/a.glsl",
            "lib/./a.glsl",
            "lib/deep/../a.glsl",
            "x/../lib/a.glsl",
        ] {
            assert_eq!(memory.text(Path::new(path)), Some("lib/a.glsl"), "{path}");
        }
        assert_eq!(memory.text(Path::new("b.glsl")), Some("./b.glsl"));
        assert_eq!(
            memory.text(Path::new("lib/../../up.glsl")),
            Some("../up.glsl")
        );
        assert_eq!(memory.text(Path::new("lib")), None);
        assert!(memory.exists(Path::new("lib/deep")) && memory.exists(Path::new("/abs")));
        assert!(!memory.exists(Path::new("no-such-folder/a.glsl")));
        assert_eq!(
            memory.canonical(Path::new("./lib/deep/..")).ok(),
            Some(PathBuf::from("lib"))
        );
    }

    #[test]
    fn a_folder_lists_what_is_in_it_once() {
        let files = [
            "lib/a.wgsl",
            "lib/deep/b.wgsl",
            "lib/deep/c.wgsl",
            "library.wgsl",
        ];
        let memory: Memory = files
            .map(|name| (name, String::new()))
            .into_iter()
            .collect();
        let lib = ["lib/a.wgsl", "lib/deep"].map(PathBuf::from);
        assert_eq!(memory.entries(Path::new("lib")), lib);
    }
}
