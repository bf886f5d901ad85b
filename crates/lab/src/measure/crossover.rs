//! A scene measured at several values of one of its variables, and where one variant overtakes
//! another.

use serde::Serialize;

use super::Estimate;
use super::timing::estimate;
use crate::measure::record::{Report, VariantReport};

/// Version of the JSON that [`Series`] serialises to.
pub(crate) const SCHEMA: &str = "preshade.series.v1";

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Series {
    pub schema: String,
    pub variable: String,
    /// Where pairs of variants cross.
    pub crossovers: Vec<Crossover>,
    /// The reports by the variable's value, ascending.
    pub points: Vec<Point>,
}

/// One value of the variable.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Point {
    pub value: u32,
    /// The report at that value.
    pub report: Report,
}

/// How two variants compare over the series, in the headline view.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Crossover {
    pub first: String,
    pub second: String,
    /// The first variant's time over the second's, by value, with its 95 % interval. Above 1 the
    /// second is faster. Samples are from the same round.
    pub ratios: Vec<(u32, Estimate)>,
    /// Values at which the ratio passes 1.
    pub at: Vec<Crossing>,
}

/// The value at which a ratio crosses 1 between two measured values, interpolated logarithmically.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Crossing {
    /// Crossing of the medians.
    pub value: f64,
    /// Crossing of the ends of the ratios' intervals; `None`: they do not pass 1 on that side
    /// within the series.
    pub low: Option<f64>,
    pub high: Option<f64>,
}

impl Series {
    /// A series from reports of the same variants.
    pub fn new(variable: &str, mut points: Vec<Point>) -> Self {
        points.sort_by_key(|p| p.value);
        let names: Vec<String> = points.first().map_or(Vec::new(), |p| {
            p.report.variants.iter().map(|v| v.name.clone()).collect()
        });
        let mut crossovers = Vec::new();
        for (i, first) in names.iter().enumerate() {
            for second in &names[i + 1..] {
                let ratios: Vec<(u32, Estimate)> = points
                    .iter()
                    .filter_map(|p| Some((p.value, ratio(&p.report, first, second)?)))
                    .collect();
                if !ratios.is_empty() {
                    crossovers.push(Crossover {
                        first: first.clone(),
                        second: second.clone(),
                        at: crossings(&ratios),
                        ratios,
                    });
                }
            }
        }
        Self {
            schema: SCHEMA.to_owned(),
            variable: variable.to_owned(),
            crossovers,
            points,
        }
    }

    /// Whether any variant broke its contract anywhere.
    pub fn is_broken(&self) -> bool {
        self.points.iter().any(|p| p.report.is_broken())
    }

    /// The JSON of record, indented, with a newline at its end.
    pub fn to_json(&self) -> serde_json::Result<String> {
        Ok(serde_json::to_string_pretty(self)? + "\n")
    }
}

/// One variant's time over another's, from samples of the same round. Needs all samples of both.
fn ratio(report: &Report, first: &str, second: &str) -> Option<Estimate> {
    let find =
        |name: &str| -> Option<&VariantReport> { report.variants.iter().find(|v| v.name == name) };
    let (a, b) = (
        find(first)?.time_ms.as_ref()?,
        find(second)?.time_ms.as_ref()?,
    );
    if a.samples.len() == b.samples.len() {
        let ratios: Vec<f64> = a
            .samples
            .iter()
            .zip(&b.samples)
            .map(|(a, b)| a / b)
            .collect();
        return Some(estimate(&ratios, 17));
    }
    // Rounds are missing, and which is not known: the widest that the intervals allow.
    Some(Estimate {
        median: a.estimate.median / b.estimate.median,
        low: a.estimate.low / b.estimate.high,
        high: a.estimate.high / b.estimate.low,
    })
}

/// Where the ratios pass 1.
fn crossings(ratios: &[(u32, Estimate)]) -> Vec<Crossing> {
    let of = |pick: fn(&Estimate) -> f64| -> Vec<f64> {
        ratios
            .windows(2)
            .filter_map(|pair| {
                let [(n, a), (m, b)] = pair else { return None };
                passes_one((*n, pick(a)), (*m, pick(b)))
            })
            .collect()
    };
    let (low, high) = (of(|e| e.low), of(|e| e.high));
    let medians = of(|e| e.median);
    // With several crossings, the order of the ends does not pair them with crossings.
    let alone = medians.len() == 1;
    medians
        .into_iter()
        .map(|value| {
            let ends: Vec<f64> = low.iter().chain(&high).copied().collect();
            let below = ends.iter().copied().filter(|e| *e <= value);
            let above = ends.iter().copied().filter(|e| *e >= value);
            Crossing {
                value,
                low: below.reduce(f64::min).filter(|_| alone),
                high: above.reduce(f64::max).filter(|_| alone),
            }
        })
        .collect()
}

/// The value between two at which a ratio is 1, if it passes it.
fn passes_one((n, a): (u32, f64), (m, b): (u32, f64)) -> Option<f64> {
    let (la, lb) = (a.ln(), b.ln());
    if !(la.is_finite() && lb.is_finite()) || (la < 0.0) == (lb < 0.0) {
        return None;
    }
    let part = la / (la - lb);
    let (n, m) = (f64::from(n).ln(), f64::from(m).ln());
    Some((n + (m - n) * part).exp())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(value: u32, median: f64) -> (u32, Estimate) {
        let spread = 1.1;
        (
            value,
            Estimate {
                median,
                low: median / spread,
                high: median * spread,
            },
        )
    }

    #[test]
    fn a_crossing_is_where_the_ratio_is_one() {
        // Halving as the value doubles: 1 is met halfway in logarithms.
        let found = crossings(&[at(100, 2.0), at(400, 0.5)]);
        assert_eq!(found.len(), 1);
        assert!((found[0].value - 200.0).abs() < 1e-9);
        let (low, high) = (found[0].low.unwrap_or(0.0), found[0].high.unwrap_or(0.0));
        // The ends are met where the ratio is 1.1 and 1 / 1.1: the value is as the ratio's inverse.
        assert!((low - 200.0 / 1.1).abs() < 1e-6, "{low}");
        assert!((high - 200.0 * 1.1).abs() < 1e-6, "{high}");
    }

    #[test]
    fn what_does_not_pass_one_does_not_cross() {
        assert_eq!(crossings(&[at(100, 2.0), at(400, 1.5)]), []);
        assert_eq!(crossings(&[at(100, 2.0)]), []);
        // An interval that reaches past the series is open.
        let open = crossings(&[at(100, 1.01), at(400, 0.5)]);
        assert_eq!(open.len(), 1);
        assert_eq!(open[0].low, None);
    }
}
