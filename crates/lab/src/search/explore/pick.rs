//! Chooses the survivors to verify if there is no time for all.

use super::Fate;
use super::pareto::{Standing, dominators};

/// Indices of at most `most` points to verify that no other point beats. First come points within
/// `budget`, spread along the frontier of their medians, with the fastest and the most accurate.
/// Then come points as good as these, then points beyond the budget, nearest first.
pub(super) fn pick(points: &[Standing], most: usize, budget: Option<f64>) -> Vec<usize> {
    let is_within = |i: &usize| budget.is_none_or(|most| points[*i].error <= most);
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by(|a, b| {
        let median = |i: &usize| points[*i].speedup.median;
        median(b).total_cmp(&median(a))
    });
    let (within, mut beyond): (Vec<usize>, Vec<usize>) = order.into_iter().partition(is_within);
    // The fastest first; one that has less error than all that are faster adds to the frontier.
    let mut least = f64::INFINITY;
    let (first, even): (Vec<usize>, Vec<usize>) = within.into_iter().partition(|i| {
        let adds = points[*i].error < least;
        least = least.min(points[*i].error);
        adds
    });
    beyond.sort_by(|a, b| points[*a].error.total_cmp(&points[*b].error));
    let mut chosen = spread(&first, most);
    chosen.extend(even.into_iter().chain(beyond));
    chosen.truncate(most);
    chosen
}

/// `most` of `all`, evenly, both ends among them.
fn spread(all: &[usize], most: usize) -> Vec<usize> {
    if all.len() <= most {
        return all.to_vec();
    }
    let last = all.len() - 1;
    let steps = most.saturating_sub(1).max(1);
    (0..most)
        .map(|i| all[(i * last + steps / 2) / steps])
        .collect()
}

/// The fate of a point that is not verified although `chosen` are: as good as one of these, if that
/// is measured.
pub(super) fn instead(
    point: &Standing,
    chosen: &[(String, Standing)],
    budget: Option<f64>,
) -> Fate {
    let even = chosen.iter().filter(|(_, c)| is_even(point, c));
    let near = even.min_by(|(_, a), (_, b)| {
        let distance = |s: &Standing| (s.speedup.median - point.speedup.median).abs();
        distance(a).total_cmp(&distance(b))
    });
    let why = match (near, budget) {
        (Some((with, _)), _) => return Fate::Even { with: with.clone() },
        (None, Some(most)) if point.error > most => "its error is beyond the budget".to_owned(),
        _ => format!("{} others were taken in its place", chosen.len()),
    };
    Fate::Unverified { why }
}

/// Whether `other` has no more error and overlapping intervals.
fn is_even(point: &Standing, other: &Standing) -> bool {
    other.error <= point.error
        && other.speedup.low <= point.speedup.high
        && point.speedup.low <= other.speedup.high
}

/// The fate of a draft, judged by the points that were verified: still beaten, or as good as one.
/// `None`: the point that replaced it has failed.
pub(super) fn still_left(point: &Standing, standing: &[(String, Standing)]) -> Option<Fate> {
    let by = standing.iter().filter(|(_, s)| s.dominates(point));
    let fastest = by.max_by(|(_, a), (_, b)| a.speedup.median.total_cmp(&b.speedup.median));
    if let Some((by, _)) = fastest {
        return Some(Fate::Beaten { by: by.clone() });
    }
    match instead(point, standing, None) {
        even @ Fate::Even { .. } => Some(even),
        _ => None,
    }
}

/// The points that no other point beats.
pub(super) fn unbeaten(points: &[Standing]) -> Vec<usize> {
    let by = dominators(points);
    (0..points.len()).filter(|i| by[*i].is_none()).collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::panic)]

    use super::*;
    use crate::measure::Estimate;

    fn at(error: f64, median: f64) -> Standing {
        Standing {
            error,
            speedup: Estimate {
                median,
                low: median - 0.04,
                high: median + 0.04,
            },
        }
    }

    /// The results for fourteen trip counts of one loop: a larger count is slower.
    fn turns() -> Vec<Standing> {
        let of = |turns: u32| {
            let left = f64::from(14 - turns);
            at(0.0007 * left * left, 1.0 + 0.06 * left)
        };
        (1..=14).map(of).collect()
    }

    #[test]
    fn a_budget_leaves_what_is_within_it() {
        let points = turns();
        let chosen = pick(&points, 4, Some(0.01));
        assert!(
            chosen.iter().all(|i| points[*i].error <= 0.01),
            "{chosen:?}"
        );
        // turns=11 (the fastest within the budget), and all turns.
        assert!(chosen.contains(&10) && chosen.contains(&13), "{chosen:?}");
    }

    #[test]
    fn without_one_both_ends_are_taken_and_what_lies_between() {
        let points = turns();
        assert_eq!(pick(&points, 4, None), [0, 4, 9, 13]);
        assert_eq!(pick(&points, 1, None), [0]);
        assert_eq!(pick(&points, 20, None).len(), 14);
    }

    #[test]
    fn where_none_is_within_it_the_nearest_are() {
        let points = turns();
        let beyond = pick(&points[..10], 3, Some(0.001));
        assert_eq!(beyond, [9, 8, 7]);
    }

    #[test]
    fn what_is_left_is_even_with_nothing_worse() {
        let chosen = [("fast".to_owned(), at(0.1026, 1.74))];
        let exact = instead(&at(0.0063, 1.01), &chosen, None);
        assert!(matches!(exact, Fate::Unverified { .. }), "{exact:?}");
        // Less error, and as fast within the intervals: not even either, but better.
        let better = instead(&at(0.05, 1.72), &chosen, None);
        assert!(matches!(better, Fate::Unverified { .. }), "{better:?}");
        let even = instead(&at(0.11, 1.76), &chosen, None);
        assert_eq!(
            even,
            Fate::Even {
                with: "fast".to_owned()
            }
        );
        let Fate::Unverified { why } = instead(&at(0.2, 1.9), &chosen, Some(0.15)) else {
            panic!("verified");
        };
        assert_eq!(why, "its error is beyond the budget");
    }

    #[test]
    fn what_was_left_for_a_point_that_fell_is_open_again() {
        let beaten = at(0.02, 1.2);
        let drafted = ("a".to_owned(), at(0.01, 1.5));
        let by = Fate::Beaten { by: "a".to_owned() };
        assert_eq!(still_left(&beaten, &[drafted]), Some(by));
        // At full size it has more error than the point it beat, or it is gone.
        let fallen = ("a".to_owned(), at(0.03, 1.5));
        assert_eq!(still_left(&beaten, &[fallen]), None);
        assert_eq!(still_left(&beaten, &[]), None);
    }
}
