//! Scene files, and plan files as a host reads them.

use std::sync::OnceLock;

use preshade_compiler::emit;
use preshade_compiler::recipe::Recipe;
use preshade_draw::scene::{self, Scene};
use preshade_lab::measure;
use preshade_plan::pass::Facts;
use preshade_plan::plan_file::Target;
use preshade_scenes::Access;
use preshade_scenes::Variables;
use shader_text::files::File;
use shader_text::limits::Limits;

use super::{recipes, root};

/// The shader files that a plan of the target `plan` may name, and the plan that fits them.
fn split() -> &'static [File] {
    static FILES: OnceLock<Vec<File>> = OnceLock::new();
    FILES.get_or_init(|| {
        let recipe = Recipe::parse_list("early-discard:texture=packed").unwrap();
        let plan = recipe
            .apply(&recipes::material("textured"), &Facts::default())
            .unwrap();
        emit::emit(&plan, &[Target::Wgsl], &emit::Options::default()).unwrap()
    })
}

/// `plan.json` beside the texts of a split material.
pub fn plan(data: &[u8]) {
    let mut files = split().to_vec();
    let json = files.iter_mut().find(|f| f.name.ends_with(".json"));
    json.unwrap().bytes = data.to_vec();
    if let Ok(variant) = preshade_scenes::from_files(&[files]) {
        drop(variant);
    }
}

/// The plan that the target `plan` is seeded with.
pub fn plan_seed() -> Vec<u8> {
    let json = split().iter().find(|f| f.name.ends_with(".json"));
    json.unwrap().bytes.clone()
}

/// The scene of a text, small, so that one input costs little.
pub fn load(text: &str) -> Result<Scene, scene::SceneError> {
    let access = Access {
        limits: Limits::parse("strict,vertices=20k,copies=500,draws=500,texture-size=64").unwrap(),
        ..Access::default()
    };
    let path = root().join("fixtures/scenes/fuzzed.toml");
    preshade_scenes::read(text, &path, &Variables::new(), access)
}

/// The scene file with generated textures of 16 texels a side where they have more. A size that no
/// texture has stays as it is.
pub fn shrunk(text: &str) -> Option<String> {
    let mut file: toml::Table = text.parse().ok()?;
    let materials = file.get_mut("materials")?.as_table_mut()?;
    let textures = materials
        .iter_mut()
        .filter_map(|(_, m)| m.get_mut("textures")?.as_table_mut())
        .flat_map(|textures| textures.iter_mut())
        .filter_map(|(_, recipe)| recipe.as_table_mut());
    for recipe in textures.filter(|r| r.contains_key("pattern")) {
        let size = recipe
            .get("size")
            .map_or(Some(256), toml::Value::as_integer);
        if size.is_some_and(|n| (17..=4096).contains(&n)) {
            recipe.insert("size".to_owned(), 16.into());
        }
    }
    toml::to_string(&file).ok()
}

/// A scene file, beside the fixtures' own.
pub fn scene(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else {
        return;
    };
    let mut read = load(text);
    // Most textures are larger than is allowed here: smaller ones are made, by the same code.
    if let Err(error) = &read
        && error.render().contains("the limit `texture-size`")
        && let Some(smaller) = shrunk(text)
    {
        read = load(&smaller);
    }
    match read {
        Ok(scene) => {
            // What is loaded can be evaluated for what it tells, and its draws can be bound.
            measure::known(&scene);
            scene::bind::guessed(&scene);
        }
        Err(error) => assert!(!error.render().is_empty()),
    }
}
