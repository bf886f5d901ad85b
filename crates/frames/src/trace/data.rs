//! Data of a trace. Until the folder is written, a data name is an index into [`Store`].

use std::path::{Path, PathBuf};
use std::sync::Arc;

use wgpu_core::device::trace::Data;

use super::TraceError;
use crate::file::DataName;
use shader_text::limits::Limits;
use shader_text::read_limited;

/// The data of a trace: files and bytes, read on demand.
pub struct Store {
    folder: PathBuf,
    limits: Limits,
    all: Vec<BytesSource>,
}

#[derive(Clone)]
enum BytesSource {
    /// A file, and how many of its bytes count (`None`: all).
    File(String, Option<u64>),
    Bytes(Arc<[u8]>),
}

impl Store {
    pub fn new(folder: &Path, limits: &Limits) -> Self {
        Self {
            folder: folder.to_owned(),
            limits: *limits,
            all: Vec::new(),
        }
    }

    /// Adds the data of an action. Reads a file only when its content is needed.
    pub fn add(&mut self, data: Data, size: Option<u64>) -> Result<DataName, TraceError> {
        let source = match data {
            Data::File(name) => {
                let is_plain = name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'.');
                if !is_plain || name.starts_with('.') {
                    return Err(TraceError::DataName(name));
                }
                BytesSource::File(name, size)
            }
            Data::String(_, text) => BytesSource::Bytes(text.into_bytes().into()),
            Data::Binary(_, bytes) => BytesSource::Bytes(bytes.into()),
        };
        Ok(self.push(source))
    }

    /// Adds data that this reader generated.
    pub fn add_bytes(&mut self, bytes: Vec<u8>) -> DataName {
        self.push(BytesSource::Bytes(bytes.into()))
    }

    fn push(&mut self, source: BytesSource) -> DataName {
        self.all.push(source);
        name(&format!("{:032x}", self.all.len() - 1))
    }

    fn source(&self, name: &DataName) -> Option<&BytesSource> {
        let number = usize::from_str_radix(&String::from(name.clone()), 16);
        number.ok().and_then(|n| self.all.get(n))
    }

    /// Bytes of a write to a buffer.
    pub fn size(&self, name: &DataName) -> u64 {
        match self.source(name) {
            Some(BytesSource::File(_, size)) => size.unwrap_or(0),
            Some(BytesSource::Bytes(bytes)) => bytes.len() as u64,
            None => 0,
        }
    }

    pub fn bytes(&self, name: &DataName) -> Result<Arc<[u8]>, TraceError> {
        match self.source(name) {
            Some(BytesSource::File(name, size)) => self.file(name, *size),
            Some(BytesSource::Bytes(bytes)) => Ok(Arc::clone(bytes)),
            None => Ok(Arc::from([])),
        }
    }

    fn file(&self, name: &str, size: Option<u64>) -> Result<Arc<[u8]>, TraceError> {
        let wrong = |error| TraceError::Data {
            name: name.to_owned(),
            error,
        };
        let path = self.folder.join(name);
        // A link could lead out of the folder.
        let about = std::fs::symlink_metadata(&path).map_err(|e| wrong(e.into()))?;
        if about.is_symlink() {
            return Err(TraceError::DataName(name.to_owned()));
        }
        let mut bytes = read_limited::bytes(&path, &self.limits, "file-bytes").map_err(wrong)?;
        if let Some(size) = size {
            if (bytes.len() as u64) < size {
                return Err(TraceError::Short {
                    name: name.to_owned(),
                    has: bytes.len() as u64,
                    needed: size,
                });
            }
            bytes.truncate(size as usize);
        }
        Ok(bytes.into())
    }
}

/// A data name from 32 hexadecimal digits.
pub(super) fn name(digits: &str) -> DataName {
    match DataName::try_from(digits.to_owned()) {
        Ok(name) => name,
        Err(error) => unreachable!("{error}"),
    }
}
