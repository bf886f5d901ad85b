//! The cost of values including everything they depend on.
//!
//! Shared operands count once per value, so this cost is not a sum over operands; it needs a walk
//! over all dependences.

use std::collections::BTreeMap;

use crate::analysis::cut;
use crate::analysis::named::{name, span};
use crate::analysis::reach::with_operands;
use crate::analysis::users::Users;
use crate::analysis::values::{Node, ValueId, Values};
use preshade_dataflow::graph::cost;
use preshade_plan::pass::Left;

/// The cost of values and all their dependences, each counted once, and the inputs among the
/// dependences.
pub(crate) fn transitive_cost(
    values: &Values<'_, '_>,
    of: impl Iterator<Item = ValueId>,
) -> (f64, Vec<usize>) {
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

/// Whether a value costs no more than `price` to compute once, with all its dependences.
///
/// In a loop the cost model counts it in each iteration, but a compiler computes a constant of the
/// draw ahead of the loop. To provide it from elsewhere, the loop would run there too
/// (`i < arrayLength(&lights)`).
pub(crate) fn is_cheap(values: &Values<'_, '_>, id: ValueId, price: f64) -> bool {
    let module = values.graph.module();
    let mut left = price;
    let (mut seen, mut work) = (Vec::new(), vec![id]);
    while let Some(id) = work.pop() {
        if seen.contains(&id) {
            continue;
        }
        seen.push(id);
        match values.values[id].node {
            Node::Control(..) => continue,
            Node::Expression(context, e, _) => {
                left -= cost::of_expression(module, values.function(context), e);
            }
            Node::Input(_) | Node::Version(..) => {}
        }
        if left < 0.0 || seen.len() > MOST_CHEAP {
            return false;
        }
        work.extend(&values.values[id].operands);
    }
    true
}

/// Most values that a cheap one is computed from, copies included.
const MOST_CHEAP: usize = 32;

/// The most expensive values and the cost of each ([`below`]), in no order. The result contains all
/// of the `most` most expensive ones that cost more than `least`, and perhaps others.
///
/// A value costs no more than any of its users. We therefore start near the outputs and go down
/// only while a value may still be among the most expensive.
pub(crate) fn dearest(
    values: &Values<'_, '_>,
    of: &[ValueId],
    most: usize,
    least: f64,
) -> Vec<(ValueId, f64)> {
    let mut walk = CostWalk::new(values);
    let mut left: Vec<usize> = of.iter().map(|id| walk.place[*id]).collect();
    left.sort_unstable();
    left.dedup();
    let depths = walk.depths();
    let mut found: Vec<(usize, f64)> = Vec::new();
    while !left.is_empty() {
        let bounds = walk.bounds(&found);
        found.sort_by(|a, b| b.1.total_cmp(&a.1));
        let enough = found
            .get(most.saturating_sub(1))
            .map_or(least, |(_, cost)| cost.max(least));
        left.retain(|at| bounds[*at] > enough);
        // Most expensive first. Among equals, callers' values first, because a call's result bounds
        // everything computed in it; then users before operands.
        left.sort_by(|a, b| {
            let dearer = bounds[*b].total_cmp(&bounds[*a]);
            dearer.then_with(|| (depths[*a], *a).cmp(&(depths[*b], *b)))
        });
        let mut some: Vec<usize> = left.drain(..left.len().min(Above::MOST)).collect();
        some.sort_unstable();
        let costs = walk.costs(&some);
        found.extend(some.into_iter().zip(costs));
    }
    let order = &walk.order;
    found.iter().map(|(at, cost)| (order[*at], *cost)).collect()
}

/// Named values that a pass leaves, at most `most`, the most expensive first. `why` gives the reason;
/// `None`: the value is not reported.
pub(crate) fn left(
    values: &Values<'_, '_>,
    most: usize,
    why: impl Fn(ValueId) -> Option<String>,
) -> Vec<Left> {
    let sources = values.graph.program().sources();
    let staying: BTreeMap<ValueId, (String, String)> = (0..values.values.len())
        .filter_map(|id| Some((id, (name(values, id)?, why(id)?))))
        .collect();
    let ids: Vec<ValueId> = staying.keys().copied().collect();
    let mut costs = dearest(values, &ids, most, 0.0);
    costs.sort_by_key(|(id, _)| *id);
    let mut left: Vec<Left> = costs
        .into_iter()
        .filter(|(_, cost)| *cost > 0.0)
        .filter_map(|(id, cost)| {
            let (name, reason) = staying.get(&id)?.clone();
            Some(Left {
                name,
                reason,
                cost: cost.round(),
                location: span(values, id).and_then(|s| sources.locate(s)),
            })
        })
        .collect();
    left.sort_by(|a, b| b.cost.total_cmp(&a.cost).then_with(|| a.name.cmp(&b.name)));
    left.dedup_by(|a, b| a.name == b.name && a.location == b.location);
    left.truncate(most);
    left
}

/// Walks from up to [`Above::MOST`] values at once. Values are numbered with users before operands,
/// except in cycles, so that a walk reads memory in order.
struct CostWalk<'v, 'g, 'p> {
    values: &'v Values<'g, 'p>,
    order: Vec<ValueId>,
    place: Vec<usize>,
    /// The operands of each value.
    operands: Users,
    /// Cost by position, without operands.
    own: Vec<f64>,
    /// By position: which of the starting values depend on it.
    resting: Vec<Above>,
    /// Bitset by position: whether any starting value depends on it.
    reached: Vec<u64>,
}

impl<'v, 'g, 'p> CostWalk<'v, 'g, 'p> {
    fn new(values: &'v Values<'g, 'p>) -> Self {
        let operands = |id: ValueId| values.values[id].operands.as_slice();
        let order = cut::users_first(0..values.values.len(), values.values.len(), operands);
        let mut place = vec![0; order.len()];
        for (at, id) in order.iter().enumerate() {
            place[*id] = at;
        }
        let pairs = order.iter().enumerate().flat_map(|(at, id)| {
            let operands = values.values[*id].operands.iter();
            operands.map(|o| place[*o]).map(move |o| (at, o))
        });
        Self {
            values,
            operands: Users::new(order.len(), pairs),
            own: order.iter().map(|id| values.values[*id].cost).collect(),
            resting: vec![Above::default(); order.len()],
            reached: vec![0; order.len().div_ceil(64)],
            order,
            place,
        }
    }

    /// Number of calls that lead to each value, by position.
    fn depths(&self) -> Vec<u32> {
        let depth = |id: &ValueId| match self.values.values[*id].node {
            Node::Input(_) => 0,
            Node::Expression(c, ..) | Node::Version(c, _) | Node::Control(c, _) => {
                self.values.contexts[c].depth
            }
        };
        self.order.iter().map(depth).collect()
    }

    /// Upper bound of each cost, by position: the known cost, or the smallest bound of a user.
    fn bounds(&self, found: &[(usize, f64)]) -> Vec<f64> {
        let mut bounds = vec![f64::INFINITY; self.order.len()];
        for (at, cost) in found {
            bounds[*at] = *cost;
        }
        for at in 0..bounds.len() {
            for operand in &self.operands[at] {
                bounds[*operand] = bounds[*operand].min(bounds[at]);
            }
        }
        bounds
    }

    /// The cost of each value; `some` has their positions in ascending order.
    fn costs(&mut self, some: &[usize]) -> Vec<f64> {
        let reach = |reached: &mut [u64], at: usize| reached[at / 64] |= 1 << (at % 64);
        // Operands follow their users, except in cycles, so all reached values are in this range.
        let mut from = some.first().copied().unwrap_or_default();
        let mut last = some.last().copied().unwrap_or_default();
        for (bit, at) in some.iter().enumerate() {
            self.resting[*at].insert(bit);
            reach(&mut self.reached, *at);
        }
        // Repeat cycles until nothing changes, which takes as many rounds as loops are nested.
        let mut changed = true;
        while std::mem::take(&mut changed) {
            let mut at = from;
            while let Some(next) = next_set(&self.reached[..=last / 64], at) {
                let above = self.resting[next];
                for operand in self.operands[next].iter().copied() {
                    let more = self.resting[operand].join(&above);
                    changed |= more && operand <= next;
                    reach(&mut self.reached, operand);
                    last = last.max(operand);
                    from = from.min(operand);
                }
                at = next + 1;
            }
        }
        // Add up parts with the same dependents before counting them.
        let mut shared: BTreeMap<Above, f64> = BTreeMap::new();
        let mut at = from;
        while let Some(next) = next_set(&self.reached[..=last / 64], at) {
            let above = std::mem::take(&mut self.resting[next]);
            let cost = self.own[next];
            if cost > 0.0 {
                *shared.entry(above).or_default() += cost;
            }
            at = next + 1;
        }
        self.reached[from / 64..=last / 64].fill(0);
        let mut costs = vec![0.0; some.len()];
        for (above, cost) in shared {
            for bit in above.iter() {
                costs[bit] += cost;
            }
        }
        costs
    }
}

/// The set of starting values that depend on a value.
#[derive(Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
struct Above([u64; 8]);

impl Above {
    const MOST: usize = 8 * 64;

    fn insert(&mut self, bit: usize) {
        self.0[bit / 64] |= 1 << (bit % 64);
    }

    /// Adds `other`; returns whether the set grew.
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

/// The first set bit from `from` on.
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

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use std::fmt::Write;

    use super::*;
    use preshade_dataflow::graph::Graph;
    use preshade_plan::program::Program;
    use shader_text::source::Language;

    /// Statements that each use two earlier values, some in loops.
    fn program(statements: usize) -> Program {
        let mut text = String::from(
            "@fragment fn fs(@location(0) a: f32) -> @location(0) vec4<f32> {\nvar x = a;\n\
             let v0 = a * 2.0;\n",
        );
        for i in 1..statements {
            let (far, near) = ((i * 7919) % i, i - 1 - (i % 5).min(i - 1));
            if i % 97 == 0 {
                writeln!(
                    text,
                    "for (var i = 0; i < 3; i++) {{ x = sin(x + v{far}); }}"
                )
                .unwrap();
            }
            writeln!(text, "let v{i} = sin(v{far}) * x + v{near};").unwrap();
        }
        writeln!(
            text,
            "return vec4<f32>(v{}, x, 0.0, 1.0);\n}}",
            statements - 1
        )
        .unwrap();
        let module = naga::front::wgsl::parse_str(&text).unwrap();
        Program::new(module, Default::default(), Language::Wgsl).unwrap()
    }

    #[test]
    fn the_dearest_are_those_that_cost_most_by_themselves() {
        let program = program(1_500);
        let graph = Graph::build(&program);
        let values = Values::new(&graph, 0).unwrap();
        let all: Vec<ValueId> = (0..values.values.len()).collect();
        let alone: Vec<f64> = all
            .iter()
            .map(|id| transitive_cost(&values, [*id].into_iter()).0)
            .collect();
        let dear = alone.iter().filter(|cost| **cost > 3.0).count();
        assert!(dear > 2 * Above::MOST, "{dear} of {}", all.len());
        for most in [1, 48, 700, all.len()] {
            let found = dearest(&values, &all, most, 3.0);
            for (id, cost) in &found {
                assert!(
                    (cost - alone[*id]).abs() <= 1e-6 * cost,
                    "{cost} and {}",
                    alone[*id]
                );
            }
            let sorted = |mut costs: Vec<f64>| {
                costs.sort_by(|a, b| b.total_cmp(a));
                costs.truncate(most.min(dear));
                costs
            };
            let (found, wanted) = (
                sorted(found.into_iter().map(|(_, cost)| cost).collect()),
                sorted(alone.clone()),
            );
            assert_eq!(found.len(), wanted.len());
            let is_near = |(a, b): (&f64, &f64)| (a - b).abs() < 1e-6 * b;
            assert!(found.iter().zip(&wanted).all(is_near), "of {most}");
        }
    }
}
