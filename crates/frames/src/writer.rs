//! Writes a frame folder. Until the new capture is complete, the folder holds the earlier one.
//!
//! Data files are named by a hash of their content, so new ones never replace those of the earlier
//! capture. The last step renames the new `frame.json` over the old one, and then removes the data
//! files that it does not name.

use std::collections::BTreeSet;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::{fs, mem};

use super::folder::{FILE, PACKED, file_of, is_folder};
use shader_text::files::File;
use shader_text::limits::Limits;
use shader_text::read_limited;

pub(super) const DATA: &str = "data";

/// From this size on, `frame.json` is compressed. Commands repeat themselves: with 1,000 draws they
/// take more space than the data.
const PACKED_FROM: usize = 64 << 10;

/// A capture that is being written. Dropped before [`Self::finish`], it leaves the earlier capture
/// in place.
pub(super) struct Writer {
    folder: PathBuf,
    /// Whether this writer created the folder.
    is_new: bool,
    limits: Limits,
}

impl Writer {
    pub fn new(folder: &Path, limits: &Limits) -> io::Result<Self> {
        let is_new = !folder.exists();
        fs::create_dir_all(folder.join(DATA))?;
        Ok(Self {
            folder: folder.to_owned(),
            is_new,
            limits: *limits,
        })
    }

    /// Writes a file into [`DATA`].
    pub fn data(&self, name: String, bytes: Vec<u8>) -> io::Result<()> {
        shader_text::files::write(&self.folder.join(DATA), &[File { name, bytes }]).map(drop)
    }

    /// Replaces the earlier `frame.json`, compressed if it is large.
    pub fn finish(self, json: Vec<u8>) -> io::Result<()> {
        if json.len() <= PACKED_FROM {
            return self.finish_as(FILE, json);
        }
        let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
        packed.write_all(&json)?;
        self.finish_as(PACKED, packed.finish()?)
    }

    /// As [`Self::finish`], for bytes that are already in the form that `name` says: compressed or
    /// not.
    pub fn finish_as(self, name: &str, bytes: Vec<u8>) -> io::Result<()> {
        let file = File {
            name: name.to_owned(),
            bytes,
        };
        shader_text::files::write(&self.folder, &[file])?;
        // If both exist, the uncompressed one counts.
        let other = if name == FILE { PACKED } else { FILE };
        match fs::remove_file(self.folder.join(other)) {
            Err(e) if e.kind() != io::ErrorKind::NotFound => Err(e),
            _ => Ok(()),
        }
    }

    /// Removes data files that `frame.json` does not name, or all of them if there is none.
    fn sweep(&self) -> io::Result<()> {
        let named = match is_folder(&self.folder) {
            true => named(&self.folder, &self.limits)?,
            false => BTreeSet::new(),
        };
        for entry in fs::read_dir(self.folder.join(DATA))? {
            let entry = entry?;
            let name = entry.file_name().to_string_lossy().into_owned();
            if is_left_over(&name) || digits(&name).is_some_and(|d| !named.contains(d)) {
                fs::remove_file(entry.path())?;
            }
        }
        Ok(())
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        // The capture is complete even if this fails: such files waste disk space until the next
        // capture.
        let _ = self.sweep();
        if mem::take(&mut self.is_new) && !is_folder(&self.folder) {
            let _ = fs::remove_dir(self.folder.join(DATA));
            let _ = fs::remove_dir(&self.folder);
        }
    }
}

/// The hash in a data file's name.
pub(super) fn digits(name: &str) -> Option<&str> {
    let digits = name.strip_suffix(".bin")?;
    is_hash(digits).then_some(digits)
}

/// Whether a file was left half-written when a program was killed.
pub(super) fn is_left_over(name: &str) -> bool {
    name.starts_with('.') && name.ends_with(".tmp")
}

fn is_hash(text: &str) -> bool {
    text.len() == 32 && text.bytes().all(|b| b.is_ascii_hexdigit())
}

/// Every string in `frame.json` that has the form of a data name.
fn named(folder: &Path, limits: &Limits) -> io::Result<BTreeSet<String>> {
    let file = file_of(folder);
    let bytes = match file.ends_with(PACKED) {
        true => super::folder::unpacked(&file, limits, "file-bytes"),
        false => read_limited::bytes(&file, limits, "file-bytes"),
    };
    let bytes = bytes.map_err(io::Error::other)?;
    let words = bytes.split(|b| *b == b'"').filter(|word| word.len() == 32);
    let words = words.filter_map(|word| str::from_utf8(word).ok());
    Ok(words.filter(|w| is_hash(w)).map(str::to_owned).collect())
}
