//! Texts that the preprocessor comes to the end of: behind a `##` that it parses it waits for the end of the line, and where there is none it waits for ever.

use std::borrow::Cow;

use glsl_lang_pp::lexer::{Lexer, Token};

/// What is said of a text that cannot be ended.
pub(super) const UNENDED: &str = "a comment or a string behind `##` is not closed";

/// The text with its last line ended, where something is pasted in it; `None` where a comment or a string behind a `##` is open to its end, so that no line's end is to come.
pub(super) fn ended(text: Cow<'_, str>) -> Option<Cow<'_, str>> {
    if !text.contains("##") {
        return Some(text);
    }
    let text = match text.ends_with('\n') {
        true => text,
        false => Cow::Owned(text.into_owned() + "\n"),
    };
    is_ended(&text).then_some(text)
}

/// Whether a line ends behind the last `##`.
fn is_ended(text: &str) -> bool {
    let mut lexer = Lexer::new(text);
    let (mut is_waiting, mut is_directive) = (false, false);
    while let Some(token) = lexer.next() {
        match *token {
            Token::PP_CONCAT => is_waiting = true,
            Token::NEWLINE => is_waiting = false,
            // What `<` opens behind an `#include` is closed by `>` alone, on whichever line.
            Token::IDENT_KW if is_directive => {
                let name = text.get(std::ops::Range::<usize>::from(token.range));
                lexer.set_expect_angle_string(name == Some("include"));
            }
            _ => {}
        }
        is_directive = match *token {
            Token::HASH => true,
            Token::WS | Token::COMMENT => is_directive,
            _ => false,
        };
    }
    !is_waiting
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_waits_for_a_line_gets_one_or_is_refused() {
        let ended = |text: &'static str| ended(Cow::Borrowed(text)).map(Cow::into_owned);
        assert_eq!(ended("#define F a##b").as_deref(), Some("#define F a##b\n"));
        assert_eq!(ended("void main() {}").as_deref(), Some("void main() {}"));
        let closed = "#define F a##/* b */ c \" d\" // ##\nvoid main() {}\n";
        assert_eq!(ended(closed).as_deref(), Some(closed));
        // Two `#` on two lines paste nothing.
        assert!(ended("#define F a#\\\n# /*\n").is_some());
        for open in [
            "#define F a##/*\n\n",
            "#define F a##\\\n",
            "#define F a##\"\n",
            "#include <\"> \n#define F a## \" b",
        ] {
            assert_eq!(ended(open), None, "{open}");
        }
    }
}
