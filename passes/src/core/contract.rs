//! What a variant promises about its picture, and what measurement says of the promise.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A condition that a promise rests on. The host, or a measurement, has to see to it.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Assumption {
    /// No two surviving fragments of one pixel (or sample) have the same depth.
    NoDepthTies,
    /// Both passes rasterise the same position bits from the same inputs.
    InvariantPosition,
    /// No other opaque material of the frame moves depth away from the viewer or leaves traces of hidden fragments (stencil, stores), and none that writes depth
    /// leaves colour channels as they are that others write. Beside what is shaded from ids each of them writes its depth, and has
    /// none in common with it: it is drawn after it, whatever their order.
    OrdinaryNeighbours,
    /// No other opaque material of the frame writes the colour channels, or targets, that this one leaves as they are: what lies hidden would show there.
    LeftChannelsUnwritten,
    /// No surface lies exactly on the near plane: at depth 0 of a float format bias vanishes, what is clamped there was biased before, and what an adapter draws there of a triangle of no
    /// area has no slope to be biased by.
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
    /// The vertex and the fragment stage compute the same bits from the same inputs: whichever of its products a compiler fuses with a sum, it fuses in both.
    StagesAgree,
    /// Textures that are sampled at interpolated coordinates, or at an implicit level, are filtered, within a level and between levels, and with an anisotropy of 1: a nearest sampler jumps, and how many texels an
    /// anisotropic one takes.
    FilteredTextures,
    /// An interpolated number is within 2^-18 of the largest at the corners of its triangle. No language says so; slivers many times as long as the screen go beyond it.
    FineInterpolation,
    /// Which neighbours in its quad a pixel's derivative is taken of, where it is not fine, and a sample's at an implicit level, is the driver's choice: it takes those that the
    /// variant's parameters say ([`crate::core::rasterizer::Rasterizer`]).
    DerivativeNeighbours,
    /// Between which corners a rasteriser interpolates, as given or snapped to its grid, is its own choice: it takes those that the variant's parameters say
    /// ([`crate::core::rasterizer::Corners`]).
    InterpolatedCorners,
    /// No triangle is clipped that has a varying interpolated linearly on the screen: between which corners that is then done is the driver's choice.
    UnclippedLinear,
    /// No triangle that is seen is clipped: a rasteriser that snaps corners interpolates between those that clipping makes, and where it clips, at the near plane alone or far out of
    /// the viewport too, is its own choice.
    UnclippedTriangles,
    /// No triangle that is seen has an area on the rasteriser's grid alone: what is interpolated over one that has none as its corners are given rests on what rounding left.
    TrianglesWithArea,
    /// From what is interpolated or sampled to what is stored, slopes are small enough that the last bits in which two rasterisers differ, and the 256th of a texel's contrast that
    /// they may become in the weights of a filter, stay within a step: the `pow` of a highlight on a normal map may be steeper.
    GentleSlopes,
    /// Varyings, constants of the draw and texels are no further from 0 than 4, and what is divided by of the draw no nearer than a quarter: a rounding meets no larger factor.
    OrdinaryNumbers,
    /// Varyings and constants of the draw lie where they lay in the frames of the scene the variant was made for, and texels no further from 0 than 4.
    NumbersOfTheScene,
    /// Positions computed by two pipelines from one source differ by less than the pass's bias or tolerance.
    PositionWithinBias,
    /// What a compiler fuses and reorders rests on no more of an operation than the float operations it takes operands from, whether they stand in one basic block, and how many read them.
    SameContraction,
    /// What is multiplied with a weight of 0 is neither NaN nor infinite: textures of floating point may hold such texels.
    FiniteTaps,
    /// The values that a draw is made with lie where the plan's guard says ([`crate::core::guard`]).
    ValuesOfTheGuard,
}

impl Assumption {
    /// Each one's name as the JSON spells it, and what it says.
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
        /// What decisions may turn on them; absent: none rests on them, and each pixel keeps to its roundings.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        turned: Option<Turned>,
        /// Sorted, each once.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        given: Vec<Assumption>,
    },
    /// Allowed to differ, by at most the user's budget, measured at the output.
    Approximate {
        /// `max_abs`, `flip_mean` or `flip_p99`.
        metric: String,
        /// Largest value of the metric.
        budget: f64,
        /// Sorted, each once.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        given: Vec<Assumption>,
    },
    /// Several approximations, each with a budget in a metric of its own: all are kept, each measured at the output of the whole.
    Budgets {
        /// Each metric once.
        budgets: Vec<Budget>,
        /// Sorted, each once.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        given: Vec<Assumption>,
    },
}

/// What of a picture may turn on roundings: a comparison, a discard, a texel, an edge that lies within them of where it falls otherwise.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub struct Turned {
    /// Part of the pixels, at most, that may differ by more than roundings do, 0 to 1.
    pub share: f64,
    /// Whether the surface itself may move by roundings.
    pub surface: Surface,
}

/// Where triangles lie on the screen, and how deep.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "kebab-case")]
pub enum Surface {
    /// Where the original's do: depth keeps its bits.
    Kept,
    /// Positions are rounded otherwise: depths may differ, which is measured and no promise is about.
    Rounded,
}

impl Turned {
    /// Largest share that is ever promised: one pixel in a thousand.
    const MOST: f64 = 1.0 / 1024.0;

    /// What may turn on `k` roundings, reckoned before anything is drawn. A number that decides is taken to run through its own size over no more than 1,024 pixels where it turns: `k`
    /// roundings of 2^-24 then move an edge by no more than `k` 2^-14 of a pixel, and an edge is taken to run through one pixel of 16. The same holds of the outlines of a surface that moves.
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

/// What an output may be off by.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Budget {
    /// `max_abs`, `flip_mean` or `flip_p99`.
    pub metric: String,
    /// Largest value of the metric.
    pub budget: f64,
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

impl std::fmt::Display for Budget {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} at most {}", self.metric, self.budget)
    }
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
            Self::Budgets { .. } => "budgets",
        }
    }

    /// The contract of doing both: assumptions gather, of whatever kind, and weaker kinds win. Budgets are on the output, so that all of them stay; of one metric the narrowest.
    pub fn and(self, other: Self) -> Self {
        use Contract::{Exact, Rounding};
        let budgets = self.budgets().into_iter().chain(other.budgets());
        let mut narrowest: Vec<Budget> = Vec::new();
        for budget in budgets {
            match narrowest.iter_mut().find(|b| b.metric == budget.metric) {
                Some(have) => have.budget = have.budget.min(budget.budget),
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
                1 => {
                    let Budget { metric, budget } = narrowest.remove(0);
                    Self::Approximate {
                        metric,
                        budget,
                        given,
                    }
                }
                _ => Self::Budgets {
                    budgets: narrowest,
                    given,
                },
            },
        }
    }

    /// What the promise rests on.
    pub fn given(&self) -> &[Assumption] {
        match self {
            Self::Exact { given }
            | Self::Rounding { given, .. }
            | Self::Approximate { given, .. }
            | Self::Budgets { given, .. } => given,
        }
    }

    /// What the output is allowed to be off by: all of them bind. Empty for the stronger kinds.
    pub fn budgets(&self) -> Vec<Budget> {
        match self {
            Self::Exact { .. } | Self::Rounding { .. } => Vec::new(),
            Self::Approximate { metric, budget, .. } => vec![Budget {
                metric: metric.clone(),
                budget: *budget,
            }],
            Self::Budgets { budgets, .. } => budgets.clone(),
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

#[cfg(test)]
mod tests {
    use super::{Assumption, Contract};

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

    fn approximate(metric: &str, budget: f64) -> Contract {
        Contract::Approximate {
            metric: metric.to_owned(),
            budget,
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
        let mean = approximate("flip_mean", 0.05);
        let both = mean.clone().and(approximate("max_abs", 0.02));
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
        // Of one metric the narrower, in either order.
        let narrower = both.clone().and(approximate("flip_mean", 0.01));
        assert_eq!(all(&narrower), ["flip_mean at most 0.01", expected[1]]);
        assert_eq!(
            approximate("max_abs", 0.5).and(approximate("max_abs", 0.1)),
            approximate("max_abs", 0.1)
        );
        // What either rests on, both rest on.
        let exact = Contract::Exact {
            given: vec![Assumption::NoDepthTies],
        };
        for weaker in [both.clone(), approximate("max_abs", 0.1), rounding(3)] {
            for under in [weaker.clone().and(exact.clone()), exact.clone().and(weaker)] {
                assert_eq!(under.given(), [Assumption::NoDepthTies]);
                assert_eq!(under.clone().and(exact.clone()), under);
            }
        }
        let json = serde_json::to_value(&both).unwrap_or_default();
        assert_eq!(serde_json::from_value::<Contract>(json).ok(), Some(both));
    }
}
