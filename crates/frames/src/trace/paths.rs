//! Removes the recording machine's paths from labels and from shader comments.

use std::borrow::Cow;

/// Cuts each absolute path in a text to its last name.
pub(super) fn stripped(text: &str) -> String {
    let is_end = |c: char| c.is_whitespace() || matches!(c, '"' | '\'' | '(' | ')' | '<' | '>');
    let words = text.split_inclusive(is_end);
    words.map(|word| last_name(word, is_end)).collect()
}

/// The last name of an absolute path. Any other word stays unchanged.
fn last_name(word: &str, is_end: impl Fn(char) -> bool) -> &str {
    let bytes = word.as_bytes();
    let is_unix = bytes.first() == Some(&b'/') && word[1..].contains('/');
    let is_windows = bytes.first().is_some_and(u8::is_ascii_alphabetic)
        && bytes.get(1) == Some(&b':')
        && bytes.get(2).is_some_and(|b| matches!(b, b'/' | b'\\'));
    let is_share = word.starts_with("\\\\");
    if word.starts_with("//") || !(is_unix || is_windows || is_share) {
        return word;
    }
    let path = word.trim_end_matches(&is_end).trim_end_matches(['/', '\\']);
    let start = path.rfind(['/', '\\']).map_or(0, |at| at + 1);
    &word[start..]
}

/// Cuts the paths in a WGSL shader's comments. Leaves the code alone, because `/` divides there.
pub(super) fn in_comments(source: &str) -> Cow<'_, str> {
    if !source.contains("//") && !source.contains("/*") {
        return source.into();
    }
    let mut out = String::with_capacity(source.len());
    let mut rest = source;
    while let Some(at) = ["//", "/*"].iter().filter_map(|c| rest.find(c)).min() {
        let (code, comment) = rest.split_at(at);
        let length = match comment.starts_with("//") {
            true => comment.find('\n').unwrap_or(comment.len()),
            false => block(comment),
        };
        let (comment, after) = comment.split_at(length);
        out.push_str(code);
        out.push_str(&comment[..2]);
        out.push_str(&stripped(&comment[2..]));
        rest = after;
    }
    out.push_str(rest);
    out.into()
}

/// Length of a block comment in bytes, including nested ones.
fn block(text: &str) -> usize {
    let (mut at, mut depth) = (2, 1);
    while depth > 0 {
        let rest = &text[at..];
        let next = [rest.find("/*"), rest.find("*/")];
        match next {
            [Some(open), close] if close.is_none_or(|c| open < c) => {
                depth += 1;
                at += open + 2;
            }
            [_, Some(close)] => {
                depth -= 1;
                at += close + 2;
            }
            [_, None] => return text.len(),
        }
    }
    at
}

#[cfg(test)]
mod tests {
    use super::{in_comments, stripped};

    #[test]
    fn absolute_paths_are_cut_to_their_last_name() {
        for (text, expected) in [
            ("/home/a/b.wgsl", "b.wgsl"),
            (
                "shader \"C:\\Users\\a\\b.wgsl\" of a",
                "shader \"b.wgsl\" of a",
            ),
            ("D:/x/y (\\\\host\\share\\z)", "y (z)"),
            ("mesh/pbr.wgsl", "mesh/pbr.wgsl"),
            ("https://example.com/a", "https://example.com/a"),
            ("1 / 2 /", "1 / 2 /"),
            ("/home/a/b/", "b/"),
        ] {
            assert_eq!(stripped(text), expected);
        }
    }

    #[test]
    fn code_of_a_shader_stays_as_it_is() {
        let source =
            "// of /home/a/b.wgsl\nlet c = a /b/c; /* /x/y /* /z/w */ /v/u */ let d = e /f/g; //";
        let expected = "// of b.wgsl\nlet c = a /b/c; /* y /* w */ u */ let d = e /f/g; //";
        assert_eq!(in_comments(source), expected);
    }
}
