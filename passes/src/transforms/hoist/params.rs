//! What the pass is told: how much may differ, what may travel, what may be assumed.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Hoist;
use super::choose::Terms;
use super::travel::{Assumed, Class, Finite, Jumps};
use crate::core::pass::{Facts, Frequency, Pass, Refusal};

/// The weakest promise a value may travel under.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Allow {
    /// Constants of the draw and of the primitive.
    Exact,
    /// Affine values too.
    Rounding,
    /// Any value.
    Approximate,
}

/// What a budget counts.
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
    /// What was measured of a value.
    pub fn of(self, frequency: &Frequency) -> f64 {
        match self {
            Self::FlipMean => frequency.flip_mean,
            Self::FlipP99 => frequency.flip_p99,
            Self::MaxAbs => frequency.max_abs,
        }
    }

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::FlipMean => "flip_mean",
            Self::FlipP99 => "flip_p99",
            Self::MaxAbs => "max_abs",
        }
    }
}

/// Parameters.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct Params {
    /// The weakest promise a value may travel under; default: `approximate` where a budget is given, `rounding` where none is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub allow: Option<Allow>,
    /// How much the picture may differ, by `metric`, above 0 and at most 1. Without one nothing approximate moves.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(max = 1.0), extend("exclusiveMinimum" = 0.0))]
    pub budget: Option<f64>,
    /// What the budget counts.
    pub metric: Metric,
    /// What may be assumed of values at vertices that were not measured.
    pub finite: Finite,
    /// What may be assumed of values that rest on what jumps, and were not measured; default: `stay`.
    #[serde(skip_serializing_if = "is_default")]
    pub jumps: Jumps,
    /// Largest measured error, by `metric`, of a value that travels as an approximation; default: the budget. Values that were not measured are not held back
    /// where nothing was.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0))]
    pub threshold: Option<f64>,
    /// The only values that travel as approximations, by id, joined by `+`: a choice made before.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub carry: Option<String>,
    /// Vertices shaded for each fragment shaded; default: as measured, or else 0.05.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0))]
    pub vertices_per_fragment: Option<f64>,
}

fn is_default(jumps: &Jumps) -> bool {
    *jumps == Jumps::default()
}

/// Taken where nothing was measured: triangles of about ten pixels, each vertex shared by a few of them.
const VERTICES_PER_FRAGMENT: f64 = 0.05;

/// Least part of the fragment stage's static cost that a hoist has to save.
const WORTHWHILE: f64 = 0.01;

impl Params {
    pub(super) fn weakest(&self) -> Class {
        match (self.allow, self.budget) {
            (Some(Allow::Exact), _) => Class::Exact,
            (Some(Allow::Rounding), _) | (None, None) => Class::Affine,
            (Some(Allow::Approximate), _) | (None, Some(_)) => Class::Smooth,
        }
    }

    pub(super) fn assumed(&self) -> Assumed {
        Assumed {
            finite: self.finite,
            jumps: self.jumps,
        }
    }

    pub(super) fn check(&self) -> Option<Refusal> {
        let name = Hoist::INFO.name;
        if self.allow == Some(Allow::Approximate) && self.budget.is_none() {
            return Some(Refusal::new(
                name,
                "no-budget",
                "an approximate hoist needs a budget: how much the picture may differ",
                "give budget=0.01 (of flip_mean, or say metric=max_abs)",
            ));
        }
        if self.budget.is_some_and(|b| !(b > 0.0 && b <= 1.0)) {
            return Some(Refusal::new(
                name,
                "budget",
                "the budget is not a number above 0 and at most 1",
                "give budget=0.01, say",
            ));
        }
        if self.threshold.is_some_and(|t| t.is_nan() || t < 0.0) {
            return Some(Refusal::new(
                name,
                "threshold",
                "the threshold is not a number of at least 0",
                "leave it out",
            ));
        }
        if self
            .vertices_per_fragment
            .is_some_and(|v| !(v >= 0.0 && v.is_finite()))
        {
            return Some(Refusal::new(
                name,
                "vertices-per-fragment",
                "the number of vertices for each fragment is not a finite number of at least 0",
                "leave it out",
            ));
        }
        None
    }

    /// In words, the least error measured of a value that is held back by it; nothing where nothing was measured.
    pub(super) fn best_measured(&self, material: &str, facts: &Facts) -> String {
        let threshold = self.threshold.or(self.budget).unwrap_or_default();
        let measured = facts.frequencies.iter().filter(|f| f.material == material);
        let least = measured
            .filter(|f| self.metric.of(f) > threshold)
            .min_by(|a, b| self.metric.of(a).total_cmp(&self.metric.of(b)));
        let allowed = self.budget.unwrap_or(threshold);
        least.map_or(String::new(), |f| {
            format!(
                "; of those that may differ `{}` ({:.0} ops) does least harm, an error of {:.4} ({}) by itself where {allowed} is allowed",
                f.name,
                f.cost,
                self.metric.of(f),
                self.metric.name()
            )
        })
    }

    pub(super) fn terms(&self, facts: &Facts) -> Terms {
        Terms {
            weakest: self.weakest(),
            vertices_per_fragment: self
                .vertices_per_fragment
                .or(facts.vertices_per_fragment)
                .unwrap_or(VERTICES_PER_FRAGMENT),
            worthwhile: WORTHWHILE,
        }
    }
}
