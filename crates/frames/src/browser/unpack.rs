//! Unpacks the tar stream that a page wrote into a frame folder. Checks names and sizes.

use std::fs;
use std::io::{self, Read};
use std::path::Path;

use tar::{Archive, EntryType};

use crate::codes;
use crate::folder::{FILE, PACKED};
use crate::writer::{DATA, Writer, digits, is_left_over};
use shader_text::limits::{Exceeded, Limits};

/// Why a stream was not unpacked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum UnpackError {
    /// The stream holds a file that no frame folder has.
    #[error("the capture holds `{0}`, which no frame folder has")]
    Name(String),
    /// The stream exceeds a limit.
    #[error(transparent)]
    Limit(#[from] Exceeded),
    /// The stream ends before the first frame.
    #[error("the capture holds no whole frame")]
    Empty,
    /// It is no tar stream.
    #[error("no capture: {0}")]
    Read(io::Error),
    /// A file cannot be written.
    #[error("cannot write the capture: {0}")]
    Write(io::Error),
    /// The folder holds files that belong to no capture.
    #[error("`{0}` holds other files than a capture: name a new folder")]
    Occupied(String),
}

impl UnpackError {
    /// The stable error code.
    pub fn code(&self) -> &'static str {
        codes::CAPTURE.code
    }
}

/// Checks that a folder may take a capture: it is new, empty, or holds only an earlier capture.
///
/// # Errors
/// [`UnpackError`].
pub fn prepare(folder: &Path) -> Result<(), UnpackError> {
    let is_ours = |name: &str| [FILE, PACKED, DATA].contains(&name) || is_left_over(name);
    let is_datum = |name: &str| digits(name).is_some() || is_left_over(name);
    holds_only(folder, &is_ours)?;
    holds_only(&folder.join(DATA), &is_datum)
}

fn holds_only(folder: &Path, is_ours: &dyn Fn(&str) -> bool) -> Result<(), UnpackError> {
    let entries = match fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(()),
        Err(e) => return Err(UnpackError::Write(e)),
    };
    for entry in entries {
        let name = entry.map_err(UnpackError::Write)?.file_name();
        if !is_ours(&name.to_string_lossy()) {
            return Err(UnpackError::Occupied(folder.display().to_string()));
        }
    }
    Ok(())
}

/// Writes the files of a stream into a folder, in place of an earlier capture.
///
/// If the stream is cut short, its last whole `frame.json` counts. If it has none, the folder stays unchanged.
///
/// # Errors
/// [`UnpackError`].
pub fn unpack(stream: &mut dyn Read, folder: &Path, limits: &Limits) -> Result<(), UnpackError> {
    let writer = Writer::new(folder, limits).map_err(UnpackError::Write)?;
    let mut archive = Archive::new(stream);
    let mut bytes = 0;
    let mut file = None;
    for entry in archive.entries().map_err(UnpackError::Read)? {
        // The stream is cut short here.
        let Ok(mut entry) = entry else { break };
        // Writing a file creates its folder.
        if entry.header().entry_type() == EntryType::Directory {
            continue;
        }
        let name = String::from_utf8_lossy(&entry.path_bytes()).into_owned();
        let is_file = name == FILE || name == PACKED;
        let datum = name.strip_prefix("data/").filter(|n| digits(n).is_some());
        if !(is_file || datum.is_some()) || entry.header().entry_type() != EntryType::Regular {
            return Err(UnpackError::Name(name));
        }
        limits.check(
            "file-bytes",
            entry.size(),
            format_args!("the bytes of {name}"),
        )?;
        bytes += entry.size();
        limits.check("scene-bytes", bytes, "the bytes of the capture")?;
        // An entry that is longer than the rest of the stream is cut off.
        let mut content = Vec::new();
        let read = entry.read_to_end(&mut content).map_err(UnpackError::Read)?;
        if read as u64 != entry.size() {
            break;
        }
        match datum {
            Some(datum) => {
                let written = writer.data(datum.to_owned(), content);
                written.map_err(UnpackError::Write)?;
            }
            None => file = Some((name, content)),
        }
    }
    let written = match file {
        Some((name, content)) if name == PACKED => writer.finish_as(PACKED, content),
        Some((_, content)) => writer.finish(content),
        None => return Err(UnpackError::Empty),
    };
    written.map_err(UnpackError::Write)
}
