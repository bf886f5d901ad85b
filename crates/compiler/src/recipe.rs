//! A recipe: passes with their parameters, in order. It is the schedule, separate from the
//! algorithm.

use std::fmt;

use preshade_geometry::{PASSES, pass_named};
use preshade_plan::pass::{AnyPass, Facts, Outcome, ParamError, Refusal, Refused};
use preshade_plan::plan::{Plan, Site};
use preshade_plan::refusals;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use shader_text::refusals::RefusalInfo;

use crate::parameters::{Parameter, parameters};
use shader_text::nearest::nearest;

/// One step: a pass, its parameters, and the code that it changes where the recipe pins that.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Step {
    /// Name of the pass.
    pub pass: String,
    /// Parameters that differ from the defaults.
    #[serde(default)]
    pub params: serde_json::Map<String, serde_json::Value>,
    /// The code that it changed when the recipe was recorded; `None`: not recorded.
    #[serde(default)]
    pub site: Option<Site>,
}

/// Steps, applied in order, each to the plan that the step before it made.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct Recipe {
    /// The steps.
    pub steps: Vec<Step>,
}

/// A recipe that cannot be read.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RecipeError {
    #[error("there is no pass `{name}`{}; the passes are: {}", several_or(.name, .nearest), names())]
    UnknownPass {
        name: String,
        nearest: Option<&'static str>,
    },
    /// A parameter names something that no material has.
    #[error("{pass}: {message}{}", suggestion(.nearest))]
    Misnamed {
        pass: String,
        message: String,
        nearest: Option<String>,
    },
    /// The text after the colon is not `key=value`.
    #[error("in `{text}`: expected `key=value` after the colon, found \
             `{found}`{}", several(.word_of, .found))]
    Syntax {
        text: String,
        /// The part that does not fit.
        found: String,
        /// The parameter that allows this word.
        word_of: Option<String>,
    },
    /// The pass has no parameter of that name.
    #[error("{pass} has no parameter `{name}`{}; it has: {known} (see `preshade passes \
             {pass}`)", suggestion(.nearest))]
    UnknownParameter {
        pass: &'static str,
        name: String,
        nearest: Option<String>,
        /// The names there are, separated by commas.
        known: String,
    },
    /// The parameter is a choice, and this is none of its words.
    #[error("{pass}: `{name}` cannot be `{value}`{}; it is one of: {known} (see `preshade passes \
             {pass}`)", suggestion(.nearest))]
    UnknownValue {
        pass: &'static str,
        name: String,
        value: String,
        nearest: Option<String>,
        /// The words there are, separated by commas.
        known: String,
    },
    /// The parameter is a number, and this is not.
    #[error("{pass}: `{name}` is {kind}, which `{value}` is not (see `preshade passes {pass}`)")]
    NotNumber {
        pass: &'static str,
        name: String,
        /// `a number` or `a whole number`.
        kind: &'static str,
        value: String,
    },
    /// The number is out of the parameter's bounds.
    #[error("{pass}: `{name}` is {range}, which {value} is not (see `preshade passes {pass}`)")]
    OutOfRange {
        pass: &'static str,
        name: String,
        /// The allowed numbers, in words.
        range: String,
        value: String,
    },
    /// A parameter is given twice.
    #[error("in `{text}`: `{name}` is given twice")]
    Twice { text: String, name: String },
    /// The values have the wrong type, or are out of range.
    #[error(transparent)]
    Params(#[from] ParamError),
}

fn suggestion(nearest: &Option<impl fmt::Display>) -> String {
    nearest
        .as_ref()
        .map(|n| format!(" (did you mean `{n}`?)"))
        .unwrap_or_default()
}

/// The suggestion for an unknown pass: several passes written as one, or another spelling.
fn several_or(name: &str, nearest: &Option<&'static str>) -> String {
    let steps: Vec<&str> = name.split([',', '+']).map(str::trim).collect();
    match steps.len() > 1 && steps.iter().all(|s| pass_named(s).is_some()) {
        true => format!(
            " (each pass is a step of its own: --pass {})",
            steps.join(" --pass ")
        ),
        false => suggestion(nearest),
    }
}

fn names() -> String {
    PASSES
        .iter()
        .map(|p| p.info().name)
        .collect::<Vec<_>>()
        .join(", ")
}

impl Step {
    /// Reads `NAME` or `NAME:key=value,key=value`, as on the command line.
    ///
    /// # Errors
    /// An unknown pass or parameter, with suggestions.
    pub fn parse(text: &str) -> Result<Self, RecipeError> {
        let (name, rest) = text.split_once(':').unwrap_or((text, ""));
        let name = name.trim();
        let pass = find(name)?;
        let mut params = serde_json::Map::new();
        for part in rest.split(',').map(str::trim).filter(|p| !p.is_empty()) {
            let Some((key, value)) = part.split_once('=') else {
                return Err(RecipeError::Syntax {
                    text: text.to_owned(),
                    found: part.to_owned(),
                    word_of: word_of(pass, part),
                });
            };
            let (key, value) = (key.trim(), value.trim());
            check(pass, key, value)?;
            if params.insert(key.to_owned(), scalar(value)).is_some() {
                return Err(RecipeError::Twice {
                    text: text.to_owned(),
                    name: key.to_owned(),
                });
            }
        }
        pass.complete(&serde_json::Value::Object(params.clone()))?;
        Ok(Self {
            pass: name.to_owned(),
            params,
            site: None,
        })
    }
}

/// Checks a parameter's name and value.
fn check(pass: &dyn AnyPass, name: &str, value: &str) -> Result<(), RecipeError> {
    let known = parameters(pass);
    let near = |word: &str, words: &[&str]| nearest(word, words.iter().copied()).map(str::to_owned);
    let Some(parameter) = known.iter().find(|p| p.name == name) else {
        let names: Vec<&str> = known.iter().map(|p| p.name.as_str()).collect();
        let listed = known.iter().filter(|p| !p.expert);
        let listed: Vec<&str> = listed.map(|p| p.name.as_str()).collect();
        return Err(RecipeError::UnknownParameter {
            pass: pass.info().name,
            name: name.to_owned(),
            nearest: near(name, &names),
            known: listed.join(", "),
        });
    };
    let kind = match parameter.kind.as_deref() {
        Some("integer") if value.parse::<i64>().is_err() => Some("a whole number"),
        Some("number") if value.parse::<f64>().is_err() => Some("a number"),
        _ => None,
    };
    if let Some(kind) = kind {
        return Err(RecipeError::NotNumber {
            pass: pass.info().name,
            name: name.to_owned(),
            kind,
            value: value.to_owned(),
        });
    }
    if let (Some(range), Ok(number)) = (parameter.range, value.parse::<f64>())
        && !range.contains(number)
    {
        return Err(RecipeError::OutOfRange {
            pass: pass.info().name,
            name: name.to_owned(),
            range: range.to_string(),
            value: value.to_owned(),
        });
    }
    let words: Vec<&str> = parameter.choices.iter().map(|c| c.value.as_str()).collect();
    if words.is_empty() || words.contains(&value) {
        return Ok(());
    }
    Err(RecipeError::UnknownValue {
        pass: pass.info().name,
        name: name.to_owned(),
        value: value.to_owned(),
        nearest: near(value, &words),
        known: words.join(", "),
    })
}

/// `true`, `12`, `0.5` or a word.
fn scalar(text: &str) -> serde_json::Value {
    match serde_json::from_str(text) {
        Ok(v @ (serde_json::Value::Bool(_) | serde_json::Value::Number(_))) => v,
        _ => serde_json::Value::String(text.to_owned()),
    }
}

fn find(name: &str) -> Result<&'static dyn AnyPass, RecipeError> {
    pass_named(name).ok_or_else(|| RecipeError::UnknownPass {
        name: name.to_owned(),
        nearest: nearest(name, PASSES.iter().map(|p| p.info().name)),
    })
}

/// The texts of the steps of [`Recipe::parse_list`].
pub(crate) fn split_list(text: &str) -> Vec<String> {
    let mut steps: Vec<String> = Vec::new();
    // ` + ` is how a recipe is printed. A `+` without spaces joins values.
    let parts = text.split(" + ").flat_map(|steps| steps.split(','));
    for part in parts {
        match steps.last_mut() {
            Some(step) if part.contains('=') && !part.contains(':') => {
                step.push(if step.contains(':') { ',' } else { ':' });
                step.push_str(part);
            }
            // A word in place of a step belongs to the pass before it, whose error suggests the
            // right form.
            Some(step) if step.contains('=') && is_word_of(step, part) => {
                step.push(',');
                step.push_str(part);
            }
            _ => steps.push(part.to_owned()),
        }
    }
    steps
}

/// Whether `part` is not a pass, but a word for a parameter of `step`.
fn is_word_of(step: &str, part: &str) -> bool {
    let pass = step.split(':').next().unwrap_or_default().trim();
    let word = part.trim();
    pass_named(word).is_none() && pass_named(pass).is_some_and(|p| word_of(p, word).is_some())
}

/// The parameter of a pass that `word` is a choice of.
fn word_of(pass: &dyn AnyPass, word: &str) -> Option<String> {
    let of = |p: &Parameter| p.choices.iter().any(|c| c.value == word);
    parameters(pass).into_iter().find(of).map(|p| p.name)
}

fn several(word_of: &Option<String>, word: &str) -> String {
    word_of.as_ref().map_or(String::new(), |name| {
        format!(
            "; `{word}` is a word of `{name}`: write {name}={word}, or several with slashes, \
             {name}=../{word}"
        )
    })
}

impl Recipe {
    /// Reads one step a string.
    ///
    /// # Errors
    /// As [`Step::parse`].
    pub fn parse<S: AsRef<str>>(steps: impl IntoIterator<Item = S>) -> Result<Self, RecipeError> {
        Ok(Self {
            steps: steps
                .into_iter()
                .map(|s| Step::parse(s.as_ref()))
                .collect::<Result<_, _>>()?,
        })
    }

    /// Reads steps separated by commas: `depth-prepass:form=equal,vertex=sliced,early-discard`. A
    /// part with an equals sign and no colon belongs to the step before it. The printed form of a
    /// [`Recipe`], with ` + ` between steps, is read too.
    ///
    /// # Errors
    /// As [`Step::parse`].
    pub fn parse_list(text: &str) -> Result<Self, RecipeError> {
        Self::parse(split_list(text))
    }

    /// The recipe as arguments of `rewrite`.
    pub fn as_passes(&self) -> String {
        let steps: Vec<String> = self.steps.iter().map(|s| format!("--pass {s}")).collect();
        steps.join(" ")
    }

    /// Checks the names among the parameters. A name is wrong only if every material lacks it. If
    /// some have it, the others refuse the step.
    ///
    /// # Errors
    /// [`RecipeError::Misnamed`].
    pub fn check_names(&self, plans: &[Plan]) -> Result<(), RecipeError> {
        for step in &self.steps {
            let Ok(pass) = find(&step.pass) else { continue };
            let params = serde_json::Value::Object(step.params.clone());
            let slips: Option<Vec<_>> = plans.iter().map(|p| pass.misnamed(p, &params)).collect();
            let slips = slips.unwrap_or_default();
            let Some(first) = slips.first() else { continue };
            let known = slips.iter().flat_map(|s| &s.known);
            // The last segments of a path are a name too.
            let known = known.flat_map(|path| {
                let ends = path.match_indices('.').map(|(at, _)| &path[at + 1..]);
                std::iter::once(path.as_str()).chain(ends)
            });
            return Err(RecipeError::Misnamed {
                pass: step.pass.clone(),
                message: first.message.clone(),
                nearest: nearest(&first.name, known).map(str::to_owned),
            });
        }
        Ok(())
    }
}

impl Step {
    /// Runs the pass. If the step names a site that is gone, it is refused as `stale`.
    pub(crate) fn run(&self, plan: &Plan, facts: &Facts) -> Result<Outcome, Refused> {
        let refuse = |code: &RefusalInfo, reason: String, remedy: &str| {
            Refused::from(vec![Refusal::new(&self.pass, code, reason, remedy)])
        };
        let pass = find(&self.pass)
            .map_err(|e| refuse(&refusals::UNKNOWN, e.to_string(), "name one of the passes"))?;
        let params = serde_json::Value::Object(self.params.clone());
        let outcome = pass.run(plan, facts, &params)?;
        match &self.site {
            Some(site) if *site != outcome.change.key => Err(refuse(
                &refusals::STALE,
                format!(
                    "the recipe was recorded for the slice {} of `{}`, which is no longer in the \
                     shader",
                    site.slice, site.entry_point
                ),
                "make the recipe anew",
            )),
            _ => Ok(outcome),
        }
    }
}

impl fmt::Display for Step {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.pass)?;
        for (i, (key, value)) in self.params.iter().enumerate() {
            let value = value
                .as_str()
                .map_or_else(|| value.to_string(), str::to_owned);
            write!(f, "{}{key}={value}", if i == 0 { ':' } else { ',' })?;
        }
        Ok(())
    }
}

impl fmt::Display for Recipe {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, step) in self.steps.iter().enumerate() {
            write!(f, "{}{step}", if i == 0 { "" } else { " + " })?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_printed_is_read() {
        let text = "hoist:budget=0.05,carry=ab.1+cd,tessellate:form=shared,level=3,depth-prepass";
        let recipe = Recipe::parse_list(text);
        let printed = recipe.as_ref().map(ToString::to_string).unwrap_or_default();
        assert!(printed.contains("carry=ab.1+cd + tessellate:"), "{printed}");
        assert_eq!(Recipe::parse_list(&printed).ok(), recipe.ok());
    }
}
