//! Parses one WGSL file to a naga module: what naga lacks is rewritten, and what it takes though no
//! browser does is refused.

mod aliases;
mod constants;
mod diagnostics;
mod edits;
mod precedence;
mod refused;
mod swizzles;
mod tokens;

use std::borrow::Cow;

use naga::front::wgsl::{self, ParseError};
use naga::{Module, Span};
use preshade_passes::link::offset;

use self::edits::Edits;
use super::error::{Code, Error};
use super::map_spans::map_spans;
use crate::wgsl::subgroups;

pub(super) use refused::check as check_module;

/// Expressions and statements of one file that are rewritten for naga, at most: each takes a parse.
const MOST_REWRITTEN: usize = 200;

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

/// A text that naga reads, with the way back to the author's.
struct Prepared {
    #[cfg(feature = "verify")]
    text: String,
    edits: Edits,
    module: Result<Module, ParseError>,
}

/// Rewrites what naga lacks, until naga takes the text or rejects something else.
fn prepared(author: &str) -> Prepared {
    let author = without_requirements(author);
    let author = subgroups::without(&author);
    let mut edits = Edits::default();
    if author.contains("@diagnostic") {
        diagnostics::lift(&author, &tokens::tokens(&author), &mut edits);
    }
    let mut text = edits.applied(&author);
    let mut module = wgsl::parse_str(&text);
    for _ in 0..MOST_REWRITTEN {
        let Err(error) = &module else {
            break;
        };
        let Some((part, by)) = replacement(&text, error) else {
            break;
        };
        edits.replace(edits.back(part), by);
        text = edits.applied(&author);
        module = wgsl::parse_str(&text);
    }
    Prepared {
        #[cfg(feature = "verify")]
        text,
        edits,
        module,
    }
}

/// What to write, and where, instead of what naga rejects. `None` if the author is to blame.
fn replacement(text: &str, error: &ParseError) -> Option<(std::ops::Range<usize>, String)> {
    let (span, _) = error.labels().next()?;
    let part = span.to_range()?;
    if constants::is_lacking(error.message()) {
        return constants::value(text, part);
    }
    swizzles::is_rejected(error.message())
        .then(|| swizzles::apart(text, part))
        .flatten()
}

/// The text for naga and wgpu, without what these do not know.
#[cfg(feature = "verify")]
pub(crate) fn for_naga(text: &str) -> String {
    prepared(text).text
}

/// Parses `text`. Error labels are offset by `base`; the module's spans are not.
pub(super) fn parse(text: &str, base: u32) -> Result<Module, Error> {
    let Prepared { edits, module, .. } = prepared(text);
    let back = |span: Span| match span.to_range() {
        Some(range) if !edits.is_empty() => {
            let range = edits.back(range);
            Span::new(range.start as u32, range.end as u32)
        }
        _ => span,
    };
    let mut module = module.map_err(|e| {
        // naga reports its recursion limit as an internal error without a span.
        if e.message().contains("recursion limit") {
            return Error::new(Code::TooDeep, "expressions are nested too deeply to parse")
                .note("naga's parser stops at 200 levels; move inner parts to variables");
        }
        let mut error = Error::new(Code::Parse, e.message());
        for (span, label) in e.labels() {
            error = error.label(offset(back(span), base), label);
        }
        for note in e.notes() {
            error = error.note(note);
        }
        error.with_remedy()
    })?;
    precedence::check(&tokens::tokens(text), base)?;
    if !edits.is_empty() {
        map_spans(&mut module, &back);
    }
    Ok(module)
}
