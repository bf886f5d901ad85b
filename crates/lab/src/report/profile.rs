//! A profile for a terminal and for a spreadsheet.

use super::grid::{Csv, number, or_dash, quoted};
use crate::measure::Estimate;
use crate::measure::profile::{Profile, ViewProfile};

/// The profile as lines of text.
pub fn render(of: &Profile) -> String {
    let part = of.part.as_deref();
    let mut lines = vec![super::place(&of.scene, part, of.resolution, 1, &of.adapter)];
    lines.extend(of.views.iter().flat_map(view));
    lines.join("\n")
}

fn view(of: &ViewProfile) -> Vec<String> {
    let mut lines = vec![format!("\n{}: {:.3} ms", of.view, of.time_ms.median)];
    lines.push(match (of.bound_by(), of.kept.is_empty()) {
        (Some((what, part)), true) => format!("  bound by {what}: {}", interval(part)),
        (Some((what, part)), false) => format!(
            "  of what could be left out, {what} is the largest part: {}",
            interval(part)
        ),
        (None, _) => "  nothing takes a part of the time that can be told from noise".to_owned(),
    });
    lines.extend(of.kept.iter().map(|material| {
        format!("  fragments of `{material}` could not all be left out: no part has their time")
    }));
    let frame = [
        ("the pass and its draw calls", of.draws),
        ("vertices", of.vertices),
    ];
    let frame = frame.map(|(what, part)| format!("{what} {}", percent(part)));
    lines.push(format!("  {}", frame.join(", ")));
    let names = of.materials.iter().map(|m| m.material.chars().count());
    let width = names.max().unwrap_or(0).max("material".len());
    lines.push(format!(
        "  {:<width$}  draws  fragments  arithmetic  textures  fill  discards",
        "material"
    ));
    lines.extend(of.materials.iter().map(|m| {
        format!(
            "  {:<width$}  {:>5}  {:>9}  {:>10}  {:>8}  {:>4}  {:>8}",
            m.material,
            m.draws,
            percent(Some(m.fragments)),
            percent(m.arithmetic),
            percent(m.textures),
            percent(m.fill),
            percent(m.coverage)
        )
    }));
    lines
}

/// A part in percent, `-` if it was not measured.
fn percent(part: Option<Estimate>) -> String {
    or_dash(part, |p| format!("{:.0} %", p.median.max(0.0) * 100.0))
}

fn interval(part: Estimate) -> String {
    let [low, high] = [part.low, part.high].map(|p| p.max(0.0) * 100.0);
    format!("{:.0} % [{low:.0}, {high:.0}]", part.median * 100.0)
}

/// One line a view and material. Parts are from 0 to 1.
pub fn csv(of: &Profile) -> String {
    let mut csv = Csv::new(
        "view,ms,draw_calls,vertices,material,draws,fragments,arithmetic,textures,fill,discards",
    );
    let cell = |part: Option<Estimate>| number(part.map(|p| p.median));
    for v in &of.views {
        for m in &v.materials {
            csv.line([
                quoted(&v.view.to_string()),
                v.time_ms.median.to_string(),
                cell(v.draws),
                cell(v.vertices),
                quoted(&m.material),
                m.draws.to_string(),
                m.fragments.median.to_string(),
                cell(m.arithmetic),
                cell(m.textures),
                cell(m.fill),
                cell(m.coverage),
            ]);
        }
    }
    csv.text()
}
