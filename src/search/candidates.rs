//! The recipes that are tried: one table, so that you read them in one place.

use preshade_passes::budget::{Budget, Metric};
use preshade_passes::pass_named;

use crate::recipe::{Recipe, RecipeError};

/// Recipes that are exact, or that compute the same real numbers with other roundings.
const PLAIN: &[&str] = &[
    "depth-prepass",
    "depth-prepass:form=equal",
    "early-discard",
    "hoist",
    "hoist,depth-prepass",
    "visibility-buffer",
    "visibility-buffer:select=id",
    "visibility-buffer:form=compute",
    "specialize",
    "specialize,depth-prepass",
    "specialize,hoist",
    "specialize,hoist,depth-prepass",
    "specialize,visibility-buffer",
    "skip-taps:threshold=0",
    "specialize,skip-taps:threshold=0",
];

/// Further recipes under a budget. `BUDGET` becomes `budget=VALUE,metric=METRIC`. `MOST` becomes
/// the value alone, for passes that only know the metric `max_abs`.
const WITHIN_BUDGET: &[&str] = &[
    "hoist:BUDGET",
    "hoist:BUDGET,depth-prepass",
    "hoist:BUDGET,tessellate:form=shared,level=2",
    "hoist:BUDGET,tessellate:form=shared,level=4",
    "hoist:BUDGET,tessellate:form=shared,level=8",
    "skip-taps:BUDGET",
    "skip-taps:BUDGET,depth-prepass",
    "specialize,skip-taps:BUDGET",
    "specialize,hoist:BUDGET",
    "specialize,hoist:BUDGET,depth-prepass",
    "trim-loop:BUDGET",
    "visibility-buffer:budget=MOST",
    "visibility-buffer:select=id,budget=MOST",
    "visibility-buffer:form=compute,budget=MOST",
];

/// The recipes to try. Recipes with a pass that this build lacks are left out.
///
/// # Errors
///
/// A recipe of the table that does not parse: a bug.
pub fn recipes(budget: Option<Budget>) -> Result<Vec<Recipe>, RecipeError> {
    let exists = |text: &&&str| {
        let pass = |step: &str| step.split(':').next().unwrap_or_default().to_owned();
        // A part with an equals sign and no colon belongs to the step before it.
        let steps = text
            .split(',')
            .filter(|s| s.contains(':') || !s.contains('='));
        steps.map(pass).all(|name| pass_named(&name).is_some())
    };
    let within = budget.map(|budget| {
        let words = format!("budget={},metric={}", budget.limit, budget.metric);
        let most = budget.limit.to_string();
        let is_counted = move |r: &&&str| !r.contains("MOST") || budget.metric == Metric::MaxAbs;
        WITHIN_BUDGET
            .iter()
            .filter(is_counted)
            .map(move |r| r.replace("BUDGET", &words).replace("MOST", &most))
    });
    PLAIN
        .iter()
        .filter(exists)
        .map(|r| (*r).to_owned())
        .chain(within.into_iter().flatten())
        .map(|text| Recipe::parse_list(&text))
        .collect()
}
