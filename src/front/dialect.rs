//! Which WGSL a file is: plain, naga_oil's with `#import` and `#ifdef`, or WESL.

use std::path::Path;

use preshade_passes::program::Searched;
#[cfg(any(feature = "naga-oil", feature = "wesl"))]
use preshade_passes::program::Wanted;

#[cfg(any(feature = "naga-oil", feature = "wesl"))]
use super::Options;
use super::Source;
use super::error::{Code, Error};

/// A language that is WGSL and more.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Dialect {
    /// WGSL.
    Plain,
    /// Modules put together by the crate `naga_oil`.
    NagaOil,
    /// WESL: `import` and `@if`, by the crate `wesl`.
    Wesl,
}

impl Dialect {
    /// By the file's ending, and by what no plain WGSL has in it.
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
        match source.text.lines().any(is_directive) {
            true => Self::NagaOil,
            false => Self::Plain,
        }
    }
}

/// The WGSL that a file comes to, and what it came of.
#[cfg_attr(
    not(any(feature = "naga-oil", feature = "wesl")),
    allow(dead_code, reason = "a build with neither makes none")
)]
pub(super) struct Compiled {
    /// WGSL.
    pub text: String,
    /// What it came of.
    pub origin: Origin,
}

/// What a text came of beside the file itself.
#[derive(Default)]
pub(super) struct Origin {
    /// The other files that it was made of, each with its path and its text.
    pub imported: Vec<(String, String)>,
    /// Files that were looked for in vain before another was found.
    pub absent: Vec<String>,
    /// Searches for them.
    pub searched: Vec<Searched>,
}

/// Whether a search would come to the same now.
pub(crate) fn still_finds(searched: &Searched) -> bool {
    let Searched {
        folders,
        wanted,
        found,
    } = searched;
    match wanted {
        #[cfg(feature = "naga-oil")]
        Wanted::Modules => super::naga_oil::found(folders) == *found,
        #[cfg(feature = "wesl")]
        Wanted::Package(name) => super::wesl::found(folders, name) == *found,
        #[cfg(not(all(feature = "naga-oil", feature = "wesl")))]
        _ => {
            let _ = (folders, found);
            false
        }
    }
}

/// What a build without a dialect's feature says.
#[cfg_attr(
    all(feature = "naga-oil", feature = "wesl"),
    allow(dead_code, reason = "a build with both reads everything")
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

/// A folder that holds what tools made: cargo's and others' caches, which say so by a file (the Cache Directory Tagging Specification), and a build script's folder for output.
#[cfg(feature = "naga-oil")]
fn is_made(folder: &Path) -> bool {
    let is_out = || {
        let out = std::env::var_os("OUT_DIR").and_then(|out| Path::new(&out).canonicalize().ok());
        out.is_some() && out == folder.canonicalize().ok()
    };
    folder.join("CACHEDIR.TAG").is_file() || is_out()
}

/// Files below the folders given, with one of the endings, each once and with its path; the same order each time. Folders below them that tools made are left out.
#[cfg(feature = "naga-oil")]
pub(super) fn files_below(
    folders: &[&Path],
    ending: &str,
    options: &Options,
) -> Vec<(std::path::PathBuf, String)> {
    type Seen = std::collections::HashSet<std::path::PathBuf>;
    fn walk(
        folder: &Path,
        ending: &str,
        options: &Options,
        seen: &mut Seen,
        out: &mut Vec<(std::path::PathBuf, String)>,
    ) {
        let entries = std::fs::read_dir(folder).into_iter().flatten();
        let mut paths: Vec<_> = entries.filter_map(|e| Some(e.ok()?.path())).collect();
        paths.sort();
        // What lies in a folder goes before what lies below it.
        let (below, files): (Vec<_>, Vec<_>) = paths.into_iter().partition(|path| path.is_dir());
        // A link may lead back, and one folder given may lie in another.
        let mut is_new = |path: &Path| path.canonicalize().is_ok_and(|whole| seen.insert(whole));
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
    let mut seen = Seen::new();
    let mut out = Vec::new();
    for folder in folders {
        walk(folder, ending, options, &mut seen, &mut out);
    }
    out
}

/// The text of a file that a shader may import: one that lies in [`Options::root`], links followed, is a file, and no larger than a source may be.
#[cfg(any(feature = "naga-oil", feature = "wesl"))]
pub(super) fn text_within(path: &Path, options: &Options) -> Option<String> {
    let real = path.canonicalize().ok()?;
    let root = options.root.as_ref();
    let within = root.is_none_or(|root| {
        let whole = root.canonicalize();
        real.starts_with(whole.as_deref().unwrap_or(root))
    });
    let text = || crate::regular::text(&real, &options.limits, "source-bytes").ok();
    within.then(text).flatten()
}

/// Where a file lies: names are relative to [`Options::root`], where there is one.
#[cfg(any(feature = "naga-oil", feature = "wesl"))]
pub(super) fn path_of(source: &Source, options: &Options) -> std::path::PathBuf {
    let root = options.root.as_deref().unwrap_or(Path::new(""));
    root.join(&source.name)
}

/// The folder that a file is in.
#[cfg(any(feature = "naga-oil", feature = "wesl"))]
pub(super) fn beside(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// A definition as a dialect has it.
#[cfg(any(feature = "naga-oil", feature = "wesl"))]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Defined {
    Bool(bool),
    Int(i32),
    #[cfg_attr(
        not(feature = "naga-oil"),
        allow(dead_code, reason = "WESL has truths alone")
    )]
    Uint(u32),
}

/// The definitions of [`Options::defines`]: `true`, `false`, `3` or `3u`.
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
                format!("`{name}` is defined as `{text}`, and this dialect has true, false and whole numbers"),
            )
        });
        Ok((name.clone(), value?))
    });
    all.collect()
}
