//! Which statement of a WGSL text naga panics at: it says nothing but a place in its own source.
//!
//! The text is read again with parts of it blank. naga lowers a function's statements in their order, so the first at which a body, cut off behind it, still panics is the one.

use std::ops::Range;

/// Longer texts, and texts of more functions, are not looked through: each look reads the whole.
const MOST_BYTES: usize = 256 << 10;
const MOST_FUNCTIONS: usize = 400;

/// The innermost statement, or else the function's body, without which `panics` is not so; `None` where no one function is to blame.
pub(super) fn statement(text: &str, panics: &dyn Fn(&str) -> bool) -> Option<Range<usize>> {
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

/// The first statement of a block at which a text still panics that has nothing behind it in the block, or one within it.
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
            // A block to blame as a whole says less than its statement.
            if least == block { found } else { least }
        }
        None => found,
    }
}

/// A text with a part of it made blank; lines stay where they are.
fn blank(text: &str, range: &Range<usize>) -> String {
    let mut bytes = text.as_bytes().to_vec();
    for byte in &mut bytes[range.clone()] {
        if *byte != b'\n' {
            *byte = b' ';
        }
    }
    // Ranges begin and end beside ASCII.
    String::from_utf8(bytes).unwrap_or_default()
}

/// What stands between the outermost braces of a part.
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

/// The statements right within a block.
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
        // What follows an `if`'s block may be its `else`, which is then a piece of its own: no text that ends ahead of it is wrong.
        if depth == 0 && matches!(byte, b';' | b'}') {
            out.extend(start.take().map(|start| start..at + 1));
        }
    }
    out
}

/// The bytes of a part that stand in no comment.
fn code(text: &str, part: Range<usize>) -> Vec<(usize, u8)> {
    let bytes = text.as_bytes();
    let mut out = Vec::new();
    let mut at = part.start;
    while at < part.end {
        let rest = &bytes[at..part.end];
        if rest.starts_with(b"//") {
            at += rest.iter().position(|b| *b == b'\n').unwrap_or(rest.len());
        } else if rest.starts_with(b"/*") {
            // They nest (WGSL, section 3.4).
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
        let found = statement(text, &panics).unwrap();
        assert_eq!(&text[found], "PANIC;");
        assert_eq!(statement(&text.replace("PANIC", "fine"), &panics), None);
        // Of a declaration no function is to blame.
        assert_eq!(
            statement(&text.replace("a = 1", "a = PANIC"), &panics),
            None
        );
    }
}
