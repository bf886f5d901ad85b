//! A frontier as text: the table for a terminal, and every point as CSV.

use std::fmt::Write;

use super::csv::{number as written, quoted};
use crate::measure::Estimate;
use crate::measure::record::{Chosen, ORIGINAL, PathTime};
use crate::search::explore::{Ended, Exploration, Fate, Point};

/// The frontier as lines of text, the least error first, and a summary of the other candidates.
pub fn table(found: &Exploration) -> String {
    let mut out = format!(
        "{}, {}x{}, on {} ({}, {}), {}\n\n",
        super::titled(&found.scene, found.part.as_deref()),
        found.resolution[0],
        found.resolution[1],
        found.adapter.title(),
        found.adapter.backend,
        found.adapter.kind,
        preshade_draw::render::order::name(found.order),
    );
    let metric = metric(found);
    let header = [
        &metric,
        "max abs",
        "ms",
        "path, p95 ms",
        "speedup",
        "recipe",
    ]
    .map(str::to_owned);
    let mut rows = vec![header];
    rows.extend(on_frontier(found).map(|p| cells(found, p)));
    let mut widths = [0; 5];
    for row in &rows {
        for (width, cell) in widths.iter_mut().zip(row) {
            *width = (*width).max(cell.chars().count());
        }
    }
    for row in &rows {
        for (cell, width) in row.iter().zip(widths) {
            let _ = write!(out, "{cell:>width$}  ");
        }
        out.push_str(&row[5]);
        out.push('\n');
    }
    out.push('\n');
    out.push_str(&counted(found));
    out.push('\n');
    for said in said(found) {
        out.push_str(&said);
        out.push('\n');
    }
    out.push_str(&ended(found));
    out
}

/// The headline: whether anything gains, and the choice under a budget.
pub(crate) fn said(found: &Exploration) -> Vec<String> {
    let gains = |p: &Point| p.speedup.is_some_and(|s| s.low > 1.0);
    let timed = on_frontier(found).any(|p| p.name != ORIGINAL && p.speedup.is_some());
    let level = timed && !on_frontier(found).any(gains);
    let unmeasured = is_unmeasured(found)
        .then(|| "Not measured: no candidate was drawn beside the original.".to_owned());
    let nothing = level.then(|| {
        "Nothing that was verified is faster than the original beyond noise: every interval of the \
         frontier reaches 1 or lies below."
            .to_owned()
    });
    let chosen = found.chosen.as_ref().map(Chosen::said);
    let warnings = found.report.iter().flat_map(|r| &r.warnings);
    let warnings = warnings.map(|w| format!("Warning: {w}."));
    let said = unmeasured.into_iter().chain(nothing);
    said.chain(chosen).chain(warnings).collect()
}

/// Whether no candidate was measured beside the original.
pub fn is_unmeasured(found: &Exploration) -> bool {
    let measured = |p: &Point| p.name != ORIGINAL && p.error.is_some();
    !found.points.iter().any(measured)
}

/// The points that no other beats, by their error.
pub(crate) fn on_frontier(found: &Exploration) -> impl Iterator<Item = &Point> {
    let of = |name: &String| found.points.iter().find(|p| p.name == *name);
    found.frontier.iter().filter_map(of)
}

/// Name of the metric, as it is written.
pub(crate) fn metric(found: &Exploration) -> String {
    let name = serde_json::to_value(found.metric).ok();
    let name = name.and_then(|n| n.as_str().map(str::to_owned));
    name.unwrap_or_default()
}

fn cells(found: &Exploration, point: &Point) -> [String; 6] {
    let dash = || "-".to_owned();
    let error = point.error.as_ref();
    [
        error.map_or_else(dash, |e| number(found.metric.of(e))),
        error.map_or_else(dash, |e| number(e.max_abs)),
        point
            .time_ms
            .map_or_else(dash, |t| format!("{:.3}", t.median)),
        point.path.as_ref().map_or_else(dash, path),
        point.speedup.map_or_else(dash, speedup),
        point.name.clone(),
    ]
}

/// A speedup with its interval.
pub(crate) fn speedup(of: Estimate) -> String {
    format!("{:.2}x [{:.2}, {:.2}]", of.median, of.low, of.high)
}

/// The median of a path's frames, and the 95th percentile.
pub(crate) fn path(of: &PathTime) -> String {
    format!("{:.3}, {:.3}", of.median_ms, of.p95_ms)
}

pub(crate) fn number(error: f64) -> String {
    match error {
        0.0 => "0".to_owned(),
        e => format!("{e:.5}"),
    }
}

/// The number of candidates with each result.
fn counted(found: &Exploration) -> String {
    let count =
        |of: &dyn Fn(&Fate) -> bool| found.points[1..].iter().filter(|p| of(&p.fate)).count();
    let kinds: [(usize, &str); 9] = [
        (
            count(&|f| matches!(f, Fate::Beaten { .. })),
            "beaten by another",
        ),
        (
            count(&|f| matches!(f, Fate::Even { .. })),
            "as good as one that was verified in its place",
        ),
        (
            count(&|f| matches!(f, Fate::Unverified { .. })),
            "not verified",
        ),
        (
            count(&|f| matches!(f, Fate::Predicted { .. })),
            "predicted to be hopeless and not drawn",
        ),
        (
            count(&|f| matches!(f, Fate::Slow { .. })),
            "far slower than the original at first sight",
        ),
        (
            count(&|f| matches!(f, Fate::Same { .. })),
            "the same text as another",
        ),
        (
            count(&|f| matches!(f, Fate::Refused { .. })),
            "refused by every material",
        ),
        (
            count(&|f| matches!(f, Fate::Broken { .. })),
            "not what they promise",
        ),
        (
            count(&|f| matches!(f, Fate::NotMeasured { .. })),
            "not measured",
        ),
    ];
    let said: Vec<String> = kinds
        .iter()
        .filter(|(n, _)| *n > 0)
        .map(|(n, what)| format!("{n} {what}"))
        .collect();
    format!(
        "Of {} candidates: {}.\n",
        found.points.len() - 1,
        said.join(", ")
    )
}

pub(crate) fn ended(found: &Exploration) -> String {
    let seconds = found.seconds;
    let verified = match found.frames_verified {
        0 => "Nothing was verified.\n".to_owned(),
        1 => "Finalists were verified on the first frame of each camera.\n".to_owned(),
        n => format!("Finalists were verified on up to {n} frames of each camera.\n"),
    };
    let how = match &found.ended {
        Ended::Complete => format!("Searched in {seconds:.0} s.\n"),
        Ended::OutOfTime => format!(
            "Not all candidates were measured: the part of --seconds that is left for them was up. \
             The whole search took {seconds:.0} s. A larger --seconds measures more, and --out keeps \
             what was measured.\n"
        ),
        Ended::Stopped => {
            format!("Stopped after {seconds:.0} s: this is what was measured by then.\n")
        }
        Ended::Lost { why } => format!("Ended after {seconds:.0} s: {why}.\n"),
    };
    how + &verified
}

/// The result of a candidate, in words.
pub(crate) fn fate(point: &Point) -> String {
    match &point.fate {
        Fate::Frontier => "on the frontier".to_owned(),
        Fate::Beaten { by } => format!("beaten by {by}"),
        Fate::Even { with } => format!("as good as {with}, which was verified in its place"),
        Fate::Unverified { why } => format!("not verified: {why}"),
        Fate::Slow { times } => {
            format!("{times:.1} times the original's time at first sight, and not timed again")
        }
        Fate::Same { r#as } => format!("the same text as {as}"),
        Fate::Refused { why } => format!("refused: {why}"),
        Fate::Broken { why } => format!("broken: {why}"),
        Fate::Predicted { why } => format!("not drawn: {why}"),
        Fate::NotMeasured { why } => format!("not measured: {why}"),
    }
}

/// Every point, one a line.
pub fn csv(found: &Exploration) -> String {
    let mut out =
        "name,recipe,fate,flip_mean,flip_p99,flip_tile,max_abs,changed_pixels,time_ms,speedup,\
                   speedup_low,speedup_high,path_median_ms,path_p95_ms,predicted_error,\
                   predicted_work\n"
            .to_owned();
    for p in &found.points {
        let error = p.error.as_ref();
        let of = written;
        let cells = [
            quoted(&p.name),
            quoted(&p.recipe),
            quoted(&fate(p)),
            of(error.map(|e| e.flip_mean)),
            of(error.map(|e| e.flip_p99)),
            of(error.map(|e| e.flip_tile)),
            of(error.map(|e| e.max_abs)),
            error.map_or_else(String::new, |e| e.changed_pixels.to_string()),
            of(p.time_ms.map(|t| t.median)),
            of(p.speedup.map(|s| s.median)),
            of(p.speedup.map(|s| s.low)),
            of(p.speedup.map(|s| s.high)),
            of(p.path.as_ref().map(|p| p.median_ms)),
            of(p.path.as_ref().map(|p| p.p95_ms)),
            of(p.prediction.map(|p| p.error)),
            of(p.prediction.map(|p| p.work)),
        ];
        out.push_str(&cells.join(","));
        out.push('\n');
    }
    out
}
