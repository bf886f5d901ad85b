//! A recipe with ranges: each combination of their values is a recipe of its own.
//!
//! `tessellate:level=1..8` is eight recipes (both ends count), `tessellate:form=pulled/shared` is
//! two, and `form=all` is one for each word that the parameter allows. A range works for any
//! whole-number parameter of any pass, and words work for any choice.

use preshade_geometry::pass_named;
use serde_json::Value;

use crate::parameters::{Parameter, parameters};
use crate::recipe::{self, Recipe, RecipeError};

/// Most recipes one sweep may stand for.
pub(crate) const MOST: usize = 256;

#[derive(Clone, Debug, PartialEq)]
pub struct Sweep {
    /// As the user wrote it.
    pub text: String,
    /// The parameters that vary, in the order of the text.
    pub axes: Vec<Axis>,
    /// Every combination; the last axis varies fastest.
    pub points: Vec<Point>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Axis {
    pub pass: String,
    pub parameter: String,
    pub kind: AxisKind,
}

/// The kind of an axis's values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AxisKind {
    /// Whole numbers, which can be the axis of a plot.
    Range,
    Words,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// The value on each axis.
    pub values: Vec<String>,
    pub recipe: Recipe,
}

/// A sweep that cannot be read.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SweepError {
    /// A recipe in it cannot be read.
    #[error(transparent)]
    Recipe(#[from] RecipeError),
    /// A range of a parameter that is not a whole number.
    #[error("{pass}: `{parameter}` takes no range: it is not a whole number")]
    NotWhole { pass: String, parameter: String },
    /// `8..1`, or an end that is not a number.
    #[error("`{text}` is not a range: write `1..8`, the smaller end first")]
    Range { text: String },
    /// It has more combinations than a sweep may have.
    #[error(
        "`{text}` stands for {count} recipes; the most is {MOST}: shorten a range, or name one \
         word of a choice (form=shared)"
    )]
    TooMany { text: String, count: usize },
}

impl Sweep {
    /// Reads steps separated by commas, as [`Recipe::parse_list`] does, with ranges. Without
    /// ranges, the sweep has one point and no axis.
    ///
    /// # Errors
    /// As [`Step::parse`](recipe::Step::parse), and for an invalid range.
    pub fn parse_list(text: &str) -> Result<Self, SweepError> {
        Self::of(text.to_owned(), recipe::split_list(text))
    }

    /// Reads one step a string.
    ///
    /// # Errors
    /// As [`Sweep::parse_list`].
    pub fn parse_steps(steps: &[String]) -> Result<Self, SweepError> {
        Self::of(steps.join(","), steps.to_vec())
    }

    fn of(text: String, steps: Vec<String>) -> Result<Self, SweepError> {
        let mut axes = Vec::new();
        // Each combination so far: the values on the axes, and the steps as text.
        let mut combinations = vec![(Vec::new(), Vec::new())];
        for step in &steps {
            let (pass, rest) = step.split_once(':').unwrap_or((step, ""));
            for (_, texts) in &mut combinations {
                texts.push(pass.to_owned());
            }
            let mut separator = ':';
            for part in rest.split(',').filter(|p| !p.trim().is_empty()) {
                let varied = varied(pass.trim(), part)?;
                let (values, axis) = match varied {
                    Some((axis, values)) => (values, Some(axis)),
                    None => (vec![part.to_owned()], None),
                };
                if values.len().saturating_mul(combinations.len()) > MOST {
                    return Err(SweepError::TooMany {
                        text,
                        count: values.len().saturating_mul(combinations.len()),
                    });
                }
                combinations = combinations
                    .into_iter()
                    .flat_map(|c| values.iter().map(move |v| (c.clone(), v)))
                    .map(|((mut on, mut texts), value)| {
                        if let Some(last) = texts.last_mut() {
                            last.push(separator);
                            match &axis {
                                Some(axis) => {
                                    on.push(value.clone());
                                    last.push_str(&format!("{}={value}", axis.parameter));
                                }
                                None => last.push_str(value),
                            }
                        }
                        (on, texts)
                    })
                    .collect();
                axes.extend(axis);
                separator = ',';
            }
        }
        let points = combinations
            .into_iter()
            .map(|(values, steps)| {
                let recipe = Recipe::parse(steps)?;
                Ok(Point { values, recipe })
            })
            .collect::<Result<_, RecipeError>>()?;
        Ok(Self { text, axes, points })
    }

    pub fn varies(&self) -> bool {
        !self.axes.is_empty()
    }
}

/// The values of `part`, which is `key=value`, if it has a range.
fn varied(pass: &str, part: &str) -> Result<Option<(Axis, Vec<String>)>, SweepError> {
    let Some((name, value)) = part.split_once('=') else {
        return Ok(None);
    };
    let (name, value) = (name.trim(), value.trim());
    let known = pass_named(pass).map(parameters).unwrap_or_default();
    // The recipe reports unknown names.
    let Some(parameter) = known.iter().find(|p| p.name == name) else {
        return Ok(None);
    };
    let axis = |kind| Axis {
        pass: pass.to_owned(),
        parameter: name.to_owned(),
        kind,
    };
    if let Some((low, high)) = value.split_once("..") {
        if parameter.kind.as_deref() != Some("integer") {
            return Err(SweepError::NotWhole {
                pass: pass.to_owned(),
                parameter: name.to_owned(),
            });
        }
        let ends = low.trim().parse::<u32>().ok().zip(high.trim().parse().ok());
        let values = match ends {
            Some((low, high)) if low <= high => low..=high,
            _ => {
                return Err(SweepError::Range {
                    text: value.to_owned(),
                });
            }
        };
        if values.clone().count() > MOST {
            return Err(SweepError::TooMany {
                text: part.to_owned(),
                count: values.count(),
            });
        }
        let values = values.map(|v| v.to_string()).collect();
        return Ok(Some((axis(AxisKind::Range), values)));
    }
    Ok(words(parameter, value).map(|words| (axis(AxisKind::Words), words)))
}

/// The words of `a/b`, or all there are for `all`.
fn words(parameter: &Parameter, value: &str) -> Option<Vec<String>> {
    let known = || parameter.choices.iter().map(|c| c.value.clone());
    if parameter.choices.is_empty() || known().any(|w| w == value) {
        return None;
    }
    if value == "all" {
        return Some(known().collect());
    }
    let parts: Vec<String> = value.split('/').map(|w| w.trim().to_owned()).collect();
    (parts.len() > 1).then_some(parts)
}

/// Parameters that a sweep of `tessellate` on `hoist` needs: without a budget, nothing is hoisted.
const UNDER_TESSELLATE: [&str; 4] = ["budget=1", "finite=assumed", "jumps=carried", "threshold=1"];

/// `steps` with the parameters that a swept `tessellate` needs, if any are missing. The `hoist` before
/// it gets a budget that allows any error, since a sweep measures each point. `tessellate` is drawn
/// in all its forms.
pub fn completed(steps: &[String]) -> Option<Vec<String>> {
    let name = |step: &str| step.split(':').next().unwrap_or_default().trim().to_owned();
    let is_swept = |s: &String| name(s) == "tessellate" && s.contains("..");
    let swept = steps.iter().position(is_swept)?;
    let under = steps[..swept].iter().rposition(|s| name(s) == "hoist")?;
    let has = |step: &str, key: &str| {
        let rest = step.split_once(':').map_or("", |(_, rest)| rest);
        let mut pairs = rest.split(',').filter_map(|p| p.split_once('='));
        pairs.any(|(k, _)| k.trim() == key)
    };
    let key = |part: &str| part.split('=').next().unwrap_or_default().to_owned();
    let mut all = steps.to_vec();
    let mut add = |step: usize, part: &str| {
        if !has(&all[step], &key(part)) {
            let separator = if all[step].contains(':') { ',' } else { ':' };
            all[step] = format!("{}{separator}{part}", all[step]);
        }
    };
    if !has(&steps[under], "budget") {
        UNDER_TESSELLATE.iter().for_each(|part| add(under, part));
    }
    add(swept, "form=all");
    (all != steps).then_some(all)
}

/// The value of a point as a number, if it is one.
pub fn number(value: &str) -> Option<f64> {
    match serde_json::from_str(value) {
        Ok(Value::Number(n)) => n.as_f64(),
        _ => None,
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::panic)]
mod tests {
    use super::*;

    fn recipes(text: &str) -> Vec<String> {
        let sweep = Sweep::parse_list(text).unwrap_or_else(|e| panic!("{e}"));
        let points = sweep.points.iter();
        points.map(|p| p.recipe.to_string()).collect()
    }

    #[test]
    fn a_range_is_its_numbers_both_ends_among_them() {
        assert_eq!(
            recipes("hoist:budget=1,tessellate:level=2..4"),
            [
                "hoist:budget=1 + tessellate:level=2",
                "hoist:budget=1 + tessellate:level=3",
                "hoist:budget=1 + tessellate:level=4",
            ]
        );
    }

    #[test]
    fn the_last_axis_varies_fastest() {
        let sweep = Sweep::parse_list("tessellate:pattern=gl/uniform,level=1..2").unwrap();
        let values: Vec<_> = sweep.points.iter().map(|p| p.values.join(" ")).collect();
        assert_eq!(values, ["gl 1", "gl 2", "uniform 1", "uniform 2"]);
        let kinds: Vec<_> = sweep.axes.iter().map(|a| a.kind).collect();
        assert_eq!(kinds, [AxisKind::Words, AxisKind::Range]);
    }

    #[test]
    fn all_is_every_word() {
        let all = recipes("depth-prepass:form=all");
        assert!(all.len() > 1, "{all:?}");
        assert!(
            all.contains(&"depth-prepass:form=equal".to_owned()),
            "{all:?}"
        );
    }

    #[test]
    fn without_a_range_it_is_one_recipe() {
        let sweep = Sweep::parse_list("depth-prepass:form=equal,early-discard").unwrap();
        assert!(!sweep.varies());
        assert_eq!(sweep.points.len(), 1);
    }

    #[test]
    fn what_is_no_range_is_told() {
        let error = |text: &str| Sweep::parse_list(text).unwrap_err().to_string();
        assert!(error("tessellate:level=8..1").contains("smaller end first"));
        assert!(error("tessellate:level=1..x").contains("not a range"));
        assert!(error("hoist:budget=0..1").contains("takes no range"));
        assert!(error("tessellate:level=1..4000000000").contains("most is 256"));
        assert!(error("tessellate:level=1..200,form=all").contains("most is 256"));
        assert!(error("tessellate:form=pulled/shred").contains("did you mean `shared`"));
        assert!(error("tessellate:form=pulled,shared").contains("form=../shared"));
        assert!(error("hoist:budget=1,tessellate:form=pulled,shared").contains("form=../shared"));
        assert!(error("depth-prepass:form=equal,shadw").contains("did you mean `shadow`"));
    }

    #[test]
    fn a_swept_tessellate_gets_the_parameters_it_needs() {
        let completed = |steps: &[&str]| {
            let steps: Vec<String> = steps.iter().map(|s| (*s).to_owned()).collect();
            completed(&steps).map(|steps| steps.join(" "))
        };
        assert_eq!(
            completed(&["shadow", "hoist", "tessellate:level=1..8"]).unwrap(),
            "shadow hoist:budget=1,finite=assumed,jumps=carried,threshold=1 \
             tessellate:level=1..8,form=all"
        );
        assert_eq!(
            completed(&["hoist:budget=0.1", "tessellate:level=1..8"]).unwrap(),
            "hoist:budget=0.1 tessellate:level=1..8,form=all"
        );
        assert_eq!(
            completed(&["hoist:budget=1", "tessellate:level=1..8,form=pulled"]),
            None
        );
        assert_eq!(completed(&["hoist", "tessellate"]), None);
        assert_eq!(completed(&["early-discard", "tessellate:level=1..8"]), None);
    }
}
