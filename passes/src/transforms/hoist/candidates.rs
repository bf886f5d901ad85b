//! Values that may be interpolated approximately, and those that measurements allow.

use std::collections::{BTreeMap, BTreeSet};

use super::movable::{self, Assumed, Class, Judged, NotHoisted, Precision, Verdict};
use super::single::{Candidates, HoistStages};
use super::{HoistMaterial, HoistParams, choose};
use crate::analysis::named::{name, span};
use crate::analysis::transitive_cost;
use crate::analysis::values::{ValueId, Values};
use preshade_dataflow::graph::FunctionId;
use preshade_dataflow::slice::{self, Criterion};
use preshade_plan::pass::{Facts, Frequency, Refusal};
use preshade_plan::plan::Plan;
use shader_text::source::{Location, SourceMap};

/// How each value may move according to the code and the measurements. `all` are the verdicts of
/// [`movable::judge`].
pub(super) fn judge(
    values: &Values<'_, '_>,
    material: &HoistMaterial<'_>,
    params: &HoistParams,
    precision: &Precision,
    facts: &Facts,
    all: &Judged,
) -> Judged {
    let measured: BTreeMap<&str, &Frequency> = facts
        .frequencies
        .iter()
        .filter(|f| f.material == material.name)
        .map(|f| (f.value.as_str(), f))
        .collect();
    // If the values of other materials were measured, those of this one were left out, and may be far off.
    let rests_on_measurement = !facts.frequencies.is_empty() && params.weakest() == Class::Smooth;
    if params.carry.is_none() && !rests_on_measurement {
        return Judged {
            verdicts: movable::held_back(values, params.assumed(), precision, &all.verdicts),
            ..all.clone()
        };
    }
    match &params.carry {
        Some(carry) => {
            let ids = carry.split('+').map(str::trim).filter(|id| !id.is_empty());
            let carry: BTreeSet<&str> = ids.collect();
            as_chosen(values, all, &carry, params.assumed(), precision)
        }
        None => Judged {
            verdicts: as_measured(values, &all.verdicts, &measured, params),
            ..all.clone()
        },
    }
}

/// Keeps only the approximations with these ids.
fn as_chosen(
    values: &Values<'_, '_>,
    all: &Judged,
    carry: &BTreeSet<&str>,
    otherwise: Assumed,
    precision: &Precision,
) -> Judged {
    let chosen = find(values, &all.verdicts, carry);
    let mut verdicts = movable::held_back(values, otherwise, precision, &all.verdicts);
    for (v, verdict) in verdicts.iter_mut().enumerate() {
        if chosen.contains_key(&v) {
            *verdict = all.verdicts[v].clone();
        } else if is_smooth(verdict) {
            *verdict = Err(NotHoisted::NotChosen);
        }
    }
    let found: BTreeSet<&str> = chosen.values().map(String::as_str).collect();
    let unknown = carry.iter().filter(|id| !found.contains(**id));
    Judged {
        verdicts,
        unknown: unknown.map(|id| (*id).to_owned()).collect(),
        ..all.clone()
    }
}

/// Keeps only the approximations whose measured error is within the threshold.
fn as_measured(
    values: &Values<'_, '_>,
    assumed: &[Verdict],
    measured: &BTreeMap<&str, &Frequency>,
    params: &HoistParams,
) -> Vec<Verdict> {
    let threshold = params.threshold.or(params.budget).unwrap_or_default();
    let ids = find(values, assumed, &measured.keys().copied().collect());
    let mut verdicts = assumed.to_vec();
    for (v, verdict) in verdicts.iter_mut().enumerate() {
        if !is_smooth(verdict) {
            continue;
        }
        match ids.get(&v).and_then(|id| measured.get(id.as_str())) {
            Some(f) if !f.is_finite() => *verdict = Err(NotHoisted::MeasuredNotFinite),
            // A NaN exceeds every threshold.
            Some(f) if params.metric.of(f) <= threshold => {}
            Some(f) => {
                *verdict = Err(NotHoisted::Measured {
                    error: format!("{:.4}", params.metric.of(f)),
                });
            }
            None => *verdict = Err(NotHoisted::NotMeasured),
        }
    }
    verdicts
}

pub(super) fn is_smooth(verdict: &Verdict) -> bool {
    matches!(verdict, Ok(c) if c.class == Class::Smooth)
}

/// A value that may be interpolated approximately.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// Stable id among the values of its fragment stage: a hash of its computation and the chain of
    /// calls.
    pub id: String,
    /// The author's name, or a description.
    pub name: String,
    /// Static cost including all dependences.
    pub cost: f64,
    /// Where it is in the author's source.
    pub location: Option<Location>,
}

/// Most candidates to examine, most expensive first.
pub const MOST_CANDIDATES: usize = 48;

/// The values of a plan's fragment stage that may be interpolated approximately, most expensive
/// first. Only the ranges in `facts` matter: with them, affine values with small rounding errors
/// qualify for a stronger contract.
///
/// # Errors
/// Nothing can be hoisted.
pub fn candidates(plan: &Plan, facts: &Facts) -> Result<Vec<Candidate>, Box<Refusal>> {
    let stages = HoistStages::of(plan)?;
    let graph = stages.graph();
    let candidates = Candidates::new(&stages, &graph, facts)?;
    Ok(candidates.list().cloned().collect())
}

/// Name and place of each candidate.
pub(super) fn describe(
    values: &Values<'_, '_>,
    verdicts: &[Verdict],
    sources: &SourceMap,
) -> Vec<(ValueId, Candidate)> {
    let found = dearest(values, verdicts, MOST_CANDIDATES);
    let ids = ids(values, found.iter().map(|(v, _)| *v));
    found
        .into_iter()
        .filter_map(|(v, cost)| {
            let location = span(values, v).and_then(|s| sources.locate(s));
            let text = || location.as_ref().and_then(|l| snippet(sources, l));
            let candidate = Candidate {
                id: ids.get(&v)?.clone(),
                name: name(values, v).or_else(text).unwrap_or_default(),
                cost,
                location,
            };
            Some((v, candidate))
        })
        .collect()
}

/// At most `most` approximable values, most expensive first, with their costs.
fn dearest(values: &Values<'_, '_>, verdicts: &[Verdict], most: usize) -> Vec<(ValueId, f64)> {
    let width = |v| values.shape(v).map(|(_, w)| w);
    let users = values.users();
    let smooth: Vec<ValueId> = (0..values.values.len())
        .filter(|v| is_smooth(&verdicts[*v]))
        .collect();
    let price = |v| choose::SMOOTH_PRICE * f64::from(width(v).unwrap_or(1));
    // Several names of one value are merged below, so start with more.
    let mut looked_at = 4 * most;
    loop {
        let costs = transitive_cost::dearest(values, &smooth, looked_at, choose::SMOOTH_PRICE);
        let costs = costs.into_iter().filter(|(v, cost)| *cost > price(*v));
        let costs: BTreeMap<ValueId, f64> = costs.collect();
        // If a value has several names, keep the last: a call's result rather than the callee's
        // return value.
        let is_last = |v: ValueId, cost: f64| {
            !users[v]
                .iter()
                .any(|u| costs.get(u) == Some(&cost) && width(*u) == width(v))
        };
        let all = costs.iter().map(|(v, cost)| (*v, *cost));
        let mut found: Vec<(ValueId, f64)> = all.filter(|(v, cost)| is_last(*v, *cost)).collect();
        if found.len() >= most || looked_at >= smooth.len() {
            found.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
            found.truncate(most);
            return found;
        }
        looked_at *= 4;
    }
}

/// Longest source snippet as a name, in characters.
const LONGEST_NAME: usize = 32;

/// The author's text of an expression on one line, truncated.
fn snippet(sources: &SourceMap, at: &Location) -> Option<String> {
    let file = sources.files().iter().find(|f| f.name == at.file)?;
    let text = file
        .text
        .get(at.range.start as usize..at.range.end as usize)?;
    let words: Vec<&str> = text.split_whitespace().collect();
    let text = words.join(" ");
    Some(match text.char_indices().nth(LONGEST_NAME) {
        Some((end, _)) => format!("{}..", &text[..end]),
        None => text,
    })
}

/// Most values whose ids are compared with those of a choice. The choice was made on the author's
/// plan; another pass may have changed the order since.
const MOST_COMPARED: usize = 4 * MOST_CANDIDATES;

/// The approximable values with these ids among the most expensive. Missing ids belong to other
/// materials.
pub(super) fn find(
    values: &Values<'_, '_>,
    verdicts: &[Verdict],
    wanted: &BTreeSet<&str>,
) -> BTreeMap<ValueId, String> {
    let mut found = BTreeMap::new();
    let mut missing = wanted.clone();
    // Ids hash the whole computation, so compute only as many as needed.
    for some in dearest(values, verdicts, MOST_COMPARED).chunks(MOST_CANDIDATES) {
        if missing.is_empty() {
            break;
        }
        for (value, id) in ids(values, some.iter().map(|(v, _)| *v)) {
            if wanted.contains(id.as_str()) {
                missing.remove(id.as_str());
                found.insert(value, id);
            }
        }
    }
    found
}

/// Ids of values: the hash of the slice, and the calls that lead to it.
fn ids(values: &Values<'_, '_>, of: impl Iterator<Item = ValueId>) -> BTreeMap<ValueId, String> {
    let graph = values.graph;
    let mut hashes: BTreeMap<(FunctionId, naga::Handle<naga::Expression>), String> =
        BTreeMap::new();
    of.filter_map(|v| {
        let (context, expression, _) = values.expression(v)?;
        let function = values.contexts[context].function;
        let hash = hashes.entry((function, expression)).or_insert_with(|| {
            let value = Criterion::Value {
                function,
                expression,
            };
            slice::backward(graph, values.entry, &[value]).hash(graph)
        });
        let mut id = hash.clone();
        let mut at = context;
        while let Some((caller, call)) = values.contexts[at].call {
            id.push_str(&format!(".{}", call.index()));
            at = caller;
        }
        Some((v, id))
    })
    .collect()
}
