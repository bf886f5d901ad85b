//! Evaluates `#if` and `#elif` (GLSL 4.60, 3.3; ES 3.20, 3.4).

/// A token of a condition.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Word {
    Number(i64),
    /// An undefined name, with its index.
    Undefined(usize),
    Operator(String),
}

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Wrong {
    /// A missing or misplaced token, with its index.
    Malformed(Option<usize>),
    /// An undefined name where that is an error.
    Undefined(usize),
    DivisionByZero,
    TooDeep,
}

/// Maximum nesting of brackets and signs.
const DEPTH: usize = 200;

/// Evaluates a condition. `strict`: an undefined name is an error, as in GLSL ES.
pub(super) fn evaluate(words: &[Word], strict: bool) -> Result<i64, Wrong> {
    let mut parser = Parser {
        words,
        at: 0,
        strict,
        depth: 0,
    };
    let value = parser.binary(0, true)?;
    match parser.at == words.len() {
        true => Ok(value),
        false => Err(Wrong::Malformed(Some(parser.at))),
    }
}

struct Parser<'a> {
    words: &'a [Word],
    at: usize,
    strict: bool,
    depth: usize,
}

/// Operator precedence.
fn power(operator: &str) -> Option<u8> {
    Some(match operator {
        "||" => 1,
        "&&" => 2,
        "|" => 3,
        "^" => 4,
        "&" => 5,
        "==" | "!=" => 6,
        "<" | ">" | "<=" | ">=" => 7,
        "<<" | ">>" => 8,
        "+" | "-" => 9,
        "*" | "/" | "%" => 10,
        _ => return None,
    })
}

impl Parser<'_> {
    /// `live` is false for the unused side of `&&` and `||`.
    fn binary(&mut self, least: u8, live: bool) -> Result<i64, Wrong> {
        self.depth += 1;
        if self.depth > DEPTH {
            return Err(Wrong::TooDeep);
        }
        let mut left = self.unary(live)?;
        while let Some(Word::Operator(operator)) = self.words.get(self.at) {
            let Some(power) = power(operator).filter(|p| *p > least) else {
                break;
            };
            self.at += 1;
            let decides = match operator.as_str() {
                "&&" => left != 0,
                "||" => left == 0,
                _ => true,
            };
            let right = self.binary(power, live && decides)?;
            left = match operator.as_str() {
                "||" => i64::from(left != 0 || right != 0),
                "&&" => i64::from(left != 0 && right != 0),
                "|" => left | right,
                "^" => left ^ right,
                "&" => left & right,
                "==" => i64::from(left == right),
                "!=" => i64::from(left != right),
                "<" => i64::from(left < right),
                ">" => i64::from(left > right),
                "<=" => i64::from(left <= right),
                ">=" => i64::from(left >= right),
                "<<" => left.wrapping_shl(right as u32),
                ">>" => left.wrapping_shr(right as u32),
                "+" => left.wrapping_add(right),
                "-" => left.wrapping_sub(right),
                "*" => left.wrapping_mul(right),
                _ if right == 0 && live => return Err(Wrong::DivisionByZero),
                _ if right == 0 => 0,
                "/" => left.wrapping_div(right),
                _ => left.wrapping_rem(right),
            };
        }
        self.depth -= 1;
        Ok(left)
    }

    fn unary(&mut self, live: bool) -> Result<i64, Wrong> {
        let word = self.words.get(self.at).ok_or(Wrong::Malformed(None))?;
        let at = self.at;
        self.at += 1;
        match word {
            Word::Number(n) => Ok(*n),
            Word::Undefined(at) if self.strict && live => Err(Wrong::Undefined(*at)),
            Word::Undefined(_) => Ok(0),
            Word::Operator(operator) => {
                if operator == "(" {
                    let value = self.binary(0, live)?;
                    return match self.words.get(self.at) {
                        Some(Word::Operator(close)) if close == ")" => {
                            self.at += 1;
                            Ok(value)
                        }
                        _ => Err(Wrong::Malformed(Some(self.at))),
                    };
                }
                if !["+", "-", "!", "~"].contains(&operator.as_str()) {
                    return Err(Wrong::Malformed(Some(at)));
                }
                self.depth += 1;
                if self.depth > DEPTH {
                    return Err(Wrong::TooDeep);
                }
                let value = self.unary(live)?;
                self.depth -= 1;
                Ok(match operator.as_str() {
                    "-" => value.wrapping_neg(),
                    "!" => i64::from(value == 0),
                    "~" => !value,
                    _ => value,
                })
            }
        }
    }
}

/// Parses a decimal, octal or hexadecimal integer with an optional `u`.
pub(super) fn integer(text: &str) -> Option<i64> {
    let digits = text.strip_suffix(['u', 'U']).unwrap_or(text);
    let parsed = match digits.strip_prefix("0x").or(digits.strip_prefix("0X")) {
        Some(hex) => i64::from_str_radix(hex, 16),
        None if digits.len() > 1 && digits.starts_with('0') => i64::from_str_radix(digits, 8),
        None => digits.parse(),
    };
    parsed.ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(text: &str) -> Vec<Word> {
        let all = text.split_whitespace().enumerate();
        all.map(|(i, w)| match integer(w) {
            Some(n) => Word::Number(n),
            None if w.starts_with(char::is_alphabetic) => Word::Undefined(i),
            None => Word::Operator(w.to_owned()),
        })
        .collect()
    }

    #[test]
    fn operators_bind_as_in_c() {
        for (text, value) in [
            ("1 + 2 * 3", 7),
            ("( 1 + 2 ) * 3", 9),
            ("7 - 2 - 1", 4),
            ("1 << 2 + 1", 8),
            ("5 & 3 == 3", 1),
            ("- 3 / 2", -1),
            ("! 0 && ~ 0 == - 1", 1),
            ("010 + 0x10 + 1u", 25),
            ("2 > 1 || 1 / 0", 1),
            ("0 && 1 % 0", 0),
        ] {
            assert_eq!(evaluate(&words(text), true), Ok(value), "{text}");
        }
        assert_eq!(evaluate(&words("1 / 0"), false), Err(Wrong::DivisionByZero));
        assert_eq!(
            evaluate(&words("1 2"), false),
            Err(Wrong::Malformed(Some(1)))
        );
        assert_eq!(
            evaluate(&words("( 1"), false),
            Err(Wrong::Malformed(Some(2)))
        );
        assert_eq!(evaluate(&words(""), false), Err(Wrong::Malformed(None)));
        let deep = "( ".repeat(1000);
        assert_eq!(evaluate(&words(&deep), false), Err(Wrong::TooDeep));
    }

    #[test]
    fn a_name_that_is_not_defined_is_0_on_the_desktop_alone() {
        assert_eq!(evaluate(&words("A == 0"), false), Ok(1));
        assert_eq!(evaluate(&words("A == 0"), true), Err(Wrong::Undefined(0)));
        assert_eq!(evaluate(&words("0 && A"), true), Ok(0));
        assert_eq!(evaluate(&words("1 || A > 2"), true), Ok(1));
        assert_eq!(evaluate(&words("1 && A"), true), Err(Wrong::Undefined(2)));
    }
}
