//! The finalists verified on every camera's path, and all of it told.

use std::time::Duration;

use preshade_passes::contract::Verdict;
use preshade_passes::hoist::Metric;

use super::arena::Arena;
use super::explore::{Exploration, Fate, Found, Point, SCHEMA, Stage, of};
use super::pareto::{Standing, dominators};
use super::race::{FIRST_RUNG, Search};
use super::watch::Watch;
use crate::measure::{self, Error, ErrorLadder, Timed, TimingSettings, Variant};
use crate::recipe::Recipe;
use crate::render::SceneInputs;
use crate::report::{Budget, Chosen, ORIGINAL, Report};

impl<'a> Search<'a> {
    /// Verifies the finalists on every camera's path, and tells it all.
    pub(super) fn verify(
        &self,
        arena: Arena<'a>,
        finalists: &[usize],
        watch: &mut Watch<'_>,
    ) -> Result<Found, Error> {
        let each = self.compared(&arena);
        let Arena { contenders, .. } = arena;
        let variants: Vec<Variant> = finalists
            .iter()
            .map(|i| contenders[*i].variant.clone())
            .collect();
        let mut points: Vec<Point> = contenders.into_iter().map(|c| c.point).collect();
        let (mut report, mut pictures, mut frames_verified) = (None, Vec::new(), 0);
        if watch.over().is_none() {
            let frames = self.frames_for(variants.len(), each, watch);
            frames_verified = frames;
            let outcome = self.verified(&variants, frames, watch)?;
            pictures = outcome.pictures;
            report = Some(outcome.report);
        }
        let original = Point {
            name: ORIGINAL.to_owned(),
            recipe: String::new(),
            prediction: None,
            error: Some(ErrorLadder::default()),
            time_ms: None,
            speedup: Some(Standing::ORIGINAL.speedup),
            path: None,
            fate: Fate::Frontier,
        };
        points.insert(0, original);
        if let Some(report) = &report {
            judge(&mut points, report, self.settings.metric);
        }
        let scene = self.inputs.scene();
        let mut frontier: Vec<&Point> =
            points.iter().filter(|p| p.fate == Fate::Frontier).collect();
        let error = |p: &Point| {
            p.error
                .as_ref()
                .map_or(f64::NAN, |e| of(self.settings.metric, e))
        };
        frontier.sort_by(|a, b| error(a).total_cmp(&error(b)));
        let frontier = frontier.into_iter().map(|p| p.name.clone()).collect();
        let budget = self.settings.budget.map(|most| Budget {
            metric: self.settings.metric,
            most,
        });
        let chosen = budget.zip(report.as_ref()).map(|(budget, report)| {
            Chosen::among(&report.variants, budget).made_by(|name| {
                let variant = variants.iter().find(|v| v.name == name)?;
                let recipe = Recipe::parse_list(&variant.recipe).ok()?;
                measure::promised(&recipe, budget, self.facts)
            })
        });
        Ok(Found {
            exploration: Exploration {
                schema: SCHEMA.to_owned(),
                scene: scene.name.clone(),
                resolution: scene.size,
                command: self.settings.command.clone(),
                adapter: self.gpu.adapter().clone(),
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

    /// Time that drawing and comparing one picture of the scene's own size takes, by what it took at the drafts'; FLIP's time is that of pixels.
    fn compared(&self, arena: &Arena<'_>) -> Duration {
        let pixels = |inputs: &SceneInputs<'_>| {
            let [w, h] = inputs.scene().size.map(f64::from);
            w * h
        };
        let (time, pictures) = arena.compared;
        let scale = pixels(self.inputs) / pixels(self.drafts).max(1.0);
        (time / pictures.max(1)).mul_f64(scale)
    }

    /// Frames of each camera's path that there is time to verify so many variants on, where comparing a picture takes `each`.
    fn frames_for(&self, variants: usize, each: Duration, watch: &Watch<'_>) -> usize {
        let left = watch.time.saturating_sub(watch.spent()).as_secs_f64();
        let cameras = &self.inputs.scene().cameras;
        let cost = |frames: usize| {
            let views: usize = cameras.iter().map(|c| c.frames.len().min(frames)).sum();
            each.as_secs_f64() * (views * (variants + 1)) as f64
        };
        let asked = self.settings.frames_per_camera.max(1);
        // Half of it is the clock's.
        let fits = (1..=asked).rev().find(|frames| cost(*frames) < left / 2.0);
        fits.unwrap_or(1)
    }

    fn verified(
        &self,
        variants: &[Variant],
        frames_per_camera: usize,
        watch: &mut Watch<'_>,
    ) -> Result<measure::Outcome, Error> {
        let scene = self.inputs.scene();
        let frames = |frames: usize| frames.min(frames_per_camera);
        let views: usize = scene.cameras.iter().map(|c| frames(c.frames.len())).sum();
        let left = watch.time.saturating_sub(watch.spent());
        // Half of it draws and compares.
        let each = left.div_f64(2.0 * views.max(1) as f64);
        let settings = measure::Settings {
            form: self.settings.form,
            timed: Timed::Everything,
            timing: TimingSettings {
                budget: each,
                min_samples: FIRST_RUNG,
                submission: Duration::from_millis(6),
                seed: self.settings.seed,
                ..TimingSettings::default()
            },
            frames_per_camera,
            count: self.settings.count,
            command: self.settings.command.clone(),
        };
        measure::verify(self.gpu, scene, variants, &settings, &mut |p| {
            watch.at(Stage::Verifying, format!("verifying: {}", p.what));
        })
    }
}

/// What verification says of the finalists takes the place of what was known of them, and which of them are on the frontier is judged anew.
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
                let error = of(metric, error);
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
