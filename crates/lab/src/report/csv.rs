//! Measurements for a spreadsheet: one line a variant and view.

use preshade_plan::contract::Verdict;

use super::plain::plain;
use crate::measure::crossover::Series;
use crate::measure::record::Report;
use crate::measure::{ErrorLadder, Estimate};
use crate::search::plan::decision::Decision;

const COLUMNS: [&str; 20] = [
    "variant",
    "recipe",
    "verdict",
    "camera",
    "frame",
    "order",
    "changed_pixels",
    "changed_depth",
    "nan_pixels",
    "max_abs",
    "flip_mean",
    "flip_p99",
    "flip_tile",
    "time_ms",
    "time_low",
    "time_high",
    "speedup",
    "speedup_low",
    "speedup_high",
    "shaded_per_pixel",
];

/// Each variant of a report in each view, the original first.
pub fn verify(report: &Report) -> String {
    COLUMNS.join(",") + "\n" + &rows(report, "")
}

/// The reports of a series under each other, each line with the variable's value ahead.
pub fn series(series: &Series) -> String {
    let header = format!("{},{}\n", quoted(&series.variable), COLUMNS.join(","));
    let points = series.points.iter();
    header
        + &points
            .map(|p| rows(&p.report, &format!("{},", p.value)))
            .collect::<String>()
}

/// The lines of a report, with `first` ahead of each.
fn rows(report: &Report, first: &str) -> String {
    let mut out = String::new();
    for v in &report.variants {
        let about = [
            quoted(&v.name),
            quoted(&v.recipe),
            quoted(&verdict(&v.verdict)),
        ];
        for view in &v.by_view {
            let mut cells = about.to_vec();
            cells.push(quoted(&view.camera));
            cells.push(view.frame.to_string());
            cells.push(preshade_draw::render::order::name(view.order).replace(' ', "-"));
            cells.extend(error(Some(&view.error)));
            cells.extend(estimate(view.time_ms.as_ref().map(|t| &t.estimate)));
            cells.extend(estimate(view.speedup.as_ref()));
            cells.push(number(view.shaded_per_pixel));
            out.push_str(first);
            line(&mut out, &cells);
        }
        // Of one that was not drawn there is the reason alone.
        if v.by_view.is_empty() {
            let mut cells = about.to_vec();
            cells.resize(COLUMNS.len(), String::new());
            out.push_str(first);
            line(&mut out, &cells);
        }
    }
    out
}

/// Each plan of a decision in each view.
pub fn decision(decision: &Decision) -> String {
    let mut out = "plan,verdict,camera,frame,order,shaded_per_pixel,overdraw,drawn_with,\
                   predicted_ms,time_ms,time_low,time_high,speedup,speedup_low,speedup_high,\
                   worst_changed_pixels,worst_changed_depth,worst_nan_pixels,worst_max_abs,\
                   worst_flip_mean,worst_flip_p99,worst_flip_tile,pipelines,creation_ms\n"
        .to_owned();
    for (number_of, plan) in decision.plans.iter().enumerate() {
        for (view, at) in decision.views.iter().zip(&plan.by_view) {
            let mut cells = vec![
                quoted(&plan.name),
                quoted(&verdict(&plan.verdict)),
                quoted(&view.view.camera),
                view.view.frame.to_string(),
                preshade_draw::render::order::name(view.view.order).replace(' ', "-"),
                view.shaded_per_pixel.to_string(),
                view.overdraw.to_string(),
                u8::from(view.plan == number_of).to_string(),
                at.predicted_ms.to_string(),
            ];
            cells.extend(estimate(at.time_ms.as_ref()));
            cells.extend(estimate(at.speedup.as_ref()));
            // The worst of all views: pictures are not compared apart.
            cells.extend(error(plan.error.as_ref()));
            cells.push(
                plan.cost
                    .as_ref()
                    .map_or_else(String::new, |c| c.pipelines.to_string()),
            );
            cells.push(number(plan.cost.as_ref().map(|c| c.creation_ms)));
            line(&mut out, &cells);
        }
    }
    out
}

fn line(out: &mut String, cells: &[String]) {
    out.push_str(&cells.join(","));
    out.push('\n');
}

fn verdict(verdict: &Verdict) -> String {
    match verdict {
        Verdict::Holds => "holds".to_owned(),
        Verdict::Broken { r#where } => format!("broken: {where}"),
        Verdict::NotMeasured { why } => format!("not measured: {why}"),
    }
}

fn error(error: Option<&ErrorLadder>) -> [String; 7] {
    let count = |of: fn(&ErrorLadder) -> u64| error.map_or_else(String::new, |e| of(e).to_string());
    [
        count(|e| e.changed_pixels),
        count(|e| e.changed_depth),
        count(|e| e.nan_pixels),
        number(error.map(|e| e.max_abs)),
        number(error.map(|e| e.flip_mean)),
        number(error.map(|e| e.flip_p99)),
        number(error.map(|e| e.flip_tile)),
    ]
}

fn estimate(of: Option<&Estimate>) -> [String; 3] {
    [of.map(|e| e.median), of.map(|e| e.low), of.map(|e| e.high)].map(number)
}

/// A number with all its digits; nothing where there is none.
pub(super) fn number(of: Option<f64>) -> String {
    of.map_or_else(String::new, |n| n.to_string())
}

/// Characters that begin a formula, full-width forms too, and characters that a spreadsheet skips
/// before one.
const FORMULAS: [char; 11] = [
    '=', '+', '-', '@', '\t', '\r', '\n', '\u{ff1d}', '\u{ff0b}', '\u{ff0d}', '\u{ff20}',
];

/// A field, quoted by RFC 4180. Text that a spreadsheet would read as a formula gets an apostrophe,
/// because names may come from strangers (OWASP, "CSV Injection").
pub(crate) fn quoted(text: &str) -> String {
    let is_formula = text.trim_start_matches(' ').starts_with(FORMULAS);
    let guard = if is_formula { "'" } else { "" };
    format!("\"{guard}{}\"", plain(text).replace('"', "\"\""))
}

#[cfg(test)]
mod tests {
    use super::quoted;

    #[test]
    fn text_is_no_formula() {
        assert_eq!(quoted("a\u{1b}[2J"), "\"a\\u{1b}[2J\"");
        assert_eq!(quoted("say \"a\""), "\"say \"\"a\"\"\"");
        assert_eq!(quoted("=1+1"), "\"'=1+1\"");
        assert_eq!(quoted("  @SUM(a)"), "\"'  @SUM(a)\"");
        assert_eq!(quoted("a-b"), "\"a-b\"");
        // The rest of OWASP's list.
        for first in ["\n=1", "\u{ff1d}1", "\u{ff0b}1", "\u{ff0d}1", "\u{ff20}A"] {
            assert_eq!(quoted(first), format!("\"'{first}\""));
        }
    }
}
