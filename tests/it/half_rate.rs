//! Both stages of `half-rate` in every language.

use preshade_compiler::emit;
use preshade_compiler::recipe::Recipe;
use preshade_plan::pass::Facts;
use preshade_plan::plan::{Plan, Role};
use preshade_plan::plan_file::Target;

use crate::fixtures_support::root;

/// The original of a scene's only material, and the variant.
fn halved(name: &str) -> [Plan; 2] {
    let scene = preshade_scenes::load(&root().join("fixtures").join(name)).unwrap();
    let original = scene.materials[0].plan();
    let recipe = Recipe::parse_list("half-rate:budget=0.01").unwrap();
    let variant = recipe.apply(&original, &Facts::default()).unwrap();
    [original, variant]
}

/// Every text is read back, and compared with the module.
#[test]
fn both_stages_are_written_in_every_language() {
    for name in [
        "scenes/deferred",
        "adversarial/thin-lines",
        "adversarial/discarded-between",
    ] {
        let [_, variant] = halved(&format!("{name}.toml"));
        for target in Target::GENERAL {
            let files = emit::emit(&variant, &[target], &emit::Options::default());
            let files = files.unwrap_or_else(|e| panic!("{name}, {target:?}: {e}"));
            assert!(
                files.iter().any(|f| f.name.contains(".half-rate.")),
                "{name}, {target:?}"
            );
        }
    }
}

/// The light and the occlusion move; the albedo stays, and so guides nothing.
#[test]
fn a_texel_that_the_light_does_not_need_stays() {
    let [_, variant] = halved("scenes/deferred.toml");
    let half = variant
        .passes
        .iter()
        .find(|p| p.role == Role::HalfRate)
        .unwrap();
    let reads =
        |p: &preshade_plan::plan::GpuPass| p.bindings.iter().any(|b| b.name == "gbuffer_albedo");
    assert!(
        !reads(half) && reads(variant.main().unwrap()),
        "{:?}",
        variant.notes
    );
    assert!(
        variant.notes[0].contains("`gbuffer_height`"),
        "{:?}",
        variant.notes
    );
}
