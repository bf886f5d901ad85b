//! Metamorphic tests with pictures: shaders of the fixture scenes with code written into them that
//! changes nothing (`passes/tests/it/metamorphic.rs` tries the same without a GPU), drawn as they
//! are and as transforms make of them, against the shader without.

use std::collections::BTreeMap;
use std::path::Path;

use preshade_compiler::front::{self, Source};
use preshade_compiler::recipe::Recipe;
use preshade_draw::scene::{DrawOrder, Scene};
use preshade_geometry::examples;
use preshade_lab::measure::record::VariantReport;
use preshade_lab::measure::{self, Session, Settings, Timed, TimingSettings, Variant, verify};
use preshade_plan::contract::Verdict;
use preshade_plan::pass::Use;
use preshade_scenes::ShaderForm;
use shader_text::options::Options;

use crate::metamorphic_support::injection;
use crate::render_support::gpu;

/// Scenes whose materials loop, discard, sample and call.
const SCENES: [&str; 5] = ["simple", "shrine", "strata", "two-sided", "gallery"];

/// The one in which a transform finds what it is for: materials whose own values decide branches.
const DECIDED: (&str, &str) = ("gallery", "specialize");

/// Each transform, and in how many pictures at least its promise has to hold.
fn recipes() -> impl Iterator<Item = (&'static str, usize)> {
    examples().filter_map(|(recipe, used)| match used {
        Use::Pictures(least) => Some((recipe, *least)),
        _ => None,
    })
}

fn scene(name: &str) -> Scene {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/scenes");
    let scene = preshade_scenes::load(&folder.join(name).with_extension("toml"));
    let mut scene = scene.unwrap().resized([61, 43]);
    scene.orders = vec![DrawOrder::BackToFront];
    scene.cameras.truncate(1);
    scene.cameras[0].frames.truncate(1);
    scene
}

/// The scene with injections in each of its shaders, as `change` leaves them; and how many shaders
/// that are.
fn injected(scene: &Scene, seed: u64, change: impl Fn(String) -> String) -> (Scene, usize) {
    let (mut scene, mut count) = (scene.clone(), 0);
    for material in &mut scene.materials {
        let files = material.program.sources().files();
        let [file] = files else { continue };
        let text = change(injection(&file.text, seed, 8));
        let source = Source::new("injected.wgsl", text.clone());
        let parsed = front::parse(&[source], &Options::default());
        let parsed = parsed
            .unwrap_or_else(|e| panic!("{}\n{text}", e.render(shader_text::error::Color::Never)));
        material.program = parsed.program;
        count += 1;
    }
    (scene, count)
}

/// The scene drawn against what recipes make of another one with its draws.
fn drawn(scene: &Scene, other: &Scene, recipes: &[&str]) -> Vec<VariantReport> {
    let facts = measure::facts(&Session::new(gpu(), scene, ShaderForm::Text).unwrap()).unwrap();
    let originals = measure::originals(other);
    let as_written = Variant {
        name: "as written".to_owned(),
        recipe: String::new(),
        plans: originals.clone(),
        kept: Vec::new(),
    };
    let recipes = recipes.iter().map(|r| Recipe::parse_list(r).unwrap());
    let variants = recipes.map(|r| measure::variant(&originals, &r, &facts));
    let variants: Vec<Variant> = [as_written].into_iter().chain(variants).collect();
    let settings = Settings {
        timed: Timed::No,
        timing: TimingSettings::default(),
        frames_per_camera: 1,
        command: String::new(),
    };
    let outcome = verify(
        &Session::new(gpu(), scene, ShaderForm::Text).unwrap(),
        &variants,
        &settings,
        &mut |_| {},
    )
    .unwrap();
    outcome.report.variants.into_iter().skip(1).collect()
}

/// As many seeds a scene as `PRESHADE_METAMORPHIC` says; one without it.
#[test]
fn what_changes_nothing_changes_no_picture() {
    let seeds: u64 = std::env::var("PRESHADE_METAMORPHIC")
        .ok()
        .and_then(|n| n.parse().ok())
        .unwrap_or(1);
    let (mut shaders, mut pictures, mut wrong) = (0, BTreeMap::new(), Vec::new());
    for name in SCENES {
        let scene = scene(name);
        for seed in 0..seeds {
            let (other, count) = injected(&scene, seed, |text| text);
            shaders += count;
            let of_scene = recipes().map(|(recipe, _)| recipe);
            let of_scene: Vec<&str> = of_scene
                .filter(|r| (name == DECIDED.0) == (*r == DECIDED.1))
                .collect();
            let variants = drawn(&scene, &other, &of_scene);
            for (variant, recipe) in variants.iter().zip(["as written"].iter().chain(&of_scene)) {
                let what = format!("{name}, seed {seed}, {recipe}");
                match &variant.verdict {
                    Verdict::Holds => *pictures.entry(*recipe).or_insert(0) += 1,
                    Verdict::Broken { r#where } => wrong.push(format!("{what}: {}", r#where)),
                    // An `equal` pre-pass is about an original that is @invariant where the
                    // author's is not.
                    Verdict::NotMeasured { why } if why.contains("@invariant") => {}
                    // A refusal is an answer.
                    Verdict::NotMeasured { why } if why == "every material refuses it" => {}
                    Verdict::NotMeasured { why } => wrong.push(format!("{what}: {why}")),
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(shaders >= 6, "{shaders}");
    for (recipe, least) in recipes().chain([("as written", 5)]) {
        let drawn = pictures.get(recipe).copied().unwrap_or(0);
        assert!(drawn >= least, "{recipe}: {drawn} pictures of {pictures:?}");
    }
}

/// The test of the test: with predicates that are not what they are taken for the pictures change.
#[test]
fn what_changes_something_is_seen() {
    let scene = scene("simple");
    let (other, _) = injected(&scene, 0, |text| {
        let text = text.replace("meta_one: i32 = 1", "meta_one: i32 = 2");
        text.replace("meta_zero: f32 = 0.0", "meta_zero: f32 = 1.0")
    });
    let found = drawn(&scene, &other, &["depth-prepass"]);
    let broken = |v: &VariantReport| matches!(v.verdict, Verdict::Broken { .. });
    assert!(found.iter().all(broken), "{found:#?}");
}
