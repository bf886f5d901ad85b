//! The choice, from what was measured: which plan for one view, which for all views, and where a switch between two is worth its pipelines. Pure functions of numbers.

use serde::{Deserialize, Serialize};

use crate::measure::Estimate;

/// The least speedup that is worth a second set of shaders. What gains less is told, and left.
pub const WORTHWHILE: f64 = 1.01;

/// What was measured of one plan in one view: the original's time over its own, of samples taken side by side.
pub type Speedup = Estimate;

/// Speedups by plan, then by view; `None` where a plan was not drawn, or broke its contract. The first plan is the original, 1 everywhere.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Table(pub Vec<Vec<Option<Speedup>>>);

impl Table {
    fn views(&self) -> usize {
        self.0.first().map_or(0, Vec::len)
    }

    fn at(&self, plan: usize, view: usize) -> Option<Speedup> {
        self.0.get(plan)?.get(view).copied().flatten()
    }

    /// Whether a plan is faster than the original in some of `views`, beyond noise and worth it, and slower in none beyond noise. So is the original.
    fn is_sound(&self, plan: usize, views: &[usize]) -> bool {
        let speedups: Option<Vec<Speedup>> = views.iter().map(|v| self.at(plan, *v)).collect();
        speedups.is_some_and(|speedups| {
            plan == 0
                || speedups.iter().any(|s| s.low > WORTHWHILE)
                    && speedups.iter().all(|s| s.high >= 1.0)
        })
    }

    /// Mean over `views` of a plan's time, the original's being 1.
    fn relative_time(&self, plan: usize, views: &[usize]) -> f64 {
        let times = views.iter().map(|v| match self.at(plan, *v) {
            Some(s) if s.median > 0.0 => 1.0 / s.median,
            _ => f64::INFINITY,
        });
        times.sum::<f64>() / views.len().max(1) as f64
    }

    /// The plan for one view: the fastest of those that are faster than the original beyond noise. 0 where none is.
    pub fn best_in(&self, view: usize) -> usize {
        self.best_over(&[view])
    }

    /// The one plan for all views.
    pub fn best(&self) -> usize {
        let views: Vec<usize> = (0..self.views()).collect();
        self.best_over(&views)
    }

    fn best_over(&self, views: &[usize]) -> usize {
        (0..self.0.len())
            .filter(|plan| self.is_sound(*plan, views))
            .min_by(|a, b| {
                let time = |plan: usize| self.relative_time(plan, views);
                time(*a).total_cmp(&time(*b))
            })
            .unwrap_or(0)
    }

    /// Whether `plan` is faster than `other` in that view, their intervals apart.
    fn is_faster(&self, plan: usize, other: usize, view: usize) -> bool {
        match (self.at(plan, view), self.at(other, view)) {
            (Some(a), Some(b)) => a.low > b.high,
            _ => false,
        }
    }
}

/// Two plans, and when to change from one to the other.
///
/// The measure is the number of fragments that the original's opaque draws shade, over the pixels of the frame. A host has it from an occlusion query (the samples that pass, where queries count) or
/// from pipeline statistics around its opaque draws: the main pass of the original, or a depth pre-pass, which is drawn in the same order under the same test and so passes as many.
/// Between the two thresholds a host stays with what it has; from frame to frame the measure of a moving camera changes little, so that no frame is drawn with pipelines that are not there yet.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Switch {
    /// The plan while little is shaded in vain: its number in the decision.
    pub below: usize,
    /// The plan above.
    pub above: usize,
    /// Go over to `above` where the measure exceeds this.
    pub on: f64,
    /// Go back to `below` where it falls under this, which is less.
    pub off: f64,
}

impl Switch {
    /// Which plan to draw the next frame with: `current` is what this one was drawn with, `measure` what it shaded for each pixel.
    pub fn next(&self, current: usize, measure: f64) -> usize {
        match current == self.above {
            true if measure < self.off => self.below,
            false if measure > self.on => self.above,
            true => self.above,
            false => self.below,
        }
    }

    /// The plan of a view that a host has looked at for a while.
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

/// What was decided over all views.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum Policy {
    /// One plan.
    One {
        /// Its number in the decision.
        plan: usize,
    },
    /// Two, and a threshold.
    Switch(Switch),
}

impl Policy {
    /// The plan that a view of that measure is drawn with.
    pub fn plan(&self, measure: f64) -> usize {
        match self {
            Self::One { plan } => *plan,
            Self::Switch(switch) => switch.settled(measure),
        }
    }
}

/// The policy for all views; `measures` has what the original shades for each pixel of each.
///
/// A switch is taken where it gains 1 % over the one plan on the mean of all views, and somewhere beyond noise. Each side of it must keep the rule of one plan. The thresholds stand a quarter of the
/// gap between the two sides' views apart from either.
pub fn policy(table: &Table, measures: &[f64], hold: Hold) -> Policy {
    let one = table.best();
    let all: Vec<usize> = (0..table.views()).collect();
    let stay = Policy::One { plan: one };
    if hold == Hold::One {
        return stay;
    }
    let mut sorted = all.clone();
    sorted.sort_by(|a, b| measures[*a].total_cmp(&measures[*b]));
    let mut best: Option<(f64, Switch)> = None;
    for cut in 1..sorted.len() {
        let (low, high) = sorted.split_at(cut);
        let (Some(last), Some(first)) = (low.last(), high.first()) else {
            continue;
        };
        let (a, b) = (measures[*last], measures[*first]);
        // Views that look alike to the host cannot be told apart.
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
            / all.len() as f64;
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
    let gains = |v: &usize| table.is_faster(switch.settled(measures[*v]), one, *v);
    match table.relative_time(one, &all) / time > WORTHWHILE && all.iter().any(gains) {
        true => Policy::Switch(switch),
        false => stay,
    }
}

/// The least difference of the measure, in parts of it, that a threshold is put into.
const LEAST_GAP: f64 = 0.02;

#[cfg(test)]
mod tests {
    use super::*;

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
    fn nothing_that_is_not_faster_beyond_noise() {
        let table = Table(vec![
            vec![one(); 3],
            vec![about(1.015), about(0.97), about(1.5)],
            vec![about(1.0), about(0.8), about(1.7)],
            // The fastest of all, and broken.
            vec![None, None, None],
        ]);
        let best: Vec<usize> = (0..3).map(|v| table.best_in(v)).collect();
        assert_eq!(best, [0, 0, 2]);
        // The first loses 3 % in the second view, within 2 %; so it does beyond noise.
        assert_eq!(table.best(), 0);
    }

    #[test]
    fn one_plan_may_gain_in_some_views_and_lose_in_none() {
        let table = Table(vec![
            vec![one(); 3],
            vec![about(1.3), about(1.0), about(0.99)],
            vec![about(2.0), about(1.0), about(0.9)],
        ]);
        assert_eq!(table.best(), 1);
    }

    #[test]
    fn a_switch_stands_between_what_it_tells_apart() {
        let table = Table(vec![
            vec![one(); 4],
            vec![about(0.9), about(2.0), about(0.95), about(3.0)],
        ]);
        let measures = [1.0, 2.0, 1.2, 3.0];
        let policy = policy(&table, &measures, Hold::Switching);
        let Policy::Switch(switch) = policy else {
            unreachable!("{policy:?}")
        };
        assert_eq!((switch.below, switch.above), (0, 1));
        assert!(1.2 < switch.off && switch.off < switch.on && switch.on < 2.0);
        // Whatever it starts with, each measured view gets its plan.
        for (view, expected) in [0, 1, 0, 1].into_iter().enumerate() {
            for start in [0, 1] {
                assert_eq!(switch.next(start, measures[view]), expected);
            }
        }
        // In between it stays.
        let between = (switch.on + switch.off) / 2.0;
        assert_eq!((switch.next(0, between), switch.next(1, between)), (0, 1));
        assert_eq!(
            super::policy(&table, &measures, Hold::One),
            Policy::One { plan: 0 }
        );
    }

    #[test]
    fn no_switch_where_the_host_sees_no_difference() {
        let table = Table(vec![vec![one(); 2], vec![about(0.8), about(1.5)]]);
        assert_eq!(
            policy(&table, &[1.5, 1.5], Hold::Switching),
            Policy::One { plan: 0 }
        );
        // Nor where one plan is as good.
        let table = Table(vec![
            vec![one(); 2],
            vec![about(1.5), about(1.5)],
            vec![about(1.5), about(1.505)],
        ]);
        assert_eq!(
            policy(&table, &[1.0, 2.0], Hold::Switching),
            Policy::One { plan: 2 }
        );
    }
}
