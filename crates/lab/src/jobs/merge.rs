//! The union of outcomes.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use super::{Found, Job, JobResult, Outcome, Reason, Run, adapter_id};
use preshade_draw::render::AdapterReport;

/// Merged outcomes of one version, or of several if that was allowed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Results {
    pub schema: String,
    /// The versions of preshade that measured.
    pub versions: BTreeSet<String>,
    /// By [`adapter_id`].
    pub adapters: BTreeMap<String, AdapterReport>,
    /// By key.
    pub jobs: BTreeMap<String, Merged>,
}

/// All outcomes of one job.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Merged {
    /// The version of preshade that measured it.
    pub version: String,
    pub job: Job,
    /// By [`adapter_id`].
    pub answers: BTreeMap<String, Answer>,
}

/// The result of one adapter for a job.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Answer {
    /// Reports. A picture has one, with an empty name of the run. Times have one of each run.
    Measured {
        /// By the run's id, machine and start.
        runs: BTreeMap<String, Measured>,
    },
    /// No run has a report.
    Failed {
        /// The class of the reason.
        reason: Reason,
        why: String,
    },
}

impl Answer {
    /// Whether both failed, and the other comes first.
    fn is_after(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Failed { reason: a, why: b }, Self::Failed { reason: c, why: d }) => {
                (a, b) > (c, d)
            }
            _ => false,
        }
    }
}

/// The measurements of one run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// Its circumstances. `None`: a picture.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub run: Option<Run>,
    #[serde(flatten)]
    pub found: Found,
}

/// Why outcomes cannot be merged. Each names both sides, in an order that does not depend on that of the
/// outcomes.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MergeError {
    /// One job, one adapter, one driver, two pictures: the driver or preshade is not deterministic.
    #[error("the results of {job} on {adapter} differ:\n  {}\n  {}", .both[0], .both[1])]
    Differ {
        /// Input and variant.
        job: String,
        /// Name and driver.
        adapter: String,
        /// The verdicts and errors of both.
        both: Box<[String; 2]>,
    },
    /// Two timing jobs ran on one adapter at the same time.
    #[error(
        "two timing jobs shared {adapter} of {host}: {} and {}", .both[0], .both[1]
    )]
    Overlap {
        adapter: String,
        host: String,
        /// Input and variant of both.
        both: Box<[String; 2]>,
    },
    /// Several versions of preshade measured.
    #[error("the results are of several versions: {}", .0.iter().cloned().collect::<Vec<_>>().join(", "))]
    Versions(BTreeSet<String>),
}

/// When a job had an adapter for itself.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct Slot {
    /// The start of a machine, and the card.
    place: (String, String),
    /// Start and end in milliseconds.
    time: [u64; 2],
    /// Input, variant and run.
    job: String,
    /// Jobs of one name may differ elsewhere.
    key: String,
    host: String,
    /// Name and driver.
    adapter: String,
}

impl Slot {
    fn of(outcome: &Outcome) -> Vec<Self> {
        let Some(run) = &outcome.run else {
            return Vec::new();
        };
        let machine = match run.boot.is_empty() {
            true => run.host.clone(),
            false => run.boot.clone(),
        };
        let slot = |time: &[u64; 2]| Self {
            place: (machine.clone(), run.card.clone()),
            time: *time,
            job: format!("{} (run {})", outcome.job.name(), run.id),
            key: outcome.job.key.clone(),
            host: run.host.clone(),
            adapter: title(&outcome.adapter),
        };
        run.alone.iter().map(slot).collect()
    }
}

pub const SCHEMA: &str = "preshade.results.v1";

impl Results {
    /// The union of outcomes: the same for any order, and however often one is given. A report wins over a
    /// failure.
    ///
    /// # Errors
    /// The first of [`MergeError`] by its text, so that the message too does not depend on the order.
    pub fn merge(
        outcomes: impl IntoIterator<Item = Outcome>,
        may_mix_versions: bool,
    ) -> Result<Self, MergeError> {
        let mut results = Self {
            schema: SCHEMA.to_owned(),
            versions: BTreeSet::new(),
            adapters: BTreeMap::new(),
            jobs: BTreeMap::new(),
        };
        let mut errors: Vec<MergeError> = Vec::new();
        let mut slots = BTreeSet::new();
        for outcome in outcomes {
            slots.extend(Slot::of(&outcome));
            errors.extend(results.add(outcome));
        }
        errors.extend(Self::overlaps(&slots));
        if results.versions.len() > 1 && !may_mix_versions {
            errors.push(MergeError::Versions(results.versions.clone()));
        }
        match errors.into_iter().min_by_key(ToString::to_string) {
            None => Ok(results),
            Some(error) => Err(error),
        }
    }

    /// Adds one outcome. Returns a contradiction to an earlier one.
    fn add(&mut self, outcome: Outcome) -> Option<MergeError> {
        let id = adapter_id(&outcome.adapter);
        let adapter = title(&outcome.adapter);
        self.versions.insert(outcome.version.clone());
        let known = self.adapters.entry(id.clone());
        let known = known.or_insert_with(|| outcome.adapter.clone());
        // Its features may differ, with the layers of the machine.
        if outcome.adapter.features < known.features {
            *known = outcome.adapter;
        }
        let job = self.jobs.entry(outcome.job.key.clone());
        let job = job.or_insert_with(|| Merged {
            version: outcome.version,
            job: outcome.job.in_any_list(),
            answers: BTreeMap::new(),
        });
        let answer = job.answers.entry(id);
        match outcome.result {
            JobResult::Measured { mut found } => {
                // As above.
                if let Found::Report(report) = &mut found {
                    report.adapter.features.clear();
                }
                let run = outcome.run;
                let named = |r: &Run| format!("{} on {} at {}", r.id, r.host, r.start_ms);
                let name = run.as_ref().map_or(String::new(), named);
                let measured = Measured { run, found };
                let first = Answer::Measured {
                    runs: BTreeMap::from([(name.clone(), measured.clone())]),
                };
                let answer = match answer {
                    Entry::Vacant(place) => {
                        place.insert(first);
                        return None;
                    }
                    Entry::Occupied(place) => place.into_mut(),
                };
                let Answer::Measured { runs } = answer else {
                    *answer = first;
                    return None;
                };
                let known = runs.entry(name).or_insert_with(|| measured.clone());
                if *known == measured {
                    return None;
                }
                // Which two of several are reported does not depend on the order.
                let mut both = [known.told(), measured.told()];
                if both[1] < both[0] {
                    both.swap(0, 1);
                    *known = measured;
                }
                Some(MergeError::Differ {
                    job: job.job.name(),
                    adapter,
                    both: Box::new(both),
                })
            }
            JobResult::Failed { reason, why, .. } => {
                let failed = Answer::Failed { reason, why };
                match answer {
                    Entry::Vacant(place) => {
                        place.insert(failed);
                    }
                    // Which of two failures remains does not depend on the order.
                    Entry::Occupied(mut place) => {
                        if place.get().is_after(&failed) {
                            place.insert(failed);
                        }
                    }
                }
                None
            }
        }
    }

    /// Timing jobs, failed ones too, that had one adapter for themselves at the same time.
    fn overlaps(slots: &BTreeSet<Slot>) -> Vec<MergeError> {
        let mut errors = Vec::new();
        // The one that ends last among those before.
        let mut last: Option<&Slot> = None;
        for slot in slots {
            let before = last.filter(|last| last.place == slot.place);
            if let Some(before) = before.filter(|b| slot.time[0] < b.time[1]) {
                errors.push(MergeError::Overlap {
                    adapter: slot.adapter.clone(),
                    host: slot.host.clone(),
                    both: Box::new([before.job.clone(), slot.job.clone()]),
                });
            }
            if before.is_none_or(|b| b.time[1] < slot.time[1]) {
                last = Some(slot);
            }
        }
        errors
    }

    /// As text: the same results give the same bytes.
    pub fn to_json(&self) -> serde_json::Result<String> {
        Ok(serde_json::to_string_pretty(self)? + "\n")
    }
}

impl Measured {
    /// Verdict and error of the variant, for a message.
    fn told(&self) -> String {
        let report = self.found.report();
        let variants = report.into_iter().flat_map(|r| r.variants.iter().skip(1));
        let told = variants.map(|v| {
            let error = v.error.as_ref().map_or(String::new(), |e| {
                format!(
                    "{} pixels, {} depths, mean FLIP {}",
                    e.changed_pixels, e.changed_depth, e.flip_mean
                )
            });
            format!("{:?}: {error}", v.verdict)
        });
        let told: Vec<String> = told.collect();
        // Reports that differ elsewhere need different texts too.
        let all = serde_json::to_string(self).unwrap_or_default();
        format!("{} [{}]", told.join("; "), super::hash(all.as_bytes()))
    }
}

/// Name and driver.
fn title(adapter: &AdapterReport) -> String {
    format!("{} ({})", adapter.name, adapter.driver)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::jobs::made_up::adapter;
    use crate::jobs::{JOB_SCHEMA, Kind, OUTCOME_SCHEMA, key};

    fn report(scene: &str) -> Box<crate::measure::record::Report> {
        let adapter = serde_json::to_value(adapter("a")).unwrap();
        Box::new(
            serde_json::from_value(serde_json::json!({
                "schema": "", "scene": scene, "resolution": [1, 1], "samples": 1, "command": "",
                "adapter": adapter, "clock": null, "depth_ties": null, "assumed": [], "variants": [],
            }))
            .unwrap(),
        )
    }

    fn measured(scene: &str) -> JobResult {
        JobResult::Measured {
            found: Found::Report(report(scene)),
        }
    }

    fn failed(why: &str) -> JobResult {
        JobResult::Failed {
            reason: Reason::of(why),
            why: why.to_owned(),
            attempts: 1,
        }
    }

    fn picture(job: usize, place: &str, result: JobResult) -> Outcome {
        Outcome {
            schema: OUTCOME_SCHEMA.to_owned(),
            version: "1".to_owned(),
            job: Job {
                schema: JOB_SCHEMA.to_owned(),
                key: key([job.to_string().as_str()]),
                kind: Kind::Picture,
                input: vec![format!("{job}.toml")],
                variant: "depth-prepass".to_owned(),
                arguments: Vec::new(),
                adapter: None,
                files: BTreeMap::new(),
                seconds: 0.0,
            },
            adapter: adapter(place),
            run: None,
            result,
        }
    }

    fn timed(job: usize, id: &str, [start_ms, end_ms]: [u64; 2]) -> Outcome {
        let of = picture(job, "a", measured("s"));
        Outcome {
            job: Job {
                kind: Kind::Time,
                // Lists may estimate one job differently.
                seconds: job as f64,
                ..of.job
            },
            run: Some(Run {
                id: id.to_owned(),
                host: "here".to_owned(),
                boot: "1".to_owned(),
                card: "1".to_owned(),
                start_ms,
                end_ms,
                alone: vec![[start_ms, end_ms]],
                load: None,
            }),
            ..of
        }
    }

    proptest! {
        #[test]
        fn any_split_any_order_and_any_subset_twice_merge_to_the_same_bytes(
            jobs in 1_usize..40,
            order in prop::collection::vec(any::<prop::sample::Index>(), 0..200),
            shuffled in any::<u64>(),
        ) {
            let all: Vec<Outcome> = (0..jobs)
                .flat_map(|job| ["a", "b"].map(|place| match (job % 5, place) {
                    (0, "b") => picture(job, place, failed("the adapter was lost")),
                    (1, _) => {
                        let mut timed = timed(job, "1", [job as u64 * 10, job as u64 * 10 + 9]);
                        timed.adapter = adapter(place);
                        timed.run.as_mut().unwrap().card = place.to_owned();
                        timed
                    }
                    _ => picture(job, place, measured(&job.to_string())),
                }))
                .collect();
            let once = Results::merge(all.clone(), false).unwrap().to_json().unwrap();
            let mut again = all.clone();
            again.extend(order.iter().map(|i| i.get(&all).clone()));
            // A part that failed elsewhere first adds nothing.
            again.extend(all.iter().filter(|o| matches!(o.result, JobResult::Measured { .. })).map(|o| Outcome {
                result: failed("it was stopped after 5 s (--limits seconds=N)"),
                ..o.clone()
            }));
            again.sort_by_key(|o| key([&o.job.key, &format!("{shuffled}{:?}", o.result)[..]]));
            // Each part by itself, read back from its file.
            let mut merged = Vec::new();
            for outcome in again {
                let text = serde_json::to_string(&outcome).unwrap();
                merged.push(serde_json::from_str::<Outcome>(&text).unwrap());
            }
            prop_assert_eq!(once, Results::merge(merged, false).unwrap().to_json().unwrap());
        }
    }

    #[test]
    fn two_pictures_of_one_adapter_are_an_error_in_any_order() {
        let [a, b] = ["x", "y"].map(|scene| picture(1, "a", measured(scene)));
        let error = Results::merge([a.clone(), b.clone()], false).unwrap_err();
        assert!(matches!(error, MergeError::Differ { .. }), "{error}");
        assert_eq!(Results::merge([b, a.clone()], false).unwrap_err(), error);
        // The results of two adapters are two columns.
        let other = picture(1, "b", measured("y"));
        let results = Results::merge([a, other], false).unwrap();
        assert_eq!(results.jobs.values().next().unwrap().answers.len(), 2);
    }

    #[test]
    fn timing_jobs_that_shared_an_adapter_are_refused() {
        let apart = [timed(1, "1", [0, 10]), timed(2, "1", [10, 20])];
        Results::merge(apart, false).unwrap();
        // The long one overlaps with one that does not follow it at once.
        let shared = [
            timed(1, "1", [0, 100]),
            timed(2, "1", [100, 110]),
            timed(3, "1", [5, 6]),
        ];
        let error = Results::merge(shared, false).unwrap_err();
        assert!(error.to_string().contains("1.toml"), "{error}");
        assert!(error.to_string().contains("3.toml"), "{error}");
        let mut elsewhere = timed(3, "1", [5, 6]);
        elsewhere.run.as_mut().unwrap().boot = "2".to_owned();
        Results::merge([timed(1, "1", [0, 100]), elsewhere], false).unwrap();
        let mut other_card = timed(3, "1", [5, 6]);
        other_card.run.as_mut().unwrap().card = "2".to_owned();
        Results::merge([timed(1, "1", [0, 100]), other_card], false).unwrap();
        // A failed job disturbed the other too.
        let lost = Outcome {
            result: failed("the adapter was lost"),
            ..timed(3, "1", [5, 6])
        };
        Results::merge([timed(1, "1", [0, 100]), lost], false).unwrap_err();
    }

    #[test]
    fn versions_mix_by_flag_only() {
        let new = Outcome {
            version: "2".to_owned(),
            ..picture(2, "a", measured("s"))
        };
        let both = [picture(1, "a", measured("s")), new];
        let error = Results::merge(both.clone(), false).unwrap_err();
        assert!(matches!(error, MergeError::Versions(_)), "{error}");
        assert_eq!(Results::merge(both, true).unwrap().versions.len(), 2);
    }
}
