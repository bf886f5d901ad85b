//! Measures how well each value of a fragment stage can be interpolated on the scene's triangles,
//! and chooses under a budget.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::ControlFlow;

use preshade_dataflow::graph::Graph;
use preshade_geometry::pass_named;
use preshade_passes::transforms::hoist::{
    self, Candidate, Candidates, Computed, Hoist, HoistStages, refusals,
};
use preshade_plan::budget::{Budget, Metric};
use preshade_plan::pass::{Bound, Facts, Frequency, Pass, Refusal};
use preshade_plan::plan::Plan;

use super::interpolation::{Points, interpolation};
use super::view::{choosing, small, spread};
use super::{Error, ErrorLadder, Session, Variant, bounds, refused, variant};
use preshade_compiler::command::explain::WORTH_A_LOOK;
use preshade_compiler::parameters::parameters;
use preshade_compiler::recipe::Recipe;
use preshade_draw::scene::DrawOrder;

/// How much to find out about each value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Detail {
    /// Enough for choosing values. The most expensive values come first. Cheap ones are measured
    /// too, because a cut moves many together.
    Choice,
    /// Also more points between vertices, and a proved bound. Values come material by material,
    /// without those that cost less than [`WORTH_A_LOOK`] of their stage.
    Table,
}

/// The progress of [`frequencies`], after each value.
#[derive(Clone, Copy, Debug)]
pub struct FrequencyStep<'m> {
    /// Part done, 0 to 1.
    pub done: f64,
    /// The values measured so far.
    pub measured: &'m [Frequency],
    /// With [`Detail::Table`]: so many materials are complete, in the scene's order.
    pub complete: usize,
}

/// Measures every candidate value: draws the scene with only that value interpolated, in all
/// materials that have it, and compares with the original. Keeps the worst of the [`choosing`]
/// frames. Of `facts` only the ranges matter. `progress` may stop the measurement.
pub fn frequencies(
    session: &Session<'_>,
    facts: &Facts,
    detail: Detail,
    progress: &mut dyn FnMut(FrequencyStep<'_>) -> ControlFlow<()>,
) -> Result<Vec<Frequency>, Error> {
    let small = small(session.scene());
    let scene = small.as_ref().unwrap_or(session.scene());
    let session = Session::sharing(session.gpu(), scene, session.form())?;
    measured(&session, facts, detail, progress)
}

fn measured(
    session: &Session<'_>,
    facts: &Facts,
    detail: Detail,
    progress: &mut dyn FnMut(FrequencyStep<'_>) -> ControlFlow<()>,
) -> Result<Vec<Frequency>, Error> {
    let plans = session.originals();
    let frames = choosing(session.scene());
    let references = session.pictures(plans, &frames, DrawOrder::AsGiven)?;
    let stages = stages(plans);
    let graphs = graphs(&stages);
    let found = found(&stages, &graphs, facts);
    let least: Vec<f64> = match detail {
        Detail::Choice => vec![0.0; plans.len()],
        Detail::Table => plans.iter().zip(&graphs).map(least).collect(),
    };
    let values = values(&found, &least, detail);
    let mut measured: Vec<Frequency> = Vec::new();
    for (done, value) in values.iter().enumerate() {
        let step = FrequencyStep {
            done: done as f64 / values.len() as f64,
            measured: &measured,
            complete: value.materials[0].0,
        };
        if progress(step).is_break() {
            break;
        }
        let alone = value.alone();
        if alone.is_empty() {
            continue;
        }
        let mut changed = plans.to_vec();
        for (material, plan) in &alone {
            changed[*material].clone_from(plan);
        }
        let drawn = session.pictures(&changed, &frames, DrawOrder::AsGiven);
        let Some(drawn) = Error::unless_lost(drawn)? else {
            continue;
        };
        let worst = ErrorLadder::worst_of(&references, &drawn)?;
        // Interpolation shows whether it is finite: a target of fixed point holds no NaN.
        let points = match detail {
            Detail::Choice => Points::Few,
            Detail::Table => Points::Many,
        };
        let interpolation = interpolation(session, &alone, points);
        let interpolation = Error::unless_lost(interpolation)?.flatten();
        let is_finite = interpolation.is_none_or(|i| i.not_finite == 0);
        let bound = match detail {
            // Nothing bounds a value that was NaN.
            Detail::Table if is_finite => value.bound(session),
            Detail::Choice | Detail::Table => None,
        };
        let carried = value
            .materials
            .iter()
            .filter(|(m, ..)| alone.contains_key(m));
        measured.extend(carried.map(|(material, _, candidate)| Frequency {
            material: plans[*material].material.clone(),
            value: value.id.to_owned(),
            name: candidate.name.clone(),
            cost: candidate.cost,
            interpolation,
            bound: bound.clone(),
            max_abs: worst.max_abs,
            flip_mean: worst.flip_mean,
            flip_p99: worst.flip_p99,
            flip_tile: worst.flip_tile,
            nan_pixels: worst.nan_pixels,
            location: candidate.location.clone(),
        }));
    }
    let _ = progress(FrequencyStep {
        done: 1.0,
        measured: &measured,
        complete: plans.len(),
    });
    Ok(measured)
}

/// A value that may be interpolated, in every material that has it.
struct Shared<'f, 'a, 'p> {
    id: &'f str,
    /// Index of the material, in ascending order.
    materials: Vec<(usize, &'f Candidates<'a, 'p>, &'f Candidate)>,
}

impl Shared<'_, '_, '_> {
    /// The plans with only this value interpolated, by index of the material.
    fn alone(&self) -> BTreeMap<usize, Plan> {
        let plans = self.materials.iter();
        plans
            .filter_map(|(material, found, _)| Some((*material, found.alone(self.id).ok()?)))
            .collect()
    }

    /// The proved bound of its interpolation error.
    fn bound(&self, session: &Session<'_>) -> Option<Bound> {
        let computed = self.materials.iter();
        let computed: Option<BTreeMap<usize, Computed>> = computed
            .map(|(material, found, _)| Some((*material, found.computed(self.id).ok()?)))
            .collect();
        bounds::bound(session.scene(), session.originals(), &computed?)
    }
}

/// The static cost of a value that is worth a look.
fn least((plan, graph): (&Plan, &Option<Graph<'_>>)) -> f64 {
    let entry = plan.main().and_then(|pass| {
        let fragment = pass.fragment.as_deref()?;
        plan.program(pass)?
            .entry_point(naga::ShaderStage::Fragment, fragment)
    });
    let cost = entry.zip(graph.as_ref()).map(|((i, _), g)| g.entry_cost(i));
    WORTH_A_LOOK * cost.unwrap_or_default()
}

/// The candidate values that cost at least `least`, by material. Materials of one shader have the
/// same candidates, and are measured together.
fn values<'f, 'a, 'p>(
    found: &'f [Option<Candidates<'a, 'p>>],
    least: &[f64],
    detail: Detail,
) -> Vec<Shared<'f, 'a, 'p>> {
    let mut values: BTreeMap<&str, Vec<_>> = BTreeMap::new();
    for (material, found) in found.iter().enumerate() {
        let Some(found) = found else { continue };
        for candidate in found.list().filter(|c| c.cost >= least[material]) {
            let of = values.entry(&candidate.id).or_default();
            of.push((material, found, candidate));
        }
    }
    let shared = |(id, materials)| Shared { id, materials };
    let mut values: Vec<_> = values.into_iter().map(shared).collect();
    let saved = |of: &Shared<'_, '_, '_>| -> f64 {
        of.materials
            .iter()
            .map(|(_, _, c)| c.cost)
            .fold(0.0, f64::max)
    };
    values.sort_by(|a, b| saved(b).total_cmp(&saved(a)));
    if detail == Detail::Table {
        values.sort_by_key(|of| of.materials[0].0);
    }
    values
}

/// The stages of each plan. `None`: nothing can be hoisted.
fn stages(plans: &[Plan]) -> Vec<Option<HoistStages<'_>>> {
    plans.iter().map(|p| HoistStages::of(p).ok()).collect()
}

fn graphs<'p>(stages: &[Option<HoistStages<'p>>]) -> Vec<Option<Graph<'p>>> {
    let graph = |s: &Option<HoistStages<'p>>| s.as_ref().map(HoistStages::graph);
    stages.iter().map(graph).collect()
}

fn found<'a, 'p>(
    stages: &'a [Option<HoistStages<'p>>],
    graphs: &'a [Option<Graph<'p>>],
    facts: &Facts,
) -> Vec<Option<Candidates<'a, 'p>>> {
    let each = stages.iter().zip(graphs);
    each.map(|(s, g)| Candidates::new(s.as_ref()?, g.as_ref()?, facts).ok())
        .collect()
}

/// Frames of a path on which a choice has to keep the budget. The others are there to check it.
const KEPT_ON: usize = 9;

/// The part of the budget that a choice may use on those frames. Frames between them may be a
/// little worse.
const MARGIN: f64 = 0.9;

/// Whether measurement has to choose: the recipe has a hoist with a budget, but without a threshold
/// and a list of values.
pub fn leaves_a_choice(recipe: &Recipe) -> bool {
    recipe.steps.iter().any(is_open)
}

fn is_open(step: &preshade_compiler::recipe::Step) -> bool {
    step.pass == Hoist::INFO.name
        && step.params.contains_key("budget")
        && !step.params.contains_key("threshold")
        && !step.params.contains_key("carry")
}

/// The recipe with the threshold that saves most within the budget, less a margin, on frames along
/// every path. Errors of values do not add up, so each threshold is drawn. Starts at the largest
/// and bisects. Refuses if not even the lowest keeps the budget, because of another step of the
/// recipe, say.
pub fn within_budget(
    session: &Session<'_>,
    recipe: &Recipe,
    facts: &Facts,
) -> Result<Result<Recipe, Box<Refusal>>, Error> {
    let mut recipe = recipe.clone();
    let session = Session::sharing(session.gpu(), session.scene(), session.form())?;
    let plans = session.originals();
    let frames = spread(session.scene(), KEPT_ON);
    let references = session.pictures(plans, &frames, DrawOrder::AsGiven)?;
    for index in 0..recipe.steps.len() {
        let step = &recipe.steps[index];
        let Ok(params) = serde_json::from_value::<hoist::HoistParams>(step.params.clone().into())
        else {
            continue;
        };
        let (true, Some(budget)) = (is_open(step), params.budget) else {
            continue;
        };
        let mut thresholds: Vec<f64> = facts
            .frequencies
            .iter()
            .map(|f| params.metric.of(f))
            .filter(|e| *e <= budget)
            .chain([0.0])
            .collect();
        thresholds.sort_by(f64::total_cmp);
        thresholds.dedup();
        let error = |threshold: f64| -> Result<f64, Error> {
            let mut tried = recipe.clone();
            set(&mut tried.steps[index], threshold);
            let tried = variant(plans, &tried, facts);
            if tried.is_refused() {
                return Ok(0.0);
            }
            let drawn = session.pictures(&tried.plans, &frames, DrawOrder::AsGiven)?;
            let worst = ErrorLadder::worst_of(&references, &drawn)?;
            Ok(match worst.nan_pixels {
                0 => params.metric.of(&worst),
                _ => f64::INFINITY,
            })
        };
        let (mut low, mut high) = (0, thresholds.len());
        let (mut next, mut best, mut least) = (high - 1, None, f64::INFINITY);
        while low < high {
            let error = error(thresholds[next])?;
            if error <= MARGIN * budget {
                (best, low) = (Some(next), next + 1);
            } else {
                (least, high) = (error, next);
            }
            next = low.midpoint(high);
        }
        let Some(best) = best else {
            let refusal = Refusal::new(
                Hoist::INFO.name,
                &refusals::OVER_BUDGET,
                format!(
                    "no choice of values keeps the budget of {budget}: the best has a {} of {least:.5}",
                    params.metric
                ),
                "allow a larger budget, or leave out a step",
            );
            return Ok(Err(Box::new(refusal)));
        };
        set(&mut recipe.steps[index], shortest(&thresholds, best));
    }
    Ok(Ok(recipe))
}

/// A recipe whose choices measurement made.
#[derive(Clone, Debug)]
pub struct Settled {
    pub asked: Recipe,
    /// The refusal: no choice keeps the budget.
    pub chosen: Result<Recipe, Box<Refusal>>,
}

impl Settled {
    /// The plans that it makes.
    pub fn variant(&self, originals: &[Plan], facts: &Facts) -> Variant {
        match &self.chosen {
            Ok(chosen) => variant(originals, chosen, facts),
            Err(why) => refused(originals, &self.asked, why),
        }
    }

    /// How `rewrite` makes the same as `made`, if measurement chose it.
    pub fn note(&self, made: &Variant, facts: &Facts) -> Option<String> {
        let chosen = self.chosen.as_ref().ok();
        let chosen = chosen.filter(|_| leaves_a_choice(&self.asked) && !made.is_refused())?;
        Some(format!(
            "{}: chosen by measurement; `rewrite` makes the same of {}",
            self.asked,
            written_out(chosen, facts)?.as_passes()
        ))
    }
}

/// Makes the choices that recipes leave to measurement. Adds the measurements behind them to
/// `facts`. `progress` gets the part done of the current step.
pub fn settled(
    session: &Session<'_>,
    recipes: Vec<Recipe>,
    facts: &mut Facts,
    progress: &mut dyn FnMut(f64, &str),
) -> Result<Vec<Settled>, Error> {
    if recipes.iter().any(leaves_a_choice) {
        let mut told = |done| progress(done, "measuring what can be interpolated");
        told(0.0);
        facts.frequencies = frequencies(session, facts, Detail::Choice, &mut |step| {
            told(step.done);
            ControlFlow::Continue(())
        })?;
    }
    let settled = recipes.into_iter().map(|asked| {
        let chosen = match leaves_a_choice(&asked) {
            false => Ok(asked.clone()),
            true => {
                progress(1.0, &format!("choosing within the budget of {asked}"));
                within_budget(session, &asked, facts)?
            }
        };
        Ok(Settled { asked, chosen })
    });
    settled.collect()
}

/// The recipe with thresholds replaced by the values they select, so that it means the same without
/// measurements. `None`: nothing was measured for it.
pub fn written_out(recipe: &Recipe, facts: &Facts) -> Option<Recipe> {
    let mut recipe = recipe.clone();
    let mut changed = false;
    for step in &mut recipe.steps {
        let params = serde_json::from_value::<hoist::HoistParams>(step.params.clone().into());
        let (Ok(params), true) = (params, step.pass == Hoist::INFO.name) else {
            continue;
        };
        let (Some(threshold), false) = (params.threshold, facts.frequencies.is_empty()) else {
            continue;
        };
        let keeps = |f: &&Frequency| params.metric.of(f) <= threshold && f.is_finite();
        let ids: BTreeSet<&str> = facts
            .frequencies
            .iter()
            .filter(keeps)
            .map(|f| f.value.as_str())
            .collect();
        let ids: Vec<&str> = ids.into_iter().collect();
        step.params.remove("threshold");
        step.params.insert("carry".to_owned(), ids.join("+").into());
        if let Some(ratio) = params.vertices_per_fragment.or(facts.vertices_per_fragment) {
            let ratio = (ratio * 1e6).round() / 1e6;
            step.params
                .insert("vertices-per-fragment".to_owned(), ratio.into());
        }
        changed = true;
    }
    changed.then_some(recipe)
}

/// The recipe for a host: its approximations promise `budget`, and their selected values are
/// written out. `None`: it approximates nothing.
pub fn promised(recipe: &Recipe, budget: Budget, facts: &Facts) -> Option<Recipe> {
    // A threshold is in the metric of the recipe.
    let mut recipe = written_out(recipe, facts).unwrap_or_else(|| recipe.clone());
    let mut changed = false;
    for step in &mut recipe.steps {
        // A budget without a metric limits roundings, not the picture.
        let has_metric = |p| parameters(p).iter().any(|p| p.name == "metric");
        let counts = pass_named(&step.pass).is_some_and(has_metric);
        if !counts || !step.params.contains_key("budget") {
            continue;
        }
        step.params.insert("budget".to_owned(), budget.limit.into());
        step.params.remove("metric");
        if budget.metric != Metric::default() {
            step.params
                .insert("metric".to_owned(), budget.metric.name().into());
        }
        changed = true;
    }
    changed.then_some(recipe)
}

/// The threshold with the fewest digits that selects the same values as the one at `index`.
fn shortest(thresholds: &[f64], index: usize) -> f64 {
    let exact = thresholds[index];
    let next = thresholds.get(index + 1).copied().unwrap_or(f64::INFINITY);
    (1..=16)
        .filter_map(|digits| format!("{exact:.digits$e}").parse::<f64>().ok())
        .find(|t| *t >= exact && *t < next)
        .unwrap_or(exact)
}

fn set(step: &mut preshade_compiler::recipe::Step, threshold: f64) {
    step.params.insert("threshold".to_owned(), threshold.into());
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// A threshold is in the metric of the recipe, and not in that of the budget.
    #[test]
    fn a_promised_recipe_selects_what_was_measured() {
        let frequency = |value: &str, flip_mean: f64, flip_tile: f64| Frequency {
            material: "m".to_owned(),
            value: value.to_owned(),
            name: String::new(),
            cost: 10.0,
            interpolation: None,
            bound: None,
            max_abs: 0.0,
            flip_mean,
            flip_p99: 0.0,
            flip_tile,
            nan_pixels: 0,
            location: None,
        };
        let facts = Facts {
            frequencies: vec![frequency("a", 0.001, 0.02), frequency("b", 0.5, 0.6)],
            ..Facts::default()
        };
        let budget = Budget {
            metric: Metric::FlipTile,
            limit: 0.3,
        };
        let promised = |threshold: &str| {
            let recipe = format!("hoist:budget=0.5,threshold={threshold}");
            let recipe = Recipe::parse([recipe.as_str()]).unwrap();
            promised(&recipe, budget, &facts)
                .unwrap()
                .steps
                .remove(0)
                .params
        };
        let some = promised("0.01");
        assert_eq!(some["carry"], "a");
        assert_eq!(
            (&some["metric"], &some["budget"]),
            (&"flip_tile".into(), &0.3.into())
        );
        // A threshold that selects nothing would select `a` in the other metric.
        let none = promised("0");
        assert_eq!((&none["carry"], none.get("threshold")), (&"".into(), None));
    }
}
