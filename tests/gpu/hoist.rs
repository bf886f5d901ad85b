//! What hoisting promises, drawn: nothing changes, the last bit changes, or the budget is kept on
//! every frame of a path.

use std::ops::ControlFlow;
use std::path::Path;

use preshade_compiler::recipe::Recipe;
use preshade_draw::scene::Scene;
use preshade_lab::measure::record::VariantReport;
use preshade_lab::measure::{self, Session, Settings, Timed, TimingSettings};
use preshade_plan::contract::Verdict;
use preshade_plan::pass::{Facts, Source};
use preshade_scenes::ShaderForm;

use crate::render_support::gpu;

fn scene(name: &str) -> Scene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fixtures/scenes")
        .join(format!("{name}.toml"));
    let scene = preshade_scenes::load(&path).unwrap();
    scene.resized([163, 91])
}

fn verified(scene: &Scene, recipe: &Recipe, facts: &Facts) -> VariantReport {
    let variant = measure::variant(&measure::originals(scene), recipe, facts);
    let settings = Settings {
        timed: Timed::No,
        timing: TimingSettings::default(),
        frames_per_camera: 5,
        command: String::new(),
    };
    let outcome = measure::verify(
        &Session::new(gpu(), scene, ShaderForm::Text).unwrap(),
        &[variant],
        &settings,
        &mut |_| {},
    )
    .unwrap();
    outcome.report.variants.into_iter().nth(1).unwrap()
}

/// Scenes of which some material has work that moves without a budget.
const UNBUDGETED: [&str; 4] = ["gbuffer", "instanced", "strata", "vertex-pulling"];

#[test]
fn without_a_budget_at_most_the_last_bit_changes() {
    let recipe = Recipe::parse(["hoist"]).unwrap();
    let mut rounded = 0;
    for name in UNBUDGETED {
        let scene = scene(name);
        let facts = Facts {
            ranges: measure::ranges(&scene).unwrap(),
            ..Facts::default()
        };
        let report = verified(&scene, &recipe, &facts);
        assert_eq!(report.verdict, Verdict::Holds, "{name}");
        let error = report.error.unwrap();
        assert!(error.max_abs <= 1.0 / 255.0 + 1e-9, "{name}");
        assert_eq!(error.changed_depth, 0, "{name}");
        rounded += usize::from(report.contract.kind() == "rounding");
    }
    assert_eq!(rounded, 1, "`strata` is there to be rounded");
}

#[test]
fn an_exact_hoist_changes_no_pixel() {
    let recipe = Recipe::parse(["hoist:allow=exact"]).unwrap();
    let mut drawn = 0;
    for name in UNBUDGETED {
        let report = verified(&scene(name), &recipe, &Facts::default());
        if matches!(report.verdict, Verdict::NotMeasured { .. }) {
            continue;
        }
        drawn += 1;
        assert_eq!(report.verdict, Verdict::Holds, "{name}");
        let error = report.error.unwrap();
        assert_eq!(error.changed_pixels, 0, "{name}");
    }
    assert!(drawn >= 3, "only {drawn} scenes have anything exact");
}

#[test]
fn a_budget_is_kept_on_frames_the_choice_was_not_made_on() {
    let (name, budget) = ("terrain-triplanar", 0.02);
    let mut scene = scene(name);
    // The path alone.
    let path = scene.cameras.pop().unwrap();
    assert!(path.frames.len() > 5, "{name}");
    scene.cameras = vec![path];
    let mut facts =
        measure::facts(&Session::new(gpu(), &scene, ShaderForm::Text).unwrap()).unwrap();
    facts.frequencies = measure::frequencies(
        &Session::new(gpu(), &scene, ShaderForm::Text).unwrap(),
        &facts,
        measure::Detail::Choice,
        &mut |_| ControlFlow::Continue(()),
    )
    .unwrap();
    assert!(!facts.frequencies.is_empty(), "{name}");
    // A picture as small as the test's has hardly more fragments than vertices; choose as for a
    // large one.
    facts.vertices_per_fragment = Some(0.01);
    let open = Recipe::parse([format!("hoist:budget={budget}")]).unwrap();
    let chosen = measure::within_budget(
        &Session::new(gpu(), &scene, ShaderForm::Text).unwrap(),
        &open,
        &facts,
    )
    .unwrap()
    .unwrap();
    let report = verified(&scene, &chosen, &facts);
    assert_eq!(report.verdict, Verdict::Holds, "{name}: {chosen}");
    let error = report.error.unwrap();
    assert!(error.changed_pixels > 0, "{name}: nothing was hoisted");
    assert!(error.flip_mean <= budget, "{name}: {}", error.flip_mean);
}

/// Where no value keeps the budget the refusal names the least error there is.
#[test]
fn noise_that_bends_within_a_triangle_is_refused_with_the_number() {
    let scene = scene("noise-grid-16");
    let facts = Facts {
        frequencies: measure::frequencies(
            &Session::new(gpu(), &scene, ShaderForm::Text).unwrap(),
            &Facts::default(),
            measure::Detail::Choice,
            &mut |_| ControlFlow::Continue(()),
        )
        .unwrap(),
        ..Facts::default()
    };
    let open = Recipe::parse(["hoist:budget=0.02"]).unwrap();
    let chosen = measure::within_budget(
        &Session::new(gpu(), &scene, ShaderForm::Text).unwrap(),
        &open,
        &facts,
    )
    .unwrap()
    .unwrap();
    let variant = measure::variant(&measure::originals(&scene), &chosen, &facts);
    let [kept] = &variant.kept[..] else {
        panic!("{:?}", variant.kept)
    };
    assert!(
        kept.why.contains("has the smallest error, 0."),
        "{}",
        kept.why
    );
}

/// A number packed into bytes stays where nothing was measured, whatever the budget. Interpolated
/// all the same, by the user's word, the picture is another.
#[test]
fn what_is_packed_into_bytes_is_not_interpolated() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/hoist/packed.toml");
    let scene = preshade_scenes::load(&path).unwrap();
    let report = |recipe: &str| {
        let recipe = Recipe::parse([recipe]).unwrap();
        verified(&scene, &recipe, &Facts::default())
    };
    let carried = report("hoist:budget=1,finite=assumed,jumps=carried");
    let error = carried.error.unwrap();
    assert!(error.max_abs > 0.5, "{}", error.max_abs);
    let kept = report("hoist:budget=1,finite=assumed");
    assert!(
        matches!(kept.verdict, Verdict::NotMeasured { .. }),
        "{:?}",
        kept.verdict
    );
}

/// Ranges are those of the scene's own numbers: strata's colours, and its world, which the box and
/// the sphere fill.
#[test]
fn a_scene_tells_between_which_numbers_it_lies() {
    let ranges = measure::ranges(&scene("strata")).unwrap();
    let of = |source: &Source| {
        let found = ranges.iter().find(|r| r.source == *source);
        let found = found.unwrap_or_else(|| panic!("{source:?}: {ranges:#?}"));
        assert_eq!(found.material, "rock");
        [found.low, found.high]
    };
    let member = |name: &str| Source::Buffer {
        group: 1,
        binding: 0,
        member: Some(name.to_owned()),
    };
    assert_eq!(of(&member("low")), [0.14, 0.42]);
    assert_eq!(of(&member("turned")), [-0.6, 1.0]);
    let [low, high] = of(&Source::Varying { location: 0 });
    // The sphere reaches 1.3 + 0.7, the box's turned corner -0.8 - 1.1 cos 30 - 0.9 sin 30.
    assert!((high - 2.0).abs() < 0.02, "{high}");
    assert!((low + 2.2026).abs() < 0.001, "{low}");
}
