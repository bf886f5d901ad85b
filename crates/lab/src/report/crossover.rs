//! A series as a table, and as a picture.

use std::fmt::Write;

use super::grid::{self, escaped, or_dash};
use crate::measure::crossover::{Crossover, Series};
use preshade_plan::contract::Verdict;

/// The series as lines of text: a row a value, a column a variant, and the crossings.
pub fn render(series: &Series) -> String {
    let Some(first) = series.points.first() else {
        return String::new();
    };
    let report = &first.report;
    let place = super::place(&report.scene, None, report.resolution, 1, &report.adapter);
    let names = report.variants.iter().map(|v| v.name.as_str());
    let header = std::iter::once(series.variable.as_str()).chain(names);
    let mut rows = vec![grid::row(header)];
    for point in &series.points {
        let cells = point.report.variants.iter().map(|v| {
            let mark = match v.verdict {
                Verdict::Holds => "",
                Verdict::Broken { .. } => " BROKEN",
                Verdict::NotMeasured { .. } => " not measured",
            };
            let time = or_dash(v.time_ms.as_ref(), |time| {
                let e = time.estimate;
                format!("{:.3} ms [{:.3}, {:.3}]", e.median, e.low, e.high)
            });
            time + mark
        });
        let value = std::iter::once(point.value.to_string());
        rows.push(grid::row(value.chain(cells)));
    }
    let mut out = format!("{place}\n\n{}", grid::aligned(&rows, |_| false, false));
    if !series.crossovers.is_empty() {
        out.push('\n');
    }
    for crossover in &series.crossovers {
        let _ = writeln!(out, "{}", sentence(&series.variable, crossover));
    }
    out
}

/// The crossing of a pair of variants, in words.
fn sentence(variable: &str, c: &Crossover) -> String {
    let (first, second) = (&c.first, &c.second);
    let Some((_, begins)) = c.ratios.first() else {
        return String::new();
    };
    let faster = |ratio: f64| if ratio > 1.0 { second } else { first };
    if c.at.is_empty() {
        let range = c.ratios.iter().map(|(_, e)| e.median);
        let (low, high) = range.fold((f64::INFINITY, 0.0), |(l, h): (f64, f64), r| {
            (l.min(r), h.max(r))
        });
        let (low, high) = match begins.median > 1.0 {
            true => (low, high),
            false => (1.0 / high, 1.0 / low),
        };
        let other = if begins.median > 1.0 { first } else { second };
        return format!(
            "{} is faster than {other} throughout, {low:.2}x to {high:.2}x",
            faster(begins.median)
        );
    }
    let mut text = format!("{} is faster than {}", faster(begins.median), {
        if begins.median > 1.0 { first } else { second }
    });
    let mut ratio = begins.median;
    for crossing in &c.at {
        let end =
            |end: Option<f64>, open: &str| end.map_or(open.to_owned(), |v| format!("{:.0}", v));
        ratio = 1.0 / ratio;
        let interval = match (crossing.low, crossing.high) {
            (None, None) => "noise hides where".to_owned(),
            (low, high) => {
                let low = end(low, "below the series");
                format!("{low}, {}", end(high, "past the series"))
            }
        };
        let _ = write!(
            text,
            " up to {variable} = {:.0} [{interval}], {} beyond",
            crossing.value,
            faster(ratio)
        );
    }
    text
}

const WIDTH: f64 = 720.0;
const HEIGHT: f64 = 440.0;
const LEFT: f64 = 64.0;
const RIGHT: f64 = 24.0;
const TOP: f64 = 40.0;
const BOTTOM: f64 = 56.0;
const COLORS: [&str; 8] = [
    "#222222", "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8a6d00",
];

/// Logarithmic axes.
struct Axes {
    x: [f64; 2],
    y: [f64; 2],
}

impl Axes {
    fn at(&self, x: f64, y: f64) -> (f64, f64) {
        let part = |v: f64, [low, high]: [f64; 2]| (v.ln() - low) / (high - low).max(1e-9);
        (
            LEFT + part(x, self.x) * (WIDTH - LEFT - RIGHT),
            HEIGHT - BOTTOM - part(y, self.y) * (HEIGHT - TOP - BOTTOM),
        )
    }
}

/// Time against the variable as SVG: a line a variant with its intervals, and a mark at each
/// crossing. `None`: nothing was timed.
pub fn svg(series: &Series) -> Option<String> {
    let report = &series.points.first()?.report;
    let lines: Vec<(&str, Vec<(f64, crate::measure::Estimate)>)> = report
        .variants
        .iter()
        .map(|v| {
            let times = series.points.iter().filter_map(|p| {
                let same = p.report.variants.iter().find(|w| w.name == v.name)?;
                Some((f64::from(p.value), same.time_ms.as_ref()?.estimate))
            });
            (v.name.as_str(), times.collect())
        })
        .collect();
    let all = || lines.iter().flat_map(|(_, points)| points);
    let range = |values: &mut dyn Iterator<Item = f64>| {
        values
            .filter(|v| *v > 0.0)
            .fold(None, |r: Option<[f64; 2]>, v| {
                let [low, high] = r.unwrap_or([v, v]);
                Some([low.min(v), high.max(v)])
            })
    };
    let x = range(&mut all().map(|(x, _)| *x))?;
    let y = range(&mut all().flat_map(|(_, e)| [e.low, e.high]))?;
    let axes = Axes {
        x: x.map(f64::ln),
        y: [(y[0] * 0.8).ln(), (y[1] * 1.25).ln()],
    };
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" \
         font-family=\"sans-serif\" font-size=\"12\">\n\
         <rect width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"#ffffff\"/>\n\
         <text x=\"{LEFT}\" y=\"22\" font-size=\"14\">{}</text>\n",
        escaped(&format!(
            "{}, {}x{}, {}",
            report.scene,
            report.resolution[0],
            report.resolution[1],
            report.adapter.title()
        ))
    );
    grid(&mut out, series, &axes);
    for (i, (name, points)) in lines.iter().enumerate() {
        curve(&mut out, &axes, i, name, points);
    }
    for crossover in &series.crossovers {
        let line = lines.iter().find(|(name, _)| *name == crossover.first);
        for crossing in &crossover.at {
            let Some(ms) = line.and_then(|(_, points)| interpolated(points, crossing.value)) else {
                continue;
            };
            let (x, y) = axes.at(crossing.value, ms);
            let _ = writeln!(
                out,
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"5\" fill=\"none\" \
                 stroke=\"#000000\"><title>{}</title></circle>",
                escaped(&sentence(&series.variable, crossover))
            );
        }
    }
    out.push_str("</svg>\n");
    Some(out)
}

/// The lines of the axes and their words.
fn grid(out: &mut String, series: &Series, axes: &Axes) {
    for point in &series.points {
        let (x, bottom) = axes.at(f64::from(point.value), axes.y[0].exp());
        let _ = writeln!(
            out,
            "<line x1=\"{x:.1}\" y1=\"{TOP}\" x2=\"{x:.1}\" y2=\"{bottom:.1}\" stroke=\"#dddddd\"/>\
             <text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
            bottom + 16.0,
            point.value
        );
    }
    for tick in ticks(axes.y) {
        let (left, y) = axes.at(axes.x[0].exp(), tick);
        let _ = writeln!(
            out,
            "<line x1=\"{left:.1}\" y1=\"{y:.1}\" x2=\"{:.1}\" y2=\"{y:.1}\" stroke=\"#dddddd\"/>\
             <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{tick}</text>",
            WIDTH - RIGHT,
            left - 6.0,
            y + 4.0
        );
    }
    let _ = writeln!(
        out,
        "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>\
         <text x=\"16\" y=\"{:.1}\" transform=\"rotate(-90 16 {:.1})\" text-anchor=\"middle\">ms a \
          frame</text>",
        (LEFT + WIDTH - RIGHT) / 2.0,
        HEIGHT - 12.0,
        escaped(&series.variable),
        HEIGHT / 2.0,
        HEIGHT / 2.0
    );
}

/// The times of the variant `i`: a line with its intervals, and its line of the legend.
fn curve(
    out: &mut String,
    axes: &Axes,
    i: usize,
    name: &str,
    points: &[(f64, crate::measure::Estimate)],
) {
    let color = COLORS[i % COLORS.len()];
    let path: Vec<String> = points
        .iter()
        .map(|(x, e)| {
            let (x, y) = axes.at(*x, e.median);
            format!("{x:.1},{y:.1}")
        })
        .collect();
    let _ = writeln!(
        out,
        "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"2\"/>",
        path.join(" ")
    );
    for (x, e) in points {
        let ((x, low), (_, high)) = (axes.at(*x, e.low), axes.at(*x, e.high));
        let _ = writeln!(
            out,
            "<line x1=\"{x:.1}\" y1=\"{low:.1}\" x2=\"{x:.1}\" y2=\"{high:.1}\" \
             stroke=\"{color}\" stroke-width=\"4\"/>"
        );
    }
    let y = TOP + 14.0 + 16.0 * i as f64;
    let _ = writeln!(
        out,
        "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"12\" height=\"4\" fill=\"{color}\"/><text \
         x=\"{:.1}\" y=\"{:.1}\">{}</text>",
        LEFT + 12.0,
        y - 6.0,
        LEFT + 30.0,
        y,
        escaped(name)
    );
}

/// The median at a value between two measured ones, in logarithms.
fn interpolated(points: &[(f64, crate::measure::Estimate)], at: f64) -> Option<f64> {
    points.windows(2).find_map(|pair| {
        let [(n, a), (m, b)] = pair else { return None };
        let part = (at.ln() - n.ln()) / (m.ln() - n.ln());
        (0.0..=1.0)
            .contains(&part)
            .then(|| (a.median.ln() + (b.median.ln() - a.median.ln()) * part).exp())
    })
}

/// 1, 2 and 5 times the powers of ten in a range of logarithms.
fn ticks([low, high]: [f64; 2]) -> Vec<f64> {
    let (low, high) = (low.exp(), high.exp());
    let mut ticks = Vec::new();
    for power in -4..6 {
        for digit in [1.0, 2.0, 5.0] {
            let tick: f64 = digit * 10_f64.powi(power);
            if (low..=high).contains(&tick) {
                // The zeros before the first digit.
                ticks.push((tick * 1e6).round() / 1e6);
            }
        }
    }
    ticks
}
