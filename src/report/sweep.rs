//! A sweep as a table, a plot and rows of pictures: what a parameter costs in accuracy and gains in time; and the point that a budget leaves.

use preshade_passes::contract::Verdict;
use preshade_passes::hoist::Metric;
use serde::Serialize;

use super::picture::{Picture, Pictures, file_name};
use super::plot::{self, Line, Panel};
use super::{Report, VariantReport, sheet};
use crate::emit::File;
use crate::measure::ErrorLadder;
use crate::render::Surplus;
use crate::sweep::{AxisKind, Sweep, number};

/// A sweep, and which variants are its points.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SweepReport {
    /// As it was written.
    pub recipe: String,
    /// What varies, `pass:parameter`, in the order of each point's values.
    pub parameters: Vec<String>,
    /// The parameter along a plot's side: the first range. `None`: words alone vary.
    pub along: Option<usize>,
    /// Every combination.
    pub points: Vec<SweepPoint>,
    /// What was asked of the points.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub budget: Option<Budget>,
    /// What the budget leaves; `None` without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub choice: Option<Choice>,
}

/// A combination.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct SweepPoint {
    /// The value of each parameter.
    pub values: Vec<String>,
    /// Name of the variant.
    pub variant: String,
}

/// How far a picture may be off.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Budget {
    /// What is counted.
    pub metric: Metric,
    /// The most of it, 0 to 1.
    pub most: f64,
}

/// The point that a budget leaves.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum Choice {
    /// The fastest of those within the budget, and faster than the original; where nothing was timed, the first.
    Within {
        /// Name of the variant.
        variant: String,
        /// Its error, by the budget's metric, the worst of all views.
        error: f64,
        /// The original's time over its own; `None`: not timed.
        speedup: Option<f64>,
    },
    /// Some are within the budget, and none of them is faster than the original.
    Slower {
        /// The fastest of them.
        variant: String,
        /// Its error.
        error: f64,
        /// The original's time over its own.
        speedup: f64,
    },
    /// None is within the budget.
    None {
        /// The one that comes nearest; `None`: nothing was drawn.
        nearest: Option<String>,
        /// Its error.
        error: Option<f64>,
        /// The original's time over its own.
        speedup: Option<f64>,
    },
}

impl Budget {
    /// Reads `flip_mean=0.02`.
    ///
    /// # Errors
    /// In words: another metric, or no number above 0 and at most 1.
    pub fn parse(text: &str) -> Result<Self, String> {
        let (metric, most) = text
            .split_once('=')
            .ok_or("expected METRIC=NUMBER, flip_mean=0.02 say")?;
        let metric = serde_json::from_value(metric.trim().into())
            .map_err(|_| format!("`{metric}` is none of flip_mean, flip_p99 and max_abs"))?;
        match most.trim().parse::<f64>() {
            Ok(most) if most > 0.0 && most <= 1.0 => Ok(Self { metric, most }),
            _ => Err(format!("`{most}` is not a number above 0 and at most 1")),
        }
    }

    fn of(self, error: &ErrorLadder) -> f64 {
        match self.metric {
            Metric::FlipMean => error.flip_mean,
            Metric::FlipP99 => error.flip_p99,
            Metric::MaxAbs => error.max_abs,
        }
    }

    fn name(self) -> &'static str {
        match self.metric {
            Metric::FlipMean => "flip_mean",
            Metric::FlipP99 => "flip_p99",
            Metric::MaxAbs => "max_abs",
        }
    }
}

/// A combination that was drawn or refused, with its figures.
#[derive(Clone, Copy)]
struct Row<'a> {
    values: &'a [String],
    variant: &'a VariantReport,
}

impl Row<'_> {
    fn error(&self) -> Option<&ErrorLadder> {
        let measured = !matches!(self.variant.verdict, Verdict::NotMeasured { .. });
        self.variant.error.as_ref().filter(|_| measured)
    }

    fn speedup(&self) -> Option<f64> {
        self.variant.speedup.as_ref().map(|s| s.median)
    }
}

impl SweepReport {
    /// The sweep whose points are drawn as variants of these names, in order, with what `budget` leaves of them.
    pub fn new(sweep: &Sweep, names: &[String], budget: Option<Budget>, report: &Report) -> Self {
        let points = sweep.points.iter().zip(names);
        let mut new = Self {
            recipe: sweep.text.clone(),
            parameters: sweep
                .axes
                .iter()
                .map(|a| format!("{}:{}", a.pass, a.parameter))
                .collect(),
            along: sweep.axes.iter().position(|a| a.kind == AxisKind::Range),
            points: points
                .map(|(point, name)| SweepPoint {
                    values: point.values.clone(),
                    variant: name.clone(),
                })
                .collect(),
            budget,
            choice: None,
        };
        new.choice = budget.map(|budget| new.choose(budget, report));
        new
    }

    fn rows<'a>(&'a self, report: &'a Report) -> impl Iterator<Item = Row<'a>> {
        self.points.iter().filter_map(|point| {
            let variant = report.variants.iter().find(|v| v.name == point.variant)?;
            Some(Row {
                values: &point.values,
                variant,
            })
        })
    }

    fn choose(&self, budget: Budget, report: &Report) -> Choice {
        let drawn: Vec<(Row<'_>, f64)> = self
            .rows(report)
            .filter_map(|row| {
                let error = row.error()?;
                let good = error.nan_pixels == 0;
                good.then(|| (row, budget.of(error)))
            })
            .collect();
        let within = || drawn.iter().filter(|(_, error)| *error <= budget.most);
        let timed = within().filter_map(|(row, error)| Some((row, error, row.speedup()?)));
        let fastest = timed.max_by(|a, b| a.2.total_cmp(&b.2));
        let name = |row: &Row<'_>| row.variant.name.clone();
        match (fastest, within().next()) {
            (Some((row, error, speedup)), _) if speedup > 1.0 => Choice::Within {
                variant: name(row),
                error: *error,
                speedup: Some(speedup),
            },
            (Some((row, error, speedup)), _) => Choice::Slower {
                variant: name(row),
                error: *error,
                speedup,
            },
            (None, Some((row, error))) => Choice::Within {
                variant: name(row),
                error: *error,
                speedup: None,
            },
            (None, None) => {
                let nearest = drawn.iter().min_by(|a, b| a.1.total_cmp(&b.1));
                Choice::None {
                    nearest: nearest.map(|(row, _)| name(row)),
                    error: nearest.map(|(_, error)| *error),
                    speedup: nearest.and_then(|(row, _)| row.speedup()),
                }
            }
        }
    }

    /// The points apart by all parameters but the one along the side: a name, and the rows.
    fn series<'a>(&'a self, report: &'a Report) -> Vec<(String, Vec<Row<'a>>)> {
        let mut all: Vec<(String, Vec<Row<'a>>)> = Vec::new();
        for row in self.rows(report) {
            let others = self.parameters.iter().zip(row.values).enumerate();
            let name = others
                .filter(|(i, _)| Some(*i) != self.along)
                .map(|(_, (parameter, value))| format!("{}={value}", short(parameter)))
                .collect::<Vec<_>>()
                .join(", ");
            match all.iter_mut().find(|(n, _)| *n == name) {
                Some((_, rows)) => rows.push(row),
                None => all.push((name, vec![row])),
            }
        }
        all
    }

    fn along<'a>(&self, row: &Row<'a>) -> &'a str {
        self.along
            .and_then(|i| row.values.get(i))
            .map_or("", String::as_str)
    }

    fn x_label(&self) -> &str {
        self.along
            .and_then(|i| self.parameters.get(i))
            .map_or("", |p| short(p))
    }

    /// The figures as text: a table for each series, and what the budget leaves.
    pub fn table(&self, report: &Report) -> String {
        let mut out = format!("Sweep of {}:\n\n", self.recipe);
        let header = [
            self.x_label(),
            "ms",
            "speedup",
            "max abs",
            "FLIP mean",
            "FLIP p99",
            "evaluations",
            "in compute",
            "at load",
            "unshared",
            "vertex runs",
            "MB",
            "largest draw",
        ];
        for (name, rows) in self.series(report) {
            if !name.is_empty() {
                out.push_str(&format!("{name}\n"));
            }
            let (drawn, left): (Vec<_>, Vec<_>) = rows.iter().partition(|r| r.error().is_some());
            if drawn.is_empty() {
                out.push_str(&self.not_drawn(&left));
                continue;
            }
            let cells: Vec<[String; 13]> = drawn.iter().map(|row| self.cells(row)).collect();
            let mut widths = header.map(str::len);
            for row in &cells {
                for (width, cell) in widths.iter_mut().zip(row) {
                    *width = (*width).max(cell.len());
                }
            }
            let mut line = |cells: [&str; 13]| {
                let padded: Vec<String> = cells
                    .iter()
                    .zip(widths)
                    .map(|(cell, width)| format!("{cell:>width$}"))
                    .collect();
                out.push_str(padded.join("  ").trim_end());
                out.push('\n');
            };
            line(header);
            for row in &cells {
                line(row.each_ref().map(String::as_str));
            }
            out.push_str(&self.not_drawn(&left));
        }
        if let Some(said) = self.said() {
            out.push_str(&said);
            out.push_str("\n\n");
        }
        out
    }

    /// Why points were not drawn, or kept their materials as written: each reason with the values it is of. Ends in an empty line.
    fn not_drawn(&self, left: &[&Row<'_>]) -> String {
        let mut reasons: Vec<(&str, Vec<&str>)> = Vec::new();
        for row in left {
            let why = match (&row.variant.kept[..], &row.variant.verdict) {
                ([kept, ..], _) => &kept.why,
                ([], Verdict::NotMeasured { why }) => why,
                ([], _) => continue,
            };
            match reasons.iter_mut().find(|(w, _)| w == why) {
                Some((_, values)) => values.push(self.along(row)),
                None => reasons.push((why, vec![self.along(row)])),
            }
        }
        let lines = reasons.iter().map(|(why, values)| {
            format!(
                "  not drawn at {} {}: {why}\n",
                self.x_label(),
                values.join(", ")
            )
        });
        lines.chain(["\n".to_owned()]).collect()
    }

    fn cells(&self, row: &Row<'_>) -> [String; 13] {
        let dash = || "-".to_owned();
        let error = |f: &dyn Fn(&ErrorLadder) -> f64, digits: usize| {
            row.error()
                .map_or_else(dash, |e| format!("{:.digits$}", f(e)))
        };
        let cost = row.variant.cost.as_ref();
        let divided = cost.and_then(|c| c.subdivision.as_ref());
        let count = |n: Option<u64>| n.map_or_else(dash, |n| n.to_string());
        let megabytes = |bytes: u64| format!("{:.2}", bytes as f64 / 1e6);
        let invoked = cost.and_then(|c| c.invocations);
        let time = row.variant.time_ms.as_ref();
        [
            self.along(row).to_owned(),
            time.map_or_else(dash, |t| format!("{:.3}", t.estimate.median)),
            row.speedup().map_or_else(dash, |s| format!("{s:.2}x")),
            error(&|e| e.max_abs, 4),
            error(&|e| e.flip_mean, 5),
            error(&|e| e.flip_p99, 4),
            divided.map_or_else(dash, |d| match d.surplus {
                Surplus::None => d.evaluations.to_string(),
                Surplus::Some => format!("<{}", d.evaluations),
            }),
            count(divided.map(|d| d.in_compute)),
            count(divided.map(|d| d.at_load)),
            count(divided.map(|d| d.unshared)),
            count(invoked.map(|i| i.vertex)),
            divided.map_or_else(dash, |d| megabytes(d.bytes)),
            divided.map_or_else(dash, |d| {
                megabytes(d.draws.iter().map(|d| d.bytes).max().unwrap_or_default())
            }),
        ]
    }

    /// What the budget leaves, as a sentence; `None` without one.
    pub fn said(&self) -> Option<String> {
        let (budget, choice) = (self.budget?, self.choice.as_ref()?);
        let (name, most) = (budget.name(), budget.most);
        let times = |speedup: Option<f64>| {
            speedup.map_or_else(|| "not timed".to_owned(), |s| format!("{s:.2}x"))
        };
        Some(match choice {
            Choice::Within {
                variant,
                error,
                speedup,
            } => format!(
                "Within {name}={most} the best is {variant}: {}, {name} {error:.5}.",
                times(*speedup)
            ),
            Choice::Slower {
                variant,
                error,
                speedup,
            } => format!(
                "No point within {name}={most} is faster than the original: the fastest is {variant}, {speedup:.2}x, {name} {error:.5}."
            ),
            Choice::None {
                nearest: Some(variant),
                error: Some(error),
                speedup,
            } => format!(
                "No point is within {name}={most}: the best error is {error:.5}, of {variant}, {}.",
                times(*speedup)
            ),
            Choice::None { .. } => format!("No point is within {name}={most}: none was drawn."),
        })
    }

    /// `NAME.svg`, and a sheet of pictures for each series, `NAME.SERIES.png`: original, variant and difference, a row a point.
    ///
    /// # Errors
    /// What the PNG encoder says.
    pub fn files(
        &self,
        report: &Report,
        pictures: &[Pictures],
    ) -> Result<Vec<File>, image::ImageError> {
        let name = format!("sweep.{}", file_name(&self.recipe));
        let mut files = Vec::new();
        if self.along.is_some() {
            files.push(File {
                name: format!("{name}.svg"),
                bytes: self.plot(report).into_bytes(),
            });
        }
        for (series, rows) in self.series(report) {
            let drawn: Vec<(String, &Pictures)> = rows
                .iter()
                .filter_map(|row| {
                    let found = pictures.iter().find(|p| p.name == row.variant.name)?;
                    Some((self.label(row, &series), found))
                })
                .collect();
            if drawn.is_empty() {
                continue;
            }
            let sheet: Picture = sheet::rows(&drawn);
            let part = file_name(&series);
            files.push(match part.as_str() {
                "" => sheet.file(&format!("{name}.png"))?,
                part => sheet.file(&format!("{name}.{part}.png"))?,
            });
        }
        Ok(files)
    }

    fn label(&self, row: &Row<'_>, series: &str) -> String {
        let along = match self.x_label() {
            "" => String::new(),
            label => format!("{label}={} ", self.along(row)),
        };
        let flip = row.error().map(|e| format!(" FLIP {:.4}", e.flip_mean));
        format!("{along}{series}{}", flip.unwrap_or_default())
    }

    fn plot(&self, report: &Report) -> String {
        let series = self.series(report);
        let panel = |title: &str, mark: Option<f64>, of: &dyn Fn(&Row<'_>) -> Option<f64>| Panel {
            title: title.to_owned(),
            mark,
            lines: series
                .iter()
                .map(|(name, rows)| Line {
                    name: match name.as_str() {
                        "" => self.recipe.clone(),
                        name => name.to_owned(),
                    },
                    points: rows
                        .iter()
                        .filter_map(|row| Some((number(self.along(row))?, of(row)?)))
                        .collect(),
                })
                .filter(|line| !line.points.is_empty())
                .collect(),
        };
        let budget = |name: &str| {
            let budget = self.budget.filter(|b| b.name() == name);
            budget.map(|b| b.most)
        };
        let original = report.variants.first().and_then(|v| v.time_ms.as_ref());
        let divided = |row: &Row<'_>| {
            let cost = row.variant.cost.as_ref()?;
            cost.subdivision.clone()
        };
        let panels = [
            panel(
                "milliseconds a frame (dashed: the original)",
                original.map(|t| t.estimate.median),
                &|row| Some(row.variant.time_ms.as_ref()?.estimate.median),
            ),
            panel("FLIP, mean", budget("flip_mean"), &|row| {
                Some(row.error()?.flip_mean)
            }),
            panel("evaluations a frame", None, &|row| {
                Some(divided(row)?.evaluations as f64)
            }),
            panel("FLIP, 99th percentile", budget("flip_p99"), &|row| {
                Some(row.error()?.flip_p99)
            }),
            panel("megabytes of new vertices", None, &|row| {
                Some(divided(row)?.bytes as f64 / 1e6)
            }),
            panel(
                "largest difference of a channel",
                budget("max_abs"),
                &|row| Some(row.error()?.max_abs),
            ),
        ];
        let title = format!(
            "{}, {}x{}, on {}",
            report.scene, report.resolution[0], report.resolution[1], report.adapter.name
        );
        plot::svg(&title, self.x_label(), &panels)
    }
}

/// A parameter without its pass.
fn short(parameter: &str) -> &str {
    parameter
        .split_once(':')
        .map_or(parameter, |(_, name)| name)
}
