//! `verify` draws the bytes that `rewrite` writes: every fixture, every pass by its defaults and
//! composed recipes, among them recipes whose first step is refused.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicU32, Ordering};

use preshade_compiler::emit;
use preshade_compiler::front::{self, Source};
use preshade_compiler::recipe::Recipe;
use preshade_geometry::{PASSES, examples};
use preshade_lab::measure;
use preshade_plan::pass::{Facts, Use};
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::Target;
use preshade_plan::state::MaterialState;
use preshade_scenes::{Access, Variables};
use shader_text::options;

/// Bytes by file name.
type Files = BTreeMap<String, Vec<u8>>;

/// Each pass by its defaults, and each recipe of the fuzzers followed by the next one. Materials
/// refuse many of them in part.
fn recipes() -> Vec<String> {
    let alone = PASSES.iter().map(|p| p.info().name.to_owned());
    let fuzzed = examples().filter(|(_, used)| **used == Use::Fuzz);
    let fuzzed: Vec<&str> = fuzzed.map(|(recipe, _)| recipe).collect();
    let next = fuzzed.iter().cycle().skip(1);
    let pairs = fuzzed.iter().zip(next).map(|(a, b)| format!("{a},{b}"));
    alone.chain(pairs).collect()
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .unwrap()
        .to_owned()
}

/// What `rewrite` writes of `inputs`, by the path below the folder.
fn rewritten(recipe: &Recipe, inputs: &[&str], out: &[&str]) -> Files {
    // The tests run side by side.
    static RUNS: AtomicU32 = AtomicU32::new(0);
    let run = RUNS.fetch_add(1, Ordering::Relaxed);
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("same-bytes-{run}"));
    let _ = std::fs::remove_dir_all(&folder);
    let steps = recipe.steps.iter();
    let passes = steps.flat_map(|s| ["--pass".to_owned(), s.to_string()]);
    let run = Command::new(env!("CARGO_BIN_EXE_preshade"))
        .current_dir(root())
        .arg("rewrite")
        .args(inputs)
        .args(passes)
        .args(out)
        .arg(&folder)
        .output()
        .unwrap();
    let stderr = String::from_utf8_lossy(&run.stderr);
    assert!(run.status.success(), "{recipe}: {stderr}");
    let mut files = Files::new();
    let mut folders = vec![folder];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let name = path.file_name().unwrap().to_str().unwrap().to_owned();
            assert!(files.insert(name, std::fs::read(path).unwrap()).is_none());
        }
    }
    files
}

/// Holds the plans that `verify` draws against the files of `rewrite`. Returns how many plans had a
/// step refused and another one applied.
fn check(recipe: &Recipe, originals: &[Plan], facts: &Facts, written: &Files) -> usize {
    let variant = measure::variant(originals, recipe, facts);
    for plan in &variant.plans {
        let files =
            |plan: &Plan| emit::emit(plan, &[Target::Wgsl], &emit::Options::default()).unwrap();
        // The renderer emits a plan without its fallback.
        let drawn = Plan {
            original: None,
            ..plan.clone()
        };
        let shaders = files(&drawn)
            .into_iter()
            .filter(|f| f.name.ends_with(".wgsl"));
        for file in files(plan).into_iter().chain(shaders) {
            let bytes = written.get(&file.name);
            let is_same = bytes.is_some_and(|b| *b == file.bytes);
            assert!(is_same, "{recipe}: {} differs", file.name);
        }
    }
    variant.kept.iter().filter(|k| k.without.is_some()).count()
}

/// Each takes seconds: `make check` skips them.
mod slow {
    use super::*;

    #[test]
    fn verify_draws_what_rewrite_writes_of_a_scene() {
        for name in [
            "first",
            "gallery",
            "sky-always",
            "color-mask-neighbour",
            "neighbour-stores",
            "two-sided",
        ] {
            let file = format!("fixtures/scenes/{name}.toml");
            let path = root().join(&file);
            for text in recipes() {
                let recipe = Recipe::parse_list(&text).unwrap();
                let scene =
                    preshade_scenes::load_within(&path, &Variables::new(), Access::default())
                        .unwrap();
                let scene = measure::grouped_for(scene, &recipe).unwrap();
                let facts = measure::known_for(&scene, &recipe);
                let written = rewritten(&recipe, &[&file], &["-o"]);
                check(&recipe, &measure::originals(&scene), &facts, &written);
            }
        }
    }

    #[test]
    fn verify_draws_what_rewrite_writes_of_every_shader() {
        let materials = |folder: &str, ending: &str| {
            let entries = std::fs::read_dir(root().join(folder)).unwrap();
            let files = entries.map(|e| e.unwrap().path());
            let mut files: Vec<PathBuf> = files
                .filter(|p| p.extension().is_some_and(|e| e == ending))
                .collect();
            files.sort();
            files
        };
        let wgsl = materials("fixtures/shaders", "wgsl")
            .into_iter()
            .map(|p| vec![p]);
        let glsl = materials("fixtures/glsl", "vert").into_iter();
        let glsl = glsl.map(|p| vec![p.clone(), p.with_extension("frag")]);
        let files: Vec<Vec<PathBuf>> = wgsl.chain(glsl).collect();
        let original = |files: &Vec<PathBuf>| {
            let source = |path: &PathBuf| {
                let name = path
                    .strip_prefix(root())
                    .unwrap()
                    .to_str()
                    .unwrap()
                    .to_owned();
                Source::new(name, std::fs::read_to_string(path).unwrap())
            };
            let sources: Vec<Source> = files.iter().map(source).collect();
            let parsed = front::parse(&sources, &options::Options::default()).unwrap();
            let name = files[0].file_stem().unwrap().to_str().unwrap();
            parsed.plan(name, &MaterialState::default())
        };
        let originals: Vec<Plan> = files.iter().map(original).collect();
        let inputs: Vec<String> = files
            .iter()
            .flatten()
            .map(|p| p.strip_prefix(root()).unwrap().to_str().unwrap().to_owned())
            .collect();
        let inputs: Vec<&str> = inputs.iter().map(String::as_str).collect();
        let mut partly = 0;
        for text in recipes() {
            let recipe = Recipe::parse_list(&text).unwrap();
            // The default state, also of stages that read which side they draw.
            let written = rewritten(&recipe, &inputs, &["--cull", "back", "--out-dir"]);
            for original in &originals {
                let alone = std::slice::from_ref(original);
                partly += check(&recipe, alone, &Facts::default(), &written);
            }
        }
        assert!(partly > 40, "{partly} materials took a part of a recipe");
    }
}
