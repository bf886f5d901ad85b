//! Names and texts of others, in which nothing is obeyed.

use std::borrow::Cow;
use std::fmt::Write as _;

/// Whether a terminal, a spreadsheet or a page would act on a character instead of showing it:
/// control characters, and those that change the writing direction (Unicode Standard Annex 9,
/// section 2). Line breaks and tabs are allowed.
pub fn is_obeyed(c: char) -> bool {
    let is_turning = matches!(
        c,
        '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}'
    );
    (c.is_control() && !matches!(c, '\n' | '\t')) || is_turning
}

/// The text with such characters escaped, for example as `\u{1b}`. Lines may end in CR LF.
pub(crate) fn plain(text: &str) -> Cow<'_, str> {
    if !text.chars().any(is_obeyed) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len());
    let mut characters = text.chars().peekable();
    while let Some(c) = characters.next() {
        match c {
            '\r' if characters.peek() == Some(&'\n') => out.push(c),
            c if is_obeyed(c) => {
                let _ = write!(out, "\\u{{{:x}}}", u32::from(c));
            }
            c => out.push(c),
        }
    }
    Cow::Owned(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_obeyed_is_told() {
        let name = "a\u{1b}[2J\u{7}\u{202e}b\u{9b}1A\rc";
        assert_eq!(plain(name), "a\\u{1b}[2J\\u{7}\\u{202e}b\\u{9b}1A\\u{d}c");
        // The marks that change the writing direction.
        assert_eq!(
            plain("a\u{200e}b\u{200f}c\u{61c}"),
            "a\\u{200e}b\\u{200f}c\\u{61c}"
        );
        let text = "one\r\n\ttwo é\n";
        assert_eq!(plain(text), text);
    }
}
