//! The regret of choices, from merged results.

use super::{Answer, EVERY, Found, Results};
use crate::search::plan::RegretReport;
use crate::search::plan::model::Observation;
use crate::search::plan::regret::{self, Choosing};

impl Results {
    /// For each adapter that ran jobs of [`EVERY`] candidate, the regret of `choosing` among them.
    /// If a scene has several runs, the first by name counts. Scenes are ordered by their files.
    pub fn regrets(&self, choosing: Choosing, command: &str) -> Vec<RegretReport> {
        let jobs = self.jobs.values().filter(|job| job.job.variant == EVERY);
        let mut jobs: Vec<_> = jobs.collect();
        jobs.sort_by(|a, b| a.job.input.cmp(&b.job.input));
        let of = |(id, adapter)| {
            let mut probes: &[Observation] = &[];
            let (mut scenes, mut failed) = (Vec::new(), Vec::new());
            for job in &jobs {
                match job.answers.get(id) {
                    None => {}
                    Some(Answer::Failed { why, .. }) => {
                        failed.push((job.job.input.join(" "), why.clone()));
                    }
                    Some(Answer::Measured { runs }) => {
                        let first = runs.values().next().map(|measured| &measured.found);
                        if let Some(Found::Exhausted(found)) = first {
                            scenes.push(found.scene.clone());
                            probes = &found.probes;
                        }
                    }
                }
            }
            let is_there = !scenes.is_empty() || !failed.is_empty();
            is_there.then(|| RegretReport {
                failed,
                ..regret::evaluate(adapter, probes, &scenes, choosing, command)
            })
        };
        self.adapters.iter().filter_map(of).collect()
    }
}
