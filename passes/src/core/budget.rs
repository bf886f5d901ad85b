//! How far a picture may differ.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::core::pass::Frequency;

/// The metric of a budget.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Metric {
    /// Mean of FLIP over the picture, 0 to 1.
    #[default]
    FlipMean,
    /// Its 99th percentile.
    FlipP99,
    /// Largest difference of a channel, 0 to 1.
    MaxAbs,
}

impl Metric {
    /// The error measured of a value.
    pub fn of(self, frequency: &Frequency) -> f64 {
        match self {
            Self::FlipMean => frequency.flip_mean,
            Self::FlipP99 => frequency.flip_p99,
            Self::MaxAbs => frequency.max_abs,
        }
    }

    /// Its name in plans and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::FlipMean => "flip_mean",
            Self::FlipP99 => "flip_p99",
            Self::MaxAbs => "max_abs",
        }
    }
}
