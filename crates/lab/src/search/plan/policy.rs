//! The policy for all views of a scene: for each draw order one plan, or two plans and a switch.
//! Pure functions of numbers.

use serde::{Deserialize, Serialize};

use super::choose::{Table, WORTHWHILE};
use preshade_draw::scene::DrawOrder;

/// Two plans, and when to change from one to the other.
///
/// The measure is the number of fragments shaded by the original's opaque draws, divided by the
/// pixels of the frame. A host gets it from an occlusion query that counts samples, or from
/// pipeline statistics, around its opaque draws. A depth pre-pass gives the same count, because it
/// is drawn in the same order under the same test.
///
/// Between the two thresholds the host keeps its plan. The measure of a moving camera changes
/// little between frames, so the host has time to build the other pipelines.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Switch {
    /// The plan while little is shaded in vain: its number in the decision.
    pub below: usize,
    /// The plan while much is shaded in vain.
    pub above: usize,
    /// Go over to `above` where the measure exceeds this.
    pub on: f64,
    /// Go back to `below` where it falls under this, which is less.
    pub off: f64,
}

impl Switch {
    /// The plan of the next frame. `current` is the plan of this frame, and `measure` the fragments
    /// it shaded for each pixel.
    pub fn next(&self, current: usize, measure: f64) -> usize {
        match current == self.above {
            true if measure < self.off => self.below,
            false if measure > self.on => self.above,
            true => self.above,
            false => self.below,
        }
    }

    /// The plan of a view that does not change.
    pub fn settled(&self, measure: f64) -> usize {
        match measure > (self.on + self.off) / 2.0 {
            true => self.above,
            false => self.below,
        }
    }
}

/// How the views' plans are held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hold {
    /// One plan for all views.
    One,
    /// One, or two with a switch between them where that pays.
    Switching,
}

/// The rule for one draw order.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum Rule {
    One {
        /// Its number in the decision.
        plan: usize,
    },
    /// Two plans, and the thresholds between them.
    Switch(Switch),
}

impl Rule {
    /// The plan that a view of that measure is drawn with.
    pub fn plan(&self, measure: f64) -> usize {
        match self {
            Self::One { plan } => *plan,
            Self::Switch(switch) => switch.settled(measure),
        }
    }

    pub fn plans(&self) -> Vec<usize> {
        match self {
            Self::One { plan } => vec![*plan],
            Self::Switch(switch) => vec![switch.below, switch.above],
        }
    }
}

/// A rule, and the draw orders it holds for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RuleRange {
    /// Orders, as the scene lists them.
    pub orders: Vec<DrawOrder>,
    #[serde(flatten)]
    pub rule: Rule,
}

/// The decision over all views: a rule for each draw order, or one for all. A host knows its draw
/// order, and so its rule.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Policy(pub Vec<RuleRange>);

impl Policy {
    /// The rule of an order. `None`: it has none.
    pub fn rule(&self, order: DrawOrder) -> Option<Rule> {
        let held = self.0.iter().find(|h| h.orders.contains(&order));
        held.map(|h| h.rule)
    }

    /// The plan for a view of that order and measure. The original if the order has no rule.
    pub fn plan(&self, order: DrawOrder, measure: f64) -> usize {
        self.rule(order).map_or(0, |rule| rule.plan(measure))
    }

    /// The plans of all rules, each once.
    pub fn plans(&self) -> Vec<usize> {
        let mut all = Vec::new();
        for plan in self.0.iter().flat_map(|h| h.rule.plans()) {
            if !all.contains(&plan) {
                all.push(plan);
            }
        }
        all
    }
}

/// The properties of a view that select its plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Measure {
    pub order: DrawOrder,
    /// Fragments of the original for each pixel.
    pub shaded: f64,
}

/// The policy for all views, which `measures` describes.
///
/// There is one rule for all orders unless a rule for each order is faster in some view beyond
/// noise. A host has the pipelines only for the order it draws in.
pub(crate) fn policy(table: &Table, measures: &[Measure], hold: Hold) -> Policy {
    let mut orders: Vec<DrawOrder> = Vec::new();
    for m in measures {
        if !orders.contains(&m.order) {
            orders.push(m.order);
        }
    }
    let all: Vec<usize> = (0..table.views()).collect();
    let joint = rule(table, measures, &all, hold);
    let same = |orders| {
        Policy(vec![RuleRange {
            orders,
            rule: joint,
        }])
    };
    if hold == Hold::One {
        return same(orders);
    }
    let mut policy = Policy(Vec::new());
    for order in &orders {
        let views: Vec<usize> = all
            .iter()
            .copied()
            .filter(|v| measures[*v].order == *order)
            .collect();
        let own = rule(table, measures, &views, hold);
        // The joint rule remains if it pays in this order by itself, and nothing is faster there
        // beyond noise.
        let gains = |v: &usize| {
            let shaded = measures[*v].shaded;
            table.is_faster(own.plan(shaded), joint.plan(shaded), *v)
        };
        let pays = joint
            .plans()
            .iter()
            .any(|plan| *plan != 0 && table.is_sound(*plan, &views));
        let rule = match views.iter().any(gains) || !pays {
            true => own,
            false => joint,
        };
        match policy.0.iter_mut().find(|held| held.rule == rule) {
            Some(held) => held.orders.push(*order),
            None => policy.0.push(RuleRange {
                orders: vec![*order],
                rule,
            }),
        }
    }
    let gains = |v: &usize| {
        let Measure { order, shaded } = measures[*v];
        table.is_faster(policy.plan(order, shaded), joint.plan(shaded), *v)
    };
    match all.iter().any(gains) {
        true => policy,
        false => same(orders),
    }
}

/// The rule for some views.
///
/// A switch needs a gain of 1 % over the single plan on the mean of the views, and a gain beyond
/// noise in some view. Each side must satisfy the rule for one plan. The thresholds are a quarter
/// of the gap away from the views on either side.
fn rule(table: &Table, measures: &[Measure], views: &[usize], hold: Hold) -> Rule {
    let one = table.best_over(views);
    let stay = Rule::One { plan: one };
    if hold == Hold::One {
        return stay;
    }
    let mut sorted = views.to_vec();
    sorted.sort_by(|a, b| measures[*a].shaded.total_cmp(&measures[*b].shaded));
    let mut best: Option<(f64, Switch)> = None;
    for cut in 1..sorted.len() {
        let (low, high) = sorted.split_at(cut);
        let (Some(last), Some(first)) = (low.last(), high.first()) else {
            continue;
        };
        let (a, b) = (measures[*last].shaded, measures[*first].shaded);
        // A host cannot distinguish views with equal measures.
        if b - a < LEAST_GAP * b.max(1.0) {
            continue;
        }
        let (below, above) = (table.best_over(low), table.best_over(high));
        if below == above {
            continue;
        }
        let parts = [(below, low), (above, high)];
        let time: f64 = parts
            .iter()
            .map(|(plan, views)| table.relative_time(*plan, views) * views.len() as f64)
            .sum::<f64>()
            / views.len() as f64;
        let switch = Switch {
            below,
            above,
            on: a + 0.75 * (b - a),
            off: a + 0.25 * (b - a),
        };
        if best.is_none_or(|(t, _)| time < t) {
            best = Some((time, switch));
        }
    }
    let Some((time, switch)) = best else {
        return stay;
    };
    let gains = |v: &usize| table.is_faster(switch.settled(measures[*v].shaded), one, *v);
    match table.relative_time(one, views) / time > WORTHWHILE && views.iter().any(gains) {
        true => Rule::Switch(switch),
        false => stay,
    }
}

/// The least relative gap of the measure for a threshold.
const LEAST_GAP: f64 = 0.02;

#[cfg(test)]
mod tests {
    use super::super::choose::Speedup;
    use super::*;

    /// Views with one draw order, by their shaded fragments for each pixel.
    fn alike(shaded: &[f64]) -> Vec<Measure> {
        let of = |shaded: &f64| Measure {
            order: DrawOrder::Shuffled,
            shaded: *shaded,
        };
        shaded.iter().map(of).collect()
    }

    fn one_rule(policy: &Policy) -> Rule {
        assert_eq!(policy.0.len(), 1, "{policy:?}");
        policy.0[0].rule
    }

    fn about(median: f64) -> Option<Speedup> {
        Some(Speedup {
            median,
            low: median - 0.02,
            high: median + 0.02,
        })
    }

    fn one() -> Option<Speedup> {
        Some(Speedup {
            median: 1.0,
            low: 1.0,
            high: 1.0,
        })
    }

    #[test]
    fn a_switch_stands_between_what_it_tells_apart() {
        let table = Table::new(vec![
            vec![one(); 4],
            vec![about(0.9), about(2.0), about(0.95), about(3.0)],
        ]);
        let shaded = [1.0, 2.0, 1.2, 3.0];
        let measures = alike(&shaded);
        let rule = one_rule(&policy(&table, &measures, Hold::Switching));
        let Rule::Switch(switch) = rule else {
            unreachable!("{rule:?}")
        };
        assert_eq!((switch.below, switch.above), (0, 1));
        assert!(1.2 < switch.off && switch.off < switch.on && switch.on < 2.0);
        // Whatever it starts with, each measured view gets its plan.
        for (view, expected) in [0, 1, 0, 1].into_iter().enumerate() {
            for start in [0, 1] {
                assert_eq!(switch.next(start, shaded[view]), expected);
            }
        }
        // In between, the plan does not change.
        let between = (switch.on + switch.off) / 2.0;
        assert_eq!((switch.next(0, between), switch.next(1, between)), (0, 1));
        assert_eq!(
            one_rule(&policy(&table, &measures, Hold::One)),
            Rule::One { plan: 0 }
        );
    }

    #[test]
    fn no_switch_where_the_host_sees_no_difference() {
        let table = Table::new(vec![vec![one(); 2], vec![about(0.8), about(1.5)]]);
        assert_eq!(
            one_rule(&policy(&table, &alike(&[1.5, 1.5]), Hold::Switching)),
            Rule::One { plan: 0 }
        );
        // Nor where one plan is as good.
        let table = Table::new(vec![
            vec![one(); 2],
            vec![about(1.5), about(1.5)],
            vec![about(1.5), about(1.505)],
        ]);
        assert_eq!(
            one_rule(&policy(&table, &alike(&[1.0, 2.0]), Hold::Switching)),
            Rule::One { plan: 2 }
        );
    }

    #[test]
    fn a_rule_for_each_order_where_one_for_all_pays_for_it() {
        use DrawOrder::{FrontToBack, Shuffled};
        // Two cameras, each in two orders. No threshold gives the second plan exactly the one view
        // where it is best.
        let table = Table::new(vec![
            vec![one(); 4],
            vec![about(0.91), about(1.06), about(1.08), about(0.95)],
            vec![about(0.90), about(1.16), about(0.90), about(0.93)],
        ]);
        let views = [
            (FrontToBack, 0.97),
            (Shuffled, 1.38),
            (FrontToBack, 1.44),
            (Shuffled, 1.06),
        ];
        let measures = views.map(|(order, shaded)| Measure { order, shaded });
        let found = policy(&table, &measures, Hold::Switching);
        let plans: Vec<usize> = views.iter().map(|(o, s)| found.plan(*o, *s)).collect();
        assert_eq!(plans, [0, 2, 1, 0]);
        let orders: Vec<_> = found.0.iter().map(|h| h.orders.clone()).collect();
        assert_eq!(orders, [[FrontToBack], [Shuffled]]);
        assert_eq!(found.plans(), [0, 1, 2]);
        // Held to one plan there is one for all.
        let one = policy(&table, &measures, Hold::One);
        assert_eq!(one_rule(&one), Rule::One { plan: 0 });
        assert_eq!(one.0[0].orders, [FrontToBack, Shuffled]);
    }

    #[test]
    fn one_rule_where_orders_gain_nothing_apart() {
        use DrawOrder::{BackToFront, FrontToBack};
        let table = Table::new(vec![vec![one(); 2], vec![about(0.9), about(1.5)]]);
        let measures = [(FrontToBack, 1.0), (BackToFront, 2.0)]
            .map(|(order, shaded)| Measure { order, shaded });
        let rule = one_rule(&policy(&table, &measures, Hold::Switching));
        assert!(
            matches!(rule, Rule::Switch(s) if (s.below, s.above) == (0, 1)),
            "{rule:?}"
        );
    }
}
