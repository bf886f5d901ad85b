//! Finds the recipes for a scene that no other recipe beats in both error and time.
//!
//! Data flows through the modules in this order:
//!
//! 1. [`space`]: the recipes to try, seeded by the interpolation error of each value of a fragment
//!    stage.
//! 2. [`predict`]: predicts error and work, and leaves out hopeless recipes.
//! 3. [`explore()`]: draws the others for their error (`race`), times them against the original,
//!    drops beaten ones (`arena`, [`pareto`]), crosses the survivors, and verifies the rest on every
//!    camera's path (`pick`, `watch`, `verify`). If a verified recipe fails, those it had beaten are
//!    judged again.
//! 4. [`journal`]: keeps measurements by hash, so that a search can continue.

mod arena;
pub mod journal;
pub mod pareto;
mod pick;
pub mod predict;
mod race;
pub mod space;
mod verify;
mod watch;

use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use preshade_plan::budget::Metric;
use preshade_plan::pass::{Facts, Frequency};
use serde::Serialize;

use crate::measure::record::{Chosen, PathTime, Pictures, Report};
use crate::measure::{
    self, Detail, Error, ErrorLadder, Estimate, Session, Variant, choosing, small,
};
use arena::Arena;
pub use journal::Journal;
use predict::Prediction;
use preshade_compiler::recipe::Recipe;
use preshade_draw::render::{AdapterReport, Gpu};
use preshade_draw::scene::{DrawOrder, Scene};
use preshade_scenes::ShaderForm;
use race::{CROSSED_BY, FREQUENCIES_BY, SEEDS_BY, Search};
use watch::Watch;

/// Version of the JSON that [`Exploration`] serialises to.
pub(crate) const SCHEMA: &str = "preshade.explore.v1";

/// The search and its limits.
pub struct Settings {
    /// The road shaders take to the driver.
    pub form: ShaderForm,
    pub metric: Metric,
    /// The largest error of interest. `None`: the whole frontier.
    pub budget: Option<f64>,
    /// The recipes to try. Empty: those of [`space::seeds`], and the best of them crossed.
    pub recipes: Vec<Recipe>,
    /// Time for the whole search. It may end a little later, because a measurement is never cut
    /// off. If time is short, fewer candidates are timed and verified.
    pub time: Duration,
    /// Most candidates that are drawn.
    pub most: usize,
    /// Most candidates to verify at the end.
    pub finalists: usize,
    /// Frames of each camera's path that these are verified on.
    pub frames_per_camera: usize,
    pub seed: u64,
    /// The command to put into the report.
    pub command: String,
}

/// The current step of a search.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum SearchStage {
    /// Interpolation errors are measured, value by value.
    Frequencies,
    /// Candidates are drawn for their error.
    Drawing,
    /// They are timed against each other.
    Racing,
    Verifying,
}

/// How far the search is.
#[derive(Clone, Debug, PartialEq)]
pub struct ExploreProgress {
    pub stage: SearchStage,
    pub what: String,
    /// Part of the time that is spent, 0 to 1.
    pub done: f64,
    pub left: Duration,
}

/// The result for a candidate.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum Fate {
    /// No other beats it: verified, and on the frontier.
    Frontier,
    /// Another has no more error and is faster beyond both intervals.
    Beaten {
        by: String,
    },
    /// No other beats it, but a verified one has no more error and is as fast within the intervals.
    Even {
        with: String,
    },
    /// No verified candidate beats it or is as good, but it was not verified. Its figures are from
    /// its draft.
    Unverified {
        why: String,
    },
    /// Its frame took so many times the original's that it was not timed again.
    Slow {
        times: f64,
    },
    /// The text and the plan of another.
    Same {
        r#as: String,
    },
    Refused {
        why: String,
    },
    /// It breaks its contract, or draws pixels that are not finite.
    Broken {
        why: String,
    },
    /// Its prediction was hopeless, so it was not drawn.
    Predicted {
        why: String,
    },
    /// It was not measured, or not to the end.
    NotMeasured {
        why: String,
    },
}

/// A candidate and its results.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Point {
    pub name: String,
    /// The recipe as `rewrite` takes it.
    pub recipe: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub prediction: Option<Prediction>,
    /// Against the original. For a finalist the worst of all verified frames, otherwise the worst
    /// of the draft frames.
    pub error: Option<ErrorLadder>,
    /// Milliseconds a frame in the headline view.
    pub time_ms: Option<Estimate>,
    /// The original's time over its own.
    pub speedup: Option<Estimate>,
    /// The frames' times along the longest path; `None`: not a finalist, or no path.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub path: Option<PathTime>,
    pub fate: Fate,
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum Ended {
    Complete,
    /// The time was up: some were not.
    OutOfTime,
    Stopped,
    Lost {
        why: String,
    },
}

/// The result of a search.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Exploration {
    pub schema: String,
    pub scene: String,
    /// For a captured frame, the part of it that `scene` is, in words.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub part: Option<String>,
    /// Width and height, in pixels.
    pub resolution: [u32; 2],
    /// The command that makes it again.
    pub command: String,
    pub adapter: AdapterReport,
    /// The order that opaque draws were in.
    pub order: DrawOrder,
    pub metric: Metric,
    pub seed: u64,
    pub ended: Ended,
    /// Frames of each camera's path that finalists were verified on; fewer than requested if time
    /// was short.
    pub frames_verified: usize,
    pub seconds: f64,
    /// The original first, then every candidate in the order they were thought of.
    pub points: Vec<Point>,
    /// Names of the points that no other beats, by their error.
    pub frontier: Vec<String>,
    /// The candidate that a budget selects.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub chosen: Option<Chosen>,
    /// The picture error and the savings of each value of a fragment stage, if it is interpolated.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub frequencies: Vec<Frequency>,
    /// The finalists, verified; `None`: it did not come to that.
    pub report: Option<Report>,
}

/// The result and the pictures of the finalists.
#[derive(Clone, Debug)]
pub struct Explored {
    pub exploration: Exploration,
    /// Pictures of the finalists in the headline view.
    pub pictures: Vec<Pictures>,
    pub variants: Vec<Variant>,
}

/// Searches for the recipes that no other beats in both error and time.
///
/// `progress` gets each step and may stop the search. The measurements so far are then returned,
/// and stay in `journal`.
///
/// # Errors
///
/// The original cannot be drawn.
pub fn explore(
    gpu: &Gpu,
    scene: &Scene,
    settings: &Settings,
    journal: &mut Journal,
    progress: &mut dyn FnMut(ExploreProgress) -> ControlFlow<()>,
) -> Result<Explored, Error> {
    // A frontier is about one draw order.
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
    // Drafts with few pixels show the error. A finalist is verified at full size.
    let draft = &small(scene).unwrap_or_else(|| scene.clone());
    let drafts = Session::new(gpu, draft, settings.form)?;
    let facts = measured_facts(&drafts, settings, &mut watch)?;
    let session = Session::new(gpu, scene, settings.form)?;
    let search = Search {
        session: &session,
        drafts: &drafts,
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

/// The facts of the scene: depth ties, and interpolation errors if a recipe needs them.
fn measured_facts(
    session: &Session<'_>,
    settings: &Settings,
    watch: &mut Watch<'_>,
) -> Result<Facts, Error> {
    watch.at(SearchStage::Frequencies, "looking for depth ties");
    let mut facts = measure::facts_for_choice(session)?;
    let is_open = |r: &Recipe| r.steps.iter().any(|s| s.pass == "hoist");
    if settings.recipes.is_empty() || settings.recipes.iter().any(is_open) {
        facts.frequencies = measure::frequencies(session, &facts, Detail::Choice, &mut |_| {
            watch.at(
                SearchStage::Frequencies,
                "measuring what can be interpolated",
            );
            watch.going_on(FREQUENCIES_BY)
        })?;
        // Values that were not reached are not interpolated. The search continues.
        watch.forgive();
    }
    Ok(facts)
}
