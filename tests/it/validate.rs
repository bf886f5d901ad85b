//! Every fixture material through every recipe, validated without a GPU: no promise of a variant
//! has a counterexample.

use std::collections::BTreeMap;

use preshade::unstable::passes::pass::{Facts, Use};
use preshade::unstable::passes::validate::{Check, Effort, Verdict, validate};
use preshade::unstable::recipe::Recipe;
use rayon::prelude::*;

use crate::fixtures_support::{materials, original, recipes};

#[test]
fn no_recipe_breaks_a_promise_of_a_fixture() {
    let effort = Effort {
        inputs: 18,
        steps: 60_000,
        paths: 16,
        ..Effort::default()
    };
    let checks: Vec<(String, Check)> = materials()
        .par_iter()
        .filter(|files| cfg!(feature = "glsl") || files.len() == 1)
        .flat_map_iter(|files| {
            let files: Vec<_> = files.iter().map(std::path::PathBuf::as_path).collect();
            let original = original(&files);
            let mut checks = Vec::new();
            for recipe in recipes(&[Use::Snapshot, Use::Compile, Use::Validate]) {
                let parsed = Recipe::parse_list(recipe).unwrap();
                let Ok(variant) = parsed.apply(&original, &Facts::without_ties()) else {
                    continue;
                };
                let name = format!("{} by {recipe}", original.material);
                let of = validate(&original, &variant, &effort);
                checks.extend(of.into_iter().map(|check| (name.clone(), check)));
            }
            checks
        })
        .collect();
    let mut kinds: BTreeMap<&str, usize> = BTreeMap::new();
    let mut reasons: BTreeMap<String, usize> = BTreeMap::new();
    let mut broken = Vec::new();
    for (name, check) in checks {
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
            let (role, promise) = (check.role.name(), &check.promise);
            broken.push(format!("{name}, {role}: {promise}: {}", check.verdict));
        }
    }
    eprintln!("{kinds:?}\n{reasons:#?}");
    assert!(broken.is_empty(), "{}", broken.join("\n"));
    assert!(kinds["proved"] > 400 && kinds["agreed"] > 100, "{kinds:?}");
}
