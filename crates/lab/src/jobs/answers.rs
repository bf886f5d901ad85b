//! The results of each adapter for each variant of each input.

use std::collections::BTreeMap;

use preshade_plan::contract::Verdict;
use serde::Serialize;

use super::{Answer, EVERY, Kind, Measured, Merged, Reason, Results};
use crate::measure::Estimate;
use crate::measure::record::VariantReport;
use crate::measure::variant::{EVERY_REFUSES, without_remedy};
use crate::search::plan::choose::WORTHWHILE;
use preshade_draw::render::AdapterReport;

/// The properties that jobs must share if their figures are compared.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Subject<'a> {
    /// The scene, frame folder or shader files.
    pub input: &'a [String],
    /// The flags, without those that request timing.
    pub arguments: Vec<&'a str>,
    /// The version of preshade that measured.
    pub version: &'a str,
    /// Hashes of the files, by path.
    pub files: &'a BTreeMap<String, String>,
}

/// For each variant, the result of each adapter, by [`super::adapter_id`].
pub type Variants<'a> = BTreeMap<&'a str, BTreeMap<&'a str, AdapterResult<'a>>>;

pub type Rows<'a> = BTreeMap<Subject<'a>, Variants<'a>>;

/// The result of one adapter for a variant.
#[derive(Clone, Debug, Default)]
pub struct AdapterResult<'a> {
    /// The report of its job on pictures, or why there is none.
    picture: Option<Drawn<'a>>,
    /// The report of a timing job, which compares pictures too. One that is broken comes first.
    timed: Option<&'a VariantReport>,
    /// Its speedups, one of each run, or the reason why a run has none.
    pub times: Vec<Result<Estimate, &'a str>>,
}

type Drawn<'a> = Result<&'a VariantReport, (Reason, &'a str)>;

/// Whether a variant keeps its contract on an adapter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Standing {
    Holds,
    Broken,
    /// The job ran, and nothing was compared.
    NotMeasured,
    DoesNotApply,
    Refused,
    /// The job has no report.
    Failed,
    NoPicture,
}

impl Standing {
    pub fn word(self) -> &'static str {
        match self {
            Self::Holds => "holds",
            Self::Broken => "BROKEN",
            Self::NotMeasured => "not measured",
            Self::DoesNotApply => "does not apply",
            Self::Refused => "refused",
            Self::Failed => "failed",
            Self::NoPicture => "no picture",
        }
    }
}

fn is_broken(variant: &VariantReport) -> bool {
    matches!(variant.verdict, Verdict::Broken { .. })
}

impl<'a> AdapterResult<'a> {
    /// The report of its pictures, or why there is none. A contract that any job breaks is broken.
    fn drawn(&self) -> Option<Drawn<'a>> {
        match (self.picture, self.timed) {
            (_, Some(timed)) if is_broken(timed) => Some(Ok(timed)),
            (Some(Ok(picture)), _) => Some(Ok(picture)),
            (_, Some(timed)) => Some(Ok(timed)),
            (failed, None) => failed,
        }
    }

    /// The report, if it has pictures.
    pub fn report(&self) -> Option<&'a VariantReport> {
        self.drawn()?.ok()
    }

    /// Whether the variant keeps its contract, and the reason if it does not.
    pub fn standing(&self) -> (Standing, &'a str) {
        match self.drawn() {
            None => (Standing::NoPicture, ""),
            Some(Err((Reason::Refused, why))) => (Standing::Refused, why),
            Some(Err((_, why))) => (Standing::Failed, why),
            Some(Ok(variant)) => match &variant.verdict {
                Verdict::Holds => (Standing::Holds, ""),
                Verdict::Broken { r#where } => (Standing::Broken, r#where),
                Verdict::NotMeasured { why } if why == EVERY_REFUSES => {
                    let first = variant.kept.first();
                    let refusal = first.map_or(why.as_str(), |kept| without_remedy(&kept.why));
                    (Standing::DoesNotApply, refusal)
                }
                Verdict::NotMeasured { why } => (Standing::NotMeasured, why),
            },
        }
    }

    /// Whether it pays: it holds, and every run finds it faster, beyond the interval, by as much as `plan` asks
    /// for.
    pub fn pays(&self) -> bool {
        self.standing().0 == Standing::Holds && self.every_run(|e| e.low > WORTHWHILE)
    }

    /// Whether every run finds it slower, beyond the interval.
    pub fn is_slower(&self) -> bool {
        self.every_run(|e| e.high < 1.0)
    }

    fn every_run(&self, is: impl Fn(Estimate) -> bool) -> bool {
        let is = |time: &Result<Estimate, &str>| time.is_ok_and(&is);
        !self.times.is_empty() && self.times.iter().all(is)
    }

    /// The median speedup; of several runs the geometric mean of their medians.
    pub fn speedup(&self) -> Option<f64> {
        let medians = self.times.iter().filter_map(|t| Some(t.ok()?.median));
        geometric_mean(medians)
    }
}

/// The geometric mean of positive numbers. `None`: there are none.
pub(crate) fn geometric_mean(of: impl Iterator<Item = f64>) -> Option<f64> {
    let of: Vec<f64> = of.collect();
    match of[..] {
        [] => None,
        // Without rounding.
        [one] => Some(one),
        _ => Some((of.iter().map(|x| x.ln()).sum::<f64>() / of.len() as f64).exp()),
    }
}

/// The variant of a report. The original is first.
fn variant(measured: &Measured) -> Option<&VariantReport> {
    measured.found.report()?.variants.get(1)
}

impl Results {
    /// The results of each adapter for each variant. Jobs of [`EVERY`] candidate are left out.
    pub fn rows(&self) -> Rows<'_> {
        let mut rows = Rows::new();
        let of_variants = self.jobs.values().filter(|m| m.job.variant != EVERY);
        for merged in of_variants {
            let row = rows.entry(Subject::of(merged)).or_default();
            let row = row.entry(merged.job.variant.as_str()).or_default();
            for (id, answer) in &merged.answers {
                let said: &mut AdapterResult<'_> = row.entry(id).or_default();
                said.add(merged.job.kind, answer);
            }
        }
        rows
    }

    /// The name of each adapter, by [`super::adapter_id`]: with driver and backend if two have one name.
    pub fn names(&self) -> BTreeMap<&str, String> {
        let name = |adapter: &AdapterReport| {
            let title = adapter.title();
            let same = self.adapters.values().filter(|a| a.title() == title);
            match same.count() {
                1 => title,
                _ => format!("{title} ({}, {})", adapter.driver, adapter.backend),
            }
        };
        let each = self.adapters.iter();
        each.map(|(id, adapter)| (id.as_str(), name(adapter)))
            .collect()
    }
}

impl<'a> AdapterResult<'a> {
    fn add(&mut self, kind: Kind, answer: &'a Answer) {
        let runs = match (answer, kind) {
            (Answer::Failed { reason, why }, Kind::Picture) => {
                self.picture = Some(Err((*reason, why)));
                return;
            }
            (Answer::Failed { why, .. }, Kind::Time) => return self.times.push(Err(why)),
            (Answer::Measured { runs }, _) => runs,
        };
        for variant in runs.values().filter_map(variant) {
            if kind == Kind::Picture {
                self.picture = Some(Ok(variant));
                continue;
            }
            let time = variant.speedup.ok_or("no time was measured");
            self.times.push(time);
            if !self.timed.is_some_and(is_broken) {
                self.timed = Some(variant);
            }
        }
    }
}

impl<'a> Subject<'a> {
    fn of(merged: &'a Merged) -> Self {
        let arguments = merged.job.arguments.iter().map(String::as_str);
        Self {
            input: &merged.job.input,
            arguments: arguments.filter(|a| !a.starts_with("--time=")).collect(),
            version: &merged.version,
            files: &merged.job.files,
        }
    }

    /// Its input, and any property in which it differs from others of that input in `rows`.
    pub fn title(&self, rows: &Rows<'_>) -> String {
        let mut title = self.input.join(" ");
        let others = || rows.keys().filter(|s| s.input == self.input);
        if others().any(|s| s.arguments != self.arguments) {
            title.push_str(&format!(" with {}", self.arguments.join(" ")));
        }
        if others().any(|s| s.version != self.version) {
            title.push_str(&format!(", version {}", self.version));
        }
        let is_other = |(path, hash): &(&String, &String)| {
            others().any(|s| s.files.get(*path).is_some_and(|h| h != *hash))
        };
        if let Some((path, hash)) = self.files.iter().find(is_other) {
            let hash = hash.get(..8).unwrap_or(hash);
            title.push_str(&format!(", {path} {hash}"));
        }
        title
    }
}
