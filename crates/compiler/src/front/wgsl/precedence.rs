//! Operators that WGSL's grammar (8.19) does not mix without parentheses. naga gives them C's
//! precedence, so that it takes texts that every browser refuses.

use naga::Span;

use super::tokens::{Kind, Token};
use shader_text::error::{Code, Error};

/// Words that no operand ends with.
const KEYWORDS: [&str; 12] = [
    "return",
    "if",
    "else",
    "while",
    "for",
    "switch",
    "case",
    "default",
    "loop",
    "break",
    "continuing",
    "const_assert",
];

/// The operators so far of one expression, outside of inner brackets.
#[derive(Clone, Default)]
struct Before<'t> {
    any: Option<&'t str>,
    bits: Option<&'t str>,
    logic: Option<&'t str>,
    /// Since the last `&&` or `||`.
    comparison: Option<&'t str>,
    /// Since the last comparison, too.
    shift: Option<&'t str>,
    arithmetic: Option<&'t str>,
}

impl<'t> Before<'t> {
    /// Adds an operator, or returns an earlier one that needs parentheses.
    fn add(&mut self, sign: &'t str) -> Result<(), &'t str> {
        let different = |earlier: Option<&'t str>| earlier.filter(|e| *e != sign);
        let clash = match sign {
            "&" | "|" | "^" => different(self.any),
            "&&" | "||" => self.bits.or(different(self.logic)),
            "<<" | ">>" => self.bits.or(self.shift).or(self.arithmetic),
            "*" | "/" | "%" | "+" | "-" => self.bits.or(self.shift),
            _ => self.bits.or(self.comparison),
        };
        if let Some(earlier) = clash {
            return Err(earlier);
        }
        let before = std::mem::take(self);
        *self = match sign {
            "&" | "|" | "^" => Self {
                bits: Some(sign),
                ..before
            },
            "&&" | "||" => Self {
                logic: Some(sign),
                ..Self::default()
            },
            "<<" | ">>" => Self {
                shift: Some(sign),
                ..before
            },
            "*" | "/" | "%" | "+" | "-" => Self {
                arithmetic: Some(sign),
                ..before
            },
            _ => Self {
                comparison: Some(sign),
                logic: before.logic,
                ..Self::default()
            },
        };
        self.any = Some(sign);
        Ok(())
    }
}

/// Finds the first operator that needs parentheses because of an earlier one.
pub(super) fn check(tokens: &[Token<'_>], base: u32) -> Result<(), Error> {
    // Outermost first.
    let mut open = vec![Before::default()];
    let mut is_behind_operand = false;
    for token in tokens {
        let is_operand = match token.kind {
            Kind::Word => !KEYWORDS.contains(&token.text),
            Kind::Number | Kind::Close => true,
            Kind::Open => false,
            Kind::Sign => matches!(token.text, ")" | "]" | "++" | "--"),
        };
        match (token.kind, token.text) {
            (Kind::Open, _) | (_, "(" | "[" | "{") => {
                if token.text == "{" {
                    open.pop();
                    open.push(Before::default());
                }
                open.push(Before::default());
            }
            (Kind::Close, _) | (_, ")" | "]" | "}") => {
                open.truncate((open.len() - 1).max(1));
            }
            (
                _,
                "*" | "/" | "%" | "+" | "-" | "&" | "|" | "^" | "<<" | ">>" | "&&" | "||" | "<"
                | ">" | "<=" | ">=" | "==" | "!=",
            ) => {
                let before = open.last_mut().filter(|_| is_behind_operand);
                let Some(Err(earlier)) = before.map(|b| b.add(token.text)) else {
                    is_behind_operand = false;
                    continue;
                };
                let message = format!("`{earlier}` and `{}` need parentheses", token.text);
                let start = base + token.at as u32;
                return Err(Error::new(Code::Parse, message)
                    .label(Span::new(start, start + token.text.len() as u32), "")
                    .note(
                        "WGSL gives neither of the two precedence, so no browser takes the text",
                    ));
            }
            (Kind::Sign, "." | "!" | "~") => {}
            (Kind::Sign, _) | (Kind::Word, _) if !is_operand => {
                open.pop();
                open.push(Before::default());
            }
            _ => {}
        }
        is_behind_operand = is_operand;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::tokens::tokens;
    use super::*;

    #[test]
    fn only_what_the_grammar_refuses_is_refused() {
        for (text, refused) in [
            ("a + b * c - d % e", None),
            ("a + b ^ c", Some("^")),
            ("a ^ b + c", Some("+")),
            ("a & b & c", None),
            ("a & b | c", Some("|")),
            ("a && b || c", Some("||")),
            ("a || b && c", Some("&&")),
            ("a && b && c == d", None),
            ("a == b && c == d || e", Some("||")),
            ("a < b == c", Some("==")),
            ("a < b && c < d", None),
            ("a << b < c << d", None),
            ("a << b + c", Some("+")),
            ("a + b << c", Some("<<")),
            ("a < b + c << d", Some("<<")),
            ("a + b < c << d", None),
            ("a << b << c", Some("<<")),
            ("a & b == c", Some("==")),
            ("a == b & c", Some("&")),
            ("a && b & c", Some("&")),
            ("(a + b) ^ c", None),
            ("a[b + c] ^ d", None),
            ("f(a + b, c ^ d)", None),
            ("f(&a) ^ b", None),
            ("a ^ -b", None),
            ("a = b + c; d ^= e + f", None),
            ("x = a + b; y = c ^ d", None),
            ("if a + b < c { d = e ^ f; }", None),
            ("array<i32, a + b>() ^ c", None),
            ("for (i = a + b; c ^ d < e; i++) {}", Some("<")),
            ("switch a + b { case c: { d = e ^ f; } }", None),
            ("let p = &a; let q = *p ^ b", None),
            ("i++; a ^ b", None),
        ] {
            let found = check(&tokens(text), 0).err().map(|e| {
                let range = e.labels()[0].span.to_range().unwrap_or_default();
                &text[range]
            });
            assert_eq!(found, refused, "{text}");
        }
    }
}
