//! The preprocessor: directives, includes and macros (GLSL 4.60, 3.3; ES 3.20, 3.4).
//!
//! `tokens` splits the text, `condition` evaluates `#if`, `macros` expands. The result only has
//! `#version` and `#extension` directives. Each token keeps its source span: a macro's result has
//! the span of the call, an argument its own.
//!
//! [`WORK`] limits the tokens that are read, skipped or made.

mod condition;
mod macros;
mod tokens;

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::rc::Rc;

use naga::{ShaderStage, Span};
use shader_text::source::SourceMap;

use self::condition::{Word, Wrong, evaluate, integer};
use self::macros::{Macro, TokenSource};
use self::tokens::{Joined, Names, Token, TokenKind, tokens};
use super::include::Files;
use super::version::Dialect;
use shader_text::error::{Code, Error};
use shader_text::unsupported;

/// Maximum tokens read, skipped or made.
const WORK: usize = 1 << 24;

/// Maximum number of includes in total.
const INCLUDES: usize = 10_000;

/// Maximum nesting of includes.
const OPEN: usize = 200;

type Stop = Error;

/// A text to preprocess.
pub(super) struct Task<'a> {
    pub text: &'a str,
    pub stage: ShaderStage,
    /// The folder for relative includes.
    pub folder: &'a Path,
    /// Offset in the source map.
    pub base: u32,
    pub dialect: Dialect,
    pub defines: &'a [(String, String)],
    /// The version whose words the lexer knows, without a `#version`.
    pub lexed_version: u16,
    /// The text is for Vulkan.
    pub vulkan: bool,
}

/// A preprocessed text.
#[derive(Debug, Default)]
pub(super) struct Preprocessed {
    pub text: String,
    /// Offset and source span of each token.
    places: Vec<(u32, Span)>,
    /// `#pragma STDGL invariant(all)`.
    pub invariant_all: bool,
    /// The result contains macro expansions or other files.
    pub is_more: bool,
    /// The text tested for Vulkan, and the answer was no.
    pub asks_for_vulkan: bool,
    /// The text has `nonuniformEXT`.
    pub is_nonuniform: bool,
    /// The version whose words the lexer knows.
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

/// A file being read.
struct Reading {
    tokens: Rc<Vec<Token>>,
    at: usize,
    folder: PathBuf,
    /// Its path; `None` for the first.
    found: Option<PathBuf>,
    /// What `#line` changed.
    numbering: Numbering,
}

/// How `__LINE__` and `__FILE__` number a file. Messages always have the file's own lines.
#[derive(Clone, Copy, Default)]
struct Numbering {
    /// `__LINE__` minus the file's own line.
    shift: i64,
    /// `__FILE__`.
    file: i64,
}

/// An open `#if`.
struct Open {
    /// The current group is active.
    active: bool,
    /// One of its groups was active.
    taken: bool,
    /// The enclosing groups are active.
    outside: bool,
    seen_else: bool,
    place: Span,
}

/// What the last token was. Only the first argument of `debugPrintfEXT` may be a string.
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
    /// `__LINE__`, `__FILE__` and `__VERSION__`.
    computed: [u32; 3],
    macros: HashMap<u32, Rc<Macro>>,
    /// Tokens to read before the files, in reverse order.
    pending: Vec<Token>,
    open: Vec<Reading>,
    conditions: Vec<Open>,
    /// A `#pragma stage` selected the other stage.
    elsewhere: bool,
    printf: Printf,
    /// Within `[[..]]`: how many closing brackets have come.
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
    /// Defines the predefined macros.
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

    /// `#line LINE` and `#line LINE FILE`, both constant expressions. The next line has the number
    /// LINE, and before GLSL 3.30 the number behind it.
    fn line(&mut self, rest: Vec<Token>, place: (u32, u32)) -> Result<(), Stop> {
        let own = self.own_line(place.1.saturating_sub(1));
        let mut expanded = self.expanded(rest, 0)?;
        // GL_GOOGLE_cpp_style_line_directive names a file, which has no number.
        expanded.pop_if(|t| t.kind == TokenKind::Quoted);
        let words = self.words(&expanded, place)?;
        let both = (1..=words.len()).rev().find_map(|n| {
            let line = evaluate(&words[..n], true).ok()?;
            let file = match &words[n..] {
                [] => None,
                file => Some(evaluate(file, true).ok()?),
            };
            Some((line, file))
        });
        let numbers = both.filter(|(line, file)| {
            let fits = |n: &i64| u32::try_from(*n).is_ok();
            fits(line) && file.as_ref().is_none_or(fits)
        });
        let Some((line, file)) = numbers else {
            return Err(self.stop("`#line` takes the number of a line, and of a file", place));
        };
        let Dialect { version, es } = self.dialect;
        let next = line + i64::from(!es && version < 330);
        if let Some(reading) = self.open.last_mut() {
            reading.numbering.shift = next - (own + 1);
            reading.numbering.file = file.unwrap_or(reading.numbering.file);
        }
        Ok(())
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

    fn directive(&mut self, hash: &Token, line: Vec<Token>) -> Result<(), Stop> {
        let mut rest = line.into_iter();
        let Some(first) = rest.next() else {
            return Ok(());
        };
        let rest: Vec<Token> = rest.collect();
        let end = rest.last().unwrap_or(&first).end;
        let place = (hash.start, end.max(first.end));
        let active = self.is_active();
        let word = self.names.text(first.name);
        match &*word {
            "if" | "ifdef" | "ifndef" => {
                let holds = match (active, &*word) {
                    (false, _) => false,
                    (true, "if") => self.condition(rest, place)?,
                    (true, word) => {
                        let name = self.named(&rest, word, place)?;
                        self.is_defined(name) == (word == "ifdef")
                    }
                };
                self.conditions.push(Open {
                    active: active && holds,
                    taken: holds,
                    outside: active,
                    seen_else: false,
                    place: Span::new(place.0, place.1),
                });
            }
            "elif" | "else" | "endif" => {
                let Some(mut open) = self.conditions.pop() else {
                    return Err(self.stop(format!("this `#{word}` has no `#if`"), place));
                };
                if &*word == "endif" {
                    return Ok(());
                }
                if open.seen_else {
                    return Err(self.stop(format!("this `#{word}` follows `#else`"), place));
                }
                let holds = match &*word {
                    "else" => {
                        open.seen_else = true;
                        true
                    }
                    // After an active group the condition is not evaluated.
                    _ if !open.outside || open.taken => false,
                    _ => self.condition(rest, place)?,
                };
                open.active = open.outside && !open.taken && holds;
                open.taken |= open.active;
                self.conditions.push(open);
            }
            "pragma" if rest.first().is_some_and(|t| self.is(t, "stage")) => {
                let own = match self.stage {
                    ShaderStage::Vertex => "vertex",
                    _ => "fragment",
                };
                self.elsewhere = !rest.get(1).is_some_and(|t| self.is(t, own));
            }
            _ if !active => {}
            "define" | "undef" | "error" | "line" if self.elsewhere => {}
            "define" => self.define(&rest, place)?,
            "undef" => {
                let name = self.named(&rest, "undef", place)?;
                self.refuse_own(name, place)?;
                self.macros.remove(&name);
            }
            "error" => {
                let words: Vec<Rc<str>> = rest.iter().map(|t| self.names.text(t.name)).collect();
                return Err(self.stop(format!("#error {}", words.join(" ")), place));
            }
            "include" => self.include(rest, place)?,
            "version" => {
                let words: Vec<Rc<str>> = rest.iter().map(|t| self.names.text(t.name)).collect();
                if let Some(version) = words.first().and_then(|v| v.parse().ok()) {
                    self.dialect.version = version;
                }
                self.out.lexed_version = match self.lexed_version {
                    // The lexer has no Vulkan in ES.
                    460 if self.dialect.es => 460,
                    460 if (420..=460).contains(&self.dialect.version) => 460,
                    _ => self.dialect.version,
                };
            }
            "pragma" => {
                let words: Vec<Rc<str>> = rest.iter().map(|t| self.names.text(t.name)).collect();
                self.out.invariant_all |= words.concat().contains("STDGLinvariant(all)");
            }
            "extension" => {
                let words: Vec<Rc<str>> = rest.iter().map(|t| self.names.text(t.name)).collect();
                if let [name, .., behaviour] = &words[..]
                    && &**behaviour != "disable"
                {
                    self.out.extensions.insert(name.to_string());
                }
            }
            "line" => self.line(rest, place)?,
            _ => return Err(self.stop(format!("unknown directive `#{word}`"), place)),
        }
        Ok(())
    }

    fn emit(&mut self, token: &Token) -> Result<(), Stop> {
        let text = self.names.text(token.name);
        if matches!(&*text, "#" | "##") {
            return Err(self.stop(format!("unexpected `{text}`"), (token.start, token.end)));
        }
        // GL_EXT_control_flow_attributes has hints for the compiler alone.
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
        // It says of an index or a variable that invocations differ, and changes no value.
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

    fn named(&self, rest: &[Token], directive: &str, place: (u32, u32)) -> Result<u32, Stop> {
        let name = rest.first().filter(|t| t.kind == TokenKind::Word);
        name.map(|t| t.name)
            .ok_or_else(|| self.stop(format!("`#{directive}` names no macro"), place))
    }

    fn is_defined(&mut self, name: u32) -> bool {
        let is = self.macros.contains_key(&name) || self.computed.contains(&name);
        self.out.asks_for_vulkan |= !is && &*self.names.text(name) == "VULKAN";
        is
    }

    fn refuse_own(&self, name: u32, place: (u32, u32)) -> Result<(), Stop> {
        let text = self.names.text(name);
        let is_own = self.macros.get(&name).is_some_and(|m| m.is_own)
            || self.computed.contains(&name)
            || &*text == "defined";
        match is_own || text.starts_with("GL_") {
            true => Err(self.stop(format!("GLSL reserves the name `{text}`"), place)),
            false => Ok(()),
        }
    }

    fn define(&mut self, rest: &[Token], place: (u32, u32)) -> Result<(), Stop> {
        let name = self.named(rest, "define", place)?;
        self.refuse_own(name, place)?;
        let called = match (rest.first(), rest.get(1)) {
            (Some(name), Some(open)) => self.is(open, "(") && open.start == name.end,
            _ => false,
        };
        let mut at = 1;
        let mut parameters = None;
        if called {
            let mut names = Vec::new();
            at = 2;
            loop {
                let token = rest.get(at);
                at += 1;
                let text = token.map(|t| self.names.text(t.name));
                match (token, text.as_deref()) {
                    (_, Some(")")) => break,
                    (_, Some(",")) => {}
                    (Some(token), _) if token.kind == TokenKind::Word => names.push(token.name),
                    _ => {
                        let name = self.names.text(name);
                        return Err(self.stop(
                            format!("the parameters of the macro `{name}` are not closed"),
                            place,
                        ));
                    }
                }
            }
            parameters = Some(names);
        }
        let body = rest.get(at..).unwrap_or_default().to_vec();
        let made = Macro {
            parameters,
            body,
            is_own: false,
        };
        self.macros.insert(name, Rc::new(made));
        Ok(())
    }

    /// The result of `defined`.
    fn answer(&mut self, asked: Token, name: u32) -> Token {
        let value = u8::from(self.is_defined(name)).to_string();
        Token {
            kind: TokenKind::Number,
            name: self.names.number(&value),
            ..asked
        }
    }

    fn condition(&mut self, line: Vec<Token>, place: (u32, u32)) -> Result<bool, Stop> {
        // The operand of `defined` is not expanded.
        let mut ready = Vec::new();
        let mut rest = line.into_iter().peekable();
        while let Some(token) = rest.next() {
            if !self.is(&token, "defined") {
                ready.push(token);
                continue;
            }
            let bracket = rest.next_if(|t| self.is(t, "(")).is_some();
            let name = rest.next_if(|t| t.kind == TokenKind::Word);
            let closed = !bracket || rest.next_if(|t| self.is(t, ")")).is_some();
            let Some(name) = name.filter(|_| closed) else {
                return Err(self.stop("`defined` names no macro", place));
            };
            ready.push(self.answer(token, name.name));
        }
        let mut input = TokenSource::list(ready);
        let mut expanded = Vec::new();
        while let Some(token) = self.next(&mut input)? {
            // Macros may produce `defined`. C leaves that undefined (C11 6.10.1), and compilers
            // accept it.
            if self.is(&token, "defined") {
                let mut name = self.next(&mut input)?;
                let bracket = name.as_ref().is_some_and(|t| self.is(t, "("));
                if bracket {
                    name = self.next(&mut input)?;
                }
                let closed = !bracket || self.next(&mut input)?.is_some_and(|t| self.is(&t, ")"));
                let Some(name) = name.filter(|t| closed && t.kind == TokenKind::Word) else {
                    return Err(self.stop("`defined` names no macro", place));
                };
                expanded.push(self.answer(token, name.name));
            } else if let Some(token) = self.expand(token, &mut input, 0)? {
                self.work(1)?;
                expanded.push(token);
            }
        }
        let words = self.words(&expanded, place)?;
        let strict = self.dialect.es;
        evaluate(&words, strict).map(|v| v != 0).map_err(|wrong| {
            let token = |at: usize| expanded.get(at);
            let text = |at: usize| {
                token(at)
                    .map(|t| self.names.text(t.name))
                    .unwrap_or_default()
            };
            let at = |at: usize| token(at).map_or(place, |t| (t.start, t.end));
            match wrong {
                Wrong::Undefined(i) => self
                    .stop(format!("`{}` is not defined", text(i)), at(i))
                    .note(
                        "in GLSL ES an undefined name is an error in `#if` (ES 3.00, section 3.4): \
                         test `defined(..)` first",
                    ),
                Wrong::Malformed(Some(i)) if i < words.len() => self.stop(
                    format!("`{}` cannot be here in a condition", text(i)),
                    at(i),
                ),
                Wrong::Malformed(_) => self.stop("this condition is incomplete", place),
                Wrong::DivisionByZero => self.stop("this condition divides by 0", place),
                Wrong::TooDeep => self.too_deep(place),
            }
        })
    }

    /// The words of an expanded expression.
    fn words(&self, expanded: &[Token], place: (u32, u32)) -> Result<Vec<Word>, Stop> {
        let word = |(i, token): (usize, &Token)| {
            let text = self.names.text(token.name);
            Ok(match token.kind {
                TokenKind::Number => Word::Number(integer(&text).ok_or_else(|| {
                    let message = format!("`{text}` is not an integer, which a directive needs");
                    self.stop(message, place)
                })?),
                TokenKind::Word => Word::Undefined(i),
                _ => Word::Operator(text.to_string()),
            })
        };
        expanded.iter().enumerate().map(word).collect()
    }

    fn include(&mut self, line: Vec<Token>, place: (u32, u32)) -> Result<(), Stop> {
        let is_name = |this: &Self, line: &[Token]| {
            line.first()
                .is_some_and(|t| t.kind == TokenKind::Quoted || this.is(t, "<"))
        };
        let line = match is_name(self, &line) {
            true => line,
            false => self.expanded(line, 0)?,
        };
        if !is_name(self, &line) {
            return Err(self
                .stop("`#include` names no file", place)
                .note("put the name in quotes or angle brackets, or use a macro for it"));
        }
        let texts: Vec<Rc<str>> = line.iter().map(|t| self.names.text(t.name)).collect();
        let angled = line.first().is_some_and(|t| t.kind != TokenKind::Quoted);
        let name = match (&texts[..], angled) {
            ([first, ..], false) => first.trim_matches('"').to_owned(),
            ([_, rest @ ..], _) => {
                // As written, with spaces.
                let closed = rest.iter().position(|t| &**t == ">" || t.ends_with('>'));
                let Some(closed) = closed else {
                    return Err(self.stop("the name of this `#include` is not closed", place));
                };
                rest[..closed].concat()
            }
            _ => String::new(),
        };
        self.included += 1;
        self.out.is_more = true;
        if self.included > INCLUDES {
            let message = format!("files are included more than {INCLUDES} times");
            return Err(Error::new(Code::TooDeep, message).label(Span::new(place.0, place.1), ""));
        }
        let (folder, found) = match self.open.last() {
            Some(reading) => {
                let found = reading.found.as_deref().and_then(Path::parent);
                (reading.folder.clone(), found.map(Path::to_owned))
            }
            None => (self.home.clone(), None),
        };
        let mut beside = vec![folder];
        if angled {
            beside.insert(0, self.home.clone());
        }
        beside.extend(found);
        let asked: Vec<PathBuf> = beside.iter().map(|f| f.join(&name)).collect();
        let told = |e: &std::io::Error| {
            self.stop(e.to_string(), place)
                .note("searched: beside the file, then the include folders; --include DIR adds one")
        };
        let mut first = None;
        let hit = asked.iter().find_map(|path| match self.files.find(path) {
            Ok(found) => Some((path.clone(), found)),
            Err(error) => {
                first.get_or_insert(error);
                None
            }
        });
        let Some((asked, found)) = hit else {
            let error = first.unwrap_or_else(|| std::io::Error::other("there is no such file"));
            return Err(told(&error));
        };
        let tokens = match self.known.get(&found) {
            Some((_, tokens)) => Rc::clone(tokens),
            None => {
                let text = self.files.text(&found).map_err(|e| told(&e))?;
                let tokens = self.read(&asked, &found, text)?;
                let name = asked.to_string_lossy().into_owned();
                self.known.insert(found.clone(), (name, Rc::clone(&tokens)));
                tokens
            }
        };
        if self.open.len() > OPEN {
            // The file that includes itself.
            let twice = |i: &usize| {
                let rest = self.open.get(i + 1..).unwrap_or_default();
                rest.iter().any(|r| r.found == self.open[*i].found)
            };
            let round = (1..self.open.len()).find(twice);
            let round = round.and_then(|i| self.known.get(self.open[i].found.as_ref()?));
            return Err(match round {
                Some((name, _)) => self
                    .stop(format!("{name} includes itself without end"), place)
                    .note(
                        "begin it with `#ifndef A_NAME` and `#define A_NAME`, and end it with \
                         `#endif`",
                    ),
                None => self.stop(format!("includes are nested more than {OPEN} deep"), place),
            });
        }
        self.open.push(Reading {
            tokens,
            at: 0,
            folder: asked.parent().unwrap_or(Path::new("")).to_owned(),
            found: Some(found),
            numbering: Numbering::default(),
        });
        Ok(())
    }

    /// Tokenises a file and adds it to the source map.
    fn read(&mut self, asked: &Path, found: &Path, text: String) -> Result<Rc<Vec<Token>>, Stop> {
        let own = super::stage_of(&text, self.stage);
        let name = self.files.shown(asked, found);
        let base = self.map.add(name, text);
        let own = match own.strip_prefix('\u{feff}') {
            Some(rest) => format!("   {rest}"),
            None => own,
        };
        let tokens = tokens(&Joined::of(&own), base, &mut self.names)
            .map_err(|at| unclosed(Span::new(at, at + 2)))?;
        Ok(Rc::new(tokens))
    }
}
