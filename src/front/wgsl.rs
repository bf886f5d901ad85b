//! Parses one WGSL file to a naga module.

use std::borrow::Cow;

use naga::front::wgsl;
use preshade_passes::link::offset;

use super::error::{Code, Error};
use crate::wgsl::subgroups;

/// The text without `requires` of language extensions that naga does not know. They change nothing:
/// what needs one is an error at its own place. The text keeps its length.
fn without_requirements(text: &str) -> Cow<'_, str> {
    let known = wgsl::ImplementedLanguageExtension::all();
    let is_known = |name: &str| known.iter().any(|k| k.to_ident() == name);
    let mut out = Cow::Borrowed(text);
    for (at, _) in text.match_indices("requires") {
        let before = text[..at].trim_end();
        let Some(length) = text[at..].find(';') else {
            continue;
        };
        let names = text[at + "requires".len()..at + length].trim();
        let mut words = names.split(',').map(str::trim);
        let is_word = |c: char| c.is_alphanumeric() || c == '_';
        let is_list = words
            .clone()
            .all(|w| !w.is_empty() && w.chars().all(is_word));
        let is_directive = before.is_empty() || before.ends_with(';') || before.ends_with('/');
        let follows_line = text[before.len()..at].contains('\n');
        if is_list && (is_directive || follows_line) && !words.all(is_known) {
            out.to_mut()
                .replace_range(at..=at + length, &" ".repeat(length + 1));
        }
    }
    out
}

/// The text for naga and wgpu, without directives that these do not know. It keeps its length.
pub(crate) fn for_naga(text: &str) -> String {
    let text = without_requirements(text);
    subgroups::without(&text).into_owned()
}

/// Parses `text`. Error labels are offset by `base`; the module's spans are not.
pub(super) fn parse(text: &str, base: u32) -> Result<naga::Module, Error> {
    wgsl::parse_str(&for_naga(text)).map_err(|e| {
        // naga reports its recursion limit as an internal error without a span.
        if e.message().contains("recursion limit") {
            return Error::new(Code::TooDeep, "expressions are nested too deeply to parse")
                .note("naga's parser stops at 200 levels; move inner parts to variables");
        }
        let mut error = Error::new(Code::Parse, e.message());
        for (span, label) in e.labels() {
            error = error.label(offset(span, base), label);
        }
        for note in e.notes() {
            error = error.note(note);
        }
        error.with_remedy()
    })
}
