//! The passes that fetch vertices in a shader, because they draw other triangles or shade without
//! drawing any, and the list of all passes.

pub(crate) mod corner;
pub(crate) mod fetch;
pub mod tessellate;
pub mod visibility_buffer;

use std::sync::LazyLock;

use preshade_passes::transforms;
use preshade_plan::pass::{AnyPass, Erased, Use};
use shader_text::refusals::RefusalInfo;

/// Every pass, in the order in which `explain` lists them.
pub static PASSES: LazyLock<Vec<&'static dyn AnyPass>> = LazyLock::new(|| {
    let mut all = transforms::PASSES.to_vec();
    let preamble = all.iter().position(|pass| pass.info().name == "preamble");
    all.insert(
        preamble.map_or(all.len(), |at| at + 1),
        &Erased::<tessellate::Tessellate>::NEW,
    );
    all.push(&Erased::<visibility_buffer::VisibilityBuffer>::NEW);
    all
});

/// Every refusal of a pass, of a shared analysis or of a recipe.
pub fn refusals() -> impl Iterator<Item = &'static RefusalInfo> {
    let shared = [
        preshade_plan::refusals::REFUSALS,
        preshade_passes::analysis::refusals::REFUSALS,
    ];
    let own = PASSES.iter().map(|pass| pass.refusals());
    shared.into_iter().chain(own).flatten()
}

/// The recipes of all passes that have a use, each with the use.
pub fn examples() -> impl Iterator<Item = (&'static str, &'static Use)> {
    let all = PASSES.iter().flat_map(|pass| pass.examples());
    all.flat_map(|example| example.uses.iter().map(|of| (example.recipe, of)))
}

pub fn pass_named(name: &str) -> Option<&'static dyn AnyPass> {
    PASSES.iter().copied().find(|p| p.info().name == name)
}
