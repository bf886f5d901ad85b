//! An exploration as one HTML file: no network, no scripts but its own, readable without them.

mod chart;
mod diff;

use askama::Template;
use base64::Engine;
use preshade_passes::contract::{Contract, Verdict};

use super::picture::Picture;
use super::{Pictures, VariantReport, frontier, sheet};
use crate::frontier::explore::Found;
use crate::frontier::{Exploration, Point};
use crate::measure::EffectUse;
use crate::scene::Scene;
use chart::Chart;
use diff::Diff;

/// Why a page could not be made.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The template.
    #[error("the report could not be written: {0}")]
    Template(#[from] askama::Error),
    /// A picture.
    #[error("a picture could not be encoded: {0}")]
    Picture(#[from] image::ImageError),
    /// The data.
    #[error("the figures could not be written: {0}")]
    Json(#[from] serde_json::Error),
}

#[derive(Template)]
#[template(path = "explore.html")]
struct Page<'a> {
    found: &'a Exploration,
    metric: String,
    order: &'static str,
    ended: String,
    chosen: Option<String>,
    chart: Option<Chart>,
    size: [f64; 2],
    rows: Vec<Row>,
    sections: Vec<Section>,
    original: Option<String>,
    aspect: String,
    effects: &'a [EffectUse],
    values: Vec<Value>,
    values_left: usize,
    candidates: Vec<(String, String)>,
    /// JSON with nothing in it that ends a script.
    data: String,
}

/// A line of the table.
struct Row {
    section: Option<usize>,
    name: String,
    cells: Vec<String>,
    chosen: bool,
}

/// A finalist.
struct Section {
    id: usize,
    name: String,
    recipe: String,
    fate: String,
    contract: String,
    verdict: String,
    variant: Option<String>,
    flip: Option<String>,
    before: Option<String>,
    after: Option<String>,
    kept: Vec<(String, String)>,
    diffs: Vec<Diff>,
    samples: String,
}

/// What a value of a fragment stage would save and do.
struct Value {
    name: String,
    place: String,
    saved: String,
    error: String,
    max_abs: String,
}

/// Most values that are listed; the data has them all.
const MOST_VALUES: usize = 40;

/// The page. `effects` are those of the scene's materials, before draws were told apart.
///
/// # Errors
/// None that these types can give, but for a picture that cannot be encoded.
pub fn page(found: &Found, scene: &Scene, effects: &[EffectUse]) -> Result<String, Error> {
    let exploration = &found.exploration;
    let report = exploration.report.as_ref();
    let variants = report.map_or(&[][..], |r| &r.variants);
    let points: Vec<&Point> = found
        .variants
        .iter()
        .filter_map(|v| exploration.points.iter().find(|p| p.name == v.name))
        .collect();
    let mut sections = Vec::new();
    for (id, point) in points.iter().enumerate() {
        let variant = variants.iter().find(|v| v.name == point.name);
        let pictures = found.pictures.iter().find(|p| p.name == point.name);
        let plans = found.variants.get(id).map_or(&[][..], |v| &v.plans);
        sections.push(section(
            id,
            point,
            variant,
            pictures,
            diff::of(scene, plans),
        )?);
    }
    let chosen = exploration.chosen.as_ref();
    let chosen_name = chosen.and_then(|c| match &c.choice {
        super::Choice::Within { variant, .. } => Some(variant.as_str()),
        _ => None,
    });
    let rows = frontier::on_frontier(exploration)
        .map(|p| {
            let variant = variants.iter().find(|v| v.name == p.name);
            row(exploration, p, variant, &points, chosen_name)
        })
        .collect();
    let original = found.pictures.first().map(|p| &p.original);
    let [w, h] = original.map_or(exploration.resolution, |p| p.size);
    let mut frequencies: Vec<_> = exploration.frequencies.iter().collect();
    frequencies.sort_by(|a, b| {
        let error = |f: &preshade_passes::pass::Frequency| exploration.metric.of(f);
        error(a)
            .total_cmp(&error(b))
            .then(b.cost.total_cmp(&a.cost))
    });
    let page = Page {
        metric: frontier::metric(exploration),
        order: crate::render::order::name(exploration.order),
        ended: frontier::ended(exploration),
        chosen: chosen.map(super::Chosen::said),
        chart: chart::chart(exploration, &points),
        size: chart::SIZE,
        rows,
        sections,
        original: original.map(data_uri).transpose()?,
        aspect: format!("{w} / {h}"),
        effects,
        values_left: frequencies.len().saturating_sub(MOST_VALUES),
        values: frequencies
            .into_iter()
            .take(MOST_VALUES)
            .map(|f| Value {
                name: f.name.clone(),
                place: f.location.as_ref().map_or_else(String::new, |l| {
                    format!("{}:{}:{}", l.file, l.line, l.column)
                }),
                saved: format!("{:.0}", f.cost),
                error: frontier::number(exploration.metric.of(f)),
                max_abs: frontier::number(f.max_abs),
            })
            .collect(),
        candidates: exploration.points[1..]
            .iter()
            .map(|p| (p.name.clone(), frontier::fate(p)))
            .collect(),
        data: serde_json::to_string(exploration)?.replace('<', "\\u003c"),
        found: exploration,
    };
    Ok(page.render()?)
}

fn row(
    found: &Exploration,
    point: &Point,
    variant: Option<&VariantReport>,
    sections: &[&Point],
    chosen: Option<&str>,
) -> Row {
    let dash = || "–".to_owned();
    let error = point.error.as_ref();
    let number = |n: Option<f64>| n.map_or_else(dash, frontier::number);
    let cost = variant.and_then(|v| v.cost.as_ref());
    let time = variant
        .and_then(|v| v.time_ms.as_ref())
        .map(|t| t.estimate)
        .or(point.time_ms);
    Row {
        section: sections.iter().position(|p| p.name == point.name),
        name: point.name.clone(),
        cells: vec![
            number(error.map(|e| crate::frontier::explore::of(found.metric, e))),
            number(error.map(|e| e.max_abs)),
            time.map_or_else(dash, |t| format!("{:.3}", t.median)),
            point.path.as_ref().map_or_else(dash, frontier::path),
            point.speedup.map_or_else(dash, frontier::speedup),
            variant
                .and_then(|v| v.shaded_per_pixel)
                .map_or_else(dash, |s| format!("{s:.2}")),
            cost.map_or_else(dash, |c| c.pipelines.to_string()),
            cost.map_or_else(dash, |c| format!("{:.1}", c.creation_ms)),
            cost.map_or_else(dash, |c| format!("{:.2}", c.target_bytes as f64 / 1e6)),
        ],
        chosen: chosen == Some(&point.name),
    }
}

fn section(
    id: usize,
    point: &Point,
    variant: Option<&VariantReport>,
    pictures: Option<&Pictures>,
    diffs: Vec<Diff>,
) -> Result<Section, Error> {
    let picture = |p: Option<Picture>| p.as_ref().map(data_uri).transpose();
    let scale = pictures.map_or(sheet::LEAST_SCALE, Pictures::overdraw_scale);
    let overdraw =
        |shading: Option<&crate::measure::Shading>| shading.map(|s| sheet::overdraw(s, scale));
    Ok(Section {
        id,
        name: point.name.clone(),
        recipe: point.recipe.clone(),
        fate: frontier::fate(point),
        contract: variant.map_or_else(String::new, |v| contract(&v.contract)),
        verdict: variant.map_or_else(String::new, |v| match &v.verdict {
            Verdict::Holds => "holds in every view".to_owned(),
            Verdict::Broken { r#where } => format!("broken: {where}"),
            Verdict::NotMeasured { why } => format!("not measured: {why}"),
        }),
        variant: picture(pictures.map(|p| p.variant.clone()))?,
        flip: picture(pictures.map(Pictures::flip))?,
        before: picture(overdraw(pictures.and_then(|p| p.overdraw_before.as_ref())))?,
        after: picture(overdraw(pictures.and_then(|p| p.overdraw_after.as_ref())))?,
        kept: variant.map_or_else(Vec::new, |v| {
            let kept = v.kept.iter();
            kept.map(|k| (k.material.clone(), k.why.clone())).collect()
        }),
        diffs,
        samples: variant
            .and_then(|v| v.time_ms.as_ref())
            .map_or_else(String::new, |t| {
                let samples: Vec<String> = t.samples.iter().map(|s| format!("{s:.4}")).collect();
                samples.join(" ")
            }),
    })
}

/// A contract in words.
fn contract(contract: &Contract) -> String {
    let promise = match contract {
        Contract::Exact { .. } => "the same bits".to_owned(),
        Contract::Rounding { k, turned, .. } => match turned {
            None => format!("within {k} roundings"),
            Some(turned) => format!("within {k} roundings, {turned}"),
        },
        Contract::Approximate { .. } | Contract::Budgets { .. } => {
            let budgets: Vec<String> = contract.budgets().iter().map(ToString::to_string).collect();
            budgets.join(", ")
        }
    };
    let given: Vec<String> = contract
        .given()
        .iter()
        .filter_map(|a| Some(serde_json::to_value(a).ok()?.as_str()?.to_owned()))
        .collect();
    match given.is_empty() {
        true => promise,
        false => format!("{promise}, given {}", given.join(", ")),
    }
}

/// A picture as the text of a URL.
fn data_uri(picture: &Picture) -> Result<String, Error> {
    let bytes = sheet::opaque(picture.clone()).file("")?.bytes;
    let text = base64::engine::general_purpose::STANDARD.encode(bytes);
    Ok(format!("data:image/png;base64,{text}"))
}
