//! What went wrong in the author's source, as data, and as a frame on the author's own text.

use std::sync::Arc;

use codespan_reporting::diagnostic::{Diagnostic, Label as Frame};
use codespan_reporting::files::SimpleFiles;
use codespan_reporting::term::{self, Config, Styles, StylesWriter, termcolor::Ansi};
use preshade_passes::program::{Invalid, Location, SourceMap};

/// What kind of error it is. [`Code::name`] is stable and may be matched on by scripts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Code {
    /// No source, or one without a single token.
    Empty,
    /// Neither the file's extension nor the caller names the language.
    UnknownLanguage,
    /// A GLSL source whose stage neither the extension nor the caller names.
    UnknownStage,
    /// The sources do not make one material: two fragment files, say.
    Sources,
    /// The language needs a feature this build of preshade lacks.
    Unsupported,
    /// The parser refused the text.
    Parse,
    /// The text parses, but the validator refused what it means.
    Invalid,
    /// naga, the parser preshade uses, panicked.
    Panic,
    /// Nested too deeply, or too long, to be worked on.
    TooDeep,
    /// No entry point of the stage that is needed.
    NoEntryPoint,
    /// The entry point asked for does not exist.
    UnknownEntryPoint,
    /// Several entry points of one stage, and none was chosen.
    AmbiguousEntryPoint,
    /// The vertex stage's outputs do not fit the fragment stage's inputs.
    Interface,
    /// Two files declare one thing differently.
    Link,
}

impl Code {
    /// The code in messages: `error[parse]`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Empty => "empty",
            Self::UnknownLanguage => "unknown-language",
            Self::UnknownStage => "unknown-stage",
            Self::Sources => "sources",
            Self::Unsupported => "unsupported",
            Self::Parse => "parse",
            Self::Invalid => "invalid",
            Self::Panic => "panic",
            Self::TooDeep => "too-deep",
            Self::NoEntryPoint => "no-entry-point",
            Self::UnknownEntryPoint => "unknown-entry-point",
            Self::AmbiguousEntryPoint => "ambiguous-entry-point",
            Self::Interface => "interface",
            Self::Link => "link",
        }
    }
}

/// Whether a rendered error carries terminal colours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Color {
    /// ANSI escape sequences.
    Always,
    /// Plain text.
    #[default]
    Never,
}

/// A place an error points at. The first of an error is the place itself, others explain it.
#[derive(Clone, Debug, PartialEq)]
pub struct Label {
    /// Where, in the address space of the error's [`SourceMap`].
    pub span: naga::Span,
    /// What is there; may be empty.
    pub text: String,
}

/// The source could not be made a program. Always the author's to mend, except [`Code::Panic`].
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

impl Error {
    pub(crate) fn new(code: Code, message: impl Into<String>) -> Self {
        Self(Box::new(Diagnosis {
            code,
            message: message.into(),
            labels: Vec::new(),
            notes: Vec::new(),
            sources: Arc::default(),
        }))
    }

    pub(crate) fn label(mut self, span: naga::Span, text: impl Into<String>) -> Self {
        self.0.labels.push(Label {
            span,
            text: text.into(),
        });
        self
    }

    pub(crate) fn label_if(self, span: Option<naga::Span>) -> Self {
        match span {
            Some(span) => self.label(span, ""),
            None => self,
        }
    }

    pub(crate) fn note(mut self, text: impl Into<String>) -> Self {
        self.0.notes.push(text.into());
        self
    }

    pub(crate) fn with_sources(mut self, sources: &Arc<SourceMap>) -> Self {
        self.0.sources = Arc::clone(sources);
        self
    }

    /// What naga's validator says of the author's module.
    pub(crate) fn invalid(invalid: &Invalid) -> Self {
        let mut error = Self::new(Code::Invalid, without_handles(&invalid.message));
        for (span, text) in &invalid.labels {
            // naga says `naga::ir::Expression [12]`: a handle tells an author nothing.
            let text = if text.starts_with("naga::") { "" } else { text };
            if !error.0.labels.iter().any(|l| l.span == *span) {
                error = error.label(*span, text);
            }
        }
        error
    }

    /// What kind of error it is.
    pub fn code(&self) -> Code {
        self.0.code
    }

    /// The message, one line as a rule, without a place.
    pub fn message(&self) -> &str {
        &self.0.message
    }

    /// The places it points at.
    pub fn labels(&self) -> &[Label] {
        &self.0.labels
    }

    /// Hints, the remedy among them.
    pub fn notes(&self) -> &[String] {
        &self.0.notes
    }

    /// Line and column of the first place.
    pub fn location(&self) -> Option<Location> {
        self.0
            .labels
            .iter()
            .find_map(|l| self.0.sources.locate(l.span))
    }

    /// The error as a frame on the author's source, ending in a newline.
    pub fn render(&self, color: Color) -> String {
        let mut files = SimpleFiles::new();
        let mut bases = Vec::new();
        for file in self.0.sources.files() {
            files.add(printable(&file.name), printable(&file.text));
            bases.push(file.base);
        }
        let mut frames: Vec<Frame<usize>> = Vec::new();
        for label in &self.0.labels {
            let (Some(file), Some(range)) =
                (self.0.sources.file_of(label.span), label.span.to_range())
            else {
                continue;
            };
            let id = bases.iter().position(|b| *b == file.base).unwrap_or(0);
            let base = file.base as usize;
            let range = range.start - base..range.end - base;
            let frame = if frames.is_empty() {
                Frame::primary(id, range)
            } else {
                Frame::secondary(id, range)
            };
            frames.push(frame.with_message(printable(&label.text)));
        }
        let diagnostic = Diagnostic::error()
            .with_code(self.0.code.name())
            .with_message(printable(&self.0.message))
            .with_labels(frames)
            .with_notes(self.0.notes.iter().map(|n| printable(n)).collect());
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
            // A label that does not fit its file: the message still must come through.
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

/// naga's message without the numbers that it gives to expressions and types: ` [43]`.
fn without_handles(message: &str) -> String {
    let mut out = String::with_capacity(message.len());
    let mut rest = message;
    while let Some((before, after)) = rest.split_once(" [") {
        out.push_str(before);
        let digits = after.bytes().take_while(u8::is_ascii_digit).count();
        rest = match after[digits..].strip_prefix(']').filter(|_| digits > 0) {
            Some(behind) => behind,
            None => {
                out.push_str(" [");
                after
            }
        };
    }
    out + rest
}

/// `text` without control characters that could drive the reader's terminal, byte for byte as long, so that ranges still fit.
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
