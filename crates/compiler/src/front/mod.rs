//! Parses a material's source into a [`Program`]. No other module knows a source language.
//!
//! [`parse`] takes one WGSL file with both entry points, two WGSL files, a GLSL vertex and a GLSL
//! fragment file, or one or two SPIR-V modules. It links two files into one naga module.
//!
//! In data-flow order: `nesting` rejects text that would overflow the stack, `panics` runs naga,
//! `glsl`, `spirv` and `wgsl` parse one file, `link` joins two modules, and `entry` chooses entry points and
//! checks that the stages fit. Every [`Error`] points at the author's text.

mod declaration;
mod dialect;
mod entry;
mod locate_panic;
mod module_size;
#[cfg(feature = "naga-oil")]
mod naga_oil;
mod other_languages;
#[cfg(feature = "wesl")]
mod wesl;
mod wgsl;

use std::borrow::Cow;
use std::path::Path;
use std::sync::Arc;

use naga::ShaderStage;
use naga_edit::declared::Declared;
use naga_edit::link::Linked;
use preshade_plan::program::Program;
#[cfg(any(feature = "naga-oil", feature = "wesl"))]
use shader_text::source::SearchTarget;
use shader_text::source::{Language, Searched, SourceMap};

use self::dialect::{CompiledFrom, Dialect};
pub use shader_text::error::{Code, Color, Error, Label};
pub use shader_text::memory::Memory;
pub use shader_text::options::{ClipSpace, Options};
pub use wgsl::for_naga;

use shader_text::panics;
use shader_text::read_limited::{self, ReadError};

/// One file of a material.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Source {
    /// The name in messages: a path or `<stdin>`.
    pub name: String,
    /// The whole text. For SPIR-V a listing of the module, which messages point into.
    pub text: String,
    /// Language; `None`: by the name's extension.
    pub language: Option<Language>,
    /// Stage of a GLSL file; `None`: by the name's extension. Ignored for WGSL. Of a SPIR-V module,
    /// the only stage to take.
    pub stage: Option<ShaderStage>,
    /// The words of a SPIR-V module.
    words: Option<Vec<u32>>,
}

impl Source {
    /// A source whose extension gives language and stage: `.wgsl`; `.vert`, `.vs`; `.frag`, `.fs`,
    /// `.glsl`. Most fragment shaders on the web end in `.glsl`. The stage may also precede it
    /// (`a.vert.glsl`).
    pub fn new(name: impl Into<String>, text: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            text: text.into(),
            language: None,
            stage: None,
            words: None,
        }
    }

    /// A source of a file's bytes: text, as for [`Self::new`], or a SPIR-V module of either byte
    /// order.
    ///
    /// # Errors
    /// [`ReadError::NoText`] or [`ReadError::Binary`], if it is neither.
    pub fn from_bytes(name: impl Into<String>, bytes: Vec<u8>) -> Result<Self, ReadError> {
        #[cfg(feature = "spirv")]
        if let Some(words) = naga_spirv::words(&bytes) {
            return Ok(Self {
                words: Some(words.clone()),
                ..Self::new(name, naga_spirv::listed(&words))
            });
        }
        let name = name.into();
        let is_module = extension(&name) == Some("spv");
        let text = read_limited::decode(bytes).map_err(|error| match error {
            ReadError::NoText(_) | ReadError::Binary("no text") if is_module => {
                ReadError::Binary("no SPIR-V, whose first word is 0x07230203")
            }
            other => other,
        });
        Ok(Self::new(name, text?))
    }

    #[must_use]
    pub fn with_language(mut self, language: Language) -> Self {
        self.language = Some(language);
        self
    }

    #[must_use]
    pub fn with_stage(mut self, stage: ShaderStage) -> Self {
        self.stage = Some(stage);
        self
    }

    fn language(&self) -> Option<Language> {
        if self.words.is_some() {
            return Some(Language::SpirV);
        }
        self.language.or_else(|| match extension(&self.name)? {
            "spv" => Some(Language::SpirV),
            "wgsl" | "wesl" => Some(Language::Wgsl),
            "vert" | "vs" | "frag" | "fs" | "glsl" | "slang" => Some(Language::Glsl),
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

/// A material's program and its entry points.
#[derive(Clone, Debug)]
pub struct Parsed {
    /// Validated module of both stages, with the author's text.
    pub program: Program,
    /// Vertex entry point; `vertex_main` for GLSL.
    pub vertex: String,
    /// Fragment entry point; `fragment_main` for GLSL. `None` for a depth-only material.
    pub fragment: Option<String>,
}

/// Parses a material of one or two files, links and validates it, and chooses its entry points.
///
/// # Errors
/// Any error in the text, with labels on it; see [`Code`]. A panic in naga becomes [`Code::Panic`].
pub fn parse(sources: &[Source], options: &Options) -> Result<Parsed, Error> {
    let translated = sources.iter().map(|source| {
        translated(source, options).map_err(|error| {
            let mut map = SourceMap::new();
            let base = map.add(&source.name, &source.text);
            other_languages::named(error, std::slice::from_ref(source), &[base])
                .with_sources(&Arc::new(map))
        })
    });
    let translated = translated.collect::<Result<Vec<_>, _>>()?;
    let (plain, origins): (Vec<Cow<'_, Source>>, Vec<CompiledFrom>) =
        translated.into_iter().unzip();
    let plain: Vec<Source> = plain.into_iter().map(Cow::into_owned).collect();
    let sources = plain.as_slice();
    let mut map = SourceMap::new();
    let bases: Vec<u32> = sources.iter().map(|s| map.add(&s.name, &s.text)).collect();
    for origin in origins {
        for (name, text) in origin.imported {
            map.add_imported(name, text);
        }
        origin.absent.into_iter().for_each(|n| map.add_absent(n));
        let searched = origin.searched.into_iter();
        searched.for_each(|searched| map.add_searched(searched));
    }
    let (parsed, map) = parse_mapped(sources, &bases, map, options);
    parsed.map_err(|e| other_languages::named(e, sources, &bases).with_sources(&map))
}

/// Compiles naga_oil's dialect or WESL to WGSL. Other sources are returned unchanged.
fn translated<'a>(
    source: &'a Source,
    options: &Options,
) -> Result<(Cow<'a, Source>, CompiledFrom), Error> {
    let dialect = match source.language() {
        Some(Language::Wgsl) => Dialect::of(source),
        _ => Dialect::Plain,
    };
    let compile = || match dialect {
        Dialect::Plain => Ok(None),
        #[cfg(feature = "naga-oil")]
        Dialect::NagaOil => naga_oil::compile(source, options).map(Some),
        #[cfg(not(feature = "naga-oil"))]
        Dialect::NagaOil => Err(dialect::not_built(source, "naga_oil's WGSL", "naga-oil")),
        #[cfg(feature = "wesl")]
        Dialect::Wesl => wesl::compile(source, options).map(Some),
        #[cfg(not(feature = "wesl"))]
        Dialect::Wesl => Err(dialect::not_built(source, "WESL", "wesl")),
    };
    let compiled = match dialect {
        Dialect::Plain => None,
        _ => panics::run(compile)
            .unwrap_or_else(|panicked| Err(bug(std::slice::from_ref(source), &panicked)))?,
    };
    let _ = options;
    Ok(match compiled {
        None => (Cow::Borrowed(source), CompiledFrom::default()),
        Some(dialect::Compiled { text, origin }) => {
            let wgsl = Source {
                stage: source.stage,
                ..Source::new(format!("{} (as WGSL)", source.name), text)
                    .with_language(Language::Wgsl)
            };
            (Cow::Owned(wgsl), origin)
        }
    })
}

/// Whether a search has the same result now.
pub(crate) fn still_finds(searched: &Searched) -> bool {
    let Searched {
        folders,
        wanted,
        found,
    } = searched;
    match wanted {
        #[cfg(feature = "naga-oil")]
        SearchTarget::Modules => naga_oil::found(folders) == *found,
        #[cfg(feature = "wesl")]
        SearchTarget::Package(name) => wesl::found(folders, name) == *found,
        #[cfg(not(all(feature = "naga-oil", feature = "wesl")))]
        _ => {
            let _ = (folders, found);
            false
        }
    }
}

fn parse_mapped(
    sources: &[Source],
    bases: &[u32],
    mut map: SourceMap,
    options: &Options,
) -> (Result<Parsed, Error>, Arc<SourceMap>) {
    let checked = check_sources(sources).and_then(|language| {
        let texts = sources.iter().zip(bases);
        for (source, base) in texts.filter(|_| language != Language::SpirV) {
            shader_text::nesting::check(&source.text, *base, &options.limits, language)?;
        }
        Ok(language)
    });
    let language = match checked {
        Ok(language) => language,
        Err(error) => return (Err(error), Arc::new(map)),
    };
    // Parsing adds included files to the map.
    let read = panics::run(|| match language {
        Language::Wgsl => sources
            .iter()
            .zip(bases)
            .map(|(source, base)| wgsl::parse(&without_mark(&source.text), *base))
            .collect::<Result<_, _>>()
            .map(|modules| (modules, Declared::default())),
        Language::Glsl => parse_glsl(sources, bases, options, &mut map),
        Language::SpirV => parse_spirv(sources, bases, options, &mut map),
    });
    let map = Arc::new(map);
    let parsed = read
        .and_then(|modules| panics::run(|| assemble(modules?, bases, language, options, &map)))
        .unwrap_or_else(|panicked| Err(bug_at(sources, bases, language, &panicked)));
    (parsed, map)
}

/// [`bug`], with a label on the statement if it can be found.
fn bug_at(
    sources: &[Source],
    bases: &[u32],
    language: Language,
    panicked: &panics::Panicked,
) -> Error {
    let error = bug(sources, panicked);
    match language {
        Language::Wgsl => {}
        Language::Glsl => return error,
        Language::SpirV => {
            return error.note(
                "naga takes a module for valid: if `spirv-val` rejects it, the compiler that wrote \
                 it has the bug",
            );
        }
    }
    let panics = |text: &str| {
        let read = || {
            let module = wgsl::parse(text, 0).ok()?;
            naga::valid::Validator::new(
                naga::valid::ValidationFlags::all(),
                naga::valid::Capabilities::all(),
            )
            .validate(&module)
            .ok()
        };
        panics::run(read).is_err()
    };
    let mut found = sources.iter().zip(bases).filter_map(|(source, base)| {
        let range = locate_panic::panicking_statement(&without_mark(&source.text), &panics)?;
        Some(naga::Span::new(
            base + range.start as u32,
            base + range.end as u32,
        ))
    });
    match found.next() {
        Some(span) => error.label(span, "it panics at this"),
        None => error,
    }
}

fn bug(sources: &[Source], panicked: &panics::Panicked) -> Error {
    let names: Vec<&str> = sources.iter().map(|s| s.name.as_str()).collect();
    Error::new(
        Code::Panic,
        format!(
            "naga, the parser preshade uses, panicked on {}",
            names.join(" and ")
        ),
    )
    .note(panicked.0.clone())
    .note("this is a bug in naga or in preshade; please report it with the file")
}

/// Links, validates and checks the modules, and chooses the entry points.
fn assemble(
    (mut modules, mut declared): (Vec<naga::Module>, Declared),
    bases: &[u32],
    language: Language,
    options: &Options,
    map: &Arc<SourceMap>,
) -> Result<Parsed, Error> {
    naga_edit::lengths::settle(&mut modules, &mut declared)?;
    let mut modules = modules.into_iter();
    let Some(mut module) = modules.next() else {
        return Err(Error::new(Code::Empty, "no source is given"));
    };
    if let Some(mut second) = modules.next() {
        entry::drop_other_stage(&mut module, &mut second);
        // The others' spans are already offset.
        let base = match language {
            Language::Wgsl => bases.get(1).copied().unwrap_or(0),
            Language::Glsl | Language::SpirV => 0,
        };
        let linked = link(module, &second, base, map)?;
        module = linked.module;
        declared.tell_apart(linked.constants);
    }
    if language != Language::Wgsl {
        naga_edit::beyond_wgsl::disable_uniformity(&mut module);
        naga_edit::beyond_wgsl::rename_constants(&mut module, &mut declared);
    }
    module_size::check(&module, &options.limits)?;
    let entries = entry::choose(&module, options, map)?;
    entry::check_interface(&module, &entries, map)?;
    let names = entry::names(&module);
    let bound = entry::bound(&module);
    let program = Program::new(module, Arc::clone(map), language).map_err(|invalid| {
        let error = entry::locate_invalid(Error::invalid(&invalid), &names, map);
        entry::name_clash(error, &bound)
    })?;
    if language == Language::Wgsl {
        wgsl::check_module(&program)?;
    }
    entry::check_bindings(&program, &entries).map_err(|e| e.with_sources(map))?;
    Ok(Parsed {
        program: program.with_declared(declared),
        vertex: entries.vertex,
        fragment: entries.fragment,
    })
}

/// Links two files' modules into one.
fn link(
    first: naga::Module,
    second: &naga::Module,
    base: u32,
    map: &SourceMap,
) -> Result<Linked, Error> {
    let suffix = second
        .entry_points
        .first()
        .map_or("second", |e| naga_edit::interface::stage_name(e.stage));
    naga_edit::link::link(first, second, base, suffix).map_err(|e| {
        // Label the members that differ if the text shows them, else the variables.
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
    })
}

/// Replaces a byte order mark by spaces, because neither parser accepts one.
fn without_mark(text: &str) -> Cow<'_, str> {
    match text.strip_prefix('\u{feff}') {
        Some(rest) => Cow::Owned(format!("   {rest}")),
        None => Cow::Borrowed(text),
    }
}

/// Checks that the sources make one material, and returns its language.
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
            .note(
                "name it with --lang wgsl or --lang glsl, or by the extension: .wgsl, .vert or \
                 .vs, .frag or .fs, .spv",
            ));
        };
        if source.words.is_none() && shader_text::nesting::is_blank(&source.text) {
            let is = match source.text.trim_start_matches('\u{feff}').trim() {
                "" => "is empty",
                _ => "has only comments",
            };
            return Err(Error::new(Code::Empty, format!("{} {is}", source.name)));
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
    #[cfg(feature = "glsl")]
    if sources.len() == 1 && has_both_stages(&sources[0]) {
        return Ok(());
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
                .note("name it by the extension: .vert or .vs, .frag or .fs"));
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
                naga_edit::interface::stage_name(stages[0])
            ),
        ));
    }
    Ok(())
}

#[cfg(feature = "glsl")]
fn parse_glsl(
    sources: &[Source],
    bases: &[u32],
    options: &Options,
    map: &mut SourceMap,
) -> Result<(Vec<naga::Module>, Declared), Error> {
    let stages = glsl_stages(sources, bases);
    let texts: Vec<naga_glsl::Text<'_>> = stages.iter().map(GlslStage::text).collect();
    naga_glsl::parse(&texts, options, map)
}

/// Whether one file, with its includes, holds both stages, as RetroArch's do.
#[cfg(feature = "glsl")]
fn has_both_stages(source: &Source) -> bool {
    extension(&source.name) == Some("slang") || naga_glsl::has_stages(&source.text)
}

/// One GLSL stage, from its own file or a shared one.
#[cfg(feature = "glsl")]
struct GlslStage<'a> {
    name: &'a str,
    text: Cow<'a, str>,
    stage: ShaderStage,
    base: u32,
}

#[cfg(feature = "glsl")]
impl GlslStage<'_> {
    fn text(&self) -> naga_glsl::Text<'_> {
        naga_glsl::Text {
            name: self.name,
            text: &self.text,
            stage: self.stage,
            base: self.base,
        }
    }
}

/// The sources' stages. In a file with `#pragma stage` lines, the other stage's lines are blanked.
#[cfg(feature = "glsl")]
fn glsl_stages<'a>(sources: &'a [Source], bases: &[u32]) -> Vec<GlslStage<'a>> {
    let mut out = Vec::new();
    for (source, base) in sources.iter().zip(bases) {
        let text = without_mark(&source.text);
        let stage = source.stage().unwrap_or(ShaderStage::Fragment);
        let both = [ShaderStage::Vertex, ShaderStage::Fragment];
        match has_both_stages(source) {
            true => out.extend(both.map(|stage| GlslStage {
                name: &source.name,
                text: Cow::Owned(naga_glsl::stage_of(&text, stage)),
                stage,
                base: *base,
            })),
            false => out.push(GlslStage {
                name: &source.name,
                text,
                stage,
                base: *base,
            }),
        }
    }
    out
}

#[cfg(feature = "spirv")]
fn parse_spirv(
    sources: &[Source],
    bases: &[u32],
    options: &Options,
    map: &mut SourceMap,
) -> Result<(Vec<naga::Module>, Declared), Error> {
    let words = sources.iter().zip(bases).map(|(source, base)| {
        let Some(words) = &source.words else {
            let message = format!(
                "{} is no SPIR-V module: it lacks the magic number",
                source.name
            );
            return Err(Error::new(Code::Parse, message)
                .note("a module's first word is 0x07230203; assemble a text with `spirv-as`"));
        };
        Ok(naga_spirv::Words {
            name: &source.name,
            words,
            stage: source.stage,
            base: *base,
        })
    });
    let names = [options.vertex.as_deref(), options.fragment.as_deref()];
    naga_spirv::parse(&words.collect::<Result<Vec<_>, _>>()?, names, map)
}

#[cfg(not(feature = "spirv"))]
fn parse_spirv(
    sources: &[Source],
    _: &[u32],
    _: &Options,
    _: &mut SourceMap,
) -> Result<(Vec<naga::Module>, Declared), Error> {
    Err(Error::new(
        Code::Unsupported,
        format!(
            "{} is SPIR-V, which this build cannot read",
            sources[0].name
        ),
    )
    .note("build preshade with the feature `spirv`"))
}

#[cfg(not(feature = "glsl"))]
fn parse_glsl(
    sources: &[Source],
    _: &[u32],
    _: &Options,
    _: &mut SourceMap,
) -> Result<(Vec<naga::Module>, Declared), Error> {
    Err(Error::new(
        Code::Unsupported,
        format!("{} is GLSL, which this build cannot read", sources[0].name),
    ))
}

/// Parses an emitted stage as OpenGL's GLSL, with its declarations.
#[cfg(feature = "glsl")]
pub(crate) fn glsl_stage(
    name: &str,
    text: &str,
    stage: ShaderStage,
) -> Result<(naga::Module, Declared), Error> {
    let mut map = SourceMap::new();
    let base = map.add(name, text);
    let text = naga_glsl::Text {
        name,
        text,
        stage,
        base,
    };
    let options = Options {
        clip_space: Some(ClipSpace::OpenGl),
        ..Options::default()
    };
    let (mut modules, declared) = naga_glsl::parse(&[text], &options, &mut map)
        .map_err(|e| e.with_sources(&Arc::new(map)))?;
    let module = modules.pop();
    let module = module.ok_or_else(|| Error::new(Code::Empty, "no source is given"))?;
    Ok((module, declared))
}

/// The syntax tree of an emitted stage.
#[cfg(feature = "glsl")]
pub(crate) fn glsl_tree(
    text: &str,
    stage: ShaderStage,
) -> Result<glsl_lang::ast::TranslationUnit, Error> {
    let mut map = SourceMap::new();
    let base = map.add("", text);
    let text = naga_glsl::Text {
        name: "",
        text,
        stage,
        base,
    };
    naga_glsl::tree(&text, &mut map)
}

/// Preprocesses and parses GLSL without lowering it, to time the parser alone.
///
/// # Errors
/// Syntax errors, as in [`parse`].
#[cfg(feature = "glsl")]
pub fn glsl_syntax(sources: &[Source], options: &Options) -> Result<(), Error> {
    let mut map = SourceMap::new();
    let bases: Vec<u32> = sources.iter().map(|s| map.add(&s.name, &s.text)).collect();
    let stages = glsl_stages(sources, &bases);
    let texts: Vec<naga_glsl::Text<'_>> = stages.iter().map(GlslStage::text).collect();
    let read = panics::run(|| naga_glsl::parse_alone(&texts, options, &mut map));
    let read = read.unwrap_or_else(|panicked| Err(bug(sources, &panicked)));
    read.map_err(|e| e.with_sources(&Arc::new(map)))
}

/// A GLSL vertex stage that provides zeros for all inputs of `fragment`, to inspect a fragment
/// shader alone.
///
/// # Errors
/// As [`parse`], except for errors from naga.
#[cfg(feature = "glsl")]
pub fn vertex_stage_for(fragment: &Source, options: &Options) -> Result<String, Error> {
    let mut map = SourceMap::new();
    let base = map.add(&fragment.name, &fragment.text);
    let stages = glsl_stages(std::slice::from_ref(fragment), &[base]);
    let read = panics::run(|| match stages.first() {
        Some(stage) => naga_glsl::vertex_stage_for(&stage.text(), options, &mut map),
        None => Err(Error::new(Code::Empty, "no source is given")),
    });
    let read = read.unwrap_or_else(|panicked| Err(bug(std::slice::from_ref(fragment), &panicked)));
    let map = Arc::new(map);
    read.map_err(|e| e.with_sources(&map))
}
