//! The shaders of `fixtures/adversarial`, each made to break a promise, without a GPU: no check
//! finds a counterexample, and each text is written, or refused by a name.

use std::path::{Path, PathBuf};

use preshade_compiler::emit::{self, EmitError};
use preshade_compiler::recipe::Recipe;
use preshade_plan::pass::{Facts, Use};
use preshade_plan::plan_file::Target;
use preshade_validate::{Effort, validate};
use rayon::prelude::*;

use crate::fixtures_support::{original, recipes, root};

/// Files of each material.
fn fixtures() -> Vec<Vec<PathBuf>> {
    let entries = std::fs::read_dir(root().join("fixtures/adversarial")).unwrap();
    let mut found: Vec<Vec<PathBuf>> = entries
        .map(|entry| entry.unwrap().path())
        .filter_map(|path| match path.extension()?.to_str()? {
            "wgsl" => Some(vec![path]),
            "vert" => Some(vec![path.clone(), path.with_extension("frag")]),
            _ => None,
        })
        .filter(|files| cfg!(feature = "glsl") || files.len() == 1)
        .collect();
    found.sort();
    assert!(found.len() > 40, "{}", found.len());
    found
}

/// The targets that fail otherwise than by naming what they lack.
fn written(label: &str, plan: &preshade_plan::plan::Plan) -> Vec<String> {
    let written = |target| emit::emit(plan, &[target], &emit::Options::default());
    let errors = Target::GENERAL
        .into_iter()
        .filter_map(|target| written(target).err());
    errors
        .filter(|e| !matches!(e, EmitError::Inexpressible { .. }))
        .map(|e| format!("{label}: {e}"))
        .collect()
}

/// Each takes seconds: `make check` skips them.
mod slow {
    use super::*;

    #[test]
    fn no_promise_is_broken_and_each_text_is_written_or_refused_by_name() {
        let effort = Effort {
            inputs: 12,
            ..Effort::default()
        };
        let wrong: Vec<String> = fixtures()
            .par_iter()
            .flat_map_iter(|files| {
                let files: Vec<&Path> = files.iter().map(PathBuf::as_path).collect();
                let original = original(&files);
                let mut wrong = written(&original.material, &original);
                for recipe in recipes(&[Use::Snapshot, Use::Inject, Use::Validate]) {
                    let label = format!("{} by {recipe}", original.material);
                    let parsed = Recipe::parse_list(recipe).unwrap();
                    let variant = match parsed.apply(&original, &Facts::without_ties()) {
                        Ok(variant) => variant,
                        Err(refusal) if refusal.code == "internal" => {
                            wrong.push(format!("{label}: {refusal}"));
                            continue;
                        }
                        Err(_) => continue,
                    };
                    let checks = validate(&original, &variant, &effort);
                    let broken = checks.iter().filter(|check| check.verdict.is_broken());
                    wrong.extend(broken.map(|c| format!("{label}: {}: {}", c.promise, c.verdict)));
                    wrong.extend(written(&label, &variant));
                }
                wrong
            })
            .collect();
        assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    }
}
