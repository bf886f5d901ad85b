//! Macros that `glsl-lang`'s preprocessor leaves unexpanded, written so that it expands them: one within its own arguments (`twice(twice(x))`), and one that stands for another's name
//! (`#define A B`, called as `A(x)`).
//!
//! The C preprocessor, which GLSL's is, expands an argument before it is put in, and looks for calls in what a macro comes to *together with* the text behind it (C11 6.10.3.1 and
//! 6.10.3.4). That one does neither. So a call within its own arguments gets a macro of its own, `twice_within1`, which is defined where the other is; and what stands for another macro's
//! name gets that one's parameters. [`Rewritten::back`] finds the author's place again.

use std::borrow::Cow;
use std::collections::HashMap;
use std::ops::Range;

/// How the macros of a text and of what it includes call one another.
#[derive(Debug, Default)]
pub(super) struct Macros {
    /// The parameters in their brackets of each macro that has some.
    functions: HashMap<String, String>,
    /// Macros that stand for another one's name.
    aliases: HashMap<String, String>,
    /// How many times each is found within its own arguments at most; aliases count as what they stand for.
    depths: HashMap<String, usize>,
    /// Ends the names of macros made here, with a number.
    mark: String,
}

/// A text with other macros.
#[derive(Clone, Debug, Default)]
pub(super) struct Rewritten {
    pub text: String,
    /// Where each piece begins in `text`, where it is from in the old one, and whether it is copied.
    pieces: Vec<(usize, usize, bool)>,
}

impl Rewritten {
    /// The place in the old text.
    pub(super) fn back(&self, at: u32) -> u32 {
        let at = at as usize;
        let next = self.pieces.partition_point(|(new, ..)| *new <= at);
        match next.checked_sub(1).and_then(|i| self.pieces.get(i)) {
            Some((new, old, true)) => (old + at - new) as u32,
            Some((_, old, false)) => *old as u32,
            None => at as u32,
        }
    }
}

impl Macros {
    /// Those of texts that make one stage.
    pub(super) fn of(texts: &[Cow<'_, str>]) -> Self {
        let mut out = Self {
            mark: "_within".to_owned(),
            ..Self::default()
        };
        // Most texts call no macro in another's arguments, and few have any.
        if texts.iter().all(|t| !t.contains("define")) {
            return out;
        }
        while texts.iter().any(|t| t.contains(&out.mark)) {
            out.mark.push('x');
        }
        let scanned: Vec<Vec<Token>> = texts.iter().map(|t| tokens(t)).collect();
        let mut objects = Vec::new();
        for (text, tokens) in texts.iter().zip(&scanned) {
            for at in hashes(tokens) {
                match Directive::at(text, tokens, at) {
                    Directive::Function {
                        name, parameters, ..
                    } => {
                        let parameters = text[parameters].to_owned();
                        out.functions
                            .entry(text[name].to_owned())
                            .or_insert(parameters);
                    }
                    Directive::Object {
                        name,
                        only: Some(only),
                    } => {
                        objects.push((text[name].to_owned(), text[only].to_owned()));
                    }
                    _ => {}
                }
            }
        }
        for (name, of) in objects {
            if out.functions.contains_key(&of) && !out.functions.contains_key(&name) {
                out.aliases.insert(name, of);
            }
        }
        for (text, tokens) in texts.iter().zip(&scanned) {
            let mut depths = std::mem::take(&mut out.depths);
            out.nested(text, tokens, |name, depth, _| {
                let deepest = depths.entry(name.to_owned()).or_default();
                *deepest = depth.max(*deepest);
            });
            out.depths = depths;
        }
        out
    }

    /// The text to be preprocessed in place of `text`; `None`: that is fine as it is.
    pub(super) fn rewrite(&self, text: &str) -> Option<Rewritten> {
        if self.aliases.is_empty() && self.depths.is_empty() {
            return None;
        }
        let tokens = tokens(text);
        let mut edits: Vec<(Range<usize>, String)> = Vec::new();
        self.nested(text, &tokens, |_, depth, name| {
            edits.push((name.end..name.end, self.suffix(depth)));
        });
        for at in hashes(&tokens) {
            let end = line_end(&tokens, at);
            match Directive::at(text, &tokens, at) {
                Directive::Function {
                    name, parameters, ..
                } => {
                    let body = text[parameters.start..end].to_owned();
                    let inner: Vec<_> = edits
                        .iter()
                        .filter(|(r, _)| (parameters.start..end).contains(&r.start))
                        .map(|(r, new)| {
                            (
                                r.start - parameters.start..r.end - parameters.start,
                                new.clone(),
                            )
                        })
                        .collect();
                    let body = apply(&body, inner).text;
                    let name = &text[name];
                    let more = self.copies(name, |k| {
                        format!("\n#define {name}{}{body}", self.suffix(k))
                    });
                    edits.push((end..end, more));
                }
                Directive::Object {
                    name,
                    only: Some(only),
                } => {
                    let (called, of) = (&text[name.clone()], &text[only.clone()]);
                    if self.aliases.get(called).is_none_or(|a| a != of) {
                        continue;
                    }
                    let parameters = self.functions.get(of).map_or("", String::as_str);
                    edits.push((name.end..name.end, parameters.to_owned()));
                    edits.push((only.end..only.end, parameters.to_owned()));
                    let more = self.copies(of, |k| {
                        let own = self.suffix(k);
                        format!("\n#define {called}{own}{parameters} {of}{own}{parameters}")
                    });
                    edits.push((end..end, more));
                }
                Directive::Undefine { name } => {
                    let name = &text[name];
                    let of = self.root(name);
                    let more = self.copies(of, |k| format!("\n#undef {name}{}", self.suffix(k)));
                    edits.push((end..end, more));
                }
                _ => {}
            }
        }
        edits.retain(|(_, new)| !new.is_empty());
        (!edits.is_empty()).then(|| apply(text, edits))
    }

    fn suffix(&self, depth: usize) -> String {
        format!("{}{depth}", self.mark)
    }

    /// What `one` says for each depth of a macro.
    fn copies(&self, name: &str, one: impl Fn(usize) -> String) -> String {
        let depth = self.depths.get(name).copied().unwrap_or(0);
        (1..=depth).map(one).collect()
    }

    fn root<'a>(&'a self, name: &'a str) -> &'a str {
        self.aliases.get(name).map_or(name, String::as_str)
    }

    /// Tells of each call within the same macro's arguments: what it calls, how deep it stands there, and where its name is.
    fn nested(
        &self,
        text: &str,
        tokens: &[Token],
        mut tell: impl FnMut(&str, usize, Range<usize>),
    ) {
        // What each open bracket is of, in the text and in a directive within it.
        let mut open: Vec<&str> = Vec::new();
        let mut outside = Vec::new();
        let mut callee = "";
        let mut i = 0;
        while let Some(token) = tokens.get(i) {
            i += 1;
            let was = std::mem::take(&mut callee);
            match token.kind {
                Kind::Hash => {
                    outside = std::mem::take(&mut open);
                    i = Directive::at(text, tokens, i - 1).body(tokens, i);
                }
                Kind::LineEnd => open = std::mem::take(&mut outside),
                Kind::Open => open.push(was),
                Kind::Close => drop(open.pop()),
                Kind::Word => {
                    let word = &text[token.range.clone()];
                    let is_call = tokens.get(i).is_some_and(|t| t.kind == Kind::Open);
                    let known =
                        self.functions.contains_key(word) || self.aliases.contains_key(word);
                    if !is_call || !known {
                        continue;
                    }
                    callee = self.root(word);
                    let depth = open.iter().filter(|o| **o == callee).count();
                    if depth > 0 {
                        tell(callee, depth, token.range.clone());
                    }
                }
                Kind::Other => {}
            }
        }
    }
}

/// The edits, none of which overlap, made in `text`.
fn apply(text: &str, mut edits: Vec<(Range<usize>, String)>) -> Rewritten {
    edits.sort_by_key(|(range, _)| range.start);
    let mut out = Rewritten::default();
    let mut copied = 0;
    for (range, new) in edits {
        out.pieces.push((out.text.len(), copied, true));
        out.text.push_str(&text[copied..range.start]);
        out.pieces.push((out.text.len(), range.start, false));
        out.text.push_str(&new);
        copied = range.end;
    }
    out.pieces.push((out.text.len(), copied, true));
    out.text.push_str(&text[copied..]);
    out
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Word,
    Open,
    Close,
    /// A `#` that begins a directive.
    Hash,
    /// The end of a directive, which has no length.
    LineEnd,
    Other,
}

#[derive(Clone, Debug)]
struct Token {
    kind: Kind,
    range: Range<usize>,
}

/// The text's tokens but for comments; lines that a backslash continues are one.
fn tokens(text: &str) -> Vec<Token> {
    let bytes = text.as_bytes();
    let is_word = |b: &u8| b.is_ascii_alphanumeric() || *b == b'_';
    let mut out: Vec<Token> = Vec::new();
    let (mut at, mut begins_line, mut directive) = (0, true, false);
    while let Some(byte) = bytes.get(at) {
        let rest = &bytes[at..];
        let length = match byte {
            b'\n' => {
                if std::mem::take(&mut directive) {
                    out.push(Token {
                        kind: Kind::LineEnd,
                        range: at..at,
                    });
                }
                begins_line = true;
                at += 1;
                continue;
            }
            b'\\' if rest.starts_with(b"\\\n") => 2,
            b'\\' if rest.starts_with(b"\\\r\n") => 3,
            b'/' if rest.starts_with(b"//") => {
                rest.iter().position(|b| *b == b'\n').unwrap_or(rest.len())
            }
            b'/' if rest.starts_with(b"/*") => {
                text[at + 2..].find("*/").map_or(rest.len(), |n| n + 4)
            }
            b if b.is_ascii_whitespace() => 1,
            _ => 0,
        };
        if length > 0 {
            at += length;
            continue;
        }
        let (kind, length) = match byte {
            b'#' if begins_line => {
                directive = true;
                (Kind::Hash, 1)
            }
            b'(' => (Kind::Open, 1),
            b')' => (Kind::Close, 1),
            b if is_word(b) => (Kind::Word, rest.iter().take_while(|b| is_word(b)).count()),
            _ => (Kind::Other, 1),
        };
        begins_line = false;
        out.push(Token {
            kind,
            range: at..at + length,
        });
        at += length;
    }
    if directive {
        out.push(Token {
            kind: Kind::LineEnd,
            range: text.len()..text.len(),
        });
    }
    out
}

/// The tokens that begin directives.
fn hashes(tokens: &[Token]) -> impl Iterator<Item = usize> + '_ {
    let all = tokens.iter().enumerate();
    all.filter(|(_, t)| t.kind == Kind::Hash).map(|(i, _)| i)
}

/// Where the directive that begins at a token ends, in the text.
fn line_end(tokens: &[Token], hash: usize) -> usize {
    let mut rest = tokens.iter().skip(hash);
    rest.find(|t| t.kind == Kind::LineEnd)
        .map_or(0, |t| t.range.start)
}

enum Directive {
    /// A macro with parameters, which `parameters` is with their brackets.
    Function {
        name: Range<usize>,
        parameters: Range<usize>,
        /// The first token of the body.
        body: usize,
    },
    /// A macro without; `only` is what it stands for, if that is one word.
    Object {
        name: Range<usize>,
        only: Option<Range<usize>>,
    },
    Undefine {
        name: Range<usize>,
    },
    Other,
}

impl Directive {
    fn at(text: &str, tokens: &[Token], hash: usize) -> Self {
        let token = |i: usize| tokens.get(hash + i);
        let kind = |i: usize| token(i).map(|t| t.kind);
        let word = |i: usize| {
            let token = token(i).filter(|t| t.kind == Kind::Word);
            token.map(|t| t.range.clone())
        };
        let said = word(1).map(|r| &text[r]);
        let Some(name) = word(2) else {
            return Self::Other;
        };
        match said {
            Some("undef") => Self::Undefine { name },
            Some("define") => match token(3) {
                Some(open) if open.kind == Kind::Open && open.range.start == name.end => {
                    let rest = tokens.iter().enumerate().skip(hash + 3);
                    let mut rest = rest.take_while(|(_, t)| t.kind != Kind::LineEnd);
                    match rest.find(|(_, t)| t.kind == Kind::Close) {
                        Some((close, token)) => Self::Function {
                            parameters: open.range.start..token.range.end,
                            body: close + 1,
                            name,
                        },
                        None => Self::Other,
                    }
                }
                _ => Self::Object {
                    only: word(3).filter(|_| kind(4) == Some(Kind::LineEnd)),
                    name,
                },
            },
            _ => Self::Other,
        }
    }

    /// The token from which on macros may be called; `next` is the one behind the `#`.
    fn body(&self, tokens: &[Token], next: usize) -> usize {
        match self {
            Self::Function { body, .. } => *body,
            Self::Object { .. } => (next + 2).min(tokens.len()),
            _ => next,
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn rewritten(text: &str) -> Option<String> {
        let macros = Macros::of(&[Cow::Borrowed(text)]);
        macros.rewrite(text).map(|r| r.text)
    }

    #[test]
    fn a_macro_in_its_own_arguments_has_one_of_its_own() {
        let text = "#define twice(x) ((x) * 2.0)\nfloat a = twice(1.0 + twice(twice(2.0)));\n";
        let expected = "#define twice(x) ((x) * 2.0)\n\
                        #define twice_within1(x) ((x) * 2.0)\n\
                        #define twice_within2(x) ((x) * 2.0)\n\
                        float a = twice(1.0 + twice_within1(twice_within2(2.0)));\n";
        assert_eq!(rewritten(text).unwrap(), expected);
    }

    #[test]
    fn what_stands_for_a_macro_has_its_parameters() {
        let text =
            "#define M four // short\n#define four(a, b) vec2(a, b)\nvec2 v = M(1.0, 2.0);\n";
        let expected = "#define M(a, b) four(a, b) // short\n#define four(a, b) vec2(a, b)\nvec2 v = M(1.0, 2.0);\n";
        assert_eq!(rewritten(text).unwrap(), expected);
    }

    #[test]
    fn bodies_comments_and_continued_lines_are_seen_through() {
        let text =
            "#define sq(x) \\\n  ((x) * (x))\n#define fourth(x) sq(/* sq( */ sq(x))\n#undef sq\n";
        let expected = "#define sq(x) \\\n  ((x) * (x))\n#define sq_within1(x) \\\n  ((x) * (x))\n\
                        #define fourth(x) sq(/* sq( */ sq_within1(x))\n#undef sq\n#undef sq_within1\n";
        assert_eq!(rewritten(text).unwrap(), expected);
    }

    #[test]
    fn what_is_expanded_anyway_stays() {
        assert_eq!(
            rewritten("#define f(x) f(x)\nfloat a = f(1.0) + f(2.0);\n"),
            None
        );
        assert_eq!(rewritten("#define N 3\n#define M N\nint a = M;\n"), None);
        assert_eq!(rewritten("float f(float x);\nfloat a = f(f(1.0));\n"), None);
    }

    #[test]
    fn places_are_found_again() {
        let text = "#define f(x) (x)\nfloat a = f(f(here));\n";
        let new = Macros::of(&[Cow::Borrowed(text)]).rewrite(text).unwrap();
        let place = new.text.find("here").unwrap() as u32;
        assert_eq!(new.back(place) as usize, text.find("here").unwrap());
        assert_eq!(new.back(3), 3);
        // What is added belongs to where it is added.
        let added = new.text.find("#define f_").unwrap() as u32;
        assert_eq!(new.back(added) as usize, text.find('\n').unwrap());
    }
}
