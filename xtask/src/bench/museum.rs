//! Exhibits of the museum: a material specialised by hand, and one that preshade specialised.

use std::path::Path;

use preshade_compiler::front::{self, Source};
use preshade_draw::scene::Scene;
use preshade_lab::measure;
use preshade_plan::pass::Facts;
use preshade_plan::plan::Plan;
use shader_text::options::Options;

use crate::Failure;

/// Kinds of exhibit that there is a hand-written version for: `museum-KIND.wgsl`.
pub const KINDS: [&str; 4] = ["plinth", "bronze", "banner", "puppet"];

/// The recipe that should match each.
pub const RECIPE: &str = "specialize";

/// The scene with only the draws of one kind, and the facts about their values.
pub fn scene(path: &Path, size: [u32; 2], kind: &str) -> Result<(Scene, Facts), Failure> {
    let mut scene = preshade_scenes::load(path)?.resized(size);
    scene.draws.retain(|d| d.name.starts_with(kind));
    scene.cameras.truncate(1);
    let facts = Facts {
        constants: measure::constants(&scene)?,
        ..Facts::without_ties()
    };
    Ok((scene, facts))
}

/// The hand-written version as a plan, with the state of the original material.
pub fn handwritten(scene: &Scene, folder: &Path, kind: &str) -> Result<Plan, Failure> {
    let path = folder.join(format!("museum-{kind}.wgsl"));
    let source = Source::new(path.display().to_string(), super::read(&path)?);
    let parsed = front::parse(&[source], &Options::default())?;
    let material = scene
        .materials
        .first()
        .ok_or("the museum has no material")?;
    Ok(Plan::original(
        &material.name,
        parsed.program,
        &parsed.vertex,
        parsed.fragment.as_deref(),
        &material.state,
    ))
}
