//! A sweep as a table, a plot and rows of pictures: error and time by parameter.

use preshade_plan::budget::Metric;
use preshade_plan::contract::Verdict;

use super::contact_sheet;
use super::grid::{self, or_dash};
use super::picture::file_name;
use super::plot::{self, Line, Mark, Panel};
use crate::measure::ErrorLadder;
use crate::measure::record::{Picture, Pictures, Report, SweepReport, VariantReport};
use preshade_compiler::sweep::number;
use preshade_draw::render::Surplus;
use shader_text::files::File;

/// A combination that was drawn or refused, with its figures.
#[derive(Clone, Copy)]
struct SweepRow<'a> {
    values: &'a [String],
    variant: &'a VariantReport,
}

impl SweepRow<'_> {
    fn error(&self) -> Option<&ErrorLadder> {
        let measured = !matches!(self.variant.verdict, Verdict::NotMeasured { .. });
        self.variant.error.as_ref().filter(|_| measured)
    }

    fn speedup(&self) -> Option<f64> {
        self.variant.speedup.as_ref().map(|s| s.median)
    }
}

impl SweepReport {
    fn rows<'a>(&'a self, report: &'a Report) -> impl Iterator<Item = SweepRow<'a>> {
        self.points.iter().filter_map(|point| {
            let variant = report.variants.iter().find(|v| v.name == point.variant)?;
            Some(SweepRow {
                values: &point.values,
                variant,
            })
        })
    }

    /// One series for each combination of all parameters but the one along the side: its name, and
    /// its rows.
    fn series<'a>(&'a self, report: &'a Report) -> Vec<(String, Vec<SweepRow<'a>>)> {
        let mut all: Vec<(String, Vec<SweepRow<'a>>)> = Vec::new();
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

    fn along<'a>(&self, row: &SweepRow<'a>) -> &'a str {
        self.along
            .and_then(|i| row.values.get(i))
            .map_or("", String::as_str)
    }

    fn x_label(&self) -> &str {
        self.along
            .and_then(|i| self.parameters.get(i))
            .map_or("", |p| short(p))
    }

    /// The figures as text: a table for each series.
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
            let mut rows = vec![grid::row(header)];
            rows.extend(drawn.iter().map(|row| grid::row(self.cells(row))));
            out.push_str(&grid::aligned(&rows, |_| false, false));
            out.push_str(&self.not_drawn(&left));
        }
        out
    }

    /// The points that were not drawn, or left their materials as written, grouped by reason. Ends
    /// in an empty line.
    fn not_drawn(&self, left: &[&SweepRow<'_>]) -> String {
        let mut reasons: Vec<(&str, Vec<&str>)> = Vec::new();
        for row in left {
            let kept = row.variant.kept.iter().find(|k| k.without.is_none());
            let why = match (kept, &row.variant.verdict) {
                (Some(kept), _) => &kept.why,
                (None, Verdict::NotMeasured { why }) => why,
                (None, _) => continue,
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

    fn cells(&self, row: &SweepRow<'_>) -> [String; 13] {
        let error = |f: &dyn Fn(&ErrorLadder) -> f64, digits: usize| {
            or_dash(row.error(), |e| format!("{:.digits$}", f(e)))
        };
        let cost = row.variant.cost.as_ref();
        let divided = cost.and_then(|c| c.subdivision.as_ref());
        let count = |n: Option<u64>| or_dash(n, |n| n.to_string());
        let megabytes = |bytes: u64| format!("{:.2}", bytes as f64 / 1e6);
        let invoked = cost.and_then(|c| c.invocations);
        let time = row.variant.time_ms.as_ref();
        [
            self.along(row).to_owned(),
            or_dash(time, |t| format!("{:.3}", t.estimate.median)),
            or_dash(row.speedup(), |s| format!("{s:.2}x")),
            error(&|e| e.max_abs, 4),
            error(&|e| e.flip_mean, 5),
            error(&|e| e.flip_p99, 4),
            or_dash(divided, |d| match d.surplus {
                Surplus::None => d.evaluations.to_string(),
                Surplus::Some => format!("<{}", d.evaluations),
            }),
            count(divided.map(|d| d.in_compute)),
            count(divided.map(|d| d.at_load)),
            count(divided.map(|d| d.unshared)),
            count(invoked.map(|i| i.vertex)),
            or_dash(divided, |d| megabytes(d.bytes)),
            or_dash(divided, |d| {
                megabytes(d.draws.iter().map(|d| d.bytes).max().unwrap_or_default())
            }),
        ]
    }

    /// `NAME.svg`, and a sheet of pictures for each series, `NAME.SERIES.png`: original, variant
    /// and difference, a row a point.
    pub fn files(
        &self,
        report: &Report,
        pictures: &[Pictures],
    ) -> Result<Vec<File>, image::ImageError> {
        let name = format!("sweep.{}", file_name(&self.recipe));
        let mut files = Vec::new();
        if self.along.is_some() {
            files.push(File::text(format!("{name}.svg"), self.plot(report)));
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
            let sheet: Picture = contact_sheet::rows(&drawn);
            let part = file_name(&series);
            files.push(match part.as_str() {
                "" => sheet.file(&format!("{name}.png"))?,
                part => sheet.file(&format!("{name}.{part}.png"))?,
            });
        }
        Ok(files)
    }

    fn label(&self, row: &SweepRow<'_>, series: &str) -> String {
        let along = match self.x_label() {
            "" => String::new(),
            label => format!("{label}={} ", self.along(row)),
        };
        let flip = row
            .error()
            .map(|e| format!(" FLIP {:.4} at worst", e.flip_mean));
        format!("{along}{series}{}", flip.unwrap_or_default())
    }

    fn plot(&self, report: &Report) -> String {
        let series = self.series(report);
        let panel =
            |title: &str, mark: Option<Mark>, of: &dyn Fn(&SweepRow<'_>) -> Option<f64>| Panel {
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
        let budget = |metric: Metric| {
            let chosen = report.chosen.as_ref();
            let budget = chosen.map(|c| c.budget).filter(|b| b.metric == metric);
            budget.map(|b| Mark {
                height: b.limit,
                name: "budget",
            })
        };
        let original = report.variants.first().and_then(|v| v.time_ms.as_ref());
        let divided = |row: &SweepRow<'_>| {
            let cost = row.variant.cost.as_ref()?;
            cost.subdivision.clone()
        };
        let panels = [
            panel(
                "milliseconds a frame",
                original.map(|t| Mark {
                    height: t.estimate.median,
                    name: "original",
                }),
                &|row| Some(row.variant.time_ms.as_ref()?.estimate.median),
            ),
            panel("FLIP, mean", budget(Metric::FlipMean), &|row| {
                Some(row.error()?.flip_mean)
            }),
            panel("evaluations a frame", None, &|row| {
                Some(divided(row)?.evaluations as f64)
            }),
            panel("FLIP, 99th percentile", budget(Metric::FlipP99), &|row| {
                Some(row.error()?.flip_p99)
            }),
            panel("megabytes of new vertices", None, &|row| {
                Some(divided(row)?.bytes as f64 / 1e6)
            }),
            panel(
                "largest difference of a channel",
                budget(Metric::MaxAbs),
                &|row| Some(row.error()?.max_abs),
            ),
        ];
        let title = format!(
            "{}, {}x{}, on {}",
            report.scene,
            report.resolution[0],
            report.resolution[1],
            report.adapter.title()
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
