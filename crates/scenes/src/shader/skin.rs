//! Finds skins in the dataflow of a vertex stage. Components of one attribute select matrices of an
//! array, and those of another attribute weight these matrices or their results.

use std::collections::BTreeMap;

use naga::{ScalarKind, TypeInner};
use preshade_passes::analysis::values::ValueId;

use super::flow::{BufferRead, MATRIX_OF_PRODUCT, MOST_INDIRECT, StageFlow, location};

/// A matrix and its weight.
pub(super) struct Skin {
    /// Index of the input that selects the matrix.
    pub joints: usize,
    /// Index of the input that weights it.
    pub weights: usize,
    pub matrices: BufferRead,
}

/// Every weighted matrix that an input chooses.
pub(super) fn skins(flow: &StageFlow<'_, '_>) -> Vec<Skin> {
    let chosen = chosen(flow);
    if chosen.is_empty() {
        return Vec::new();
    }
    let values = 0..flow.values.values.len();
    values
        .filter_map(|value| weighted(flow, value, &chosen))
        .collect()
}

/// The matrices that an input selects, by the value that loads them.
fn chosen(flow: &StageFlow<'_, '_>) -> BTreeMap<ValueId, (usize, BufferRead)> {
    let module = flow.values.graph.module();
    let values = 0..flow.values.values.len();
    values
        .filter_map(|value| {
            let read = flow.read(value)?;
            let TypeInner::Matrix { .. } = module.types[read.ty].inner else {
                return None;
            };
            let input = nearest_input(flow, flow.index(value)?)?;
            Some((value, (input, read)))
        })
        .collect()
}

/// The skin in a product with a scalar weight.
fn weighted(
    flow: &StageFlow<'_, '_>,
    product: ValueId,
    chosen: &BTreeMap<ValueId, (usize, BufferRead)>,
) -> Option<Skin> {
    let (context, left, right) = flow.product(product)?;
    let f = flow.values.function(context);
    let is_scalar = |e| matches!(f.ty(flow.values.graph.module(), e), TypeInner::Scalar(_));
    let (weight, other) = match (is_scalar(left), is_scalar(right)) {
        (true, false) => (left, right),
        (false, true) => (right, left),
        _ => return None,
    };
    let weights = nearest_input(flow, flow.values.named(context, weight)?)?;
    let near = flow.nearest(flow.values.named(context, other)?);
    let (joints, matrices) = near.cost.iter().find_map(|(value, cost)| {
        let matrix = chosen.get(value);
        matrix.filter(|_| *cost <= MATRIX_OF_PRODUCT)
    })?;
    let is_skin = weights != *joints
        && flow.shape(&flow.values.inputs[weights]) == Some((4, ScalarKind::Float));
    is_skin.then(|| Skin {
        joints: *joints,
        weights,
        matrices: matrices.clone(),
    })
}

/// The most direct vector attribute behind a value.
fn nearest_input(flow: &StageFlow<'_, '_>, value: ValueId) -> Option<usize> {
    let near = flow.nearest(value);
    let inputs = near.cost.iter().filter_map(|(value, cost)| {
        let input = flow.input(*value)?;
        let io = &flow.values.inputs[input];
        location(io)?;
        let (rows, _) = flow.shape(io)?;
        (rows > 1 && *cost < MOST_INDIRECT).then_some((*cost, input))
    });
    inputs.min().map(|(_, input)| input)
}
