//! The candidates of a search on their way: who is in the race, who is beaten, who is verified.

use std::time::Duration;

use preshade_plan::budget::Metric;

use super::pareto::{Standing, dominators};
use super::pick::{instead, pick};
use super::predict::Prediction;
use super::race::{FIRST_RUNG, MOST_CROSSED, SUBMISSION, Search};
use super::space::{self, Candidate};
use super::{Fate, Point};
use crate::measure::record::ORIGINAL;
use crate::measure::{Error, FEWEST_SAMPLES, Variant, check_seen, estimate};
use preshade_draw::render::{Prepared, Rendered};

/// Least number of candidates to draw and time, whatever time is left.
pub(super) const LEAST_RACING: usize = 3;

/// A candidate on its way.
pub(super) struct Contender<'a> {
    pub(super) candidate: Candidate,
    pub(super) variant: Variant,
    pub(super) key: Option<String>,
    pub(super) point: Point,
    pub(super) prepared: Option<Prepared<'a>>,
    pub(super) ratios: Vec<f64>,
    pub(super) times: Vec<f64>,
    /// Milliseconds of one frame by the wall clock, at first sight.
    pub(super) sight: f64,
    /// Time for building, drawing and comparing it.
    pub(super) spent: Duration,
    pub(super) alive: bool,
}

/// The original and the candidates so far.
pub(super) struct Arena<'a> {
    pub(super) original: Prepared<'a>,
    pub(super) references: Vec<Rendered>,
    /// Milliseconds of one frame of the original by the wall clock, at first sight.
    pub(super) first_sight: f64,
    pub(super) contenders: Vec<Contender<'a>>,
    pub(super) drawn: usize,
    /// Time spent on drawing and comparing pictures, and how many.
    pub(super) compared: (Duration, u32),
}

impl<'a> Arena<'a> {
    pub(super) fn new(search: &Search<'a>) -> Result<Self, Error> {
        let frames = search.frames.iter();
        let views: Vec<_> = frames.map(|frame| (*frame, search.order())).collect();
        check_seen(search.session, &views)?;
        let mut original = search.session.prepare(search.session.originals())?;
        let references = search.pictures(search.session.originals())?;
        let first_sight = search
            .glance(&mut original)?
            .min(search.glance(&mut original)?);
        Ok(Self {
            original,
            references,
            first_sight,
            contenders: Vec::new(),
            drawn: 0,
            compared: (Duration::ZERO, 0),
        })
    }

    /// The error and speedup of each candidate in the race, with its index.
    pub(super) fn standings(&self, metric: Metric) -> Vec<(usize, Standing)> {
        let alive = self.contenders.iter().enumerate().filter(|(_, c)| c.alive);
        let standing = |(i, c): (usize, &Contender<'_>)| {
            let error = metric.of(c.point.error.as_ref()?);
            let speedup = c.point.speedup?;
            Some((i, Standing { error, speedup }))
        };
        alive.filter_map(standing).collect()
    }

    /// Drops candidates that another one beats.
    pub(super) fn drop_beaten(&mut self, metric: Metric) {
        let standings = self.standings(metric);
        let points: Vec<Standing> = std::iter::once(Standing::ORIGINAL)
            .chain(standings.iter().map(|(_, s)| *s))
            .collect();
        let by = dominators(&points);
        let names: Vec<String> = std::iter::once(ORIGINAL.to_owned())
            .chain(
                standings
                    .iter()
                    .map(|(i, _)| self.contenders[*i].point.name.clone()),
            )
            .collect();
        for ((i, _), by) in standings.iter().zip(&by[1..]) {
            if let Some(by) = by {
                let by = names[*by].clone();
                self.contenders[*i].out(Fate::Beaten { by });
            }
        }
    }

    /// As many racing candidates as can be timed in the time left, and the number of samples
    /// ([`fitting`]). `None`: all have times, and there is no time for another rung.
    pub(super) fn fitting(
        &mut self,
        mut racing: Vec<usize>,
        samples: usize,
        left: Duration,
    ) -> Option<(Vec<usize>, usize)> {
        let submission = SUBMISSION.as_secs_f64() * 1e3;
        let once = |sight: f64| sight.max(submission) * 1e-3;
        let seconds = |i: usize| once(self.contenders[i].sight);
        racing.sort_by(|a, b| seconds(*a).total_cmp(&seconds(*b)));
        let each: Vec<f64> = racing.iter().map(|i| seconds(*i)).collect();
        let fits = fitting(once(self.first_sight), &each, samples, left.as_secs_f64());
        let has_time = |i: &usize| self.contenders[*i].point.speedup.is_some();
        let (count, samples) = match fits {
            Some(fits) => fits,
            None if racing.iter().all(has_time) => return None,
            // Without a time, no candidate can be judged.
            None => (LEAST_RACING.min(racing.len()), FEWEST_SAMPLES),
        };
        for slow in racing.split_off(count) {
            if self.contenders[slow].point.speedup.is_none() {
                let why = "there was no time left to time it".to_owned();
                self.contenders[slow].out(Fate::NotMeasured { why });
            }
        }
        racing.sort_unstable();
        Some((racing, samples))
    }

    /// Estimates the seconds for verifying one variant on `views` views, from the times so far.
    /// Each variant is built twice (for drawing and for counting), drawn, compared, counted and
    /// timed.
    pub(super) fn verifying(&self, views: usize, compared: Duration) -> f64 {
        let seen: Vec<&Contender<'_>> = self.contenders.iter().filter(|c| c.alive).collect();
        let mean = |of: &dyn Fn(&Contender<'_>) -> f64| {
            seen.iter().map(|c| of(c)).sum::<f64>() / seen.len().max(1) as f64
        };
        let built = mean(&|c| c.spent.as_secs_f64());
        let sight = mean(&|c| c.sight.max(SUBMISSION.as_secs_f64() * 1e3)) * 1e-3;
        let frames = (FIRST_RUNG + 4) as f64;
        2.0 * built + views as f64 * (compared.as_secs_f64() + frames * sight)
    }

    /// The best ways to compute less in a fragment with the best ways to shade fewer.
    pub(super) fn crossed(&self) -> Vec<Candidate> {
        let mut gains: Vec<&Contender<'_>> = self
            .contenders
            .iter()
            .filter(|c| c.alive && c.point.speedup.is_some_and(|s| s.low > 1.0))
            .collect();
        let speed = |c: &Contender<'_>| c.point.speedup.map_or(0.0, |s| s.median);
        gains.sort_by(|a, b| speed(b).total_cmp(&speed(a)));
        let kind = |covers: bool| {
            let of = gains.iter().filter(move |c| c.candidate.covers == covers);
            of.take(MOST_CROSSED).map(|c| &c.candidate)
        };
        kind(false)
            .flat_map(|shading| kind(true).filter_map(|c| space::cross(shading, c)))
            .collect()
    }

    /// Indices of the candidates to verify that no other candidate beats. If there are more than
    /// `most`, [`pick`] chooses; the others get the reason.
    pub(super) fn finalists(
        &mut self,
        most: usize,
        metric: Metric,
        budget: Option<f64>,
    ) -> Vec<usize> {
        let left = self.standings(metric);
        let points: Vec<Standing> = left.iter().map(|(_, s)| *s).collect();
        let picked = pick(&points, most, budget);
        let chosen: Vec<usize> = picked.iter().map(|p| left[*p].0).collect();
        let names = chosen
            .iter()
            .map(|i| self.contenders[*i].point.name.clone());
        let taken: Vec<(String, Standing)> = names.zip(picked.iter().map(|p| points[*p])).collect();
        for (i, standing) in left.iter().filter(|(i, _)| !chosen.contains(i)) {
            self.contenders[*i].out(instead(standing, &taken, budget));
        }
        chosen
    }
}

/// How many variants can be timed against the original within `left` seconds, and with how many
/// samples. `each` has the seconds of a frame, the fastest first. First choice: all variants with
/// `samples` or fewer samples (an even number, at least [`FEWEST_SAMPLES`]). Second choice: the
/// fastest of them. `None`: not even [`LEAST_RACING`].
fn fitting(original: f64, each: &[f64], samples: usize, left: f64) -> Option<(usize, usize)> {
    // Two frames each ahead of the samples.
    let cost = |count: usize, samples: usize| {
        let all: f64 = each.iter().take(count).sum();
        (original + all) * (samples + 2) as f64
    };
    let all = each.len();
    let fewer = (FEWEST_SAMPLES / 2..=samples / 2)
        .rev()
        .map(|half| 2 * half);
    if let Some(samples) = fewer.clone().find(|n| cost(all, *n) <= left) {
        return Some((all, samples));
    }
    let some = (LEAST_RACING..all)
        .rev()
        .find(|n| cost(*n, FEWEST_SAMPLES) <= left);
    some.map(|count| (count, FEWEST_SAMPLES))
}

impl<'a> Contender<'a> {
    /// At the start: in the race, unless its fate is known.
    pub(super) fn new(
        candidate: Candidate,
        prediction: Option<Prediction>,
        variant: Variant,
        key: Option<String>,
        fate: Option<Fate>,
    ) -> Self {
        let alive = fate.is_none();
        Self {
            point: Point {
                name: variant.name.clone(),
                recipe: variant.recipe.clone(),
                prediction,
                error: None,
                time_ms: None,
                speedup: None,
                path: None,
                fate: fate.unwrap_or(Fate::NotMeasured {
                    why: "it was not reached".to_owned(),
                }),
            },
            candidate,
            variant,
            key,
            prepared: None,
            ratios: Vec::new(),
            times: Vec::new(),
            sight: 0.0,
            spent: Duration::ZERO,
            alive,
        }
    }

    /// Takes it out of the race.
    pub(super) fn out(&mut self, fate: Fate) {
        self.point.fate = fate;
        self.alive = false;
        self.prepared = None;
    }

    /// More samples of its time.
    pub(super) fn timed(&mut self, ratios: &[f64], times: &[f64], seed: u64) {
        self.ratios.extend_from_slice(ratios);
        self.times.extend_from_slice(times);
        if !self.ratios.is_empty() {
            self.point.speedup = Some(estimate(&self.ratios, seed));
            self.point.time_ms = Some(estimate(&self.times, seed));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::fitting;

    #[test]
    fn fewer_samples_and_then_fewer_variants() {
        let each = [0.01, 0.02, 0.03, 0.04, 0.1];
        // (0.1 + 0.2) seconds a round, two rounds ahead.
        assert_eq!(fitting(0.1, &each, 12, 4.3), Some((5, 12)));
        assert_eq!(fitting(0.1, &each, 12, 3.1), Some((5, 8)));
        assert_eq!(fitting(0.1, &each, 24, 2.5), Some((5, 6)));
        // The slowest is out: 8 * (0.1 + 0.1) seconds. Fewer samples have no interval.
        assert_eq!(fitting(0.1, &each, 24, 1.7), Some((4, 6)));
        assert_eq!(fitting(0.1, &each, 24, 1.3), Some((3, 6)));
        assert_eq!(fitting(0.1, &each, 24, 0.5), None);
    }
}
