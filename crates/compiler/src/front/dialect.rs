//! Detects a file's WGSL dialect: plain WGSL, naga_oil (`#import`, `#ifdef`) or WESL.

use std::path::Path;

use shader_text::source::Searched;

use super::Source;
use shader_text::error::{Code, Error};
#[cfg(any(feature = "naga-oil", feature = "wesl"))]
use shader_text::options::Options;
use shader_text::tokens::without_comments;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Dialect {
    /// WGSL without extensions.
    Plain,
    /// Modules composed by the crate `naga_oil`.
    NagaOil,
    /// WESL (`import`, `@if`), compiled by the crate `wesl`.
    Wesl,
}

impl Dialect {
    /// Decides by the file's extension and by directives that plain WGSL does not have.
    pub(super) fn of(source: &Source) -> Self {
        if Path::new(&source.name)
            .extension()
            .is_some_and(|e| e == "wesl")
        {
            return Self::Wesl;
        }
        let is_directive = |line: &str| {
            let words = [
                "#import",
                "#define_import_path",
                "#ifdef",
                "#ifndef",
                "#if ",
                "#define ",
            ];
            let line = line.trim_start();
            words.iter().any(|w| line.starts_with(w)) || line.contains("#{")
        };
        // In WGSL, no line begins with this word.
        let is_import = |line: &str| line.starts_with("import ");
        match without_comments(&source.text)
            .lines()
            .find(|l| is_directive(l) || is_import(l))
        {
            Some(line) if is_import(line) => Self::Wesl,
            Some(_) => Self::NagaOil,
            None => Self::Plain,
        }
    }
}

/// A file compiled to WGSL.
#[cfg_attr(
    not(any(feature = "naga-oil", feature = "wesl")),
    allow(dead_code, reason = "unused without both features")
)]
pub(super) struct Compiled {
    /// Plain WGSL.
    pub text: String,
    pub origin: CompiledFrom,
}

/// The inputs of a compilation besides the file itself.
#[derive(Default)]
pub(super) struct CompiledFrom {
    /// Imported files: path and text.
    pub imported: Vec<(String, String)>,
    /// Paths that did not exist when they were tried.
    pub absent: Vec<String>,
    /// Folder searches and their results.
    pub searched: Vec<Searched>,
}

/// The error for a dialect whose Cargo feature is off.
#[cfg_attr(
    all(feature = "naga-oil", feature = "wesl"),
    allow(dead_code, reason = "unused with both features")
)]
pub(super) fn not_built(source: &Source, language: &str, feature: &str) -> Error {
    Error::new(
        Code::Unsupported,
        format!(
            "{} is {language}, which this build cannot read",
            source.name
        ),
    )
    .note(format!("build preshade with the feature `{feature}`"))
}

/// The error of an import that no file provides, labelled at the line that names it first. The
/// source is alone in the error's source map.
#[cfg(any(feature = "naga-oil", feature = "wesl"))]
pub(super) fn no_module(source: &Source, module: &str, options: &Options) -> Error {
    let package = module.split("::").next().unwrap_or(module);
    let mut start = 0;
    let lines = source.text.split_inclusive('\n').map(|line| {
        start += line.len();
        (start - line.len(), line.trim_end())
    });
    let names = |line: &str| line.contains("import ") && line.contains(package);
    let at = lines.into_iter().find(|(_, line)| names(line));
    let span = at.map(|(at, line)| naga::Span::new(at as u32, (at + line.len()) as u32));
    let folders: Vec<String> = options
        .include
        .iter()
        .map(|f| format!("`{}`", f.display()))
        .collect();
    let searched = match folders.len() {
        0 => "searched: the file's own folder".to_owned(),
        1..=6 => format!("searched: the file's own folder, {}", folders.join(", ")),
        many => format!("searched: the file's own folder, and {many} that you include"),
    };
    let error = Error::new(Code::Parse, format!("there is no module `{module}`"))
        .label_if(span)
        .note(format!("{searched}; --include DIR adds a folder"));
    match package.starts_with("bevy") {
        true => error.note(format!(
            "`{package}` is a crate of Bevy: --include its folder in cargo's registry, and give \
             the definitions of Bevy's pipeline (docs/reference/wgsl-dialects.md)"
        )),
        false => error,
    }
}

/// Whether tools generated the folder: a cache (`CACHEDIR.TAG`) or a build script's `OUT_DIR`.
#[cfg(feature = "naga-oil")]
fn is_made(folder: &Path) -> bool {
    let is_out = || {
        let out = std::env::var_os("OUT_DIR").and_then(|out| Path::new(&out).canonicalize().ok());
        out.is_some() && out == folder.canonicalize().ok()
    };
    folder.join("CACHEDIR.TAG").is_file() || is_out()
}

/// Files with the extension `ending` below `folders`: path and text, each once, in a stable order.
/// Generated folders are skipped.
#[cfg(feature = "naga-oil")]
pub(super) fn files_below(
    folders: &[&Path],
    ending: &str,
    options: &Options,
) -> Vec<(std::path::PathBuf, String)> {
    type Visited = std::collections::HashSet<std::path::PathBuf>;
    fn walk(
        folder: &Path,
        ending: &str,
        options: &Options,
        seen: &mut Visited,
        out: &mut Vec<(std::path::PathBuf, String)>,
    ) {
        let memory = &options.files;
        let paths = memory.entries(folder).into_iter();
        // A folder's own files come before those of its subfolders.
        let (below, files): (Vec<_>, Vec<_>) = paths.partition(|path| memory.is_folder(path));
        // Links can form a cycle, and one folder can lie in another.
        let mut is_new = |path: &Path| memory.canonical(path).is_ok_and(|whole| seen.insert(whole));
        for path in files {
            if path.extension().is_some_and(|e| e == ending)
                && is_new(&path)
                && let Some(text) = text_within(&path, options)
            {
                out.push((path, text));
            }
        }
        let below: Vec<_> = below.into_iter().filter(|path| is_new(path)).collect();
        for folder in below.iter().filter(|folder| !is_made(folder)) {
            walk(folder, ending, options, seen, out);
        }
    }
    let mut seen = Visited::new();
    let mut out = Vec::new();
    for folder in folders {
        walk(folder, ending, options, &mut seen, &mut out);
    }
    out
}

/// Reads a file that a shader may import: one in memory, or a regular file inside of
/// [`Options::root`] (after following links), within the size limit.
#[cfg(any(feature = "naga-oil", feature = "wesl"))]
pub(super) fn text_within(path: &Path, options: &Options) -> Option<String> {
    if let Some(text) = options.in_memory(path) {
        let limits = &options.limits;
        let fits = limits.check("source-bytes", text.len() as u64, path.display());
        return fits.is_ok().then(|| text.to_owned());
    }
    let real = path.canonicalize().ok()?;
    let root = options.root.as_ref();
    let within = root.is_none_or(|root| {
        let whole = root.canonicalize();
        real.starts_with(whole.as_deref().unwrap_or(root))
    });
    let text = || shader_text::read_limited::text(&real, &options.limits, "source-bytes").ok();
    within.then(text).flatten()
}

/// The path of a source. Names are relative to [`Options::root`].
#[cfg(any(feature = "naga-oil", feature = "wesl"))]
pub(super) fn path_of(source: &Source, options: &Options) -> std::path::PathBuf {
    let root = options.root.as_deref().unwrap_or(Path::new(""));
    root.join(&source.name)
}

/// The folder of a file.
#[cfg(any(feature = "naga-oil", feature = "wesl"))]
pub(super) fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// The value of a preprocessor definition.
#[cfg(any(feature = "naga-oil", feature = "wesl"))]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Defined {
    Bool(bool),
    Int(i32),
    Uint(u32),
}

/// Parses [`Options::defines`]: `true`, `false`, `3` or `3u`.
#[cfg(any(feature = "naga-oil", feature = "wesl"))]
pub(super) fn definitions(options: &Options) -> Result<Vec<(String, Defined)>, Error> {
    let value = |text: &str| match text {
        "true" => Some(Defined::Bool(true)),
        "false" => Some(Defined::Bool(false)),
        _ => match text.strip_suffix('u') {
            Some(digits) => digits.parse().ok().map(Defined::Uint),
            None => text.parse().ok().map(Defined::Int),
        },
    };
    let all = options.defines.iter().map(|(name, text)| {
        let value = value(text).ok_or_else(|| {
            Error::new(
                Code::Unsupported,
                format!(
                    "`{name}` is defined as `{text}`, but this dialect only allows true, false and \
                     integers"
                ),
            )
        });
        Ok((name.clone(), value?))
    });
    all.collect()
}
