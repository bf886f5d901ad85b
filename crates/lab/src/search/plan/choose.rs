//! Chooses plans for one view or several from measured speedups. Pure functions of numbers.

use std::collections::BTreeSet;

use crate::measure::Estimate;

/// The least speedup that justifies a second set of shaders. Smaller gains are reported but not
/// used.
pub const WORTHWHILE: f64 = 1.01;

/// The original's time over a plan's in one view, from samples taken side by side.
pub(crate) type Speedup = Estimate;

/// The speedups of all plans in all views.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Table {
    /// Speedups by plan, then by view. `None`: not drawn, or its contract is broken. The first plan
    /// is the original with 1 everywhere.
    pub rows: Vec<Vec<Option<Speedup>>>,
    /// The plans whose contract assumes that no depths tie, which a tie breaks that no view showed, and those that
    /// change the picture within a budget.
    pub weaker: BTreeSet<usize>,
    /// The views that are drawn front to back, as a good engine draws. If a plan is for one of them, it
    /// has to gain in one of them.
    pub in_front: BTreeSet<usize>,
    /// How many recipes each plan has; empty: they do not count.
    pub forms: Vec<usize>,
    /// The factor by which the original differs from itself, at least 1.
    pub apart: f64,
}

impl Table {
    /// A table without weaker plans.
    pub fn new(rows: Vec<Vec<Option<Speedup>>>) -> Self {
        Self {
            rows,
            ..Self::default()
        }
    }

    pub(super) fn views(&self) -> usize {
        self.rows.first().map_or(0, Vec::len)
    }

    fn at(&self, plan: usize, view: usize) -> Option<Speedup> {
        self.rows.get(plan)?.get(view).copied().flatten()
    }

    /// Whether a plan is sound: faster than the original in some of `views` (beyond noise and
    /// worthwhile), and slower in none beyond noise. The original is.
    pub(super) fn is_sound(&self, plan: usize, views: &[usize]) -> bool {
        let speedups: Option<Vec<Speedup>> = views.iter().map(|v| self.at(plan, *v)).collect();
        let has_front = views.iter().any(|v| self.in_front.contains(v));
        let counts = |view: &usize| !has_front || self.in_front.contains(view);
        speedups.is_some_and(|speedups| {
            let gains = |(view, s): (&usize, &Speedup)| counts(view) && s.low > WORTHWHILE;
            plan == 0
                || views.iter().zip(&speedups).any(gains) && speedups.iter().all(|s| s.high >= 1.0)
        })
    }

    /// Mean over `views` of a plan's time, the original's being 1.
    pub(super) fn relative_time(&self, plan: usize, views: &[usize]) -> f64 {
        let times = views.iter().map(|v| match self.at(plan, *v) {
            Some(s) if s.median > 0.0 => 1.0 / s.median,
            _ => f64::INFINITY,
        });
        times.sum::<f64>() / views.len().max(1) as f64
    }

    /// The fastest plan for one view among those faster than the original beyond noise. 0 if there
    /// is none.
    pub fn best_in(&self, view: usize) -> usize {
        self.best_over(&[view])
    }

    /// The one plan for all views.
    pub fn best(&self) -> usize {
        let views: Vec<usize> = (0..self.views()).collect();
        self.best_over(&views)
    }

    /// The one plan for these views. A plan that needs no ties has to be faster than the best that
    /// does not, in some view beyond noise and by a worthwhile part.
    pub(super) fn best_over(&self, views: &[usize]) -> usize {
        let time = |plan: usize| self.relative_time(plan, views);
        let sound = |plan: &usize| self.is_sound(*plan, views);
        let all = || (0..self.rows.len()).filter(sound);
        let least = |a: &usize, b: &usize| time(*a).total_cmp(&time(*b));
        let best = all().min_by(least).unwrap_or(0);
        let robust = all().filter(|plan| !self.weaker.contains(plan));
        let best = match robust.min_by(least) {
            Some(robust) if robust != 0 && !views.iter().any(|v| self.wins(best, robust, *v)) => {
                robust
            }
            _ => best,
        };
        // Fewer recipes are one form for more materials: more have to be worth their shaders.
        let forms = |plan: usize| self.forms.get(plan).copied().unwrap_or(0);
        let is_simpler = |plan: &usize| {
            *plan != 0
                && forms(*plan) < forms(best)
                && (self.weaker.contains(&best) || !self.weaker.contains(plan))
        };
        match all().filter(is_simpler).min_by(least) {
            Some(simpler) if !views.iter().any(|v| self.is_apart(best, simpler, *v)) => simpler,
            _ => best,
        }
    }

    /// Whether `plan` is faster than `other` in that view by more than the original differs from
    /// itself.
    fn is_apart(&self, plan: usize, other: usize, view: usize) -> bool {
        match (self.at(plan, view), self.at(other, view)) {
            (Some(a), Some(b)) => a.low > b.high && a.median > self.apart * b.median,
            _ => false,
        }
    }

    /// Whether `plan` is faster than `other` in that view, by more than a prediction or a clock can
    /// be trusted with.
    fn wins(&self, plan: usize, other: usize, view: usize) -> bool {
        match (self.at(plan, view), self.at(other, view)) {
            (Some(a), Some(b)) => a.low > WORTHWHILE * b.high,
            _ => false,
        }
    }

    /// Whether `plan` is faster than `other` in that view, with intervals that do not overlap.
    pub(super) fn is_faster(&self, plan: usize, other: usize, view: usize) -> bool {
        match (self.at(plan, view), self.at(other, view)) {
            (Some(a), Some(b)) => a.low > b.high,
            _ => false,
        }
    }
}

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
        let table = Table::new(vec![
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
    fn a_weaker_plan_has_to_win_beyond_noise() {
        let rows = |fragile: f64| vec![vec![one()], vec![about(fragile)], vec![about(1.50)]];
        let best = |fragile: f64| {
            let table = Table {
                weaker: BTreeSet::from([1]),
                ..Table::new(rows(fragile))
            };
            table.best()
        };
        assert_eq!((best(1.52), best(1.60)), (2, 1));
        assert_eq!(Table::new(rows(1.52)).best(), 1);
    }

    #[test]
    fn one_form_for_all_unless_two_are_apart() {
        let best = |mixed: f64, apart: f64| {
            let table = Table {
                forms: vec![0, 1, 2],
                apart,
                ..Table::new(vec![vec![one()], vec![about(1.5)], vec![about(mixed)]])
            };
            table.best()
        };
        assert_eq!(
            [best(1.52, 1.0), best(1.7, 1.0), best(1.7, 1.18)],
            [1, 2, 1]
        );
    }

    #[test]
    fn one_plan_may_gain_in_some_views_and_lose_in_none() {
        let table = Table::new(vec![
            vec![one(); 3],
            vec![about(1.3), about(1.0), about(0.99)],
            vec![about(2.0), about(1.0), about(0.9)],
        ]);
        assert_eq!(table.best(), 1);
    }
}
