//! The author's files in one address space of offsets, and types for the results of readers:
//! locations, languages, and modules that naga refuses.

use serde::{Deserialize, Serialize};

/// One file of the author's source.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SourceFile {
    /// Name in messages: a path as the user gave it, or `<stdin>`.
    pub name: String,
    pub text: String,
    /// Offset in bytes of the file's first byte in the map's address space.
    pub base: u32,
    /// Start of each line in the text, to find a place in a long file quickly.
    lines: Vec<u32>,
    /// Whether the file was derived from another one, such as an imported module.
    pub is_imported: bool,
}

/// The author's files in one address space of byte offsets, for naga's [`naga::Span`]: spans of a
/// module linked from two files are unambiguous.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SourceMap {
    files: Vec<SourceFile>,
    absent: Vec<String>,
    searched: Vec<Searched>,
}

/// A search of folders that the program's list of files depends on. A new match may come before the
/// old ones, or conflict with them.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Searched {
    pub folders: Vec<String>,
    pub wanted: SearchTarget,
    /// The matches in order, one word each.
    pub found: Vec<String>,
}

/// The target of a search.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SearchTarget {
    /// Files at any depth that define a module (naga_oil's `#define_import_path`).
    Modules,
    /// Folders of a package of this name.
    Package(String),
}

/// A place in the author's source.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct Location {
    /// File name, as in [`SourceFile::name`].
    pub file: String,
    /// Line, from 1.
    pub line: u32,
    /// Column in characters, from 1.
    pub column: u32,
    /// Byte range within the file, `start..end`.
    pub range: std::ops::Range<u32>,
}

impl SourceMap {
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a file and returns its base offset. One byte is left between files so that no span can
    /// touch two.
    pub fn add(&mut self, name: impl Into<String>, text: impl Into<String>) -> u32 {
        let base = self
            .files
            .last()
            .map_or(0, |f| f.base + f.text.len() as u32 + 1);
        let text: String = text.into();
        let ends = text.match_indices('\n').map(|(at, _)| at as u32 + 1);
        self.files.push(SourceFile {
            name: name.into(),
            lines: std::iter::once(0).chain(ends).collect(),
            text,
            base,
            is_imported: false,
        });
        base
    }

    /// Adds a file that was derived from another one, once: an imported module, or text from debug
    /// information. Returns its base offset.
    pub fn add_imported(&mut self, name: impl Into<String>, text: impl Into<String>) -> u32 {
        let (name, text) = (name.into(), text.into());
        let is = |f: &&SourceFile| f.is_imported && f.name == name && f.text == text;
        if let Some(known) = self.files.iter().find(is) {
            return known.base;
        }
        let base = self.add(name, text);
        if let Some(added) = self.files.last_mut() {
            added.is_imported = true;
        }
        base
    }

    /// Records a missing file that was searched for before another was found. If it appears, the
    /// program changes.
    pub fn add_absent(&mut self, name: impl Into<String>) {
        let name = name.into();
        if !self.absent.contains(&name) {
            self.absent.push(name);
        }
    }

    /// Records a search, once.
    pub fn add_searched(&mut self, searched: Searched) {
        if !self.searched.contains(&searched) {
            self.searched.push(searched);
        }
    }

    /// Searches that the program depends on.
    pub fn searched(&self) -> &[Searched] {
        &self.searched
    }

    /// Files that were searched for but not found.
    pub fn absent(&self) -> &[String] {
        &self.absent
    }

    /// The files, in the order they were added.
    pub fn files(&self) -> &[SourceFile] {
        &self.files
    }

    /// The file a span of this map lies in.
    pub fn file_of(&self, span: naga::Span) -> Option<&SourceFile> {
        let range = span.to_range()?;
        self.files
            .iter()
            .rev()
            .find(|f| range.start as u32 >= f.base)
            .filter(|f| range.end <= f.base as usize + f.text.len())
    }

    /// Line and column of a span, or `None` for an undefined span or one that lies in no file.
    pub fn locate(&self, span: naga::Span) -> Option<Location> {
        let file = self.file_of(span)?;
        let range = span.to_range()?;
        let (start, end) = (range.start as u32 - file.base, range.end as u32 - file.base);
        let line = file.lines.partition_point(|begin| *begin <= start);
        let begin = *file.lines.get(line.checked_sub(1)?)?;
        let before = file.text.get(begin as usize..start as usize)?;
        let (line, column) = (line as u32, before.chars().count() as u32 + 1);
        Some(Location {
            file: file.name.clone(),
            line,
            column,
            range: start..end,
        })
    }
}

/// The language the author wrote in, or compiled to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Language {
    /// WebGPU Shading Language.
    Wgsl,
    /// GLSL of any version.
    Glsl,
    /// A SPIR-V module.
    #[serde(rename = "spirv")]
    SpirV,
}

/// naga's validator refused a module. From a front end it is the author's error; after a pass it is
/// always a bug of ours.
#[derive(Debug, thiserror::Error)]
#[error("{message}")]
pub struct Invalid {
    /// naga's message with the chain of its causes.
    pub message: String,
    /// The spans in naga's error, with their messages.
    pub labels: Vec<(naga::Span, String)>,
}
