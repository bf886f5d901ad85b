//! A report put together of variants that were measured in processes of their own.

use preshade_compiler::recipe::Recipe;
use preshade_draw::render::NOT_MEASURED;
use preshade_lab::measure::Verified;
use preshade_lab::measure::record::{Chosen, Report, Unfinished, VariantReport};
use preshade_plan::budget::Budget;
use preshade_plan::contract::{Contract, Verdict};
use shader_text::limits::Limits;

use crate::saved_results::Keeper;
use crate::{Failure, worker};

/// Measures the original in a process of its own, and then each of `recipes` beside it in another.
pub fn apart(
    recipes: &[Recipe],
    budget: Option<Budget>,
    limits: &Limits,
    keeper: &mut Keeper,
) -> Result<Verified, Failure> {
    let mut report = measured(0, limits).map_err(|why| {
        Failure(match why.contains(NOT_MEASURED) {
            true => why,
            false => format!("error: the original was not measured: {why}"),
        })
    })?;
    for (i, recipe) in recipes.iter().enumerate() {
        let variant = variant(&mut report, i, recipe, limits);
        report
            .variants
            .push(variant.unwrap_or_else(|why| not_measured(recipe, why)));
        let missing = recipes[i + 1..].iter().map(ToString::to_string).collect();
        keeper.keep_report(&Unfinished::new(report.clone(), missing));
    }
    report.chosen = budget.map(|b| Chosen::among(&report.variants, b));
    Ok(Verified {
        report,
        pictures: Vec::new(),
        lost: None,
    })
}

/// Measures in separate processes the variants that a run missed because it lost its adapter.
/// Measured variants remain.
pub fn resumed(
    mut outcome: Verified,
    recipes: &[Recipe],
    limits: &Limits,
    keeper: &mut Keeper,
) -> Verified {
    let is_missing = |v: &VariantReport| matches!(&v.verdict, Verdict::NotMeasured { why } if Some(why) == outcome.lost.as_ref());
    let missing: Vec<usize> = (0..outcome.report.variants.len())
        .filter(|i| outcome.report.variants.get(*i).is_some_and(is_missing))
        .collect();
    for i in missing {
        let found = match i.checked_sub(1) {
            None => measured(0, limits).and_then(|r| {
                let original = r.variants.into_iter().next();
                original.ok_or_else(|| "its report is empty".to_owned())
            }),
            Some(n) => match recipes.get(n) {
                Some(recipe) => variant(&mut outcome.report, n, recipe, limits),
                None => continue,
            },
        };
        let Some(place) = outcome.report.variants.get_mut(i) else {
            continue;
        };
        match found {
            Ok(variant) => *place = variant,
            Err(why) => {
                let before = outcome.lost.clone().unwrap_or_default();
                place.verdict = Verdict::NotMeasured {
                    why: format!("{before}; and in a process of its own {why}"),
                };
            }
        }
        keeper.keep_report(&Unfinished::new(outcome.report.clone(), Vec::new()));
    }
    outcome
}

fn measured(variant: usize, limits: &Limits) -> Result<Report, String> {
    let text = worker::run(variant, limits, worker::OF_A_VARIANT)?;
    worker::printed(&text)
}

/// The variant of a recipe, beside the original. What its pictures leave untested becomes a part of
/// `whole`, and is no longer a mere warning there.
fn variant(
    whole: &mut Report,
    index: usize,
    recipe: &Recipe,
    limits: &Limits,
) -> Result<VariantReport, String> {
    let report = measured(index + 1, limits)?;
    whole.warnings.retain(|w| !report.untested.contains(w));
    for untested in report.untested {
        if !whole.untested.contains(&untested) {
            whole.untested.push(untested);
        }
    }
    let variant = report.variants.into_iter().nth(1);
    variant.ok_or_else(|| format!("its report has no `{recipe}`"))
}

fn not_measured(recipe: &Recipe, why: String) -> VariantReport {
    let name = recipe.to_string();
    let verdict = Verdict::NotMeasured { why };
    VariantReport::new(&name, &name, Contract::exact(), verdict)
}
