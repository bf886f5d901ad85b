//! Tokens of an author's WGSL: comments are skipped, operators are whole, and brackets of templates
//! differ from comparisons (WGSL 3.9).

use std::ops::Range;

use shader_text::tokens as text;
use shader_text::tokens::TokenKind;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// An identifier or keyword.
    Word,
    Number,
    /// `<` of a template.
    Open,
    /// `>` of a template.
    Close,
    /// Any other sign, up to three characters.
    Sign,
}

#[derive(Clone, Debug)]
pub(super) struct Token<'t> {
    pub kind: Kind,
    pub text: &'t str,
    pub at: usize,
}

impl Token<'_> {
    pub(super) fn range(&self) -> Range<usize> {
        self.at..self.at + self.text.len()
    }
}

/// Signs of more than one character, longest first.
const SIGNS: [&str; 21] = [
    "<<=", ">>=", "&&", "||", "<<", ">>", "<=", ">=", "==", "!=", "++", "--", "->", "+=", "-=",
    "*=", "/=", "%=", "&=", "|=", "^=",
];

pub(super) fn tokens(text: &str) -> Vec<Token<'_>> {
    let blank = without_comments(text);
    let raw: Vec<(TokenKind, Range<usize>)> = text::tokens(&blank).collect();
    let brackets = templates(&blank, &raw);
    let mut out: Vec<Token<'_>> = Vec::with_capacity(raw.len());
    let mut n = 0;
    while let Some((kind, range)) = raw.get(n) {
        let mut end = range.end;
        let kind = match (kind, brackets.get(n)) {
            (_, Some(Some(bracket))) => *bracket,
            (TokenKind::Word, _) => Kind::Word,
            (TokenKind::Number, _) => Kind::Number,
            (TokenKind::Mark, _) => {
                let is_free = |sign: &&&str| {
                    let others = &brackets[n..(n + sign.len()).min(brackets.len())];
                    blank[range.start..].starts_with(**sign) && others.iter().all(Option::is_none)
                };
                if let Some(sign) = SIGNS.iter().find(is_free) {
                    end = range.start + sign.len();
                }
                Kind::Sign
            }
        };
        out.push(Token {
            kind,
            text: &text[range.start..end],
            at: range.start,
        });
        n += 1;
        while raw.get(n).is_some_and(|(_, next)| next.start < end) {
            n += 1;
        }
    }
    out
}

/// The text with blanks in place of comments, which nest.
fn without_comments(text: &str) -> String {
    let mut bytes = text.as_bytes().to_vec();
    let mut at = 0;
    while at < text.len() {
        let rest = &text[at..];
        let end = if rest.starts_with("//") {
            rest.find([
                '\n', '\r', '\u{b}', '\u{c}', '\u{85}', '\u{2028}', '\u{2029}',
            ])
            .unwrap_or(rest.len())
        } else if rest.starts_with("/*") {
            end_of_comment(rest)
        } else {
            at += rest.find('/').map_or(rest.len(), |n| n.max(1));
            continue;
        };
        bytes[at..at + end].fill(b' ');
        at += end;
    }
    String::from_utf8(bytes).unwrap_or_default()
}

fn end_of_comment(text: &str) -> usize {
    let (mut depth, mut at) = (0_usize, 0);
    while let Some(n) = text[at..].find(['/', '*']) {
        at += n;
        match &text.as_bytes()[at..(at + 2).min(text.len())] {
            b"/*" => depth += 1,
            b"*/" => depth -= 1,
            _ => {
                at += 1;
                continue;
            }
        }
        at += 2;
        if depth == 0 {
            return at;
        }
    }
    text.len()
}

/// For each raw token, which bracket of a template it is.
fn templates(text: &str, raw: &[(TokenKind, Range<usize>)]) -> Vec<Option<Kind>> {
    let mut out = vec![None; raw.len()];
    let mut pending: Vec<(usize, usize)> = Vec::new();
    let mut depth = 0;
    let sign = |n: usize| raw.get(n).map_or("", |(_, r)| &text[r.clone()]);
    // The sign behind, with nothing in between.
    let joined = |n: usize| match (raw.get(n), raw.get(n + 1)) {
        (Some((_, a)), Some((_, b))) if a.end == b.start => &text[b.clone()],
        _ => "",
    };
    let mut n = 0;
    while n < raw.len() {
        match sign(n) {
            "<" if n > 0 && raw[n - 1].0 == TokenKind::Word => match joined(n) {
                "<" | "=" => n += 1,
                _ => pending.push((n, depth)),
            },
            ">" => match pending.last() {
                Some((open, of)) if *of == depth => {
                    (out[*open], out[n]) = (Some(Kind::Open), Some(Kind::Close));
                    pending.pop();
                }
                _ if joined(n) == "=" => n += 1,
                _ => {}
            },
            "(" | "[" => depth += 1,
            ")" | "]" => {
                pending.retain(|(_, of)| *of < depth);
                depth = depth.saturating_sub(1);
            }
            "!" if joined(n) == "=" => n += 1,
            "=" if joined(n) == "=" => n += 1,
            "=" | ";" | "{" | ":" => {
                pending.clear();
                depth = 0;
            }
            one @ ("&" | "|") if joined(n) == one => {
                pending.retain(|(_, of)| *of < depth);
                n += 1;
            }
            _ => {}
        }
        n += 1;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn templates_are_told_from_comparisons() {
        let words = |text: &str| -> String {
            let shown = |t: &Token<'_>| match t.kind {
                Kind::Open => "(:".to_owned(),
                Kind::Close => ":)".to_owned(),
                _ => t.text.to_owned(),
            };
            tokens(text).iter().map(shown).collect::<Vec<_>>().join(" ")
        };
        for (text, seen) in [
            ("array<vec2<f32>,2>()", "array (: vec2 (: f32 :) , 2 :) ( )"),
            ("a < b && c > d", "a < b && c > d"),
            ("a<b,c>(d)", "a (: b , c :) ( d )"),
            ("let z: vec2<i32>= x >>1", "let z : vec2 (: i32 :) = x >> 1"),
            ("a >>= 1; b<=c", "a >>= 1 ; b <= c"),
            ("f(a<b)>c", "f ( a < b ) > c"),
            ("x /* > /* */ ^ */ ^ y // &\n& z", "x ^ y & z"),
        ] {
            assert_eq!(words(text), seen);
        }
    }
}
