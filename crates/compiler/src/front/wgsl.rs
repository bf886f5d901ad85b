//! Parses one WGSL file to a naga module. Rewrites features that naga lacks, and refuses texts that
//! naga accepts but no browser does.

mod aliases;
mod constants;
mod diagnostics;
mod edits;
mod precedence;
mod refused;
mod swizzles;
mod tokens;

use naga::front::wgsl::{self, ParseError};
use naga::{Module, Span};
use naga_edit::link::offset;

use self::edits::Edits;
use self::swizzles::Replaced;
use self::tokens::{Kind, Token};
use crate::wgsl::subgroups;
use naga_edit::map_spans::map_spans;
use shader_text::error::{Code, Error};

pub(super) use refused::check as check_module;

/// Expressions and statements of one file that are rewritten for naga, at most: each takes a parse.
const MOST_REWRITTEN: usize = 200;

/// Drops `requires` of language extensions that naga does not know. The directive changes nothing:
/// a use of the extension is an error at its own place. Directives come ahead of all declarations.
fn drop_requirements(tokens: &[Token<'_>], edits: &mut Edits) {
    let known = wgsl::ImplementedLanguageExtension::all();
    let is_known = |name: &Token<'_>| known.iter().any(|k| k.to_ident() == name.text);
    let is_directive = |word: &str| matches!(word, "enable" | "requires" | "diagnostic");
    let mut rest = tokens;
    while let Some(first) = rest.first().filter(|t| is_directive(t.text))
        && let Some(end) = rest.iter().position(|t| t.text == ";")
    {
        let mut names = rest[1..end].iter().filter(|t| t.kind == Kind::Word);
        if first.text == "requires" && !names.all(is_known) {
            edits.replace(first.at..rest[end].range().end, "");
        }
        rest = &rest[end + 1..];
    }
}

/// Puts each condition of a `const_assert` in parentheses: naga takes a first one to be around the
/// whole.
fn enclose_assertions(tokens: &[Token<'_>], edits: &mut Edits) {
    for (n, token) in tokens.iter().enumerate() {
        if token.text == "const_assert"
            && let Some(end) = tokens[n..].iter().find(|t| t.text == ";")
        {
            edits.replace(token.range(), "const_assert (");
            edits.replace(end.range(), ");");
        }
    }
}

/// A text that naga reads, with the way back to the author's.
struct Prepared {
    text: String,
    edits: Edits,
    module: Result<Module, ParseError>,
}

/// Rewrites features that naga lacks, until naga takes the text or rejects something else.
fn prepared(author: &str) -> Prepared {
    let author = subgroups::without(author);
    let tokens = tokens::tokens(&author);
    let mut edits = Edits::default();
    drop_requirements(&tokens, &mut edits);
    enclose_assertions(&tokens, &mut edits);
    diagnostics::lift(&author, &tokens, &mut edits);
    let mut text = edits.applied(&author);
    let mut module = wgsl::parse_str(&text);
    for _ in 0..MOST_REWRITTEN {
        let Some(replaced) = replacement(&text, &module) else {
            break;
        };
        let replaced = replaced.into_iter();
        let replaced: Vec<_> = replaced.map(|(part, by)| (edits.back(part), by)).collect();
        for (part, by) in replaced {
            edits.replace(part, by);
        }
        text = edits.applied(&author);
        module = wgsl::parse_str(&text);
    }
    Prepared {
        text,
        edits,
        module,
    }
}

/// A replacement for the part that naga rejects, and its place. `None` if the author is to blame.
fn replacement(text: &str, parsed: &Result<Module, ParseError>) -> Option<Replaced> {
    let (span, message) = match parsed {
        Ok(module) => (constants::unsettled(module)?, None),
        Err(error) => (error.labels().next()?.0, Some(error.message())),
    };
    let part = span.to_range()?;
    if message.is_none_or(constants::is_lacking) {
        return constants::value(text, part).map(|found| vec![found]);
    }
    message
        .is_some_and(swizzles::is_rejected)
        .then(|| swizzles::assign_components(text, part))
        .flatten()
}

/// The text for naga and wgpu, without features that these do not know.
pub fn for_naga(text: &str) -> String {
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
