//! Refuses text nested so deeply that a recursive parser, or any analysis after it, would run out of stack: quickly, and with a place.

use naga::Span;

use super::Language;
use super::error::{Code, Error};
use crate::limits::Limits;

/// Most operators in one expression outside any further bracket: a chain of `+` is a tree as deep as it is long. As many brackets may be closed there: `a[0][0]` nests as well.
const OPERATORS: usize = 1_500;
/// Most `else if`s in one chain: each nests in the one before.
const ELSES: usize = 500;
/// Most commas between expressions that are no arguments: GLSL's operator.
const COMMAS: usize = 1_500;

/// What an open bracket holds so far.
#[derive(Clone, Copy, Default)]
struct Level {
    /// Operators since the last separator.
    operators: usize,
    /// Brackets closed since then.
    closed: usize,
    /// `else`s since the chain began.
    elses: usize,
    /// Commas that are operators, since the last semicolon.
    commas: usize,
    /// Its commas stand between arguments, or values of a list.
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

/// Checks one file's text, in a language that has the comma for an operator or not; spans are offset by `base`. naga's WGSL parser gives up near 200 open brackets by itself, its GLSL
/// parser never does; the one for WGSL is quadratic within a function, so that the text's length is bounded too.
pub(super) fn check(
    text: &str,
    base: u32,
    limits: &Limits,
    language: Language,
) -> Result<(), Error> {
    let brackets = usize::try_from(limits.nesting).unwrap_or(usize::MAX);
    if text.len() as u64 > limits.source_bytes {
        return Err(Error::new(
            Code::TooDeep,
            format!(
                "{} bytes of source; at most {} are read",
                text.len(),
                limits.source_bytes
            ),
        ));
    }
    let bytes = text.as_bytes();
    let glsl = language == Language::Glsl;
    let here = |at: usize| Span::new(base + at as u32, base + at as u32 + 1);
    let too_many = |what: String, at: usize| {
        Error::new(Code::TooDeep, what)
            .label(here(at), "this one is too many")
            .note("split it over several variables")
    };
    // For each open bracket, the outermost first.
    let mut open: Vec<Level> = vec![Level::default()];
    // What stands before: the last byte that is neither white nor of a comment, and whether it ends a word that may be called.
    let (mut last, mut is_called) = (b';', false);
    let mut is_fresh = true;
    let mut at = 0;
    while at < bytes.len() {
        let start = at;
        at += 1;
        let Some(level) = open.last_mut() else {
            break;
        };
        let (before, named) = (last, is_called);
        let byte = bytes[start];
        let is_comment = byte == b'/' && matches!(bytes.get(at), Some(b'/' | b'*'));
        if !byte.is_ascii_whitespace() && !is_comment {
            (last, is_called) = (byte, false);
        }
        // What macros come to is looked at once it is expanded.
        let begins_line = is_fresh;
        is_fresh = byte == b'\n' || is_fresh && byte.is_ascii_whitespace();
        match byte {
            b'#' if glsl && begins_line => at = end_of_directive(bytes, at),
            b'/' if bytes.get(at) == Some(&b'/') => at = end_of_line(bytes, at),
            b'/' if bytes.get(at) == Some(&b'*') => at = end_of_comment(bytes, at + 1),
            b'(' | b'[' | b'{' => {
                // A list of values, unless it is a block: what a name, a length or a type's `>` stands before, and in GLSL `= {`.
                let is_list = match byte {
                    b'(' => named || before == b']' || !glsl,
                    b'{' => {
                        before == b'=' || level.is_list && matches!(before, b',' | b'{') || !glsl
                    }
                    _ => !glsl,
                };
                if byte == b'{' {
                    level.end();
                }
                open.push(Level {
                    is_list,
                    ..Level::default()
                });
                if open.len() > brackets {
                    return Err(Error::new(
                        Code::TooDeep,
                        format!("brackets are nested more than {brackets} deep"),
                    )
                    .label(here(start), "this one is too deep")
                    .note("give the inner parts names of their own"));
                }
            }
            b')' | b']' | b'}' => {
                // One too many is the parser's to report.
                if open.len() > 1 {
                    open.pop();
                }
                let Some(level) = open.last_mut() else {
                    break;
                };
                if byte == b'}' {
                    level.end();
                    continue;
                }
                level.closed += 1;
                if level.closed > OPERATORS {
                    let what =
                        format!("one expression has more than {OPERATORS} brackets in a row");
                    return Err(too_many(what, start));
                }
            }
            b';' => level.end(),
            b',' if level.is_list => level.separate(),
            b',' => {
                level.operators = 0;
                level.commas += usize::from(glsl);
                if !glsl {
                    level.separate();
                }
                if level.commas > COMMAS {
                    let what = format!("one expression has more than {COMMAS} commas");
                    return Err(too_many(what, start));
                }
            }
            b'+' | b'-' | b'*' | b'/' | b'%' | b'&' | b'|' | b'^' | b'!' | b'~' | b'=' | b'<'
            | b'>' | b'.' | b'?' => {
                level.operators += 1;
                if level.operators > OPERATORS {
                    let what = format!("one expression has more than {OPERATORS} operators");
                    return Err(too_many(what, start));
                }
            }
            b'a'..=b'z' | b'A'..=b'Z' | b'_' => {
                while bytes
                    .get(at)
                    .is_some_and(|b| b.is_ascii_alphanumeric() || *b == b'_')
                {
                    at += 1;
                }
                let word = &bytes[start..at];
                is_called = !matches!(word, b"if" | b"for" | b"while" | b"switch" | b"return");
                if word == b"if" && !text[..start].trim_end().ends_with("else") {
                    // It begins a chain of its own.
                    level.elses = 0;
                }
                let too_many = match word {
                    // Without braces, statements nest in one another up to the next semicolon.
                    b"if" | b"for" | b"while" | b"do" => {
                        level.operators += 1;
                        level.operators > OPERATORS
                    }
                    b"else" => {
                        level.elses += 1;
                        level.elses > ELSES
                    }
                    _ => false,
                };
                if too_many {
                    return Err(Error::new(
                        Code::TooDeep,
                        format!("more than {ELSES} branches nest in one another"),
                    )
                    .label(here(start), "this one is too many")
                    .note("use a switch, or a table"));
                }
            }
            _ => {}
        }
    }
    Ok(())
}

/// Whether `text` holds anything but white space and comments.
pub(super) fn is_blank(text: &str) -> bool {
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

/// At the end of a directive, which may go over several lines.
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

/// Past the `*/`, or past the text. Nested comments (WGSL's) end early here; the rest is then counted as code, which only makes the
/// check stricter.
fn end_of_comment(bytes: &[u8], from: usize) -> usize {
    bytes[from..]
        .windows(2)
        .position(|w| w == b"*/")
        .map_or(bytes.len(), |n| from + n + 2)
}
