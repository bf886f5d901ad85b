//! Random recipes on all fixture materials, and pictures of some on the fixture scenes: how many
//! are as promised.
//!
//! ```text
//! cargo run --release --all-features --example combinations -- --modules 10000 --pictures 500 --seed 1 [--adapter TEXT]
//! cargo run --release --all-features --example combinations -- --modules 0 --pictures 1 --first 32000050
//! ```
//!
//! The tables go to stdout as JSON. A module is wrong that does not validate, a text that does not
//! read back, a promise that has a counterexample, a picture of an `exact` or `rounding` plan that
//! `verify` finds to break it. Told apart: a picture over the user's budget, for nothing was
//! measured when its plan was made, and telling so is what `verify` is for; and one of a plan whose
//! parameters say of the adapter what it was seen not to do, which is what its promise rests on by
//! name. `--first` says the first seed by itself; scenes, recipes and all else follow from a seed.
#![allow(
    clippy::unwrap_used,
    clippy::panic,
    reason = "a tool that ends with a message"
)]

use std::collections::BTreeMap;
use std::path::PathBuf;

use preshade_compiler::recipe::Recipe;
use preshade_draw::render::{AdapterChoice, Gpu};
use preshade_draw::scene::{DrawOrder, Scene};
use preshade_geometry::visibility_buffer;
use preshade_lab::measure::{self, Session, Settings, Timed, TimingSettings};
use preshade_plan::contract::{Contract, Verdict};
use preshade_plan::pass::Facts;
use preshade_plan::plan::Plan;
use preshade_scenes::ShaderForm;
use preshade_validate::Effort;
use preshade_validate::inputs::Random;

#[path = "../tests/it/combinations_support/mod.rs"]
mod combinations_support;
#[path = "../tests/support/fixtures_support.rs"]
mod fixtures_support;

use combinations_support::{Tally, combinations, recipe};
use fixtures_support::{materials, original, root};

/// Not a multiple of the quad or of any tile.
const SIZE: [u32; 2] = [97, 61];

#[derive(Default, serde::Serialize)]
struct Pictures {
    adapter: String,
    /// Scenes drawn with a recipe that at least one of its materials took, steps that it did not
    /// take left out.
    drawn: u64,
    /// Of these by the kind of the weakest contract of the scene's plans.
    by_contract: BTreeMap<String, u64>,
    /// Those whose verdict is that they hold, by that kind.
    held: BTreeMap<String, u64>,
    /// Over the budget that the recipe gave, and told to be.
    over_budget: Vec<String>,
    /// Outside of a promise that rests on an adapter that does otherwise than this one was seen to
    /// do, and told to.
    of_another_adapter: Vec<String>,
    /// Not drawn, and why.
    not_measured: Vec<String>,
    /// What must not be.
    wrong: Vec<String>,
}

#[derive(serde::Serialize)]
struct Report {
    seed: u64,
    modules: Tally,
    pictures: Pictures,
}

fn argument(name: &str) -> Option<String> {
    let mut arguments = std::env::args().skip_while(|a| a != name);
    arguments.nth(1)
}

fn number(name: &str, default: u64) -> u64 {
    argument(name).map_or(default, |n| {
        n.parse().unwrap_or_else(|_| panic!("{name} {n}"))
    })
}

fn main() {
    let (modules, pictures, seed) = (
        number("--modules", 10_000),
        number("--pictures", 500),
        number("--seed", 1),
    );
    let originals: Vec<Plan> = materials()
        .iter()
        .map(|files| {
            let files: Vec<_> = files.iter().map(PathBuf::as_path).collect();
            original(&files)
        })
        .collect();
    let effort = Effort {
        inputs: 18,
        ..Effort::default()
    };
    let first = number("--first", seed * 1_000_000);
    let tally = combinations(&originals, first..first + modules, &effort);
    eprintln!(
        "{} modules, {} wrong",
        tally.combinations,
        tally.wrong.len()
    );
    let pictures = match pictures {
        0 => Pictures::default(),
        _ => drawn(pictures, first),
    };
    let report = Report {
        seed,
        modules: tally,
        pictures,
    };
    println!("{}", serde_json::to_string_pretty(&report).unwrap());
    if !(report.modules.wrong.is_empty() && report.pictures.wrong.is_empty()) {
        std::process::exit(1);
    }
}

/// The scenes, small, one frame of each camera.
fn scenes() -> Vec<(String, Scene)> {
    let folder = root().join("fixtures/scenes");
    let mut paths: Vec<PathBuf> = std::fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().path())
        .filter(|p| p.extension().is_some_and(|e| e == "toml"))
        .collect();
    paths.sort();
    let load = |path: &PathBuf| {
        let scene = preshade_scenes::load(path).unwrap_or_else(|e| panic!("{}", e.render()));
        let mut scene = scene.resized(SIZE);
        for camera in &mut scene.cameras {
            camera.frames.truncate(1);
        }
        scene.orders = vec![DrawOrder::BackToFront, DrawOrder::AsGiven];
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        (name, scene)
    };
    paths.iter().map(load).collect()
}

fn drawn(count: u64, first: u64) -> Pictures {
    let adapter = argument("--adapter").map_or(AdapterChoice::Best, AdapterChoice::Matching);
    let gpu = Gpu::new(&adapter).unwrap_or_else(|e| panic!("{e}"));
    let scenes = scenes();
    let mut facts: BTreeMap<usize, Facts> = BTreeMap::new();
    let mut told = Pictures {
        adapter: gpu.adapter().name.clone(),
        ..Pictures::default()
    };
    let settings = Settings {
        timed: Timed::No,
        timing: TimingSettings::default(),
        frames_per_camera: 1,
        command: String::new(),
    };
    for seed in first.. {
        if told.drawn >= count {
            break;
        }
        let mut random = Random::new(seed, "picture");
        let index = random.below(scenes.len());
        let (name, scene) = &scenes[index];
        let module = scene.materials[random.below(scene.materials.len())]
            .program
            .module();
        let recipe = recipe(module, &mut random);
        let facts = facts.entry(index).or_insert_with(|| {
            let counted = Session::new(&gpu, scene, ShaderForm::Text)
                .map_err(measure::Error::from)
                .and_then(|session| measure::facts(&session));
            Facts {
                rasterizer: measure::rasterizer(&gpu).ok(),
                ..merged(counted.unwrap_or_default(), measure::known(scene))
            }
        });
        let originals = measure::originals(scene);
        // Steps that no material takes are left out.
        let kept: Vec<_> = recipe
            .steps
            .iter()
            .scan(Recipe::default(), |taken, step| {
                let mut with = taken.clone();
                with.steps.push(step.clone());
                let takes = |plan: &Plan| with.apply(plan, facts).is_ok();
                let is_taken = originals.iter().any(takes);
                if is_taken {
                    *taken = with;
                }
                Some(is_taken.then(|| step.clone()))
            })
            .flatten()
            .collect();
        let recipe = Recipe { steps: kept };
        let variant = measure::variant(&originals, &recipe, facts);
        if variant.plans.iter().all(|p| p.steps.is_empty()) {
            continue;
        }
        told.drawn += 1;
        let contract = variant
            .plans
            .iter()
            .map(|p| p.contract.clone())
            .reduce(Contract::and)
            .unwrap_or_else(Contract::exact);
        let kind = contract.kind().to_owned();
        *told.by_contract.entry(kind.clone()).or_default() += 1;
        let label = format!("seed {seed}: {name} by {recipe}");
        eprintln!("{} {label}", told.drawn);
        let seen = facts.rasterizer;
        let is_of_another =
            |plan: &Plan| seen.is_some_and(|s| visibility_buffer::contradicted(plan, &s).is_some());
        let of_another = variant.plans.iter().any(is_of_another);
        let outcome = Session::new(&gpu, scene, ShaderForm::Text)
            .map_err(measure::Error::from)
            .and_then(|session| measure::verify(&session, &[variant], &settings, &mut |_| {}));
        let outcome = match outcome {
            Ok(outcome) => outcome,
            Err(error) => {
                told.not_measured.push(format!("{label}: {error}"));
                continue;
            }
        };
        let found = &outcome.report.variants[1];
        match &found.verdict {
            Verdict::Holds => *told.held.entry(kind).or_default() += 1,
            Verdict::NotMeasured { why } => told.not_measured.push(format!("{label}: {why}")),
            Verdict::Broken { r#where } => {
                let line = format!("{label} ({kind}): {where}", where = r#where);
                match (contract.budgets().is_empty(), of_another) {
                    (false, _) => told.over_budget.push(line),
                    (true, true) => told.of_another_adapter.push(line),
                    (true, false) => told.wrong.push(line),
                }
            }
        }
    }
    told
}

/// What was counted, with what the scene tells.
fn merged(counted: Facts, known: Facts) -> Facts {
    Facts {
        changing: known.changing,
        constants: known.constants,
        ranges: known.ranges,
        ..counted
    }
}
