//! A device that is lost in the middle: what was measured stands, what was not says so, and another
//! device goes on.

use std::ops::ControlFlow;
use std::path::Path;
use std::time::Duration;

use preshade_compiler::recipe::Recipe;
use preshade_draw::render::{AdapterChoice, Gpu};
use preshade_draw::scene::{DrawOrder, Scene};
use preshade_lab::measure::record::Unfinished;
use preshade_lab::measure::{self, Detail, Session, Settings, Timed, TimingSettings, verify};
use preshade_lab::search::explore::{
    Ended, Fate, Journal, SearchStage, Settings as Search, explore,
};
use preshade_plan::budget::Metric;
use preshade_plan::contract::Verdict;
use preshade_plan::pass::Facts;
use preshade_scenes::ShaderForm;

/// One of its own: it is lost.
fn gpu() -> Gpu {
    Gpu::new(&AdapterChoice::Best).unwrap()
}

fn scene() -> Scene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/scenes/simple.toml");
    let mut scene = preshade_scenes::load(&path).unwrap().resized([64, 48]);
    scene.orders = vec![
        DrawOrder::BackToFront,
        DrawOrder::FrontToBack,
        DrawOrder::AsGiven,
    ];
    scene.cameras.truncate(1);
    scene
}

const LOST: &str = "the cable is out";

fn untimed() -> Settings {
    Settings {
        timed: Timed::No,
        timing: TimingSettings::default(),
        frames_per_camera: 1,
        command: String::new(),
    }
}

#[test]
fn verify_keeps_the_views_before_and_names_those_after() {
    let (gpu, scene) = (gpu(), scene());
    let originals = measure::originals(&scene);
    let recipe = Recipe::parse(["depth-prepass"]).unwrap();
    let variants = [measure::variant(&originals, &recipe, &Facts::default())];
    let settings = untimed();
    let mut kept: Vec<Unfinished> = Vec::new();
    let outcome = verify(
        &Session::new(&gpu, &scene, ShaderForm::Text).unwrap(),
        &variants,
        &settings,
        &mut |p| {
            if let Some(so_far) = p.so_far {
                kept.push(*so_far);
                gpu.pretend_lost(LOST);
            }
        },
    );
    let outcome = outcome.unwrap();
    let why = outcome.lost.unwrap();
    assert!(why.contains(LOST), "{why}");
    // One view of three was drawn; each is in what was kept on the way, with the other two by name.
    let [first] = &kept[..] else {
        panic!("{} views were kept", kept.len())
    };
    assert_eq!(first.missing.len(), 2, "{:?}", first.missing);
    assert!(first.missing[1].contains("as-given") || first.missing[1].contains("as given"));
    for variant in &first.report.variants {
        assert_eq!(variant.by_view.len(), 1);
    }
    assert_eq!(first.report.variants[1].by_view[0].error.changed_pixels, 0);
    let text = serde_json::to_string(first).unwrap();
    assert_eq!(&serde_json::from_str::<Unfinished>(&text).unwrap(), first);
    for variant in &outcome.report.variants {
        assert_eq!(variant.by_view.len(), 1, "{}", variant.name);
        assert_eq!(variant.verdict, Verdict::NotMeasured { why: why.clone() });
    }
    // Another device goes on.
    let again = verify(
        &Session::new(&self::gpu(), &scene, ShaderForm::Text).unwrap(),
        &variants,
        &settings,
        &mut |_| (),
    )
    .unwrap();
    assert_eq!(again.lost, None);
    assert_eq!(again.report.variants[1].verdict, Verdict::Holds);
    assert_eq!(again.report.variants[1].by_view.len(), 3);
}

#[test]
fn a_loss_while_variants_are_built_is_told_as_one() {
    let (gpu, scene) = (gpu(), scene());
    let session = Session::new(&gpu, &scene, ShaderForm::Text).unwrap();
    let variants = ["depth-prepass", "early-discard"].map(|recipe| {
        let recipe = Recipe::parse([recipe]).unwrap();
        measure::variant(session.originals(), &recipe, &Facts::default())
    });
    let mut built = 0;
    let found = verify(&session, &variants, &untimed(), &mut |p| {
        built += usize::from(p.what.starts_with("compiling"));
        if built == 2 {
            gpu.pretend_lost(LOST);
        }
    });
    let found = found.unwrap();
    assert!(found.lost.unwrap().contains(LOST));
    for variant in &found.report.variants {
        assert!(variant.by_view.is_empty(), "{variant:?}");
        let is_open = matches!(variant.verdict, Verdict::NotMeasured { .. });
        assert!(is_open, "{variant:?}");
    }
}

#[test]
fn a_loss_after_the_views_is_told_as_one() {
    for (recipe, what) in [
        ("shadow", "under the light"),
        ("outputs", "auxiliary pictures"),
    ] {
        let (gpu, scene) = (gpu(), scene());
        let session = Session::new(&gpu, &scene, ShaderForm::Text).unwrap();
        let recipe = Recipe::parse([recipe]).unwrap();
        let variant = measure::variant(session.originals(), &recipe, &Facts::default());
        let found = verify(&session, &[variant], &untimed(), &mut |p| {
            if p.what.contains(what) {
                gpu.pretend_lost(LOST);
            }
        });
        let found = found.unwrap();
        let why = found.lost.unwrap();
        assert!(why.contains(LOST), "{recipe}: {why}");
        let variant = &found.report.variants[1];
        assert_eq!(variant.by_view.len(), 3, "{recipe}");
        assert_eq!(variant.verdict, Verdict::NotMeasured { why });
    }
}

#[test]
fn explore_keeps_what_it_drew_and_goes_on_with_another_device() {
    let (gpu, scene) = (gpu(), scene());
    let dir = std::env::temp_dir().join(format!("preshade-lost-{}", std::process::id()));
    let _ = std::fs::remove_dir_all(&dir);
    let path = dir.join("measured.jsonl");
    let recipes = [
        "depth-prepass",
        "early-discard",
        "depth-prepass:bias-slope=3",
    ];
    let settings = Search {
        form: ShaderForm::Text,
        metric: Metric::FlipMean,
        budget: None,
        recipes: recipes
            .iter()
            .map(|r| Recipe::parse_list(r).unwrap())
            .collect(),
        time: Duration::from_secs(900),
        most: 12,
        finalists: 2,
        frames_per_camera: 1,
        seed: 1,
        command: String::new(),
    };
    let mut journal = Journal::open(&path).unwrap();
    let found = explore(&gpu, &scene, &settings, &mut journal, &mut |p| {
        if p.stage == SearchStage::Drawing && p.what.contains("drawing 2") {
            gpu.pretend_lost(LOST);
        }
        ControlFlow::Continue(())
    });
    let exploration = found.unwrap().exploration;
    assert!(
        matches!(&exploration.ended, Ended::Lost { why } if why.contains(LOST)),
        "{:?}",
        exploration.ended
    );
    // The original, one that was drawn, and two that say why not.
    let missing = |fate: &Fate| matches!(fate, Fate::NotMeasured { .. });
    let points = &exploration.points;
    assert_eq!(points.len(), 4);
    assert_eq!(points[1].error.as_ref().unwrap().changed_pixels, 0);
    assert!(missing(&points[2].fate) && missing(&points[3].fate));
    drop(journal);
    let mut journal = Journal::open(&path).unwrap();
    assert_eq!(journal.missing().len(), 2, "{:?}", journal.missing());
    let found = explore(&self::gpu(), &scene, &settings, &mut journal, &mut |_| {
        ControlFlow::Continue(())
    });
    let exploration = found.unwrap().exploration;
    assert_eq!(exploration.ended, Ended::Complete);
    assert!(exploration.points[1..].iter().all(|p| p.error.is_some()));
    assert!(journal.missing().is_empty(), "{:?}", journal.missing());
    std::fs::remove_dir_all(&dir).unwrap();
}

#[test]
fn a_loss_while_values_are_measured_is_no_value_without_measurement() {
    let gpu = gpu();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/scenes/teapot-specular.toml");
    let scene = preshade_scenes::load(&path).unwrap().resized([64, 48]);
    let session = Session::new(&gpu, &scene, ShaderForm::Text).unwrap();
    let facts = Facts::without_ties();
    let mut asked = 0;
    let found = measure::frequencies(&session, &facts, Detail::Choice, &mut |_| {
        asked += 1;
        if asked == 2 {
            gpu.pretend_lost(LOST);
        }
        ControlFlow::Continue(())
    });
    assert!(found.is_err_and(|error| error.is_lost()));
    assert_eq!(asked, 2);
}
