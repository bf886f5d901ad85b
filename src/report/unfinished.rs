//! What a run has measured before its end: kept while it goes on, so that one that is killed leaves what it has, and what is missing.

use serde::{Deserialize, Serialize};

use super::Report;

/// Version of the JSON that [`Unfinished`] serialises to.
pub const SCHEMA: &str = "preshade.unfinished.v1";

/// Name of the file that it is kept in. It is taken away once the report is written.
pub const FILE: &str = "report.unfinished.json";

/// A report of what is measured so far.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Unfinished {
    /// Always [`SCHEMA`].
    pub schema: String,
    /// The views, or the variants, that are not measured yet.
    pub missing: Vec<String>,
    /// What is measured. A variant whose views are not all drawn is not measured, or broken already.
    pub report: Report,
}

impl Unfinished {
    /// What is in `report`, and what is not.
    pub fn new(report: Report, missing: Vec<String>) -> Self {
        Self {
            schema: SCHEMA.to_owned(),
            missing,
            report,
        }
    }
}
