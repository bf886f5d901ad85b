//! Every fixture material through every recipe, validated without a GPU: no promise of a variant
//! has a counterexample.

use std::collections::BTreeMap;

use preshade_compiler::recipe::Recipe;
use preshade_plan::pass::{Facts, Use};
use preshade_plan::plan::Role;
use preshade_validate::{Check, Effort, Verdict, validate};
use rayon::prelude::*;

use crate::fixtures_support::{materials, original, recipes};

/// The checks of every fixture by each of the recipes that applies to it, with their names.
fn checks(recipes: &[&str], effort: &Effort) -> Vec<(String, Check)> {
    materials()
        .par_iter()
        .filter(|files| cfg!(feature = "glsl") || files.len() == 1)
        .flat_map_iter(|files| {
            let files: Vec<_> = files.iter().map(std::path::PathBuf::as_path).collect();
            let original = original(&files);
            let mut checks = Vec::new();
            for recipe in recipes {
                let parsed = Recipe::parse_list(recipe).unwrap();
                let Ok(variant) = parsed.apply(&original, &Facts::without_ties()) else {
                    continue;
                };
                let name = format!("{} by {recipe}", original.material);
                let of = validate(&original, &variant, effort);
                checks.extend(of.into_iter().map(|check| (name.clone(), check)));
            }
            checks
        })
        .collect()
}

/// Each takes seconds: `make check` skips them.
mod slow {
    use super::*;

    #[test]
    fn no_recipe_breaks_a_promise_of_a_fixture() {
        let effort = Effort {
            inputs: 18,
            steps: 60_000,
            paths: 16,
            ..Effort::default()
        };
        let checks = checks(
            &recipes(&[Use::Snapshot, Use::Compile, Use::Validate]),
            &effort,
        );
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

    /// The resolve of every fixture that the visibility buffer splits is evaluated.
    #[test]
    fn every_resolve_of_a_fixture_is_evaluated() {
        let effort = Effort {
            inputs: 96,
            steps: 60_000,
            paths: 16,
            ..Effort::default()
        };
        let recipes = [
            "visibility-buffer:budget=0.05",
            "visibility-buffer:budget=0.05,select=id,vertices=kept",
        ];
        let mut checks = checks(&recipes, &effort);
        checks.retain(|(_, check)| [Role::Ids, Role::Resolve].contains(&check.role));
        let told = |(name, check): &(String, Check)| {
            let (role, promise) = (check.role.name(), &check.promise);
            format!("{name}, {role}: {promise}: {}", check.verdict)
        };
        let told_all: Vec<String> = checks.iter().map(told).collect();
        eprintln!("{}", told_all.join("\n"));
        let left = checks.iter().filter(|(_, check)| !check.verdict.holds());
        let left: Vec<String> = left.map(told).collect();
        assert!(left.is_empty(), "{}", left.join("\n"));
        let resolves = checks
            .iter()
            .filter(|(_, c)| c.promise.starts_with("colours"));
        assert!(resolves.count() >= 84);
    }
}
