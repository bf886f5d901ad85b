//! Refuses text nested so deeply that a recursive parser, or any analysis after it, would run out of stack: quickly, and with a place.

use naga::Span;

use super::error::{Code, Error};
use crate::limits::Limits;

/// Most operators in one expression outside any further bracket: a chain of `+` is a tree as deep as it is long.
const OPERATORS: usize = 1_500;
/// Most `else if`s in one chain: each nests in the one before.
const ELSES: usize = 500;

/// Checks one file's text; spans are offset by `base`. naga's WGSL parser gives up near 200 open brackets by itself, its GLSL parser never does; the one for WGSL is
/// quadratic within a function, so that the text's length is bounded too.
pub(super) fn check(text: &str, base: u32, limits: &Limits) -> Result<(), Error> {
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
    let here = |at: usize| Span::new(base + at as u32, base + at as u32 + 1);
    // For each open bracket, the outermost first: operators since the last separator, and `else`s since the chain began.
    let mut open: Vec<(usize, usize)> = vec![(0, 0)];
    let mut at = 0;
    while at < bytes.len() {
        let start = at;
        at += 1;
        let Some((count, elses)) = open.last_mut() else {
            break;
        };
        match bytes[start] {
            b'/' if bytes.get(at) == Some(&b'/') => at = end_of_line(bytes, at),
            b'/' if bytes.get(at) == Some(&b'*') => at = end_of_comment(bytes, at + 1),
            b'(' | b'[' | b'{' => {
                if bytes[start] == b'{' {
                    *count = 0;
                }
                open.push((0, 0));
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
                if bytes[start] == b'}' {
                    open.last_mut()
                        .into_iter()
                        .for_each(|(count, _)| *count = 0);
                }
            }
            b',' | b';' => *count = 0,
            b'+' | b'-' | b'*' | b'/' | b'%' | b'&' | b'|' | b'^' | b'!' | b'~' | b'=' | b'<'
            | b'>' | b'.' | b'?' => {
                *count += 1;
                if *count > OPERATORS {
                    return Err(Error::new(
                        Code::TooDeep,
                        format!("one expression has more than {OPERATORS} operators"),
                    )
                    .label(here(start), "this one is too many")
                    .note("split it over several variables"));
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
                if word == b"if" && !text[..start].trim_end().ends_with("else") {
                    // It begins a chain of its own.
                    *elses = 0;
                }
                let too_many = match word {
                    // Without braces, statements nest in one another up to the next semicolon.
                    b"if" | b"for" | b"while" | b"do" => {
                        *count += 1;
                        *count > OPERATORS
                    }
                    b"else" => {
                        *elses += 1;
                        *elses > ELSES
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
