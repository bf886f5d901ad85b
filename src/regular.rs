//! Reads whole files up to a size limit. Devices and pipes are refused, since they may never end,
//! and the limit holds for sparse files too.

use std::fs::File;
use std::io::{self, Read as _};
use std::path::Path;

use crate::limits::{Exceeded, Limits};

/// A file that was not read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// The system's own error.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// A folder.
    #[error("it is a folder")]
    Folder,
    /// A device, a pipe or a socket.
    #[error("it is no file but a device or a pipe; `-` stands for stdin")]
    Endless,
    /// It is larger than allowed.
    #[error("{0}")]
    TooLarge(#[from] Exceeded),
    /// It is not UTF-8 from this byte on.
    #[error("not UTF-8 text (byte {0})")]
    NoText(usize),
}

impl From<ReadError> for io::Error {
    fn from(error: ReadError) -> Self {
        match error {
            ReadError::Io(error) => error,
            other => Self::new(io::ErrorKind::InvalidInput, other.to_string()),
        }
    }
}

/// Reads a file, up to the number of bytes that the named limit allows.
///
/// # Errors
/// [`ReadError`].
pub fn bytes(path: &Path, limits: &Limits, limit: &'static str) -> Result<Vec<u8>, ReadError> {
    // By name: opening a pipe would wait for its writer.
    let about = std::fs::metadata(path)?;
    if about.is_dir() {
        return Err(ReadError::Folder);
    }
    if !about.is_file() {
        return Err(ReadError::Endless);
    }
    let check = |n: u64| limits.check(limit, n, format_args!("the bytes of {}", path.display()));
    check(about.len())?;
    let mut bytes = Vec::new();
    // The file may grow meanwhile.
    let most = limits.of(limit);
    File::open(path)?
        .take(most.saturating_add(1))
        .read_to_end(&mut bytes)?;
    check(bytes.len() as u64)?;
    Ok(bytes)
}

/// [`bytes`], as text.
///
/// # Errors
/// [`ReadError`].
pub fn text(path: &Path, limits: &Limits, limit: &'static str) -> Result<String, ReadError> {
    String::from_utf8(bytes(path, limits, limit)?)
        .map_err(|e| ReadError::NoText(e.utf8_error().valid_up_to()))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn only_files_of_some_size_are_read() {
        let name = format!("preshade-regular-{}", std::process::id());
        let folder = std::env::temp_dir().join(name);
        std::fs::create_dir_all(&folder).unwrap();
        let limits = Limits {
            source_bytes: 4,
            ..Limits::default()
        };
        let read = |path: &Path| text(path, &limits, "source-bytes");
        let path = folder.join("a.wgsl");
        std::fs::write(&path, "abcd").unwrap();
        assert_eq!(read(&path).unwrap(), "abcd");
        std::fs::write(&path, "abcde").unwrap();
        assert!(matches!(read(&path), Err(ReadError::TooLarge(_))));
        std::fs::write(&path, b"ab\xff").unwrap();
        assert!(matches!(read(&path), Err(ReadError::NoText(2))));
        // A sparse file of one terabyte.
        File::create(&path).unwrap().set_len(1 << 40).unwrap();
        assert!(matches!(read(&path), Err(ReadError::TooLarge(_))));
        assert!(matches!(read(&folder), Err(ReadError::Folder)));
        assert!(matches!(read(&folder.join("none")), Err(ReadError::Io(_))));
        if cfg!(unix) {
            assert!(matches!(
                read(Path::new("/dev/zero")),
                Err(ReadError::Endless)
            ));
        }
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
