//! Line charts as SVG: a few panels with one legend.

use std::fmt::Write;

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Panel {
    /// Name of the quantity, with its unit.
    pub title: String,
    /// Lines whose points have rising x.
    pub lines: Vec<Line>,
    /// A marked height across the chart, for example a budget.
    pub mark: Option<Mark>,
}

/// A height and its label.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Mark {
    pub height: f64,
    /// One word.
    pub name: &'static str,
}

/// One line of a chart.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Line {
    /// Name in the legend: lines of one name have one colour in all panels.
    pub name: String,
    /// Points, without those that were not measured.
    pub points: Vec<(f64, f64)>,
}

/// Line colours by Okabe and Ito, also distinct for colour-blind readers.
const COLORS: [&str; 7] = [
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000",
];

/// Pixels of a panel, and the margins for labels.
const WIDTH: f64 = 400.0;
const HEIGHT: f64 = 250.0;
const LEFT: f64 = 64.0;
const RIGHT: f64 = 12.0;
const TOP: f64 = 30.0;
const BOTTOM: f64 = 36.0;
const COLUMNS: usize = 2;
const HEADER: f64 = 44.0;

/// The panels as an SVG file, two in a row, under a title. The x axis has whole numbers. The y axis
/// is logarithmic if all values are positive and span more than a factor of ten; otherwise it
/// starts at 0.
pub(crate) fn svg(title: &str, x_label: &str, panels: &[Panel]) -> String {
    let mut names: Vec<&str> = Vec::new();
    for line in panels.iter().flat_map(|p| &p.lines) {
        if !names.contains(&line.name.as_str()) {
            names.push(&line.name);
        }
    }
    let rows = panels.len().div_ceil(COLUMNS);
    let legend = 18.0 * names.len() as f64;
    let (width, height) = (
        WIDTH * COLUMNS as f64,
        HEADER + HEIGHT * rows as f64 + legend + 10.0,
    );
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" font-size=\"12\">\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"#ffffff\"/>\n"
    );
    text(&mut out, (LEFT, 24.0), "start", title);
    for (i, panel) in panels.iter().enumerate() {
        let x = WIDTH * (i % COLUMNS) as f64;
        let y = HEADER + HEIGHT * (i / COLUMNS) as f64;
        let _ = writeln!(out, "<g transform=\"translate({x} {y})\">");
        draw(&mut out, panel, x_label, &names);
        out.push_str("</g>\n");
    }
    let top = HEADER + HEIGHT * rows as f64;
    for (i, name) in names.iter().enumerate() {
        let y = top + 18.0 * i as f64 + 9.0;
        let color = color(&names, name);
        let _ = writeln!(
            out,
            "<line x1=\"{LEFT}\" y1=\"{y}\" x2=\"{}\" y2=\"{y}\" stroke=\"{color}\" \
             stroke-width=\"2\"/>",
            LEFT + 24.0
        );
        text(&mut out, (LEFT + 32.0, y + 4.0), "start", name);
    }
    out.push_str("</svg>\n");
    out
}

fn color(names: &[&str], name: &str) -> &'static str {
    let index = names.iter().position(|n| *n == name).unwrap_or_default();
    COLORS[index % COLORS.len()]
}

fn draw(out: &mut String, panel: &Panel, x_label: &str, names: &[&str]) {
    text(out, (LEFT, TOP - 10.0), "start", &panel.title);
    let points = || panel.lines.iter().flat_map(|l| &l.points);
    let xs = Scale::linear(points().map(|p| p.0));
    let heights = points().map(|p| p.1).chain(panel.mark.map(|m| m.height));
    let (Some(xs), Some(ys)) = (xs, Scale::heights(heights)) else {
        text(out, (LEFT, HEIGHT / 2.0), "start", "not measured");
        return;
    };
    let (w, h) = (WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM);
    let x = |v: f64| LEFT + w * xs.at(v);
    let y = |v: f64| TOP + h * (1.0 - ys.at(v));
    for tick in ys.ticks() {
        let at = y(tick);
        let _ = writeln!(
            out,
            "<line x1=\"{LEFT}\" y1=\"{at:.1}\" x2=\"{:.1}\" y2=\"{at:.1}\" stroke=\"#dddddd\"/>",
            LEFT + w
        );
        text(out, (LEFT - 6.0, at + 4.0), "end", &number(tick));
    }
    // The x axis has whole numbers.
    for tick in xs.ticks().into_iter().filter(|t| t.fract() == 0.0) {
        text(out, (x(tick), TOP + h + 16.0), "middle", &number(tick));
    }
    text(out, (LEFT + w / 2.0, TOP + h + 31.0), "middle", x_label);
    let _ = writeln!(
        out,
        "<rect x=\"{LEFT}\" y=\"{TOP}\" width=\"{w}\" height=\"{h}\" fill=\"none\" \
         stroke=\"#888888\"/>"
    );
    if let Some(mark) = panel.mark {
        let at = y(mark.height);
        let _ = writeln!(
            out,
            "<line x1=\"{LEFT}\" y1=\"{at:.1}\" x2=\"{:.1}\" y2=\"{at:.1}\" stroke=\"#444444\" \
             stroke-dasharray=\"5 4\"/>",
            LEFT + w
        );
        // Above the line, or below where there is no room.
        let beside = if at < TOP + 14.0 { at + 13.0 } else { at - 4.0 };
        text(out, (LEFT + w - 4.0, beside), "end", mark.name);
    }
    for line in &panel.lines {
        let color = color(names, &line.name);
        let all: Vec<String> = line
            .points
            .iter()
            .map(|p| format!("{:.1},{:.1}", x(p.0), y(p.1)))
            .collect();
        let _ = writeln!(
            out,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"2\"/>",
            all.join(" ")
        );
        for point in &line.points {
            let _ = writeln!(
                out,
                "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"3\" fill=\"{color}\"/>",
                x(point.0),
                y(point.1)
            );
        }
    }
}

fn text(out: &mut String, (x, y): (f64, f64), anchor: &str, text: &str) {
    let escaped = super::grid::escaped(text);
    let _ = writeln!(
        out,
        "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{escaped}</text>"
    );
}

#[derive(Clone, Copy)]
struct Scale {
    low: f64,
    high: f64,
    logarithmic: bool,
}

impl Scale {
    /// `None` without a finite value.
    fn linear(values: impl Iterator<Item = f64>) -> Option<Self> {
        let (low, high) = ends(values)?;
        // A single value is centred.
        let (low, high) = match low == high {
            true => (low - 1.0, high + 1.0),
            false => (low, high),
        };
        Some(Self {
            low,
            high,
            logarithmic: false,
        })
    }

    fn heights(values: impl Iterator<Item = f64>) -> Option<Self> {
        let (low, high) = ends(values)?;
        let logarithmic = low > 0.0 && high > 10.0 * low;
        let (low, high) = match logarithmic {
            true => (
                10_f64.powf(low.log10().floor()),
                10_f64.powf(high.log10().ceil()),
            ),
            false if high > 0.0 => (low.min(0.0), high * 1.1),
            false => (low.min(-1.0), 1.0),
        };
        Some(Self {
            low,
            high,
            logarithmic,
        })
    }

    /// The place of a value, 0 to 1.
    fn at(self, value: f64) -> f64 {
        let of = |v: f64| if self.logarithmic { v.log10() } else { v };
        (of(value) - of(self.low)) / (of(self.high) - of(self.low))
    }

    /// Decades, or round steps that fit four to ten times.
    fn ticks(self) -> Vec<f64> {
        if self.logarithmic {
            let exponents = self.low.log10().round() as i32..=self.high.log10().round() as i32;
            return exponents.map(|e| 10_f64.powi(e)).collect();
        }
        let span = self.high - self.low;
        let decade = 10_f64.powf((span / 4.0).log10().floor());
        let factor = [5.0, 2.0, 1.0]
            .into_iter()
            .find(|f| span / (f * decade) >= 4.0);
        let step = factor.unwrap_or(1.0) * decade;
        let first = (self.low / step).ceil() as i64;
        let last = (self.high / step).floor() as i64;
        (first..=last).map(|i| i as f64 * step).collect()
    }
}

fn ends(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    values
        .filter(|v| v.is_finite())
        .map(|v| (v, v))
        .reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
}

fn number(value: f64) -> String {
    match value.abs() {
        v if v >= 1e9 => format!("{:.0}G", value / 1e9),
        v if v >= 1e6 => format!("{:.0}M", value / 1e6),
        v if v >= 1e4 => format!("{:.0}k", value / 1e3),
        _ => {
            let text = format!("{value:.6}");
            text.trim_end_matches('0').trim_end_matches('.').to_owned()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round() {
        let scale = |low, high| Scale {
            low,
            high,
            logarithmic: false,
        };
        assert_eq!(
            scale(1.0, 8.0).ticks(),
            [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]
        );
        assert_eq!(scale(0.0, 0.26).ticks().len(), 6);
        let logarithmic = Scale::heights([0.02, 0.3].into_iter());
        let ticks: Vec<String> = logarithmic
            .map(Scale::ticks)
            .unwrap_or_default()
            .into_iter()
            .map(number)
            .collect();
        assert_eq!(ticks, ["0.01", "0.1", "1"]);
    }

    #[test]
    fn what_was_not_measured_has_no_line() {
        let panel = |points: Vec<(f64, f64)>| Panel {
            title: "ms < 1".to_owned(),
            lines: vec![Line {
                name: "a&b".to_owned(),
                points,
            }],
            mark: Some(Mark {
                height: 0.5,
                name: "budget",
            }),
        };
        let drawn = svg(
            "t",
            "level",
            &[panel(vec![(1.0, 0.4), (2.0, 0.8)]), panel(Vec::new())],
        );
        assert_eq!(drawn.matches("<polyline").count(), 1, "{drawn}");
        assert_eq!(drawn.matches("<circle").count(), 2);
        assert_eq!(drawn.matches("not measured").count(), 1);
        assert!(drawn.contains("ms &lt; 1") && drawn.contains("a&amp;b"));
        assert_eq!(drawn.matches("stroke-dasharray").count(), 1);
    }
}
