//! Merged results: the results of each adapter for each variant of each input.

use std::collections::BTreeMap;

use super::frontier;
use super::grid::{Csv, number, quoted};
use crate::jobs::{AdapterResult, Results, Standing};
use crate::measure::Estimate;

/// On how many adapters a variant holds and pays, in words.
pub(crate) fn holds_and_pays(row: &BTreeMap<&str, AdapterResult<'_>>) -> String {
    let drawn = || {
        let standings = row.values().map(|s| s.standing().0);
        standings.filter(|s| ![Standing::NoPicture, Standing::DoesNotApply].contains(s))
    };
    let timed = || {
        let applies = row
            .values()
            .filter(|s| s.standing().0 != Standing::DoesNotApply);
        applies.filter(|s| !s.times.is_empty())
    };
    let mut told = Vec::new();
    if drawn().count() > 0 {
        let holds = drawn().filter(|s| *s == Standing::Holds).count();
        told.push(format!("holds on {holds} of {}", drawn().count()));
    }
    if timed().count() > 0 {
        let paying = timed().filter(|s| s.pays()).count();
        told.push(format!("pays on {paying} of {}", timed().count()));
    }
    told.join(", ")
}

/// The results as lines: the adapters, and for each variant of each input on how many of them it
/// holds and pays.
pub fn table(results: &Results) -> String {
    let mut lines: Vec<String> = results
        .adapters
        .values()
        .map(|a| format!("{} ({}, {})", a.title(), a.backend, a.driver))
        .collect();
    let (rows, names) = (results.rows(), results.names());
    for (subject, variants) in &rows {
        lines.push(format!("\n{}", subject.title(&rows)));
        for (variant, row) in variants {
            lines.push(format!("  {variant}: {}", holds_and_pays(row)));
            for (id, said) in row {
                let name = names.get(id).map_or(*id, String::as_str);
                let (standing, why) = said.standing();
                if ![Standing::Holds, Standing::NoPicture].contains(&standing) {
                    lines.push(format!("    {name}: {}: {why}", standing.word()));
                }
                lines.extend(said.times.iter().map(|time| match time {
                    Ok(speedup) => format!("    {name}: {}", frontier::speedup(*speedup)),
                    Err(why) => format!("    {name}: not timed: {why}"),
                }));
            }
        }
    }
    lines.join("\n")
}

/// One line an input, variant, adapter and run.
pub fn csv(results: &Results) -> String {
    let mut csv = Csv::new(
        "input,variant,adapter,driver,verdict,changed_pixels,flip_mean,speedup,speedup_low,\
         speedup_high",
    );
    let rows = results.rows();
    let each = rows.iter().flat_map(|(subject, variants)| {
        let title = subject.title(&rows);
        let variants = variants.iter();
        variants.map(move |(variant, row)| (title.clone(), variant, row))
    });
    for (input, variant, row) in each {
        for (id, said) in row {
            let adapter = results.adapters.get(*id);
            let [name, driver] = match adapter {
                Some(a) => [a.name.as_str(), a.driver.as_str()],
                None => [*id, ""],
            };
            let error = said.report().and_then(|r| r.error.as_ref());
            let mut times: Vec<Option<Estimate>> = said.times.iter().map(|t| t.ok()).collect();
            if times.is_empty() {
                times.push(None);
            }
            for time in times {
                csv.line([
                    quoted(&input),
                    quoted(variant),
                    quoted(name),
                    quoted(driver),
                    said.standing().0.word().to_owned(),
                    error.map_or(String::new(), |e| e.changed_pixels.to_string()),
                    number(error.map(|e| e.flip_mean)),
                    number(time.map(|e| e.median)),
                    number(time.map(|e| e.low)),
                    number(time.map(|e| e.high)),
                ]);
            }
        }
    }
    csv.text()
}
