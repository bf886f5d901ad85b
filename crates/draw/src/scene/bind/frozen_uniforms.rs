//! Uniforms with their values from another frame, for passes that the plan draws from another view.

use std::collections::BTreeMap;

use super::super::{Draw, Frame, Material, Scene, SceneError, Value};
use super::guessed::ValueOrigin;
use super::streams::Streams;
use super::{authored, buffer};
use crate::scene::layout::VariableLeaf;
use preshade_plan::plan::BindingKind;

/// The uniforms in `names` (variables or members), by path, with their values for one draw in one
/// frame. Values that the scene gives as numbers are the same in every frame and are left out.
///
/// # Errors
/// As [`super::draw`], for uniforms only.
pub(in super::super) fn uniforms(
    scene: &Scene,
    material: &Material,
    draw: &Draw,
    frame: &Frame,
    names: &[String],
) -> Result<BTreeMap<String, Value>, SceneError> {
    if draw.captured.is_some() {
        return Ok(BTreeMap::new());
    }
    let streams = Streams::new(scene, material, draw)?;
    let mut out = BTreeMap::new();
    let pass = material.plan().passes.pop();
    for binding in pass.iter().flat_map(authored) {
        if binding.kind != BindingKind::Uniform {
            continue;
        }
        // A path contains only the member's name for unnamed GLSL blocks; a plan has a dot before
        // it.
        let listed = |path: &str| {
            names.iter().any(|name| {
                let name = name.strip_prefix('.').unwrap_or(name);
                path.strip_prefix(name)
                    .is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
            })
        };
        let mut keep = |leaf: &VariableLeaf<'_>, _: ValueOrigin, numbers: &[f64; 16]| {
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
