//! Text to a syntax tree: the preprocessor, included files and the parser of `glsl-lang`.
//!
//! The tree's own positions are numbers of tokens, counted as the preprocessor delivers them, so that they grow from the first to the last whatever macro or
//! file they come from; [`Unit::place`] turns them into the author's bytes.

use std::borrow::Cow;
use std::collections::{HashMap, HashSet};
use std::io;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use glsl_lang::ast;
use glsl_lang::lexer::full::LexicalError;
use glsl_lang::lexer::full::fs::{Lexer, LexerIterator, PreprocessorExt as _};
use glsl_lang::lexer::{HasLexerError, LangLexer as _, ParseContext, ParseOptions, Token};
use glsl_lang::parse::{HasParser, LangParser};
use glsl_lang_pp::ext_name;
use glsl_lang_pp::exts::Registry;
use glsl_lang_pp::processor::event::DirectiveKind;
use glsl_lang_pp::processor::fs::Processor;
use glsl_lang_pp::processor::nodes::{Define, DefineObject, ExtensionBehavior};
use glsl_lang_pp::processor::{ProcessorState, ProcessorStateBuilder};
use lang_util::located::FileIdResolver as _;
use lang_util::position::{LexerPosition, NodeSpan};
use lang_util::{FileId, TextSize};
use naga::{ShaderStage, Span};
use preshade_passes::program::SourceMap;

use super::include::Files;
use super::pasted::{UNENDED, ended};
use super::rescan::Rewritten;
use crate::front::Options;
use crate::front::error::{Code, Error};

/// Most tokens a stage may have once its macros are expanded.
const TOKENS: usize = 1 << 20;

/// Extensions that are part of what is read, for `#ifdef`.
const EXTENSIONS: [&str; 5] = [
    "GL_OES_standard_derivatives",
    "GL_EXT_shader_texture_lod",
    "GL_EXT_frag_depth",
    "GL_EXT_draw_buffers",
    "GL_GOOGLE_include_directive",
];

/// Which GLSL a text is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Dialect {
    /// 100 to 460; what a text without `#version` means goes by [`Dialect::of`].
    pub version: u16,
    pub es: bool,
}

impl Dialect {
    /// By the text's `#version`. A text without one is GLSL ES 1.00 by the book of WebGL and GLSL 1.10 by that of OpenGL: both are read alike.
    pub(super) fn of(text: &str, path: &Path) -> Self {
        let line = text
            .lines()
            .map(str::trim)
            .find_map(|l| l.strip_prefix('#')?.trim_start().strip_prefix("version"));
        let mut words = line.unwrap_or("").split_whitespace();
        let version = words
            .next()
            .and_then(|v| v.parse().ok())
            // RetroArch's may have it in a file that they include.
            .unwrap_or(match path.extension().is_some_and(|e| e == "slang") {
                true => 450,
                false => 110,
            });
        let es = version == 100 || words.next() == Some("es");
        Self { version, es }
    }

    /// The name that a token is where it is a keyword of later versions only.
    fn name(self, token: &Token) -> Option<&'static str> {
        let before = |es: u16, desktop: u16| self.version < if self.es { es } else { desktop };
        let (name, is_name) = match token {
            Token::Sample => ("sample", before(320, 400)),
            Token::Patch => ("patch", before(320, 400)),
            Token::Precise => ("precise", before(320, 400)),
            Token::Buffer => ("buffer", before(310, 430)),
            Token::Shared => ("shared", before(310, 430)),
            Token::Coherent => ("coherent", before(310, 420)),
            Token::Volatile => ("volatile", before(310, 420)),
            Token::Restrict => ("restrict", before(310, 420)),
            Token::ReadOnly => ("readonly", before(310, 420)),
            Token::WriteOnly => ("writeonly", before(310, 420)),
            Token::Subroutine => ("subroutine", before(320, 400)),
            Token::Smooth => ("smooth", before(300, 130)),
            Token::NoPerspective => ("noperspective", before(320, 130)),
            _ => return None,
        };
        is_name.then_some(name)
    }
}

/// A stage's tree, and what it came from.
pub(super) struct Unit {
    pub tree: ast::TranslationUnit,
    pub dialect: Dialect,
    /// Every word of the expanded text: what a new name may not be.
    pub names: HashSet<String>,
    /// `#pragma STDGL invariant(all)`.
    pub invariant_all: bool,
    places: Vec<Span>,
}

impl Unit {
    /// Where a node stands in the author's text.
    pub(super) fn place(&self, span: Option<NodeSpan>) -> Option<Span> {
        let range = span?.range();
        let start = self.places.get(u32::from(range.start()) as usize)?;
        let last = u32::from(range.end()).max(1) as usize - 1;
        Some(joined(
            *start,
            self.places.get(last).copied().unwrap_or(*start),
        ))
    }
}

/// The text with its `#version` raised, byte for byte as long.
fn as_version_460(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for line in text.split_inclusive('\n') {
        let directive = line.trim_start().strip_prefix('#').map(str::trim_start);
        match directive.is_some_and(|d| d.starts_with("version")) {
            true => {
                out += &line
                    .replace("420", "460")
                    .replace("430", "460")
                    .replace("440", "460")
                    .replace("450", "460")
            }
            false => out += line,
        }
    }
    out
}

/// From the start of `first` to the end of `last`, where that is one stretch of text; else `first`.
fn joined(first: Span, last: Span) -> Span {
    match (first.to_range(), last.to_range()) {
        // A node may begin in one file and end in another, or end with a macro's argument that stands before it.
        (Some(a), Some(b)) if a.start < b.end && b.end - a.start < 1 << 16 => {
            Span::new(a.start as u32, b.end as u32)
        }
        _ => first,
    }
}

/// One stage's text and how to read it.
pub(super) struct Input<'a> {
    pub text: &'a str,
    pub stage: ShaderStage,
    /// The file it is from: where relative includes are looked up.
    pub path: &'a Path,
    /// The file's place in the source map.
    pub base: u32,
    pub options: &'a Options,
}

/// Preprocesses and parses. Included files are added to `map`.
pub(super) fn parse(input: &Input<'_>, map: &mut SourceMap) -> Result<Unit, Error> {
    let dialect = Dialect::of(input.text, input.path);
    // The names of Vulkan's separate textures are functions' names elsewhere.
    let old = ["texture2D(", "textureCube(", "texture2D (", "texture3D("];
    let vulkan = !dialect.es
        && (dialect.version >= 420 || dialect.version == 110)
        && input.text.contains("sampler")
        && (dialect.version >= 420 || !old.iter().any(|w| input.text.contains(w)));
    let folder = input.path.parent().unwrap_or(Path::new(""));
    let mut files = Files::new(input.options, input.stage);
    let own = files
        .check(input.text, folder)
        .map_err(|e| Error::new(Code::Parse, e.to_string()))?;
    let (read, rewritten) = (Rc::clone(&files.read), Rc::clone(&files.rewritten));
    let (found, shown) = (Rc::clone(&files.found), Rc::clone(&files.shown));
    let absent = Rc::clone(&files.absent);
    let text = own.as_ref().map_or(input.text, |own| &own.text);
    // The lexer knows Vulkan's types from 4.60 on.
    let text = match vulkan {
        true => Cow::Owned(as_version_460(text)),
        false => Cow::Borrowed(text),
    };
    let text = ended(text).ok_or_else(|| Error::new(Code::Parse, UNENDED))?;
    let mut processor = Processor::new_with_fs(files);
    processor.system_paths_mut().push(folder.to_owned());
    let file = processor
        .open_source(&text, folder)
        .with_state(state(dialect, &input.options.defines));
    let options = ParseOptions {
        default_version: if vulkan { 460 } else { dialect.version },
        target_vulkan: vulkan,
        ..ParseOptions::default()
    };
    let context = ParseContext::default();
    let lexer = Lexer::new(file, &options).run(context.clone());
    let mut numbered = Numbered {
        text: &text,
        lexer,
        dialect,
        raw: Vec::new(),
        names: HashSet::new(),
        too_many: false,
    };
    type Parser = <ast::TranslationUnit as HasParser>::Parser;
    let parsed = <Parser as LangParser>::parse(&Parser::new(), context, &mut numbered);
    let Numbered {
        lexer,
        raw,
        names,
        too_many,
        ..
    } = numbered;
    let directives = lexer.into_directives();
    let invariant_all = directives.directives().iter().any(|d| match d.kind() {
        DirectiveKind::Pragma(pragma) => pragma
            .raw()
            .replace(' ', "")
            .contains("STDGLinvariant(all)"),
        _ => false,
    });

    // Only now are the files known that the text includes.
    let mut files: HashMap<FileId, (u32, Option<Rewritten>)> = HashMap::new();
    let mut span = |id: FileId, start: TextSize, end: TextSize| {
        let (base, rewritten) = files.entry(id).or_insert_with(|| {
            // The preprocessor knows it by the path that was asked for.
            let path = processor.resolve(id);
            let path = path.and_then(|p| found.borrow().get(p).cloned());
            let text = path.as_ref().and_then(|p| read.borrow().get(p).cloned());
            match (path, text) {
                (Some(path), Some(text)) => (
                    map.add(name(&shown.borrow(), &path), text),
                    rewritten.borrow().get(&path).cloned(),
                ),
                _ => (input.base, own.clone()),
            }
        });
        let back = |at: TextSize| {
            let at = u32::from(at);
            rewritten.as_ref().map_or(at, |r| r.back(at))
        };
        let (start, end) = (back(start), back(end));
        Span::new(*base + start, *base + end.max(start))
    };
    let places: Vec<Span> = raw
        .iter()
        .map(|(start, end)| match start.source_id == end.source_id {
            true => span(start.source_id, start.offset, end.offset),
            false => span(start.source_id, start.offset, start.offset),
        })
        .collect();
    if too_many {
        return Err(Error::new(
            Code::TooDeep,
            format!("macros expand to more than {TOKENS} words"),
        )
        .note("write functions in their place"));
    }
    match parsed {
        Ok(tree) => {
            add_silent(&read.borrow(), &shown.borrow(), map);
            for path in absent.borrow().iter() {
                map.add_absent(path.to_string_lossy());
            }
            Ok(Unit {
                tree,
                dialect,
                names,
                invariant_all,
                places,
            })
        }
        Err(error) => Err(explain(error, &places, &mut span)),
    }
}

/// What a file that was found is called.
fn name(shown: &HashMap<PathBuf, PathBuf>, path: &Path) -> String {
    let shown = shown.get(path).map_or(path, PathBuf::as_path);
    shown.to_string_lossy().into_owned()
}

/// Adds to `map` the files of which no word is left, which define macros and nothing else: the text rests on them too.
fn add_silent(
    read: &HashMap<PathBuf, String>,
    shown: &HashMap<PathBuf, PathBuf>,
    map: &mut SourceMap,
) {
    let mut silent: Vec<(String, &String)> = read
        .iter()
        .map(|(path, text)| (name(shown, path), text))
        .filter(|(name, _)| !map.files().iter().any(|f| f.name == *name))
        .collect();
    silent.sort();
    for (name, text) in silent {
        map.add(name, text);
    }
}

type Io = LexicalError<io::Error>;

/// What the parser says, with where.
fn explain(
    error: lalrpop_util::ParseError<LexerPosition, Token, Io>,
    places: &[Span],
    span: &mut impl FnMut(FileId, TextSize, TextSize) -> Span,
) -> Error {
    use lalrpop_util::ParseError as E;
    let at = |p: LexerPosition| places.get(u32::from(p.offset) as usize).copied();
    let one_of = |expected: &[String]| match expected {
        [] => String::new(),
        [one] => format!(", expected {one}"),
        _ if expected.len() <= 4 => format!(", expected one of {}", expected.join(", ")),
        _ => String::new(),
    };
    match error {
        E::InvalidToken { location } => {
            Error::new(Code::Parse, "invalid token").label_if(at(location))
        }
        E::UnrecognizedEof { expected, .. } => Error::new(
            Code::Parse,
            format!("the file ends too early{}", one_of(&expected)),
        )
        .label_if(places.last().copied()),
        E::UnrecognizedToken {
            token: (start, token, _),
            expected,
        } => Error::new(
            Code::Parse,
            format!("unexpected {token}{}", one_of(&expected)),
        )
        .label_if(at(start)),
        E::ExtraToken {
            token: (start, token, _),
        } => Error::new(Code::Parse, format!("unexpected {token}")).label_if(at(start)),
        E::User { error } => {
            use lang_util::error::LexicalError as _;
            let message = error.to_string();
            let (start, length) = error.location();
            let place = span(start.source_id, start.offset, start.offset + length);
            let error = Error::new(Code::Parse, message.clone()).label(place, "");
            match message.contains("#include")
                || matches!(error.message(), m if m.contains("os error"))
            {
                true => error.note(
                    "included files are looked up beside the file, then in the include paths",
                ),
                false => error,
            }
        }
    }
}

/// What is defined before the first line.
fn state(dialect: Dialect, defines: &[(String, String)]) -> ProcessorState {
    let none = Registry::new();
    let define = |name: &str, value: &str| {
        let value = ended(Cow::Borrowed(value)).and_then(|v| v.parse().ok());
        let value = value.unwrap_or_else(DefineObject::one);
        Define::object(name.into(), value, false)
    };
    let mut builder: ProcessorStateBuilder<'_> = ProcessorStateBuilder::new(&none)
        .es_profile(dialect.es)
        .core_profile(!dialect.es && dialect.version >= 150)
        .extension(
            ext_name!("GL_GOOGLE_include_directive"),
            ExtensionBehavior::Enable,
        );
    for name in EXTENSIONS {
        builder = builder.definition(define(name, "1"));
    }
    if dialect.es {
        builder = builder
            .definition(define("GL_ES", "1"))
            .definition(define("GL_FRAGMENT_PRECISION_HIGH", "1"));
    }
    for (name, value) in defines {
        builder = builder.definition(define(name, value));
    }
    builder.finish()
}

/// The lexer's tokens, each at its number instead of its place.
struct Numbered<'a, 'r, 'p> {
    text: &'a str,
    lexer: LexerIterator<'r, 'p, Files>,
    dialect: Dialect,
    raw: Vec<(LexerPosition, LexerPosition)>,
    names: HashSet<String>,
    too_many: bool,
}

impl HasLexerError for Numbered<'_, '_, '_> {
    type Error = Io;
}

impl Numbered<'_, '_, '_> {
    /// An integer that takes all 32 bits without an `u`: the same bits, negative.
    fn large_integer(&self, error: &Io) -> Option<(LexerPosition, Token, LexerPosition)> {
        let Io::Token { pos, .. } = error else {
            return None;
        };
        let range = pos.range();
        let text = self
            .text
            .get(u32::from(range.start()) as usize..u32::from(range.end()) as usize)?;
        let value = match text.strip_prefix("0x").or(text.strip_prefix("0X")) {
            Some(digits) => u32::from_str_radix(digits, 16).ok()?,
            None => text.parse().ok()?,
        };
        Some((pos.start(), Token::IntConstant(value as i32), pos.end()))
    }
}

/// Whether a message of the preprocessor is of something that changes no token: a directive or an extension that it has not heard of.
fn is_passed_over(message: &str) -> bool {
    ["unknown preprocessor directive", "extension not supported"]
        .iter()
        .any(|m| message.contains(m))
}

impl Iterator for Numbered<'_, '_, '_> {
    type Item = Result<(LexerPosition, Token, LexerPosition), Io>;

    fn next(&mut self) -> Option<Self::Item> {
        let (start, mut token, end) = match self.lexer.next()? {
            Ok(token) => token,
            // As compilers do: what none knows is no error.
            Err(Io::Processor(e)) if is_passed_over(&e.to_string()) => return self.next(),
            Err(error) => match self.large_integer(&error) {
                Some(token) => token,
                None => return Some(Err(error)),
            },
        };
        if self.raw.len() >= TOKENS {
            self.too_many = true;
            return None;
        }
        if let Some(name) = self.dialect.name(&token) {
            token = Token::Identifier(name.into());
        }
        if let Token::Identifier(name) | Token::TypeName(name) = &token
            && !self.names.contains(name.as_str())
        {
            self.names.insert(name.to_string());
        }
        let number = self.raw.len() as u32;
        self.raw.push((start, end));
        let at = |n: u32| LexerPosition::new(FileId::new(0), n.into());
        Some(Ok((at(number), token, at(number + 1))))
    }
}
