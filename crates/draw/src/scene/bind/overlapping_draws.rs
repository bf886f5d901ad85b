//! Finds draws that coincide, because no input of their shader depends on their transforms.

use std::collections::BTreeMap;

use super::super::{Draw, Scene};

/// Two draws of one mesh and material with different transforms but equal inputs: at most one pair
/// per material, as the names of material and draws.
pub fn overlapping_draws(scene: &Scene) -> Vec<(&str, [&str; 2])> {
    let Some(frame) = scene.cameras.first().and_then(|c| c.frames.first()) else {
        return Vec::new();
    };
    let materials = scene.materials.iter().enumerate();
    let found = materials.filter_map(|(index, material)| {
        let pass = material.plan().passes.pop()?;
        let mut firsts: BTreeMap<usize, &Draw> = BTreeMap::new();
        let mut own = scene
            .draws
            .iter()
            .filter(|d| d.material == index && d.captured.is_none());
        let (first, second) = own.find_map(|draw| {
            let first = *firsts.entry(draw.mesh).or_insert(draw);
            (first.transform != draw.transform).then_some((first, draw))
        })?;
        let bound = |draw| super::draw(scene, material, &pass, draw, frame).ok();
        let is_same = bound(first)? == bound(second)?;
        is_same.then_some((material.name.as_str(), [&*first.name, &*second.name]))
    });
    found.collect()
}
