//! The choice for a fleet: one variant for all adapters, and the frontier of error and time over
//! them.

use std::collections::BTreeSet;

use preshade_plan::budget::{Budget, Metric};
use preshade_plan::contract::Contract;
use serde::Serialize;

use super::answers::{Standing, Subject, Variants, geometric_mean};
use super::{AdapterResult, Results};
use crate::measure::Estimate;

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FleetDecisions {
    pub schema: &'static str,
    pub decisions: Vec<FleetDecision>,
}

impl FleetDecisions {
    pub fn new(decisions: Vec<FleetDecision>) -> Self {
        Self {
            schema: "preshade.fleet-decision.v1",
            decisions,
        }
    }
}

/// Which variant of an input to draw with on all adapters, and on each.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FleetDecision {
    /// The scene, frame folder or shader files.
    pub input: Vec<String>,
    /// The flags that it was measured with.
    pub arguments: Vec<String>,
    /// Names of the adapters that timed something: a variant pays on so many of them.
    pub adapters: Vec<String>,
    /// The variant. `None`: the original.
    pub choice: Option<String>,
    /// The best choice for each of `adapters` alone.
    pub by_adapter: Vec<OfAdapter>,
    /// Each variant, the best first. Those that cannot be chosen are last.
    pub variants: Vec<FleetVariant>,
}

/// The best choice for one adapter.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OfAdapter {
    pub adapter: String,
    /// The variant. `None`: the original.
    pub choice: Option<String>,
    pub speedup: Option<f64>,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FleetVariant {
    /// Written as after `--variant`.
    pub variant: String,
    /// `None`: nothing drew it.
    pub contract: Option<Contract>,
    /// Adapters that found that it holds.
    pub holds: usize,
    /// Adapters that found whether it holds.
    pub drawn: usize,
    /// Adapters of [`FleetDecision::adapters`] on which it pays.
    pub pays: usize,
    /// Geometric mean of its median speedups. An adapter without a time counts as 1: it draws the original.
    pub speedup: f64,
    /// Each adapter with a result.
    pub adapters: Vec<OnAdapter>,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OnAdapter {
    pub adapter: String,
    pub standing: Standing,
    /// The reason if it does not.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub why: String,
    pub pays: bool,
    /// Whether every run finds it slower, beyond the interval.
    pub slower: bool,
    /// Its median speedup; of several runs the geometric mean.
    pub speedup: Option<f64>,
    /// One of each run.
    pub runs: Vec<Estimate>,
    /// Why runs have no time.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub not_timed: Vec<String>,
}

impl FleetVariant {
    /// Whether some adapter found its contract broken.
    pub fn is_broken(&self) -> bool {
        self.drawn > self.holds
    }

    /// Whether it may be chosen.
    pub fn may_be_chosen(&self) -> bool {
        self.holds > 0 && !self.is_broken()
    }
}

/// No job has a time.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no job has a time{}", .why.as_ref().map_or(String::new(), |w| format!(": {w}")))]
pub struct NoTimes {
    /// The reason of a timing job. `None`: there is none.
    pub why: Option<String>,
}

/// The adapters that timed something, by [`super::adapter_id`].
fn timed<'a>(row: &Variants<'a>) -> Result<BTreeSet<&'a str>, NoTimes> {
    let all = || row.values().flatten();
    let timed: BTreeSet<&str> = all()
        .filter(|(_, said)| said.speedup().is_some())
        .map(|(id, _)| *id)
        .collect();
    match timed.is_empty() {
        false => Ok(timed),
        true => Err(NoTimes {
            why: all()
                .find_map(|(_, said)| Some((*said.times.first()?.as_ref().err()?).to_owned())),
        }),
    }
}

/// Chooses the variant that holds on every adapter that drew it and pays on most. One that pays on half of the
/// adapters or fewer is not chosen.
///
/// # Errors
/// Nothing was timed.
pub fn decide(
    results: &Results,
    subject: &Subject<'_>,
    row: &Variants<'_>,
) -> Result<FleetDecision, NoTimes> {
    let timed = timed(row)?;
    let names = results.names();
    let name = |id: &str| names.get(id).cloned().unwrap_or_else(|| id.to_owned());
    let mut variants: Vec<FleetVariant> = Vec::new();
    for (variant, said) in row {
        let standing = |wanted| {
            let of = said.values().filter(|s| s.standing().0 == wanted);
            of.count()
        };
        let holds = standing(Standing::Holds);
        let mut adapters: Vec<OnAdapter> =
            said.iter().map(|(id, s)| on_adapter(name(id), s)).collect();
        adapters.sort_by(|a, b| a.adapter.cmp(&b.adapter));
        variants.push(FleetVariant {
            variant: (*variant).to_owned(),
            contract: said
                .values()
                .find_map(AdapterResult::report)
                .map(|r| r.contract.clone()),
            holds,
            drawn: holds + standing(Standing::Broken),
            pays: said.values().filter(|s| s.pays()).count(),
            speedup: over(&timed, |id| said.get(id)),
            adapters,
        });
    }
    variants.sort_by(|a, b| {
        (b.may_be_chosen().cmp(&a.may_be_chosen()))
            .then(b.pays.cmp(&a.pays))
            .then(b.speedup.total_cmp(&a.speedup))
    });
    let best = variants.first();
    let best = best.filter(|v| v.may_be_chosen() && v.pays * 2 > timed.len());
    let by_adapter = timed.iter().map(|id| {
        let may = variants.iter().filter(|v| v.may_be_chosen());
        let paying = may.filter_map(|v| {
            let said = row.get(v.variant.as_str())?.get(id)?;
            Some((v, said.speedup().filter(|_| said.pays())?))
        });
        let best = paying.max_by(|a, b| a.1.total_cmp(&b.1));
        OfAdapter {
            adapter: name(id),
            choice: best.map(|(v, _)| v.variant.clone()),
            speedup: best.map(|(_, speedup)| speedup),
        }
    });
    let mut by_adapter: Vec<OfAdapter> = by_adapter.collect();
    by_adapter.sort_by(|a, b| a.adapter.cmp(&b.adapter));
    Ok(FleetDecision {
        input: subject.input.to_vec(),
        arguments: arguments(subject),
        adapters: by_adapter.iter().map(|a| a.adapter.clone()).collect(),
        choice: best.map(|v| v.variant.clone()),
        by_adapter,
        variants,
    })
}

fn arguments(subject: &Subject<'_>) -> Vec<String> {
    subject.arguments.iter().map(|a| (*a).to_owned()).collect()
}

/// Geometric mean of the speedups over adapters. One without a time counts as 1.
fn over<'s, 'a: 's>(
    adapters: &BTreeSet<&str>,
    said: impl Fn(&str) -> Option<&'s AdapterResult<'a>>,
) -> f64 {
    let speedup = |id: &&str| said(id).and_then(AdapterResult::speedup).unwrap_or(1.0);
    geometric_mean(adapters.iter().map(speedup)).unwrap_or(1.0)
}

fn on_adapter(adapter: String, said: &AdapterResult<'_>) -> OnAdapter {
    let (standing, why) = said.standing();
    OnAdapter {
        adapter,
        standing,
        why: why.to_owned(),
        pays: said.pays(),
        slower: said.is_slower(),
        speedup: said.speedup(),
        runs: said.times.iter().filter_map(|t| t.ok()).collect(),
        not_timed: said
            .times
            .iter()
            .filter_map(|t| Some(t.err()?.to_owned()))
            .collect(),
    }
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FleetFrontiers {
    pub schema: &'static str,
    pub frontiers: Vec<FleetFrontier>,
}

impl FleetFrontiers {
    pub fn new(frontiers: Vec<FleetFrontier>) -> Self {
        Self {
            schema: "preshade.fleet-frontier.v1",
            frontiers,
        }
    }
}

/// The trade between error and time over all adapters.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FleetFrontier {
    /// The scene, frame folder or shader files.
    pub input: Vec<String>,
    /// The flags that it was measured with.
    pub arguments: Vec<String>,
    /// Names of the adapters that timed something.
    pub adapters: Vec<String>,
    pub metric: Metric,
    /// Each variant, the least error first.
    pub points: Vec<FleetPoint>,
}

impl FleetFrontier {
    /// Whether a variant broke its contract.
    pub fn is_broken(&self) -> bool {
        let is_broken = |p: &FleetPoint| matches!(p.fate, FleetFate::Broken { .. });
        self.points.iter().any(is_broken)
    }
}

/// A variant on the plane of error and time.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FleetPoint {
    /// Written as after `--variant`.
    pub variant: String,
    /// The worst of all adapters. `None`: nothing was compared.
    pub error: Option<f64>,
    /// As [`FleetVariant::speedup`]. `None`: nothing was timed.
    pub speedup: Option<f64>,
    /// The smallest and the largest of the adapters' median speedups.
    pub range: Option<[f64; 2]>,
    pub timed: usize,
    pub fate: FleetFate,
}

/// The place of a variant relative to the frontier.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum FleetFate {
    /// No other has as little error and is as fast.
    Frontier,
    /// Another is as good in both and better in one.
    Beaten {
        /// The better variant.
        by: String,
    },
    /// Its error is over the limit.
    BeyondBudget,
    Broken {
        adapter: String,
        r#where: String,
    },
    /// No adapter compared it, or none timed it.
    NotMeasured,
}

/// The name of the original in a frontier.
const ORIGINAL: &str = crate::measure::record::ORIGINAL;

/// The variants that no other beats in both error and speedup.
///
/// # Errors
/// Nothing was timed.
pub fn frontier(
    results: &Results,
    subject: &Subject<'_>,
    row: &Variants<'_>,
    budget: Option<Budget>,
) -> Result<FleetFrontier, NoTimes> {
    let timed = timed(row)?;
    let names = results.names();
    let name = |id: &str| names.get(id).cloned().unwrap_or_else(|| id.to_owned());
    let metric = budget.map_or_else(Metric::default, |b| b.metric);
    let mut points = vec![FleetPoint {
        variant: ORIGINAL.to_owned(),
        error: Some(0.0),
        speedup: Some(1.0),
        range: Some([1.0, 1.0]),
        timed: timed.len(),
        fate: FleetFate::Frontier,
    }];
    for (variant, said) in row {
        let reports = said.values().filter_map(AdapterResult::report);
        let errors = reports.filter_map(|r| Some(metric.of(r.error.as_ref()?)));
        let error = errors.max_by(f64::total_cmp);
        let speedups: Vec<f64> = said.values().filter_map(AdapterResult::speedup).collect();
        let least = speedups.iter().copied().min_by(f64::total_cmp);
        let most = speedups.iter().copied().max_by(f64::total_cmp);
        let range = least.zip(most).map(|(least, most)| [least, most]);
        let broken = said.iter().find_map(|(id, said)| match said.standing() {
            (Standing::Broken, r#where) => Some(FleetFate::Broken {
                adapter: name(id),
                r#where: r#where.to_owned(),
            }),
            _ => None,
        });
        points.push(FleetPoint {
            variant: (*variant).to_owned(),
            error,
            speedup: range.map(|_| over(&timed, |id| said.get(id))),
            range,
            timed: speedups.len(),
            fate: match (broken, error, range) {
                (Some(broken), ..) => broken,
                (_, Some(error), Some(_)) if budget.is_some_and(|b| error > b.limit) => {
                    FleetFate::BeyondBudget
                }
                (_, Some(_), Some(_)) => FleetFate::Frontier,
                _ => FleetFate::NotMeasured,
            },
        });
    }
    let standing = |p: &&FleetPoint| p.fate == FleetFate::Frontier;
    let in_question: Vec<FleetPoint> = points.iter().filter(standing).cloned().collect();
    for point in points.iter_mut().filter(|p| standing(&&**p)) {
        let place = |p: &FleetPoint| Some((p.error?, p.speedup?));
        let Some((error, speedup)) = place(point) else {
            continue;
        };
        let beats = |other: &&FleetPoint| {
            place(other)
                .is_some_and(|(e, s)| e <= error && s >= speedup && (e < error || s > speedup))
        };
        let best = in_question.iter().filter(beats);
        // The fastest of them is on the frontier itself.
        let best = best.max_by(|a, b| {
            let key = |p: &FleetPoint| (p.speedup.unwrap_or(0.0), -p.error.unwrap_or(0.0));
            let (a, b) = (key(a), key(b));
            a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1))
        });
        if let Some(other) = best {
            point.fate = FleetFate::Beaten {
                by: other.variant.clone(),
            };
        }
    }
    points.sort_by(|a, b| {
        let error = |p: &FleetPoint| p.error.unwrap_or(f64::INFINITY);
        let speedup = |p: &FleetPoint| p.speedup.unwrap_or(0.0);
        (error(a).total_cmp(&error(b))).then(speedup(b).total_cmp(&speedup(a)))
    });
    let mut adapters: Vec<String> = timed.iter().map(|id| name(id)).collect();
    adapters.sort();
    Ok(FleetFrontier {
        input: subject.input.to_vec(),
        arguments: arguments(subject),
        adapters,
        metric,
        points,
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::jobs::made_up::{ModelResult, results};

    const ADAPTERS: [&str; 8] = ["a", "b", "c", "d", "e", "f", "g", "h"];

    /// A variant that holds on all eight adapters, with a speedup on each.
    fn on_all(variant: &'static str, speedups: [f64; 8]) -> Vec<ModelResult> {
        let each = ADAPTERS.into_iter().zip(speedups);
        each.flat_map(|(a, s)| {
            [
                ModelResult::Picture(a, variant, true),
                ModelResult::Time(a, variant, s),
            ]
        })
        .collect()
    }

    fn decided(made: &[ModelResult]) -> Result<FleetDecision, NoTimes> {
        let results = results(made);
        let rows = results.rows();
        let (subject, row) = rows.iter().next().unwrap();
        decide(&results, subject, row)
    }

    const SIX: [f64; 8] = [1.3, 1.3, 1.3, 1.3, 1.3, 1.3, 1.0, 0.8];

    #[test]
    fn what_pays_on_most_adapters_is_chosen_and_each_adapter_has_its_own_best() {
        let mut made = on_all("prepass", SIX);
        made.extend(on_all("discard", [2.0, 2.0, 2.0, 2.0, 1.0, 1.0, 1.2, 1.0]));
        let decision = decided(&made).unwrap();
        assert_eq!(decision.choice.as_deref(), Some("prepass"));
        let best = &decision.variants[0];
        assert_eq!((best.pays, decision.adapters.len()), (6, 8));
        let h = best.adapters.iter().find(|a| a.adapter == "h").unwrap();
        assert!(h.slower && !h.pays && h.speedup == Some(0.8), "{h:?}");
        let alone: Vec<Option<&str>> = decision
            .by_adapter
            .iter()
            .map(|a| a.choice.as_deref())
            .collect();
        let [d, p] = [Some("discard"), Some("prepass")];
        assert_eq!(alone, [d, d, d, d, p, p, d, None]);
        let told = crate::report::fleet::decision(&decision);
        for line in [
            "  draw with prepass: pays on 6 of 8, 1.18x on average",
            "  promise: the same bits; holds on 8 of 8",
            "  does not pay on g: 1.00x [1.00, 1.00]",
            "  does not pay on h: 0.80x [0.80, 0.80], slower",
            "    discard: pays on 5 of 8, 1.45x on average",
            "    as it is written: h",
        ] {
            assert!(told.lines().any(|l| l == line), "{line}:\n{told}");
        }
    }

    #[test]
    fn of_as_many_the_faster_is_chosen() {
        let mut made = on_all("prepass", SIX);
        made.extend(on_all("discard", SIX.map(|s| s * 1.05)));
        let decision = decided(&made).unwrap();
        assert_eq!(decision.choice.as_deref(), Some("discard"));
        // A variant that pays on half of the adapters is not chosen.
        let half = on_all("prepass", [2.0, 2.0, 2.0, 2.0, 1.0, 1.0, 1.0, 1.0]);
        let decision = decided(&half).unwrap();
        assert_eq!(decision.choice, None);
        let told = crate::report::fleet::decision(&decision);
        assert!(told.contains("Nothing pays on more than half of 8 adapters"));
    }

    #[test]
    fn what_is_broken_anywhere_is_chosen_nowhere_and_named() {
        let mut made = on_all("prepass", [2.0; 8]);
        made.extend(on_all("discard", SIX));
        // By its timing job: the picture job came through.
        made.push(ModelResult::Broken("h", "prepass"));
        let decision = decided(&made).unwrap();
        assert_eq!(decision.choice.as_deref(), Some("discard"));
        let of_broken = Some("prepass");
        let alone = decision.by_adapter.iter();
        assert!(alone.clone().all(|a| a.choice.as_deref() != of_broken));
        let told = crate::report::fleet::decision(&decision);
        let line = "  ! prepass broke its promise on h, and is not chosen: camera 0";
        assert!(told.lines().any(|l| l == line), "{told}");
    }

    #[test]
    fn what_was_not_timed_does_not_pay_and_without_any_time_there_is_no_decision() {
        let mut made = on_all("prepass", SIX);
        made.retain(|m| !matches!(m, ModelResult::Time("a" | "b" | "c", ..)));
        // They timed something else.
        made.extend(["a", "b", "c"].map(|a| ModelResult::Time(a, "discard", 1.0)));
        let decision = decided(&made).unwrap();
        let prepass = &decision.variants[0];
        assert_eq!((prepass.pays, decision.adapters.len()), (3, 8));
        assert_eq!(decision.choice, None);
        made.retain(|m| !matches!(m, ModelResult::Time(..)));
        assert_eq!(decided(&made), Err(NoTimes { why: None }));
        made.push(ModelResult::LostTime("a", "prepass"));
        let why = decided(&made).unwrap_err().why;
        assert_eq!(why.as_deref(), Some("the adapter was lost"));
    }

    #[test]
    fn the_frontier_takes_the_worst_error_and_the_mean_speedup() {
        let mut made = on_all("exact", [1.1; 8]);
        made.extend(on_all("slow", [1.05; 8]));
        made.extend(on_all("rough", [2.0, 2.0, 2.0, 2.0, 1.5, 1.5, 1.5, 1.5]));
        made.push(ModelResult::Error("c", "rough", 0.01));
        made.push(ModelResult::Error("d", "rough", 0.03));
        made.push(ModelResult::Broken("e", "wrong"));
        let results = results(&made);
        let rows = results.rows();
        let (subject, row) = rows.iter().next().unwrap();
        let fates = |budget| {
            let found = frontier(&results, subject, row, budget).unwrap();
            let line = |p: &FleetPoint| {
                let (error, [least, most]) = (p.error.unwrap(), p.range.unwrap());
                let fate = crate::report::fleet::fate(&p.fate);
                format!("{} {error} {least} {most} {fate}", p.variant)
            };
            let mut lines: Vec<String> = found.points.iter().map(line).collect();
            lines.sort();
            lines
        };
        let mut expected = [
            "exact 0 1.1 1.1 on the frontier",
            "original 0 1 1 beaten by exact",
            "rough 0.03 1.5 2 on the frontier",
            "slow 0 1.05 1.05 beaten by exact",
            "wrong 0 3 3 broken on e: camera 0",
        ];
        assert_eq!(fates(None), expected);
        let narrow = Budget {
            metric: Metric::FlipMean,
            limit: 0.02,
        };
        expected[2] = "rough 0.03 1.5 2 beyond the budget";
        assert_eq!(fates(Some(narrow)), expected);
    }
}
