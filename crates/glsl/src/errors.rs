//! Constructors of errors about the text.

use naga::Span;
use shader_text::error::{Code, Error};

/// An error for valid GLSL that is not supported.
pub(super) fn unsupported(what: impl Into<String>, place: Option<Span>) -> Error {
    Error::new(Code::Unsupported, what).label_if(place)
}

/// An error for invalid GLSL.
pub(super) fn wrong(what: impl Into<String>, place: Option<Span>) -> Error {
    Error::new(Code::Parse, what).label_if(place)
}
