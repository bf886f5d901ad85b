//! The promise that a variant makes about its picture, and the verdict of a measurement.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::budget::Budget;

/// A condition of a promise. The host or a measurement has to ensure it.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Assumption {
    /// No two surviving fragments of one pixel (or sample) have the same depth.
    NoDepthTies,
    /// Both passes rasterise the same position bits from the same inputs.
    InvariantPosition,
    /// No other opaque material of the frame moves depth away from the viewer or leaves traces of
    /// hidden fragments (stencil, stores). None writes depth without the colour channels that
    /// others write. Where a material is shaded from ids, all others write depth, share no depth
    /// value with it, and are drawn before it.
    OrdinaryNeighbours,
    /// No other opaque material of the frame writes the colour channels or targets that this one
    /// leaves unwritten: hidden surfaces would show there.
    LeftChannelsUnwritten,
    /// No surface lies exactly on the near plane. In a float format, bias vanishes at depth 0;
    /// clamped depths were biased before; and a triangle without area has no slope to bias by.
    BeyondNearPlane,
    /// The original's position is already `@invariant`. If it isn't, marking it may move positions
    /// by their last bits.
    InvariantOriginal,
    /// The discard or depth slice computes the same result in both passes.
    InvariantDiscard,
    /// Alpha to coverage derives the same mask from the same alpha at the same pixel in every pass.
    /// The languages leave the mask to the implementation.
    SameAlphaCoverage,
    /// All passes of a frame use one viewport and one jitter.
    SameViewport,
    /// Opaque draws come in the same order in every pass where order matters.
    SameDrawOrder,
    /// Two stages (vertex, fragment or compute) compute the same bits from the same inputs: the
    /// compiler fuses the same multiply-adds in both, and neither takes a subnormal number for 0 that
    /// the other keeps. Where a scene gives the numbers of its draws, no value moves that depends on a
    /// subnormal one.
    StagesAgree,
    /// An interpolated number is within 2^-18 of the largest value at the corners of its triangle.
    /// No language guarantees this. Slivers thinner than a rasteriser's grid, or many times as long as
    /// the screen, exceed it.
    FineInterpolation,
    /// The driver chooses the quad neighbours of coarse derivatives and of samples at an implicit
    /// level. It chooses those that the variant's parameters name
    /// ([`crate::rasterizer::Rasterizer`]).
    DerivativeNeighbours,
    /// The rasteriser chooses whether it interpolates between the given corners or between corners
    /// snapped to its grid. It chooses as the variant's parameters name
    /// ([`crate::rasterizer::Corners`]).
    InterpolatedCorners,
    /// Varyings, constants of the draw and texels are within 4 of 0, and the draw's divisors are at
    /// least a quarter. No larger factor multiplies a rounding error.
    OrdinaryNumbers,
    /// Varyings and constants of the draw stay in the ranges of the scene that the variant was made
    /// for, and texels are within 4 of 0.
    NumbersOfTheScene,
    /// Positions computed by two pipelines from one source differ by less than the pass's bias or tolerance.
    PositionWithinBias,
    /// Whether a compiler fuses or reorders a float operation depends only on the float operations
    /// around it, their basic blocks and their number of uses.
    SameContraction,
    /// No value that is multiplied by a weight of 0 is NaN or infinite. Float textures may hold
    /// such texels.
    FiniteTaps,
    /// The draw's values lie in the ranges of the plan's guard ([`crate::guard`]).
    ValuesOfTheGuard,
    /// No pass of the frame writes a texture that is read once a draw, before the material is drawn.
    SteadyTextures,
    /// The viewport's depth range is 0 to 1. Depths that a shader writes are clamped to it.
    WholeDepthRange,
    /// The position's text is the author's, and other code joined or left its vertex stage: the
    /// driver computes the same bits as in the original. The self-test checks this.
    UnchangedPosition,
    /// The budget was measured with the views, values and textures of a scene. Others may differ by
    /// more.
    MeasuredScene,
    /// No picture was measured, or only pictures of a scene that preshade made up: the budget is the
    /// user's wish.
    NotMeasured,
}

impl Assumption {
    /// The JSON name and the description of every assumption.
    pub fn all() -> Vec<(String, String)> {
        let schema = schemars::schema_for!(Assumption).to_value();
        let each = schema["oneOf"].as_array().into_iter().flatten();
        each.filter_map(|a| {
            let text = |key: &str| Some(a[key].as_str()?.to_owned());
            Some((text("const")?, text("description")?))
        })
        .collect()
    }
}

/// The promise of a transform. Ordered from strongest to weakest; a plan has the weakest contract
/// of its steps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum Contract {
    /// The same bits on the same adapter, under the assumptions. One changed pixel is a bug.
    Exact {
        /// Sorted, each once.
        given: Vec<Assumption>,
    },
    /// The same function of real numbers, evaluated in another place. The error is at most `k *
    /// 2^-24 * sum |a_i x_i|`, plus the interpolator's own.
    Rounding {
        /// Number of roundings that may differ.
        k: u32,
        /// How roundings may change decisions. Absent: no decision depends on them, and each pixel
        /// differs by its roundings only.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        turned: Option<Turned>,
        /// Sorted, each once.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        given: Vec<Assumption>,
    },
    /// May differ by at most the user's budget, measured at the output.
    Approximate {
        /// Largest difference.
        #[serde(flatten)]
        budget: Budget,
        /// Sorted, each once.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        given: Vec<Assumption>,
    },
    /// Several approximations, each with a budget in its own metric. All of them hold, measured at
    /// the output of the whole.
    Budgets {
        /// Each metric once.
        budgets: Vec<Budget>,
        /// Sorted, each once.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        given: Vec<Assumption>,
    },
}

/// The part of a picture that roundings may change completely: comparisons, discards, texels and
/// edges close to their threshold.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub struct Turned {
    /// Largest share of pixels that may differ by more than roundings, 0 to 1.
    pub share: f64,
    /// Whether roundings may move the surface.
    pub surface: Surface,
}

/// Screen position and depth of triangles.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "kebab-case")]
pub enum Surface {
    /// Same bits as in the original.
    Kept,
    /// Positions are rounded differently. Depths may differ; they are measured but not promised.
    Rounded,
}

impl Turned {
    /// Largest share that is ever promised: one pixel in a thousand.
    const MOST: f64 = 1.0 / 1024.0;

    /// The share for `k` roundings, estimated before drawing. We assume that a deciding number
    /// crosses its own magnitude within 1,024 pixels, so `k` roundings of 2^-24 move an edge by at
    /// most `k` 2^-14 of a pixel, and that an edge runs through one pixel of 16. Outlines of a
    /// moved surface count likewise.
    pub fn on(k: u32, surface: Surface) -> Self {
        let share = f64::from(k) / f64::from(1 << 18);
        Self {
            share: share.min(Self::MOST),
            surface,
        }
    }

    fn and(self, other: Self) -> Self {
        Self {
            share: (self.share + other.share).min(Self::MOST),
            surface: self.surface.max(other.surface),
        }
    }
}

impl std::fmt::Display for Turned {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "decisions may turn on them in {:.3} % of the pixels",
            100.0 * self.share
        )?;
        match self.surface {
            Surface::Kept => Ok(()),
            Surface::Rounded => write!(f, ", depth is rounded too"),
        }
    }
}

impl Contract {
    pub fn exact() -> Self {
        Self::Exact { given: Vec::new() }
    }

    /// Its kind, as in the JSON.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Exact { .. } => "exact",
            Self::Rounding { .. } => "rounding",
            Self::Approximate { .. } => "approximate",
            Self::Budgets { .. } => "budgets",
        }
    }

    /// The contract of applying both. Assumptions are united, and the weaker kind wins. All budgets
    /// remain, because they are about the output; of one metric, the smaller one.
    pub fn and(self, other: Self) -> Self {
        use Contract::{Exact, Rounding};
        let budgets = self.budgets().into_iter().chain(other.budgets());
        let mut narrowest: Vec<Budget> = Vec::new();
        for budget in budgets {
            match narrowest.iter_mut().find(|b| b.metric == budget.metric) {
                Some(have) => have.limit = have.limit.min(budget.limit),
                None => narrowest.push(budget),
            }
        }
        let mut given = [self.given(), other.given()].concat();
        given.sort();
        given.dedup();
        match (self, other) {
            (Exact { .. }, Exact { .. }) => Exact { given },
            (
                Rounding {
                    k: a, turned: s, ..
                },
                Rounding {
                    k: b, turned: t, ..
                },
            ) => Rounding {
                k: a + b,
                turned: match (s, t) {
                    (Some(s), Some(t)) => Some(s.and(t)),
                    (one, other) => one.or(other),
                },
                given,
            },
            (Rounding { k, turned, .. }, Exact { .. })
            | (Exact { .. }, Rounding { k, turned, .. }) => Rounding { k, turned, given },
            _ => match narrowest.len() {
                1 => Self::Approximate {
                    budget: narrowest.remove(0),
                    given,
                },
                _ => Self::Budgets {
                    budgets: narrowest,
                    given,
                },
            },
        }
    }

    pub fn given(&self) -> &[Assumption] {
        match self {
            Self::Exact { given }
            | Self::Rounding { given, .. }
            | Self::Approximate { given, .. }
            | Self::Budgets { given, .. } => given,
        }
    }

    /// Adds the assumptions that a budget is based on. Nothing measured is the weaker evidence.
    pub(crate) fn base_budgets_on(&mut self, evidence: &[Assumption]) {
        if let Self::Approximate { given, .. } | Self::Budgets { given, .. } = self {
            given.extend(evidence.iter().cloned());
            if given.contains(&Assumption::NotMeasured) {
                given.retain(|a| *a != Assumption::MeasuredScene);
            }
            given.sort();
            given.dedup();
        }
    }

    /// The budgets, all of which bind. Empty for the stronger kinds.
    pub fn budgets(&self) -> Vec<Budget> {
        match self {
            Self::Exact { .. } | Self::Rounding { .. } => Vec::new(),
            Self::Approximate { budget, .. } => vec![*budget],
            Self::Budgets { budgets, .. } => budgets.clone(),
        }
    }
}

/// The result of measuring a contract on one adapter in one emitted form.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum Verdict {
    /// Every compared picture and depth buffer was within the contract.
    Holds,
    /// At least one was not.
    Broken {
        /// Camera, draw order and first differing pixel.
        r#where: String,
    },
    /// Nothing was compared; never counts as a pass.
    NotMeasured {
        /// The reason.
        why: String,
    },
}

#[cfg(test)]
mod tests {
    use super::{Assumption, Budget, Contract};
    use crate::budget::Metric;

    #[test]
    fn every_assumption_says_what_it_is() {
        let all = Assumption::all();
        let ties = all.iter().find(|(name, _)| name == "no-depth-ties");
        assert!(
            ties.is_some_and(|(_, text)| text.contains("same depth")),
            "{all:?}"
        );
        let last = serde_json::to_value(Assumption::ValuesOfTheGuard).unwrap_or_default();
        assert!(all.iter().any(|(name, _)| *name == last), "{all:?}");
    }

    fn approximate(metric: Metric, limit: f64) -> Contract {
        Contract::Approximate {
            budget: Budget { metric, limit },
            given: Vec::new(),
        }
    }

    #[test]
    fn budgets_of_different_metrics_are_all_kept() {
        let rounding = |k| Contract::Rounding {
            k,
            turned: None,
            given: Vec::new(),
        };
        let mean = approximate(Metric::FlipMean, 0.05);
        let both = mean.clone().and(approximate(Metric::MaxAbs, 0.02));
        let all =
            |c: &Contract| -> Vec<String> { c.budgets().iter().map(ToString::to_string).collect() };
        let expected = ["flip_mean at most 0.05", "max_abs at most 0.02"];
        assert_eq!(all(&both), expected);
        assert_eq!(both.kind(), "budgets");
        for stronger in [Contract::exact(), rounding(3)] {
            assert_eq!(both.clone().and(stronger.clone()), both);
            assert_eq!(stronger.clone().and(both.clone()), both);
            assert_eq!(stronger.and(mean.clone()), mean);
        }
        let narrower = both.clone().and(approximate(Metric::FlipMean, 0.01));
        assert_eq!(all(&narrower), ["flip_mean at most 0.01", expected[1]]);
        assert_eq!(
            approximate(Metric::MaxAbs, 0.5).and(approximate(Metric::MaxAbs, 0.1)),
            approximate(Metric::MaxAbs, 0.1)
        );
        let exact = Contract::Exact {
            given: vec![Assumption::NoDepthTies],
        };
        for weaker in [both.clone(), approximate(Metric::MaxAbs, 0.1), rounding(3)] {
            for under in [weaker.clone().and(exact.clone()), exact.clone().and(weaker)] {
                assert_eq!(under.given(), [Assumption::NoDepthTies]);
                assert_eq!(under.clone().and(exact.clone()), under);
            }
        }
        let json = serde_json::to_value(&both).unwrap_or_default();
        assert_eq!(serde_json::from_value::<Contract>(json).ok(), Some(both));
    }
}
