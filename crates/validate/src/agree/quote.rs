//! The author's text and numbers, as a sentence quotes them.

use crate::compare::text;
use naga_interp::{Scalar, Value};
use preshade_plan::program::Program;

/// The longest text that a sentence quotes.
const MOST: usize = 60;

/// The author's text of a span, on one line. If it is a name alone, as in GLSL, up to `parts` members
/// and indices follow.
pub(super) fn written(program: &Program, span: naga::Span, parts: usize) -> Option<String> {
    let sources = program.sources();
    let (file, range) = (sources.file_of(span)?, span.to_range()?);
    let base = file.base as usize;
    let (start, end) = (range.start - base, range.end - base);
    let start = opened(&file.text, start, end);
    // The span of a call is its function's name.
    let text = file.text.get(start..end)?;
    let rest = file.text.get(end..)?;
    let is_name = text.chars().all(|c| c.is_alphanumeric() || c == '_');
    let arguments = match is_name {
        true if rest.starts_with('(') => parenthesis(rest),
        true => (0..parts).fold(0, |end, _| end + part(&rest[end..])),
        false => 0,
    };
    let text = file.text.get(start..end + arguments)?;
    let line = text.split_whitespace().collect::<Vec<_>>().join(" ");
    let end = line.floor_char_boundary(MOST);
    Some(match end < line.len() {
        true => format!("{}..", &line[..end]),
        false => line,
    })
}

/// Where the expression begins whose end a span is: naga's spans of GLSL begin at a last index or member.
fn opened(text: &str, start: usize, end: usize) -> usize {
    let mut open = 0_usize;
    let mut closed = 0_usize;
    for c in text.get(start..end).unwrap_or_default().chars() {
        match c {
            '(' | '[' => open += 1,
            ')' | ']' if open == 0 => closed += 1,
            ')' | ']' => open -= 1,
            _ => {}
        }
    }
    let is_member = text.get(start..).is_some_and(|rest| rest.starts_with('.'));
    if closed == 0 && !is_member {
        return start;
    }
    // Back to the opening bracket, and to the name before it.
    let mut depth = closed;
    for (at, c) in text.get(..start).unwrap_or_default().char_indices().rev() {
        match c {
            ')' | ']' => depth += 1,
            '(' | '[' => depth = depth.saturating_sub(1),
            c if depth == 0 && !(c.is_alphanumeric() || c == '_' || c == '.') => {
                return at + c.len_utf8();
            }
            _ => {}
        }
    }
    0
}

/// The length of the member or index that a text begins with.
fn part(text: &str) -> usize {
    let is_of_name = |c: char| c.is_alphanumeric() || c == '_';
    match text.strip_prefix('.') {
        Some(name) => 1 + name.find(|c| !is_of_name(c)).unwrap_or(name.len()),
        None if text.starts_with('[') => parenthesis(text),
        None => 0,
    }
}

/// The length of the parenthesis or bracket that a text begins with.
fn parenthesis(text: &str) -> usize {
    let mut open = 0;
    for (at, c) in text.char_indices() {
        match c {
            '(' | '[' => open += 1,
            ')' | ']' if open == 1 => return at + 1,
            ')' | ']' => open -= 1,
            _ => {}
        }
    }
    0
}

/// A value in few digits.
pub(super) fn short(value: &Value) -> String {
    match value {
        Value::Scalar(Scalar::F32(x)) => digits(*x),
        // The first column of a matrix.
        Value::Composite(parts) if parts.iter().any(|p| matches!(p, Value::Composite(_))) => {
            match &parts[0] {
                Value::Composite(inner) if inner.iter().all(|p| matches!(p, Value::Scalar(_))) => {
                    format!("({}, ..)", short(&parts[0]))
                }
                _ => "(..)".to_owned(),
            }
        }
        Value::Composite(parts) if parts.len() <= 4 => {
            let parts: Vec<String> = parts.iter().map(short).collect();
            format!("({})", parts.join(", "))
        }
        other => text(other),
    }
}

/// Two texts of values, with the fewest digits of each number that still differ.
pub(super) fn distinguished(texts: [&str; 2]) -> [String; 2] {
    let mut all = (3..9).map(|count| texts.map(|text| fewer(text, count)));
    let found = all.find(|[a, b]| a != b);
    found.unwrap_or_else(|| texts.map(str::to_owned))
}

/// A text of values with this many digits of each number.
fn fewer(text: &str, count: i32) -> String {
    let mut out = String::new();
    let mut word = String::new();
    let flush = |word: &mut String, out: &mut String| {
        match word.parse::<f32>() {
            Ok(number) if word.contains('.') => out.push_str(&first_digits(number, count)),
            _ => out.push_str(word),
        }
        word.clear();
    };
    for c in text.chars() {
        match c {
            '(' | ')' | ',' | ' ' => {
                flush(&mut word, &mut out);
                out.push(c);
            }
            c => word.push(c),
        }
    }
    flush(&mut word, &mut out);
    out
}

/// A number with three digits.
pub(super) fn digits(x: f32) -> String {
    first_digits(x, 3)
}

fn first_digits(x: f32, count: i32) -> String {
    if x == 0.0 || !x.is_finite() {
        return format!("{x}");
    }
    let size = x.abs().log10().floor() as i32;
    match size {
        -4..=5 => {
            let text = format!("{:.*}", (count - 1 - size).max(0) as usize, x);
            match text.contains('.') {
                true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
                false => text,
            }
        }
        _ => format!("{x:.*e}", (count - 1) as usize),
    }
}
