//! The recipes that are tried: those of the passes' examples that are for it.

use preshade_geometry::examples;
use preshade_plan::budget::{Budget, Metric};
use preshade_plan::pass::Use;

use preshade_compiler::recipe::{Recipe, RecipeError};

/// The recipes to try. Under a budget there are more, which may change the picture.
///
/// # Errors
///
/// An example that does not parse: a bug.
pub fn recipes(budget: Option<Budget>) -> Result<Vec<Recipe>, RecipeError> {
    let of = |wanted: Use| {
        let used = examples().filter(move |(_, used)| **used == wanted);
        used.map(|(recipe, _)| recipe)
    };
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

/// The recipe of an example with this budget in the places that are left to the user.
pub fn filled(recipe: &str, budget: Budget) -> String {
    let words = format!("budget={},metric={}", budget.limit, budget.metric);
    let most = budget.limit.to_string();
    recipe.replace("BUDGET", &words).replace("MOST", &most)
}
