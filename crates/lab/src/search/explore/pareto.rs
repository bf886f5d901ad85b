//! Which points no other beats: dominance that waits for evidence.

use crate::measure::Estimate;

/// The error and the speedup of a variant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Standing {
    /// The worst error of all pictures; smaller is better. It has no noise: the same text draws the
    /// same picture.
    pub error: f64,
    /// The original's time over its own: larger is better.
    pub speedup: Estimate,
}

impl Standing {
    /// The original itself.
    pub const ORIGINAL: Self = Self {
        error: 0.0,
        speedup: Estimate {
            median: 1.0,
            low: 1.0,
            high: 1.0,
        },
    };

    /// Whether it beats `other`: it has no more error, and its interval of speedups is above the
    /// other's. If intervals touch, neither beats the other.
    pub fn dominates(&self, other: &Self) -> bool {
        self.error <= other.error && self.speedup.low > other.speedup.high
    }
}

/// For each point the fastest one that beats it. `None`: none does, so it is on the frontier.
pub(crate) fn dominators(points: &[Standing]) -> Vec<Option<usize>> {
    let beaten = |p: &Standing| {
        let by = points.iter().enumerate().filter(|(_, q)| q.dominates(p));
        let fastest = by.max_by(|a, b| a.1.speedup.median.total_cmp(&b.1.speedup.median));
        fastest.map(|(i, _)| i)
    };
    points.iter().map(beaten).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(error: f64, low: f64, high: f64) -> Standing {
        Standing {
            error,
            speedup: Estimate {
                median: f64::midpoint(low, high),
                low,
                high,
            },
        }
    }

    #[test]
    fn a_point_is_beaten_only_where_intervals_separate() {
        let points = [
            at(0.0, 1.0, 1.0),
            // Overlaps the next, which has more error. Both remain.
            at(0.01, 1.9, 2.1),
            at(0.02, 2.0, 2.4),
            // As much error as the one before, and slower by more than noise.
            at(0.02, 1.2, 1.5),
            // No gain at all for its error.
            at(0.001, 0.7, 0.9),
        ];
        assert_eq!(dominators(&points), [None, None, None, Some(2), Some(0)]);
    }

    #[test]
    fn equals_do_not_beat_one_another() {
        let twice = [at(0.5, 1.0, 2.0), at(0.5, 1.0, 2.0)];
        assert_eq!(dominators(&twice), [None, None]);
    }

    #[test]
    fn a_point_without_a_time_beats_nothing_and_is_beaten_by_nothing() {
        let unknown = at(0.0, f64::NAN, f64::NAN);
        assert_eq!(dominators(&[unknown, at(0.0, 1.0, 2.0)]), [None, None]);
    }
}
