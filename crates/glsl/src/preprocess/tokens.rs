//! Splits text into preprocessing tokens. Comments become spaces and continued lines are joined
//! (GLSL 4.60, 3.1 and 3.2).

use std::borrow::Cow;
use std::collections::HashMap;
use std::rc::Rc;

/// The kind of a token.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in super::super) enum TokenKind {
    Word,
    /// Any token that begins like a number.
    Number,
    /// A string with its quotes.
    Quoted,
    Other,
    /// The end of a line.
    Line,
}

/// A token with its source.
#[derive(Clone, Debug)]
pub(in super::super) struct Token {
    pub kind: TokenKind,
    /// The token's text, as an index into [`Names`].
    pub name: u32,
    /// Byte range in the source map.
    pub start: u32,
    pub end: u32,
    /// Whether it is the first token of its line.
    pub begins_line: bool,
    /// The hide set: macros that may not expand it.
    pub hidden: Option<Rc<[u32]>>,
}

impl Token {
    pub(super) fn is_hidden_from(&self, name: u32) -> bool {
        self.hidden.as_ref().is_some_and(|h| h.contains(&name))
    }
}

/// Token texts by index.
#[derive(Debug, Default)]
pub(in super::super) struct Names {
    numbers: HashMap<Rc<str>, u32>,
    texts: Vec<Rc<str>>,
}

impl Names {
    pub(super) fn number(&mut self, text: &str) -> u32 {
        if let Some(known) = self.numbers.get(text) {
            return *known;
        }
        let shared: Rc<str> = Rc::from(text);
        let number = self.texts.len() as u32;
        self.texts.push(Rc::clone(&shared));
        self.numbers.insert(shared, number);
        number
    }

    pub(super) fn text(&self, number: u32) -> Rc<str> {
        let text = self.texts.get(number as usize);
        text.cloned().unwrap_or_else(|| Rc::from(""))
    }
}

/// A text after joining continued lines.
pub(super) struct Joined<'a> {
    pub text: Cow<'a, str>,
    /// Removed bytes: the position in the new text, and the total up to there.
    cuts: Vec<(usize, usize)>,
}

impl<'a> Joined<'a> {
    pub(super) fn of(text: &'a str) -> Self {
        if !text.contains("\\\n") && !text.contains("\\\r\n") {
            return Self {
                text: Cow::Borrowed(text),
                cuts: Vec::new(),
            };
        }
        let mut out = String::with_capacity(text.len());
        let (mut cuts, mut taken, mut rest) = (Vec::new(), 0, text);
        while let Some(at) = rest.find('\\') {
            let after = &rest[at + 1..];
            let end = match after {
                a if a.starts_with('\n') => 1,
                a if a.starts_with("\r\n") => 2,
                _ => 0,
            };
            out.push_str(&rest[..at]);
            match end {
                0 => out.push('\\'),
                _ => {
                    taken += 1 + end;
                    cuts.push((out.len(), taken));
                }
            }
            rest = &after[end..];
        }
        out.push_str(rest);
        Self {
            text: Cow::Owned(out),
            cuts,
        }
    }

    /// The position in the original text.
    fn back(&self, at: usize) -> usize {
        let next = self.cuts.partition_point(|(new, _)| *new <= at);
        let taken = next.checked_sub(1).and_then(|i| self.cuts.get(i));
        at + taken.map_or(0, |(_, taken)| *taken)
    }
}

/// Operators of several characters, longest first.
const OPERATORS: [&str; 24] = [
    "<<=", ">>=", "<<", ">>", "<=", ">=", "==", "!=", "&&", "||", "^^", "++", "--", "+=", "-=",
    "*=", "/=", "%=", "&=", "|=", "^=", "##", "::", "->",
];

/// Splits a text. The error is the position of an unclosed comment.
pub(super) fn tokens(joined: &Joined<'_>, base: u32, names: &mut Names) -> Result<Vec<Token>, u32> {
    let text: &str = &joined.text;
    let bytes = text.as_bytes();
    let place = |at: usize| base + joined.back(at) as u32;
    let is_word = |b: &u8| b.is_ascii_alphanumeric() || *b == b'_';
    let mut out = Vec::with_capacity(text.len() / 4);
    let (mut at, mut begins_line) = (0, true);
    while let Some(byte) = bytes.get(at) {
        let rest = &text[at..];
        let (kind, length) = match byte {
            b'\n' => (TokenKind::Line, 1),
            b if b.is_ascii_whitespace() => {
                at += 1;
                continue;
            }
            b'/' if rest.starts_with("//") => {
                at += rest.find('\n').unwrap_or(rest.len());
                continue;
            }
            b'/' if rest.starts_with("/*") => {
                let length = rest[2..].find("*/").ok_or_else(|| place(at))?;
                at += length + 4;
                continue;
            }
            b'"' => {
                let line = rest[1..].find(['"', '\n']);
                match line.filter(|end| rest[1 + end..].starts_with('"')) {
                    Some(end) => (TokenKind::Quoted, end + 2),
                    None => (TokenKind::Other, 1),
                }
            }
            b if b.is_ascii_digit() => (TokenKind::Number, number(rest)),
            b'.' if bytes.get(at + 1).is_some_and(u8::is_ascii_digit) => {
                (TokenKind::Number, number(rest))
            }
            b if is_word(b) => (
                TokenKind::Word,
                bytes[at..].iter().take_while(|b| is_word(b)).count(),
            ),
            _ => {
                let long = OPERATORS.iter().find(|o| rest.starts_with(**o));
                let one = || rest.chars().next().map_or(1, char::len_utf8);
                (TokenKind::Other, long.map_or_else(one, |o| o.len()))
            }
        };
        out.push(Token {
            kind,
            name: names.number(&text[at..at + length]),
            start: place(at),
            end: place(at + length - 1) + 1,
            begins_line,
            hidden: None,
        });
        begins_line = kind == TokenKind::Line;
        at += length;
    }
    out.push(Token {
        kind: TokenKind::Line,
        name: names.number("\n"),
        start: place(text.len()),
        end: place(text.len()),
        begins_line,
        hidden: None,
    });
    Ok(out)
}

/// The length of the number at the start of `text`: digits, letters, points, and exponent signs.
fn number(text: &str) -> usize {
    let is_hex = text.starts_with("0x") || text.starts_with("0X");
    let mut before = 0;
    for (i, b) in text.bytes().enumerate() {
        let exponent = matches!(before, b'e' | b'E') && !is_hex && matches!(b, b'+' | b'-');
        if !(b.is_ascii_alphanumeric() || b == b'_' || b == b'.' || exponent) {
            return i;
        }
        before = b;
    }
    text.len()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn comments_are_spaces_and_continued_lines_are_one() {
        let text = "#def\\\nine A /* x\n */ 1e-3-2 // b \\\n c\n\"q r\" <<=0x1e+1\n";
        let joined = Joined::of(text);
        let mut names = Names::default();
        let all = tokens(&joined, 100, &mut names).unwrap();
        let texts: Vec<String> = all.iter().map(|t| names.text(t.name).to_string()).collect();
        let expected = [
            "#", "define", "A", "1e-3", "-", "2", "\n", "\"q r\"", "<<=", "0x1e", "+", "1", "\n",
            "\n",
        ];
        assert_eq!(texts, expected);
        assert_eq!((all[1].start, all[1].end), (101, 109));
        let a = text.find('A').unwrap() as u32;
        assert_eq!(all[2].start, 100 + a);
        assert!(tokens(&Joined::of("a /* b"), 0, &mut names).is_err());
    }
}
