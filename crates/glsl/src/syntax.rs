//! Parses text to a syntax tree with `glsl-lang`.
//!
//! The tree's positions are token numbers, so they increase across macros and files.
//! [`Unit::place`] maps them to source spans.

use std::collections::HashSet;
use std::path::Path;

use glsl_lang::ast;
use glsl_lang::lexer::min::LexicalError;
use glsl_lang::lexer::min::str::{Lexer, LexerIterator};
use glsl_lang::lexer::{HasLexerError, LangLexer, ParseContext, ParseOptions, Token};
use glsl_lang::parse::{HasParser, LangParser};
use lang_util::position::{LexerPosition, NodeSpan};
use lang_util::{FileId, TextSize};
use naga::Span;
use shader_text::source::SourceMap;

use super::Text;
use super::include::Files;
use super::preprocess::{Preprocessed, Task, preprocess};
use super::ty::Ty;
use super::type_names::TypeNames;
use super::version::Dialect;
use crate::errors::wrong;
use shader_text::error::{Code, Error};
use shader_text::nesting;
use shader_text::options::{ClipSpace, Options};
use shader_text::source::Language;
use shader_text::unsupported::{self, Absent, Word};

/// Maximum tokens of a stage after macro expansion.
const TOKENS: usize = 1 << 20;

/// A stage's syntax tree and its source map.
pub(super) struct Unit {
    pub tree: ast::TranslationUnit,
    pub dialect: Dialect,
    /// All words of the expanded text, so that generated names are unique.
    pub names: HashSet<String>,
    /// Whether it contains `#pragma STDGL invariant(all)`.
    pub invariant_all: bool,
    /// Whether the text tested for Vulkan, with a negative result.
    pub asks_for_vulkan: bool,
    /// Whether the text uses `nonuniformEXT`.
    pub is_nonuniform: bool,
    /// Maximum elements of a type.
    pub array_elements: u64,
    places: Vec<Span>,
}

impl Unit {
    /// The source span of a node.
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

/// From the start of `first` to the end of `last` if both are close together in one file; else
/// `first`.
fn joined(first: Span, last: Span) -> Span {
    match (first.to_range(), last.to_range()) {
        // A node may span files, or end with a macro argument that comes before it.
        (Some(a), Some(b)) if a.start < b.end && b.end - a.start < 1 << 16 => {
            Span::new(a.start as u32, b.end as u32)
        }
        _ => first,
    }
}

/// Preprocesses and parses a stage. Adds included files to `map`.
pub(super) fn parse(
    input: &Text<'_>,
    options: &Options,
    map: &mut SourceMap,
) -> Result<Unit, Error> {
    let path = Path::new(input.name);
    let dialect = Dialect::of(input.text, path);
    // In other dialects, the names of Vulkan's textures are functions.
    let old = ["texture2D(", "textureCube(", "texture2D (", "texture3D("];
    let has = |word: &str| input.text.contains(word);
    let mut words = input.text.split(|c: char| !c.is_alphanumeric() && c != '_');
    let vulkan = match dialect {
        // Vulkan's GLSL has these types in ES too.
        Dialect { es: true, version } => {
            let is_type = |w: &str| w == "sampler" || w == "samplerShadow";
            version >= 310 && words.any(is_type)
        }
        Dialect { version, .. } if version >= 420 => has("sampler"),
        Dialect { version, .. } => version == 110 && has("sampler") && !old.into_iter().any(has),
    };
    let folder = path.parent().unwrap_or(Path::new(""));
    let files = Files::new(options);
    // The lexer knows Vulkan's types since 4.60.
    let lexed_version = if vulkan { 460 } else { dialect.version };
    let task = Task {
        text: input.text,
        stage: input.stage,
        folder,
        base: input.base,
        dialect,
        defines: &options.defines,
        vulkan: options.clip_space == Some(ClipSpace::AsWritten)
            || path.extension().is_some_and(|e| e == "slang"),
        lexed_version,
    };
    let preprocessed = preprocess(&task, &files, map);
    for path in files.absent.borrow().iter() {
        map.add_absent(path.to_string_lossy());
    }
    let preprocessed = preprocessed?;
    // Macros can nest deeply. The original text has been checked already.
    if preprocessed.is_more {
        check_nesting(&preprocessed, options)?;
    }
    let text = preprocessed.text.as_str();
    let lexing = ParseOptions {
        default_version: preprocessed.lexed_version,
        target_vulkan: vulkan,
        ..ParseOptions::default()
    };
    let context = ParseContext::default();
    let lexer = <Lexer<'_> as LangLexer<'_>>::new(text, &lexing).run(context.clone());
    let mut numbered = Numbered {
        text,
        lexer,
        dialect,
        extensions: &preprocessed.extensions,
        raw: Vec::new(),
        names: HashSet::new(),
        types: HashSet::new(),
        type_names: TypeNames::new(text),
        in_layout: false,
        stopped: None,
        too_many: false,
    };
    type Parser = <ast::TranslationUnit as HasParser>::Parser;
    let parsed = <Parser as LangParser>::parse(&Parser::new(), context, &mut numbered);
    let Numbered {
        raw,
        names,
        stopped,
        too_many,
        ..
    } = numbered;
    let span = |start: TextSize, end: TextSize| {
        let first = preprocessed.place(start.into());
        let last = u32::from(end).max(u32::from(start) + 1) - 1;
        joined(first, preprocessed.place(last))
    };
    let places: Vec<Span> = raw
        .iter()
        .map(|(start, end)| span(start.offset, end.offset))
        .collect();
    if let Some((absent, name)) = stopped {
        return Err(absent.refuse(&name, places.last().copied()));
    }
    if too_many {
        return Err(Error::new(
            Code::TooDeep,
            format!("macros expand to more than {TOKENS} tokens"),
        )
        .note("use functions instead"));
    }
    match parsed {
        Ok(tree) => Ok(Unit {
            tree,
            dialect,
            names,
            invariant_all: preprocessed.invariant_all,
            asks_for_vulkan: preprocessed.asks_for_vulkan,
            is_nonuniform: preprocessed.is_nonuniform,
            array_elements: options.limits.array_elements.min(1 << 24),
            places,
        }),
        Err(error) => Err(explain(error, &places, &span)),
    }
}

fn check_nesting(preprocessed: &Preprocessed, options: &Options) -> Result<(), Error> {
    nesting::check(&preprocessed.text, 0, &options.limits, Language::Glsl).map_err(|e| {
        let first = e.labels().first().and_then(|l| l.span.to_range());
        let place = first.map(|at| preprocessed.place(at.start as u32));
        let error = Error::new(e.code(), e.message()).label_if(place);
        e.notes().iter().fold(error, |error, note| error.note(note))
    })
}

/// Converts a parser error and finds its span.
fn explain(
    error: lalrpop_util::ParseError<LexerPosition, Token, LexicalError>,
    places: &[Span],
    span: &impl Fn(TextSize, TextSize) -> Span,
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
        E::InvalidToken { location } => wrong("invalid token", at(location)),
        E::UnrecognizedEof { expected, .. } => wrong(
            format!("unexpected end of the file{}", one_of(&expected)),
            places.last().copied(),
        ),
        E::UnrecognizedToken {
            token: (start, token, _),
            expected,
        } => wrong(
            format!("unexpected {token}{}", one_of(&expected)),
            at(start),
        ),
        E::ExtraToken {
            token: (start, token, _),
        } => wrong(format!("unexpected {token}"), at(start)),
        E::User { error } => {
            let message = error.to_string();
            let LexicalError::Token { pos, .. } = error;
            let place = span(pos.start().offset, pos.end().offset);
            Error::new(Code::Parse, message).label(place, "")
        }
    }
}

/// The lexer's tokens, with token numbers as positions.
struct Numbered<'a> {
    text: &'a str,
    lexer: LexerIterator<'a>,
    dialect: Dialect,
    extensions: &'a HashSet<String>,
    raw: Vec<(LexerPosition, LexerPosition)>,
    names: HashSet<String>,
    /// Names among the tokens that are types of extensions.
    types: HashSet<String>,
    type_names: TypeNames<'a>,
    /// Whether the position is between `layout` and its closing bracket.
    in_layout: bool,
    /// A name that the grammar does not support.
    stopped: Option<(&'static Absent, String)>,
    too_many: bool,
}

impl HasLexerError for Numbered<'_> {
    type Error = LexicalError;
}

impl<'a> Numbered<'a> {
    /// The text of a token.
    fn word(&self, start: LexerPosition, end: LexerPosition) -> &'a str {
        let at = |p: LexerPosition| u32::from(p.offset) as usize;
        self.text.get(at(start)..at(end)).unwrap_or_default()
    }

    /// An integer that uses all 32 bits without a `u`: the negative number with the same bits.
    fn large_integer(&self, error: &LexicalError) -> Option<(LexerPosition, Token, LexerPosition)> {
        let LexicalError::Token { pos, .. } = error;
        let text = self.word(pos.start(), pos.end());
        let value = match text.strip_prefix("0x").or(text.strip_prefix("0X")) {
            Some(digits) => u32::from_str_radix(digits, 16).ok()?,
            None => text.parse().ok()?,
        };
        Some((pos.start(), Token::IntConstant(value as i32), pos.end()))
    }

    /// Turns type names of extensions into types. Stops at other names of extensions that the
    /// grammar does not support.
    fn settle_name(&mut self, token: &mut Token) {
        match token {
            Token::Layout => self.in_layout = true,
            Token::RightParen => self.in_layout = false,
            _ => {}
        }
        let (Token::Identifier(name) | Token::TypeName(name)) = &*token else {
            return;
        };
        if !self.names.contains(name.as_str()) {
            self.names.insert(name.to_string());
            let entry = unsupported::absent(name);
            let word = entry.map(Absent::word);
            if word == Some(Word::Type) || is_type_of_extension(name) {
                self.types.insert(name.to_string());
            }
            let stops = match word {
                Some(Word::Qualifier) => true,
                Some(Word::Layout) => self.in_layout,
                _ => false,
            };
            if let Some(entry) = entry.filter(|_| stops) {
                self.stopped = Some((entry, name.to_string()));
            }
        }
        if self.types.contains(name.as_str()) {
            *token = Token::TypeName(name.clone());
        }
    }
}

/// Whether a name is a type with a bit width, such as `f16vec3`, which the lexer does not know.
fn is_type_of_extension(name: &str) -> bool {
    let marks = ["16", "32", "64"];
    marks.iter().any(|m| name.contains(m))
        && !matches!(Ty::named(name), Ty::Opaque(_) | Ty::Combined(_))
}

impl Iterator for Numbered<'_> {
    type Item = Result<(LexerPosition, Token, LexerPosition), LexicalError>;

    fn next(&mut self) -> Option<Self::Item> {
        let (start, mut token, end) = match self.lexer.next()? {
            Ok(token) => token,
            Err(error) => match self.large_integer(&error) {
                Some(token) => token,
                None => return Some(Err(error)),
            },
        };
        if self.raw.len() >= TOKENS {
            self.too_many = true;
            return None;
        }
        if let Some(name) = self.dialect.name(&token, self.extensions) {
            token = Token::Identifier(name.into());
        }
        let number = self.raw.len() as u32;
        self.raw.push((start, end));
        self.settle_name(&mut token);
        let word = self.word(start, end);
        self.type_names.settle(&mut token, word);
        if matches!(token, Token::Subroutine) {
            self.stopped = unsupported::absent("subroutine").map(|a| (a, "subroutine".to_owned()));
        }
        if self.stopped.is_some() {
            return None;
        }
        let at = |n: u32| LexerPosition::new(FileId::new(0), n.into());
        Some(Ok((at(number), token, at(number + 1))))
    }
}
