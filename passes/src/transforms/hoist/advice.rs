//! The remedy if nothing pays: the one relaxation that would help, or that there is none.

use super::choose::{self, Terms};
use super::movable::{self, Assumed, Class, Judged, Jumps, Precision};
use super::{Hoist, HoistMaterial, HoistParams};
use crate::analysis::refusals as shared;
use crate::analysis::values::Values;
use preshade_plan::pass::{Facts, Pass, Refusal};

/// The one relaxation under which a value could move. We choose it under all relaxations together,
/// so that following the advice terminates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Advice {
    Budget,
    /// A budget: the user requested a contract that needs none.
    Allow,
    /// Treat values at vertices as finite: by assumption or by measurement.
    Finite,
    /// Treat values that depend on a discontinuity as smooth: by assumption or by measurement.
    Jumps,
    /// A larger error limit; some values were measured.
    Error,
    Choice,
    /// Nothing: no value pays under all relaxations together.
    Nothing,
}

impl Advice {
    /// The advice for a material without movable values under `params` and `facts`. `all` and
    /// `judged` are the verdicts under [`Assumed::ALL`] and the current ones.
    pub(super) fn on(
        values: &Values<'_, '_>,
        material: &HoistMaterial<'_>,
        params: &HoistParams,
        precision: &Precision,
        facts: &Facts,
        [all, judged]: [&Judged; 2],
    ) -> Self {
        let terms = Terms {
            weakest: Class::Smooth,
            ..params.terms(facts)
        };
        let pays =
            |judged: &Judged| choose::choose(values, judged, precision.most, &terms).is_some();
        if !pays(all) {
            return Self::Nothing;
        }
        let under = |assumed: Assumed| Judged {
            verdicts: movable::held_back(values, assumed, precision, &all.verdicts),
            ..all.clone()
        };
        let carried = Assumed {
            jumps: Jumps::Carried,
            ..params.assumed()
        };
        let was_measured = facts
            .frequencies
            .iter()
            .any(|f| f.material == material.name);
        match params.weakest() {
            _ if params.carry.is_some() => Self::Choice,
            Class::Smooth if was_measured => Self::Error,
            weakest if weakest != Class::Smooth && params.allow.is_some() => Self::Allow,
            // No choice and no measurement apply here.
            weakest if weakest != Class::Smooth && pays(judged) => Self::Budget,
            _ if params.jumps == Jumps::Stay && pays(&under(carried)) => Self::Jumps,
            _ => Self::Finite,
        }
    }

    pub(super) fn refusal(self) -> Refusal {
        let remedy = match self {
            Self::Budget => {
                "give the pass a budget (hoist:budget=0.01) if the picture may differ a little"
            }
            Self::Allow => {
                "leave `allow` out and give a budget (hoist:budget=0.01) if the picture may differ \
                 a little"
            }
            Self::Finite => {
                "the values that would pay may be NaN or infinite at a vertex: run `preshade \
                 verify` with hoist:budget=0.01, which measures them and prints what `rewrite` may \
                 hoist; or assume that they are finite: hoist:budget=0.01,finite=assumed"
            }
            Self::Jumps => {
                "the values that would pay depend on a discontinuity (`preshade explain` names \
                 it): run `preshade verify` with hoist:budget=0.01, which measures them and prints \
                 what `rewrite` may hoist; or add jumps=carried to the budget, which assumes that \
                 they change slowly over a triangle, as noise does"
            }
            Self::Error => {
                "allow a larger error; `preshade explain` lists the values that are not hoisted, \
                 and why"
            }
            Self::Choice => {
                "choose again with `verify`: hoisting the values that `carry` names does not pay \
                 here"
            }
            Self::Nothing => {
                "leave the material as it is: no budget would help; \
                 `preshade explain` lists the values that are not hoisted, and why"
            }
        };
        Refusal::new(
            Hoist::INFO.name,
            &shared::NOTHING_PAYS,
            "no value that may be hoisted saves a fragment more than interpolating it costs",
            remedy,
        )
    }
}
