//! How well each value of a fragment stage can be interpolated on a scene's own triangles, and the choice under a budget that rests on it.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::ControlFlow;

use preshade_passes::graph::Graph;
use preshade_passes::hoist::{self, Candidate, Candidates, Computed, Hoist, Metric, Stages};
use preshade_passes::pass::{Facts, Frequency, Pass};
use preshade_passes::pass_named;
use preshade_passes::plan::Plan;

use super::bounds;
use super::interpolation::{Points, interpolation};
use super::{Error, ErrorLadder, compare, originals, variant};
use crate::parameters::parameters;
use crate::recipe::Recipe;
use crate::render::{
    FrameSettings, Gpu, Prepared, Rendered, SceneInputs, ShaderForm, Variant as HostVariant,
};
use crate::report::Budget;
use crate::scene::{DrawOrder, Frame, Scene};

/// Measures every candidate of every material: the picture with that value carried, in all materials that have it, and nothing else approximate, against the original. The worst of the
/// frames that choices are made on ([`choosing`]). Of `facts` the ranges count. The dearest come first; `progress` is told the part done, and may end it there: what was measured stands.
///
/// # Errors
/// As [`Prepared::new`] and [`Prepared::render`], of the original. A candidate that cannot be drawn is left out.
pub fn frequencies(
    gpu: &Gpu,
    scene: &Scene,
    facts: &Facts,
    form: ShaderForm,
    progress: &mut dyn FnMut(f64) -> ControlFlow<()>,
) -> Result<Vec<Frequency>, Error> {
    let scene = &small(scene);
    let inputs = SceneInputs::new(gpu, scene)?;
    let plans = originals(scene);
    let frames = choosing(scene);
    let references = pictures(&inputs, &plans, &frames, form)?;
    let stages = stages(&plans);
    let graphs = graphs(&stages);
    let found = found(&stages, &graphs, facts);
    // Materials of one shader have the same candidates, and are measured together.
    let mut candidates: BTreeMap<&str, Vec<(usize, &Candidates<'_, '_>, &Candidate)>> =
        BTreeMap::new();
    for (material, found) in found.iter().enumerate() {
        let Some(found) = found else { continue };
        for candidate in found.list() {
            let of = candidates.entry(&candidate.id).or_default();
            of.push((material, found, candidate));
        }
    }
    let mut candidates: Vec<_> = candidates.into_iter().collect();
    let saved = |of: &[(usize, &Candidates<'_, '_>, &Candidate)]| -> f64 {
        of.iter().map(|(_, _, c)| c.cost).fold(0.0, f64::max)
    };
    candidates.sort_by(|(_, a), (_, b)| saved(b).total_cmp(&saved(a)));
    let mut measured = Vec::new();
    for (done, (id, of)) in candidates.iter().enumerate() {
        if progress(done as f64 / candidates.len() as f64).is_break() {
            break;
        }
        let mut alone: BTreeMap<usize, Plan> = BTreeMap::new();
        let carried: Vec<_> = of
            .iter()
            .filter_map(|(material, found, candidate)| {
                alone.insert(*material, found.alone(id).ok()?);
                Some((material, candidate))
            })
            .collect();
        if carried.is_empty() {
            continue;
        }
        let mut changed = plans.clone();
        for (material, plan) in &alone {
            changed[*material].clone_from(plan);
        }
        let Ok(drawn) = pictures(&inputs, &changed, &frames, form) else {
            continue;
        };
        let worst = worst(&references, &drawn)?;
        // Whether it is finite is seen by itself: a target of fixed point holds no NaN.
        let interpolation = interpolation(&inputs, &plans, &alone, form, Points::Few);
        let interpolation = interpolation.unwrap_or_default();
        measured.extend(carried.into_iter().map(|(material, candidate)| Frequency {
            material: plans[*material].material.clone(),
            value: (*id).to_owned(),
            name: candidate.name.clone(),
            cost: candidate.cost,
            interpolation,
            bound: None,
            max_abs: worst.max_abs,
            flip_mean: worst.flip_mean,
            flip_p99: worst.flip_p99,
            nan_pixels: worst.nan_pixels,
            location: candidate.location.clone(),
        }));
    }
    Ok(measured)
}

/// The stages of each plan; `None` of one that nothing can be hoisted in. With [`graphs`] what [`found`] rests on, which is there for all candidates of a stage.
fn stages(plans: &[Plan]) -> Vec<Option<Stages<'_>>> {
    plans.iter().map(|p| Stages::of(p).ok()).collect()
}

fn graphs<'p>(stages: &[Option<Stages<'p>>]) -> Vec<Option<Graph<'p>>> {
    let graph = |s: &Option<Stages<'p>>| s.as_ref().map(Stages::graph);
    stages.iter().map(graph).collect()
}

fn found<'a, 'p>(
    stages: &'a [Option<Stages<'p>>],
    graphs: &'a [Option<Graph<'p>>],
    facts: &Facts,
) -> Vec<Option<Candidates<'a, 'p>>> {
    let each = stages.iter().zip(graphs);
    each.map(|(s, g)| Candidates::new(s.as_ref()?, g.as_ref()?, facts).ok())
        .collect()
}

/// Those of `facts`, with how far each value itself is from its interpolation, evaluated at more points, and proved: what no choice rests on, and takes a while.
///
/// # Errors
/// As [`SceneInputs::new`].
pub fn interpolations(
    gpu: &Gpu,
    scene: &Scene,
    facts: &Facts,
    form: ShaderForm,
    progress: &mut dyn FnMut(f64),
) -> Result<Vec<Frequency>, Error> {
    let inputs = SceneInputs::new(gpu, scene)?;
    let plans = originals(scene);
    let stages = stages(&plans);
    let graphs = graphs(&stages);
    let found = found(&stages, &graphs, facts);
    let mut frequencies = facts.frequencies.clone();
    let values: BTreeSet<String> = frequencies.iter().map(|f| f.value.clone()).collect();
    for (done, value) in values.iter().enumerate() {
        progress(done as f64 / values.len() as f64);
        let mut of: Vec<&mut Frequency> = frequencies
            .iter_mut()
            .filter(|f| f.value == *value)
            .collect();
        let materials: Vec<(usize, &Candidates<'_, '_>)> = found
            .iter()
            .enumerate()
            .filter(|(m, _)| of.iter().any(|f| f.material == plans[*m].material))
            .filter_map(|(m, found)| Some((m, found.as_ref()?)))
            .collect();
        let alone = materials
            .iter()
            .filter_map(|(m, found)| Some((*m, found.alone(value).ok()?)));
        let alone: BTreeMap<usize, Plan> = alone.collect();
        // What cannot be evaluated away from a picture is still known by it.
        let interpolation =
            interpolation(&inputs, &plans, &alone, form, Points::Many).unwrap_or_default();
        let computed = materials
            .iter()
            .map(|(m, found)| Some((*m, found.computed(value).ok()?)));
        let computed: Option<BTreeMap<usize, Computed>> = computed.collect();
        let bound = computed.and_then(|of| bounds::bound(scene, &plans, &of));
        for frequency in &mut of {
            frequency.interpolation = interpolation.or(frequency.interpolation);
            frequency.bound.clone_from(&bound);
        }
    }
    Ok(frequencies)
}

/// Most pixels of the pictures that candidates are measured on. How far interpolation is off is a matter of the triangles; whether a budget is kept is
/// seen at the scene's own size.
const MOST_PIXELS: u32 = 1 << 17;

pub(crate) fn small(scene: &Scene) -> Scene {
    let [width, height] = scene.size;
    let scale = (f64::from(MOST_PIXELS) / (f64::from(width) * f64::from(height))).sqrt();
    if scale >= 1.0 {
        return scene.clone();
    }
    let side = |n: u32| ((f64::from(n) * scale) as u32).max(1);
    scene.clone().resized([side(width), side(height)])
}

/// The frames that candidates are measured on: the first of every camera and the middle of its path.
pub fn choosing(scene: &Scene) -> Vec<&Frame> {
    spread(scene, 2)
}

/// Frames of a path on which a choice has to keep the budget. The others are there to check it.
const KEPT_ON: usize = 9;

/// The part of the budget that a choice may use up on those frames: what lies between them may be a little worse.
const MARGIN: f64 = 0.9;

/// At most `most` frames of every camera's path, evenly spaced from its first.
fn spread(scene: &Scene, most: usize) -> Vec<&Frame> {
    let of = |frames: &'_ [Frame]| -> BTreeSet<usize> {
        (0..most).map(|i| i * frames.len() / most).collect()
    };
    let cameras = scene.cameras.iter();
    cameras
        .flat_map(|c| {
            let chosen = of(&c.frames).into_iter();
            chosen.filter_map(|i| c.frames.get(i))
        })
        .collect()
}

fn pictures(
    inputs: &SceneInputs<'_>,
    plans: &[Plan],
    frames: &[&Frame],
    form: ShaderForm,
) -> Result<Vec<Rendered>, Error> {
    let scene = inputs.scene();
    let host = HostVariant::new(plans, form)?;
    let mut prepared = Prepared::new(inputs, &host, &FrameSettings::of(scene))?;
    frames
        .iter()
        .map(|frame| {
            inputs.set_frame(frame)?;
            prepared.aim(frame, DrawOrder::AsGiven);
            Ok(prepared.render()?)
        })
        .collect()
}

fn worst(references: &[Rendered], drawn: &[Rendered]) -> Result<ErrorLadder, Error> {
    let mut worst = ErrorLadder::default();
    for (a, b) in references.iter().zip(drawn) {
        worst = worst.worst(&compare(a, b)?);
    }
    Ok(worst)
}

/// Whether a recipe leaves a choice to measurement: a hoist with a budget and neither a threshold nor a list of values.
pub fn leaves_a_choice(recipe: &Recipe) -> bool {
    recipe.steps.iter().any(is_open)
}

fn is_open(step: &crate::recipe::Step) -> bool {
    step.pass == Hoist::INFO.name
        && step.params.contains_key("budget")
        && !step.params.contains_key("threshold")
        && !step.params.contains_key("carry")
}

/// The recipe with the threshold on measured errors that saves most and keeps the budget, less a margin, on frames along every path. Errors do not add along a
/// cut, so that each threshold is drawn: from the largest, halving the interval.
///
/// # Errors
/// As [`frequencies`].
pub fn within_budget(
    gpu: &Gpu,
    scene: &Scene,
    recipe: &Recipe,
    facts: &Facts,
    form: ShaderForm,
) -> Result<Recipe, Error> {
    let mut recipe = recipe.clone();
    let inputs = SceneInputs::new(gpu, scene)?;
    let plans = originals(scene);
    let frames = spread(scene, KEPT_ON);
    let references = pictures(&inputs, &plans, &frames, form)?;
    for index in 0..recipe.steps.len() {
        let step = &recipe.steps[index];
        let Ok(params) = serde_json::from_value::<hoist::Params>(step.params.clone().into()) else {
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
        let keeps = |threshold: f64| -> Result<bool, Error> {
            let mut tried = recipe.clone();
            set(&mut tried.steps[index], threshold);
            let tried = variant(&plans, &tried, facts);
            let drawn = pictures(&inputs, &tried.plans, &frames, form)?;
            let worst = worst(&references, &drawn)?;
            let error = match params.metric {
                Metric::FlipMean => worst.flip_mean,
                Metric::FlipP99 => worst.flip_p99,
                Metric::MaxAbs => worst.max_abs,
            };
            Ok(error <= MARGIN * budget && worst.nan_pixels == 0)
        };
        // `low` keeps it: with nothing approximate there is nothing to break it.
        let (mut low, mut high) = (0, thresholds.len());
        if keeps(thresholds[high - 1])? {
            low = high - 1;
        }
        while high - low > 1 {
            let middle = low.midpoint(high);
            match keeps(thresholds[middle])? {
                true => low = middle,
                false => high = middle,
            }
        }
        set(&mut recipe.steps[index], shortest(&thresholds, low));
    }
    Ok(recipe)
}

/// The recipe with its thresholds on measured errors written out as the values that keep them, so that it means the same where nothing is measured. `None`
/// if it rests on no measurement.
pub fn written_out(recipe: &Recipe, facts: &Facts) -> Option<Recipe> {
    let mut recipe = recipe.clone();
    let mut changed = false;
    for step in &mut recipe.steps {
        let params = serde_json::from_value::<hoist::Params>(step.params.clone().into());
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
        if ids.is_empty() {
            continue;
        }
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

/// The recipe with its approximations under a promise of `budget`, and what they chose written out: what a host is given of a variant that was found to be within it. `None` if it approximates
/// nothing.
pub fn promised(recipe: &Recipe, budget: Budget, facts: &Facts) -> Option<Recipe> {
    let mut recipe = recipe.clone();
    let mut changed = false;
    for step in &mut recipe.steps {
        // A budget without a metric is of another kind: what a rounding may become, say.
        let has_metric = |p| parameters(p).iter().any(|p| p.name == "metric");
        let counts = pass_named(&step.pass).is_some_and(has_metric);
        if !counts || !step.params.contains_key("budget") {
            continue;
        }
        step.params.insert("budget".to_owned(), budget.most.into());
        step.params.remove("metric");
        if budget.metric != hoist::Metric::default() {
            step.params
                .insert("metric".to_owned(), budget.name().into());
        }
        changed = true;
    }
    let written = written_out(&recipe, facts).unwrap_or(recipe);
    changed.then_some(written)
}

/// The threshold with the fewest digits that chooses what the one at `index` does.
fn shortest(thresholds: &[f64], index: usize) -> f64 {
    let exact = thresholds[index];
    let next = thresholds.get(index + 1).copied().unwrap_or(f64::INFINITY);
    (1..=16)
        .filter_map(|digits| format!("{exact:.digits$e}").parse::<f64>().ok())
        .find(|t| *t >= exact && *t < next)
        .unwrap_or(exact)
}

fn set(step: &mut crate::recipe::Step, threshold: f64) {
    step.params.insert("threshold".to_owned(), threshold.into());
}
