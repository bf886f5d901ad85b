//! Measurements as jobs that any scheduler can run, and the union of their results.
//!
//! A [`Job`] is one variant of one input: pictures, or times. An [`Outcome`] is the result of one
//! job on one adapter, in a file of its own. [`Results::merge`] is their union: it does not depend
//! on how the jobs were shared out, on the order, or on how often a job ran.

mod answers;
pub mod decision;
pub mod files;
mod machine;
#[cfg(test)]
pub(crate) mod made_up;
mod merge;
mod partition;
mod regrets;

pub use answers::{AdapterResult, Rows, Standing, Subject, Variants};
pub use machine::{FleetAdapter, MACHINE_SCHEMA, Machine, MachineCard, fleet};
pub use merge::{Answer, Measured, MergeError, Merged, Results, SCHEMA};
pub use partition::Partition;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::measure::record::Report;
use crate::search::plan::Exhausted;
use crate::search::plan::model::Observation;
use preshade_draw::render::AdapterReport;

/// The version of preshade, part of each key.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// Compares pictures. Jobs of this kind may share an adapter.
    Picture,
    /// Times frames. Such a job needs the adapter for itself.
    Time,
}

/// One line of a list of jobs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Job {
    pub schema: String,
    /// Identity: [`key`] of everything else but `adapter` and `seconds`, and of the emitted shaders.
    pub key: String,
    pub kind: Kind,
    /// The scene, frame folder or shader files, as given.
    pub input: Vec<String>,
    /// The variant, as after `--variant`, or [`EVERY`].
    pub variant: String,
    /// Further arguments of `preshade verify`, or of `preshade plan --exhaustive`: every value that is not a default.
    pub arguments: Vec<String>,
    /// Part of the name, driver or backend of the adapters that may run it. `None`: any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub adapter: Option<String>,
    /// [`hash`] of each file that it reads, by path.
    pub files: BTreeMap<String, String>,
    /// Estimated seconds on a fast GPU. Software adapters take longer.
    #[serde(default, skip_serializing_if = "is_unknown")]
    pub seconds: f64,
}

fn is_unknown(seconds: &f64) -> bool {
    *seconds == 0.0
}

pub const JOB_SCHEMA: &str = "preshade.job.v1";

pub const OUTCOME_SCHEMA: &str = "preshade.outcome.v1";

/// The result of one job on one adapter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    pub schema: String,
    /// The version of preshade that measured it.
    pub version: String,
    /// The job, without the fields that differ between lists: its filter and its estimate.
    pub job: Job,
    pub adapter: AdapterReport,
    /// When it ran, and with which load. `None`: a picture, which depends on neither.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub run: Option<Run>,
    pub result: JobResult,
}

/// Circumstances of a timing job.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// Name of the run. Further runs add samples.
    pub id: String,
    pub host: String,
    /// The machine's start that `alone` counts from, or empty: since 1970.
    pub boot: String,
    /// Which of the machine's adapters of that name.
    pub card: String,
    /// Milliseconds since 1970 when it began.
    pub start_ms: u64,
    /// Milliseconds since 1970 when it ended.
    pub end_ms: u64,
    /// When it had the adapter for itself: starts and ends in milliseconds.
    pub alone: Vec<[u64; 2]>,
    /// Processes that were waiting for a core at the start and the end, on average over a minute.
    /// `None`: not known on this system.
    pub load: Option<[f64; 2]>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum JobResult {
    /// The job was measured. A report of a broken promise counts, too.
    Measured {
        #[serde(flatten)]
        found: Found,
    },
    Failed {
        /// The class of the reason.
        reason: Reason,
        why: String,
        attempts: u32,
    },
}

/// The measurements of a job.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Found {
    /// The report of `verify` on one variant, with an empty `command`, and for pictures without any time.
    Report(Box<Report>),
    /// The measurements of [`EVERY`] candidate.
    Exhausted(Box<Exhaustive>),
}

impl Found {
    /// The report on one variant.
    pub fn report(&self) -> Option<&Report> {
        match self {
            Self::Report(report) => Some(report),
            Self::Exhausted(_) => None,
        }
    }

    /// Whether a variant broke its contract.
    pub fn is_broken(&self) -> bool {
        self.report().is_some_and(Report::is_broken)
    }
}

/// Every candidate of `plan`, timed in every view of a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Exhaustive {
    /// [`adapter_id`] of the adapter.
    pub adapter: String,
    /// Frames that the adapter's cost model is fitted to.
    pub probes: Vec<Observation>,
    pub scene: Exhausted,
}

/// [`Job::variant`] of a job that measures every candidate of `plan`.
pub const EVERY: &str = "every candidate";

/// Why a job has no report.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Reason {
    Refused,
    /// The process ended without a report.
    Crashed,
    DeviceLost,
    /// The process ran out of memory, or over its limit.
    OutOfMemory,
    /// The process ran over its time.
    TimedOut,
}

impl Reason {
    /// The class of a failure from its message.
    pub fn of(why: &str) -> Self {
        let lower = why.to_lowercase();
        let has = |words: &[&str]| words.iter().any(|word| lower.contains(word));
        match () {
            () if has(&["of memory (--limits", "out of memory"]) => Self::OutOfMemory,
            () if has(&["(--limits seconds", "(--seconds"]) => Self::TimedOut,
            () if has(&[
                "adapter was lost",
                "device was lost",
                "device is lost",
                "device lost",
                "adapter cannot be shared",
            ]) =>
            {
                Self::DeviceLost
            }
            () if has(&["process ended with signal", "panicked"]) => Self::Crashed,
            () => Self::Refused,
        }
    }
}

impl Job {
    /// The job as in an [`Outcome`].
    #[must_use]
    pub fn in_any_list(&self) -> Self {
        Self {
            adapter: None,
            seconds: 0.0,
            ..self.clone()
        }
    }

    /// Input and variant, for messages.
    pub fn name(&self) -> String {
        format!("{} with {}", self.input.join(" "), self.variant)
    }
}

impl Outcome {
    /// Whether a further attempt can change anything: it has no report, and was tried fewer than
    /// `attempts` times.
    pub fn is_open(&self, attempts: u32) -> bool {
        match &self.result {
            JobResult::Measured { .. } => false,
            JobResult::Failed {
                attempts: tried, ..
            } => *tried < attempts,
        }
    }
}

/// Hash of bytes, as in keys and [`Job::files`]: 32 hexadecimal digits of BLAKE3.
pub fn hash(bytes: &[u8]) -> String {
    let mut hash = blake3::hash(bytes).to_hex().to_string();
    hash.truncate(32);
    hash
}

/// The key of parts, which end where they end: moving text from one to the next changes the key.
pub fn key<'a>(parts: impl IntoIterator<Item = &'a str>) -> String {
    let mut hasher = blake3::Hasher::new();
    for part in parts {
        hasher.update(&(part.len() as u64).to_le_bytes());
        hasher.update(part.as_bytes());
    }
    let mut key = hasher.finalize().to_hex().to_string();
    key.truncate(32);
    key
}

/// Short name of an adapter with its driver, for file names.
pub fn adapter_id(adapter: &AdapterReport) -> String {
    let mut id = key([
        adapter.name.as_str(),
        adapter.driver.as_str(),
        adapter.backend.as_str(),
    ]);
    id.truncate(8);
    id
}
