//! What to say where nothing pays: the one thing that would let a value travel, or that there is none.

use super::choose::{self, Terms};
use super::travel::{self, Assumed, Class, Judged, Jumps, Precision};
use super::{Hoist, Material, Params};
use crate::analysis::values::Values;
use crate::core::pass::{Facts, Pass, Refusal};

/// What would let a value travel where none does. It is chosen among what all of these together would let travel, so that following the advice comes to an end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Advice {
    /// A budget.
    Budget,
    /// A budget, where the author has asked for a promise that needs none.
    Allow,
    /// Values at vertices taken for finite: by the author's word, or as measured.
    Finite,
    /// Values that rest on what jumps taken for smooth, in the same ways.
    Jumps,
    /// A larger error than the one allowed, for some were measured.
    Error,
    /// A choice anew.
    Choice,
    /// Nothing: with all of these no value pays.
    Nothing,
}

impl Advice {
    /// For a material of which nothing travels under `params` and `facts`. `all` and `judged` are the verdicts under [`Assumed::ALL`], and those that nothing travels under.
    pub(super) fn on(
        values: &Values<'_, '_>,
        material: &Material<'_>,
        params: &Params,
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
            verdicts: travel::held_back(values, assumed, precision, &all.verdicts),
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
            // No choice and no measurement stand behind them here.
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
                "leave `allow` out and give a budget (hoist:budget=0.01) if the picture may differ a little"
            }
            Self::Finite => {
                "what would pay is not seen to be finite at every vertex: `preshade verify` with hoist:budget=0.01 draws it, and says what `rewrite` may take; or take it for finite, with hoist:budget=0.01,finite=assumed"
            }
            Self::Jumps => {
                "what would pay rests on what jumps (explain says on what): `preshade verify` with hoist:budget=0.01 draws it, and says what `rewrite` may take; or take it to change slowly over a triangle, as noise does, with jumps=carried beside the budget"
            }
            Self::Error => {
                "allow a larger error; explain lists what stays, and why each value does"
            }
            Self::Choice => "choose anew with `verify`: what `carry` names does not pay here",
            Self::Nothing => {
                "nothing would at any budget: leave the material as it is; explain lists what stays, and why each value does"
            }
        };
        Refusal::new(
            Hoist::INFO.name,
            "nothing-pays",
            "no value that may travel saves a fragment more than carrying it costs",
            remedy,
        )
    }
}
