//! Textures that no frame writes.

use std::collections::BTreeMap;

use preshade_passes::pass::SteadyTexture;

use super::originals;
use crate::scene::{Scene, SceneError, bind};

/// The textures of each material that hold, in every draw, what they held at the start of the frame. Those that
/// preshade made up are left out.
///
/// # Errors
///
/// A value that does not fit its variable.
pub fn steady_textures(scene: &Scene) -> Result<Vec<SteadyTexture>, SceneError> {
    let plans = originals(scene);
    let Some((_, frame)) = scene.frames().next() else {
        return Ok(Vec::new());
    };
    let mut found: BTreeMap<SteadyTexture, bool> = BTreeMap::new();
    for draw in &scene.draws {
        let material = scene.materials.get(draw.material);
        let plan = plans.get(draw.material);
        let (Some(material), Some(plan), Some(pass)) =
            (material, plan, plan.and_then(|p| p.main()))
        else {
            continue;
        };
        for texture in bind::draw(scene, material, pass, draw, frame)?.textures {
            let at = SteadyTexture {
                material: plan.material.clone(),
                group: texture.group,
                binding: texture.binding,
            };
            *found.entry(at).or_insert(true) &= texture.is_steady && !texture.is_invented;
        }
    }
    let steady = found.into_iter().filter(|(_, is_steady)| *is_steady);
    Ok(steady.map(|(at, _)| at).collect())
}
