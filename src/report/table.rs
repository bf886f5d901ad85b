//! The table for a terminal: plain text, aligned, without colours.

use preshade_passes::contract::Verdict;

use super::{Kept, Report, VariantReport};
use crate::measure::Clock;

/// The report as lines of text.
pub fn render(report: &Report) -> String {
    let mut out = format!(
        "{}, {}x{}{}, on {} ({}, {})\n",
        report.scene,
        report.resolution[0],
        report.resolution[1],
        match report.samples {
            1 => String::new(),
            n => format!(", {n} samples"),
        },
        report.adapter.name,
        report.adapter.backend,
        report.adapter.kind,
    );
    let header = [
        "variant",
        "verdict",
        "changed px",
        "depths",
        "max abs",
        "FLIP",
        "ms",
        "speedup",
        "shaded/px",
    ];
    let rows: Vec<[String; 9]> = report.variants.iter().map(row).collect();
    let mut widths = header.map(str::len);
    for row in &rows {
        for (w, cell) in widths.iter_mut().zip(row) {
            *w = (*w).max(cell.chars().count());
        }
    }
    let line = |cells: [&str; 9]| {
        let mut line = String::new();
        for (i, (cell, width)) in cells.iter().zip(widths).enumerate() {
            // Words to the left, numbers to the right.
            if i < 2 {
                line.push_str(&format!("{cell:<width$}  "));
            } else {
                line.push_str(&format!("{cell:>width$}  "));
            }
        }
        line.trim_end().to_owned() + "\n"
    };
    out.push('\n');
    out.push_str(&line(header));
    out.push_str(&line(
        widths.map(|w| "-".repeat(w)).each_ref().map(String::as_str),
    ));
    for row in &rows {
        out.push_str(&line(row.each_ref().map(String::as_str)));
    }
    out.push('\n');
    out.push_str(&notes(report));
    out
}

fn row(v: &VariantReport) -> [String; 9] {
    let dash = || "-".to_owned();
    let error = v.error.as_ref();
    let drawn = |f: &dyn Fn(&crate::measure::ErrorLadder) -> String| error.map_or_else(dash, f);
    [
        v.name.clone(),
        match &v.verdict {
            Verdict::Holds => "holds",
            Verdict::Broken { .. } => "BROKEN",
            Verdict::NotMeasured { .. } => "not measured",
        }
        .to_owned(),
        drawn(&|e| e.changed_pixels.to_string()),
        drawn(&|e| e.changed_depth.to_string()),
        drawn(&|e| match e.max_abs {
            0.0 => "0".to_owned(),
            m => format!("{m:.4}"),
        }),
        drawn(&|e| match e.flip_mean {
            0.0 => "0".to_owned(),
            m => format!("{m:.5}"),
        }),
        v.time_ms
            .as_ref()
            .map_or_else(dash, |t| format!("{:.3}", t.estimate.median)),
        v.speedup.as_ref().map_or_else(dash, |s| {
            format!("{:.2}x [{:.2}, {:.2}]", s.median, s.low, s.high)
        }),
        v.shaded_per_pixel.map_or_else(dash, |s| format!("{s:.2}")),
    ]
}

/// What the figures are of, what broke, and what was left alone.
fn notes(report: &Report) -> String {
    let mut out = String::new();
    if let Some(view) = report.variants.first().and_then(|v| v.by_view.first()) {
        let clock = match report.clock {
            Some(Clock::GpuTimestamps) => "by GPU timestamps",
            Some(Clock::WallClock) => "by the wall clock",
            None => "not taken",
        };
        let views = report.variants.first().map_or(0, |v| v.by_view.len());
        out.push_str(&format!(
            "Errors are the worst of {views} views; times ({clock}) and shaded fragments are of camera `{}`, {}.\n",
            view.camera,
            crate::render::order::name(view.order)
        ));
    }
    if let Some(ties) = report.depth_ties.filter(|n| *n > 0) {
        out.push_str(&format!(
            "{ties} depth ties: at so many pixels two surfaces share the winning depth.\n"
        ));
    }
    for v in &report.variants {
        match &v.verdict {
            Verdict::Broken { r#where } => {
                out.push_str(&format!("{}: broken at {}\n", v.name, r#where));
            }
            Verdict::NotMeasured { why } => {
                out.push_str(&format!("{}: not measured: {why}\n", v.name));
            }
            Verdict::Holds => {}
        }
    }
    // Variants of one pass leave a material alone for one reason: told once.
    let mut told: Vec<&Kept> = Vec::new();
    for kept in report.variants.iter().flat_map(|v| &v.kept) {
        if !told.contains(&kept) {
            told.push(kept);
            out.push_str(&format!(
                "material `{}` is drawn as it is: {}\n",
                kept.material, kept.why
            ));
        }
    }
    out
}
