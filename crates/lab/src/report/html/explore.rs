//! An exploration: the frontier as a chart and a table, the finalists with their pictures, and the
//! result of every candidate.

use askama::Template;
use preshade_plan::pass::Frequency;

use super::frontier_chart::{self, Chart};
use super::section::{Cameras, Section, section};
use super::words::{self, or_dash};
use super::{Gallery, PageError, Shell, data, diff};
use crate::measure::record::{Choice, VariantReport};
use crate::report::control_characters::plain;
use crate::report::frontier;
use crate::search::explore::{Exploration, Explored, Point};
use preshade_compiler::command::explain::EffectUse;
use preshade_draw::scene::Scene;

#[derive(Template)]
#[template(path = "html/explore.html")]
struct Page<'a> {
    shell: Shell,
    metric: String,
    chart: Option<Chart>,
    size: [f64; 2],
    /// Names of the rows' cells.
    columns: [String; 9],
    rows: Vec<Row>,
    sections: Vec<Section>,
    effects: &'a [EffectUse],
    values: Vec<ValueRow>,
    values_left: usize,
    candidates: Vec<(String, String)>,
}

/// A line of the table.
struct Row {
    section: Option<usize>,
    name: String,
    cells: [String; 9],
    chosen: bool,
}

/// The savings and the error of a value of a fragment stage.
struct ValueRow {
    name: String,
    place: String,
    saved: String,
    error: String,
    max_abs: String,
}

/// Most values that are listed; the data has them all.
const MOST_VALUES: usize = 40;

/// The page. `effects` are those of the scene's materials, before draws were split into groups.
pub fn page(found: &Explored, scene: &Scene, effects: &[EffectUse]) -> Result<String, PageError> {
    let exploration = &found.exploration;
    let report = exploration.report.as_ref();
    let variants = report.map_or(&[][..], |r| &r.variants);
    let points: Vec<&Point> = found
        .variants
        .iter()
        .filter_map(|v| exploration.points.iter().find(|p| p.name == v.name))
        .collect();
    let mut gallery = Gallery::default();
    let mut sections = Vec::new();
    for (id, point) in points.iter().enumerate() {
        let plans = found.variants.get(id).map_or(&[][..], |v| &v.plans);
        sections.push(Section {
            diffs: diff::of(scene, plans),
            ..section(
                id,
                (&point.name, &point.recipe),
                vec![("standing", frontier::fate(point))],
                variants.iter().find(|v| v.name == point.name),
                found.pictures.iter().find(|p| p.name == point.name),
                Cameras::First,
                &mut gallery,
            )?
        });
    }
    let chosen = exploration.chosen.as_ref();
    let chosen_name = chosen.and_then(|c| match &c.choice {
        Choice::Within { variant, .. } => Some(variant.as_str()),
        _ => None,
    });
    let rows = frontier::on_frontier(exploration)
        .map(|p| {
            let variant = variants.iter().find(|v| v.name == p.name);
            row(exploration, p, variant, &points, chosen_name)
        })
        .collect();
    let mut frequencies: Vec<&Frequency> = exploration.frequencies.iter().collect();
    frequencies.sort_by(|a, b| {
        let error = |f: &Frequency| exploration.metric.of(f);
        error(a)
            .total_cmp(&error(b))
            .then(b.cost.total_cmp(&a.cost))
    });
    let title = format!("{}: what accuracy costs in time", exploration.scene);
    let metric = frontier::metric(exploration);
    let page = Page {
        shell: Shell {
            headline: title.clone(),
            title,
            about: format!(
                "{}x{}, drawn {}, on {}. {}",
                exploration.resolution[0],
                exploration.resolution[1],
                preshade_draw::render::order::name(exploration.order),
                words::adapter(&exploration.adapter),
                frontier::ended(exploration)
            ),
            said: frontier::said(exploration),
            command: exploration.command.clone(),
            file: "report.json",
            data: data(exploration)?,
            gallery,
        },
        chart: frontier_chart::chart(exploration, &points),
        size: frontier_chart::SIZE,
        columns: [
            &metric,
            "max abs",
            "ms",
            "ms on the path, p95",
            "speedup [95 %]",
            "shaded/px",
            "pipelines",
            "built in ms",
            "targets MB",
        ]
        .map(str::to_owned),
        metric,
        rows,
        sections,
        effects,
        values_left: frequencies.len().saturating_sub(MOST_VALUES),
        values: frequencies
            .into_iter()
            .take(MOST_VALUES)
            .map(|f| value(exploration, f))
            .collect(),
        candidates: exploration.points[1..]
            .iter()
            .map(|p| (p.name.clone(), frontier::fate(p)))
            .collect(),
    };
    Ok(plain(&page.render()?).into_owned())
}

fn value(found: &Exploration, f: &Frequency) -> ValueRow {
    ValueRow {
        name: f.name.clone(),
        place: f.location.as_ref().map_or_else(String::new, |l| {
            format!("{}:{}:{}", l.file, l.line, l.column)
        }),
        saved: format!("{:.0}", f.cost),
        error: frontier::number(found.metric.of(f)),
        max_abs: frontier::number(f.max_abs),
    }
}

fn row(
    found: &Exploration,
    point: &Point,
    variant: Option<&VariantReport>,
    sections: &[&Point],
    chosen: Option<&str>,
) -> Row {
    let error = point.error.as_ref();
    let cost = variant.and_then(|v| v.cost.as_ref());
    let time = variant
        .and_then(|v| v.time_ms.as_ref())
        .map(|t| t.estimate)
        .or(point.time_ms);
    let of = |e| found.metric.of(e);
    Row {
        section: sections.iter().position(|p| p.name == point.name),
        name: point.name.clone(),
        cells: [
            or_dash(error, |e| frontier::number(of(e))),
            or_dash(error, |e| frontier::number(e.max_abs)),
            or_dash(time, |t| format!("{:.3}", t.median)),
            or_dash(point.path.as_ref(), frontier::path),
            or_dash(point.speedup, frontier::speedup),
            or_dash(variant.and_then(|v| v.shaded_per_pixel), |s| {
                format!("{s:.2}")
            }),
            or_dash(cost, |c| c.pipelines.to_string()),
            or_dash(cost.and_then(|c| c.creation_ms), |ms| format!("{ms:.1}")),
            or_dash(cost, |c| format!("{:.2}", c.target_bytes as f64 / 1e6)),
        ],
        chosen: chosen == Some(&point.name),
    }
}
