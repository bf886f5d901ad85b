//! Everything measured: each frame that is weighed in a scene, in every view.

use preshade_plan::contract::Verdict;
use preshade_plan::pass::Facts;
use serde::{Deserialize, Serialize};

use super::PlanError;
use super::scene::{Settings, scout};
use super::stage::{self, Runner};
use super::terms::Work;
use crate::measure::timing::estimate;
use crate::measure::{Clock, Estimate, Session, View, bench};
use preshade_compiler::recipe::Recipe;

/// A scene in which everything was measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Exhausted {
    pub scene: String,
    /// Names of the plans of the frame, the original first.
    pub plans: Vec<String>,
    /// Why those are out that broke a promise or could not be drawn, by plan.
    pub out: Vec<Option<String>>,
    pub views: Vec<ExhaustedView>,
    pub clock: Option<Clock>,
}

/// A view in which everything was measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ExhaustedView {
    /// From where, in which order.
    pub view: View,
    /// Fragments the original shades for each pixel of the frame.
    pub shaded_per_pixel: f64,
    /// The work of each plan.
    pub work: Vec<Work>,
    /// Milliseconds a frame, round by round; `None` of a plan that is out.
    pub samples: Vec<Option<Vec<f64>>>,
}

/// Measures every frame of [`super::assign::FramePredictor::frames`] in every view of a scene.
pub fn exhaust(
    session: &Session<'_>,
    recipes: &[Recipe],
    facts: &Facts,
    settings: &Settings<'_>,
) -> Result<Exhausted, PlanError> {
    let scene = session.scene();
    let scouted = scout(session, recipes, facts, settings.frames_per_camera)?;
    let frames = scouted.seen(settings.model).frames();
    let mut subjects = frames
        .iter()
        .map(|frame| Runner::new(session, &scouted.choices, frame))
        .collect::<Result<Vec<_>, _>>()?;
    let mut clock = None;
    let mut views = Vec::new();
    for (i, (view, frame)) in scouted.views.iter().enumerate() {
        let at = (view, frame);
        stage::compare(session, &mut subjects, at)?;
        let (whose, timings) = bench::race(session, &mut subjects, at, &settings.timing, |_| {})?;
        clock = Some(whose);
        views.push(ExhaustedView {
            view: view.clone(),
            shaded_per_pixel: scouted.counted[i].shaded_per_pixel(),
            work: frames.iter().map(|f| f.work[i]).collect(),
            // A sample that the clock lost would put rounds side by side that were not.
            samples: timings
                .into_iter()
                .map(|t| t.filter(|t| t.rejected == 0).map(|t| t.time.samples))
                .collect(),
        });
    }
    let out = subjects
        .iter()
        .map(|subject| match &subject.subject.verdict {
            Verdict::Broken { r#where } => Some(r#where.clone()),
            Verdict::NotMeasured { why } => Some(why.clone()),
            Verdict::Holds => None,
        });
    Ok(Exhausted {
        scene: scene.name.clone(),
        plans: frames
            .iter()
            .map(|f| f.assignment.name(&scouted.choices))
            .collect(),
        out: out.collect(),
        views,
        clock,
    })
}

#[derive(Clone, Copy)]
pub(super) enum Rounds {
    Choosing,
    Judging,
}

/// The rounds of one kind. Kinds alternate after two rounds.
fn part(samples: &[f64], which: Rounds) -> Vec<f64> {
    let wanted = match which {
        Rounds::Choosing => 0,
        Rounds::Judging => 1,
    };
    let each = samples.iter().enumerate();
    each.filter(|(i, _)| (i / 2) % 2 == wanted)
        .map(|(_, s)| *s)
        .collect()
}

const SEED: u64 = 0x7265_6772_6574;

pub(super) const EVEN: Estimate = Estimate {
    median: 1.0,
    low: 1.0,
    high: 1.0,
};

impl ExhaustedView {
    /// Time of plan `a` over that of `b`, round by round.
    pub(super) fn ratio(&self, a: usize, b: usize, which: Rounds) -> Option<Estimate> {
        if a == b {
            return Some(EVEN);
        }
        let (a, b) = (
            self.samples.get(a)?.as_ref()?,
            self.samples.get(b)?.as_ref()?,
        );
        let (a, b) = (part(a, which), part(b, which));
        let ratios: Vec<f64> = a.iter().zip(&b).map(|(a, b)| a / b).collect();
        (!ratios.is_empty()).then(|| estimate(&ratios, SEED))
    }

    pub(super) fn median(&self, plan: usize, which: Rounds) -> Option<f64> {
        let samples = part(self.samples.get(plan)?.as_ref()?, which);
        (!samples.is_empty()).then(|| estimate(&samples, SEED).median)
    }
}
