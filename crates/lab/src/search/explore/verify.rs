//! Verifies the finalists on every camera's path and builds the result.

use std::time::Duration;

use preshade_plan::budget::{Budget, Metric};
use preshade_plan::contract::Verdict;

use super::arena::Arena;
use super::pareto::{Standing, dominators};
use super::pick::{pick, still_left, unbeaten};
use super::race::{FIRST_RUNG, SUBMISSION, Search};
use super::watch::Watch;
use super::{Exploration, Explored, Fate, Point, SCHEMA, SearchStage, Settings};
use crate::measure::record::{Chosen, ORIGINAL, Report, VariantReport};
use crate::measure::{self, Error, ErrorLadder, Session, Timed, TimingSettings, Variant};
use preshade_compiler::recipe::Recipe;

impl<'a> Search<'a> {
    /// Verifies the finalists on every camera's path. As long as there is time, goes on with
    /// candidates that a failed finalist had replaced.
    pub fn verify(
        &self,
        arena: Arena<'a>,
        finalists: Vec<usize>,
        watch: &mut Watch<'_>,
    ) -> Result<Explored, Error> {
        let each = self.compared(&arena);
        let cameras = self.session.scene().cameras.len();
        let one_more = Duration::from_secs_f64(2.0 * arena.verifying(cameras, each));
        let mut points = vec![original()];
        let mut made: Vec<Variant> = Vec::new();
        for contender in arena.contenders {
            points.push(contender.point);
            made.push(contender.variant);
        }
        let Settings { metric, budget, .. } = *self.settings;
        let (mut report, mut pictures, mut frames_verified) = (None::<Report>, Vec::new(), 0);
        let mut variants: Vec<Variant> = Vec::new();
        let mut next = finalists;
        while watch.over().is_none() && (report.is_none() || !next.is_empty()) {
            let round: Vec<Variant> = next.iter().map(|i| made[*i].clone()).collect();
            let frames = self.frames_for(round.len(), each, watch);
            let outcome = self.verified(&round, frames, watch)?;
            variants.extend(round);
            pictures.extend(outcome.pictures);
            frames_verified = match &report {
                None => frames,
                Some(_) => frames.min(frames_verified),
            };
            let told = match report.take() {
                None => outcome.report,
                Some(first) => with_more(first, outcome.report),
            };
            judge(&mut points, &told, metric);
            let verified: Vec<&str> = told.variants.iter().map(|v| v.name.as_str()).collect();
            let reopened = reopen(&mut points, &verified, metric, budget);
            report = Some(told);
            // One more variant, with the original.
            if watch.left(1.0) < one_more {
                break;
            }
            let standings: Vec<Standing> = reopened.iter().map(|(_, s)| *s).collect();
            let picked = pick(&standings, self.settings.finalists, budget);
            // The original is the first of the points.
            next = picked.into_iter().map(|p| reopened[p].0 - 1).collect();
        }
        let scene = self.session.scene();
        let mut frontier: Vec<&Point> =
            points.iter().filter(|p| p.fate == Fate::Frontier).collect();
        let error = |p: &Point| {
            p.error
                .as_ref()
                .map_or(f64::NAN, |e| self.settings.metric.of(e))
        };
        frontier.sort_by(|a, b| error(a).total_cmp(&error(b)));
        let frontier = frontier.into_iter().map(|p| p.name.clone()).collect();
        let budget = self.settings.budget.map(|limit| Budget {
            metric: self.settings.metric,
            limit,
        });
        let chosen = budget.zip(report.as_ref()).map(|(budget, report)| {
            let unverified = points.iter().filter(|p| {
                let error = p.error.as_ref().map(|e| budget.of(e));
                matches!(p.fate, Fate::Unverified { .. })
                    && error.is_some_and(|e| e <= budget.limit)
            });
            let chosen = Chosen::among(&report.variants, budget).beside(unverified.count());
            chosen.made_by(|name| {
                let variant = variants.iter().find(|v| v.name == name)?;
                let recipe = Recipe::parse_list(&variant.recipe).ok()?;
                measure::promised(&recipe, budget, self.facts)
            })
        });
        Ok(Explored {
            exploration: Exploration {
                schema: SCHEMA.to_owned(),
                scene: scene.name.clone(),
                part: scene.part.clone(),
                resolution: scene.size,
                command: self.settings.command.clone(),
                adapter: self.session.gpu().adapter().clone(),
                order: self.order(),
                metric: self.settings.metric,
                seed: self.settings.seed,
                ended: watch.end(),
                frames_verified,
                seconds: watch.spent().as_secs_f64(),
                points,
                frontier,
                chosen,
                frequencies: self.facts.frequencies.clone(),
                report,
            },
            pictures,
            variants,
        })
    }

    /// Estimates the time for drawing and comparing one picture at full size from the drafts.
    /// FLIP's time is proportional to pixels.
    fn compared(&self, arena: &Arena<'_>) -> Duration {
        let pixels = |session: &Session<'_>| {
            let [w, h] = session.scene().size.map(f64::from);
            w * h
        };
        let (time, pictures) = arena.compared;
        let scale = pixels(self.session) / pixels(self.drafts).max(1.0);
        (time / pictures.max(1)).mul_f64(scale)
    }

    /// Frames of each camera's path that can be verified for so many variants, if one comparison
    /// takes `each`.
    fn frames_for(&self, variants: usize, each: Duration, watch: &Watch<'_>) -> usize {
        let left = watch.time.saturating_sub(watch.spent()).as_secs_f64();
        let cameras = &self.session.scene().cameras;
        let cost = |frames: usize| {
            let views: usize = cameras.iter().map(|c| c.frames.len().min(frames)).sum();
            each.as_secs_f64() * (views * (variants + 1)) as f64
        };
        let longest = cameras.iter().map(|c| c.frames.len()).max().unwrap_or(1);
        let asked = self.settings.frames_per_camera.min(longest).max(1);
        // The other half is for timing.
        let fits = (1..=asked).rev().find(|frames| cost(*frames) < left / 2.0);
        fits.unwrap_or(1)
    }

    /// The number of finalists that can be verified, with the original, on the first frame of each
    /// camera; at least one.
    pub(super) fn verifiable(&self, arena: &Arena<'_>, watch: &Watch<'_>) -> usize {
        let cameras = self.session.scene().cameras.len();
        let one = arena.verifying(cameras, self.compared(arena));
        let fits = (watch.left(1.0).as_secs_f64() / one.max(1e-6)) as usize;
        fits.saturating_sub(1)
            .clamp(1, self.settings.finalists.max(1))
    }

    fn verified(
        &self,
        variants: &[Variant],
        frames_per_camera: usize,
        watch: &mut Watch<'_>,
    ) -> Result<measure::Verified, Error> {
        let scene = self.session.scene();
        let frames = |frames: usize| frames.min(frames_per_camera);
        let views: usize = scene.cameras.iter().map(|c| frames(c.frames.len())).sum();
        let left = watch.time.saturating_sub(watch.spent());
        // The other half is for drawing and comparing.
        let each = left.div_f64(2.0 * views.max(1) as f64);
        let settings = measure::Settings {
            timed: Timed::Everything,
            timing: TimingSettings {
                budget: each,
                min_samples: FIRST_RUNG,
                submission: SUBMISSION,
                deadline: Some(watch.deadline()),
                seed: self.settings.seed,
                ..TimingSettings::default()
            },
            frames_per_camera,
            command: self.settings.command.clone(),
        };
        measure::verify(self.session, variants, &settings, &mut |p| {
            watch.at(SearchStage::Verifying, format!("verifying: {}", p.what));
        })
    }
}

/// A report that also has the variants of a later one.
fn with_more(mut report: Report, later: Report) -> Report {
    let is_new = |v: &VariantReport| report.variants.iter().all(|have| have.name != v.name);
    let new: Vec<VariantReport> = later.variants.into_iter().filter(is_new).collect();
    report.variants.extend(new);
    report
}

fn original() -> Point {
    Point {
        name: ORIGINAL.to_owned(),
        recipe: String::new(),
        prediction: None,
        error: Some(ErrorLadder::default()),
        time_ms: None,
        speedup: Some(Standing::ORIGINAL.speedup),
        path: None,
        fate: Fate::Frontier,
    }
}

/// Judges drafts again after the candidates that replaced them were verified. A draft is open if no
/// verified candidate beats it or is as good. Returns open drafts that no other open one beats. If
/// no verified candidate is within the budget, drafts within it are open too.
fn reopen(
    points: &mut [Point],
    verified: &[&str],
    metric: Metric,
    budget: Option<f64>,
) -> Vec<(usize, Standing)> {
    let standing = |p: &Point| {
        let error = metric.of(p.error.as_ref()?);
        let speedup = p.speedup?;
        Some(Standing { error, speedup })
    };
    let is_verified = |p: &Point| verified.contains(&p.name.as_str());
    let stand: Vec<(String, Standing)> = points
        .iter()
        .filter(|p| is_verified(p) && matches!(p.fate, Fate::Frontier | Fate::Beaten { .. }))
        .filter_map(|p| Some((p.name.clone(), standing(p)?)))
        .collect();
    let is_met = budget.is_none_or(|most| {
        let mut stand = stand.iter().filter(|(name, _)| name != ORIGINAL);
        stand.any(|(_, s)| s.error <= most)
    });
    let mut open = Vec::new();
    for (i, point) in points.iter_mut().enumerate() {
        let left = match &point.fate {
            Fate::Beaten { by: left } | Fate::Even { with: left } => Some(left.clone()),
            Fate::Unverified { .. } => None,
            _ => continue,
        };
        let Some(of_it) = standing(point).filter(|_| !is_verified(point)) else {
            continue;
        };
        if let Some(fate) = still_left(&of_it, &stand) {
            point.fate = fate;
            continue;
        }
        let within = budget.is_none_or(|most| of_it.error <= most);
        if let Some(left) = left {
            let why =
                format!("it was left for {left}, which did not stay as good when it was verified");
            point.fate = Fate::Unverified { why };
            open.push((i, of_it));
        } else if within && !is_met {
            open.push((i, of_it));
        }
    }
    let standings: Vec<Standing> = open.iter().map(|(_, s)| *s).collect();
    let unbeaten = unbeaten(&standings);
    let others: Vec<(String, Standing)> = open
        .iter()
        .map(|(i, s)| (points[*i].name.clone(), *s))
        .collect();
    for (place, (i, of_it)) in open.iter().enumerate() {
        // Beaten by one that is open itself: judged again with it.
        if !unbeaten.contains(&place)
            && let Some(fate) = still_left(of_it, &others)
        {
            points[*i].fate = fate;
        }
    }
    unbeaten.into_iter().map(|place| open[place]).collect()
}

/// Replaces drafts by verified results, and finds the frontier again.
fn judge(points: &mut [Point], report: &Report, metric: Metric) {
    let mut judged: Vec<(usize, Standing)> = Vec::new();
    for (i, point) in points.iter_mut().enumerate() {
        let Some(variant) = report.variants.iter().find(|v| v.name == point.name) else {
            continue;
        };
        if let Some(error) = &variant.error {
            point.error = Some(error.clone());
        }
        point.time_ms = variant.time_ms.as_ref().map(|t| t.estimate);
        point.speedup = variant.speedup.or(point.speedup);
        let longest = variant.by_path.iter().max_by_key(|p| p.frames);
        point.path = longest.cloned();
        point.fate = match (&variant.verdict, &point.error, point.speedup) {
            (Verdict::Broken { r#where }, ..) => Fate::Broken {
                why: r#where.clone(),
            },
            (Verdict::NotMeasured { why }, ..) => Fate::NotMeasured { why: why.clone() },
            (_, Some(error), Some(speedup)) => {
                let error = metric.of(error);
                judged.push((i, Standing { error, speedup }));
                Fate::Frontier
            }
            _ => Fate::NotMeasured {
                why: "it was not timed".to_owned(),
            },
        };
    }
    let standings: Vec<Standing> = judged.iter().map(|(_, s)| *s).collect();
    for ((i, _), by) in judged.iter().zip(dominators(&standings)) {
        if let Some(by) = by {
            let by = points[judged[by].0].name.clone();
            points[*i].fate = Fate::Beaten { by };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::Estimate;

    fn point(name: &str, error: f64, median: f64, fate: Fate) -> Point {
        let (low, high) = (median - 0.04, median + 0.04);
        Point {
            name: name.to_owned(),
            error: Some(ErrorLadder {
                flip_mean: error,
                ..ErrorLadder::default()
            }),
            speedup: Some(Estimate { median, low, high }),
            fate,
            ..original()
        }
    }

    fn beaten(by: &str) -> Fate {
        Fate::Beaten { by: by.to_owned() }
    }

    fn open(points: &mut [Point], verified: &[&str], budget: Option<f64>) -> Vec<String> {
        let open = reopen(points, verified, Metric::FlipMean, budget);
        open.into_iter()
            .map(|(i, _)| points[i].name.clone())
            .collect()
    }

    #[test]
    fn what_a_broken_finalist_beat_is_judged_again() {
        let broken = Fate::Broken {
            why: "a pixel".to_owned(),
        };
        let verified = [ORIGINAL, "a", "b"];
        let mut points = [
            original(),
            point("a", 0.01, 1.9, broken),
            point("b", 0.02, 1.5, Fate::Frontier),
            // All were dropped for `a`. The first is free now, the second belongs to the first, the
            // third to `b`.
            point("c", 0.01, 1.7, beaten("a")),
            point("d", 0.015, 1.6, beaten("a")),
            point("e", 0.03, 1.2, beaten("a")),
        ];
        assert_eq!(open(&mut points, &verified, None), ["c"]);
        assert!(matches!(points[3].fate, Fate::Unverified { .. }));
        assert_eq!(points[4].fate, beaten("c"));
        assert_eq!(points[5].fate, beaten("b"));
        // Once verified, it replaces those it beats, and nothing is open.
        points[3].fate = Fate::Frontier;
        assert_eq!(
            open(&mut points, &[&verified[..], &["c"]].concat(), None),
            [""; 0]
        );
        assert_eq!(points[4].fate, beaten("c"));
    }

    #[test]
    fn a_budget_that_nothing_verified_is_within_opens_what_was_drawn_within_it() {
        let left = Fate::Unverified {
            why: "two others were taken in its place".to_owned(),
        };
        let mut points = [
            original(),
            // Within it as drawn, and not on every frame.
            point("a", 0.012, 1.9, Fate::Frontier),
            point("b", 0.007, 1.5, left.clone()),
            point("c", 0.02, 2.5, left),
        ];
        assert_eq!(open(&mut points, &[ORIGINAL, "a"], Some(0.01)), ["b"]);
        assert_eq!(open(&mut points, &[ORIGINAL, "a"], Some(0.015)), [""; 0]);
        assert_eq!(open(&mut points, &[ORIGINAL, "a"], None), [""; 0]);
    }
}
