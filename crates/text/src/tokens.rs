//! Tokenises naga's WGSL, which has no comments and no templates that look like comparisons.

use std::ops::Range;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TokenKind {
    /// An identifier or keyword.
    Word,
    /// A number with its suffix.
    Number,
    /// Any other character except white space.
    Mark,
}

/// The text with blanks in place of comments, as long as before and with the same lines.
pub fn without_comments(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(at) = rest.find('/') {
        let inside = &rest[at + 1..];
        let length = match inside.as_bytes().first() {
            Some(b'/') => inside.find('\n').unwrap_or(inside.len()),
            Some(b'*') => inside[1..].find("*/").map_or(inside.len(), |n| n + 3),
            _ => 0,
        };
        let is_comment = length > 0;
        out.push_str(&rest[..at + usize::from(!is_comment)]);
        let (comment, behind) = rest[at..].split_at(1 + length);
        if is_comment {
            let blank = |b| if b == b'\n' { '\n' } else { ' ' };
            out.extend(comment.bytes().map(blank));
        }
        rest = behind;
    }
    out + rest
}

/// The tokens of `text`, those in comments too.
pub fn tokens(text: &str) -> impl Iterator<Item = (TokenKind, Range<usize>)> + '_ {
    let bytes = text.as_bytes();
    let mut at = 0;
    std::iter::from_fn(move || {
        while bytes.get(at).is_some_and(u8::is_ascii_whitespace) {
            at += 1;
        }
        let start = at;
        let first = *bytes.get(at)?;
        let word = |b: u8| b.is_ascii_alphanumeric() || b == b'_' || !b.is_ascii();
        at += 1;
        let kind = if first.is_ascii_digit() {
            // 0x1f, 1.5f, 1e-5: a sign belongs to a number only after its exponent letter.
            let hex = bytes.get(at).is_some_and(|b| matches!(b, b'x' | b'X'));
            while let Some(b) = bytes.get(at) {
                let exponent = matches!(bytes[at - 1], b'e' | b'E') && !hex;
                if !(word(*b) || *b == b'.' || (exponent && matches!(b, b'+' | b'-'))) {
                    break;
                }
                at += 1;
            }
            TokenKind::Number
        } else if word(first) {
            while bytes.get(at).is_some_and(|b| word(*b)) {
                at += 1;
            }
            TokenKind::Word
        } else {
            TokenKind::Mark
        };
        Some((kind, start..at))
    })
}

/// Which words to visit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Words {
    All,
    /// Words that are not members, so no dot precedes them.
    Free,
}

/// Replaces each word for which `rename` returns a name.
pub fn rename_words<'a>(
    text: &'a str,
    words: Words,
    rename: impl Fn(&'a str) -> Option<&'a str>,
) -> String {
    let mut out = String::with_capacity(text.len());
    let mut copied = 0;
    let mut after_dot = false;
    for (kind, range) in tokens(text) {
        let word = &text[range.clone()];
        let considered = kind == TokenKind::Word && (words == Words::All || !after_dot);
        after_dot = word == ".";
        if considered && let Some(new) = rename(word) {
            out.push_str(&text[copied..range.start]);
            out.push_str(new);
            copied = range.end;
        }
    }
    out.push_str(&text[copied..]);
    out
}

/// The syntax of 32-bit float literals.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Spelling {
    /// `1.5f`.
    Wgsl,
    /// `1.5`, or `1e-7`.
    Glsl,
}

/// Rewrites floats so that every compiler reads naga's bits. The shortest digits of the largest
/// float exceed it, which Tint rejects and ANGLE reads as infinity. In WGSL, numbers get the
/// exponents that Rust prints and naga omits.
pub fn exact_floats(text: &str, spelling: Spelling) -> String {
    let mut out = String::with_capacity(text.len());
    let mut copied = 0;
    for (kind, range) in tokens(text) {
        let word = &text[range.clone()];
        if kind != TokenKind::Number || word.starts_with("0x") {
            continue;
        }
        let digits = match spelling {
            Spelling::Wgsl => word.strip_suffix('f'),
            Spelling::Glsl => word.contains(['.', 'e']).then_some(word),
        };
        let Some(value) = digits.and_then(|d| d.parse::<f32>().ok()) else {
            continue;
        };
        let spelled = match value == f32::MAX {
            true => "3.40282346e38".to_owned(),
            false => format!("{value:?}"),
        };
        if spelling == Spelling::Wgsl && !spelled.contains('e') || spelled == word {
            continue;
        }
        out.push_str(&text[copied..range.start]);
        out.push_str(&spelled);
        if spelling == Spelling::Wgsl {
            out.push('f');
        }
        copied = range.end;
    }
    out.push_str(&text[copied..]);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_words_are_told_apart() {
        let text = "let a1 = 0x1f + 1.5e-5f*x2.y;";
        let seen: Vec<&str> = tokens(text).map(|(_, r)| &text[r]).collect();
        assert_eq!(
            seen,
            [
                "let", "a1", "=", "0x1f", "+", "1.5e-5f", "*", "x2", ".", "y", ";"
            ]
        );
    }

    #[test]
    fn whole_words_are_renamed() {
        let rename = |w: &str| (w == "uv_").then_some("uv");
        let text = "uv_ + uv_1 * a.uv_";
        assert_eq!(rename_words(text, Words::All, rename), "uv + uv_1 * a.uv");
        assert_eq!(rename_words(text, Words::Free, rename), "uv + uv_1 * a.uv_");
    }

    #[test]
    fn floats_come_back_to_their_bits() {
        let smallest = f32::from_bits(1);
        for value in [
            f32::MAX,
            -f32::MAX,
            f32::from_bits(f32::MAX.to_bits() - 1),
            smallest,
            f32::from_bits(0x007f_ffff),
            f32::MIN_POSITIVE,
            1e16,
            16_777_216.0,
            0.1,
            -0.0,
            1e-5,
        ] {
            for (spelling, written) in [
                (Spelling::Wgsl, format!("x = {value}f;")),
                (Spelling::Glsl, format!("x = {value:?};")),
            ] {
                let text = exact_floats(&written, spelling);
                let number = text.trim_start_matches("x = ").trim_end_matches(['f', ';']);
                // A compiler may read a double first, which must not exceed the largest float.
                let read: f64 = number.parse().unwrap_or(f64::NAN);
                assert!(read.abs() <= f64::from(f32::MAX), "{text}");
                assert_eq!((read as f32).to_bits(), value.to_bits(), "{text}");
            }
        }
    }

    #[test]
    fn what_is_no_float_stays() {
        let text = "array<f32, 4>(1f, 2.5f, 3i, 4u, 0x1f, 1.5h) // 1e9";
        assert_eq!(exact_floats(text, Spelling::Wgsl), text);
        let text = "vec2 a[3] = f(1.0, 2u, 3, 1e-7, 1.5LF);";
        assert_eq!(exact_floats(text, Spelling::Glsl), text);
    }
}
