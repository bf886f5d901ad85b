//! Taps of no weight left out, drawn: hex tiling loses no pixel, and what samples at implicit
//! levels keeps its budget.

use std::path::Path;

use preshade_compiler::recipe::Recipe;
use preshade_lab::measure::record::VariantReport;
use preshade_lab::measure::{self, Session, Settings, Timed, TimingSettings};
use preshade_plan::contract::Verdict;
use preshade_plan::pass::Facts;
use preshade_scenes::ShaderForm;

use crate::render_support::gpu;

fn verified(name: &str, recipes: &[&str]) -> Vec<VariantReport> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fixtures/scenes")
        .join(format!("{name}.toml"));
    let mut scene = preshade_scenes::load(&path).unwrap().resized([160, 90]);
    scene.orders.truncate(1);
    let originals = measure::originals(&scene);
    let variant = |recipe: &&str| {
        let recipe = Recipe::parse_list(recipe).unwrap();
        measure::variant(&originals, &recipe, &Facts::without_ties())
    };
    let variants: Vec<_> = recipes.iter().map(variant).collect();
    let settings = Settings {
        timed: Timed::No,
        timing: TimingSettings::default(),
        frames_per_camera: 2,
        command: String::new(),
    };
    let outcome = measure::verify(
        &Session::new(gpu(), &scene, ShaderForm::Text).unwrap(),
        &variants,
        &settings,
        &mut |_| {},
    )
    .unwrap();
    outcome.report.variants.into_iter().skip(1).collect()
}

/// Three copies of a texture with gradients of their own: those of no weight are no part of the
/// sum.
#[test]
fn hex_tiling_without_the_copies_that_weigh_nothing() {
    let recipes = [
        "skip-taps:threshold=0",
        "skip-taps:threshold=0.05,budget=0.02",
        "skip-taps:threshold=0.05,budget=0.02,depth-prepass",
    ];
    let [nothing, little, composed] = &verified("shrine", &recipes)[..] else {
        panic!("three variants");
    };
    assert_eq!(nothing.verdict, Verdict::Holds);
    assert_eq!(nothing.error.as_ref().unwrap().changed_pixels, 0);
    for report in [little, composed] {
        assert_eq!(report.verdict, Verdict::Holds, "{}", report.recipe);
        let error = report.error.as_ref().unwrap();
        assert!(error.changed_pixels > 0 && error.changed_depth == 0);
        // Each of three terms may be off by the threshold.
        assert!(error.max_abs < 0.15, "{}", error.max_abs);
    }
    assert_eq!(little.error, composed.error);
}

/// Gradients taken ahead make levels that llvmpipe rounds otherwise: hence a budget, which is kept.
#[test]
fn sides_that_face_away_are_not_sampled() {
    let recipes = ["skip-taps:threshold=0,budget=0.01"];
    let report = &verified("terrain-triplanar", &recipes)[0];
    assert_eq!(report.verdict, Verdict::Holds, "{:?}", report.kept);
    assert!(report.kept.is_empty(), "{:?}", report.kept);
    assert!(report.error.as_ref().unwrap().max_abs < 0.02);
}
