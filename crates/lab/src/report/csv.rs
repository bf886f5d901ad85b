//! Measurements for a spreadsheet: one line a variant and view.

use preshade_plan::contract::Verdict;

use super::grid::{Csv, number, quoted};
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
    let mut csv = Csv::new(&COLUMNS.join(","));
    rows(&mut csv, report, &[]);
    csv.text()
}

/// The reports of a series under each other, each line with the variable's value ahead.
pub fn series(series: &Series) -> String {
    let mut csv = Csv::new(&format!(
        "{},{}",
        quoted(&series.variable),
        COLUMNS.join(",")
    ));
    for point in &series.points {
        rows(&mut csv, &point.report, &[point.value.to_string()]);
    }
    csv.text()
}

/// The lines of a report, with `first` ahead of each.
fn rows(csv: &mut Csv, report: &Report, first: &[String]) {
    for v in &report.variants {
        let about = [&v.name, &v.recipe, &verdict(&v.verdict)].map(|text| quoted(text));
        let about = [first, &about].concat();
        for view in &v.by_view {
            let mut cells = about.clone();
            cells.push(quoted(&view.camera));
            cells.push(view.frame.to_string());
            cells.push(preshade_draw::render::order::name(view.order).replace(' ', "-"));
            cells.extend(error(Some(&view.error)));
            cells.extend(estimate(view.time_ms.as_ref().map(|t| &t.estimate)));
            cells.extend(estimate(view.speedup.as_ref()));
            cells.push(number(view.shaded_per_pixel));
            csv.line(cells);
        }
        // A variant that was not drawn has only the reason.
        if v.by_view.is_empty() {
            let mut cells = about;
            cells.resize(first.len() + COLUMNS.len(), String::new());
            csv.line(cells);
        }
    }
}

/// Each plan of a decision in each view.
pub fn decision(decision: &Decision) -> String {
    let mut csv = Csv::new(
        "plan,verdict,camera,frame,order,shaded_per_pixel,overdraw,drawn_with,\
                   predicted_ms,time_ms,time_low,time_high,speedup,speedup_low,speedup_high,\
                   worst_changed_pixels,worst_changed_depth,worst_nan_pixels,worst_max_abs,\
                   worst_flip_mean,worst_flip_p99,worst_flip_tile,pipelines,creation_ms",
    );
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
            // The worst of all views: the pictures have no columns of their own.
            cells.extend(error(plan.error.as_ref()));
            cells.push(
                plan.cost
                    .as_ref()
                    .map_or_else(String::new, |c| c.pipelines.to_string()),
            );
            cells.push(number(plan.cost.as_ref().map(|c| c.creation_ms)));
            csv.line(cells);
        }
    }
    csv.text()
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
