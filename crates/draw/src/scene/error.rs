//! Errors in scenes, each with its place in the scene file.

use std::ops::Range;
use std::path::Path;

use codespan_reporting::diagnostic::{Diagnostic, Label};
use codespan_reporting::files::SimpleFile;
use codespan_reporting::term;

use super::codes;
use shader_text::read_limited;

/// A scene that cannot be loaded, or a draw that cannot be bound. [`Display`](std::fmt::Display) is
/// one line; [`SceneError::render`] shows the place in the scene file.
#[derive(Clone, Debug)]
pub struct SceneError {
    message: String,
    help: Option<String>,
    place: Option<Box<TextPlace>>,
    detail: Option<String>,
    subject: Option<Box<str>>,
    /// Whether the cause is an unsupported extension that a glTF file requires.
    is_extension: bool,
}

#[derive(Clone, Debug)]
struct TextPlace {
    file: String,
    text: String,
    range: Range<usize>,
}

impl SceneError {
    /// An error without a place.
    pub fn new(message: impl Into<String>) -> Self {
        Self {
            message: message.into(),
            help: None,
            place: None,
            detail: None,
            subject: None,
            is_extension: false,
        }
    }

    pub fn code(&self) -> &'static str {
        match self.is_extension {
            true => codes::GLTF_EXTENSION.code,
            false => codes::SCENE.code,
        }
    }

    /// Sets the code for unsupported extensions.
    #[must_use]
    pub fn of_extension(mut self) -> Self {
        self.is_extension = true;
        self
    }

    /// A file that cannot be read.
    pub fn read(path: &Path, error: &std::io::Error) -> Self {
        Self::new(format!("cannot read `{}`: {error}", path.display()))
    }

    /// A file is missing, too large or unreadable.
    pub fn unread(path: &Path, error: read_limited::ReadError) -> Self {
        match error {
            read_limited::ReadError::TooLarge(exceeded) => exceeded.into(),
            other => Self::new(format!("cannot read `{}`: {other}", path.display())),
        }
    }

    #[must_use]
    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }

    /// Suggests the nearest of `known`, or lists all of them if none is near.
    #[must_use]
    pub fn suggest<'a>(self, wrong: &str, known: impl IntoIterator<Item = &'a str>) -> Self {
        let known: Vec<&str> = known.into_iter().collect();
        match nearest(wrong, &known) {
            Some(near) => self.help(format!("did you mean `{near}`?")),
            None if known.is_empty() => self,
            None => self.help(format!("known are: {}", known.join(", "))),
        }
    }

    /// Sets the place, unless the error already has one.
    #[must_use]
    pub fn at(mut self, file: &str, text: &str, range: Range<usize>) -> Self {
        self.place.get_or_insert_with(|| {
            Box::new(TextPlace {
                file: file.to_owned(),
                text: text.to_owned(),
                range,
            })
        });
        self
    }

    /// Adds a rendered message of another component, such as a shader error.
    #[must_use]
    pub fn detail(mut self, detail: impl Into<String>) -> Self {
        self.detail = Some(detail.into());
        self
    }

    /// Sets the path of the shader value that the error is about.
    #[must_use]
    pub fn about(mut self, path: impl Into<String>) -> Self {
        self.subject = Some(path.into().into_boxed_str());
        self
    }

    /// Path of the shader value that the error is about.
    pub fn subject(&self) -> Option<&str> {
        self.subject.as_deref()
    }

    /// Prefixes the message with a name.
    #[must_use]
    pub(crate) fn within(mut self, what: &str) -> Self {
        self.message = format!("{what}: {}", self.message);
        self
    }

    /// The message without place or help.
    pub fn message(&self) -> &str {
        &self.message
    }

    /// The remedy, if there is one.
    pub fn help_text(&self) -> Option<&str> {
        self.help.as_deref()
    }

    /// Line, from 1, in the scene file.
    pub fn line(&self) -> Option<usize> {
        let place = self.place.as_ref()?;
        Some(
            place
                .text
                .get(..place.range.start)?
                .bytes()
                .filter(|b| *b == b'\n')
                .count()
                + 1,
        )
    }

    /// The message with a frame on the scene file's text, without colours.
    pub fn render(&self) -> String {
        let mut diagnostic: Diagnostic<()> = Diagnostic::error()
            .with_code(self.code())
            .with_message(&self.message);
        if let Some(help) = &self.help {
            diagnostic = diagnostic.with_notes(vec![format!("help: {help}")]);
        }
        let (name, text) = match &self.place {
            Some(p) => {
                diagnostic = diagnostic.with_labels(vec![Label::primary((), p.range.clone())]);
                (p.file.as_str(), p.text.as_str())
            }
            None => ("", ""),
        };
        let mut out = term::emit_into_string(
            &term::Config::default(),
            &SimpleFile::new(name, text),
            &diagnostic,
        )
        .unwrap_or_else(|_| format!("error: {}\n", self.message));
        if let Some(detail) = &self.detail {
            out.push_str(detail);
        }
        out
    }
}

impl std::fmt::Display for SceneError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if let (Some(place), Some(line)) = (&self.place, self.line()) {
            write!(f, "{}:{line}: ", place.file)?;
        }
        f.write_str(&self.message)?;
        if let Some(help) = &self.help {
            write!(f, " ({help})")?;
        }
        Ok(())
    }
}

impl std::error::Error for SceneError {}

impl From<shader_text::limits::Exceeded> for SceneError {
    fn from(exceeded: shader_text::limits::Exceeded) -> Self {
        Self::new(exceeded.to_string()).help(exceeded.remedy())
    }
}

/// The known name nearest to a wrong one, if at most a third of its letters differ, or else one
/// that contains it.
pub fn nearest<'a>(wrong: &str, known: &[&'a str]) -> Option<&'a str> {
    known
        .iter()
        .map(|k| (strsim::osa_distance(wrong, k), *k))
        .min()
        .filter(|(d, k)| *d * 3 <= k.chars().count().max(wrong.chars().count()))
        .map(|(_, k)| k)
        .or_else(|| shader_text::nearest::containing(wrong, known))
}
