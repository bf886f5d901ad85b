//! Reads whole files up to a size limit. Refuses devices and pipes, because they may never end. The
//! limit also holds for sparse files.

use std::fs::File;
use std::io::{self, Read as _};
use std::path::Path;

use crate::limits::{Exceeded, Limits};

/// Why a file was not read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    #[error(transparent)]
    Io(#[from] io::Error),
    #[error("it is a folder")]
    Folder,
    /// A device, a pipe or a socket.
    #[error("it is no file but a device or a pipe; `-` stands for stdin")]
    Endless,
    /// The file is larger than the limit.
    #[error("{0}")]
    TooLarge(#[from] Exceeded),
    /// Not UTF-8 from this byte offset on.
    #[error("not UTF-8 text (byte {0})")]
    NoText(usize),
    /// Binary, in this known format.
    #[error("it is {0}")]
    Binary(&'static str),
}

impl From<ReadError> for io::Error {
    fn from(error: ReadError) -> Self {
        match error {
            ReadError::Io(error) => error,
            other => Self::new(io::ErrorKind::InvalidInput, other.to_string()),
        }
    }
}

/// Reads a file of up to as many bytes as the named limit allows.
///
/// # Errors
/// [`ReadError`].
pub fn bytes(path: &Path, limits: &Limits, limit: &'static str) -> Result<Vec<u8>, ReadError> {
    // Not by opening it: opening a pipe would wait for its writer.
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
    decode(bytes(path, limits, limit)?)
}

/// First bytes of binary files that users often pass in place of text.
const BINARY: [(&[u8], &str); 4] = [
    (
        b"glTF",
        "a glTF mesh: a scene file names it, as `gltf = { file = \"..\" }` \
         (docs/reference/scene-geometry.md)",
    ),
    (
        &[0x03, 0x02, 0x23, 0x07],
        "SPIR-V, where a text is expected",
    ),
    (
        b"DXBC",
        "a compiled HLSL shader: compile it to SPIR-V with `dxc -spirv`",
    ),
    (b"\x89PNG", "a picture"),
];

/// The text of a file: UTF-8, or UTF-16 with a byte order mark, as Windows editors write it.
///
/// # Errors
/// [`ReadError::NoText`] or [`ReadError::Binary`].
pub fn decode(bytes: Vec<u8>) -> Result<String, ReadError> {
    if let Some((_, what)) = BINARY.iter().find(|(start, _)| bytes.starts_with(start)) {
        return Err(ReadError::Binary(what));
    }
    match bytes.as_slice() {
        [0xff, 0xfe, rest @ ..] => return utf16(rest, u16::from_le_bytes),
        [0xfe, 0xff, rest @ ..] => return utf16(rest, u16::from_be_bytes),
        _ => {}
    }
    // Latin letters in UTF-16 are valid UTF-8, each with a zero byte.
    let zeros = bytes.iter().filter(|b| **b == 0).count();
    if zeros * 3 > bytes.len() {
        let (pairs, _) = bytes.as_chunks::<2>();
        let halves = [0, 1].map(|half| pairs.iter().filter(|p| p[half] == 0).count());
        return Err(ReadError::Binary(match halves.contains(&0) {
            true => "UTF-16 without a byte order mark: save it as UTF-8",
            false => "no text",
        }));
    }
    String::from_utf8(bytes).map_err(|e| ReadError::NoText(e.utf8_error().valid_up_to()))
}

fn utf16(bytes: &[u8], unit: fn([u8; 2]) -> u16) -> Result<String, ReadError> {
    let (pairs, rest) = bytes.as_chunks::<2>();
    let units: Vec<u16> = pairs.iter().copied().map(unit).collect();
    match String::from_utf16(&units) {
        Ok(text) if rest.is_empty() => Ok(text),
        _ => Err(ReadError::Binary("broken UTF-16: save it as UTF-8")),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn utf16_is_read_with_its_mark_and_named_without() {
        let text = "fn é() {}";
        let little = |text: &str| -> Vec<u8> {
            let units = text.encode_utf16();
            units.flat_map(u16::to_le_bytes).collect()
        };
        let big = format!("\u{feff}{text}");
        let big = big.encode_utf16().flat_map(u16::to_be_bytes).collect();
        for bytes in [
            text.as_bytes().to_vec(),
            little(&format!("\u{feff}{text}")),
            big,
        ] {
            assert_eq!(decode(bytes).unwrap(), text);
        }
        let unmarked = decode(little(text)).unwrap_err().to_string();
        assert!(
            unmarked.contains("UTF-16 without a byte order mark"),
            "{unmarked}"
        );
        // Half of an executable's bytes are 0 too, but in irregular positions.
        let binary = b"\x7fELF\x02\x01\x01\0\0\0\0\0\0\0\0\0\x03\0\x3e\0".to_vec();
        let binary = decode(binary).unwrap_err().to_string();
        assert_eq!(binary, "it is no text");
        let mut cut = little(&format!("\u{feff}{text}"));
        cut.pop();
        assert!(matches!(decode(cut), Err(ReadError::Binary(_))));
    }

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
        assert!(matches!(
            decode(b"glTF\x02".to_vec()),
            Err(ReadError::Binary(_))
        ));
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
