//! Which values might be carried as approximations, and which of them may after they were measured.

use std::collections::{BTreeMap, BTreeSet};

use super::choose;
use super::travel::{self, Carriage, Class, Finite, Judged, Precision, Stays};
use super::values::{ValueId, Values};
use super::{Material, Params, name, span};
use crate::graph::{FunctionId, Graph};
use crate::pass::{Facts, Frequency, Refusal};
use crate::plan::Plan;
use crate::program::{Location, SourceMap};
use crate::slice::{self, Criterion};

/// How each value may travel, as far as the code shows it and what was measured allows it.
pub(super) fn judge(
    values: &Values<'_, '_>,
    material: &Material<'_>,
    params: &Params,
    facts: &Facts,
) -> Judged {
    let precision = material.precision(facts);
    let mut judged = travel::judge(values, params.finite, &precision);
    let verdicts = &mut judged.verdicts;
    let smooth = |v: &Result<Carriage, Stays>| matches!(v, Ok(c) if c.class == Class::Smooth);
    if let Some(carry) = &params.carry {
        let carry: BTreeSet<&str> = carry.split('+').map(str::trim).collect();
        let assumed = travel::judge(values, Finite::Assumed, &precision).verdicts;
        let ids = ids(values, |v| smooth(&assumed[v]));
        for (v, verdict) in verdicts.iter_mut().enumerate() {
            if ids.get(&v).is_some_and(|id| carry.contains(id.as_str())) {
                *verdict = assumed[v].clone();
            } else if smooth(verdict) {
                *verdict = Err(Stays::NotChosen);
            }
        }
        return judged;
    }
    let measured: BTreeMap<&str, &Frequency> = facts
        .frequencies
        .iter()
        .filter(|f| f.material == material.name)
        .map(|f| (f.value.as_str(), f))
        .collect();
    if measured.is_empty() || params.weakest() < Class::Smooth {
        return judged;
    }
    let threshold = params.threshold.or(params.budget).unwrap_or_default();
    let assumed = travel::judge(values, Finite::Assumed, &precision).verdicts;
    let ids = ids(values, |v| smooth(&assumed[v]));
    for (v, verdict) in verdicts.iter_mut().enumerate() {
        if !smooth(&assumed[v]) {
            continue;
        }
        *verdict = match ids.get(&v).and_then(|id| measured.get(id.as_str())) {
            Some(f) if !f.is_finite() => Err(Stays::MeasuredNotFinite),
            // A NaN keeps no threshold.
            Some(f) if params.metric.of(f) <= threshold => assumed[v].clone(),
            Some(f) => Err(Stays::Measured {
                error: format!("{:.4}", params.metric.of(f)),
            }),
            None => Err(Stays::NotMeasured),
        };
    }
    judged
}

/// A value that might be carried as an approximation.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// Names it among the values of its fragment stage, stably: the hash of what computes it, and the chain of calls.
    pub id: String,
    /// The author's name for it, or what it is.
    pub name: String,
    /// Static cost of computing it, all it rests on included.
    pub cost: f64,
    /// Where it is in the author's source.
    pub location: Option<Location>,
}

/// Most candidates that are looked at, the dearest first.
pub const MOST_CANDIDATES: usize = 48;

/// The values of a plan's fragment stage that might be carried as approximations, the dearest first. Of `facts` the ranges count: what is affine travels under a stronger
/// promise where they show that its roundings stay small.
///
/// # Errors
/// Where nothing can be hoisted at all.
pub fn candidates(plan: &Plan, facts: &Facts) -> Result<Vec<Candidate>, Box<Refusal>> {
    let material = Material::examine(plan, &Params::default())?;
    let graph = Graph::build(material.program);
    let values = material.values(&graph)?;
    let precision = material.precision(facts);
    let verdicts = travel::judge(&values, Finite::Assumed, &precision).verdicts;
    let worth = |v: ValueId| {
        let width = choose::shape(&values, v).map_or(1, |(_, w)| w);
        let (cost, _) = choose::below(&values, std::iter::once(v));
        (cost > choose::SMOOTH_PRICE * f64::from(width)).then_some(cost)
    };
    let users = values.users();
    let mut found: Vec<(ValueId, f64)> = (0..values.values.len())
        .filter(|v| matches!(&verdicts[*v], Ok(c) if c.class == Class::Smooth))
        .filter_map(|v| Some((v, worth(v)?)))
        .collect();
    let costs: BTreeMap<ValueId, f64> = found.iter().copied().collect();
    // Of the names of one value the last: a call's result rather than what the callee returns.
    found.retain(|(v, cost)| {
        let width = |v| choose::shape(&values, v).map(|(_, w)| w);
        !users[*v]
            .iter()
            .any(|u| costs.get(u) == Some(cost) && width(*u) == width(*v))
    });
    found.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    found.truncate(MOST_CANDIDATES);
    let chosen: BTreeSet<ValueId> = found.iter().map(|(v, _)| *v).collect();
    let ids = ids(&values, |v| chosen.contains(&v));
    let sources = material.program.sources();
    Ok(found
        .into_iter()
        .filter_map(|(v, cost)| {
            let location = span(&values, v).and_then(|s| sources.locate(s));
            let text = || location.as_ref().and_then(|l| snippet(sources, l));
            Some(Candidate {
                id: ids.get(&v)?.clone(),
                name: name(&values, v).or_else(text).unwrap_or_default(),
                cost,
                location,
            })
        })
        .collect())
}

/// Longest piece of source that names a value, in characters.
const LONGEST_NAME: usize = 32;

/// The author's text for an expression, on one line, its end left out where it is long.
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

/// How values may travel where everything is finite, and the value of that id among those that may as approximations.
pub(super) fn only(
    values: &Values<'_, '_>,
    id: &str,
) -> (Vec<Result<Carriage, Stays>>, Option<ValueId>) {
    let verdicts = travel::judge(values, Finite::Assumed, &Precision::EXACT).verdicts;
    let is_smooth = |v: ValueId| matches!(&verdicts[v], Ok(c) if c.class == Class::Smooth);
    let ids = ids(values, is_smooth);
    let value = ids.into_iter().find(|(_, own)| own == id).map(|(v, _)| v);
    (verdicts, value)
}

/// Stable names of the values of which `of` holds.
fn ids(values: &Values<'_, '_>, of: impl Fn(ValueId) -> bool) -> BTreeMap<ValueId, String> {
    let graph = values.graph;
    let mut hashes: BTreeMap<(FunctionId, naga::Handle<naga::Expression>), String> =
        BTreeMap::new();
    (0..values.values.len())
        .filter(|v| of(*v))
        .filter_map(|v| {
            let (context, expression, _) = values.expression(v)?;
            let function = values.contexts[context].function;
            let hash = hashes.entry((function, expression)).or_insert_with(|| {
                let value = Criterion::Value {
                    function,
                    expression,
                };
                slice::backward(graph, values.entry, &[value]).hash
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
