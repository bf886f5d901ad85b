//! The preprocessor: directives, includes and macros (GLSL 4.60, 3.3; ES 3.20, 3.4).
//!
//! `tokens` splits the text, `directive` executes directives, `condition` evaluates `#if`, and
//! `macros` expands. The result only has `#version` and `#extension` directives. Each token keeps
//! its source span: a macro's result has the span of the call, an argument its own.
//!
//! [`WORK`] limits the tokens that are read, skipped or made.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::rc::Rc;

use naga::{ShaderStage, Span};

use self::macros::{Macro, TokenSource};
use self::tokens::{Joined, Names, Token, TokenKind, tokens};
use super::include::Files;
use super::version::Dialect;
use shader_text::error::{Code, Error};
use shader_text::source::SourceMap;
use shader_text::unsupported;

mod condition;
mod directive;
mod macros;
mod tokens;

/// Maximum tokens read, skipped or made.
const WORK: usize = 1 << 24;

/// Maximum number of includes in total.
const INCLUDES: usize = 10_000;

/// Maximum nesting of includes.
const OPEN: usize = 200;

type Stop = Error;

pub(super) struct Task<'a> {
    pub text: &'a str,
    pub stage: ShaderStage,
    /// The folder for relative includes.
    pub folder: &'a Path,
    /// Offset in the source map.
    pub base: u32,
    pub dialect: Dialect,
    pub defines: &'a [(String, String)],
    /// The version whose keywords the lexer knows, if the text has no `#version`.
    pub lexed_version: u16,
    /// Whether the text is for Vulkan.
    pub vulkan: bool,
}

#[derive(Debug, Default)]
pub(super) struct Preprocessed {
    pub text: String,
    /// Offset and source span of each token.
    places: Vec<(u32, Span)>,
    /// Whether it contains `#pragma STDGL invariant(all)`.
    pub invariant_all: bool,
    /// Whether the result contains macro expansions or other files.
    pub is_more: bool,
    /// Whether the text tested for Vulkan, with a negative result.
    pub asks_for_vulkan: bool,
    /// Whether the text uses `nonuniformEXT`.
    pub is_nonuniform: bool,
    /// The version whose keywords the lexer knows.
    pub lexed_version: u16,
    /// The extensions that the text uses.
    pub extensions: HashSet<String>,
}

impl Preprocessed {
    /// The source span of the token at an offset.
    pub(super) fn place(&self, at: u32) -> Span {
        let next = self.places.partition_point(|(begin, _)| *begin <= at);
        let token = next.checked_sub(1).and_then(|i| self.places.get(i));
        token.map_or(Span::UNDEFINED, |(_, place)| *place)
    }
}

struct Reading {
    tokens: Rc<Vec<Token>>,
    at: usize,
    folder: PathBuf,
    /// The file's path. `None` for the first file.
    found: Option<PathBuf>,
    /// Changes by `#line`.
    numbering: Numbering,
}

/// How `__LINE__` and `__FILE__` number a file. Messages always have the file's own lines.
#[derive(Clone, Copy, Default)]
struct Numbering {
    /// `__LINE__` minus the file's own line.
    shift: i64,
    /// Value of `__FILE__`.
    file: i64,
}

struct Open {
    /// Whether the current group is active.
    active: bool,
    /// Whether one of its groups was active.
    taken: bool,
    /// Whether all enclosing groups are active.
    outside: bool,
    seen_else: bool,
    place: Span,
}

/// Position in a `debugPrintfEXT` call. Only its first argument may be a string.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Printf {
    Named,
    Opened,
    Elsewhere,
}

/// The preprocessor of one stage.
struct Preprocessor<'a> {
    files: &'a Files,
    map: &'a mut SourceMap,
    stage: ShaderStage,
    dialect: Dialect,
    lexed_version: u16,
    vulkan: bool,
    /// The folder of the first file.
    home: PathBuf,
    names: Names,
    /// Names of `__LINE__`, `__FILE__` and `__VERSION__`.
    computed: [u32; 3],
    macros: HashMap<u32, Rc<Macro>>,
    /// Tokens to read before the files, in reverse order.
    pending: Vec<Token>,
    open: Vec<Reading>,
    conditions: Vec<Open>,
    /// Whether `#pragma stage` selected the other stage.
    elsewhere: bool,
    printf: Printf,
    /// Within `[[..]]`: number of closing brackets so far.
    attribute: Option<u8>,
    /// Files by path.
    known: HashMap<PathBuf, (String, Rc<Vec<Token>>)>,
    included: usize,
    done: usize,
    out: Preprocessed,
}

/// Preprocesses a stage. Adds included files to `map`.
pub(super) fn preprocess(
    input: &Task<'_>,
    files: &Files,
    map: &mut SourceMap,
) -> Result<Preprocessed, Error> {
    let mut names = Names::default();
    let tokens = tokens(&Joined::of(input.text), input.base, &mut names)
        .map_err(|at| unclosed(Span::new(at, at + 2)))?;
    let computed = ["__LINE__", "__FILE__", "__VERSION__"].map(|name| names.number(name));
    let mut preprocessor = Preprocessor {
        files,
        map,
        stage: input.stage,
        dialect: input.dialect,
        lexed_version: input.lexed_version,
        vulkan: input.vulkan,
        home: input.folder.to_owned(),
        names,
        computed,
        macros: HashMap::new(),
        pending: Vec::new(),
        open: vec![Reading {
            tokens: Rc::new(tokens),
            at: 0,
            folder: input.folder.to_owned(),
            found: None,
            numbering: Numbering::default(),
        }],
        conditions: Vec::new(),
        elsewhere: false,
        printf: Printf::Elsewhere,
        attribute: None,
        known: HashMap::new(),
        included: 0,
        done: 0,
        out: Preprocessed {
            lexed_version: input.lexed_version,
            ..Preprocessed::default()
        },
    };
    preprocessor.predefine(input.defines)?;
    while let Some(token) = preprocessor.next_token()? {
        if let Some(token) = preprocessor.expand(token, &mut TokenSource::Files, 0)? {
            preprocessor.emit(&token)?;
        }
    }
    if let Some(open) = preprocessor.conditions.last() {
        return Err(Error::new(Code::Parse, "this `#if` has no `#endif`").label(open.place, ""));
    }
    Ok(preprocessor.out)
}

/// A 16-bit literal, such as `1.5hf`, as a constructor.
fn half(number: &str) -> Option<Rc<str>> {
    let digits = number.strip_suffix("hf").or(number.strip_suffix("HF"))?;
    Some(Rc::from(format!("float16_t ( {digits} )")))
}

fn unclosed(place: Span) -> Error {
    Error::new(Code::Parse, "this comment is not closed").label(place, "")
}

/// Extensions that are defined for `#ifdef`.
const EXTENSIONS: [&str; 5] = [
    "GL_OES_standard_derivatives",
    "GL_EXT_shader_texture_lod",
    "GL_EXT_frag_depth",
    "GL_EXT_draw_buffers",
    "GL_GOOGLE_include_directive",
];

impl Preprocessor<'_> {
    fn predefine(&mut self, defines: &[(String, String)]) -> Result<(), Stop> {
        let Dialect { version, es } = self.dialect;
        let mut own = EXTENSIONS.to_vec();
        match es {
            true => own.extend(["GL_ES", "GL_es_profile", "GL_FRAGMENT_PRECISION_HIGH"]),
            false if version >= 150 => own.push("GL_core_profile"),
            false => {}
        }
        // GL_KHR_vulkan_glsl. An author may still define it.
        let vulkan = self.vulkan.then_some(("VULKAN", "100", false));
        let all = own.into_iter().map(|name| (name, "1", true)).chain(vulkan);
        let given = defines.iter().map(|(n, v)| (n.as_str(), v.as_str(), false));
        for (name, value, is_own) in all.chain(given) {
            let value = match value.trim().is_empty() {
                true => "1",
                false => value,
            };
            let joined = Joined::of(value);
            let mut body = tokens(&joined, 0, &mut self.names).map_err(|_| {
                Error::new(
                    Code::Parse,
                    format!("the value of `{name}` has a comment that is not closed"),
                )
            })?;
            body.retain(|t| t.kind != TokenKind::Line);
            let name = self.names.number(name);
            let made = Macro {
                parameters: None,
                body,
                is_own,
                is_authors: false,
            };
            self.macros.insert(name, Rc::new(made));
        }
        Ok(())
    }

    fn stop(&self, message: impl Into<String>, place: (u32, u32)) -> Stop {
        Error::new(Code::Parse, message).label(Span::new(place.0, place.1), "")
    }

    fn too_deep(&self, place: (u32, u32)) -> Stop {
        Error::new(Code::TooDeep, "macro calls are nested too deeply")
            .label(Span::new(place.0, place.1), "")
            .note("use functions instead")
    }

    /// Counts work against [`WORK`].
    fn work(&mut self, tokens: usize) -> Result<(), Stop> {
        self.done += tokens;
        match self.done > WORK {
            true => Err(Error::new(
                Code::TooDeep,
                format!("macros and included files have more than {WORK} tokens"),
            )
            .note("use functions instead")),
            false => Ok(()),
        }
    }

    fn is(&self, token: &Token, text: &str) -> bool {
        &*self.names.text(token.name) == text
    }

    /// The number of the file at an offset.
    fn file_at(&self, at: u32) -> Option<u32> {
        self.map.file_of(Span::new(at, at)).map(|f| f.base)
    }

    /// The value of `__LINE__` and the other computed macros.
    fn own_value(&self, token: &Token) -> Option<String> {
        let numbering = self.open.last().map(|r| r.numbering).unwrap_or_default();
        Some(match self.computed.iter().position(|n| *n == token.name)? {
            0 => (self.own_line(token.start) + numbering.shift).to_string(),
            1 => numbering.file.to_string(),
            _ => self.dialect.version.to_string(),
        })
    }

    /// The file's own line at an offset.
    fn own_line(&self, at: u32) -> i64 {
        let at = self.map.locate(Span::new(at, at));
        at.map_or(0, |l| i64::from(l.line))
    }

    fn is_active(&self) -> bool {
        self.conditions.last().is_none_or(|c| c.active)
    }

    /// The next token outside of directives and inactive groups.
    fn next_token(&mut self) -> Result<Option<Token>, Stop> {
        loop {
            if let Some(token) = self.pending.pop() {
                return Ok(Some(token));
            }
            self.work(1)?;
            let Some(reading) = self.open.last_mut() else {
                return Ok(None);
            };
            let Some(token) = reading.tokens.get(reading.at) else {
                self.open.pop();
                continue;
            };
            reading.at += 1;
            if token.kind == TokenKind::Line {
                continue;
            }
            let token = token.clone();
            if token.begins_line && token.kind == TokenKind::Other && self.is(&token, "#") {
                let line = self.rest_of_line()?;
                self.directive(&token, line)?;
                continue;
            }
            if !self.is_active() || self.elsewhere {
                self.rest_of_line()?;
                continue;
            }
            return Ok(Some(token));
        }
    }

    fn rest_of_line(&mut self) -> Result<Vec<Token>, Stop> {
        let Some(reading) = self.open.last_mut() else {
            return Ok(Vec::new());
        };
        let rest = reading.tokens.get(reading.at..).unwrap_or_default();
        let ends = |t: &Token| t.kind == TokenKind::Line;
        let length = rest.iter().position(ends).unwrap_or(rest.len());
        let line = rest[..length].to_vec();
        reading.at += length;
        self.work(length)?;
        Ok(line)
    }

    fn emit(&mut self, token: &Token) -> Result<(), Stop> {
        let text = self.names.text(token.name);
        if matches!(&*text, "#" | "##") {
            return Err(self.stop(format!("unexpected `{text}`"), (token.start, token.end)));
        }
        // GL_EXT_control_flow_attributes only has hints for the compiler.
        if let Some(closed) = self.attribute {
            self.attribute = Some(closed + u8::from(&*text == "]")).filter(|n| *n < 2);
            return Ok(());
        }
        if &*text == "[" && self.out.text.ends_with("[ ") {
            self.out.text.truncate(self.out.text.len() - "[ ".len());
            self.out.places.pop();
            self.attribute = Some(0);
            return Ok(());
        }
        // It marks values that differ between invocations, but changes none.
        if &*text == "nonuniformEXT" {
            self.out.is_nonuniform = true;
            return Ok(());
        }
        let follows = self.printf;
        self.printf = match &*text {
            "debugPrintfEXT" => Printf::Named,
            "(" if follows == Printf::Named => Printf::Opened,
            _ => Printf::Elsewhere,
        };
        let text = match token.kind {
            // The call is dropped, so any value will do.
            TokenKind::Quoted if follows == Printf::Opened => Rc::from("0"),
            TokenKind::Number => {
                let sized = [("s", "int16_t"), ("l", "int64_t")];
                let lower = text.to_lowercase();
                // `lf` ends a double.
                if let Some((_, of)) = sized.iter().find(|(end, _)| lower.ends_with(end)) {
                    let place = Span::new(token.start, token.end);
                    return Err(match unsupported::absent(of) {
                        Some(of) => of.refuse(&text, Some(place)),
                        None => self.stop("invalid number", (token.start, token.end)),
                    });
                }
                half(&text).unwrap_or(text)
            }
            _ => text,
        };
        self.work(1)?;
        let at = self.out.text.len() as u32;
        let place = Span::new(token.start, token.end);
        self.out.places.push((at, place));
        self.out.text.push_str(&text);
        self.out.text.push(' ');
        Ok(())
    }
}
