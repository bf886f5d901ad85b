//! Results for tests.
#![allow(clippy::unwrap_used)]

use std::collections::BTreeMap;

use serde_json::json;

use super::{
    Found, JOB_SCHEMA, Job, JobResult, Kind, OUTCOME_SCHEMA, Outcome, Reason, Results, Run, key,
};
use preshade_draw::render::AdapterReport;

/// A made-up result of an adapter for a variant.
#[derive(Clone, Copy, Debug)]
pub(crate) enum ModelResult {
    /// Pictures; the flag: the contract holds.
    Picture(&'static str, &'static str, bool),
    /// Pictures that hold, with a mean FLIP.
    Error(&'static str, &'static str, f64),
    Time(&'static str, &'static str, f64),
    /// A further run of a timing job, which is three times as fast and breaks the contract.
    Broken(&'static str, &'static str),
    /// No picture: the adapter was lost.
    Lost(&'static str, &'static str),
    /// No time: the adapter was lost.
    LostTime(&'static str, &'static str),
}

pub(crate) fn adapter(name: &str) -> AdapterReport {
    serde_json::from_value(json!({
        "name": name, "driver": "1", "backend": "vulkan", "kind": "discrete", "timestamps": true,
        "pipeline_statistics": true, "features": [],
    }))
    .unwrap()
}

/// The merge of all. Of several [`ModelResult::Picture`] and [`ModelResult::Error`] of one job the last counts.
pub(crate) fn results(made: &[ModelResult]) -> Results {
    let all: BTreeMap<_, _> = made.iter().map(|m| outcome(*m)).collect();
    Results::merge(all.into_values(), false).unwrap()
}

fn outcome(made: ModelResult) -> ((String, String, String), Outcome) {
    let (name, variant, kind, run) = match made {
        ModelResult::Picture(a, v, _) | ModelResult::Error(a, v, _) | ModelResult::Lost(a, v) => {
            (a, v, Kind::Picture, "")
        }
        ModelResult::Time(a, v, _) | ModelResult::LostTime(a, v) => (a, v, Kind::Time, "1"),
        ModelResult::Broken(a, v) => (a, v, Kind::Time, "2"),
    };
    let (holds, flip, speedup) = match made {
        ModelResult::Picture(_, _, holds) => (holds, 0.0, None),
        ModelResult::Error(_, _, flip) => (true, flip, None),
        ModelResult::Time(_, _, speedup) => (true, 0.0, Some(speedup)),
        ModelResult::Broken(..) => (false, 0.0, Some(3.0)),
        ModelResult::Lost(..) | ModelResult::LostTime(..) => (false, 0.0, None),
    };
    let failed = JobResult::Failed {
        reason: Reason::DeviceLost,
        why: "the adapter was lost".to_owned(),
        attempts: 1,
    };
    let outcome = Outcome {
        schema: OUTCOME_SCHEMA.to_owned(),
        version: "1".to_owned(),
        job: Job {
            schema: JOB_SCHEMA.to_owned(),
            key: key([variant, if run.is_empty() { "picture" } else { "time" }]),
            kind,
            input: vec!["a.toml".to_owned()],
            variant: variant.to_owned(),
            arguments: Vec::new(),
            adapter: None,
            files: BTreeMap::new(),
            seconds: 0.0,
        },
        adapter: adapter(name),
        run: (kind == Kind::Time).then(|| Run {
            id: run.to_owned(),
            host: format!("host of {name}"),
            boot: String::new(),
            card: "0".to_owned(),
            start_ms: 0,
            end_ms: 0,
            alone: Vec::new(),
            load: None,
        }),
        result: match made {
            ModelResult::Lost(..) | ModelResult::LostTime(..) => failed,
            _ => measured(name, variant, (holds, flip, speedup)),
        },
    };
    let id = (name.to_owned(), outcome.job.key.clone(), run.to_owned());
    (id, outcome)
}

fn measured(
    name: &str,
    variant: &str,
    (holds, flip, speedup): (bool, f64, Option<f64>),
) -> JobResult {
    let verdict = match holds {
        true => json!({ "kind": "holds" }),
        false => json!({ "kind": "broken", "where": "camera 0" }),
    };
    let error = json!({
        "changed_pixels": 0, "changed_alpha": 0, "changed_depth": 0, "max_abs": flip, "flip_mean": flip,
        "flip_p99": flip, "flip_tile": flip, "nan_pixels": 0, "depth_max_ulp": 0,
    });
    let of = |name: &str, verdict: serde_json::Value, speedup: Option<f64>| {
        json!({
            "name": name, "recipe": name, "contract": { "kind": "exact", "given": [] }, "verdict": verdict,
            "error": error, "time_ms": null,
            "speedup": speedup.map(|s| json!({ "median": s, "low": s, "high": s })),
            "shaded_per_pixel": null, "cost": null, "shadow": null, "self_test": [], "kept": [],
            "by_path": [], "by_view": [],
        })
    };
    let variants = [
        of("original", json!({ "kind": "holds" }), None),
        of(variant, verdict, speedup),
    ];
    let report = json!({
        "schema": "", "scene": "a", "resolution": [1, 1], "samples": 1, "command": "",
        "adapter": serde_json::to_value(adapter(name)).unwrap(), "clock": null, "depth_ties": null,
        "assumed": [], "variants": variants,
    });
    JobResult::Measured {
        found: Found::Report(serde_json::from_value(report).unwrap()),
    }
}
