//! Rejects text whose nesting would overflow the stack of a recursive parser or analysis. It is
//! fast and reports a location.

use std::ops::Range;

use naga::Span;

use super::error::{Code, Error};
use crate::limits::Limits;
use crate::source::Language;

/// Maximum operators per expression outside of brackets: a chain of `+` is a tree as deep as it is
/// long. The same limit holds for closed brackets, because `a[0][0]` nests too.
const OPERATORS: usize = 1_500;
/// Maximum `else if`s in a chain: each one nests in the previous.
const ELSES: usize = 500;
/// Maximum comma operators (GLSL).
const COMMAS: usize = 1_500;

/// Counts for one open bracket.
#[derive(Clone, Copy, Default)]
struct Level {
    /// Operators since the last separator.
    operators: usize,
    /// Brackets closed since the last separator.
    closed: usize,
    /// `else`s in the current chain.
    elses: usize,
    /// Comma operators since the last semicolon.
    commas: usize,
    /// Commas separate arguments or list values.
    is_list: bool,
}

impl Level {
    fn separate(&mut self) {
        (self.operators, self.closed) = (0, 0);
    }

    fn end(&mut self) {
        self.separate();
        self.commas = 0;
    }
}

/// Checks one file. `base` offsets the spans. naga's WGSL parser stops near 200 open brackets, its
/// GLSL parser never does. naga is quadratic within a function, so statements and the text's length are
/// limited too.
pub fn check(text: &str, base: u32, limits: &Limits, language: Language) -> Result<(), Error> {
    if text.len() as u64 > limits.source_bytes {
        let (bytes, limit) = (text.len(), limits.source_bytes);
        let message = format!("{bytes} bytes of source; the limit is {limit}");
        return Err(Error::new(Code::TooDeep, message));
    }
    let bytes = text.as_bytes();
    let glsl = language == Language::Glsl;
    let mut scan = Scan {
        text,
        base,
        glsl,
        brackets: usize::try_from(limits.nesting).unwrap_or(usize::MAX),
        open: vec![Level::default()],
        most_statements: limits.statements,
        statements: None,
        last: b';',
        is_called: false,
    };
    let mut is_fresh = true;
    let mut at = 0;
    while at < bytes.len() {
        let start = at;
        let byte = bytes[start];
        let begins_line = is_fresh;
        is_fresh = byte == b'\n' || is_fresh && byte.is_ascii_whitespace();
        at = match (byte, bytes.get(start + 1)) {
            // Macros are checked after expansion.
            (b'#', _) if glsl && begins_line => {
                (scan.last, scan.is_called) = (byte, false);
                end_of_directive(bytes, start + 1)
            }
            (b'/', Some(b'/')) => end_of_line(bytes, start + 1),
            (b'/', Some(b'*')) => end_of_comment(bytes, start + 2),
            (b'a'..=b'z' | b'A'..=b'Z' | b'_', _) => {
                let is_word = |b: &u8| b.is_ascii_alphanumeric() || *b == b'_';
                let length = bytes[start..].iter().take_while(|b| is_word(b)).count();
                scan.word(start..start + length)?;
                start + length
            }
            _ => {
                scan.sign(start)?;
                start + 1
            }
        };
    }
    Ok(())
}

struct Scan<'a> {
    text: &'a str,
    base: u32,
    glsl: bool,
    /// Maximum open brackets.
    brackets: usize,
    /// One level per open bracket, outermost first. Never empty.
    open: Vec<Level>,
    most_statements: u64,
    /// Statements and list values of the open function; `None` outside of functions.
    statements: Option<u64>,
    /// The last byte outside of white space and comments, and whether it ends a callable word.
    last: u8,
    is_called: bool,
}

impl Scan<'_> {
    fn level(&mut self) -> &mut Level {
        if self.open.is_empty() {
            self.open.push(Level::default());
        }
        let last = self.open.len() - 1;
        &mut self.open[last]
    }

    fn error(&self, message: String, at: usize, label: &str, note: &str) -> Error {
        let start = self.base + at as u32;
        Error::new(Code::TooDeep, message)
            .label(Span::new(start, start + 1), label)
            .note(note)
    }

    /// Fails if `count` exceeds `most`.
    fn limit(&self, count: usize, most: usize, of: &str, at: usize) -> Result<(), Error> {
        if count <= most {
            return Ok(());
        }
        let message = format!("one expression has more than {most} {of}");
        let note = "split it into several variables";
        Err(self.error(message, at, "this one is too many", note))
    }

    /// Counts a statement or a list value.
    fn count(&mut self, at: usize) -> Result<(), Error> {
        let most = self.most_statements;
        let Some(statements) = &mut self.statements else {
            return Ok(());
        };
        *statements += 1;
        if *statements <= most {
            return Ok(());
        }
        let message = format!(
            "one function has more than {most} statements and list values; the limit is \
             `statements`"
        );
        let note = "the parser's time grows with their square: move some to other functions, or \
                    allow more with --limits statements=NUMBER";
        Err(self.error(message, at, "this one is too many", note))
    }

    fn word(&mut self, range: Range<usize>) -> Result<(), Error> {
        let start = range.start;
        let word = &self.text[range];
        self.last = word.as_bytes()[0];
        self.is_called = !matches!(word, "if" | "for" | "while" | "switch" | "return");
        let begins_chain = word == "if" && !self.text[..start].trim_end().ends_with("else");
        let level = self.level();
        if begins_chain {
            level.elses = 0;
        }
        let too_many = match word {
            // Without braces, statements nest until the next semicolon.
            "if" | "for" | "while" | "do" => {
                level.operators += 1;
                level.operators > OPERATORS
            }
            "else" => {
                level.elses += 1;
                level.elses > ELSES
            }
            _ => false,
        };
        if too_many {
            let message = format!("more than {ELSES} branches are nested");
            let note = "use a switch, or a table";
            return Err(self.error(message, start, "this one is too many", note));
        }
        Ok(())
    }

    fn sign(&mut self, at: usize) -> Result<(), Error> {
        let byte = self.text.as_bytes()[at];
        let (before, named) = (self.last, self.is_called);
        if !byte.is_ascii_whitespace() {
            (self.last, self.is_called) = (byte, false);
        }
        if matches!(byte, b';' | b',') {
            self.count(at)?;
        }
        if byte == b'{' && self.open.len() == 1 && before != b'=' {
            self.statements = Some(0);
        }
        let glsl = self.glsl;
        let level = self.level();
        match byte {
            b'(' | b'[' | b'{' => {
                // A list follows a name, a length or a type's `>`, and `= {` in GLSL. Otherwise it
                // is a block.
                let is_list = match byte {
                    _ if !glsl => true,
                    b'(' => named || before == b']',
                    b'{' => before == b'=' || level.is_list && matches!(before, b',' | b'{'),
                    _ => false,
                };
                if byte == b'{' {
                    level.end();
                }
                self.open.push(Level {
                    is_list,
                    ..Level::default()
                });
                if self.open.len() > self.brackets {
                    let message = format!("brackets are nested more than {} deep", self.brackets);
                    let note = "move the inner parts to variables";
                    return Err(self.error(message, at, "this one is too deep", note));
                }
            }
            b')' | b']' | b'}' => {
                // The parser reports an extra bracket.
                if self.open.len() > 1 {
                    self.open.pop();
                }
                if self.open.len() == 1 {
                    self.statements = None;
                }
                let level = self.level();
                if byte == b'}' {
                    level.end();
                } else {
                    level.closed += 1;
                    let closed = level.closed;
                    self.limit(closed, OPERATORS, "brackets in a row", at)?;
                }
            }
            b';' => level.end(),
            b',' if level.is_list || !glsl => level.separate(),
            b',' => {
                level.operators = 0;
                level.commas += 1;
                let commas = level.commas;
                self.limit(commas, COMMAS, "commas", at)?;
            }
            b'+' | b'-' | b'*' | b'/' | b'%' | b'&' | b'|' | b'^' | b'!' | b'~' | b'=' | b'<'
            | b'>' | b'.' | b'?' => {
                level.operators += 1;
                let operators = level.operators;
                self.limit(operators, OPERATORS, "operators", at)?;
            }
            _ => {}
        }
        Ok(())
    }
}

/// Whether `text` only has white space and comments.
pub fn is_blank(text: &str) -> bool {
    let bytes = text.as_bytes();
    let mut at = 0;
    while at < bytes.len() {
        match bytes[at] {
            b'/' if bytes.get(at + 1) == Some(&b'/') => at = end_of_line(bytes, at),
            b'/' if bytes.get(at + 1) == Some(&b'*') => at = end_of_comment(bytes, at + 2),
            b if b.is_ascii_whitespace() => at += 1,
            // A byte order mark.
            0xEF | 0xBB | 0xBF => at += 1,
            _ => return false,
        }
    }
    true
}

/// The end of a directive, which may span several lines.
fn end_of_directive(bytes: &[u8], from: usize) -> usize {
    let mut at = from;
    while at < bytes.len() {
        at = match (bytes[at], bytes.get(at + 1)) {
            (b'\n', _) => return at,
            (b'\\', Some(b'\n')) => at + 2,
            (b'\\', Some(b'\r')) if bytes.get(at + 2) == Some(&b'\n') => at + 3,
            (b'/', Some(b'*')) => end_of_comment(bytes, at + 2),
            _ => at + 1,
        };
    }
    at
}

fn end_of_line(bytes: &[u8], from: usize) -> usize {
    bytes[from..]
        .iter()
        .position(|b| *b == b'\n')
        .map_or(bytes.len(), |n| from + n)
}

/// The position after `*/`, or the end of the text. WGSL's nested comments end early here, so their
/// rest counts as code. That only makes the check stricter.
fn end_of_comment(bytes: &[u8], from: usize) -> usize {
    bytes[from..]
        .windows(2)
        .position(|w| w == b"*/")
        .map_or(bytes.len(), |n| from + n + 2)
}
