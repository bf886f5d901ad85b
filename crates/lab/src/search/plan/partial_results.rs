//! The measurements of scenes while a run goes on. A run that is killed, or loses its adapter,
//! leaves its results and a list of missing views.

use preshade_plan::contract::Verdict;
use serde::Serialize;

use super::stage::Runner;
use crate::measure::{Clock, ErrorLadder, Estimate, FrameTime, Timing, View};
use preshade_draw::render::AdapterReport;

/// Version of the JSON that [`Unfinished`] serialises to.
pub(crate) const SCHEMA: &str = "preshade.plan-unfinished.v1";

/// Name of its file, which is removed at the end of the run.
pub const FILE: &str = "plan.unfinished.json";

/// Scenes of a run that has not come to its end.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Unfinished {
    pub schema: String,
    pub command: String,
    pub adapter: AdapterReport,
    /// Scenes that were begun, in order.
    pub scenes: Vec<SceneSoFar>,
    pub missing: Vec<String>,
}

/// The measurements of a scene.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SceneSoFar {
    pub scene: String,
    pub clock: Option<Clock>,
    /// Views in which every plan was drawn and timed.
    pub views: Vec<ViewSoFar>,
    pub missing: Vec<View>,
    /// Why its views will not be measured.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub failed: Option<String>,
}

/// The measurements in a view.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ViewSoFar {
    /// From where, in which order.
    #[serde(flatten)]
    pub view: View,
    /// The plans of the frame, the original first, and then those that refine the best.
    pub plans: Vec<PlanSoFar>,
}

/// The measurements of a plan in a view.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PlanSoFar {
    pub name: String,
    /// Whether its pictures so far keep the contract.
    pub verdict: Verdict,
    /// The worst difference. `None`: nothing was compared.
    pub error: Option<ErrorLadder>,
    /// Milliseconds a frame; `None` of one that is out.
    pub time: Option<FrameTime>,
    /// The original's time over its own.
    pub speedup: Option<Estimate>,
}

/// How far a scene is.
#[derive(Clone, Debug)]
pub struct PlanProgress<'a> {
    /// Part done, 0 to 1.
    pub done: f64,
    pub what: String,
    /// The measurements, if there are new ones.
    pub so_far: Option<&'a SceneSoFar>,
}

impl PlanProgress<'_> {
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
    /// A scene with these views, and no measurements.
    pub fn new(scene: &str, views: impl Iterator<Item = View>) -> Self {
        Self {
            scene: scene.to_owned(),
            missing: views.collect(),
            ..Self::default()
        }
    }

    /// Adds the measurements of these runners in a view, with their times.
    pub fn add(&mut self, clock: Clock, view: &View, plans: (&[Runner<'_>], &[Option<Timing>])) {
        self.clock = Some(clock);
        self.missing.retain(|v| v != view);
        let (runners, timings) = plans;
        let of = |(runner, timing): (&Runner<'_>, &Option<Timing>)| PlanSoFar {
            name: runner.name.clone(),
            verdict: runner.subject.verdict.clone(),
            error: runner.subject.error.clone(),
            time: timing.as_ref().map(|t| t.time.clone()),
            speedup: timing.as_ref().map(|t| t.speedup),
        };
        let plans = runners.iter().zip(timings).map(of);
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

    /// Replaces the measurements of a scene.
    pub fn take(&mut self, scene: SceneSoFar) {
        self.missing.retain(|name| *name != scene.scene);
        match self.scenes.iter_mut().find(|s| s.scene == scene.scene) {
            Some(known) => *known = scene,
            None => self.scenes.push(scene),
        }
    }

    /// Stores the reason why a scene failed, with its measurements.
    pub fn fail(&mut self, scene: &str, why: &str) {
        let known = self.scenes.iter().find(|s| s.scene == scene).cloned();
        let known = known.unwrap_or_else(|| SceneSoFar::new(scene, std::iter::empty()));
        self.take(SceneSoFar {
            failed: Some(why.to_owned()),
            ..known
        });
    }

    /// Indented, with a newline at its end.
    pub fn to_json(&self) -> serde_json::Result<String> {
        Ok(serde_json::to_string_pretty(self)? + "\n")
    }
}
