//! A frontier as text: the table for a terminal, and every point as CSV.

use super::grid::{self, Cell, Csv, or_dash, quoted};
use crate::measure::Estimate;
use crate::measure::record::{Chosen, ORIGINAL, PathTime};
use crate::search::explore::{Ended, Exploration, Fate, Point};

/// The frontier as lines of text, the least error first, and a summary of the other candidates.
pub fn table(found: &Exploration) -> String {
    let part = found.part.as_deref();
    let mut out = format!(
        "{}, {}\n\n",
        super::place(&found.scene, part, found.resolution, 1, &found.adapter),
        preshade_draw::render::order::name(found.order),
    );
    let metric = metric(found);
    let header = [
        metric.as_str(),
        "max abs",
        "ms",
        "path, p95 ms",
        "speedup",
        "recipe",
    ];
    let mut rows = vec![grid::row(header)];
    rows.extend(on_frontier(found).map(|p| cells(found, p)));
    out.push_str(&grid::aligned(&rows, |c| c == 5, false));
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

/// Whether no candidate was measured against the original.
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

fn cells(found: &Exploration, point: &Point) -> Vec<Cell> {
    let error = point.error.as_ref();
    grid::row([
        or_dash(error, |e| number(found.metric.of(e))),
        or_dash(error, |e| number(e.max_abs)),
        or_dash(point.time_ms, |t| format!("{:.3}", t.median)),
        or_dash(point.path.as_ref(), path),
        or_dash(point.speedup, speedup),
        point.name.clone(),
    ])
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
    let kinds = [
        "beaten by another",
        "as good as one that was verified in its place",
        "not verified",
        "predicted to be hopeless and not drawn",
        "far slower than the original at first sight",
        "the same text as another",
        "refused by every material",
        "not what they promise",
        "not measured",
    ];
    let kind = |fate: &Fate| match fate {
        Fate::Frontier => None,
        Fate::Beaten { .. } => Some(0),
        Fate::Even { .. } => Some(1),
        Fate::Unverified { .. } => Some(2),
        Fate::Predicted { .. } => Some(3),
        Fate::Slow { .. } => Some(4),
        Fate::Same { .. } => Some(5),
        Fate::Refused { .. } => Some(6),
        Fate::Broken { .. } => Some(7),
        Fate::NotMeasured { .. } => Some(8),
    };
    let mut counts = [0; 9];
    for kind in found.points[1..].iter().filter_map(|p| kind(&p.fate)) {
        counts[kind] += 1;
    }
    let kinds = counts.iter().zip(kinds);
    let said: Vec<String> = kinds
        .filter(|(n, _)| **n > 0)
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
    let mut csv = Csv::new(
        "name,recipe,fate,flip_mean,flip_p99,flip_tile,max_abs,changed_pixels,time_ms,speedup,\
         speedup_low,speedup_high,path_median_ms,path_p95_ms,predicted_error,predicted_work",
    );
    for p in &found.points {
        let error = p.error.as_ref();
        let of = grid::number;
        csv.line([
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
        ]);
    }
    csv.text()
}
