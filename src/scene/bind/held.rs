//! Uniforms of one frame as values for another: how a pass is drawn that a plan says reads another view than the camera's.

use std::collections::BTreeMap;

use super::super::{Draw, Error, Frame, Material, Scene, Value};
use super::guessed::Origin;
use super::streams::Streams;
use super::{BindingKind, authored, buffer};
use crate::scene::layout::Leaf;

/// The uniforms that `names` lists (variables or members), by path, as they are for one draw in one frame. What the scene gives as numbers
/// is the same in every frame and is left out.
///
/// # Errors
/// As [`super::draw`], for uniforms alone.
pub(in super::super) fn uniforms(
    scene: &Scene,
    material: &Material,
    draw: &Draw,
    frame: &Frame,
    names: &[String],
) -> Result<BTreeMap<String, Value>, Error> {
    let streams = Streams::new(scene, material, draw)?;
    let mut out = BTreeMap::new();
    let pass = material.plan().passes.pop();
    for binding in pass.iter().flat_map(authored) {
        if binding.kind != BindingKind::Uniform {
            continue;
        }
        // A member of a GLSL block without a name stands by itself in a path, and after a dot in a plan.
        let listed = |path: &str| {
            names.iter().any(|name| {
                let name = name.strip_prefix('.').unwrap_or(name);
                path.strip_prefix(name)
                    .is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
            })
        };
        let mut keep = |leaf: &Leaf<'_>, _: Origin, numbers: &[f64; 16]| {
            if listed(&leaf.text()) {
                let count = (leaf.columns * leaf.rows) as usize;
                let numbers = numbers[..count].to_vec();
                out.insert(leaf.indexed(), Value::Numbers(numbers));
            }
        };
        buffer(scene, material, &streams, binding, draw, frame, &mut keep)?;
    }
    Ok(out)
}
