//! The choice of what to hoist: minimum cuts over a sweep of what transport costs, the best of those that fit.

use std::collections::BTreeMap;

use naga::{Binding, BuiltIn, TypeInner};

use super::cut::{self, Cut, Item};
use super::pack::{self, Load, Slot};
use super::reach::with_operands;
use super::travel::{Carriage, Class, Judged, Verdict};
use super::values::{Node, Value, ValueId, Values};
use crate::graph::rate::Interpolated;

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
    /// Varyings of the author's that the fragment stage still reads, by index in the order of [`Values::inputs`].
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

/// The cheapest thing to hoist of which the roundings change an output by `most` at most; `None` where nothing pays.
pub fn choose(
    values: &Values<'_, '_>,
    judged: &Judged,
    most: f64,
    terms: &Terms,
) -> Option<Choice> {
    let verdicts = &judged.verdicts;
    let before = {
        let items = items(values, verdicts, |_| false);
        total(&items, &cut::minimum(&items, &values.roots)?)
    };
    let items = items(values, verdicts, |c| c.class <= terms.weakest);
    let mut cuts = cut::sweep(&items, &values.roots, &SWEEP)?;
    cuts.dedup_by(|a, b| a.computed == b.computed && a.carried == b.carried);
    let mut best: Option<(f64, Choice)> = None;
    for cut in &cuts {
        let Some(choice) = cut_at(values, verdicts, &items, cut, before) else {
            continue;
        };
        let affine = choice.carried.iter();
        let affine = affine.filter(|(_, c)| c.class == Class::Affine);
        let affine: Vec<ValueId> = affine.map(|(id, _)| *id).collect();
        if !affine.is_empty() && judged.roundings.together(&affine) > most {
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

/// One value carried, whether that pays or not; `None` where it does not fit.
pub fn one(values: &Values<'_, '_>, verdicts: &[Verdict], id: ValueId) -> Option<Choice> {
    let mut items = items(values, verdicts, |_| false);
    let before = total(&items, &cut::minimum(&items, &values.roots)?);
    // It cannot be computed in the fragment stage, like an incoming varying.
    items[id] = Item {
        cost: None,
        price: Some(0.0),
        ..items[id].clone()
    };
    let cut = cut::minimum(&items, &values.roots)?;
    cut_at(values, verdicts, &items, &cut, before)
}

/// What a cut carries, packed; `None` where that is nothing, or does not fit.
fn cut_at(
    values: &Values<'_, '_>,
    verdicts: &[Verdict],
    items: &[Item],
    cut: &Cut,
    before: f64,
) -> Option<Choice> {
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
            let (kind, width) = shape(values, *id)?;
            Some(Load {
                width,
                kind,
                carriage: *carriage,
            })
        })
        .collect();
    let slots = pack::pack(&loads, kept.len(), limit)?;
    let (vertex, read) = below(values, carried.iter().map(|(id, _)| *id));
    Some(Choice {
        after: total(items, cut),
        carried,
        slots,
        kept,
        read,
        before,
        vertex,
    })
}

/// What a fragment pays under a cut: transport, and what it computes.
fn total(items: &[Item], cut: &Cut) -> f64 {
    let transport: f64 = cut.carried.iter().filter_map(|id| items[*id].price).sum();
    let computed = (0..items.len()).filter(|i| cut.computed[*i]);
    transport + computed.filter_map(|i| items[i].cost).sum::<f64>()
}

/// The values as what a cut chooses from.
fn items(
    values: &Values<'_, '_>,
    verdicts: &[Verdict],
    allowed: impl Fn(&Carriage) -> bool,
) -> Vec<Item> {
    let item = |id: ValueId, value: &Value| {
        let (cost, price) = match &value.node {
            Node::Input(i) => match values.inputs.get(*i).map(|io| (&io.binding, io.ty)) {
                Some((Some(Binding::Location { .. }), ty)) => {
                    let width = components(&values.graph.module().types[ty].inner);
                    let flat = value.fact.rate.is_flat();
                    (None, Some(price(width, flat)))
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
                    Some(price(f64::from(width), flat) * (1.0 + 0.002 * depth))
                });
                (Some(value.cost), price)
            }
        };
        Item {
            cost,
            price,
            operands: value.operands.clone(),
        }
    };
    let all = values.values.iter().enumerate();
    all.map(|(id, value)| item(id, value)).collect()
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
    let held = with_operands(values, of.collect());
    let (mut cost, mut inputs) = (0.0, Vec::new());
    for (value, _) in values.values.iter().zip(held).filter(|(_, held)| *held) {
        cost += value.cost;
        if let Node::Input(i) = value.node {
            inputs.push(i);
        }
    }
    inputs.sort_unstable();
    (cost, inputs)
}

/// Cost of computing each of several values by itself, with all it rests on: [`below`] of each.
///
/// What values share is counted once for each, so that this cannot be had from the costs of their operands. The walk is shared by as many of them as an `Above`
/// holds, and parts of the graph that the same ones rest on are added up before they are counted.
pub fn below_each(values: &Values<'_, '_>, of: &[ValueId]) -> Vec<f64> {
    let operands = |id: ValueId| values.values[id].operands.as_slice();
    let order = cut::users_first(0..values.values.len(), values.values.len(), operands);
    let mut place = vec![0; order.len()];
    for (at, id) in order.iter().enumerate() {
        place[*id] = at;
    }
    let mut sorted: Vec<usize> = (0..of.len()).collect();
    sorted.sort_by_key(|i| place[of[*i]]);
    let mut costs = vec![0.0; of.len()];
    // By place, so that a walk goes upwards; `reached` keeps it to what is there.
    let mut resting = vec![Above::default(); order.len()];
    let mut reached = vec![0_u64; order.len().div_ceil(64)];
    let reach = |reached: &mut [u64], at: usize| reached[at / 64] |= 1 << (at % 64);
    for some in sorted.chunks(Above::MOST) {
        // Operands stand behind, but those of a circle: what is reached lies between these.
        let mut from = some.first().map_or(0, |i| place[of[*i]]);
        let mut last = from;
        for (bit, i) in some.iter().enumerate() {
            resting[place[of[*i]]].insert(bit);
            reach(&mut reached, place[of[*i]]);
            last = last.max(place[of[*i]]);
        }
        // A circle is passed again until nothing changes: as often as loops are nested.
        let mut changed = true;
        while std::mem::take(&mut changed) {
            let mut at = from;
            while let Some(next) = next_set(&reached[..=last / 64], at) {
                let above = resting[next];
                for operand in operands(order[next]).iter().map(|o| place[*o]) {
                    let more = resting[operand].join(&above);
                    changed |= more && operand <= next;
                    reach(&mut reached, operand);
                    last = last.max(operand);
                    from = from.min(operand);
                }
                at = next + 1;
            }
        }
        let mut shared: BTreeMap<Above, f64> = BTreeMap::new();
        let mut at = from;
        while let Some(next) = next_set(&reached[..=last / 64], at) {
            let above = std::mem::take(&mut resting[next]);
            let cost = values.values[order[next]].cost;
            if cost > 0.0 {
                *shared.entry(above).or_default() += cost;
            }
            at = next + 1;
        }
        reached[from / 64..=last / 64].fill(0);
        for (above, cost) in shared {
            for bit in above.iter() {
                costs[some[bit]] += cost;
            }
        }
    }
    costs
}

/// Which of some values rest on one.
#[derive(Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
struct Above([u64; 8]);

impl Above {
    const MOST: usize = 8 * 64;

    fn insert(&mut self, bit: usize) {
        self.0[bit / 64] |= 1 << (bit % 64);
    }

    /// Takes in all of `other`; whether any was new.
    fn join(&mut self, other: &Self) -> bool {
        let mut new = 0;
        for (mine, more) in self.0.iter_mut().zip(other.0) {
            new |= more & !*mine;
            *mine |= more;
        }
        new != 0
    }

    fn iter(&self) -> impl Iterator<Item = usize> {
        let first = next_set(&self.0, 0);
        std::iter::successors(first, |at| next_set(&self.0, at + 1))
    }
}

/// The first bit that is set from `from` on.
fn next_set(words: &[u64], from: usize) -> Option<usize> {
    let first = words.get(from / 64)? & (u64::MAX << (from % 64));
    if first != 0 {
        return Some(from / 64 * 64 + first.trailing_zeros() as usize);
    }
    let rest = words.iter().enumerate().skip(from / 64 + 1);
    rest.filter(|(_, word)| **word != 0)
        .map(|(i, word)| i * 64 + word.trailing_zeros() as usize)
        .next()
}
