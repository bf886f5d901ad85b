//! Finds the WGSL statement at which naga panics. naga's panic only gives a place in naga's own
//! source.
//!
//! We parse the text again with parts of it blanked. naga lowers statements in order, so the
//! culprit is the first statement at which a truncated body still panics.

use std::ops::Range;

/// Longer texts, and texts with more functions, are not searched: each attempt parses the whole
/// text.
const MOST_BYTES: usize = 256 << 10;
const MOST_FUNCTIONS: usize = 400;

/// The innermost statement that makes `panics` true, or else the function's body. `None` if no
/// single function is the cause.
pub(super) fn panicking_statement(
    text: &str,
    panics: &dyn Fn(&str) -> bool,
) -> Option<Range<usize>> {
    if text.len() > MOST_BYTES || !panics(text) {
        return None;
    }
    let blocks = blocks(text, 0..text.len());
    if blocks.len() > MOST_FUNCTIONS {
        return None;
    }
    let without = |range: &Range<usize>| !panics(&blank(text, range));
    let body = blocks.into_iter().find(without)?;
    Some(narrowed(text, body, panics))
}

/// The first statement of a block after which the truncated text still panics, or a statement
/// nested in it.
fn narrowed(text: &str, body: Range<usize>, panics: &dyn Fn(&str) -> bool) -> Range<usize> {
    let statements = statements(text, body.clone());
    let cut = |end: usize| blank(text, &(end..body.end));
    let first = statements.partition_point(|s| !panics(&cut(s.end)));
    let Some(found) = statements.get(first).cloned() else {
        return body;
    };
    let shorter = cut(found.end);
    let inner = blocks(&shorter, found.clone());
    let inner = inner
        .into_iter()
        .find(|block| !panics(&blank(&shorter, block)));
    match inner {
        Some(block) => {
            let least = narrowed(&shorter, block.clone(), panics);
            // A statement is more precise than a whole block.
            if least == block { found } else { least }
        }
        None => found,
    }
}

/// Blanks a part of the text and keeps its line breaks.
fn blank(text: &str, range: &Range<usize>) -> String {
    let mut bytes = text.as_bytes().to_vec();
    for byte in &mut bytes[range.clone()] {
        if *byte != b'\n' {
            *byte = b' ';
        }
    }
    String::from_utf8(bytes).unwrap_or_default()
}

/// The ranges between a part's outermost braces.
fn blocks(text: &str, part: Range<usize>) -> Vec<Range<usize>> {
    let mut out = Vec::new();
    let mut open = Vec::new();
    for (at, byte) in code(text, part) {
        match byte {
            b'{' => open.push(at + 1),
            b'}' => {
                if let (Some(start), true) = (open.pop(), open.is_empty()) {
                    out.push(start..at);
                }
            }
            _ => {}
        }
    }
    out
}

/// The direct statements of a block.
fn statements(text: &str, body: Range<usize>) -> Vec<Range<usize>> {
    let mut out = Vec::new();
    let (mut depth, mut start) = (0_u32, None);
    for (at, byte) in code(text, body) {
        if start.is_none() && !byte.is_ascii_whitespace() {
            start = Some(at);
        }
        match byte {
            b'{' | b'(' | b'[' => depth += 1,
            b'}' | b')' | b']' => depth = depth.saturating_sub(1),
            _ => {}
        }
        // An `else` after an `if` block is a piece of its own. A text that ends before it is still
        // valid.
        if depth == 0 && matches!(byte, b';' | b'}') {
            out.extend(start.take().map(|start| start..at + 1));
        }
    }
    out
}

/// The bytes of a part that are outside of comments.
fn code(text: &str, part: Range<usize>) -> Vec<(usize, u8)> {
    let bytes = text.as_bytes();
    let mut out = Vec::new();
    let mut at = part.start;
    while at < part.end {
        let rest = &bytes[at..part.end];
        if rest.starts_with(b"//") {
            at += rest.iter().position(|b| *b == b'\n').unwrap_or(rest.len());
        } else if rest.starts_with(b"/*") {
            // Comments nest (WGSL 3.4).
            let mut depth = 0;
            while at < part.end {
                let rest = &bytes[at..part.end];
                let step = match () {
                    () if rest.starts_with(b"/*") => {
                        depth += 1;
                        2
                    }
                    () if rest.starts_with(b"*/") => {
                        depth -= 1;
                        2
                    }
                    () => 1,
                };
                at += step;
                if depth == 0 {
                    break;
                }
            }
        } else {
            out.push((at, bytes[at]));
            at += 1;
        }
    }
    out
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn the_innermost_statement_is_found() {
        let text = "const a = 1; // {
fn one() { let x = 1; }
/* } /* { */ */ fn two() -> i32 {
    var y = 2;
    if y > 1 { y = 3; } else { for (var i = 0; i < 3; i++) { y += 1; PANIC; y += 2; } }
    return y;
}
fn three() {}
";
        let panics = |text: &str| text.contains("PANIC");
        let found = panicking_statement(text, &panics).unwrap();
        assert_eq!(&text[found], "PANIC;");
        assert_eq!(
            panicking_statement(&text.replace("PANIC", "fine"), &panics),
            None
        );
        // A panic in a declaration has no culprit function.
        assert_eq!(
            panicking_statement(&text.replace("a = 1", "a = PANIC"), &panics),
            None
        );
    }
}
