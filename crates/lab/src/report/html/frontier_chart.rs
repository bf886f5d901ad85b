//! The frontier as an SVG picture: error to the right, speedup upwards, intervals as whiskers.

use crate::report::frontier;
use crate::search::explore::{Exploration, Fate, Point};

/// Width and height in SVG's units, and the margins for labels.
pub(crate) const SIZE: [f64; 2] = [860.0, 420.0];
const LEFT: f64 = 56.0;
const RIGHT: f64 = 16.0;
const TOP: f64 = 16.0;
const BOTTOM: f64 = 46.0;

/// Width of the column of errors that are nothing: a logarithm has no place for them.
const ZERO: f64 = 100.0;

pub(crate) struct Chart {
    /// Points, the frontier last, so that it is drawn over the others.
    pub dots: Vec<Dot>,
    /// The frontier as steps: SVG's path data.
    pub steps: String,
    pub rows: Vec<Tick>,
    /// Places along the bottom with their label.
    pub columns: Vec<Tick>,
    pub budget: Option<f64>,
    /// Height of a speedup of 1.
    pub even: f64,
}

/// A line of the grid.
pub(crate) struct Tick {
    pub at: f64,
    pub label: String,
}

/// A candidate in the chart.
pub(crate) struct Dot {
    pub x: f64,
    pub y: f64,
    /// Height of the interval's ends.
    pub low: f64,
    /// Height of the interval's ends.
    pub high: f64,
    /// Whether no other beats it.
    pub frontier: bool,
    pub told: String,
    /// Number of its section; `None`: it has none.
    pub section: Option<usize>,
}

/// Maps measurements to the picture. `None`: there are none.
pub(crate) fn chart(found: &Exploration, sections: &[&Point]) -> Option<Chart> {
    let error = |p: &Point| Some(found.metric.of(p.error.as_ref()?));
    let measured: Vec<(&Point, f64, crate::measure::Estimate)> = found
        .points
        .iter()
        .filter_map(|p| Some((p, error(p).filter(|e| e.is_finite())?, p.speedup?)))
        .collect();
    if measured.len() < 2 {
        return None;
    }
    let errors = || measured.iter().map(|m| m.1).filter(|e| *e > 0.0);
    let budget = found.chosen.as_ref().map(|c| c.budget.limit);
    let least = errors().chain(budget).fold(f64::INFINITY, f64::min);
    let most = errors().chain(budget).fold(0.0, f64::max);
    let decades = match least.is_finite() {
        true => (
            least.log10().floor(),
            most.log10().ceil().max(least.log10().floor() + 1.0),
        ),
        false => (-3.0, 0.0),
    };
    let top = measured.iter().map(|m| m.2.high).fold(1.2, f64::max) * 1.06;
    let (w, h) = (SIZE[0] - LEFT - RIGHT - ZERO, SIZE[1] - TOP - BOTTOM);
    let x = |e: f64| match e > 0.0 {
        true => tenths(LEFT + ZERO + w * (e.log10() - decades.0) / (decades.1 - decades.0)),
        false => tenths(LEFT + ZERO / 2.0),
    };
    let y = |s: f64| tenths(TOP + h * (1.0 - s / top));
    let mut dots: Vec<Dot> = measured
        .iter()
        .map(|(p, e, s)| Dot {
            x: x(*e),
            y: y(s.median),
            low: y(s.low),
            high: y(s.high),
            frontier: p.fate == Fate::Frontier,
            told: told(found, p),
            section: sections.iter().position(|q| q.name == p.name),
        })
        .collect();
    dots.sort_by_key(|d| d.frontier);
    let mut on: Vec<&Dot> = dots.iter().filter(|d| d.frontier).collect();
    on.sort_by(|a, b| a.x.total_cmp(&b.x).then(b.y.total_cmp(&a.y)));
    let mut steps = String::new();
    let mut best = f64::INFINITY;
    for dot in on.iter().filter(|d| {
        let rises = d.y < best;
        best = best.min(d.y);
        rises
    }) {
        steps.push_str(&match steps.is_empty() {
            true => format!("M{:.1} {:.1}", dot.x, dot.y),
            false => format!("H{:.1}V{:.1}", dot.x, dot.y),
        });
    }
    if !steps.is_empty() {
        steps.push_str(&format!("H{:.1}", SIZE[0] - RIGHT));
    }
    let step = step(top);
    Some(Chart {
        steps,
        rows: (0..)
            .map(|i| f64::from(i) * step)
            .take_while(|s| *s <= top)
            .map(|s| Tick {
                at: y(s),
                label: format!("{}x", short(s)),
            })
            .collect(),
        columns: std::iter::once(Tick {
            at: x(0.0),
            label: "none".to_owned(),
        })
        .chain((decades.0 as i32..=decades.1 as i32).map(|d| Tick {
            at: x(10_f64.powi(d)),
            label: short(10_f64.powi(d)),
        }))
        .collect(),
        budget: budget.map(x),
        even: y(1.0),
        dots,
    })
}

/// A coordinate in few digits.
fn tenths(at: f64) -> f64 {
    (at * 10.0).round() / 10.0
}

/// A round step that fits four to ten times.
fn step(top: f64) -> f64 {
    let decade = 10_f64.powf((top / 4.0).log10().floor());
    let fits = |f: &f64| top / (f * decade) >= 4.0;
    [5.0, 2.0, 1.0].into_iter().find(fits).unwrap_or(1.0) * decade
}

fn short(value: f64) -> String {
    let text = format!("{value:.6}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// The tooltip of a point.
fn told(found: &Exploration, point: &Point) -> String {
    let metric = frontier::metric(found);
    let error = point.error.as_ref().map_or(0.0, |e| found.metric.of(e));
    let time = point
        .time_ms
        .map(|t| format!("{:.3} ms [{:.3}, {:.3}], ", t.median, t.low, t.high));
    let speedup = point.speedup.map(frontier::speedup);
    format!(
        "{}: {metric} {}, {}{}; {}",
        point.name,
        frontier::number(error),
        time.unwrap_or_default(),
        speedup.unwrap_or_default(),
        frontier::fate(point),
    )
}
