//! What a variant promises about its picture, and what measurement says of the promise.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A condition an [`Contract::Exact`] promise rests on. The host, or a measurement, has to see to it.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Assumption {
    /// No two surviving fragments of one pixel (or sample) have the same depth.
    NoDepthTies,
    /// Both passes rasterise the same position bits from the same inputs.
    InvariantPosition,
    /// No other opaque material of the frame moves depth away from the viewer or leaves traces of hidden fragments (stencil, stores), and none that writes depth
    /// leaves colour channels as they are that others write.
    OrdinaryNeighbours,
    /// No other opaque material of the frame writes the colour channels, or targets, that this one leaves as they are: what lies hidden would show there.
    LeftChannelsUnwritten,
    /// No surface lies exactly on the near plane, at depth 0 of a float format, where bias vanishes.
    BeyondNearPlane,
    /// The original's position is `@invariant` already. Where it is not, marking it may move positions by their last bits.
    InvariantOriginal,
    /// The discard or depth slice gives the same answer in both passes.
    InvariantDiscard,
    /// Alpha to coverage makes the same mask of the same alpha at the same pixel, in every pass. The languages leave the mask to the implementation.
    SameAlphaCoverage,
    /// All passes of a frame use one viewport and one jitter.
    SameViewport,
    /// Opaque draws come in one order in every pass in which order decides.
    SameDrawOrder,
    /// The vertex and the fragment stage compute the same bits from the same inputs.
    StagesAgree,
    /// Positions computed by two pipelines from one source differ by less than the pass's bias or tolerance.
    PositionWithinBias,
}

/// What a transform promises. Ordered from strongest to weakest; the contract of a plan is the weakest of its steps'.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum Contract {
    /// The same bits on the same adapter, given the assumptions. One changed pixel is a bug.
    Exact {
        /// Sorted, each once.
        given: Vec<Assumption>,
    },
    /// The same function of real numbers, evaluated elsewhere: the error is at most `k * 2^-24 * sum |a_i x_i|` and the
    /// interpolator's own.
    Rounding {
        /// Number of roundings that may differ.
        k: u32,
    },
    /// Allowed to differ, by at most the user's budget, measured at the output.
    Approximate {
        /// `max_abs`, `flip_mean` or `flip_p99`.
        metric: String,
        /// Largest value of the metric.
        budget: f64,
    },
}

impl Contract {
    /// `Exact` under nothing.
    pub fn exact() -> Self {
        Self::Exact { given: Vec::new() }
    }

    /// Its kind, as the JSON spells it.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Exact { .. } => "exact",
            Self::Rounding { .. } => "rounding",
            Self::Approximate { .. } => "approximate",
        }
    }

    /// The contract of doing both: assumptions gather, weaker kinds win.
    pub fn and(self, other: Self) -> Self {
        use Contract::{Approximate, Exact, Rounding};
        match (self, other) {
            (Exact { given: mut a }, Exact { given: b }) => {
                a.extend(b);
                a.sort();
                a.dedup();
                Exact { given: a }
            }
            (Rounding { k: a }, Rounding { k: b }) => Rounding { k: a + b },
            (a @ Approximate { .. }, Exact { .. } | Rounding { .. })
            | (a @ Rounding { .. }, Exact { .. }) => a,
            (Exact { .. } | Rounding { .. }, b @ Approximate { .. })
            | (Exact { .. }, b @ Rounding { .. }) => b,
            // Errors do not add along a cut, and a budget is on the output: the narrower one binds where the metric agrees.
            (
                Approximate {
                    metric: m,
                    budget: a,
                },
                Approximate {
                    metric: n,
                    budget: b,
                },
            ) => {
                if m == n {
                    Approximate {
                        metric: m,
                        budget: a.min(b),
                    }
                } else {
                    Approximate {
                        metric: m,
                        budget: a,
                    }
                }
            }
        }
    }
}

/// What measurement says of a contract, on one adapter and in one emitted form.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum Verdict {
    /// Every picture and depth buffer compared was within the contract.
    Holds,
    /// At least one was not.
    Broken {
        /// Camera, draw order and first differing pixel, in words.
        r#where: String,
    },
    /// Nothing was compared; never counts as a pass.
    NotMeasured {
        /// Why not.
        why: String,
    },
}
