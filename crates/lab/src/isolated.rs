//! A report put together of variants that were measured in processes of their own.

use crate::measure::Verified;
use crate::measure::record::{Chosen, Report, Unfinished, VariantReport};
use preshade_compiler::recipe::Recipe;
use preshade_draw::render::NOT_MEASURED;
use preshade_plan::budget::Budget;
use preshade_plan::contract::{Contract, Verdict};

/// Measures a variant against the original in a process of its own. The number selects the recipe,
/// from 1; 0 is the original alone.
pub type Alone<'a> = &'a dyn Fn(usize) -> Result<Report, String>;

/// Measures the original, and then each of `recipes` against it. `keep` gets the results so far.
///
/// # Errors
/// Why the original was not measured.
pub fn apart(
    recipes: &[Recipe],
    budget: Option<Budget>,
    alone: Alone<'_>,
    keep: &mut dyn FnMut(&Unfinished),
) -> Result<Verified, String> {
    let mut report = alone(0).map_err(|why| match why.contains(NOT_MEASURED) {
        true => why,
        false => format!("error: the original was not measured: {why}"),
    })?;
    for (i, recipe) in recipes.iter().enumerate() {
        let variant = variant(&mut report, i, recipe, alone);
        report
            .variants
            .push(variant.unwrap_or_else(|why| not_measured(recipe, why)));
        let missing = recipes[i + 1..].iter().map(ToString::to_string).collect();
        keep(&Unfinished::new(report.clone(), missing));
    }
    report.chosen = budget.map(|b| Chosen::among(&report.variants, b));
    Ok(Verified {
        report,
        pictures: Vec::new(),
        lost: None,
    })
}

/// Measures the variants that a run missed because it lost its adapter. Measured variants remain.
pub fn resumed(
    mut outcome: Verified,
    recipes: &[Recipe],
    alone: Alone<'_>,
    keep: &mut dyn FnMut(&Unfinished),
) -> Verified {
    let lost = outcome.lost.clone().unwrap_or_default();
    let is_missing =
        |v: &VariantReport| matches!(&v.verdict, Verdict::NotMeasured { why } if *why == lost);
    let variants = outcome.report.variants.iter().enumerate();
    let missing = variants.filter(|(_, v)| is_missing(v)).map(|(i, _)| i);
    for i in missing.collect::<Vec<_>>() {
        let found = match i.checked_sub(1) {
            None => alone(0).and_then(|r| {
                let original = r.variants.into_iter().next();
                original.ok_or_else(|| "its report is empty".to_owned())
            }),
            Some(n) => match recipes.get(n) {
                Some(recipe) => variant(&mut outcome.report, n, recipe, alone),
                None => continue,
            },
        };
        let place = &mut outcome.report.variants[i];
        match found {
            Ok(variant) => *place = variant,
            Err(why) => {
                place.verdict = Verdict::NotMeasured {
                    why: format!("{lost}; and in a process of its own {why}"),
                };
            }
        }
        keep(&Unfinished::new(outcome.report.clone(), Vec::new()));
    }
    outcome
}

/// The variant of a recipe, measured against the original. Moves the reasons why its pictures test
/// too little from the warnings of `whole` to `whole.untested`.
fn variant(
    whole: &mut Report,
    index: usize,
    recipe: &Recipe,
    alone: Alone<'_>,
) -> Result<VariantReport, String> {
    let report = alone(index + 1)?;
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
