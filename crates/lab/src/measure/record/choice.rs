//! Which of the variants a budget leaves: the fastest that is off by no more.

use std::cmp::Ordering;

use preshade_plan::budget::Budget;
use preshade_plan::contract::Verdict;
use serde::{Deserialize, Serialize};

use super::{ORIGINAL, VariantReport};
use crate::measure::Estimate;
use preshade_compiler::recipe::Recipe;

/// A budget and the variant it selects.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Chosen {
    #[serde(with = "as_most")]
    pub budget: Budget,
    pub choice: Choice,
    /// The recipe with which `rewrite` makes the chosen variant and promises this budget. `None`:
    /// its own recipe.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub recipe: Option<String>,
    /// Number of variants that a first look found within the budget and as good as the verified
    /// ones, but that were not verified.
    #[serde(skip_serializing_if = "is_zero")]
    pub unverified: usize,
}

/// A report calls the limit of a budget `most`.
mod as_most {
    use preshade_plan::budget::{Budget, Metric};
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    #[derive(Serialize, Deserialize)]
    struct Most {
        metric: Metric,
        most: f64,
    }

    pub fn serialize<S: Serializer>(budget: &Budget, to: S) -> Result<S::Ok, S::Error> {
        let Budget { metric, limit } = *budget;
        let most = Most {
            metric,
            most: limit,
        };
        most.serialize(to)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Budget, D::Error> {
        let Most { metric, most } = Most::deserialize(from)?;
        Ok(Budget {
            metric,
            limit: most,
        })
    }
}

fn is_zero(number: &usize) -> bool {
    *number == 0
}

/// The variant that a budget leaves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum Choice {
    /// The fastest variant that keeps its promise and is within the budget, if it is faster than the original beyond its 95 %
    /// interval. If nothing was timed, the one with the least error.
    Within {
        variant: String,
        /// Its error, by the budget's metric, the worst of all views.
        error: f64,
        /// The original's time over its own; `None`: not timed.
        speedup: Option<Estimate>,
    },
    /// Some variants are within the budget, but none is faster than the original beyond noise.
    NoGain {
        variant: String,
        error: f64,
        /// The original's time over its own.
        speedup: Estimate,
    },
    /// None is within the budget.
    None {
        /// The variant nearest to the budget, the fastest of several; `None`: none was drawn and
        /// held its promise.
        nearest: Option<String>,
        error: Option<f64>,
        /// The original's time over its own.
        speedup: Option<Estimate>,
    },
}

/// A variant that was drawn, its error and its speedup.
#[derive(Clone, Copy)]
struct Compared<'a> {
    variant: &'a VariantReport,
    error: f64,
    speedup: Option<Estimate>,
}

impl Compared<'_> {
    /// The better first: the least error, then the greatest speedup.
    fn by_error(&self, other: &Self) -> Ordering {
        let speed = |d: &Self| d.speedup.map_or(0.0, |s| s.median);
        let faster = speed(other).total_cmp(&speed(self));
        self.error.total_cmp(&other.error).then(faster)
    }
}

impl Chosen {
    /// Selects from these variants, except the original.
    pub fn among(variants: &[VariantReport], budget: Budget) -> Self {
        Self {
            budget,
            choice: Choice::among(variants, budget),
            recipe: None,
            unverified: 0,
        }
    }

    /// The same, with this number of unverified variants.
    #[must_use]
    pub fn beside(mut self, unverified: usize) -> Self {
        self.unverified = unverified;
        self
    }

    /// The same, with the recipe that `promised` returns for the chosen variant.
    #[must_use]
    pub fn made_by(mut self, promised: impl FnOnce(&str) -> Option<Recipe>) -> Self {
        if let Choice::Within { variant, .. } = &self.choice {
            self.recipe = promised(variant).as_ref().map(Recipe::as_passes);
        }
        self
    }
}

impl Choice {
    fn among(variants: &[VariantReport], budget: Budget) -> Self {
        let drawn = variants.iter().filter(|v| v.name != ORIGINAL);
        let drawn: Vec<Compared<'_>> = drawn
            .filter_map(|variant| {
                let error = variant.error.as_ref()?;
                // A variant that breaks its own promise is not for shipping, whatever this budget
                // allows.
                let stands = !matches!(
                    variant.verdict,
                    Verdict::NotMeasured { .. } | Verdict::Broken { .. }
                );
                (stands && error.nan_pixels == 0).then(|| Compared {
                    variant,
                    error: budget.of(error),
                    speedup: variant.speedup,
                })
            })
            .collect();
        let within = || drawn.iter().filter(|d| d.error <= budget.limit);
        let timed = || within().filter_map(|d| Some((d, d.speedup?)));
        let median = |a: &(&Compared<'_>, Estimate), b: &(&Compared<'_>, Estimate)| {
            a.1.median.total_cmp(&b.1.median)
        };
        // A gain within noise does not count, however large its median.
        let gains = timed()
            .filter(|(_, speedup)| speedup.low > 1.0)
            .max_by(median);
        let fastest = gains.or_else(|| timed().max_by(median));
        let best = within().min_by(|a, b| a.by_error(b));
        match (fastest, best) {
            (Some((d, speedup)), _) if speedup.low > 1.0 => Self::Within {
                variant: d.variant.name.clone(),
                error: d.error,
                speedup: Some(speedup),
            },
            (Some((d, speedup)), _) => Self::NoGain {
                variant: d.variant.name.clone(),
                error: d.error,
                speedup,
            },
            (None, Some(d)) => Self::Within {
                variant: d.variant.name.clone(),
                error: d.error,
                speedup: None,
            },
            (None, None) => {
                let nearest = drawn.iter().min_by(|a, b| a.by_error(b));
                Self::None {
                    nearest: nearest.map(|d| d.variant.name.clone()),
                    error: nearest.map(|d| d.error),
                    speedup: nearest.and_then(|d| d.speedup),
                }
            }
        }
    }
}
