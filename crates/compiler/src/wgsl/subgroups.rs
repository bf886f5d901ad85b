//! `enable subgroups;`: WGSL has the directive, and naga has the operations without it. naga gets
//! the text without the directive. Text is written with it where the author had it, because the
//! author's host requires it then.

use std::borrow::Cow;
use std::ops::Range;

use shader_text::tokens as text;
use shader_text::tokens::TokenKind;

const NAME: &str = "subgroups";

/// The text for naga: as long as before, with blanks for the directive.
pub(crate) fn without(text: &str) -> Cow<'_, str> {
    let Some(blanks) = directive(text) else {
        return Cow::Borrowed(text);
    };
    let (before, after) = (&text[..blanks.start], &text[blanks.end..]);
    let spaces = " ".repeat(blanks.len());
    Cow::Owned(format!("{before}{spaces}{after}"))
}

/// The directive for `written`, which is a part of a program that was read from `sources`. Empty if
/// it needs none, or if no source has it.
pub(crate) fn restored<'t>(
    written: &str,
    mut sources: impl Iterator<Item = &'t str>,
) -> &'static str {
    let is_operation = |word: &str| word.starts_with("subgroup") || word.starts_with("quad");
    let mut words = words(written).map(|range| &written[range]);
    match words.any(is_operation) && sources.any(|text| directive(text).is_some()) {
        true => "enable subgroups;\n",
        false => "",
    }
}

fn words(text: &str) -> impl Iterator<Item = Range<usize>> {
    let tokens = text::tokens(text);
    tokens.filter_map(|(kind, range)| (kind == TokenKind::Word).then_some(range))
}

/// The range to blank: the whole directive, or its part of a list.
fn directive(text: &str) -> Option<Range<usize>> {
    if !text.contains(NAME) {
        return None;
    }
    let text = &text::without_comments(text);
    let mut start = None;
    let mut names = Vec::new();
    for (_, range) in text::tokens(text) {
        match (&text[range.clone()], start) {
            ("enable", None) => (start, names) = (Some(range.start), Vec::new()),
            (";", Some(from)) => {
                let at = names
                    .iter()
                    .position(|n: &Range<usize>| &text[n.clone()] == NAME);
                match (at, names.len()) {
                    (None, _) => start = None,
                    (Some(_), 1) => return Some(from..range.end),
                    // With the comma next to it.
                    (Some(0), _) => return Some(names[0].start..names[1].start),
                    (Some(at), _) => return Some(names[at - 1].end..names[at].end),
                }
            }
            (",", Some(_)) => {}
            (_, Some(_)) => names.push(range),
            // Directives come first.
            ("requires" | "diagnostic", None) => {}
            ("fn" | "struct" | "var" | "const" | "override" | "alias" | "@", None) => return None,
            _ => {}
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_directive_is_blanked_in_place() {
        for (text, blank) in [
            (
                "enable subgroups;\nfn f() {}",
                "                 \nfn f() {}",
            ),
            ("enable f16, subgroups;", "enable f16           ;"),
            ("enable subgroups, f16;", "enable            f16;"),
            (
                "enable f16; enable subgroups;",
                "enable f16;                  ",
            ),
            ("fn subgroups() {}", "fn subgroups() {}"),
            ("// enable subgroups;\n", "// enable subgroups;\n"),
        ] {
            assert_eq!(without(text), blank);
        }
    }

    #[test]
    fn comments_are_blanked_in_place() {
        let text = "a // cbuffer\nb /* SV_Target\n*/ c é // d";
        let blank = text::without_comments(text);
        assert!(!blank.contains("cbuffer") && !blank.contains("SV_Target"));
        assert_eq!(blank.find('c'), text.rfind("c é"));
    }

    #[test]
    fn it_is_written_where_it_was_and_is_needed() {
        let with = || ["enable subgroups;"].into_iter();
        assert_eq!(restored("subgroupMax(x)", with()), "enable subgroups;\n");
        assert_eq!(restored("max(x, y)", with()), "");
        assert_eq!(restored("subgroupMax(x)", [""].into_iter()), "");
    }
}
