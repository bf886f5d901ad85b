//! The resources that draws bind: textures that no frame writes, those that hold infinite numbers,
//! and depth ranges.

use std::collections::{BTreeMap, BTreeSet};

use preshade_plan::pass::MaterialTexture;

use super::originals;
use preshade_draw::scene::bind::{self, TextureContent};
use preshade_draw::scene::{Scene, SceneError};

/// Properties of a material's texture.
#[derive(Clone, Copy, Debug)]
pub struct Texels {
    /// Whether it has, in every draw, its content from the start of the frame, and preshade did not
    /// make that up.
    pub is_steady: bool,
    /// Whether it holds NaN or an infinite number in any draw.
    pub is_infinite: bool,
}

/// The resources that the draws of a scene bind in its first frame.
#[derive(Clone, Debug, Default)]
pub struct Bound {
    pub textures: BTreeMap<MaterialTexture, Texels>,
    /// Materials with a draw whose viewport has another depth range than 0 to 1.
    pub narrow_depths: BTreeSet<String>,
}

/// Reads the draws of a scene.
///
/// # Errors
///
/// A value that does not fit its variable.
pub fn bound(scene: &Scene) -> Result<Bound, SceneError> {
    let plans = originals(scene);
    let mut found = Bound::default();
    let Some((_, frame)) = scene.frames().next() else {
        return Ok(found);
    };
    for draw in &scene.draws {
        let material = scene.materials.get(draw.material);
        let plan = plans.get(draw.material);
        let (Some(material), Some(plan), Some(pass)) =
            (material, plan, plan.and_then(|p| p.main()))
        else {
            continue;
        };
        let bound = bind::draw(scene, material, pass, draw, frame)?;
        if bound
            .area
            .is_some_and(|area| area != area.with_all_depths())
        {
            found.narrow_depths.insert(plan.material.clone());
        }
        for texture in bound.textures {
            let at = MaterialTexture {
                material: plan.material.clone(),
                group: texture.group,
                binding: texture.binding,
            };
            let texels = match &texture.content {
                TextureContent::Image(image) => image.texels(),
                TextureContent::Depth { .. } | TextureContent::Storage { .. } => None,
            };
            let mut numbers = texels.iter().flat_map(|t| t.all()).flatten();
            let of = found.textures.entry(at).or_insert(Texels {
                is_steady: true,
                is_infinite: false,
            });
            of.is_steady &= texture.is_steady && !texture.is_invented;
            of.is_infinite |= numbers.any(|n| !n.is_finite());
        }
    }
    Ok(found)
}
