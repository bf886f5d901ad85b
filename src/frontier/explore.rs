//! The search: each candidate drawn for its error and raced for its time, those beaten dropped on the way, what is left verified along every camera's path.
//!
//! The race is successive halving (Jamieson and Talwalkar 2016) with evidence in place of a quota: after each rung, of twice the samples of the one before, what another beats beyond both intervals is out.

use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use preshade_passes::hoist::Metric;
use preshade_passes::pass::{Facts, Frequency};
use preshade_passes::plan::{GpuPass, Plan};
use serde::Serialize;

use super::arena::Arena;
use super::journal::{self, Journal};
use super::predict::Prediction;
use super::race::{CROSSED_BY, FREQUENCIES_BY, SEEDS_BY, Search};
use super::space::{self};
use super::watch::Watch;
use crate::measure::frequency::{choosing, small};
use crate::measure::{self, CountProgram, Error, ErrorLadder, Estimate, Variant};
use crate::recipe::Recipe;
use crate::render::{AdapterReport, Gpu, SceneInputs, ShaderForm};
use crate::report::{Budget, Chosen, PathTime, Pictures, Report};
use crate::scene::{DrawOrder, Scene};

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
    /// Time to spend in all. Met closely, not to the second: a candidate that is being measured is measured to its end. Where it is short, fewer are timed, and fewer verified.
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
    /// Nothing beats it, and one that was verified in its place has no more error and is as fast within the intervals.
    Even {
        /// Its name.
        with: String,
    },
    /// Nothing that was verified beats it or is as good, and it was not verified itself: what is known of it is its draft's.
    Unverified {
        /// Why not.
        why: String,
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
    search.admit(&mut arena, seeds, SEEDS_BY, &mut watch);
    search.draw(&mut arena, journal, SEEDS_BY, &mut watch);
    search.race(&mut arena, journal, SEEDS_BY, &mut watch);
    if settings.recipes.is_empty() {
        let crossed = arena.crossed();
        search.admit(&mut arena, crossed, CROSSED_BY, &mut watch);
        search.draw(&mut arena, journal, CROSSED_BY, &mut watch);
        search.race(&mut arena, journal, CROSSED_BY, &mut watch);
    }
    let most = search.verifiable(&arena, &watch);
    let finalists = arena.finalists(most, settings.metric, settings.budget);
    search.verify(arena, finalists, &mut watch)
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
        facts.frequencies = measure::frequencies(gpu, scene, &facts, settings.form, &mut |done| {
            let part = format!("measuring what can be interpolated, {:.0} %", done * 100.0);
            watch.at(Stage::Frequencies, part);
            watch.going_on(FREQUENCIES_BY)
        })?;
        // Those that were not reached are not carried; the search goes on.
        watch.forgive();
    }
    Ok(facts)
}

/// An error by a metric.
pub fn of(metric: Metric, error: &ErrorLadder) -> f64 {
    Budget { metric, most: 1.0 }.of(error)
}
