//! What was measured of scenes while a run goes on: one that is killed, or loses its adapter, leaves what it has, and what is missing.

use preshade_passes::contract::Verdict;
use serde::Serialize;

use super::count::View;
use super::stage::Subject;
use crate::measure::{Clock, ErrorLadder, Estimate, FrameTime, Timing};
use crate::render::AdapterReport;

/// Version of the JSON that [`Unfinished`] serialises to.
pub const SCHEMA: &str = "preshade.plan-unfinished.v1";

/// Name of the file that it is kept in. It is taken away once everything is told.
pub const FILE: &str = "plan.unfinished.json";

/// Scenes of a run that has not come to its end.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Unfinished {
    /// Always [`SCHEMA`].
    pub schema: String,
    /// The command that measures.
    pub command: String,
    /// Where.
    pub adapter: AdapterReport,
    /// Scenes that were begun, in order.
    pub scenes: Vec<SceneSoFar>,
    /// Those that were not.
    pub missing: Vec<String>,
}

/// What was measured of a scene.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SceneSoFar {
    /// Scene's name.
    pub scene: String,
    /// Whose clock.
    pub clock: Option<Clock>,
    /// Views in which every plan was drawn and timed.
    pub views: Vec<ViewSoFar>,
    /// Views that are missing.
    pub missing: Vec<View>,
    /// Why nothing will come of them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub failed: Option<String>,
}

/// What was measured in a view.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ViewSoFar {
    /// From where, in which order.
    #[serde(flatten)]
    pub view: View,
    /// The plans of the frame, the original first; behind them those that were measured to refine what was best.
    pub plans: Vec<PlanSoFar>,
}

/// What was measured of a plan of the frame in a view.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PlanSoFar {
    /// Name, in words.
    pub name: String,
    /// What its pictures say of its promise, in the views yet.
    pub verdict: Verdict,
    /// The worst of them; `None`: nothing was compared.
    pub error: Option<ErrorLadder>,
    /// Milliseconds a frame; `None` of one that is out.
    pub time: Option<FrameTime>,
    /// The original's time over its own.
    pub speedup: Option<Estimate>,
}

/// How far a scene is.
#[derive(Clone, Debug)]
pub struct Progress<'a> {
    /// Part of it that is done, 0 to 1.
    pub done: f64,
    /// What is done now.
    pub what: String,
    /// What was measured, where that is more than when it was last told.
    pub so_far: Option<&'a SceneSoFar>,
}

impl Progress<'_> {
    /// Where nothing more is measured.
    pub fn at(done: f64, what: impl Into<String>) -> Self {
        Self {
            done,
            what: what.into(),
            so_far: None,
        }
    }
}

impl SceneSoFar {
    /// A scene of these views, of which nothing is measured.
    pub fn new(scene: &str, views: impl Iterator<Item = View>) -> Self {
        Self {
            scene: scene.to_owned(),
            missing: views.collect(),
            ..Self::default()
        }
    }

    /// Adds what was measured of these plans in a view: their subjects, and their times as [`super::stage::time`] gives them.
    pub fn add(&mut self, clock: Clock, view: &View, plans: (&[Subject<'_>], &[Option<Timing>])) {
        self.clock = Some(clock);
        self.missing.retain(|v| v != view);
        let (subjects, timings) = plans;
        let of = |(subject, timing): (&Subject<'_>, &Option<Timing>)| PlanSoFar {
            name: subject.name.clone(),
            verdict: subject.verdict.clone(),
            error: subject.error.clone(),
            time: timing.as_ref().map(|t| t.time.clone()),
            speedup: timing.as_ref().map(|t| t.speedup),
        };
        let plans = subjects.iter().zip(timings).map(of);
        match self.views.iter_mut().find(|v| v.view == *view) {
            // The original is measured again with each lot.
            Some(known) => known.plans.extend(plans.skip(1)),
            None => self.views.push(ViewSoFar {
                view: view.clone(),
                plans: plans.collect(),
            }),
        }
    }
}

impl Unfinished {
    /// A run that has these scenes before it.
    pub fn new(command: String, adapter: AdapterReport, scenes: Vec<String>) -> Self {
        Self {
            schema: SCHEMA.to_owned(),
            command,
            adapter,
            scenes: Vec::new(),
            missing: scenes,
        }
    }

    /// Takes in what is known of a scene, in place of what was.
    pub fn take(&mut self, scene: SceneSoFar) {
        self.missing.retain(|name| *name != scene.scene);
        match self.scenes.iter_mut().find(|s| s.scene == scene.scene) {
            Some(known) => *known = scene,
            None => self.scenes.push(scene),
        }
    }

    /// Notes why a scene comes to no end. What was measured of it stands.
    pub fn fail(&mut self, scene: &str, why: &str) {
        let known = self.scenes.iter().find(|s| s.scene == scene).cloned();
        let known = known.unwrap_or_else(|| SceneSoFar::new(scene, std::iter::empty()));
        self.take(SceneSoFar {
            failed: Some(why.to_owned()),
            ..known
        });
    }

    /// Indented, with a newline at its end.
    ///
    /// # Errors
    /// None that these types can give.
    pub fn to_json(&self) -> serde_json::Result<String> {
        Ok(serde_json::to_string_pretty(self)? + "\n")
    }
}
