//! The results of `rewrite`.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use preshade::unstable::emit;
use preshade::unstable::passes::contract::Contract;
use preshade::unstable::passes::pass::Refusal;
use preshade::unstable::passes::validate::Check;
use serde::Serialize;

/// The result for one material.
#[derive(Serialize)]
pub struct Rewritten {
    pub material: String,
    pub recipe: String,
    pub contract: Contract,
    pub refusals: Vec<Refusal>,
    pub notes: Vec<String>,
    /// Results of validation by proof and interpreter, if requested.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub validation: Option<Vec<Check>>,
    /// Results of validation on an adapter, if there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub validation_on: Option<OnAdapter>,
    pub files: Vec<Written>,
}

impl Rewritten {
    pub fn is_broken(&self) -> bool {
        let elsewhere = self.validation_on.iter().flat_map(|v| &v.checks);
        let checks = self.validation.iter().flatten().chain(elsewhere);
        checks.into_iter().any(|c| c.verdict.is_broken())
    }
}

/// Results of running original and variant on an adapter.
#[derive(Serialize)]
pub struct OnAdapter {
    pub adapter: String,
    pub checks: Vec<Check>,
}

/// A file that was written or printed.
#[derive(Serialize)]
pub struct Written {
    pub name: String,
    /// Its path, or its content if it was printed.
    #[serde(flatten)]
    pub content: Content,
}

#[derive(Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Content {
    Path(PathBuf),
    Text(String),
}

#[derive(Serialize)]
pub struct Report {
    pub schema: &'static str,
    pub materials: Vec<Rewritten>,
    pub errors: Vec<String>,
}

/// The result of a job, before anything is written.
#[derive(Default)]
pub struct Made {
    pub materials: Vec<(Rewritten, Vec<emit::File>)>,
    pub read: Vec<PathBuf>,
    pub messages: Vec<String>,
    /// Notes about pipeline state that preshade assumed.
    pub assumed: Vec<String>,
    /// Printed after everything is written.
    pub hints: Vec<String>,
    pub errors: Vec<String>,
    pub times: Times,
}

/// Time by activity.
#[derive(Default)]
pub struct Times(pub BTreeMap<(u8, String), Duration>);

impl Times {
    /// Runs and times `work`; `order` is its line in the table.
    pub fn took<T>(&mut self, order: u8, what: &str, work: impl FnOnce() -> T) -> T {
        let began = Instant::now();
        let done = work();
        self.add(order, what, began.elapsed());
        done
    }

    pub fn add(&mut self, order: u8, what: &str, time: Duration) {
        *self.0.entry((order, what.to_owned())).or_default() += time;
    }

    pub fn table<'t>(all: impl Iterator<Item = &'t Self>) -> String {
        let mut sums: BTreeMap<&(u8, String), Duration> = BTreeMap::new();
        for (what, time) in all.flat_map(|t| &t.0) {
            *sums.entry(what).or_default() += *time;
        }
        let line = |(what, time): (&str, Duration)| {
            format!("{:>10.3} ms  {what}", time.as_secs_f64() * 1e3)
        };
        let whole: Duration = sums.values().sum();
        let sums = sums.iter().map(|((_, what), time)| (what.as_str(), *time));
        let lines: Vec<String> = sums.chain([("in all", whole)]).map(line).collect();
        lines.join("\n")
    }
}
