//! Nothing a back end writes is shipped on faith: every fixture through every pass, in every target, compiled by compilers that are not ours.
#![cfg(all(feature = "glsl", feature = "spirv"))]
#![allow(clippy::unwrap_used, clippy::panic, missing_docs)]

use std::path::Path;

use preshade::emit::{self, Target};
use preshade::passes::pass::Facts;
use preshade::recipe::Recipe;

mod accept;
mod fixtures_support;

#[test]
fn other_compilers_take_every_variant_of_every_fixture() {
    let mut sets = Vec::new();
    let mut left_out = Vec::new();
    for files in fixtures_support::materials() {
        let paths: Vec<&Path> = files.iter().map(AsRef::as_ref).collect();
        let original = fixtures_support::original(&paths);
        let mut variants = vec![("original", original.clone())];
        let composed = fixtures_support::COMPOSED;
        for recipe in fixtures_support::RECIPES.into_iter().chain(composed) {
            // Ties measured to be none: the main pass of `equal` loses its discard, the hardest text of the two.
            let facts = Facts::without_ties();
            if let Ok(plan) = Recipe::parse_list(recipe).unwrap().apply(&original, &facts) {
                variants.push((recipe, plan));
            }
        }
        for (recipe, plan) in variants {
            let label = format!("{} {recipe}", plan.material);
            let mut set = Vec::new();
            // Tessellation stages are for what was hoisted, and nothing behind that.
            let last = plan.steps.last().map(|s| s.pass.as_str());
            let targets = match last {
                Some("hoist") => &Target::ALL[..],
                _ => &Target::GENERAL[..],
            };
            for &target in targets {
                match emit::emit(&plan, &[target], &emit::Options::default()) {
                    Ok(files) => {
                        set.extend(files.into_iter().filter(|f| !f.name.ends_with(".json")))
                    }
                    Err(e) if !matches!(target, Target::Wgsl | Target::Spirv) => {
                        left_out.push(format!("{label} {}: {e}", target.name()))
                    }
                    Err(e) => panic!("{label} {}: {e}", target.name()),
                }
            }
            sets.push((label, set));
        }
    }
    let judged = accept::accept(&sets);
    println!("{judged:?}");
    assert!(
        judged.wgsl > 100 && judged.spirv > 200 && judged.glsl > 100 && judged.linked > 20,
        "{judged:?}"
    );
    // What GLSL cannot say is refused by name, never written wrong: a depth texture's texels, storage buffers in ES 3.00 and in 4.00, and the
    // indices of vertices and instances, which naga writes in OpenGL's words alone.
    let known = |text: &str| {
        text.contains("early-discard: `texture=float`")
            || (text.contains("glsl-es") && text.contains("storage buffers"))
            || (text.contains("glsl-tess") && text.contains("a storage buffer"))
            || (text.contains("glsl-vulkan-tess") && text.contains("index"))
    };
    let unknown: Vec<_> = left_out.iter().filter(|l| !known(l)).collect();
    assert!(unknown.is_empty(), "{unknown:#?}");
}
