//! A report that is written while a run goes on. If the run is killed, it has the results so far
//! and the list of missing views.

use serde::{Deserialize, Serialize};

use super::Report;

/// Version of the JSON that [`Unfinished`] serialises to.
pub(crate) const SCHEMA: &str = "preshade.unfinished.v1";

/// Name of its file, which is removed once the report is written.
pub const FILE: &str = "report.unfinished.json";

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Unfinished {
    pub schema: String,
    /// The views, or the variants, that are not measured yet.
    pub missing: Vec<String>,
    /// The results so far. Variants with missing views are not measured, or already broken.
    pub report: Report,
}

impl Unfinished {
    /// A report with its missing views.
    pub fn new(report: Report, missing: Vec<String>) -> Self {
        Self {
            schema: SCHEMA.to_owned(),
            missing,
            report,
        }
    }
}
