//! The author's text becomes a [`Program`]: the only place that knows a source language.
//!
//! [`parse`] takes a material as one WGSL file with both entry points, as two WGSL files, or as a GLSL vertex and a GLSL fragment file. Two
//! files are linked into one naga module, so that everything after this sees one program whatever it came from.
//!
//! In data-flow order: `nesting` refuses what would exhaust the stack, `guard` runs naga, `glsl` and `wgsl` parse one file, `link` joins
//! two modules, `entry` chooses entry points and checks that the stages fit. Every error is an [`Error`] that points at the author's text.

mod declaration;
mod entry;
mod error;
#[cfg(feature = "glsl")]
mod glsl;
pub(crate) mod guard;
#[cfg(feature = "glsl")]
mod macros;
mod nesting;
pub(crate) mod operands;
#[cfg(feature = "glsl")]
mod promote;
#[cfg(feature = "glsl")]
mod switch;
pub(crate) mod varying;
mod wgsl;

use std::borrow::Cow;
use std::path::Path;
use std::sync::Arc;

use naga::ShaderStage;
use preshade_passes::program::{Language, Program, SourceMap};

pub use error::{Code, Color, Error, Label};

/// One file of a material.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Source {
    /// Name to print in messages: a path as the user gave it, or `<stdin>`.
    pub name: String,
    /// The whole text.
    pub text: String,
    /// Language; `None` goes by the name's extension.
    pub language: Option<Language>,
    /// Stage of a GLSL file; `None` goes by the name's extension. Ignored for WGSL, whose entry points say it.
    pub stage: Option<ShaderStage>,
}

impl Source {
    /// A source whose language and stage go by the name's extension: `.wgsl`; `.vert` and `.vs`; `.frag`, `.fs` and, as most fragment
    /// shaders on the web are named so, `.glsl`. A last extension `.glsl` may follow one that names the stage (`a.vert.glsl`).
    pub fn new(name: impl Into<String>, text: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            text: text.into(),
            language: None,
            stage: None,
        }
    }

    /// The same source with its language given.
    #[must_use]
    pub fn with_language(mut self, language: Language) -> Self {
        self.language = Some(language);
        self
    }

    /// The same source with its stage given.
    #[must_use]
    pub fn with_stage(mut self, stage: ShaderStage) -> Self {
        self.stage = Some(stage);
        self
    }

    fn language(&self) -> Option<Language> {
        self.language.or_else(|| match extension(&self.name)? {
            "wgsl" => Some(Language::Wgsl),
            "vert" | "vs" | "frag" | "fs" | "glsl" => Some(Language::Glsl),
            _ => None,
        })
    }

    fn stage(&self) -> Option<ShaderStage> {
        fn by_extension(extension: &str) -> Option<ShaderStage> {
            match extension {
                "vert" | "vs" => Some(ShaderStage::Vertex),
                "frag" | "fs" => Some(ShaderStage::Fragment),
                _ => None,
            }
        }
        self.stage.or_else(|| match extension(&self.name)? {
            "glsl" => extension(self.name.strip_suffix(".glsl")?)
                .and_then(by_extension)
                .or(Some(ShaderStage::Fragment)),
            other => by_extension(other),
        })
    }
}

fn extension(name: &str) -> Option<&str> {
    Path::new(name).extension()?.to_str()
}

/// Choices a source may leave open.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Options {
    /// Vertex entry point; needed where there are several.
    pub vertex: Option<String>,
    /// Fragment entry point; needed where there are several.
    pub fragment: Option<String>,
    /// GLSL preprocessor definitions, name and value.
    pub defines: Vec<(String, String)>,
}

/// A material's program and the entry points that draw it.
#[derive(Clone, Debug)]
pub struct Parsed {
    /// Validated module of both stages, with the author's text.
    pub program: Program,
    /// Vertex entry point. GLSL's `main` is renamed to `vertex_main`.
    pub vertex: String,
    /// Fragment entry point, `fragment_main` from GLSL; `None` if the material has none and draws depth alone.
    pub fragment: Option<String>,
}

/// Parses a material of one or two files, links and validates it, and chooses its entry points.
///
/// # Errors
/// Whatever is wrong with the text, as a frame on it; see [`Code`] for the kinds. naga's own panics come back as [`Code::Panic`].
pub fn parse(sources: &[Source], options: &Options) -> Result<Parsed, Error> {
    let mut map = SourceMap::new();
    let bases: Vec<u32> = sources.iter().map(|s| map.add(&s.name, &s.text)).collect();
    let map = Arc::new(map);
    parse_mapped(sources, &bases, &map, options).map_err(|e| e.with_sources(&map))
}

fn parse_mapped(
    sources: &[Source],
    bases: &[u32],
    map: &Arc<SourceMap>,
    options: &Options,
) -> Result<Parsed, Error> {
    let language = check_sources(sources)?;
    for (source, base) in sources.iter().zip(bases) {
        nesting::check(&source.text, *base)?;
    }
    let names = sources
        .iter()
        .map(|s| s.name.as_str())
        .collect::<Vec<_>>()
        .join(" and ");
    guard::run(|| {
        let mut modules = Vec::new();
        for (source, base) in sources.iter().zip(bases) {
            modules.push(match language {
                Language::Wgsl => wgsl::parse(&without_mark(&source.text), *base)?,
                Language::Glsl => parse_glsl(source, *base, options)?,
            });
        }
        let mut modules = modules.into_iter();
        let Some(mut module) = modules.next() else {
            return Err(Error::new(Code::Empty, "no source is given"));
        };
        if let (Some(second), Some(base)) = (modules.next(), bases.get(1)) {
            module = link(module, &second, *base, map)?;
        }
        let entries = entry::choose(&module, options, map)?;
        entry::check_interface(&module, &entries, map)?;
        let names = entry::names(&module);
        let program = Program::new(module, Arc::clone(map), language)
            .map_err(|invalid| entry::locate_invalid(Error::invalid(&invalid), &names, map))?;
        Ok(Parsed {
            program,
            vertex: entries.vertex,
            fragment: entries.fragment,
        })
    })
    .unwrap_or_else(|panicked| {
        Err(Error::new(
            Code::Panic,
            format!("naga, the parser preshade uses, panicked on {names}"),
        )
        .note(panicked.0)
        .note("this is a bug in naga or in preshade; please report it with the file"))
    })
}

/// Two files' modules as one.
fn link(
    first: naga::Module,
    second: &naga::Module,
    base: u32,
    map: &SourceMap,
) -> Result<naga::Module, Error> {
    let suffix = second
        .entry_points
        .first()
        .map_or("second", |e| entry::stage_name(e.stage));
    let linked = preshade_passes::link::link(first, second, base, suffix).map_err(|e| {
        // The members that differ, where the text shows them; else the variables.
        let members = e
            .members
            .iter()
            .map(|m| Some((declaration::member(map, m.of, &m.name)?, m.text.clone())))
            .collect::<Option<Vec<_>>>()
            .filter(|members| !members.is_empty());
        let error = members
            .unwrap_or_default()
            .into_iter()
            .chain(e.labels)
            .fold(Error::new(Code::Link, e.message), |error, (span, text)| {
                error.label(span, text)
            });
        e.note.into_iter().fold(error, Error::note)
    })?;
    Ok(linked.module)
}

/// The text with a byte order mark, which neither parser knows, made as many spaces.
fn without_mark(text: &str) -> Cow<'_, str> {
    match text.strip_prefix('\u{feff}') {
        Some(rest) => Cow::Owned(format!("   {rest}")),
        None => Cow::Borrowed(text),
    }
}

/// Checks that the sources make one material, and says in which language.
fn check_sources(sources: &[Source]) -> Result<Language, Error> {
    let Some(first) = sources.first() else {
        return Err(Error::new(Code::Empty, "no source is given"));
    };
    if sources.len() > 2 {
        return Err(Error::new(
            Code::Sources,
            format!(
                "a material has one file, or a vertex and a fragment file; {} are given",
                sources.len()
            ),
        ));
    }
    let mut languages = Vec::new();
    for source in sources {
        let Some(language) = source.language() else {
            return Err(Error::new(
                Code::UnknownLanguage,
                format!("cannot tell the language of {}", source.name),
            )
            .note("name it with --lang wgsl or --lang glsl, or by the extension .wgsl, .vert or .frag"));
        };
        if nesting::is_blank(&source.text) {
            return Err(Error::new(Code::Empty, format!("{} is empty", source.name)));
        }
        languages.push(language);
    }
    let language = languages[0];
    if let Some(other) = languages.iter().position(|l| *l != language) {
        return Err(Error::new(
            Code::Sources,
            format!(
                "{} and {} are in two languages",
                first.name, sources[other].name
            ),
        ));
    }
    if language == Language::Glsl {
        check_glsl_stages(sources)?;
    }
    Ok(language)
}

fn check_glsl_stages(sources: &[Source]) -> Result<(), Error> {
    if !cfg!(feature = "glsl") {
        return Err(Error::new(
            Code::Unsupported,
            format!("{} is GLSL, which this build cannot read", sources[0].name),
        )
        .note("build preshade with the feature `glsl`"));
    }
    let mut stages = Vec::new();
    for source in sources {
        match source.stage() {
            Some(stage @ (ShaderStage::Vertex | ShaderStage::Fragment)) => stages.push(stage),
            Some(other) => {
                return Err(Error::new(
                    Code::UnknownStage,
                    format!(
                        "{} is a {other:?} shader; a material has a vertex and a fragment stage",
                        source.name
                    ),
                ));
            }
            None => {
                return Err(Error::new(
                    Code::UnknownStage,
                    format!("cannot tell the stage of {}", source.name),
                )
                .note("name it by the extension: .vert or .frag"));
            }
        }
    }
    if sources.len() == 2 && stages[0] == stages[1] {
        return Err(Error::new(
            Code::Sources,
            format!(
                "{} and {} are both {} shaders",
                sources[0].name,
                sources[1].name,
                entry::stage_name(stages[0])
            ),
        ));
    }
    Ok(())
}

#[cfg(feature = "glsl")]
fn parse_glsl(source: &Source, base: u32, options: &Options) -> Result<naga::Module, Error> {
    let stage = source.stage().unwrap_or(ShaderStage::Fragment);
    glsl::parse(&without_mark(&source.text), stage, &options.defines, base)
}

#[cfg(not(feature = "glsl"))]
fn parse_glsl(source: &Source, _: u32, _: &Options) -> Result<naga::Module, Error> {
    Err(Error::new(
        Code::Unsupported,
        format!("{} is GLSL, which this build cannot read", source.name),
    ))
}
