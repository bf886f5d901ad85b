//! Chooses the values to hoist: minimum cuts over a sweep of transport prices, and the best cut
//! that fits.

use naga::{Binding, BuiltIn, TypeInner};

use super::movable::{Carriage, Class, Judged, Verdict};
use super::pack::{self, Load, VaryingSlot};
use crate::analysis::contraction::Pruned;
use crate::analysis::cut::{self, Cut, Item};
use crate::analysis::reach::with_operands;
use crate::analysis::transitive_cost::transitive_cost;
use crate::analysis::values::{Node, ValueId, Values};
use preshade_dataflow::graph::rate::Interpolated;

/// Cost of interpolating a component per fragment, in the units of [`preshade_dataflow::graph::cost`]. NVIDIA
/// interpolates at a quarter of the multiply-add rate; others need two multiply-adds and a load.
pub(crate) const SMOOTH_PRICE: f64 = 4.0;
/// Cost of reading a flat component per fragment.
pub(crate) const FLAT_PRICE: f64 = 3.0;

/// `maxInterStageShaderVariables` of every WebGPU device.
pub(crate) const MOST_VARYINGS: usize = 16;

/// Multiples of the transport price to try. Higher prices move fewer values.
const SWEEP: [f64; 10] = [1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 10.0, 16.0, 32.0, 64.0];

/// The restrictions and weights of a choice.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Terms {
    /// The weakest allowed class.
    pub weakest: Class,
    /// Vertices shaded per fragment shaded.
    pub vertices_per_fragment: f64,
    /// The smallest fraction of the fragment stage's cost that must be saved.
    pub worthwhile: f64,
}

/// The choice of values to hoist, with its costs.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct CarriedValues {
    /// Values to compute in the vertex stage.
    pub carried: Vec<(ValueId, Carriage)>,
    /// Their varyings; parts index `carried`.
    pub slots: Vec<VaryingSlot>,
    /// The author's varyings that the fragment stage still reads, as indices of [`Values::inputs`].
    pub kept: Vec<usize>,
    /// Varyings that the hoisted work reads.
    pub read: Vec<usize>,
    /// Static cost of the fragment stage before, including transport.
    pub before: f64,
    /// Static cost of the fragment stage after hoisting.
    pub after: f64,
    /// Static cost of the additional work in the vertex stage.
    pub vertex: f64,
    /// Operations that stay, and that a compiler may round differently without those that move.
    pub rounded_anew: Vec<ValueId>,
}

impl CarriedValues {
    /// The weakest class among the moved values, and of the operations that stay.
    pub fn class(&self) -> Option<Class> {
        let moved = self.carried.iter().map(|(_, c)| c.class).max();
        moved.max((!self.rounded_anew.is_empty()).then_some(Class::Affine))
    }
}

/// The cheapest choice whose rounding errors change an output by at most `most`; `None` if nothing
/// pays.
pub(crate) fn choose(
    values: &Values<'_, '_>,
    judged: &Judged,
    most: f64,
    terms: &Terms,
) -> Option<CarriedValues> {
    let verdicts = &judged.verdicts;
    let before = {
        let items = items(values, verdicts, |_| false);
        cut::minimum(&items, &values.roots)?.total(&items)
    };
    let items = items(values, verdicts, |c| c.class <= terms.weakest);
    let mut cuts = cut::sweep(&items, &values.roots, &SWEEP)?;
    cuts.dedup_by(|a, b| a.computed == b.computed && a.carried == b.carried);
    let pruned = Pruned::new(values);
    let decides = with_operands(values, values.coverage.clone());
    let mut best: Option<(f64, CarriedValues)> = None;
    for cut in &cuts {
        let Some(mut choice) = cut_at(values, verdicts, &items, cut, before) else {
            continue;
        };
        choice.rounded_anew = pruned.rounded_anew(|id| cut.computed[id], |_| true);
        let anew = &choice.rounded_anew;
        if anew.iter().any(|id| decides[*id]) || choice.class() > Some(terms.weakest) {
            continue;
        }
        let affine = choice.carried.iter();
        let affine = affine.filter(|(_, c)| c.class == Class::Affine);
        let affine: Vec<ValueId> = affine.map(|(id, _)| *id).collect();
        // A budget is measured with the operations that stay.
        let anew = match choice.class() {
            Some(Class::Smooth) => &[],
            _ => anew.as_slice(),
        };
        let is_rounded = !(affine.is_empty() && anew.is_empty());
        if is_rounded && judged.roundings.together(&affine, anew) > most {
            continue;
        }
        let whole = choice.after + choice.vertex * terms.vertices_per_fragment;
        if before - whole <= before * terms.worthwhile {
            continue;
        }
        if best.as_ref().is_none_or(|(cost, _)| whole < *cost) {
            best = Some((whole, choice));
        }
    }
    best.map(|(_, choice)| choice)
}

/// Moves one value whether or not it pays; `None` if it does not fit.
pub(crate) fn one(
    values: &Values<'_, '_>,
    verdicts: &[Verdict],
    id: ValueId,
) -> Option<CarriedValues> {
    let mut items = items(values, verdicts, |_| false);
    let before = cut::minimum(&items, &values.roots)?.total(&items);
    // As with an incoming varying, the fragment stage cannot compute it.
    items[id] = Item {
        cost: None,
        price: Some(0.0),
        ..items[id].clone()
    };
    let cut = cut::minimum(&items, &values.roots)?;
    cut_at(values, verdicts, &items, &cut, before)
}

/// The packed values of a cut; `None` if the cut is empty or does not fit.
fn cut_at(
    values: &Values<'_, '_>,
    verdicts: &[Verdict],
    items: &[Item<'_>],
    cut: &Cut,
    before: f64,
) -> Option<CarriedValues> {
    let reserved = values.inputs.iter().filter(|io| {
        matches!(
            io.binding,
            Some(Binding::BuiltIn(
                BuiltIn::FrontFacing | BuiltIn::SampleIndex | BuiltIn::SampleMask
            ))
        )
    });
    let limit = MOST_VARYINGS - reserved.count().min(MOST_VARYINGS);
    let mut carried = Vec::new();
    let mut kept = Vec::new();
    for id in &cut.carried {
        match (&values.values[*id].node, &verdicts[*id]) {
            (Node::Input(i), _) => kept.push(*i),
            (_, Ok(carriage)) => carried.push((*id, *carriage)),
            (_, Err(_)) => {}
        }
    }
    if carried.is_empty() {
        return None;
    }
    let loads: Vec<Load> = carried
        .iter()
        .filter_map(|(id, carriage)| {
            let (scalar, width) = values.shape(*id)?;
            Some(Load {
                width,
                kind: scalar.kind,
                carriage: *carriage,
            })
        })
        .collect();
    let slots = pack::pack(&loads, kept.len(), limit)?;
    let (vertex, read) = transitive_cost(values, carried.iter().map(|(id, _)| *id));
    Some(CarriedValues {
        after: cut.total(items),
        carried,
        slots,
        kept,
        read,
        before,
        vertex,
        rounded_anew: Vec::new(),
    })
}

/// The values as items of the cut problem.
fn items<'v>(
    values: &'v Values<'_, '_>,
    verdicts: &[Verdict],
    allowed: impl Fn(&Carriage) -> bool,
) -> Vec<Item<'v>> {
    let mut items = cut::items(values, |id| match values.values[id].node {
        Node::Input(i) => {
            let io = values.inputs.get(i)?;
            let is_varying = matches!(io.binding, Some(Binding::Location { .. }));
            let width = components(&values.graph.module().types[io.ty].inner);
            is_varying.then(|| price(width, values.values[id].fact.rate.is_flat()))
        }
        _ => {
            let carriage = verdicts[id].as_ref().ok().filter(|c| allowed(c))?;
            let (_, width) = values.shape(id)?;
            let flat = carriage.interpolated == Interpolated::Flat;
            Some(price(f64::from(width), flat))
        }
    });
    for (item, value) in items.iter_mut().zip(&values.values) {
        if let Node::Input(_) = value.node {
            // No fragment can compute a varying.
            item.cost = item.price.is_none().then_some(0.0);
        }
    }
    items
}

fn price(components: f64, flat: bool) -> f64 {
    components * if flat { FLAT_PRICE } else { SMOOTH_PRICE }
}

fn components(ty: &TypeInner) -> f64 {
    match ty {
        TypeInner::Vector { size, .. } => f64::from(*size as u8),
        _ => 1.0,
    }
}
