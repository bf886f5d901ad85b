//! The result of `verify`: each variant with its verdict and its pictures, view by view.

use askama::Template;
use preshade_plan::contract::Verdict;

use super::range::{Scale, Strip};
use super::section::{Cameras, Section, section};
use super::words::{self, or_dash};
use super::{Gallery, PageError, Shell, data, diff};
use crate::measure::Variant;
use crate::measure::record::{Choice, ORIGINAL, Pictures, Report, VariantReport};
use crate::report::control_characters::plain;
use crate::report::headline::{headline, verdict};
use crate::report::{frontier, table};
use preshade_compiler::command::explain::EffectUse;
use preshade_draw::scene::Scene;

#[derive(Template)]
#[template(path = "html/verify.html")]
struct Page<'a> {
    shell: Shell,
    views: usize,
    headline: Option<String>,
    /// Names of the rows' cells.
    columns: [&'static str; 10],
    rows: Vec<Row>,
    by_view: ByView<'a>,
    notes: Vec<String>,
    sweeps: Vec<(String, String)>,
    sections: Vec<Section>,
    effects: &'a [EffectUse],
    assumed: Vec<(String, String)>,
}

/// A line of the table.
struct Row {
    section: Option<usize>,
    name: String,
    verdict: String,
    /// Class of the row: `broken`, or empty.
    kept: &'static str,
    speedup: String,
    strip: Option<Strip>,
    cells: [String; 10],
    chosen: bool,
}

struct ByView<'a> {
    columns: Vec<&'a str>,
    /// Cells, and whether they are beyond noise.
    rows: Vec<Vec<(String, &'static str)>>,
}

/// The page. `variants` are those of the report with known plans. `effects` are those of the
/// scene's materials, before draws were split into groups.
pub fn page(
    report: &Report,
    pictures: &[Pictures],
    variants: &[Variant],
    scene: &Scene,
    effects: &[EffectUse],
) -> Result<String, PageError> {
    let mut gallery = Gallery::default();
    let mut sections = Vec::new();
    let drawn = report.variants.iter().filter(|v| v.name != ORIGINAL);
    for (id, v) in drawn.enumerate() {
        let made = variants.iter().find(|m| m.name == v.name);
        let plans = made.map_or(&[][..], |m| &m.plans);
        sections.push(Section {
            diffs: diff::of(scene, plans),
            ..section(
                id,
                (&v.name, &v.recipe),
                Vec::new(),
                Some(v),
                pictures.iter().find(|p| p.name == v.name),
                Cameras::Every,
                &mut gallery,
            )?
        });
    }
    let views = report.variants.first().map_or(&[][..], |v| &v.by_view);
    let page = Page {
        shell: Shell {
            title: format!("{}: the original and its variants", report.scene),
            headline: headline(report),
            about: about(report),
            said: said(report),
            command: report.command.clone(),
            file: "report.json",
            data: data(report)?,
            gallery,
        },
        views: views.len(),
        headline: views.first().map(|v| {
            let order = preshade_draw::render::order::name(v.order);
            format!("camera {} {order}", v.camera)
        }),
        columns: [
            "ms",
            "changed px",
            "depths",
            "max abs",
            "FLIP",
            "shaded/px",
            "pipelines",
            "built in ms",
            "draw calls",
            "targets MB",
        ],
        rows: rows(report, &sections),
        by_view: by_view(report),
        // Warnings are printed above.
        notes: table::notes(report)
            .lines()
            .filter(|line| !line.starts_with("Warning: "))
            .map(str::to_owned)
            .collect(),
        sweeps: report
            .sweeps
            .iter()
            .map(|s| (s.recipe.clone(), s.table(report)))
            .collect(),
        sections,
        effects,
        assumed: report
            .assumed
            .iter()
            .map(|g| (g.name.clone(), g.guess.to_string()))
            .collect(),
    };
    Ok(plain(&page.render()?).into_owned())
}

fn about(report: &Report) -> String {
    let samples = match report.samples {
        1 => String::new(),
        n => format!(", {n} samples a pixel"),
    };
    format!(
        "{}x{}{samples}, on {}. {}",
        report.resolution[0],
        report.resolution[1],
        words::adapter(&report.adapter),
        words::clock(report.clock)
    )
}

/// The number of variants whose contracts hold, and warnings.
fn said(report: &Report) -> Vec<String> {
    let drawn = || report.variants.iter().filter(|v| v.name != ORIGINAL);
    let count = |is: fn(&Verdict) -> bool| drawn().filter(|v| is(&v.verdict)).count();
    let held = count(|v| matches!(v, Verdict::Holds));
    let broken = count(|v| matches!(v, Verdict::Broken { .. }));
    let open = count(|v| matches!(v, Verdict::NotMeasured { .. }));
    let mut parts = vec![format!(
        "{held} of {} keep what they promise",
        drawn().count()
    )];
    if broken > 0 {
        parts.push(match broken {
            1 => "1 breaks it".to_owned(),
            n => format!("{n} break it"),
        });
    }
    if open > 0 {
        parts.push(match open {
            1 => "1 was not measured".to_owned(),
            n => format!("{n} were not measured"),
        });
    }
    let mut said = vec![parts.join(", ") + "."];
    said.extend(report.warnings.iter().map(|w| format!("Warning: {w}.")));
    said.extend(report.notes.iter().map(|n| format!("Note: {n}.")));
    said
}

fn rows(report: &Report, sections: &[Section]) -> Vec<Row> {
    let scale = Scale::of(report.variants.iter().filter_map(|v| v.speedup.as_ref()));
    let chosen = report.chosen.as_ref().and_then(|c| match &c.choice {
        Choice::Within { variant, .. } => Some(variant),
        _ => None,
    });
    let row = |v: &VariantReport| {
        let error = v.error.as_ref();
        let cost = v.cost.as_ref();
        Row {
            section: sections.iter().find(|s| s.name == v.name).map(|s| s.id),
            name: v.name.clone(),
            verdict: verdict(report, v),
            kept: match v.verdict {
                Verdict::Broken { .. } => "broken",
                Verdict::Holds | Verdict::NotMeasured { .. } => "",
            },
            speedup: or_dash(v.speedup, frontier::speedup),
            strip: v.speedup.as_ref().map(|s| scale.strip(s)),
            cells: [
                or_dash(v.time_ms.as_ref(), |t| format!("{:.3}", t.estimate.median)),
                or_dash(error, |e| e.changed_pixels.to_string()),
                or_dash(error, |e| e.changed_depth.to_string()),
                or_dash(error, |e| frontier::number(e.max_abs)),
                or_dash(error, |e| frontier::number(e.flip_mean)),
                or_dash(v.shaded_per_pixel, |s| format!("{s:.2}")),
                or_dash(cost, |c| c.pipelines.to_string()),
                or_dash(cost.and_then(|c| c.creation_ms), |ms| format!("{ms:.1}")),
                or_dash(cost, |c| c.draw_calls.to_string()),
                or_dash(cost, |c| format!("{:.2}", c.target_bytes as f64 / 1e6)),
            ],
            chosen: chosen == Some(&v.name),
        }
    };
    report.variants.iter().map(row).collect()
}

fn by_view(report: &Report) -> ByView<'_> {
    let [original, variants @ ..] = report.variants.as_slice() else {
        return ByView {
            columns: Vec::new(),
            rows: Vec::new(),
        };
    };
    let timed = original.by_view.iter().enumerate();
    let rows = timed.filter_map(|(i, view)| {
        let time = view.time_ms.as_ref()?;
        let order = preshade_draw::render::order::name(view.order);
        let mut cells = vec![
            (format!("{} {}, {order}", view.camera, view.frame), ""),
            (or_dash(view.shaded_per_pixel, |s| format!("{s:.2}")), ""),
            (format!("{:.3}", time.estimate.median), ""),
        ];
        cells.extend(variants.iter().map(|v| {
            let speedup = v.by_view.get(i).and_then(|w| w.speedup);
            let class = match speedup {
                Some(s) if s.low > 1.0 => "faster",
                Some(s) if s.high < 1.0 => "slower",
                _ => "",
            };
            (or_dash(speedup, |s| format!("{:.2}x", s.median)), class)
        }));
        Some(cells)
    });
    ByView {
        columns: ["view", "shaded/px", "ms"]
            .into_iter()
            .chain(variants.iter().map(|v| v.name.as_str()))
            .collect(),
        rows: rows.collect(),
    }
}
