//! Evaluates the choices: measures every candidate in every view and compares the choice with the
//! best.
//!
//! One set of samples serves both. Rounds are taken A B B A. Every other pair is for choosing and
//! the rest for judging, so that a choice cannot profit from its own noise. The model is fitted to
//! the probes and every other scene. A choice measures no more than it normally would: the original
//! and the runners-up by prediction.
//!
//! The measured frames are those that `plan` ranks by prediction: the original, each recipe on all
//! materials that accept it, and the mix predicted best. So "best" means the best of these frames.
//! Choices are judged before `plan` refines them material by material, because that measures
//! further frames. The report says both.

use serde::Serialize;

use super::assign::finalists;
use super::choose::{Table, WORTHWHILE};
use super::exhaust::{EVEN, Exhausted, ExhaustedView, Rounds};
use super::model::{Model, Observation};
use super::policy::{Hold, Measure, Policy, policy};
use crate::measure::{Clock, Estimate, View};
use preshade_draw::render::AdapterReport;

/// Version of the JSON that [`RegretReport`] serialises to.
pub(crate) const SCHEMA: &str = "preshade.regret.v2";

/// How good the choices are.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RegretReport {
    pub schema: String,
    /// The command that measured it.
    pub command: String,
    pub adapter: AdapterReport,
    pub clock: Option<Clock>,
    /// Width and height, in pixels; `None`: each scene's own.
    pub resolution: Option<[u32; 2]>,
    /// Plans that a choice may measure in addition to the original.
    pub runners: usize,
    /// Fitted to the probes and to the scenes that are not held out.
    pub model: Model,
    /// The regret of choices for one view, and of one policy for all views of a scene.
    pub summary: Vec<Summary>,
    /// How far the model is off.
    pub prediction: Vec<Prediction>,
    pub scenes: Vec<SceneRegret>,
    /// Scenes that could not be measured, and why.
    pub failed: Vec<(String, String)>,
}

/// Regret over a set of views.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// `one view`: chosen for that view alone. `policy`: one plan, or two and a switch, for all
    /// views of the scene or of each draw order.
    pub choice: String,
    /// `all`, `fitted` or `held out`.
    pub scenes: String,
    pub views: usize,
    /// Views with a regret whose interval is above 0.
    pub counted: usize,
    /// Median of the regrets, those that are not counted being 0.
    pub median: f64,
    /// 95th percentile of the regrets.
    pub p95: f64,
    /// The largest regret.
    pub worst: f64,
    /// Scene and view of the largest.
    pub worst_at: String,
    /// Views whose chosen plan is slower than the original, with separate intervals.
    pub slower: usize,
    /// Views in which something other than the original is chosen.
    pub changed: usize,
}

/// How far predictions are from measurements, over all plans and views.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Prediction {
    /// `fitted` or `held out`.
    pub scenes: String,
    pub frames: usize,
    /// Median of the relative errors of a frame's time.
    pub time: f64,
    /// Median of those of its ratio to the original's time.
    pub ratio: f64,
    /// Views in which the plan predicted fastest is the fastest measured, or not slower beyond noise.
    pub first: usize,
    pub views: usize,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SceneRegret {
    pub scene: String,
    /// Whether the model was fitted without it.
    pub held_out: bool,
    pub plans: Vec<String>,
    /// Why those are out that are.
    pub out: Vec<(usize, String)>,
    /// The policy for all its views, before refinement.
    pub policy: Policy,
    pub views: Vec<ViewRegret>,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ViewRegret {
    #[serde(flatten)]
    pub view: View,
    /// Fragments the original shades for each pixel of the frame.
    pub shaded_per_pixel: f64,
    /// The plan with the least median time, of those that were measured.
    pub best: usize,
    /// Chosen for this view alone.
    pub alone: PlanRegret,
    /// Chosen by the scene's policy.
    pub policy: PlanRegret,
    /// By plan: predicted and measured milliseconds; `None` of one that is out.
    pub plans: Vec<Option<[f64; 2]>>,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PlanRegret {
    pub plan: usize,
    /// Its time over the best plan's.
    pub over_best: Estimate,
    /// The original's time over its own.
    pub speedup: Estimate,
}

impl PlanRegret {
    /// Time over the best plan's, less 1. 0 if the interval includes it.
    pub fn regret(&self) -> f64 {
        match self.over_best.low > 1.0 {
            true => self.over_best.median - 1.0,
            false => 0.0,
        }
    }

    fn is_slower(&self) -> bool {
        self.speedup.high < 1.0
    }
}

impl ExhaustedView {
    fn judged(&self, plan: usize, best: usize) -> PlanRegret {
        PlanRegret {
            plan,
            over_best: self.ratio(plan, best, Rounds::Judging).unwrap_or(EVEN),
            speedup: self.ratio(0, plan, Rounds::Judging).unwrap_or(EVEN),
        }
    }
}

impl Exhausted {
    fn observations(&self) -> Vec<Observation> {
        let of = |view: &ExhaustedView| -> Vec<Observation> {
            let plans = 0..view.work.len();
            plans
                .filter_map(|plan| {
                    Some(Observation {
                        work: view.work[plan],
                        ms: view.median(plan, Rounds::Choosing)?,
                    })
                })
                .collect()
        };
        self.views.iter().flat_map(of).collect()
    }

    /// Speedups on the samples that choices are made on, of those plans alone.
    fn table(&self, plans: &[usize], views: &[usize]) -> Table {
        let row = |plan: usize| {
            let is_in = plans.contains(&plan) && self.out[plan].is_none();
            let each = views.iter().map(|v| {
                let speedup = self.views[*v].ratio(0, plan, Rounds::Choosing);
                speedup.filter(|_| is_in)
            });
            each.collect()
        };
        Table::new((0..self.plans.len()).map(row).collect())
    }

    fn finalists(&self, model: &Model, views: &[usize], runners: usize) -> Vec<usize> {
        let predicted: Vec<Vec<f64>> = (0..self.plans.len())
            .map(|plan| {
                let works = views.iter().map(|v| &self.views[*v].work[plan]);
                works.map(|w| model.predict(w)).collect()
            })
            .collect();
        let predicted: Vec<&[f64]> = predicted.iter().map(Vec::as_slice).collect();
        finalists(&predicted, runners, model.error())
    }

    fn regret(&self, model: &Model, held_out: bool, runners: usize, hold: Hold) -> SceneRegret {
        let all: Vec<usize> = (0..self.views.len()).collect();
        let table = self.table(&self.finalists(model, &all, runners), &all);
        let measure = |v: &ExhaustedView| Measure {
            order: v.view.order,
            shaded: v.shaded_per_pixel,
        };
        let measures: Vec<Measure> = self.views.iter().map(measure).collect();
        let policy = policy(&table, &measures, hold);
        let views = self.views.iter().enumerate().map(|(i, view)| {
            let alone = self
                .table(&self.finalists(model, &[i], runners), &[i])
                .best_in(0);
            let standing = (0..self.plans.len()).filter(|p| self.out[*p].is_none());
            let best = standing
                .filter_map(|p| Some((p, view.median(p, Rounds::Judging)?)))
                .min_by(|a, b| a.1.total_cmp(&b.1))
                .map_or(0, |(p, _)| p);
            ViewRegret {
                view: view.view.clone(),
                shaded_per_pixel: view.shaded_per_pixel,
                best,
                alone: view.judged(alone, best),
                policy: view.judged(policy.plan(measures[i].order, measures[i].shaded), best),
                plans: (0..self.plans.len())
                    .map(|p| {
                        let measured = view.median(p, Rounds::Judging)?;
                        Some([rounded(model.predict(&view.work[p])), rounded(measured)])
                    })
                    .collect(),
            }
        });
        SceneRegret {
            scene: self.scene.clone(),
            held_out,
            plans: self.plans.clone(),
            out: self
                .out
                .iter()
                .enumerate()
                .filter_map(|(i, why)| Some((i, why.clone()?)))
                .collect(),
            views: views.collect(),
            policy,
        }
    }
}

fn rounded(ms: f64) -> f64 {
    (ms * 1e6).round() / 1e6
}

#[derive(Clone, Copy, Debug)]
pub struct Choosing {
    /// Plans that a choice may measure in addition to the original.
    pub runners: usize,
    /// One plan, or two and a switch where that pays.
    pub hold: Hold,
}

impl Default for Choosing {
    fn default() -> Self {
        Self {
            runners: 4,
            hold: Hold::Switching,
        }
    }
}

/// Compares choices with measurements. The model is fitted to `probes` and scenes of even index.
/// The others are held out.
pub(crate) fn evaluate(
    adapter: &AdapterReport,
    probes: &[Observation],
    scenes: &[Exhausted],
    choosing: Choosing,
    command: &str,
) -> RegretReport {
    let fitted = scenes.iter().step_by(2).flat_map(Exhausted::observations);
    let observations: Vec<Observation> = probes.iter().copied().chain(fitted).collect();
    let model = Model::fit(&adapter.title(), &observations);
    let rows: Vec<SceneRegret> = scenes
        .iter()
        .enumerate()
        .map(|(i, s)| s.regret(&model, i % 2 == 1, choosing.runners, choosing.hold))
        .collect();
    let mut summary = Vec::new();
    for (choice, judged) in CHOICES {
        for (name, which) in HALVES {
            summary.extend(summarised(&rows, (choice, judged), (name, which)));
        }
    }
    let prediction = [("fitted", false), ("held out", true)];
    let prediction = prediction.map(|(name, held_out)| predicted(&rows, name, held_out));
    RegretReport {
        schema: SCHEMA.to_owned(),
        command: command.to_owned(),
        adapter: adapter.clone(),
        clock: scenes.iter().find_map(|s| s.clock),
        resolution: None,
        runners: choosing.runners,
        model,
        summary,
        prediction: prediction.into(),
        scenes: rows,
        failed: Vec::new(),
    }
}

type Judge = fn(&ViewRegret) -> &PlanRegret;

const CHOICES: [(&str, Judge); 2] = [("one view", |v| &v.alone), ("policy", |v| &v.policy)];

type Half = fn(&SceneRegret) -> bool;

const HALVES: [(&str, Half); 3] = [
    ("all", |_| true),
    ("fitted", |s| !s.held_out),
    ("held out", |s| s.held_out),
];

fn summarised(
    rows: &[SceneRegret],
    (choice, judge): (&str, Judge),
    (scenes, which): (&str, Half),
) -> Option<Summary> {
    let of = |s: &SceneRegret| -> Vec<(f64, PlanRegret, String)> {
        let each = s.views.iter().map(|v| {
            let judged = *judge(v);
            (judged.regret(), judged, format!("{}: {}", s.scene, v.view))
        });
        each.collect()
    };
    let mut all: Vec<(f64, PlanRegret, String)> =
        rows.iter().filter(|s| which(s)).flat_map(of).collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (worst, _, worst_at) = all.last()?.clone();
    let at = |part: f64| all[((all.len() - 1) as f64 * part).round() as usize].0;
    Some(Summary {
        choice: choice.to_owned(),
        scenes: scenes.to_owned(),
        views: all.len(),
        counted: all.iter().filter(|(r, ..)| *r > 0.0).count(),
        median: at(0.5),
        p95: at(0.95),
        worst,
        worst_at,
        slower: all.iter().filter(|(_, j, _)| j.is_slower()).count(),
        changed: all.iter().filter(|(_, j, _)| j.plan != 0).count(),
    })
}

fn predicted(rows: &[SceneRegret], name: &str, held_out: bool) -> Prediction {
    let (mut times, mut ratios) = (Vec::new(), Vec::new());
    let (mut first, mut views) = (0, 0);
    let of = rows.iter().filter(|s| s.held_out == held_out);
    for view in of.flat_map(|s| &s.views) {
        let known: Vec<(usize, [f64; 2])> = view
            .plans
            .iter()
            .enumerate()
            .filter_map(|(i, p)| Some((i, (*p)?)))
            .collect();
        let Some((_, original)) = known.first().copied() else {
            continue;
        };
        views += 1;
        times.extend(known.iter().map(|(_, [p, m])| (p / m - 1.0).abs()));
        let ratio = |[p, m]: &[f64; 2]| ((p / original[0]) / (m / original[1]) - 1.0).abs();
        ratios.extend(known.iter().skip(1).map(|(_, p)| ratio(p)));
        let best = known
            .iter()
            .map(|(_, [_, m])| *m)
            .fold(f64::INFINITY, f64::min);
        let fastest = known.iter().min_by(|a, b| a.1[0].total_cmp(&b.1[0]));
        first += usize::from(fastest.is_some_and(|(_, [_, m])| *m <= best * WORTHWHILE));
    }
    let median = |mut values: Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or_default()
    };
    Prediction {
        scenes: name.to_owned(),
        frames: times.len(),
        time: median(times),
        ratio: median(ratios),
        first,
        views,
    }
}

impl RegretReport {
    /// The JSON of record: one line, with a newline at its end, for there are many views.
    pub fn to_json(&self) -> serde_json::Result<String> {
        Ok(serde_json::to_string(self)? + "\n")
    }
}

#[cfg(test)]
mod tests {
    use super::super::terms::{Term, Work};
    use super::*;
    use preshade_draw::scene::DrawOrder;

    /// A view with these times of its plans in milliseconds. The noise differs between rounds.
    fn view(camera: &str, ms: &[f64], predicted: &[f64]) -> ExhaustedView {
        let noise = |round: usize| 1.0 + 0.004 * ((round * 7 % 5) as f64 - 2.0);
        let samples = |(plan, ms): (usize, &f64)| {
            Some((0..16).map(|round| ms * noise(round + plan)).collect())
        };
        let work = |ms: &f64| {
            let mut work = Work::default();
            work.add(Term::FragmentOps, ms * 1e6);
            work
        };
        ExhaustedView {
            view: View {
                camera: camera.to_owned(),
                frame: 0,
                order: DrawOrder::AsGiven,
            },
            shaded_per_pixel: ms[0],
            work: predicted.iter().map(work).collect(),
            samples: ms.iter().enumerate().map(samples).collect(),
        }
    }

    fn scene(views: Vec<ExhaustedView>) -> Exhausted {
        Exhausted {
            scene: "s".to_owned(),
            plans: ["original", "a", "b"].map(str::to_owned).into(),
            out: vec![None; 3],
            views,
            clock: None,
        }
    }

    fn model() -> Model {
        Model {
            nanoseconds: [(Term::FragmentOps, 1.0)].into(),
            ..Model::nominal()
        }
    }

    #[test]
    fn what_is_best_and_measured_has_no_regret() {
        let ms = [2.0, 1.0, 1.5];
        let regret = scene(vec![view("c", &ms, &ms)]).regret(&model(), false, 2, Hold::One);
        let view = &regret.views[0];
        assert_eq!((view.best, view.alone.plan, view.policy.plan), (1, 1, 1));
        assert_eq!(view.alone.regret(), 0.0);
        assert!((view.alone.speedup.median - 2.0).abs() < 0.05);
    }

    #[test]
    fn what_the_model_hides_is_regretted() {
        // The best is predicted to be the slowest, and only one other plan is measured.
        let regret = scene(vec![view("c", &[2.0, 1.0, 1.5], &[2.0, 9.0, 1.5])]).regret(
            &model(),
            false,
            1,
            Hold::One,
        );
        let view = &regret.views[0];
        assert_eq!((view.best, view.alone.plan), (1, 2));
        assert!((view.alone.regret() - 0.5).abs() < 0.03, "{:?}", view.alone);
    }

    #[test]
    fn what_differs_by_noise_alone_is_not() {
        let ms = [1.0, 1.001, 0.999];
        let regret = scene(vec![view("c", &ms, &ms)]).regret(&model(), false, 2, Hold::One);
        assert_eq!(regret.views[0].alone.plan, 0);
        assert_eq!(regret.views[0].alone.regret(), 0.0);
    }

    #[test]
    fn what_broke_is_neither_chosen_nor_best() {
        let ms = [2.0, 1.0, 1.5];
        let mut scene = scene(vec![view("c", &ms, &ms)]);
        scene.out[1] = Some("a pixel".to_owned());
        let regret = scene.regret(&model(), false, 2, Hold::One);
        assert_eq!((regret.views[0].best, regret.views[0].alone.plan), (2, 2));
    }

    #[test]
    fn a_policy_pays_for_holding_to_one_plan() {
        let views = || {
            let (gains, loses) = ([2.0, 1.0, 2.0], [1.0, 1.2, 1.0]);
            vec![view("gains", &gains, &gains), view("loses", &loses, &loses)]
        };
        let one = scene(views()).regret(&model(), false, 2, Hold::One);
        assert_eq!(one.policy.plans(), [0]);
        assert!(one.views[0].policy.regret() > 0.9);
        assert_eq!(one.views[0].alone.regret(), 0.0);
        let two = scene(views()).regret(&model(), false, 2, Hold::Switching);
        assert!(
            two.views.iter().all(|v| v.policy.regret() == 0.0),
            "{two:?}"
        );
    }
}
