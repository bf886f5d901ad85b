//! Which variants are the points of a sweep.

use serde::{Deserialize, Serialize};

use super::Report;
use preshade_compiler::sweep::{AxisKind, Sweep};

/// A sweep, and which variants are its points.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SweepReport {
    pub recipe: String,
    /// The parameters that vary, `pass:parameter`, in the order of each point's values.
    pub parameters: Vec<String>,
    /// The parameter along a plot's side: the first range. `None`: words alone vary.
    pub along: Option<usize>,
    pub points: Vec<SweepPoint>,
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SweepPoint {
    /// The value of each parameter.
    pub values: Vec<String>,
    pub variant: String,
}

impl SweepReport {
    /// The sweep, with the variants' names in the order of its points.
    pub fn new(sweep: &Sweep, names: &[String]) -> Self {
        let points = sweep.points.iter().zip(names);
        Self {
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
        }
    }
}

impl Report {
    /// Adds the sweeps. Its variants are, in order, the points of one sweep after the other.
    pub fn add_sweeps(&mut self, sweeps: &[Sweep]) {
        let names = self.variants.iter().skip(1).map(|v| v.name.clone());
        let mut names = names.collect::<Vec<_>>().into_iter();
        for sweep in sweeps {
            let names: Vec<String> = names.by_ref().take(sweep.points.len()).collect();
            if sweep.varies() {
                self.sweeps.push(SweepReport::new(sweep, &names));
            }
        }
    }
}
