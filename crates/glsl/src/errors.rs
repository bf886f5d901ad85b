//! Errors about what a text says.

use naga::Span;
use shader_text::error::{Code, Error};

/// It is GLSL, but not supported.
pub(super) fn unsupported(what: impl Into<String>, place: Option<Span>) -> Error {
    Error::new(Code::Unsupported, what).label_if(place)
}

/// It is not GLSL.
pub(super) fn wrong(what: impl Into<String>, place: Option<Span>) -> Error {
    Error::new(Code::Parse, what).label_if(place)
}
