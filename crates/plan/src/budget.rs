//! How much a picture may differ: a metric and its limit.

use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize};

/// The metric of a budget.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Metric {
    /// Mean of FLIP over the whole picture, 0 to 1, also where the material draws nothing. For a
    /// material that covers little of the picture, take `flip_tile`.
    #[default]
    FlipMean,
    /// 99th percentile of FLIP.
    FlipP99,
    /// Largest mean of FLIP over a tile of 16 x 16 pixels, 0 to 1, so that a small ruined spot counts.
    /// A tile at the right or lower edge may be smaller; its mean is over the pixels it has.
    FlipTile,
    /// Largest difference of a channel, 0 to 1.
    MaxAbs,
}

/// A difference that was measured in every metric.
pub trait Difference {
    /// Mean FLIP, its 99th percentile, that of the worst tile, and the largest difference of a channel.
    fn by_metric(&self) -> [f64; 4];
}

impl<D: Difference> Difference for &D {
    fn by_metric(&self) -> [f64; 4] {
        (*self).by_metric()
    }
}

impl Metric {
    /// The value of this metric in a measured difference.
    pub fn of(self, difference: &impl Difference) -> f64 {
        let [flip_mean, flip_p99, flip_tile, max_abs] = difference.by_metric();
        match self {
            Self::FlipMean => flip_mean,
            Self::FlipP99 => flip_p99,
            Self::FlipTile => flip_tile,
            Self::MaxAbs => max_abs,
        }
    }

    /// The name in recipes and in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::FlipMean => "flip_mean",
            Self::FlipP99 => "flip_p99",
            Self::FlipTile => "flip_tile",
            Self::MaxAbs => "max_abs",
        }
    }
}

impl fmt::Display for Metric {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A difference that no record has, which no budget allows.
pub fn unmeasured() -> f64 {
    f64::INFINITY
}

/// A number, or infinity where JSON has none.
///
/// # Errors
/// The deserialiser's.
pub fn or_infinite<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(from)?.unwrap_or(f64::INFINITY))
}

/// The most that a picture may differ.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Budget {
    /// The metric.
    pub metric: Metric,
    /// Largest value of the metric, 0 to 1.
    #[serde(rename = "budget")]
    pub limit: f64,
}

impl Budget {
    /// A budget in the largest difference of a channel.
    pub fn max_abs(limit: f64) -> Self {
        Self {
            metric: Metric::MaxAbs,
            limit,
        }
    }

    /// Reads `flip_mean=0.02`.
    ///
    /// # Errors
    /// In words: another metric, or no number above 0 and at most 1.
    pub fn parse(text: &str) -> Result<Self, String> {
        let (metric, limit) = text
            .split_once('=')
            .ok_or("expected METRIC=NUMBER, flip_mean=0.02 say")?;
        let metric = serde_json::from_value(metric.trim().into()).map_err(|_| {
            format!("`{metric}` is none of flip_mean, flip_p99, flip_tile and max_abs")
        })?;
        match limit.trim().parse::<f64>() {
            Ok(limit) if limit > 0.0 && limit <= 1.0 => Ok(Self { metric, limit }),
            _ => Err(format!("`{limit}` is not a number above 0 and at most 1")),
        }
    }

    /// The difference in the budget's metric.
    pub fn of(self, difference: &impl Difference) -> f64 {
        self.metric.of(difference)
    }

    /// Whether the difference is within the budget. NaN is not.
    pub fn allows(self, difference: &impl Difference) -> bool {
        self.of(difference) <= self.limit
    }
}

impl fmt::Display for Budget {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} at most {}", self.metric, self.limit)
    }
}
