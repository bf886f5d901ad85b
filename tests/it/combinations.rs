//! Recipes of random passes in random order, on all fixture materials: all compose or refuse.

use preshade_geometry::examples;
use preshade_plan::pass::Use;
use preshade_plan::plan::Plan;
use preshade_plan::state::CompareFunction;
use preshade_validate::Effort;

use crate::combinations_support::combinations;
use crate::fixtures_support::{materials, original, root};

/// Each takes seconds: `make check` skips them.
mod slow {
    use super::*;

    /// As many with `PRESHADE_COMBINATIONS=10000`, from the first seed on.
    #[test]
    fn random_recipes_compose_or_refuse() {
        let count = std::env::var("PRESHADE_COMBINATIONS")
            .ok()
            .and_then(|n| n.parse().ok())
            .unwrap_or(1000);
        // Each pass meets the material of its own page, because some fit few others.
        let pages = examples().filter_map(|(_, used)| match used {
            Use::Page(file) => Some(vec![
                root().join("fixtures").join(file).with_extension("wgsl"),
            ]),
            _ => None,
        });
        let pages: Vec<Vec<std::path::PathBuf>> = pages.collect();
        let of = |files: Vec<std::path::PathBuf>| {
            let files: Vec<_> = files.iter().map(std::path::PathBuf::as_path).collect();
            original(&files)
        };
        // `half-rate` wants a draw that no depth decides.
        let full_screen = pages.clone().into_iter().map(of).map(|mut plan| {
            for depth in plan.passes.iter_mut().filter_map(|p| p.depth.as_mut()) {
                depth.compare = CompareFunction::Always;
                depth.write = false;
            }
            plan
        });
        let drawn = materials().into_iter().chain(pages).map(of);
        let originals: Vec<Plan> = drawn.chain(full_screen).collect();
        let effort = Effort {
            inputs: 6,
            steps: 40_000,
            paths: 4,
            ..Effort::default()
        };
        let tally = combinations(&originals, 0..count, &effort);
        assert!(tally.wrong.is_empty(), "{}", tally.wrong.join("\n"));
        assert_eq!(tally.combinations, count);
        // They are not all refused, and every pass is among those that are not.
        assert!(tally.refused_whole < count / 2, "{tally:#?}");
        assert_eq!(
            tally.accepted.len(),
            preshade_geometry::PASSES.len(),
            "{tally:#?}"
        );
    }
}
