//! What to carry and what to compute: a minimum cut.
//!
//! Each value `v` has two nodes: `N(v)`, it is needed in the fragment stage, and `F(v)`, it is computed there.
//!
//! ```text
//! source ──∞──▶ N(root)          what is observed is needed
//! N(v) ──price──▶ F(v)           cut: v comes in a varying            (∞ where it may not travel)
//! F(v) ──cost──▶ sink            cut: v is computed in each fragment  (∞ for what no fragment can compute)
//! F(v) ──∞──▶ N(operand)         whoever computes v needs its operands
//! ```
//!
//! A finite cut is a choice of transports and computations that gives every root; the least one is the cheapest such choice. A value that several others
//! need pays once, and computing a cheap value again beside a carried one is free to win. This differs from the one post-dominator an input of
//! Mesa's `nir_opt_varyings`: three inputs of which two sums are needed are carried as the two sums.
//!
//! Operands may be circular, as in a loop: then none of the circle is computed without all of it.

use petgraph::Direction;
use petgraph::algo::dinics;
use petgraph::graph::{DiGraph, NodeIndex};
use petgraph::visit::EdgeRef;

/// A value in the cut problem.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Item {
    /// What computing it costs a fragment, apart from its operands; `None` for what no fragment can compute.
    pub cost: Option<f64>,
    /// What carrying it costs a fragment; `None` for what may not travel.
    pub price: Option<f64>,
    /// Items it is computed from.
    pub operands: Vec<usize>,
}

/// The cheapest choice.
#[derive(Clone, Debug, PartialEq)]
pub struct Cut {
    /// Items that come in varyings, in ascending order.
    pub carried: Vec<usize>,
    /// Whether each item is computed in the fragment stage.
    pub computed: Vec<bool>,
    /// What both cost together, in the units of the items.
    pub cost: f64,
}

/// Capacities are whole numbers, so that the flow is exact: costs are rounded to this part of a unit.
const RESOLUTION: f64 = 4096.0;

fn capacity(cost: f64) -> u64 {
    (cost.clamp(0.0, 1e9) * RESOLUTION).round() as u64
}

/// The cheapest way to have every one of `roots`; `None` where there is none: a root may not travel and rests on what no fragment can compute.
/// Among equally cheap ways the one that computes least is taken.
pub fn minimum(items: &[Item], roots: &[usize]) -> Option<Cut> {
    let finite: u64 = items
        .iter()
        .flat_map(|i| [i.cost, i.price])
        .flatten()
        .map(capacity)
        .sum();
    let infinite = finite + 1;
    let mut network = DiGraph::<(), u64>::with_capacity(2 * items.len() + 2, 4 * items.len());
    let needed: Vec<NodeIndex> = items.iter().map(|_| network.add_node(())).collect();
    let computed: Vec<NodeIndex> = items.iter().map(|_| network.add_node(())).collect();
    let (source, sink) = (network.add_node(()), network.add_node(()));
    for root in roots {
        network.add_edge(source, needed[*root], infinite);
    }
    for (i, item) in items.iter().enumerate() {
        let or_infinite = |c: Option<f64>| c.map_or(infinite, capacity);
        network.add_edge(needed[i], computed[i], or_infinite(item.price));
        network.add_edge(computed[i], sink, or_infinite(item.cost));
        for operand in &item.operands {
            network.add_edge(computed[i], needed[*operand], infinite);
        }
    }
    let (flow, flows) = dinics(&network, source, sink);
    if flow >= infinite {
        return None;
    }
    // What the source still reaches in the residual network: the smallest source side of all minimum cuts.
    let mut reached = vec![false; network.node_count()];
    let mut stack = vec![source];
    reached[source.index()] = true;
    while let Some(node) = stack.pop() {
        let onward = network
            .edges(node)
            .filter(|e| flows[e.id().index()] < *e.weight())
            .map(|e| e.target());
        let back = network
            .edges_directed(node, Direction::Incoming)
            .filter(|e| flows[e.id().index()] > 0)
            .map(|e| e.source());
        for next in onward.chain(back) {
            if !std::mem::replace(&mut reached[next.index()], true) {
                stack.push(next);
            }
        }
    }
    Some(Cut {
        carried: (0..items.len())
            .filter(|i| reached[needed[*i].index()] && !reached[computed[*i].index()])
            .collect(),
        computed: computed.iter().map(|c| reached[c.index()]).collect(),
        cost: flow as f64 / RESOLUTION,
    })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    /// Every choice of carried items tried; the cost of the cheapest that works.
    fn brute_force(items: &[Item], roots: &[usize]) -> Option<f64> {
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
                    stack.extend(&items[i].operands);
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

    fn random(seed: u64) -> (Vec<Item>, Vec<usize>) {
        let mut random = Random(seed);
        let count = 2 + random.below(13) as usize;
        let items = (0..count)
            .map(|i| {
                let is_input = i == 0 || random.below(4) == 0;
                let operands = if is_input {
                    Vec::new()
                } else {
                    // One in sixteen looks forward, which makes circles.
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
                    operands,
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

    /// The open example of Mesa's `nir_opt_varyings`: of three inputs only two sums are needed.
    #[test]
    fn three_inputs_are_carried_as_two() {
        let input = Item {
            price: Some(4.0),
            ..Item::default()
        };
        let sum = |a, b| Item {
            cost: Some(1.0),
            price: Some(4.0),
            operands: vec![a, b],
        };
        let root = Item {
            cost: Some(9.0),
            price: None,
            operands: vec![3, 4],
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
