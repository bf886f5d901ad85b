//! The search for the frontier: what it finds is beaten by nothing it measured, it goes on where it
//! ended, and its page needs nothing else.

use std::ops::ControlFlow;
use std::path::Path;
use std::time::Duration;

use preshade_compiler::recipe::Recipe;
use preshade_draw::scene::Scene;
use preshade_lab::search::explore::{
    Ended, Explored, Fate, Journal, Point, SearchStage, Settings, explore,
};
use preshade_lab::{measure, report};
use preshade_plan::budget::Metric;
use preshade_plan::contract::Verdict;
use preshade_scenes::ShaderForm;

use crate::render_support::gpu;

fn scene(name: &str) -> Scene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fixtures/scenes")
        .join(format!("{name}.toml"));
    preshade_scenes::load(&path).unwrap().resized([163, 91])
}

fn settings(recipes: &[&str]) -> Settings {
    Settings {
        form: ShaderForm::Text,
        metric: Metric::FlipMean,
        budget: None,
        recipes: recipes
            .iter()
            .map(|r| Recipe::parse_list(r).unwrap())
            .collect(),
        // No test waits for a clock: far more than it takes.
        time: Duration::from_secs(900),
        most: 12,
        finalists: 4,
        frames_per_camera: 2,
        seed: 1,
        command: "preshade explore <script>alert(1)</script>".to_owned(),
    }
}

fn search(
    scene: &Scene,
    settings: &Settings,
    journal: &mut Journal,
) -> (Explored, Vec<SearchStage>) {
    let mut stages = Vec::new();
    let found = explore(gpu(), scene, settings, journal, &mut |p| {
        if stages.last() != Some(&p.stage) {
            stages.push(p.stage);
        }
        ControlFlow::Continue(())
    });
    (found.unwrap(), stages)
}

/// What a search over the built-in space has to keep, whatever the clock said.
fn check(found: &Explored) {
    let e = &found.exploration;
    let on = |name: &String| e.points.iter().find(|p| p.name == *name).unwrap();
    let frontier: Vec<&Point> = e.frontier.iter().map(on).collect();
    assert!(!frontier.is_empty());
    for p in &frontier {
        assert_eq!(p.fate, Fate::Frontier, "{}", p.name);
        for q in frontier.iter().filter(|q| q.name != p.name) {
            let (a, b) = (p.error.as_ref().unwrap(), q.error.as_ref().unwrap());
            let beats = e.metric.of(b) <= e.metric.of(a)
                && q.speedup.unwrap().low > p.speedup.unwrap().high;
            assert!(!beats, "{} is beaten by {}", p.name, q.name);
        }
    }
    for point in &e.points {
        match &point.fate {
            Fate::Beaten { by } | Fate::Even { with: by } | Fate::Same { r#as: by } => {
                assert!(e.points.iter().any(|p| p.name == *by), "{by}");
            }
            Fate::Frontier
            | Fate::Unverified { .. }
            | Fate::Refused { .. }
            | Fate::Predicted { .. }
            | Fate::Slow { .. } => {}
            Fate::Broken { why } | Fate::NotMeasured { why } => {
                assert!(
                    why.contains("were drawn before it"),
                    "{}: {why}",
                    point.name
                );
            }
        }
    }
    let report = e.report.as_ref().unwrap();
    let held = report.variants.iter().all(|v| v.verdict == Verdict::Holds);
    assert!(
        held,
        "{:?}",
        report
            .variants
            .iter()
            .map(|v| &v.verdict)
            .collect::<Vec<_>>()
    );
}

#[test]
fn a_noisy_grid_has_a_frontier_of_its_approximations() {
    let scene = scene("noise-grid-16");
    let (found, stages) = search(&scene, &settings(&[]), &mut Journal::new());
    check(&found);
    assert_eq!(found.exploration.ended, Ended::Complete);
    assert!(stages.contains(&SearchStage::Racing) && stages.contains(&SearchStage::Verifying));
    // Something approximate was drawn, and its error is that of its pictures.
    let points = &found.exploration.points;
    let approximate = points
        .iter()
        .filter(|p| p.prediction.is_some() && p.error.is_some());
    assert!(approximate.clone().count() > 0);
    for point in approximate {
        assert!(
            point.error.as_ref().unwrap().flip_mean > 0.0,
            "{}",
            point.name
        );
    }
    // The least error of the frontier is none: nothing exact is lost.
    let first = &found.exploration.frontier[0];
    let first = points.iter().find(|p| p.name == *first).unwrap();
    assert_eq!(first.error.as_ref().unwrap().flip_mean, 0.0);
}

#[test]
fn a_second_search_draws_nothing_again_and_finds_the_same_errors() {
    let scene = scene("overdraw-5");
    let settings = settings(&[
        "depth-prepass",
        "early-discard",
        "hoist:budget=1,threshold=1",
    ]);
    let dir = std::env::temp_dir().join(format!("preshade-explore-{}", std::process::id()));
    let _ = std::fs::remove_dir_all(&dir);
    let path = dir.join("measured.jsonl");
    let first = search(&scene, &settings, &mut Journal::open(&path).unwrap()).0;
    let errors = |text: &str| text.lines().filter(|l| l.contains("\"error\"")).count();
    let before = errors(&std::fs::read_to_string(&path).unwrap());
    assert!(before > 0);
    let second = search(&scene, &settings, &mut Journal::open(&path).unwrap()).0;
    let after = errors(&std::fs::read_to_string(&path).unwrap());
    assert_eq!(before, after, "an error was measured again");
    for (a, b) in first
        .exploration
        .points
        .iter()
        .zip(&second.exploration.points)
    {
        assert_eq!((&a.name, &a.error), (&b.name, &b.error));
    }
    // Another size is another scene.
    let other = scene.resized([80, 60]);
    search(&other, &settings, &mut Journal::open(&path).unwrap());
    assert!(errors(&std::fs::read_to_string(&path).unwrap()) > after);
    std::fs::remove_dir_all(&dir).unwrap();
}

#[test]
fn what_is_stopped_tells_what_it_has() {
    let scene = scene("overdraw-5");
    let settings = settings(&["depth-prepass", "early-discard"]);
    let mut drawings = 0;
    let found = explore(gpu(), &scene, &settings, &mut Journal::new(), &mut |p| {
        drawings += usize::from(p.stage == SearchStage::Drawing);
        match drawings {
            0..2 => ControlFlow::Continue(()),
            _ => ControlFlow::Break(()),
        }
    });
    let exploration = found.unwrap().exploration;
    assert_eq!(exploration.ended, Ended::Stopped);
    assert_eq!(exploration.points.len(), 3);
    assert_eq!(
        exploration.points[1].error.as_ref().unwrap().changed_pixels,
        0
    );
    let why = "the search was stopped".to_owned();
    assert_eq!(exploration.points[2].fate, Fate::NotMeasured { why });
    assert!(report::frontier::table(&exploration).contains("Stopped after"));
}

#[test]
fn the_page_stands_alone_and_escapes_what_it_is_told() {
    let scene = scene("overdraw-5");
    let settings = settings(&["depth-prepass", "early-discard:quad=vote"]);
    let (found, _) = search(&scene, &settings, &mut Journal::new());
    check(&found);
    let page =
        report::html::explore::page(&found, &scene, &measure::effects(&scene).unwrap()).unwrap();
    // No scheme but that of its own pictures, no script but its own.
    for outside in [
        "http://", "https://", "//cdn", "@import", "<link", " src=\"/",
    ] {
        assert!(!page.contains(outside), "{outside}");
    }
    assert!(!page.contains("<script>alert"));
    assert_eq!(page.matches("<script").count(), 2);
    assert!(page.contains("&#60;script&#62;alert") || page.contains("&lt;script&gt;alert"));
    // What it carries as data is the report.
    let data = page.split("id=\"data\">").nth(1).unwrap();
    let data: serde_json::Value =
        serde_json::from_str(data.split("</script>").next().unwrap()).unwrap();
    assert_eq!(data, serde_json::to_value(&found.exploration).unwrap());
    // Every finalist has its pictures, and something to compare its text by.
    assert!(!found.variants.is_empty());
    assert_eq!(page.matches("data-cut>").count(), found.variants.len());
    assert!(page.matches("<pre class=\"diff\"").count() >= found.variants.len());
    let csv = report::frontier::csv(&found.exploration);
    assert_eq!(csv.lines().count(), found.exploration.points.len() + 1);
}
