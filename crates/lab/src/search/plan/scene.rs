//! One scene, from its files to a decision.

use std::collections::BTreeSet;

use preshade_plan::contract::{Assumption, Contract, Verdict};
use preshade_plan::pass::Facts;
use preshade_plan::plan::Plan;

use super::assign::{Assignment, Considered, FramePredictor, Taken, finalists};
use super::choices::{Choices, choices};
use super::choose::Table;
use super::count::FragmentCounter;
use super::decision::{
    Decision, MaterialDecision, PlanReport, PlanView, PredictedRecipe, SCHEMA, SwitchCost,
    ViewReport,
};
use super::frame_work::{Counted, DrawCounts, drawn};
use super::layers::Layers;
use super::model::Model;
use super::partial_results::{PlanProgress, SceneSoFar};
use super::policy::{Hold, Measure, Policy, Rule, policy};
use super::stage::{self, Runner};
use super::{PlanError, confirm, partial_prepass, reasons, sorting};
use crate::measure::picture_warnings::{self, Colours};
use crate::measure::{self, Clock, Estimate, Session, Timing, TimingSettings, View, bench};
use preshade_compiler::recipe::Recipe;
use preshade_draw::scene::{DrawOrder, Frame, Scene, bind};

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Timed {
    /// Nothing: the choice is a prediction.
    No,
    /// Everything the choice depends on.
    #[default]
    Yes,
}

pub struct Settings<'a> {
    pub timed: Timed,
    /// How long and how often, for each view.
    pub timing: TimingSettings,
    /// Most frames of each camera to measure, evenly spaced from its first.
    pub frames_per_camera: usize,
    /// Plans of the frame that are measured against the original, before any refinement. Up to
    /// twice as many if predictions are too coarse to rank them.
    pub runners: usize,
    /// Most plans to measure in refining the best one, if there are several materials.
    pub refinements: usize,
    /// One plan, or two and a switch where that pays.
    pub hold: Hold,
    pub model: &'a Model,
    /// The command to put into the report.
    pub command: String,
}

/// A scene with the counts of its views.
pub(crate) struct Scouted {
    /// The candidates of each material.
    pub choices: Vec<Choices>,
    /// The draws of each material.
    pub drawn: Vec<DrawCounts>,
    pub views: Vec<(View, Frame)>,
    /// The counts of each view.
    pub counted: Vec<Counted>,
}

/// Applies the recipes to each material and counts fragments in every view.
pub(crate) fn scout(
    session: &Session<'_>,
    recipes: &[Recipe],
    facts: &Facts,
    frames_per_camera: usize,
) -> Result<Scouted, PlanError> {
    let (scene, inputs, originals) = (session.scene(), session.inputs(), session.originals());
    let views: Vec<(View, Frame)> = View::all(scene, frames_per_camera)
        .into_iter()
        .map(|(view, frame)| (view, *frame))
        .collect();
    if views.is_empty() {
        return Err(PlanError::NoView(scene.name.clone()));
    }
    let frames: Vec<_> = views.iter().map(|(v, frame)| (frame, v.order)).collect();
    measure::check_seen(session, &frames)?;
    let mut counter = FragmentCounter::new(inputs, originals)?;
    let mut counted = Vec::new();
    for (view, frame) in &views {
        inputs.set_frame(frame)?;
        counted.push(counter.count(frame, view.order)?);
    }
    Ok(Scouted {
        choices: choices(originals, recipes, facts),
        drawn: drawn(scene),
        views,
        counted,
    })
}

impl Scouted {
    /// The plans of the frame with a pre-pass for each material that takes it.
    fn prepasses(&self) -> Vec<Plan> {
        let of = |c: &Choices| c.position(partial_prepass::RECIPE).unwrap_or(0);
        let all = Assignment(self.choices.iter().map(of).collect());
        all.mended(&self.choices).0.plans(&self.choices)
    }

    /// The views as `model` sees them.
    pub fn seen<'a>(&'a self, model: &'a Model) -> FramePredictor<'a> {
        FramePredictor {
            choices: &self.choices,
            drawn: &self.drawn,
            counted: &self.counted,
            model,
            taken: Taken::All,
        }
    }
}

/// The measurements, by frame and view.
#[derive(Default)]
pub struct Measured {
    clock: Option<Clock>,
    pub(super) times: Vec<Vec<Option<Estimate>>>,
    pub(super) table: Table,
    colours: Colours,
    /// Pixels that are left out, in the view with most.
    unsteady: u64,
    so_far: SceneSoFar,
}

/// Decides the plan of each material of a scene. `recipes` are the candidates, with their measured
/// choices made. `progress` gets the part done, and the measurements after each view.
///
/// # Errors
///
/// The original cannot be drawn, counted or timed, or the adapter is lost.
pub fn decide(
    session: &Session<'_>,
    recipes: &[Recipe],
    facts: &Facts,
    settings: &Settings<'_>,
    progress: &mut dyn FnMut(PlanProgress<'_>),
) -> Result<Decision, PlanError> {
    progress(PlanProgress::at(0.0, "counting fragments"));
    let scouted = scout(session, recipes, facts, settings.frames_per_camera)?;
    let mut race = Race::new(session, &scouted, settings, progress);
    match settings.timed {
        Timed::No => race.predict(),
        Timed::Yes => {
            // A budget adds candidates, and the model is too coarse to choose among so many. Those
            // without a budget are measured first, or a budget would make the decision worse.
            let is_kept = |c: &Choices| c.candidates.iter().all(|c| Taken::Keeping.has(c));
            let rounds: &[Taken] = match scouted.choices.iter().all(is_kept) {
                true => &[Taken::All],
                false => &[Taken::Keeping, Taken::All],
            };
            for (round, taken) in rounds.iter().enumerate() {
                let seen = FramePredictor {
                    taken: *taken,
                    ..scouted.seen(settings.model)
                };
                let within = |from: f64, to: f64| {
                    [from, to].map(|done| 0.1 + 0.9 * (round as f64 + done) / rounds.len() as f64)
                };
                race.first(&seen, within(0.0, 0.65))?;
                race.refine(&seen, within(0.65, 1.0))?;
            }
        }
    }
    let Race {
        frames,
        runners,
        mut measured,
        progress,
        ..
    } = race;
    let measures: Vec<Measure> = measures(&scouted);
    let mut policy = policy(&measured.table, &measures, settings.hold);
    let (mut warnings, mut again) = (Vec::new(), Vec::new());
    if settings.timed == Timed::Yes {
        progress(PlanProgress::at(0.9, "measuring the choice again"));
        again = confirm::confirm(session, &scouted, settings, &frames, &policy, &mut measured)?;
        let of = (&scouted, &frames[..]);
        policy = confirm::held(policy, of, (&measured, &again), &mut warnings);
    }
    let chosen = Chosen {
        policy,
        again,
        warnings,
    };
    let mut decision = report(
        session,
        &scouted,
        settings,
        (&frames, &runners),
        measured,
        chosen,
    );
    if settings.timed == Timed::Yes {
        for (of, (view, frame)) in decision.views.iter_mut().zip(&scouted.views) {
            if view.order == DrawOrder::AsGiven {
                progress(PlanProgress::at(
                    0.9,
                    format!("sorting the draws of {view}"),
                ));
                session.inputs().set_frame(frame)?;
                let layers = Layers::draw(session, frame, facts)?;
                of.sorted = sorting::measured(session, frame, &layers, &settings.timing)?;
                let plans = scouted.prepasses();
                of.ahead = partial_prepass::measured(
                    session,
                    frame,
                    (&layers, &plans),
                    facts,
                    &settings.timing,
                )?;
            }
        }
    }
    progress(PlanProgress::at(1.0, "done"));
    Ok(decision)
}

/// The frames with a plan whose contract assumes that no depths tie, or that changes the picture within a budget: they
/// have to win beyond noise.
fn weaker(frames: &[Considered], choices: &[Choices]) -> BTreeSet<usize> {
    let needs = |plan: &Plan| {
        plan.contract.given().contains(&Assumption::NoDepthTies)
            || matches!(plan.contract, Contract::Approximate { .. })
    };
    let frames = frames.iter().enumerate();
    frames
        .filter(|(_, f)| f.assignment.plans(choices).iter().any(needs))
        .map(|(i, _)| i)
        .collect()
}

const MADE_UP: &str = "the scene is made up: give yours before you decide";

/// How many recipes each frame has.
fn forms(frames: &[Considered], choices: &[Choices]) -> Vec<usize> {
    let each = frames.iter().map(|f| f.assignment.recipes(choices));
    each.map(|recipes| recipes.values().collect::<BTreeSet<_>>().len())
        .collect()
}

/// A frame's predicted speedups, as if they were measured without noise.
fn predicted_row(original: &[f64], frame: &Considered) -> Vec<Option<Estimate>> {
    let each = original.iter().zip(&frame.predicted);
    each.map(|(before, after)| {
        let ratio = before / after;
        ratio.is_finite().then_some(Estimate {
            median: ratio,
            low: ratio,
            high: ratio,
        })
    })
    .collect()
}

/// Frames that are drawn against the original, compared and timed.
struct Race<'a, 'p> {
    session: &'a Session<'a>,
    scouted: &'p Scouted,
    settings: &'p Settings<'p>,
    progress: &'p mut dyn FnMut(PlanProgress<'_>),
    /// The original first.
    frames: Vec<Considered>,
    /// One for each of `frames`.
    runners: Vec<Runner<'a>>,
    measured: Measured,
}

impl<'a, 'p> Race<'a, 'p> {
    fn new(
        session: &'a Session<'a>,
        scouted: &'p Scouted,
        settings: &'p Settings<'p>,
        progress: &'p mut dyn FnMut(PlanProgress<'_>),
    ) -> Self {
        let views = scouted.views.iter().map(|(view, _)| view.clone());
        Self {
            measured: Measured {
                so_far: SceneSoFar::new(&session.scene().name, views),
                ..Measured::default()
            },
            session,
            scouted,
            settings,
            progress,
            frames: Vec::new(),
            runners: Vec::new(),
        }
    }

    /// Uses predictions instead of measurements.
    fn predict(&mut self) {
        self.frames = self.scouted.seen(self.settings.model).frames();
        let original = self.frames.first().map_or(&[][..], |f| &f.predicted);
        let rows = self.frames.iter().map(|f| predicted_row(original, f));
        self.measured.table = Table::new(rows.collect());
        self.measured.table.weaker = weaker(&self.frames, &self.scouted.choices);
        self.measured.times = vec![vec![None; self.scouted.views.len()]; self.frames.len()];
    }

    fn is_new(&self, frame: &Considered) -> bool {
        let mut known = self.frames.iter();
        known.all(|f| f.assignment != frame.assignment)
    }

    /// Measures the frames that are predicted to be the fastest.
    fn first(&mut self, seen: &FramePredictor<'_>, part: [f64; 2]) -> Result<(), PlanError> {
        // The original is the first of all.
        let all = seen.frames().into_iter().enumerate();
        let all: Vec<Considered> = all
            .filter(|(i, c)| *i == 0 || self.is_new(c))
            .map(|(_, c)| c)
            .collect();
        let predicted: Vec<&[f64]> = all.iter().map(|f| f.predicted.as_slice()).collect();
        let (runners, error) = (self.settings.runners, self.settings.model.error());
        let finalists = finalists(&predicted, runners, error).into_iter();
        let new = finalists.map(|i| &all[i]).filter(|c| self.is_new(c));
        self.measure(new.cloned().collect(), part)
    }

    /// Measures frames that differ from the best in one material, the fastest predicted first, as long
    /// as one is better.
    fn refine(&mut self, seen: &FramePredictor<'_>, part: [f64; 2]) -> Result<(), PlanError> {
        if self.scouted.choices.len() < 2 {
            return Ok(());
        }
        let mut left = self.settings.refinements;
        loop {
            let best = self.measured.table.best();
            let near: Vec<Considered> = seen
                .neighbours(&self.frames[best].assignment)
                .into_iter()
                .filter(|c| self.is_new(c))
                .take(left.min(LOT))
                .filter_map(|c| seen.consider(c.assignment))
                .filter(|c| self.is_new(c))
                .collect();
            if near.is_empty() {
                return Ok(());
            }
            left -= near.len();
            self.measure(near, part)?;
            if self.measured.table.best() == best {
                return Ok(());
            }
        }
    }

    /// Measures new frames. The first of all is the original. `part` is of the whole progress.
    fn measure(&mut self, new: Vec<Considered>, [from, to]: [f64; 2]) -> Result<(), PlanError> {
        let (session, scouted) = (self.session, self.scouted);
        let Some(first) = new.first() else {
            return Ok(());
        };
        // The original again, so that ratios are of samples from the same rounds. The first time,
        // it is measured against itself: a plan that gains less than that difference gains nothing.
        let again = self.frames.len().min(1);
        let itself = (again == 0).then_some(first);
        let mut lot = Vec::new();
        for frame in self.frames[..again].iter().chain(&new).chain(itself) {
            let name = frame.assignment.name(&scouted.choices);
            (self.progress)(PlanProgress::at(from, format!("compiling {name}")));
            lot.push(Runner::new(session, &scouted.choices, frame)?);
        }
        let mut rows: Vec<Vec<Option<Timing>>> = vec![Vec::new(); lot.len()];
        for (i, (view, frame)) in scouted.views.iter().enumerate() {
            let done =
                |views: usize| from + (to - from) * views as f64 / scouted.views.len() as f64;
            (self.progress)(PlanProgress::at(done(i), view.to_string()));
            let at = (view, frame);
            let measured = &mut self.measured;
            if let Some(first) = stage::compare(session, &mut lot, at)? {
                measured.colours.look(&first.picture);
                measured.unsteady = measured.unsteady.max(first.unsteady());
            }
            let timing = &self.settings.timing;
            let (clock, timings) = bench::race(session, &mut lot, at, timing, |_| {})?;
            measured.clock = Some(clock);
            measured.so_far.add(clock, view, (&lot, &timings));
            (self.progress)(PlanProgress {
                so_far: Some(&measured.so_far),
                ..PlanProgress::at(done(i + 1), view.to_string())
            });
            for (row, timing) in rows.iter_mut().zip(timings) {
                row.push(timing);
            }
        }
        if itself.is_some() {
            let stands = lot.pop().is_some_and(|r| r.subject.is_standing());
            let itself = rows.pop().filter(|_| stands).unwrap_or_default();
            let each = itself.iter().flatten().map(|t| confirm::apart(&t.speedup));
            self.measured.table.apart = each.fold(1.0, f64::max);
        }
        for (runner, row) in lot.into_iter().zip(rows).skip(again) {
            let stands = runner.subject.is_standing();
            let of = |is: bool, of: fn(&Timing) -> Estimate| {
                let each = row.iter().map(|t| t.as_ref().filter(|_| is).map(of));
                each.collect()
            };
            self.measured.times.push(of(true, |t| t.time.estimate));
            // A plan that broke in a later view is out everywhere.
            let speedups = of(stands, |t| t.speedup);
            self.measured.table.rows.push(speedups);
            self.runners.push(runner);
        }
        self.frames.extend(new);
        let table = &mut self.measured.table;
        table.weaker = weaker(&self.frames, &scouted.choices);
        table.forms = forms(&self.frames, &scouted.choices);
        let views = scouted.views.iter().enumerate();
        let in_front = views.filter(|(_, (view, _))| view.order == DrawOrder::FrontToBack);
        table.in_front = in_front.map(|(i, _)| i).collect();
        Ok(())
    }
}

/// The rule to draw by, and the results of its measurement.
struct Chosen {
    policy: Policy,
    /// The original against itself, by view.
    again: Vec<Option<Estimate>>,
    warnings: Vec<String>,
}

/// The measure that a switch depends on, by view.
fn measures(scouted: &Scouted) -> Vec<Measure> {
    let counted = scouted.views.iter().zip(&scouted.counted);
    counted
        .map(|((view, _), counted)| Measure {
            order: view.order,
            shaded: counted.shaded_per_pixel(),
        })
        .collect()
}

/// Frames measured at a time while refining.
const LOT: usize = 3;

fn report(
    session: &Session<'_>,
    scouted: &Scouted,
    settings: &Settings<'_>,
    (frames, subjects): (&[Considered], &[Runner<'_>]),
    measured: Measured,
    chosen: Chosen,
) -> Decision {
    let (gpu, scene) = (session.gpu(), session.scene());
    let measures = measures(scouted);
    let Chosen {
        policy,
        again,
        warnings,
    } = chosen;
    let plans: Vec<PlanReport> = frames
        .iter()
        .enumerate()
        .map(|(i, frame)| plan_report(i, frame, scouted, subjects.get(i), &measured))
        .collect();
    let views = scouted
        .views
        .iter()
        .zip(&scouted.counted)
        .enumerate()
        .map(|(i, ((view, _), counted))| ViewReport {
            view: view.clone(),
            shaded_per_pixel: counted.shaded_per_pixel(),
            overdraw: counted.overdraw(),
            materials: counted.materials.clone(),
            plan: policy.plan(measures[i].order, measures[i].shaded),
            alone: measured.table.best_in(i),
            again: again.get(i).copied().flatten(),
            sorted: None,
            ahead: None,
        })
        .collect();
    let mut decision = Decision {
        schema: SCHEMA.to_owned(),
        scene: scene.name.clone(),
        part: scene.part.clone(),
        resolution: scene.size,
        command: settings.command.clone(),
        adapter: gpu.adapter().clone(),
        clock: measured.clock,
        policy,
        materials: Vec::new(),
        plans,
        views,
        warnings: picture_warnings::missing_attributes(&bind::guessed(scene))
            .into_iter()
            .chain(picture_warnings::overlapping_draws(scene))
            .chain(measured.colours.warning())
            .chain(picture_warnings::unsteady(measured.unsteady))
            .chain(warnings)
            .chain(scene.is_made_up.then(|| MADE_UP.to_owned()))
            .collect(),
        switch_cost: Vec::new(),
        model: settings.model.clone(),
    };
    decision.switch_cost = switch_costs(&decision);
    let seen = scouted.seen(settings.model);
    decision.materials = (0..scouted.choices.len())
        .map(|m| material(m, scene, &seen, &decision, frames))
        .collect();
    decision
}

fn plan_report(
    index: usize,
    frame: &Considered,
    scouted: &Scouted,
    subject: Option<&Runner<'_>>,
    measured: &Measured,
) -> PlanReport {
    let by_view = frame.predicted.iter().enumerate().map(|(view, predicted)| {
        let at = |rows: &[Vec<Option<Estimate>>]| rows.get(index)?.get(view).copied().flatten();
        PlanView {
            predicted_ms: *predicted,
            time_ms: at(&measured.times),
            // Without a clock it would be the prediction again.
            speedup: measured.clock.and_then(|_| at(&measured.table.rows)),
        }
    });
    let plans = frame.assignment.plans(&scouted.choices);
    let promised = plans
        .iter()
        .fold(Contract::exact(), |c, plan| c.and(plan.contract.clone()));
    PlanReport {
        name: frame.assignment.name(&scouted.choices),
        recipes: frame.assignment.recipes(&scouted.choices),
        contract: promised,
        verdict: subject.map_or_else(
            || Verdict::NotMeasured {
                why: "it was not drawn".to_owned(),
            },
            |s| s.subject.verdict.clone(),
        ),
        error: subject.and_then(|s| s.subject.error.clone()),
        cost: subject.and_then(|s| s.cost.clone()),
        notes: frame.notes.clone(),
        by_view: by_view.collect(),
    }
}

/// The costs of both plans of each switch.
fn switch_costs(decision: &Decision) -> Vec<Option<SwitchCost>> {
    let cost = |plan: usize| decision.plans.get(plan)?.cost.as_ref();
    let of = |rule: &Rule| match rule {
        Rule::One { .. } => None,
        Rule::Switch(switch) => Some(SwitchCost::of(cost(switch.below)?, cost(switch.above)?)),
    };
    decision.policy.0.iter().map(|h| of(&h.rule)).collect()
}

/// The decision for one material.
fn material(
    index: usize,
    scene: &Scene,
    seen: &FramePredictor<'_>,
    decision: &Decision,
    frames: &[Considered],
) -> MaterialDecision {
    let choices = &seen.choices[index];
    let recipes: Vec<String> = decision
        .drawn()
        .iter()
        .map(|plan| {
            let recipes = &decision.plans[*plan].recipes;
            recipes.get(&choices.material).cloned().unwrap_or_default()
        })
        .collect();
    let original = &frames[0].predicted;
    let predicted: Vec<PredictedRecipe> = (1..choices.candidates.len())
        .filter_map(|pick| {
            let mut alone = Assignment::original(seen.choices);
            alone.0[index] = pick;
            let considered = seen.predict(alone)?;
            let ratios = original.iter().zip(&considered.predicted);
            let ratios: Vec<f64> = ratios.map(|(before, after)| after / before).collect();
            Some(PredictedRecipe {
                recipe: choices.candidates[pick].recipe.to_string(),
                relative_time: ratios.iter().sum::<f64>() / ratios.len().max(1) as f64,
            })
        })
        .collect();
    let mut reasons = reasons::of(&choices.material, &recipes, &predicted, decision);
    // The facts are about every frame of every camera.
    let needs = |r: &String| {
        let pick = choices
            .position(r)
            .and_then(|at| choices.candidates.get(at));
        pick.is_some_and(|c| c.plan.contract.given().contains(&Assumption::NoDepthTies))
    };
    if choices.depth_ties == Some(0) && recipes.iter().any(needs) {
        let views = scene.frames().count() as u64;
        let [width, height] = scene.size.map(u64::from);
        reasons.push(format!(
            "it depends on depth ties: no tie seen in {} pixels of {views} view{}",
            width * height * views,
            if views == 1 { "" } else { "s" }
        ));
    }
    MaterialDecision {
        reasons,
        material: choices.material.clone(),
        draws: (0..scene.draws.len())
            .filter(|d| scene.draws[*d].material == index)
            .collect(),
        recipes,
        refused: choices.refused.clone(),
        predicted,
    }
}
