//! The search: each candidate drawn for its error and raced for its time, those beaten dropped on the way, what is left verified along every camera's path.
//!
//! The race is successive halving (Jamieson and Talwalkar 2016) with evidence in place of a quota: after each rung, of twice the samples of the one before, what another beats beyond both intervals is out.

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use preshade_passes::contract::Verdict;
use preshade_passes::hoist::Metric;
use preshade_passes::pass::{Facts, Frequency};
use preshade_passes::plan::{GpuPass, Plan};
use serde::Serialize;

use super::journal::{self, Entry, Journal};
use super::pareto::{Standing, dominators};
use super::predict::{Prediction, Predictor, hopeless};
use super::space::{self, Candidate};
use crate::measure::frequency::{choosing, small};
use crate::measure::{
    self, CountProgram, Error, ErrorLadder, Estimate, Timed, TimingSettings, Variant, compare,
    estimate, verdict,
};
use crate::recipe::Recipe;
use crate::render::{
    self, AdapterReport, FrameSettings, Gpu, Prepared, Rendered, SceneInputs, ShaderForm,
    Variant as HostVariant,
};
use crate::report::{Budget, Choice, Chosen, ORIGINAL, PathTime, Pictures, Report};
use crate::scene::{DrawOrder, Frame, Scene};

/// Version of the JSON that [`Exploration`] serialises to.
pub const SCHEMA: &str = "preshade.explore.v1";

/// What to search, and for how long.
pub struct Settings<'a> {
    /// The road shaders take to the driver.
    pub form: ShaderForm,
    /// What errors are counted in.
    pub metric: Metric,
    /// The most of it that is of interest; `None`: the whole frontier.
    pub budget: Option<f64>,
    /// The recipes to look at; empty: those of [`space::seeds`], and the best of them crossed.
    pub recipes: Vec<Recipe>,
    /// Time to spend in all. Met closely, not to the second: a candidate that is being measured is measured to its end.
    pub time: Duration,
    /// Most candidates that are drawn.
    pub most: usize,
    /// Most of them that are verified at the end.
    pub finalists: usize,
    /// Frames of each camera's path that these are verified on.
    pub frames_per_camera: usize,
    /// Seed of the bootstrap.
    pub seed: u64,
    /// What stands in for a pass's fragment stage while fragments are counted.
    pub count: &'a dyn Fn(&Plan, &GpuPass) -> CountProgram,
    /// The command to put into the report.
    pub command: String,
}

/// What the search is at.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Stage {
    /// What can be interpolated is measured, value by value.
    Frequencies,
    /// Candidates are drawn for their error.
    Drawing,
    /// They are timed against each other.
    Racing,
    /// The finalists are verified.
    Verifying,
}

/// How far the search is.
#[derive(Clone, Debug, PartialEq)]
pub struct Progress {
    /// What it is at.
    pub stage: Stage,
    /// In words.
    pub what: String,
    /// Part of the time that is spent, 0 to 1.
    pub done: f64,
    /// Time left.
    pub left: Duration,
}

/// What became of a candidate.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum Fate {
    /// No other beats it: verified, and on the frontier.
    Frontier,
    /// Another has no more error and is faster beyond both intervals.
    Beaten {
        /// Its name.
        by: String,
    },
    /// Nothing beats it, and one that was verified in its place is as good within the intervals.
    Even {
        /// Its name.
        with: String,
    },
    /// A frame of it took so many times the original's that it was not timed again.
    Slow {
        /// How many.
        times: f64,
    },
    /// The text and the plan of another.
    Same {
        /// Its name.
        r#as: String,
    },
    /// No material takes it.
    Refused {
        /// The first reason.
        why: String,
    },
    /// It is not what it promises, or it makes pixels that are no numbers.
    Broken {
        /// How.
        why: String,
    },
    /// Left out before it was drawn, by what was predicted of it.
    Predicted {
        /// What.
        why: String,
    },
    /// It was not measured, or not to the end.
    NotMeasured {
        /// Why not.
        why: String,
    },
}

/// A candidate, and what is known of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Point {
    /// Name.
    pub name: String,
    /// The recipe as `rewrite` takes it.
    pub recipe: String,
    /// What was predicted of it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub prediction: Option<Prediction>,
    /// Against the original: of a finalist the worst of all frames that were verified, of another the worst of the frames candidates are compared on.
    pub error: Option<ErrorLadder>,
    /// Milliseconds a frame in the headline view.
    pub time_ms: Option<Estimate>,
    /// The original's time over its own.
    pub speedup: Option<Estimate>,
    /// The frames' times along the longest path; `None`: not a finalist, or no path.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub path: Option<PathTime>,
    /// What became of it.
    pub fate: Fate,
}

/// How a search ended.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum Ended {
    /// All candidates were looked at.
    Complete,
    /// The time was up: some were not.
    OutOfTime,
    /// It was told to stop.
    Stopped,
    /// The adapter was lost.
    Lost {
        /// Why.
        why: String,
    },
}

/// What was found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Exploration {
    /// Always [`SCHEMA`].
    pub schema: String,
    /// Scene's name.
    pub scene: String,
    /// Width and height, in pixels.
    pub resolution: [u32; 2],
    /// The command that makes it again.
    pub command: String,
    /// Where it was measured.
    pub adapter: AdapterReport,
    /// The order that opaque draws were in.
    pub order: DrawOrder,
    /// What errors are counted in.
    pub metric: Metric,
    /// Seed of the bootstrap.
    pub seed: u64,
    /// How it ended.
    pub ended: Ended,
    /// Frames of each camera's path that finalists were verified on: fewer than were asked for where the time was short.
    pub frames_verified: usize,
    /// Seconds it took.
    pub seconds: f64,
    /// The original first, then every candidate in the order they were thought of.
    pub points: Vec<Point>,
    /// Names of the points that no other beats, by their error.
    pub frontier: Vec<String>,
    /// What a budget leaves of it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub chosen: Option<Chosen>,
    /// What each value of a fragment stage does to the picture if it is interpolated, and what it would save.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub frequencies: Vec<Frequency>,
    /// The finalists, verified; `None`: it did not come to that.
    pub report: Option<Report>,
}

/// What was found, and the pictures of the finalists.
#[derive(Clone, Debug)]
pub struct Found {
    /// The figures.
    pub exploration: Exploration,
    /// Pictures of the finalists in the headline view.
    pub pictures: Vec<Pictures>,
    /// The finalists.
    pub variants: Vec<Variant>,
}

/// Parts of the time by whose end a stage is to be over; verifying has the rest.
const FREQUENCIES_BY: f64 = 0.25;
const SEEDS_BY: f64 = 0.6;
const CROSSED_BY: f64 = 0.75;

/// Samples in the first rung of a race; each rung has twice those of the one before.
const FIRST_RUNG: usize = 6;

/// Rungs of a race.
const RUNGS: u32 = 3;

/// A candidate that takes so many times the original's time at first sight is not timed again.
const TOO_SLOW: f64 = 3.0;

/// Milliseconds of a frame by the wall clock that are worth sparing: shorter ones are mostly the submission's.
const DEAR: f64 = 50.0;

/// Ways of each kind that are crossed.
const MOST_CROSSED: usize = 4;

/// Searches for the recipes that no other beats in both error and time.
///
/// `progress` is told where it is, and may end it: what was measured is told, and kept in `journal`.
///
/// # Errors
/// When the original itself cannot be drawn.
pub fn explore(
    gpu: &Gpu,
    scene: &Scene,
    settings: &Settings<'_>,
    journal: &mut Journal,
    progress: &mut dyn FnMut(Progress) -> ControlFlow<()>,
) -> Result<Found, Error> {
    // One order: what a frontier says is about one way to draw.
    let order = scene.orders.first().copied().unwrap_or(DrawOrder::AsGiven);
    let scene = &Scene {
        orders: vec![order],
        ..scene.clone()
    };
    let mut watch = Watch {
        start: Instant::now(),
        time: settings.time,
        ended: Ended::Complete,
        late: false,
        progress,
    };
    // How far a variant is off is seen on few pixels; a finalist is held to all of them.
    let draft = &small(scene);
    let facts = measured_facts(gpu, draft, settings, &mut watch)?;
    let inputs = SceneInputs::new(gpu, scene)?;
    let drafts = SceneInputs::new(gpu, draft)?;
    let originals = measure::originals(scene);
    let search = Search {
        gpu,
        inputs: &inputs,
        drafts: &drafts,
        originals: &originals,
        facts: &facts,
        settings,
        subject: journal::subject(gpu.adapter(), scene, order, settings.form),
        frames: choosing(scene),
        draft_frames: choosing(draft),
    };
    let mut arena = Arena::new(&search)?;
    let seeds = match settings.recipes.is_empty() {
        true => space::seeds(&facts, settings.metric),
        false => space::given(settings.recipes.clone()),
    };
    search.admit(&mut arena, seeds);
    search.draw(&mut arena, journal, SEEDS_BY, &mut watch);
    search.race(&mut arena, journal, SEEDS_BY, &mut watch);
    if settings.recipes.is_empty() {
        let crossed = arena.crossed();
        search.admit(&mut arena, crossed);
        search.draw(&mut arena, journal, CROSSED_BY, &mut watch);
        search.race(&mut arena, journal, CROSSED_BY, &mut watch);
    }
    let finalists = arena.finalists(settings.finalists, settings.metric);
    search.verify(arena, &finalists, &mut watch)
}

/// What is known of the scene: ties, and what can be interpolated where that is asked for.
fn measured_facts(
    gpu: &Gpu,
    scene: &Scene,
    settings: &Settings<'_>,
    watch: &mut Watch<'_>,
) -> Result<Facts, Error> {
    watch.at(Stage::Frequencies, "looking for depth ties");
    let mut facts = measure::facts(gpu, scene, settings.form, settings.count)?;
    let is_open = |r: &Recipe| r.steps.iter().any(|s| s.pass == "hoist");
    if settings.recipes.is_empty() || settings.recipes.iter().any(is_open) {
        facts.frequencies = measure::frequencies(gpu, scene, &facts, settings.form, &mut |_| {
            watch.at(Stage::Frequencies, "measuring what can be interpolated");
            watch.going_on(FREQUENCIES_BY)
        })?;
        // Those that were not reached are not carried; the search goes on.
        watch.forgive();
    }
    Ok(facts)
}

/// The clock, and whoever watches it.
struct Watch<'p> {
    start: Instant,
    time: Duration,
    ended: Ended,
    /// Something was left for want of time.
    late: bool,
    progress: &'p mut dyn FnMut(Progress) -> ControlFlow<()>,
}

impl Watch<'_> {
    fn spent(&self) -> Duration {
        self.start.elapsed()
    }

    /// Tells what is being done.
    fn at(&mut self, stage: Stage, what: impl Into<String>) {
        let spent = self.spent();
        let told = (self.progress)(Progress {
            stage,
            what: what.into(),
            done: (spent.as_secs_f64() / self.time.as_secs_f64().max(1e-9)).min(1.0),
            left: self.time.saturating_sub(spent),
        });
        if told.is_break() {
            self.ended = Ended::Stopped;
        }
    }

    /// Whether there is time until this part of it is over.
    fn going_on(&mut self, by: f64) -> ControlFlow<()> {
        if self.ended == Ended::Complete && self.spent() > self.time.mul_f64(by) {
            self.ended = Ended::OutOfTime;
        }
        match self.ended {
            Ended::Complete => ControlFlow::Continue(()),
            _ => ControlFlow::Break(()),
        }
    }

    /// A stage that ran out of its part of the time leaves the rest of it to the next.
    fn forgive(&mut self) {
        if self.ended == Ended::OutOfTime {
            self.ended = Ended::Complete;
            self.late = true;
        }
    }

    /// How it ended.
    fn end(&self) -> Ended {
        match (&self.ended, self.late) {
            (Ended::Complete, true) => Ended::OutOfTime,
            (ended, _) => ended.clone(),
        }
    }

    /// Why nothing more is measured; `None` while it is.
    fn over(&self) -> Option<&'static str> {
        match self.ended {
            Ended::Complete | Ended::OutOfTime => None,
            Ended::Stopped => Some("the search was stopped"),
            Ended::Lost { .. } => Some("the graphics device was lost"),
        }
    }

    fn lost(&mut self, error: &Error) -> bool {
        let is_lost = matches!(error, Error::Render(render::Error::Lost(_)));
        if is_lost {
            self.ended = Ended::Lost {
                why: error.to_string(),
            };
        }
        is_lost
    }
}

/// What all candidates are measured under.
struct Search<'a> {
    gpu: &'a Gpu,
    inputs: &'a SceneInputs<'a>,
    /// The scene with fewer pixels, for errors.
    drafts: &'a SceneInputs<'a>,
    originals: &'a [Plan],
    facts: &'a Facts,
    settings: &'a Settings<'a>,
    subject: String,
    /// The first is what is timed.
    frames: Vec<&'a Frame>,
    /// What errors are compared on.
    draft_frames: Vec<&'a Frame>,
}

/// A candidate on its way.
struct Contender<'a> {
    candidate: Candidate,
    variant: Variant,
    key: Option<String>,
    point: Point,
    prepared: Option<Prepared<'a>>,
    ratios: Vec<f64>,
    times: Vec<f64>,
    /// Still in the race.
    alive: bool,
}

/// The original and the candidates so far.
struct Arena<'a> {
    original: Prepared<'a>,
    references: Vec<Rendered>,
    /// Milliseconds of one frame of the original by the wall clock, at first sight.
    first_sight: f64,
    contenders: Vec<Contender<'a>>,
    drawn: usize,
    /// Time spent on drawing and comparing pictures, and how many.
    compared: (Duration, u32),
}

impl<'a> Arena<'a> {
    fn new(search: &Search<'a>) -> Result<Self, Error> {
        let mut original = search.prepare(search.inputs, search.originals)?;
        let references = search.pictures(search.originals)?;
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

    /// What stands of each that is in the race, and whose it is.
    fn standings(&self, metric: Metric) -> Vec<(usize, Standing)> {
        let alive = self.contenders.iter().enumerate().filter(|(_, c)| c.alive);
        let standing = |(i, c): (usize, &Contender<'_>)| {
            let error = of(metric, c.point.error.as_ref()?);
            let speedup = c.point.speedup?;
            Some((i, Standing { error, speedup }))
        };
        alive.filter_map(standing).collect()
    }

    /// Drops what another beats.
    fn drop_beaten(&mut self, metric: Metric) {
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

    /// The best ways to compute less in a fragment with the best ways to shade fewer.
    fn crossed(&self) -> Vec<Candidate> {
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

    /// Indices of those to verify: nothing beats them. Of more than `most`, those that gain most over the next smaller error are taken, and the others are even with one of them.
    fn finalists(&mut self, most: usize, metric: Metric) -> Vec<usize> {
        let mut left: Vec<usize> = (0..self.contenders.len())
            .filter(|i| self.contenders[*i].alive && self.contenders[*i].point.speedup.is_some())
            .collect();
        let speed = |c: &Contender<'_>| c.point.speedup.map_or(0.0, |s| s.median);
        left.sort_by(|a, b| {
            let (a, b) = (&self.contenders[*a], &self.contenders[*b]);
            speed(b).total_cmp(&speed(a))
        });
        // The fastest first; one that has less error than all that are faster adds to the frontier, by medians.
        let error = |i: usize| {
            let ladder = self.contenders[i].point.error.as_ref();
            ladder.map_or(f64::INFINITY, |e| of(metric, e))
        };
        let mut least = f64::INFINITY;
        let (mut first, mut rest) = (Vec::new(), Vec::new());
        for i in left {
            match error(i) < least {
                true => {
                    least = error(i);
                    first.push(i);
                }
                false => rest.push(i),
            }
        }
        let mut chosen: Vec<usize> = first.into_iter().chain(rest).collect();
        let others = chosen.split_off(most.min(chosen.len()));
        for i in others {
            // The nearest in time that was taken.
            let near = chosen.iter().min_by(|a, b| {
                let distance =
                    |j: usize| (speed(&self.contenders[j]) - speed(&self.contenders[i])).abs();
                distance(**a).total_cmp(&distance(**b))
            });
            let with = near.map_or_else(String::new, |j| self.contenders[*j].point.name.clone());
            self.contenders[i].out(Fate::Even { with });
        }
        chosen
    }
}

impl Contender<'_> {
    /// Takes it out of the race.
    fn out(&mut self, fate: Fate) {
        self.point.fate = fate;
        self.alive = false;
        self.prepared = None;
    }

    /// More samples of its time.
    fn timed(&mut self, ratios: &[f64], times: &[f64], seed: u64) {
        self.ratios.extend_from_slice(ratios);
        self.times.extend_from_slice(times);
        if !self.ratios.is_empty() {
            self.point.speedup = Some(estimate(&self.ratios, seed));
            self.point.time_ms = Some(estimate(&self.times, seed));
        }
    }
}

impl<'a> Search<'a> {
    fn prepare(&self, inputs: &'a SceneInputs<'a>, plans: &[Plan]) -> Result<Prepared<'a>, Error> {
        let host = HostVariant::new(plans, self.settings.form)?;
        let settings = FrameSettings::of(inputs.scene());
        Ok(Prepared::new(inputs, &host, &settings)?)
    }

    fn order(&self) -> DrawOrder {
        let first = self.inputs.scene().orders.first();
        first.copied().unwrap_or(DrawOrder::AsGiven)
    }

    /// What errors are compared on, drawn.
    fn pictures(&self, plans: &[Plan]) -> Result<Vec<Rendered>, Error> {
        let mut prepared = self.prepare(self.drafts, plans)?;
        let draw = |frame: &&Frame| {
            self.drafts.set_frame(frame)?;
            prepared.aim(frame, self.order());
            Ok(prepared.render()?)
        };
        self.draft_frames.iter().map(draw).collect()
    }

    /// Aims at the headline view.
    fn aim(&self, prepared: &mut Prepared<'a>) -> Result<(), Error> {
        if let Some(frame) = self.frames.first() {
            self.inputs.set_frame(frame)?;
            prepared.aim(frame, self.order());
        }
        Ok(())
    }

    /// Milliseconds of one frame by the wall clock.
    fn glance(&self, prepared: &mut Prepared<'a>) -> Result<f64, Error> {
        self.aim(prepared)?;
        let start = Instant::now();
        prepared.draw()?;
        Ok(start.elapsed().as_secs_f64() * 1e3)
    }

    /// Applies candidates, and leaves out what is refused, is another's text, or is predicted to be hopeless.
    fn admit(&self, arena: &mut Arena<'a>, candidates: Vec<Candidate>) {
        let predictor = Predictor::new(self.originals, self.facts, self.settings.metric);
        let predictions: Vec<Option<Prediction>> =
            candidates.iter().map(|c| predictor.of(c)).collect();
        let mut keys: BTreeMap<String, String> = arena
            .contenders
            .iter()
            .filter_map(|c| Some((c.key.clone()?, c.point.name.clone())))
            .collect();
        keys.extend(
            journal::content(&self.subject, self.originals).map(|k| (k, ORIGINAL.to_owned())),
        );
        let mut admitted = Vec::new();
        let is_refused = |v: &Variant| !v.plans.is_empty() && v.kept.len() == v.plans.len();
        let mut refused: Vec<Candidate> = Vec::new();
        let mut kept = Vec::new();
        for (candidate, prediction) in candidates.into_iter().zip(predictions) {
            // What stands on a refused one is refused for its reason, and not worth a line.
            if refused.iter().any(|r| candidate.stands_on(r)) {
                continue;
            }
            let variant = measure::variant(self.originals, &candidate.recipe, self.facts);
            if is_refused(&variant) {
                refused.push(candidate.clone());
            }
            kept.push((candidate, prediction, variant));
        }
        // What is refused beats nothing.
        let known: Vec<Prediction> = kept
            .iter()
            .filter_map(|(_, p, v)| p.filter(|_| !is_refused(v)))
            .collect();
        for (candidate, prediction, variant) in kept {
            let is_refused = is_refused(&variant);
            let key = journal::content(&self.subject, &variant.plans);
            let same = key.as_ref().and_then(|k| keys.get(k));
            let hopeless = || hopeless(prediction?, &known, self.settings.budget);
            let fate = match (is_refused, same, &key) {
                (true, ..) => Some(Fate::Refused {
                    why: variant
                        .kept
                        .first()
                        .map_or_else(String::new, |k| k.why.clone()),
                }),
                (_, _, None) => Some(Fate::NotMeasured {
                    why: "its shaders cannot be written as WGSL".to_owned(),
                }),
                (_, Some(name), _) => Some(Fate::Same { r#as: name.clone() }),
                _ => hopeless().map(|why| Fate::Predicted { why }),
            };
            if let (None, Some(key)) = (&fate, &key) {
                keys.insert(key.clone(), variant.name.clone());
            }
            let point = Point {
                name: variant.name.clone(),
                recipe: variant.recipe.clone(),
                prediction,
                error: None,
                time_ms: None,
                speedup: None,
                path: None,
                fate: fate.clone().unwrap_or(Fate::NotMeasured {
                    why: "it was not reached".to_owned(),
                }),
            };
            admitted.push(Contender {
                candidate,
                variant,
                key,
                point,
                prepared: None,
                ratios: Vec::new(),
                times: Vec::new(),
                alive: fate.is_none(),
            });
        }
        arena.contenders.extend(admitted);
    }

    /// The order to draw in: what nothing is predicted of first, then layer by layer of what is predicted to be beaten by nothing, by nothing left, and so on.
    fn sequence(arena: &Arena<'_>) -> Vec<usize> {
        let waiting = |i: &usize| {
            let c = &arena.contenders[*i];
            c.alive && c.point.error.is_none()
        };
        let all: Vec<usize> = (0..arena.contenders.len()).filter(waiting).collect();
        let predicted = |i: usize| arena.contenders[i].point.prediction;
        let mut sequence: Vec<usize> = all
            .iter()
            .copied()
            .filter(|i| predicted(*i).is_none())
            .collect();
        let mut rest: Vec<(usize, Prediction)> = all
            .iter()
            .filter_map(|i| Some((*i, predicted(*i)?)))
            .collect();
        while !rest.is_empty() {
            let beaten = |p: &Prediction| {
                rest.iter().any(|(_, q)| {
                    q.error <= p.error && q.work <= p.work && (q.error < p.error || q.work < p.work)
                })
            };
            let (layer, under): (Vec<_>, Vec<_>) = rest.iter().partition(|(_, p)| !beaten(p));
            sequence.extend(layer.iter().map(|(i, _)| i));
            rest = under;
        }
        sequence
    }

    /// Draws each that waits, compares it with the original, and looks how long it takes.
    fn draw(&self, arena: &mut Arena<'a>, journal: &mut Journal, by: f64, watch: &mut Watch<'_>) {
        let sequence = Self::sequence(arena);
        let count = sequence.len();
        for (done, i) in sequence.into_iter().enumerate() {
            watch.at(
                Stage::Drawing,
                format!(
                    "drawing {} of {count}: {}",
                    done + 1,
                    arena.contenders[i].point.name
                ),
            );
            if watch.going_on(by).is_break() {
                let why = watch.over().unwrap_or("there was no time left to draw it");
                arena.contenders[i].out(Fate::NotMeasured {
                    why: why.to_owned(),
                });
                continue;
            }
            if arena.drawn >= self.settings.most {
                let why = format!("{} others were drawn before it", arena.drawn);
                arena.contenders[i].out(Fate::NotMeasured { why });
                continue;
            }
            arena.drawn += 1;
            if let Err(error) = self.draw_one(arena, i, journal) {
                let why = error.to_string();
                arena.contenders[i].out(Fate::NotMeasured { why });
                watch.lost(&error);
            }
        }
        watch.forgive();
    }

    fn draw_one(
        &self,
        arena: &mut Arena<'a>,
        i: usize,
        journal: &mut Journal,
    ) -> Result<(), Error> {
        let contender = &mut arena.contenders[i];
        let key = contender.key.clone().unwrap_or_default();
        let known = journal.get(&key).cloned().unwrap_or_default();
        let error = match known.error {
            Some(error) => error,
            None => {
                let start = Instant::now();
                let drawn = self.pictures(&contender.variant.plans)?;
                let mut worst = ErrorLadder::default();
                for (a, b) in arena.references.iter().zip(&drawn) {
                    worst = worst.worst(&compare(a, b)?);
                }
                arena.compared.0 += start.elapsed();
                arena.compared.1 += drawn.len() as u32;
                // JSON has no infinity: such a one is drawn again.
                if worst.max_abs.is_finite() {
                    let entry = Entry {
                        error: Some(worst.clone()),
                        ..Entry::default()
                    };
                    journal.add(&key, entry);
                }
                worst
            }
        };
        contender.point.error = Some(error.clone());
        let contract = contender
            .variant
            .plans
            .iter()
            .map(|p| p.contract.clone())
            .reduce(preshade_passes::contract::Contract::and);
        let broken = contract.and_then(|c| verdict::breaks(&c, &error));
        let broken = broken.or_else(|| {
            (error.nan_pixels > 0)
                .then(|| format!("{} pixels are NaN or infinite", error.nan_pixels))
        });
        if let Some(why) = broken {
            contender.out(Fate::Broken { why });
            return Ok(());
        }
        contender.timed(&known.ratios, &known.times, self.settings.seed);
        let mut prepared = self.prepare(self.inputs, &contender.variant.plans)?;
        // The first frame compiles and uploads; the lesser of two says more.
        let glance = self.glance(&mut prepared)?.min(self.glance(&mut prepared)?);
        if glance > DEAR && glance > TOO_SLOW * arena.first_sight {
            let times = glance / arena.first_sight;
            contender.out(Fate::Slow { times });
            return Ok(());
        }
        contender.prepared = Some(prepared);
        Ok(())
    }

    /// Times all that are in the race against the original, in rungs, and drops what is beaten after each.
    fn race(&self, arena: &mut Arena<'a>, journal: &mut Journal, by: f64, watch: &mut Watch<'_>) {
        for rung in 0..RUNGS {
            watch.at(Stage::Racing, "timing");
            let racing: Vec<usize> = (0..arena.contenders.len())
                .filter(|i| arena.contenders[*i].alive && arena.contenders[*i].prepared.is_some())
                .collect();
            // The first rung is run even late: without a time nothing can be said.
            let late = watch.going_on(by).is_break() && rung > 0;
            if racing.is_empty() || late || watch.over().is_some() {
                break;
            }
            if let Err(error) = self.rung(arena, &racing, FIRST_RUNG << rung, journal, watch) {
                watch.lost(&error);
                break;
            }
            arena.drop_beaten(self.settings.metric);
        }
        watch.forgive();
        let why = watch.over().unwrap_or("its time was not measured");
        for contender in &mut arena.contenders {
            if contender.alive && contender.point.speedup.is_none() {
                contender.out(Fate::NotMeasured {
                    why: why.to_owned(),
                });
            }
        }
    }

    fn rung(
        &self,
        arena: &mut Arena<'a>,
        racing: &[usize],
        samples: usize,
        journal: &mut Journal,
        watch: &mut Watch<'_>,
    ) -> Result<(), Error> {
        self.aim(&mut arena.original)?;
        for i in racing {
            if let Some(prepared) = &mut arena.contenders[*i].prepared {
                self.aim(prepared)?;
            }
        }
        let against: Vec<&Prepared<'a>> = std::iter::once(&arena.original)
            .chain(
                racing
                    .iter()
                    .filter_map(|i| arena.contenders[*i].prepared.as_ref()),
            )
            .collect();
        let timing = TimingSettings {
            budget: Duration::ZERO,
            min_samples: samples,
            max_samples: samples,
            submission: Duration::from_millis(6),
            seed: self.settings.seed,
        };
        let (_, timings) = measure::time(self.gpu, &against, &timing, |_| {
            watch.at(Stage::Racing, format!("timing {} variants", racing.len()));
        })?;
        for (i, timing) in racing.iter().zip(&timings[1..]) {
            let contender = &mut arena.contenders[*i];
            contender.timed(&timing.ratios, &timing.time.samples, self.settings.seed);
            let entry = Entry {
                error: None,
                ratios: timing.ratios.clone(),
                times: timing.time.samples.clone(),
            };
            journal.add(contender.key.as_deref().unwrap_or_default(), entry);
        }
        Ok(())
    }

    /// Verifies the finalists on every camera's path, and tells it all.
    fn verify(
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
            let mut chosen = Chosen::among(&report.variants, budget);
            if let Choice::Within { variant, .. } = &chosen.choice {
                let of = variants.iter().find(|v| v.name == *variant);
                let recipe = of.and_then(|v| Recipe::parse_list(&v.recipe).ok());
                let promised = recipe.and_then(|r| measure::promised(&r, budget, self.facts));
                chosen.recipe = promised.as_ref().map(Recipe::as_passes);
            }
            chosen
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

/// An error by a metric.
pub fn of(metric: Metric, error: &ErrorLadder) -> f64 {
    Budget { metric, most: 1.0 }.of(error)
}
