//! The recipes that are tried: those of the passes' examples that are for it.

use preshade_geometry::examples;
use preshade_plan::budget::{Budget, Metric};
use preshade_plan::pass::Use;

use preshade_compiler::recipe::{Recipe, RecipeError};
use preshade_compiler::sweep::{Sweep, SweepError};

/// The recipes to try. Under a budget there are more, which may change the picture.
///
/// # Errors
/// An example that does not parse: a bug.
pub fn recipes(budget: Option<Budget>) -> Result<Vec<Recipe>, RecipeError> {
    let within = budget.map(|budget| {
        // Passes with `MOST` only know the metric `max_abs`.
        let is_counted = move |r: &&str| !r.contains("MOST") || budget.metric == Metric::MaxAbs;
        let within = of(Use::PlanWithin).filter(is_counted);
        within.map(move |recipe| filled(recipe, budget))
    });
    // Among equally fast plans the first wins, so those that assume nothing about the scene lead.
    let mut plain: Vec<String> = of(Use::Plan).map(str::to_owned).collect();
    plain.sort_by_key(|recipe| recipe.starts_with("specialize"));
    plain
        .into_iter()
        .chain(within.into_iter().flatten())
        .map(|text| Recipe::parse_list(&text))
        .collect()
}

/// The recipes that `verify` draws if none is named.
///
/// # Errors
/// As [`recipes`].
pub fn by_default() -> Result<Vec<Sweep>, SweepError> {
    of(Use::Verify).map(Sweep::parse_list).collect()
}

/// Every recipe that a pass declares, each once.
///
/// # Errors
/// As [`recipes`].
pub fn every_pass() -> Result<Vec<Recipe>, RecipeError> {
    let mut all: Vec<Recipe> = Vec::new();
    for (text, _) in examples() {
        let recipe = Recipe::parse_list(&filled(text, BUDGET))?;
        if !all.contains(&recipe) {
            all.push(recipe);
        }
    }
    Ok(all)
}

/// The budget of [`every_pass`] in recipes that leave it to the user.
const BUDGET: Budget = Budget {
    metric: Metric::FlipMean,
    limit: 0.02,
};

fn of(wanted: Use) -> impl Iterator<Item = &'static str> {
    let used = examples().filter(move |(_, used)| **used == wanted);
    used.map(|(recipe, _)| recipe)
}

/// The recipe of an example with this budget in the places that are left to the user.
fn filled(recipe: &str, budget: Budget) -> String {
    let words = format!("budget={},metric={}", budget.limit, budget.metric);
    let most = budget.limit.to_string();
    recipe.replace("BUDGET", &words).replace("MOST", &most)
}
