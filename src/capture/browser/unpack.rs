//! A frame folder from a tar stream, which a page wrote: names and sizes are checked.

use std::fs;
use std::io::{self, Read};
use std::path::Path;

use tar::{Archive, EntryType};

use crate::capture::codes;
use crate::capture::folder::{self, FILE, PACKED};
use crate::limits::{Exceeded, Limits};

/// The stream or the folder is none.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum UnpackError {
    /// It holds what a frame folder does not.
    #[error("the capture holds `{0}`, which no frame folder has")]
    Name(String),
    /// It is larger than allowed.
    #[error(transparent)]
    Limit(#[from] Exceeded),
    /// It ends before the first frame.
    #[error("the capture holds no whole frame")]
    Empty,
    /// It is no tar stream.
    #[error("no capture: {0}")]
    Read(io::Error),
    /// A file cannot be written.
    #[error("cannot write the capture: {0}")]
    Write(io::Error),
    /// The folder holds something else.
    #[error("`{0}` holds other files than a capture: name a new folder")]
    Occupied(String),
}

impl UnpackError {
    /// The stable error code.
    pub fn code(&self) -> &'static str {
        codes::CAPTURE.code
    }
}

const DATA: &str = "data";

/// Makes an empty folder. One that holds an older capture is emptied, any other is refused.
///
/// # Errors
/// [`UnpackError`].
pub fn prepare(folder: &Path) -> Result<(), UnpackError> {
    let entries = match fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(e) if e.kind() == io::ErrorKind::NotFound => {
            return fs::create_dir_all(folder).map_err(UnpackError::Write);
        }
        Err(e) => return Err(UnpackError::Write(e)),
    };
    let mut names = Vec::new();
    for entry in entries {
        names.push(entry.map_err(UnpackError::Write)?.file_name());
    }
    if (names.iter()).any(|name| ![FILE, PACKED, DATA].iter().any(|own| name == own)) {
        return Err(UnpackError::Occupied(folder.display().to_string()));
    }
    for file in [FILE, PACKED] {
        if names.iter().any(|name| name == file) {
            fs::remove_file(folder.join(file)).map_err(UnpackError::Write)?;
        }
    }
    let data = folder.join(DATA);
    if !data.is_dir() {
        return Ok(());
    }
    for entry in fs::read_dir(&data).map_err(UnpackError::Write)? {
        let entry = entry.map_err(UnpackError::Write)?;
        if !is_data(&entry.file_name().to_string_lossy()) {
            return Err(UnpackError::Occupied(data.display().to_string()));
        }
        fs::remove_file(entry.path()).map_err(UnpackError::Write)?;
    }
    Ok(())
}

/// Whether `name` is that of a data file: 32 hexadecimal digits.
fn is_data(name: &str) -> bool {
    let digits = name.strip_suffix(".bin").unwrap_or_default();
    digits.len() == 32 && digits.bytes().all(|b| b.is_ascii_hexdigit())
}

/// Writes the files of a stream into a prepared folder. Where the stream is cut short, the last
/// `frame.json` that is whole counts.
///
/// # Errors
/// [`UnpackError`].
pub fn unpack(stream: &mut dyn Read, folder: &Path, limits: &Limits) -> Result<(), UnpackError> {
    fs::create_dir_all(folder.join(DATA)).map_err(UnpackError::Write)?;
    let mut archive = Archive::new(stream);
    let mut bytes = 0;
    let mut has_file = false;
    for entry in archive.entries().map_err(UnpackError::Read)? {
        // The rest is cut off.
        let Ok(mut entry) = entry else { break };
        // Files make their folders.
        if entry.header().entry_type() == EntryType::Directory {
            continue;
        }
        let name = String::from_utf8_lossy(&entry.path_bytes()).into_owned();
        let is_file = name == FILE || name == PACKED;
        let is_known = is_file || name.strip_prefix("data/").is_some_and(is_data);
        if !is_known || entry.header().entry_type() != EntryType::Regular {
            return Err(UnpackError::Name(name));
        }
        limits.check(
            "file-bytes",
            entry.size(),
            format_args!("the bytes of {name}"),
        )?;
        bytes += entry.size();
        limits.check("scene-bytes", bytes, "the bytes of the capture")?;
        // Larger than what the stream still holds: cut off.
        let mut content = Vec::new();
        let read = entry.read_to_end(&mut content).map_err(UnpackError::Read)?;
        if read as u64 != entry.size() {
            break;
        }
        let written = match name == FILE {
            true => folder::write(folder, &content),
            false => fs::write(folder.join(&name), &content),
        };
        written.map_err(UnpackError::Write)?;
        has_file |= is_file;
    }
    match has_file {
        true => Ok(()),
        false => Err(UnpackError::Empty),
    }
}
