//! Variables of a scene. Sweeps set them.

use std::collections::BTreeMap;

use serde::Deserialize;

use preshade_draw::scene::SceneError;

#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(untagged, expecting = "a whole number, or a name")]
pub enum Variable {
    Number(u32),
    Name(String),
}

impl Variable {
    /// Parses a command line argument.
    pub fn parse(text: &str) -> Self {
        match text.replace('_', "").parse() {
            Ok(number) => Self::Number(number),
            Err(_) => Self::Name(text.to_owned()),
        }
    }
}

pub type Variables = BTreeMap<String, Variable>;

/// The scene's variables with the given ones replaced.
///
/// # Errors
/// The scene has no variable of that name.
pub(super) fn set(own: &Variables, given: &Variables) -> Result<Variables, SceneError> {
    let mut all = own.clone();
    for (name, value) in given {
        match all.get_mut(name) {
            Some(slot) => *slot = value.clone(),
            None => {
                return Err(
                    SceneError::new(format!("the scene has no variable `{name}`"))
                        .suggest(name, own.keys().map(String::as_str)),
                );
            }
        }
    }
    Ok(all)
}

/// The value of the variable that `text` names as `$name`.
pub(super) fn get<'v>(variables: &'v Variables, text: &str) -> Result<&'v Variable, SceneError> {
    let Some(name) = text.strip_prefix('$') else {
        return Err(SceneError::new(format!("`{text}` is no value here"))
            .help("a variable is written with a dollar sign, \"$instances\" say"));
    };
    variables.get(name).ok_or_else(|| {
        SceneError::new(format!("there is no variable `{name}`"))
            .suggest(name, variables.keys().map(String::as_str))
    })
}

/// A value, or the name of a variable.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged, expecting = "a value, or the \"$name\" of a variable")]
pub(super) enum Setting<T> {
    Value(T),
    Variable(String),
}

impl<T: Default> Default for Setting<T> {
    fn default() -> Self {
        Self::Value(T::default())
    }
}

impl Setting<u32> {
    pub(super) fn number(&self, variables: &Variables) -> Result<u32, SceneError> {
        match self {
            Self::Value(value) => Ok(*value),
            Self::Variable(name) => match get(variables, name)? {
                Variable::Number(number) => Ok(*number),
                Variable::Name(text) => Err(SceneError::new(format!(
                    "the variable `{}` is `{text}`, and a whole number is asked for",
                    name.trim_start_matches('$')
                ))),
            },
        }
    }
}
