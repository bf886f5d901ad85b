//! The results of a job of `rewrite`.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use preshade_compiler::command::rewrite::Rewritten;
use shader_text::files;

/// The result of a job, before anything is written.
#[derive(Default)]
pub struct RewriteResult {
    pub materials: Vec<(Rewritten, Vec<files::File>)>,
    /// The versions of materials that serve several draws.
    pub versions: Vec<files::File>,
    pub read: Vec<PathBuf>,
    pub messages: Vec<String>,
    /// Notes about pipeline state that preshade assumed.
    pub assumed: Vec<String>,
    /// Printed after everything is written.
    pub hints: Vec<String>,
    pub errors: Vec<String>,
    pub times: Times,
}

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
