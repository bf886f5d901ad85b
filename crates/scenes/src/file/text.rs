//! Parses the text of a scene file.

use std::ops::Range;

use super::plausible_numbers;
use crate::file::entries::SceneFile;
use preshade_draw::scene::{SceneError, error};
use shader_text::limits::Limits;

/// Parses the entries of a scene file.
pub(super) fn parsed(source: SceneText<'_>, limits: Limits) -> Result<SceneFile, SceneError> {
    let text = source.text;
    nested(text, limits.nesting)?;
    let file: SceneFile = toml::from_str(text).map_err(|e| source.toml_error(&e))?;
    plausible_numbers::check(text).map_err(|(e, range)| source.at(e, range))?;
    Ok(file)
}

/// Fails if brackets nest deeper than the parser's stack allows. Brackets in strings count too:
/// scenes do not need them there.
fn nested(text: &str, most: u64) -> Result<(), SceneError> {
    let mut open = 0_u64;
    for byte in text.bytes() {
        match byte {
            b'[' | b'{' => open += 1,
            b']' | b'}' => open = open.saturating_sub(1),
            _ => {}
        }
        if open > most {
            return Err(SceneError::new(format!(
                "brackets are nested more than {most} deep"
            )));
        }
    }
    Ok(())
}

/// The scene file's text, for error messages.
#[derive(Clone, Copy)]
pub(super) struct SceneText<'a> {
    /// Empty if no user wrote the text.
    pub name: &'a str,
    pub text: &'a str,
}

impl SceneText<'_> {
    pub(super) fn at(&self, error: SceneError, range: Range<usize>) -> SceneError {
        match self.name {
            "" => error,
            name => error.at(name, self.text, range),
        }
    }

    /// toml's message, with a suggestion if it names the expected keys.
    fn toml_error(&self, e: &toml::de::Error) -> SceneError {
        let message = e.message().trim_end();
        let quoted: Vec<&str> = message.split('`').skip(1).step_by(2).collect();
        let error = match (message.split_once(", expected"), quoted.as_slice()) {
            (Some((what, _)), [wrong, known @ ..])
                if message.starts_with("unknown field")
                    || message.starts_with("unknown variant") =>
            {
                let what = what
                    .replace("unknown field", "unknown key")
                    .replace("unknown variant", "unknown name");
                let help = match error::nearest(wrong, known) {
                    Some(near) => format!("did you mean `{near}`?"),
                    None => format!("known are: {}", known.join(", ")),
                };
                SceneError::new(what).help(help)
            }
            _ if message == "invalid type: sequence, expected a map" => {
                SceneError::new("a list, where each entry has a name")
                    .help("write `[materials.NAME]`, say, and not `[[materials]]`")
            }
            _ => SceneError::new(message),
        };
        match e.span() {
            Some(range) => self.at(error, range),
            None => error,
        }
    }
}
