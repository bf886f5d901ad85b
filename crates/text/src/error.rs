//! Errors in the author's source: codes, labels and notes, rendered as a frame on the text.

use std::sync::Arc;

use crate::refusals::RefusalInfo;
use crate::source::{Invalid, Location, SourceMap};
use codespan_reporting::diagnostic::{Diagnostic, Label as Frame};
use codespan_reporting::term::{self, Config, Styles, StylesWriter, termcolor::Ansi};

use super::codes;
use super::excerpt::{Excerpts, short_lines};

/// The kind of an error. [`Code::name`] is stable, so scripts may match on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Code {
    /// No source, or only sources without a token.
    Empty,
    UnknownLanguage,
    /// A GLSL source of unknown stage.
    UnknownStage,
    /// The sources do not make one material, such as two fragment files.
    Sources,
    /// The file is in another language, or an engine completes it.
    Foreign,
    /// The language needs a feature that this build lacks.
    Unsupported,
    /// The parser rejected the text.
    Parse,
    /// The validator rejected the module.
    Invalid,
    /// naga panicked.
    Panic,
    /// The text is nested too deeply or too long.
    TooDeep,
    /// A required stage has no entry point.
    NoEntryPoint,
    /// The requested entry point does not exist.
    UnknownEntryPoint,
    /// A stage has several entry points and none was chosen.
    AmbiguousEntryPoint,
    /// The vertex outputs do not match the fragment inputs.
    Interface,
    /// Two files declare one thing differently.
    Link,
}

impl Code {
    /// The code's name and explanation.
    pub fn info(self) -> &'static RefusalInfo {
        match self {
            Self::Empty => &codes::EMPTY,
            Self::UnknownLanguage => &codes::UNKNOWN_LANGUAGE,
            Self::UnknownStage => &codes::UNKNOWN_STAGE,
            Self::Sources => &codes::SOURCES,
            Self::Foreign => &codes::FOREIGN,
            Self::Unsupported => &codes::UNSUPPORTED,
            Self::Parse => &codes::PARSE,
            Self::Invalid => &codes::INVALID,
            Self::Panic => &codes::PANIC,
            Self::TooDeep => &codes::TOO_DEEP,
            Self::NoEntryPoint => &codes::NO_ENTRY_POINT,
            Self::UnknownEntryPoint => &codes::UNKNOWN_ENTRY_POINT,
            Self::AmbiguousEntryPoint => &codes::AMBIGUOUS_ENTRY_POINT,
            Self::Interface => &codes::INTERFACE,
            Self::Link => &codes::LINK,
        }
    }

    /// The stable name, as in `error[parse]`.
    pub fn name(self) -> &'static str {
        self.info().code
    }
}

/// Whether a rendered error has terminal colours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Color {
    /// ANSI escape sequences.
    Always,
    /// Without escape sequences.
    #[default]
    Never,
}

/// A span that an error points at. The first label is the error's location.
#[derive(Clone, Debug, PartialEq)]
pub struct Label {
    /// A range in the address space of the error's [`SourceMap`].
    pub span: naga::Span,
    /// An explanation, or empty.
    pub text: String,
}

/// The source is not a valid program. The author must fix it, except for [`Code::Panic`].
#[derive(Clone, Debug)]
pub struct Error(Box<Diagnosis>);

#[derive(Clone, Debug)]
struct Diagnosis {
    code: Code,
    message: String,
    labels: Vec<Label>,
    notes: Vec<String>,
    sources: Arc<SourceMap>,
}

/// The message of a GLSL stage without `main`.
pub const NO_MAIN: &str = "there is no function `main`";

/// Parts of naga's messages about valid WGSL, and remedies. `docs/naga-issues.md` has the inputs.
const LACKS: &[(&str, &str)] = &[
    (
        "found \"--\"",
        "naga takes `--` for a decrement: write `- -`",
    ),
    (
        "Not implemented as constant expression",
        "naga computes this at run time only: write its value, or a `let` in each function that uses it",
    ),
    (
        "Abstract types may only appear in constant expressions",
        "naga does not settle the type of these numbers: give one a suffix, as in `1.0f`",
    ),
    (
        "which can't be passed into functions",
        "naga passes pointers to variables of functions and to private ones only: pass the value, or \
         name the buffer in the function",
    ),
];

impl Error {
    /// An error without a location.
    pub fn new(code: Code, message: impl Into<String>) -> Self {
        Self(Box::new(Diagnosis {
            code,
            message: message.into(),
            labels: Vec::new(),
            notes: Vec::new(),
            sources: Arc::default(),
        }))
    }

    /// Adds a label. The first one is the error's location.
    pub fn label(mut self, span: naga::Span, text: impl Into<String>) -> Self {
        self.0.labels.push(Label {
            span,
            text: text.into(),
        });
        self
    }

    /// Adds a label without text, if there is a span.
    pub fn label_if(self, span: Option<naga::Span>) -> Self {
        match span {
            Some(span) => self.label(span, ""),
            None => self,
        }
    }

    pub fn note(mut self, text: impl Into<String>) -> Self {
        self.0.notes.push(text.into());
        self
    }

    /// Sets the sources that the labels point into.
    pub fn with_sources(mut self, sources: &Arc<SourceMap>) -> Self {
        self.0.sources = Arc::clone(sources);
        self
    }

    /// Converts naga's validation error.
    pub fn invalid(invalid: &Invalid) -> Self {
        let message = in_wgsl(without_handles(&invalid.message));
        let mut error = Self::new(Code::Invalid, message);
        for (span, text) in &invalid.labels {
            // naga labels spans with handles (`naga::ir::Expression [12]`), which mean nothing to
            // an author.
            let text = if text.starts_with("naga::") { "" } else { text };
            if !error.0.labels.iter().any(|l| l.span == *span) {
                error = error.label(*span, text);
            }
        }
        error.with_remedy()
    }

    /// Adds a remedy for WGSL that naga refuses but other compilers accept.
    pub fn with_remedy(self) -> Self {
        let is_in = |(part, _): &&(&str, &'static str)| self.0.message.contains(part);
        match LACKS.iter().find(is_in) {
            Some((_, remedy)) => self.note(*remedy),
            None => self,
        }
    }

    pub fn code(&self) -> Code {
        self.0.code
    }

    /// The message without a location, usually one line.
    pub fn message(&self) -> &str {
        &self.0.message
    }

    pub fn labels(&self) -> &[Label] {
        &self.0.labels
    }

    /// Hints and remedies.
    pub fn notes(&self) -> &[String] {
        &self.0.notes
    }

    /// Line and column of the first label.
    pub fn location(&self) -> Option<Location> {
        self.0
            .labels
            .iter()
            .find_map(|l| self.0.sources.locate(l.span))
    }

    /// Renders the error as a frame on the source, ending in a newline.
    pub fn render(&self, color: Color) -> String {
        let mut files = Excerpts::default();
        let sources = self.0.sources.files();
        // File and range of each label.
        let places: Vec<_> = (self.0.labels.iter())
            .filter_map(|label| {
                let base = self.0.sources.file_of(label.span)?.base;
                let id = sources.iter().position(|f| f.base == base)?;
                let range = label.span.to_range()?;
                Some((
                    id,
                    range.start - base as usize..range.end - base as usize,
                    label,
                ))
            })
            .collect();
        for (id, file) in sources.iter().enumerate() {
            let own = places.iter().filter(|(of, ..)| *of == id);
            let own: Vec<_> = own.map(|(_, range, _)| range.clone()).collect();
            files.add(printable(&file.name), &printable(&file.text), &own);
        }
        let frames = places.iter().enumerate().map(|(n, (id, range, label))| {
            let range = files.place(*id, range.clone());
            let frame = match n {
                0 => Frame::primary(*id, range),
                _ => Frame::secondary(*id, range),
            };
            frame.with_message(printable(&label.text))
        });
        let frames: Vec<Frame<usize>> = frames.collect();
        let diagnostic = Diagnostic::error()
            .with_code(self.0.code.name())
            .with_message(printable(&self.0.message))
            .with_labels(frames)
            .with_notes(
                self.0
                    .notes
                    .iter()
                    .map(|n| short_lines(&printable(n)))
                    .collect(),
            );
        let config = Config::default();
        let mut bytes = Vec::new();
        let done = match color {
            Color::Never => term::emit_to_io_write(&mut bytes, &config, &files, &diagnostic),
            Color::Always => {
                let styles = Styles::default();
                let mut writer = StylesWriter::new(Ansi::new(&mut bytes), &styles);
                term::emit_to_write_style(&mut writer, &config, &files, &diagnostic)
            }
        };
        match done {
            Ok(()) => String::from_utf8_lossy(&bytes).into_owned(),
            // If a label does not fit its file, the message must still appear.
            Err(_) => format!("error[{}]: {}\n", self.0.code.name(), self.0.message),
        }
    }
}

impl std::fmt::Display for Error {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.location() {
            Some(at) => write!(
                f,
                "{}:{}:{}: {}",
                at.file, at.line, at.column, self.0.message
            ),
            None => f.write_str(&self.0.message),
        }
    }
}

impl std::error::Error for Error {}

/// naga's names of scalar kinds, and WGSL's.
const SCALARS: [(&str, &str, u32); 8] = [
    ("Float", "f16", 2),
    ("Float", "f32", 4),
    ("Float", "f64", 8),
    ("Sint", "i32", 4),
    ("Sint", "i64", 8),
    ("Uint", "u32", 4),
    ("Uint", "u64", 8),
    ("Bool", "bool", 1),
];

/// naga's names of operators, and WGSL's.
const OPERATORS: [(&str, &str); 18] = [
    ("Add", "+"),
    ("Subtract", "-"),
    ("Multiply", "*"),
    ("Divide", "/"),
    ("Modulo", "%"),
    ("Equal", "=="),
    ("NotEqual", "!="),
    ("Less", "<"),
    ("LessEqual", "<="),
    ("Greater", ">"),
    ("GreaterEqual", ">="),
    ("And", "&"),
    ("ExclusiveOr", "^"),
    ("InclusiveOr", "|"),
    ("LogicalAnd", "&&"),
    ("LogicalOr", "||"),
    ("ShiftLeft", "<<"),
    ("ShiftRight", ">>"),
];

/// Writes types and operators, which naga prints as Rust data, as WGSL does.
fn in_wgsl(mut message: String) -> String {
    const SIZES: [(&str, u32); 3] = [("Bi", 2), ("Tri", 3), ("Quad", 4)];
    for (kind, scalar, width) in SCALARS {
        let rust = format!("Scalar {{ kind: {kind}, width: {width} }}");
        if !message.contains(&rust) {
            continue;
        }
        message = message
            .replace(&format!("Scalar({rust})"), scalar)
            .replace(&rust, scalar);
        for (size, rows) in SIZES {
            let rust = format!("Vector {{ size: {size}, scalar: {scalar} }}");
            message = message.replace(&rust, &format!("vec{rows}<{scalar}>"));
            for (side, columns) in SIZES {
                let rust = format!("Matrix {{ columns: {side}, rows: {size}, scalar: {scalar} }}");
                message = message.replace(&rust, &format!("mat{columns}x{rows}<{scalar}>"));
            }
        }
    }
    for (rust, sign) in OPERATORS {
        message = message.replace(
            &format!("Operation {rust} can't work"),
            &format!("`{sign}` can't work"),
        );
    }
    message.replace("(of type ", "(")
}

/// Removes naga's handle numbers from a message, such as ` [43]`. If only the number identified the
/// object, the label shows it.
fn without_handles(message: &str) -> String {
    let mut out = String::with_capacity(message.len());
    let mut rest = message;
    while let Some((before, after)) = rest.split_once(" [") {
        out.push_str(before);
        let digits = after.bytes().take_while(u8::is_ascii_digit).count();
        rest = match after[digits..].strip_prefix(']').filter(|_| digits > 0) {
            Some(behind) => {
                let word = out.rsplit(' ').next().unwrap_or_default();
                let is_open = ["of", "in", "with", "to", "on", "got"].contains(&word);
                if is_open && !behind.starts_with(" (") {
                    out.push_str(if word == "in" {
                        " a variable"
                    } else {
                        " a value"
                    });
                }
                behind
            }
            None => {
                out.push_str(" [");
                after
            }
        };
    }
    out + rest
}

/// Replaces control characters that could drive a terminal, byte for byte.
fn printable(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        if c.is_control() && !matches!(c, '\n' | '\r' | '\t') {
            out.extend(std::iter::repeat_n('?', c.len_utf8()));
        } else {
            out.push(c);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn types_and_operators_are_written_as_in_wgsl() {
        let naga = "Operation Less can't work with [4] (of type Vector { size: Quad, scalar: \
                    Scalar { kind: Float, width: 4 } }) and [5] (of type Scalar(Scalar { kind: \
                    Float, width: 4 }))";
        assert_eq!(
            in_wgsl(without_handles(naga)),
            "`<` can't work with (vec4<f32>) and (f32)"
        );
        assert_eq!(
            without_handles("The type of [12] doesn't match the type stored in [3]"),
            "The type of a value doesn't match the type stored in a variable"
        );
    }
}
