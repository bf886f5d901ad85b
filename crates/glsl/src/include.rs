//! Finds and reads included files, in memory or on disk, and enforces the root folder.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::io;
use std::path::{Path, PathBuf};

use shader_text::limits::Limits;
use shader_text::memory::Memory;
use shader_text::options::Options;
use shader_text::read_limited;

/// Searches the including file's folder first, then the include folders.
pub(super) struct Files {
    include: Vec<PathBuf>,
    /// Files in memory, which come before those on disk.
    memory: Memory,
    root: Option<PathBuf>,
    /// Limits the size of each file.
    limits: Limits,
    /// Missing paths that were tried.
    pub absent: RefCell<BTreeSet<PathBuf>>,
}

fn refused(message: String) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, message)
}

impl Files {
    pub fn new(options: &Options) -> Self {
        Self {
            include: options.include.clone(),
            memory: options.files.clone(),
            root: options.root.clone(),
            limits: options.limits,
            absent: RefCell::default(),
        }
    }

    /// Finds `path`, the including file's folder joined with the quoted name. In include folders,
    /// tries the longest suffix first.
    pub fn find(&self, path: &Path) -> io::Result<PathBuf> {
        if self.memory.text(path).is_some() {
            return self.memory.canonical(path);
        }
        let beside = match &self.root {
            Some(root) => root.join(path),
            None => path.to_owned(),
        };
        let mut ending = path;
        let mut found = beside.canonicalize();
        let is_there = |path: &PathBuf| {
            let is_there = self.memory.exists(path);
            if !is_there {
                self.absent.borrow_mut().insert(path.clone());
            }
            is_there
        };
        if found.is_err() {
            is_there(&beside);
        }
        while found.is_err() {
            let below = |d: &PathBuf| d.join(ending);
            if let Some(hit) = self.include.iter().map(below).find(is_there) {
                found = self.memory.canonical(&hit);
                break;
            }
            let mut parts = ending.components();
            if parts.next().is_none() || parts.as_path().as_os_str().is_empty() {
                return Err(io::Error::new(
                    io::ErrorKind::NotFound,
                    format!("there is no file {}", path.display()),
                ));
            }
            ending = parts.as_path();
        }
        let found = found?;
        match &self.root {
            Some(root) if self.memory.text(&found).is_none() && !found.starts_with(root) => {
                Err(io::Error::new(
                    io::ErrorKind::PermissionDenied,
                    format!("{} is outside of the root folder", path.display()),
                ))
            }
            _ => Ok(found),
        }
    }

    /// Reads a regular file within the size limit.
    pub fn text(&self, found: &Path) -> io::Result<String> {
        if let Some(text) = self.memory.text(found) {
            let size = text.len() as u64;
            let what = format_args!("the bytes of {}", found.display());
            let fits = self.limits.check("source-bytes", size, what);
            return fits
                .map(|()| text.to_owned())
                .map_err(|e| refused(e.to_string()));
        }
        let bytes =
            read_limited::bytes(found, &self.limits, "source-bytes").map_err(|e| match e {
                read_limited::ReadError::Io(e) => e,
                read_limited::ReadError::TooLarge(e) => refused(e.to_string()),
                other => refused(format!("{}: {other}", found.display())),
            })?;
        // Comments may have any encoding. The parser rejects invalid characters elsewhere.
        let lossy = || String::from_utf8_lossy(&bytes).into_owned();
        Ok(read_limited::decode(bytes.clone()).unwrap_or_else(|_| lossy()))
    }

    /// The file's name in messages: as the author wrote it, if that path exists.
    pub fn shown(&self, asked: &Path, found: &Path) -> String {
        let is_there = match &self.root {
            _ if self.memory.text(asked).is_some() => true,
            Some(root) => root.join(asked).exists(),
            None => asked.exists(),
        };
        let name = if is_there { asked } else { found };
        name.to_string_lossy().into_owned()
    }
}
