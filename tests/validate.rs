//! Every fixture material through every recipe, validated without a GPU: no promise of a variant has a counterexample.
#![allow(clippy::unwrap_used, clippy::panic, missing_docs)]

use std::collections::BTreeMap;

use preshade::passes::pass::Facts;
use preshade::passes::validate::{Effort, Verdict, validate};
use preshade::recipe::Recipe;

mod fixtures_support;
use fixtures_support::{COMPOSED, RECIPES, materials, original};

/// Recipes that the support has not.
const MORE: [&str; 5] = [
    "trim-loop:budget=0.1",
    "hoist:allow=rounding",
    "hoist:budget=0.02,finite=assumed,depth-prepass:form=equal",
    "hoist:budget=0.02,finite=assumed,early-discard",
    "visibility-buffer",
];

#[test]
fn no_recipe_breaks_a_promise_of_a_fixture() {
    let effort = Effort {
        inputs: 18,
        steps: 60_000,
        paths: 16,
        ..Effort::default()
    };
    let mut kinds: BTreeMap<&str, usize> = BTreeMap::new();
    let mut reasons: BTreeMap<String, usize> = BTreeMap::new();
    let mut broken = Vec::new();
    for files in materials() {
        let files: Vec<_> = files.iter().map(std::path::PathBuf::as_path).collect();
        if cfg!(not(feature = "glsl")) && files.len() > 1 {
            continue;
        }
        let original = original(&files);
        for recipe in RECIPES.into_iter().chain(COMPOSED).chain(MORE) {
            let parsed = Recipe::parse_list(recipe).unwrap();
            let Ok(variant) = parsed.apply(&original, &Facts::without_ties()) else {
                continue;
            };
            let start = std::time::Instant::now();
            for check in validate(&original, &variant, &effort) {
                let kind = match &check.verdict {
                    Verdict::Proved { .. } => "proved",
                    Verdict::Agreed { .. } => "agreed",
                    Verdict::Counterexample(_) => "broken",
                    Verdict::NotEvaluable { why } => {
                        *reasons.entry(why.clone()).or_default() += 1;
                        "not evaluated"
                    }
                };
                *kinds.entry(kind).or_default() += 1;
                if check.verdict.is_broken() {
                    broken.push(format!(
                        "{} by {recipe}, {}: {}: {}",
                        original.material,
                        check.role.name(),
                        check.promise,
                        check.verdict
                    ));
                }
            }
            if start.elapsed().as_secs() > 1 {
                eprintln!("{} {recipe} {:?}", original.material, start.elapsed());
            }
        }
    }
    eprintln!("{kinds:?}\n{reasons:#?}");
    assert!(broken.is_empty(), "{}", broken.join("\n"));
    assert!(kinds["proved"] > 400 && kinds["agreed"] > 100, "{kinds:?}");
}
