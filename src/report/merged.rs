//! Merged results: what each adapter said of each variant of each input.

use std::collections::BTreeMap;

use preshade_passes::contract::Verdict;

use super::plain::plain;
use crate::jobs::{Answer, EVERY, Kind, Measured, Merged, Results};
use crate::measure::Estimate;
use crate::measure::record::VariantReport;
use crate::search::plan::choose::WORTHWHILE;

/// What one adapter said of a variant.
#[derive(Clone, Debug, Default)]
struct Said<'a> {
    /// The variant's report on pictures, or what stands in its place.
    picture: Option<Result<&'a VariantReport, &'a str>>,
    /// Its speedups, one of each run, or what stands in their place.
    times: Vec<Result<Estimate, &'a str>>,
}

/// Input and variant, and what each adapter said.
type Rows<'a> = BTreeMap<(String, &'a str), BTreeMap<&'a str, Said<'a>>>;

fn rows(results: &Results) -> Rows<'_> {
    let mut rows = Rows::new();
    let of_variants = results.jobs.values().filter(|m| m.job.variant != EVERY);
    for Merged { job, answers, .. } in of_variants {
        let row = rows.entry((job.input.join(" "), job.variant.as_str()));
        let row = row.or_default();
        for (id, answer) in answers {
            let said = row.entry(id).or_default();
            let runs = match answer {
                Answer::Failed { why, .. } => {
                    match job.kind {
                        Kind::Picture => said.picture = Some(Err(why)),
                        Kind::Time => said.times.push(Err(why)),
                    }
                    continue;
                }
                Answer::Measured { runs } => runs,
            };
            for variant in runs.values().filter_map(variant) {
                match job.kind {
                    Kind::Picture => said.picture = Some(Ok(variant)),
                    Kind::Time => {
                        let time = variant.speedup.ok_or("no time was measured");
                        said.times.push(time);
                    }
                }
            }
        }
    }
    rows
}

/// The variant of a report. The original is first.
fn variant(measured: &Measured) -> Option<&VariantReport> {
    measured.found.report()?.variants.get(1)
}

/// Whether it pays: faster in every run, beyond the intervals, by as much as `plan` asks for.
fn pays(times: &[Result<Estimate, &str>]) -> bool {
    let is_faster = |time: &Result<Estimate, &str>| time.is_ok_and(|e| e.low > WORTHWHILE);
    !times.is_empty() && times.iter().all(is_faster)
}

/// One word for what the pictures said.
fn word<'a>(picture: Option<Result<&'a VariantReport, &'a str>>) -> (&'static str, &'a str) {
    match picture {
        None => ("no picture", ""),
        Some(Err(why)) => ("failed", why),
        Some(Ok(variant)) => match &variant.verdict {
            Verdict::Holds => ("holds", ""),
            Verdict::Broken { r#where } => ("BROKEN", r#where),
            Verdict::NotMeasured { why } => ("not measured", why),
        },
    }
}

/// The results as lines: the adapters, and for each variant of each input on how many of them it
/// holds and pays.
pub fn table(results: &Results) -> String {
    let mut lines: Vec<String> = results
        .adapters
        .values()
        .map(|a| format!("{} ({}, {})", a.title(), a.backend, a.driver))
        .collect();
    let mut input = String::new();
    for ((of, variant), row) in rows(results) {
        if input != of {
            lines.push(format!("\n{of}"));
            input = of;
        }
        let drawn: Vec<_> = row.values().filter(|s| s.picture.is_some()).collect();
        let hold = drawn.iter().filter(|s| word(s.picture).0 == "holds");
        let timed: Vec<_> = row.values().filter(|s| !s.times.is_empty()).collect();
        let mut told = Vec::new();
        if !drawn.is_empty() {
            told.push(format!("holds on {} of {}", hold.count(), drawn.len()));
        }
        if !timed.is_empty() {
            let paying = timed.iter().filter(|s| pays(&s.times)).count();
            told.push(format!("pays on {paying} of {}", timed.len()));
        }
        lines.push(format!("  {variant}: {}", told.join(", ")));
        for (id, said) in &row {
            let (word, why) = word(said.picture);
            if !["holds", "no picture"].contains(&word) {
                lines.push(format!("    {}: {word}: {why}", name(results, id)));
            }
            for time in &said.times {
                lines.push(match time {
                    Ok(e) => format!(
                        "    {}: {:.2}x [{:.2}, {:.2}]",
                        name(results, id),
                        e.median,
                        e.low,
                        e.high
                    ),
                    Err(why) => format!("    {}: not timed: {why}", name(results, id)),
                });
            }
        }
    }
    lines.join("\n")
}

/// Name of an adapter.
fn name<'a>(results: &'a Results, id: &'a str) -> &'a str {
    results.adapters.get(id).map_or(id, |a| a.name.as_str())
}

/// One line an input, variant, adapter and run.
pub fn csv(results: &Results) -> String {
    let mut out =
        "input,variant,adapter,driver,verdict,changed_pixels,flip_mean,speedup,speedup_low,\
                   speedup_high\n"
            .to_owned();
    let quoted = |text: &str| format!("\"{}\"", plain(text).replace('"', "\"\""));
    for ((input, variant), row) in rows(results) {
        for (id, said) in &row {
            let adapter = results.adapters.get(*id);
            let [name, driver] = match adapter {
                Some(a) => [a.name.as_str(), a.driver.as_str()],
                None => [*id, ""],
            };
            let error = match said.picture {
                Some(Ok(variant)) => variant.error.as_ref(),
                _ => None,
            };
            let error = match error {
                Some(e) => format!("{},{}", e.changed_pixels, e.flip_mean),
                None => ",".to_owned(),
            };
            let mut times: Vec<Option<Estimate>> = said.times.iter().map(|t| t.ok()).collect();
            if times.is_empty() {
                times.push(None);
            }
            for time in times {
                let time = match time {
                    Some(e) => format!("{},{},{}", e.median, e.low, e.high),
                    None => ",,".to_owned(),
                };
                out.push_str(&format!(
                    "{},{},{},{},{},{error},{time}\n",
                    quoted(&input),
                    quoted(variant),
                    quoted(name),
                    quoted(driver),
                    word(said.picture).0
                ));
            }
        }
    }
    out
}
