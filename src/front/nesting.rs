//! Rejects text whose nesting would overflow the stack of a recursive parser or analysis. It is
//! fast and reports a location.

use naga::Span;

use super::Language;
use super::error::{Code, Error};
use crate::limits::Limits;

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
/// GLSL parser never does. The WGSL parser is quadratic within a function, so the text's length is
/// limited too.
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
                "{} bytes of source; the limit is {}",
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
            .note("split it into several variables")
    };
    // One level per open bracket, outermost first.
    let mut open: Vec<Level> = vec![Level::default()];
    // The last byte outside of white space and comments, and whether it ends a callable word.
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
        // Macros are checked after expansion.
        let begins_line = is_fresh;
        is_fresh = byte == b'\n' || is_fresh && byte.is_ascii_whitespace();
        match byte {
            b'#' if glsl && begins_line => at = end_of_directive(bytes, at),
            b'/' if bytes.get(at) == Some(&b'/') => at = end_of_line(bytes, at),
            b'/' if bytes.get(at) == Some(&b'*') => at = end_of_comment(bytes, at + 1),
            b'(' | b'[' | b'{' => {
                // A list follows a name, a length or a type's `>`, and `= {` in GLSL. Otherwise it
                // is a block.
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
                    .note("move the inner parts to variables"));
                }
            }
            b')' | b']' | b'}' => {
                // The parser reports an extra bracket.
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
                    // A new chain begins.
                    level.elses = 0;
                }
                let too_many = match word {
                    // Without braces, statements nest until the next semicolon.
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
                        format!("more than {ELSES} branches are nested"),
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

/// Whether `text` only has white space and comments.
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
