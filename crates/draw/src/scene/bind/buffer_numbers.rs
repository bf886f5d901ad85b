//! Reads the numbers in a material's buffers, by path.

use std::collections::BTreeMap;

use naga::ScalarKind;

use super::super::{Draw, Frame, Material, Scene, SceneError, Value};
use super::streams::Streams;
use super::{authored, ignore, packed, runtime_length, variable};
use crate::scene::globals::immediates;
use crate::scene::layout::{self, VariableLeaf};
use preshade_plan::plan::BindingKind;

/// Every scalar, vector and matrix of a material's buffers and immediate data for one draw in one
/// frame, by its path with indices.
///
/// # Errors
/// As [`super::draw`].
pub fn numbers(
    scene: &Scene,
    material: &Material,
    draw: &Draw,
    frame: &Frame,
) -> Result<BTreeMap<String, Value>, SceneError> {
    if draw.captured.is_some() {
        return Ok(BTreeMap::new());
    }
    let streams = Streams::new(scene, material, draw)?;
    let module = material.program.module();
    let nothing = BTreeMap::new();
    let given = layout::SceneValues {
        draw: &nothing,
        material: &nothing,
    };
    let pass = material.plan().passes.pop();
    let is_buffer = |kind| {
        use BindingKind::{StorageRead, StorageReadWrite, Uniform};
        matches!(kind, Uniform | StorageRead | StorageReadWrite)
    };
    let bound = pass.iter().flat_map(authored);
    let bound = bound.filter(|b| is_buffer(b.kind));
    let mut variables = bound
        .map(|b| variable(material, b))
        .collect::<Result<Vec<_>, _>>()?;
    variables.extend(immediates(&material.program));
    let mut out = BTreeMap::new();
    for (name, ty) in variables {
        let of = (scene, material, &streams);
        let bytes = packed(of, (name, ty), draw, frame, &mut ignore)?.data.bytes;
        let dynamic = runtime_length(material, &streams, draw, name, ty)?;
        let mut keep = |leaf: &VariableLeaf<'_>| {
            out.insert(leaf.indexed(), Value::Numbers(read(leaf, &bytes)));
            Ok([0.0; 16])
        };
        layout::pack(module, name, ty, dynamic, given, &mut keep)?;
    }
    Ok(out)
}

/// The numbers of a leaf in a variable's bytes.
fn read(leaf: &VariableLeaf<'_>, bytes: &[u8]) -> Vec<f64> {
    let (columns, rows) = (leaf.columns as usize, leaf.rows as usize);
    // The last column has no padding after it.
    let width = leaf.width as usize;
    let stride = match columns {
        1 => 0,
        _ => (leaf.bytes.len() - rows * width) / (columns - 1),
    };
    let number = |c: usize, r: usize| {
        let at = leaf.bytes.start + c * stride + r * width;
        let word = bytes.get(at..at + width).unwrap_or(&[]);
        let mut wide = [0; 8];
        wide[..word.len()].copy_from_slice(word);
        let bits = u64::from_le_bytes(wide);
        match (leaf.kind, width) {
            (ScalarKind::Float, 8) => f64::from_bits(bits),
            (ScalarKind::Float, 2) => f64::from(half::f16::from_bits(bits as u16)),
            (ScalarKind::Float, _) => f64::from(f32::from_bits(bits as u32)),
            (ScalarKind::Sint, 4) => f64::from(bits as u32 as i32),
            (ScalarKind::Sint, _) => bits as i64 as f64,
            _ => bits as f64,
        }
    };
    (0..columns)
        .flat_map(|c| (0..rows).map(move |r| (c, r)))
        .map(|(c, r)| number(c, r))
        .collect()
}
