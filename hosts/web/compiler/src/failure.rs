//! Why there is no answer.

use serde::Serialize;
use shader_text::error::Color;
use shader_text::limits::Exceeded;
use shader_text::source::Location;

/// An error of a request. The caller must change the shader or the request.
#[derive(Debug, Serialize)]
pub struct Failure {
    /// The code, as in `preshade --explain CODE`; or `usage`, for a request that is wrong.
    code: &'static str,
    /// The message, without a place.
    message: String,
    /// Where in the author's source.
    place: Option<Location>,
    /// Hints.
    notes: Vec<String>,
    /// The whole message, as the command line prints it.
    rendered: String,
}

impl Failure {
    /// A wrong request.
    pub fn usage(message: impl Into<String>) -> Self {
        let message = message.into();
        Self {
            code: "usage",
            rendered: format!("error: {message}"),
            message,
            place: None,
            notes: Vec::new(),
        }
    }

    /// A file that is larger than allowed.
    pub fn too_large(name: &str, exceeded: &Exceeded) -> Self {
        Self {
            code: shader_text::error::Code::TooDeep.name(),
            message: exceeded.to_string(),
            place: None,
            notes: vec![exceeded.remedy()],
            rendered: format!("error: {name}: {exceeded}\n = {}", exceeded.remedy()),
        }
    }

    /// An error in a shader.
    pub fn front(error: &shader_text::error::Error) -> Self {
        Self {
            code: error.code().name(),
            message: error.message().to_owned(),
            place: error.location(),
            notes: error.notes().to_vec(),
            rendered: error.render(Color::Never).trim_end().to_owned(),
        }
    }

    /// The whole message.
    pub fn rendered(&self) -> &str {
        &self.rendered
    }

    /// The same, of a program that the message does not name.
    pub fn of(mut self, names: &str) -> Self {
        if !names.split(',').any(|name| self.rendered.contains(name)) {
            self.rendered = format!("{}\n = in {names}", self.rendered.trim_end());
        }
        self
    }

    /// The same, with a hint in the rendered message.
    pub fn hint(mut self, hint: &str) -> Self {
        self.rendered = format!("{}\n = {hint}", self.rendered.trim_end());
        self
    }
}
