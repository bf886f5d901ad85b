//! The parameters: error limits, movable classes, assumptions.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::choose::Terms;
use super::movable::{Assumed, Class, Finite, Jumps};
use super::{Hoist, refusals};
use crate::analysis::refusals as shared;
use preshade_plan::budget::Metric;
use preshade_plan::pass::{Facts, Pass, Refusal};

/// The weakest contract for a moved value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Allow {
    /// Only constants of the draw and of the primitive.
    Exact,
    /// Also affine values.
    Rounding,
    /// Any value.
    Approximate,
}

/// Parameters.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct HoistParams {
    /// The weakest contract for a moved value. Default: `approximate` with a budget, otherwise
    /// `rounding`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub allow: Option<Allow>,
    /// Largest allowed picture error by `metric`, above 0 and at most 1. Without it nothing
    /// approximate moves.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(max = 1.0), extend("exclusiveMinimum" = 0.0))]
    pub budget: Option<f64>,
    /// The metric of the budget.
    pub metric: Metric,
    /// Assumption about unmeasured values at vertices.
    pub finite: Finite,
    /// Assumption about unmeasured values that depend on a discontinuity. Default: `stay`.
    #[serde(skip_serializing_if = "is_default")]
    pub jumps: Jumps,
    /// Largest measured error by `metric` of an approximated value. Default: the budget. If nothing
    /// was measured, unmeasured values may move too.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0))]
    pub threshold: Option<f64>,
    /// The only values to approximate, by id, joined by `+`: an earlier choice. Empty: none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub carry: Option<String>,
    /// Vertices shaded per fragment shaded. Default: the measured ratio, otherwise 0.05.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0))]
    pub vertices_per_fragment: Option<f64>,
}

fn is_default(jumps: &Jumps) -> bool {
    *jumps == Jumps::default()
}

/// The default without measurements: triangles of about ten pixels whose vertices are shared by a
/// few of them.
const VERTICES_PER_FRAGMENT: f64 = 0.05;

/// Smallest fraction of the fragment stage's static cost that a hoist must save.
const WORTHWHILE: f64 = 0.01;

impl HoistParams {
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
                &shared::NO_BUDGET,
                "an approximate hoist needs a budget: how much the picture may differ",
                "give budget=0.01 (of flip_mean, or say metric=max_abs)",
            ));
        }
        if self.budget.is_some_and(|b| !(b > 0.0 && b <= 1.0)) {
            return Some(Refusal::new(
                name,
                &preshade_plan::refusals::BUDGET,
                "the budget is not a number above 0 and at most 1",
                "give budget=0.01, say",
            ));
        }
        if self.threshold.is_some_and(|t| t.is_nan() || t < 0.0) {
            return Some(Refusal::new(
                name,
                &refusals::THRESHOLD,
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
                &refusals::VERTICES_PER_FRAGMENT,
                "the number of vertices for each fragment is not a finite number of at least 0",
                "leave it out",
            ));
        }
        None
    }

    /// A message with the smallest measured error beyond the threshold; empty without measurements.
    pub(super) fn best_measured(&self, material: &str, facts: &Facts) -> String {
        let threshold = self.threshold.or(self.budget).unwrap_or_default();
        let measured = facts.frequencies.iter().filter(|f| f.material == material);
        let least = measured
            .filter(|f| self.metric.of(f) > threshold)
            .min_by(|a, b| self.metric.of(a).total_cmp(&self.metric.of(b)));
        let allowed = self.budget.unwrap_or(threshold);
        least.map_or(String::new(), |f| {
            format!(
                "; `{}` ({:.0} ops) has the smallest error, {:.4} ({}) alone, and {allowed} is allowed",
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
