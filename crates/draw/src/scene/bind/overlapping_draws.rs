//! Draws that lie on top of each other, because no input of their shader reads their transforms.

use std::collections::BTreeMap;

use super::super::{Draw, Scene};

/// The first two draws of one mesh and material that have different transforms and the same inputs.
/// Every material counts once: its name, and those of the draws.
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
