//! The choice of what to hoist: minimum cuts over a sweep of what transport costs, the best of those that fit.

use naga::{Binding, BuiltIn, TypeInner};

use super::cut::{self, Item};
use super::pack::{self, Load, Slot};
use super::travel::{Carriage, Class, Stays};
use super::values::{Node, ValueId, Values};
use crate::graph::rate::Interpolated;
use crate::reflect;

/// What interpolating a component costs a fragment, in the units of [`crate::graph::cost`]: NVIDIA's interpolators run at a quarter of the rate of
/// multiply-adds, others spend two of these and a load.
pub const SMOOTH_PRICE: f64 = 4.0;
/// What reading a flat component costs a fragment.
pub const FLAT_PRICE: f64 = 3.0;

/// `maxInterStageShaderVariables` of every WebGPU device.
pub const MOST_VARYINGS: usize = 16;

/// Multiples of the price of transport that are tried: the dearer it is, the fewer values are carried.
const SWEEP: [f64; 10] = [1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 10.0, 16.0, 32.0, 64.0];

/// What may travel, and what weighs what.
#[derive(Clone, Debug, PartialEq)]
pub struct Terms {
    /// The weakest class that may travel.
    pub weakest: Class,
    /// Vertices shaded for each fragment shaded.
    pub vertices_per_fragment: f64,
    /// Least part of the fragment stage's cost that has to be saved.
    pub worthwhile: f64,
}

/// What to hoist.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// Values computed in the vertex stage.
    pub carried: Vec<(ValueId, Carriage)>,
    /// Where they travel; parts index `carried`.
    pub slots: Vec<Slot>,
    /// Varyings of the author's that the fragment stage still reads, by index in the order of [`reflect::inputs`].
    pub kept: Vec<usize>,
    /// Varyings that what is hoisted reads.
    pub read: Vec<usize>,
    /// Static cost of the fragment stage before, transport included.
    pub before: f64,
    /// After.
    pub after: f64,
    /// Static cost of what the vertex stage computes in addition.
    pub vertex: f64,
}

impl Choice {
    /// The weakest class among what is carried.
    pub fn class(&self) -> Option<Class> {
        self.carried.iter().map(|(_, c)| c.class).max()
    }
}

/// The cheapest thing to hoist; `None` where nothing pays.
pub fn choose(
    values: &Values<'_, '_>,
    verdicts: &[Result<Carriage, Stays>],
    terms: &Terms,
) -> Option<Choice> {
    let module = values.graph.module();
    let inputs = reflect::inputs(module, values.function(0).function);
    let before = total(values, verdicts, terms, 1.0, &|_| false)?.1.cost;
    let reserved = inputs.iter().filter(|io| {
        matches!(
            io.binding,
            Some(Binding::BuiltIn(
                BuiltIn::FrontFacing | BuiltIn::SampleIndex | BuiltIn::SampleMask
            ))
        )
    });
    let limit = MOST_VARYINGS - reserved.count().min(MOST_VARYINGS);
    let mut best: Option<(f64, Choice)> = None;
    for scale in SWEEP {
        let allowed = |c: &Carriage| c.class <= terms.weakest;
        let Some((items, cut)) = total(values, verdicts, terms, scale, &allowed) else {
            continue;
        };
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
            continue;
        }
        let loads: Vec<Load> = carried
            .iter()
            .filter_map(|(id, carriage)| {
                let (kind, width) = shape(values, *id)?;
                Some(Load {
                    width,
                    kind,
                    carriage: *carriage,
                })
            })
            .collect();
        let Some(slots) = pack::pack(&loads, kept.len(), limit) else {
            continue;
        };
        let transport: f64 = cut
            .carried
            .iter()
            .filter_map(|id| items[*id].price)
            .sum::<f64>()
            / scale;
        let computed: f64 = (0..items.len())
            .filter(|i| cut.computed[*i])
            .filter_map(|i| items[i].cost)
            .sum();
        let (vertex, read) = below(values, carried.iter().map(|(id, _)| *id));
        let after = transport + computed;
        let whole = after + vertex * terms.vertices_per_fragment;
        if before - whole <= before * terms.worthwhile {
            continue;
        }
        if best.as_ref().is_none_or(|(cost, _)| whole < *cost) {
            let choice = Choice {
                carried,
                slots,
                kept,
                read,
                before,
                after,
                vertex,
            };
            best = Some((whole, choice));
        }
    }
    best.map(|(_, choice)| choice)
}

/// The cut where transport costs `scale` times what it does.
fn total(
    values: &Values<'_, '_>,
    verdicts: &[Result<Carriage, Stays>],
    _terms: &Terms,
    scale: f64,
    allowed: &dyn Fn(&Carriage) -> bool,
) -> Option<(Vec<Item>, cut::Cut)> {
    let inputs = reflect::inputs(values.graph.module(), values.function(0).function);
    let items: Vec<Item> = values
        .values
        .iter()
        .enumerate()
        .map(|(id, value)| {
            let (cost, price) = match &value.node {
                Node::Input(i) => match inputs.get(*i).map(|io| (&io.binding, io.ty)) {
                    Some((Some(Binding::Location { .. }), ty)) => {
                        let width = components(&values.graph.module().types[ty].inner);
                        let flat = value.fact.rate.is_flat();
                        (None, Some(scale * price(width, flat)))
                    }
                    _ => (Some(0.0), None),
                },
                _ => {
                    let carriage = verdicts[id].as_ref().ok().filter(|c| allowed(c));
                    let price = carriage.and_then(|c| {
                        let (_, width) = shape(values, id)?;
                        let flat = c.interpolated == Interpolated::Flat;
                        // Of two names for one value, the one in the outermost function: it is carried without a copy of the callee.
                        let depth = depth(values, id);
                        Some(scale * price(f64::from(width), flat) * (1.0 + 0.002 * depth))
                    });
                    (Some(value.cost), price)
                }
            };
            Item {
                cost,
                price,
                operands: value.operands.clone(),
            }
        })
        .collect();
    let cut = cut::minimum(&items, &values.roots)?;
    Some((items, cut))
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

/// Scalar kind and number of components of a value that is a scalar or a vector.
pub fn shape(values: &Values<'_, '_>, id: ValueId) -> Option<(naga::ScalarKind, u8)> {
    let (context, e, _) = values.expression(id)?;
    match values.function(context).ty(values.graph.module(), e) {
        TypeInner::Scalar(s) => Some((s.kind, 1)),
        TypeInner::Vector { size, scalar } => Some((scalar.kind, *size as u8)),
        _ => None,
    }
}

fn depth(values: &Values<'_, '_>, id: ValueId) -> f64 {
    let Some((mut context, ..)) = values.expression(id) else {
        return 0.0;
    };
    let mut depth = 0.0;
    while let Some((caller, _)) = values.contexts[context].call {
        depth += 1.0;
        context = caller;
    }
    depth
}

/// Cost of computing values and all they rest on, each once, and the inputs among that.
pub fn below(values: &Values<'_, '_>, of: impl Iterator<Item = ValueId>) -> (f64, Vec<usize>) {
    let mut seen = vec![false; values.values.len()];
    let mut stack: Vec<ValueId> = of.collect();
    let (mut cost, mut inputs) = (0.0, Vec::new());
    while let Some(id) = stack.pop() {
        if std::mem::replace(&mut seen[id], true) {
            continue;
        }
        cost += values.values[id].cost;
        if let Node::Input(i) = values.values[id].node {
            inputs.push(i);
        }
        stack.extend(&values.values[id].operands);
    }
    inputs.sort_unstable();
    (cost, inputs)
}
