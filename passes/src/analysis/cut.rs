//! Decides which values a stage is given and which it computes: a minimum cut.
//!
//! `hoist` gives a fragment stage values in varyings, `preamble` in a buffer of the draw. Each
//! value `v` has two nodes: `N(v)`, needed in the fragment stage, and `F(v)`, computed there.
//!
//! ```text
//! source ──∞──▶ N(root)          the observed values are needed
//! N(v) ──price──▶ F(v)           cut: v is given                      (∞ if it must not move)
//! F(v) ──cost──▶ sink            cut: v is computed in each fragment  (∞ if no fragment can compute it)
//! F(v) ──∞──▶ N(operand)         computing v needs its operands
//! ```
//!
//! A finite cut is a choice of transports and computations that provides every root, and the
//! minimum cut is the cheapest one. A value with several users pays once. It may be cheaper to
//! compute a value again although the stage is given one that depends on it, and the cut finds that
//! too. Mesa's `nir_opt_varyings` allows one post-dominator per input; here, two needed sums of
//! three inputs become two varyings.
//!
//! Operands may form cycles, as in loops. Then the whole cycle is computed or none of it.
//!
//! Most of a shader's values must not move. We contract them before computing a flow. From a root
//! down to the first movable values, everything is computed anyway. A value that must not move
//! belongs to its user; if it has only one, the two share a node. A value that depends on a missing
//! input cannot be computed. The flow handles only the movable values and their shared operands.

use std::borrow::Cow;

use rustc_hash::FxHashSet;

use crate::analysis::users::Users;
use crate::analysis::values::{ValueId, Values};

mod flow;

use flow::{Arc, Network};

/// A value in the cut problem.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Item<'a> {
    /// Cost per fragment without operands; `None` if no fragment can compute it.
    pub cost: Option<f64>,
    /// Transport price per fragment; `None` if it must not move.
    pub price: Option<f64>,
    /// Items that it is computed from.
    pub operands: Cow<'a, [usize]>,
}

/// A stage's values as items. `price` is the cost for each fragment of giving a value; `None`: it
/// must not move.
pub(crate) fn items<'v>(
    values: &'v Values<'_, '_>,
    price: impl Fn(ValueId) -> Option<f64>,
) -> Vec<Item<'v>> {
    let all = values.values.iter().enumerate();
    all.map(|(id, value)| {
        let depth = values
            .expression(id)
            .map(|(c, ..)| values.contexts[c].depth);
        // If a value has two names, prefer the outermost function's: it needs no copy of the
        // callee.
        let depth = 1.0 + 0.002 * f64::from(depth.unwrap_or_default());
        Item {
            cost: Some(value.cost),
            price: price(id).map(|price| price * depth),
            operands: Cow::Borrowed(&value.operands),
        }
    })
    .collect()
}

/// The cost of each fragment if it is given nothing.
pub(crate) fn uncut(values: &Values<'_, '_>) -> Option<f64> {
    let items = items(values, |_| None);
    Some(minimum(&items, &values.roots)?.total(&items))
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Cut {
    /// Items that are given, in ascending order.
    pub carried: Vec<usize>,
    /// Whether the fragment stage computes each item.
    pub computed: Vec<bool>,
    /// Total cost in the units of the items.
    pub cost: f64,
}

impl Cut {
    /// Prices of given values plus costs of computed ones, without rounding and multiples.
    pub fn total(&self, items: &[Item<'_>]) -> f64 {
        let given: f64 = self.carried.iter().filter_map(|id| items[*id].price).sum();
        let computed = (0..items.len()).filter(|i| self.computed[*i]);
        given + computed.filter_map(|i| items[i].cost).sum::<f64>()
    }
}

/// Capacities are integers, so that the flow is exact. Costs are rounded to this fraction of a
/// unit.
const RESOLUTION: f64 = 4096.0;

fn capacity(cost: f64) -> u64 {
    (cost.clamp(0.0, 1e9) * RESOLUTION).round() as u64
}

/// The cheapest way to provide every root, and of several the one that computes least. `None`:
/// there is none, because a root must not move and depends on a value that no fragment can compute.
pub(crate) fn minimum(items: &[Item<'_>], roots: &[usize]) -> Option<Cut> {
    sweep(items, roots, &[1.0])?.pop()
}

/// The cheapest ways for each multiple of the prices, in ascending order. `None` as in [`minimum`];
/// it does not depend on the price.
pub(crate) fn sweep(items: &[Item<'_>], roots: &[usize], multiples: &[f64]) -> Option<Vec<Cut>> {
    let mut network = Contracted::new(items, roots)?;
    Some(multiples.iter().map(|m| network.cut(items, *m)).collect())
}

const SOURCE: usize = 0;
const SINK: usize = 1;

/// The network after contracting nodes that no finite cut separates: most values must not move and
/// join their users.
struct Contracted {
    network: Network,
    /// The node of `N(item)`; `None` if no item needs it.
    needed: Vec<Option<usize>>,
    /// The node of `F(item)`.
    computed: Vec<Option<usize>>,
    /// Items with a price that may be cut: the arc and its current capacity.
    prices: Vec<(usize, usize, u64)>,
    /// Cost of the values that are always computed.
    base: u64,
    flow: u64,
}

/// More than any possible flow.
const INFINITE: u64 = u64::MAX / 4;

impl Contracted {
    fn new(items: &[Item<'_>], roots: &[usize]) -> Option<Self> {
        let order = users_first(roots.iter().copied(), items.len(), |i| &items[i].operands);
        let users = users(items, &order);
        let impossible = impossible(items, &users);
        let forced = forced(items, roots);
        if (0..items.len()).any(|i| forced[i] && impossible[i]) {
            return None;
        }
        let mut of_source = vec![false; items.len()];
        let operands_of_forced = (0..items.len())
            .filter(|i| forced[*i])
            .flat_map(|i| items[i].operands.iter());
        for item in operands_of_forced.chain(roots) {
            of_source[*item] = true;
        }
        let mut needed: Vec<Option<usize>> = vec![None; items.len()];
        let mut computed: Vec<Option<usize>> = vec![None; items.len()];
        let mut nodes = 2;
        for item in order {
            let mut above = users[item]
                .iter()
                .map(|u| computed[*u])
                .filter(|node| *node != Some(SINK));
            let mut fresh = || {
                nodes += 1;
                nodes - 1
            };
            let need = match above.next() {
                _ if of_source[item] => SOURCE,
                _ if impossible[item] && items[item].price.is_none() => SINK,
                // Its only user decides, or all of its users share a node.
                Some(Some(first)) if above.all(|node| node == Some(first)) => first,
                _ => fresh(),
            };
            needed[item] = Some(need);
            computed[item] = Some(match items[item].price {
                _ if forced[item] => SOURCE,
                _ if impossible[item] => SINK,
                Some(_) => fresh(),
                None => need,
            });
        }
        Some(Self::connected(items, nodes, needed, computed))
    }

    fn connected(
        items: &[Item<'_>],
        nodes: usize,
        needed: Vec<Option<usize>>,
        computed: Vec<Option<usize>>,
    ) -> Self {
        let mut arcs = Vec::new();
        let mut prices = Vec::new();
        let mut costs = vec![0; nodes];
        let mut joined: FxHashSet<(usize, usize)> = FxHashSet::default();
        for (i, item) in items.iter().enumerate() {
            let (Some(need), Some(compute)) = (needed[i], computed[i]) else {
                continue;
            };
            if item.price.is_some() && need != compute {
                prices.push((i, arcs.len(), 0));
                arcs.push(Arc {
                    from: need,
                    to: compute,
                    capacity: 0,
                });
            }
            if compute == SINK {
                continue;
            }
            costs[compute] += item.cost.map_or(0, capacity);
            for operand in item.operands.iter() {
                let Some(operand) = needed[*operand] else {
                    continue;
                };
                if compute != operand && operand != SOURCE && joined.insert((compute, operand)) {
                    arcs.push(Arc {
                        from: compute,
                        to: operand,
                        capacity: INFINITE,
                    });
                }
            }
        }
        for (node, cost) in costs.iter().enumerate() {
            if node != SOURCE && *cost > 0 {
                arcs.push(Arc {
                    from: node,
                    to: SINK,
                    capacity: *cost,
                });
            }
        }
        Self {
            network: Network::new(nodes, &arcs),
            needed,
            computed,
            prices,
            base: costs[SOURCE],
            flow: 0,
        }
    }

    fn cut(&mut self, items: &[Item<'_>], multiple: f64) -> Cut {
        for (item, arc, before) in &mut self.prices {
            let price = capacity(items[*item].price.unwrap_or_default() * multiple);
            self.network.widen(*arc, price.saturating_sub(*before));
            *before = price.max(*before);
        }
        self.flow += self.network.augment(SOURCE, SINK);
        let reached = self.network.reached(SOURCE);
        let is_reached = |node: &Option<usize>| node.is_some_and(|n| reached[n]);
        let computed: Vec<bool> = self.computed.iter().map(is_reached).collect();
        let carried = self.needed.iter().zip(&computed).enumerate();
        Cut {
            carried: carried
                .filter(|(_, (needed, computed))| is_reached(needed) && !**computed)
                .map(|(i, _)| i)
                .collect(),
            computed,
            cost: (self.base + self.flow) as f64 / RESOLUTION,
        }
    }
}

/// The users of each item, among some.
fn users(items: &[Item<'_>], among: &[usize]) -> Users {
    let operands = |item: &usize| {
        items[*item]
            .operands
            .iter()
            .copied()
            .zip(std::iter::repeat(*item))
    };
    Users::new(items.len(), among.iter().flat_map(operands))
}

/// Items that no fragment can compute: neither by themselves nor from operands that must not move.
fn impossible(items: &[Item<'_>], users: &Users) -> Vec<bool> {
    let mut impossible = vec![false; items.len()];
    let mut stack: Vec<usize> = (0..items.len())
        .filter(|i| items[*i].cost.is_none())
        .collect();
    while let Some(item) = stack.pop() {
        if !std::mem::replace(&mut impossible[item], true) && items[item].price.is_none() {
            stack.extend(&users[item]);
        }
    }
    impossible
}

/// Items that are always computed: a path from a root reaches them without passing a movable item.
fn forced(items: &[Item<'_>], roots: &[usize]) -> Vec<bool> {
    let mut forced = vec![false; items.len()];
    let mut stack = roots.to_vec();
    while let Some(item) = stack.pop() {
        if items[item].price.is_none() && !std::mem::replace(&mut forced[item], true) {
            stack.extend(items[item].operands.iter());
        }
    }
    forced
}

/// The dependences of `roots`, users before operands. In a cycle, the first one reached comes
/// first.
pub(super) fn users_first<'a>(
    roots: impl IntoIterator<Item = usize>,
    count: usize,
    operands: impl Fn(usize) -> &'a [usize],
) -> Vec<usize> {
    let mut seen = vec![false; count];
    let mut order = Vec::with_capacity(count);
    let mut stack: Vec<(usize, usize)> = Vec::new();
    for root in roots {
        if !std::mem::replace(&mut seen[root], true) {
            stack.push((root, 0));
        }
        // An item is placed after all its operands; the caller reverses the order.
        while let Some((item, next)) = stack.last_mut() {
            match operands(*item).get(*next).copied() {
                Some(operand) => {
                    *next += 1;
                    if !std::mem::replace(&mut seen[operand], true) {
                        stack.push((operand, 0));
                    }
                }
                None => {
                    order.push(*item);
                    stack.pop();
                }
            }
        }
    }
    order.reverse();
    order
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    /// Tries every choice of items; returns the cost of the cheapest valid one.
    fn brute_force(items: &[Item<'_>], roots: &[usize]) -> Option<f64> {
        (0..1_u32 << items.len())
            .filter_map(|carried| {
                let is_carried = |i: usize| carried >> i & 1 == 1;
                let mut computed = vec![false; items.len()];
                let mut stack = roots.to_vec();
                let mut cost = 0.0;
                while let Some(i) = stack.pop() {
                    if is_carried(i) || std::mem::replace(&mut computed[i], true) {
                        continue;
                    }
                    cost += items[i].cost?;
                    stack.extend(items[i].operands.iter());
                }
                for item in (0..items.len())
                    .filter(|i| is_carried(*i))
                    .map(|i| &items[i])
                {
                    cost += item.price?;
                }
                Some(cost)
            })
            .min_by(f64::total_cmp)
    }

    /// A small linear congruential generator: the same graphs on every machine.
    struct Random(u64);

    impl Random {
        fn below(&mut self, n: u64) -> u64 {
            self.0 = self
                .0
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 33) % n
        }
    }

    fn random(seed: u64) -> (Vec<Item<'static>>, Vec<usize>) {
        let mut random = Random(seed);
        let count = 2 + random.below(13) as usize;
        let items = (0..count)
            .map(|i| {
                let is_input = i == 0 || random.below(4) == 0;
                let operands = if is_input {
                    Vec::new()
                } else {
                    // One in sixteen looks forward, which creates cycles.
                    let reach = match random.below(16) {
                        0 => count,
                        _ => i,
                    };
                    (0..=random.below(3))
                        .map(|_| random.below(reach as u64) as usize)
                        .filter(|o| *o != i)
                        .collect()
                };
                Item {
                    cost: (!is_input || random.below(6) == 0).then(|| random.below(9) as f64),
                    price: (is_input || random.below(3) > 0).then(|| 1.0 + random.below(6) as f64),
                    operands: Cow::Owned(operands),
                }
            })
            .collect();
        let roots = (0..=random.below(2)).map(|_| random.below(count as u64) as usize);
        (items, roots.collect())
    }

    #[test]
    fn the_cut_is_as_cheap_as_the_best_of_all_choices() {
        let mut possible = 0;
        for seed in 0..400 {
            let (items, roots) = random(seed);
            let best = brute_force(&items, &roots);
            let cut = minimum(&items, &roots);
            assert_eq!(
                cut.as_ref().map(|c| c.cost),
                best,
                "seed {seed}: {items:?} {roots:?}"
            );
            possible += usize::from(best.is_some());
        }
        assert!(possible >= 200, "only {possible} of the graphs had any way");
    }

    #[test]
    fn the_choice_gives_every_root_and_costs_what_it_says() {
        for seed in 400..600 {
            let (items, roots) = random(seed);
            let Some(cut) = minimum(&items, &roots) else {
                continue;
            };
            let has = |i: usize| cut.computed[i] || cut.carried.contains(&i);
            assert!(roots.iter().all(|r| has(*r)));
            let mut cost = 0.0;
            for (i, item) in items.iter().enumerate() {
                if cut.computed[i] {
                    cost += item.cost.unwrap();
                    assert!(item.operands.iter().all(|o| has(*o)));
                }
                if cut.carried.contains(&i) {
                    cost += item.price.unwrap();
                }
            }
            assert_eq!(cost, cut.cost, "seed {seed}");
        }
    }

    /// The cut at a multiple does not depend on the cheaper ones before it, ties included.
    #[test]
    fn a_sweep_cuts_at_each_multiple_as_if_it_were_the_only_one() {
        let multiples = [1.0, 1.5, 2.0, 4.0, 64.0];
        for seed in 600..800 {
            let (items, roots) = random(seed);
            let Some(swept) = sweep(&items, &roots, &multiples) else {
                assert_eq!(minimum(&items, &roots), None);
                continue;
            };
            for (multiple, cut) in multiples.iter().zip(swept) {
                let scaled: Vec<Item<'_>> = items
                    .iter()
                    .map(|item| Item {
                        price: item.price.map(|p| p * multiple),
                        ..item.clone()
                    })
                    .collect();
                assert_eq!(minimum(&scaled, &roots), Some(cut), "seed {seed}");
            }
        }
    }

    /// A stage of `count` statements `x = x * a + sin(x + b)` one after another, of which every
    /// `stays`-th value may not travel.
    fn straight_line(count: usize, stays: usize) -> Vec<Item<'static>> {
        let mut items = vec![Item {
            price: Some(4.0),
            ..Item::default()
        }];
        for _ in 0..count {
            let x = items.len() - 1;
            let at = items.len();
            for (cost, operands) in [
                (1.0, vec![x]),
                (1.0, vec![x]),
                (4.0, vec![at + 1]),
                (1.0, vec![at, at + 2]),
            ] {
                items.push(Item {
                    cost: Some(cost),
                    price: (items.len() % stays > 0).then_some(4.0),
                    operands: operands.into(),
                });
            }
        }
        items
    }

    #[test]
    fn the_flow_looks_at_no_more_of_a_longer_stage() {
        let multiples = [1.0, 4.0, 16.0, 64.0];
        for stays in [1, 2, 3, 5, 97] {
            let work = |count| {
                let items = straight_line(count, stays);
                let mut network = Contracted::new(&items, &[items.len() - 1]).unwrap();
                for multiple in multiples {
                    network.cut(&items, multiple);
                }
                network.network.work()
            };
            let (short, long) = (work(200), work(800));
            // A high price moves values further down, but not without bound.
            assert!(long <= short + short / 4, "{stays}: {short}, then {long}");
        }
    }

    /// The open example of Mesa's `nir_opt_varyings`: of three inputs, only two sums are needed.
    #[test]
    fn three_inputs_are_carried_as_two() {
        let input = Item {
            price: Some(4.0),
            ..Item::default()
        };
        let sum = |a, b| Item {
            cost: Some(1.0),
            price: Some(4.0),
            operands: vec![a, b].into(),
        };
        let root = Item {
            cost: Some(9.0),
            price: None,
            operands: vec![3, 4].into(),
        };
        let items = [
            input.clone(),
            input.clone(),
            input,
            sum(0, 1),
            sum(1, 2),
            root,
        ];
        let cut = minimum(&items, &[5]).unwrap();
        assert_eq!(cut.carried, [3, 4]);
        assert_eq!(cut.cost, 9.0 + 8.0);
    }
}
