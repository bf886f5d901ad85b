//! Whether a difference keeps a contract.

use preshade_plan::budget::Budget;
use preshade_plan::contract::{Assumption, Contract, Surface, Turned};
use preshade_plan::plan::{GpuPass, Phase, Plan, Role};

use super::error::counted;
use super::{ErrorLadder, shadow};

/// Whether the contract is about an original with `@invariant` positions.
pub(super) fn needs_invariant_original(contract: &Contract) -> bool {
    contract.given().contains(&Assumption::InvariantOriginal)
}

/// The joint promise of the plans of a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Promise {
    /// The contract of all together.
    pub contract: Contract,
    /// Whether depths have the original's bits, whatever the colours may do.
    pub keeps_depth: bool,
}

impl Promise {
    /// The promise of `plans`: the weakest of theirs, with all budgets.
    pub fn of<'p>(plans: impl IntoIterator<Item = &'p Plan>) -> Self {
        let mut this = Self {
            contract: Contract::exact(),
            keeps_depth: true,
        };
        for plan in plans {
            // A budget of 1 is that of a diagnostic picture, which promises nothing.
            let is_diagnostic = plan.contract.budgets().iter().any(|b| b.limit >= 1.0);
            this.keeps_depth &= keeps_positions(plan) && !is_diagnostic;
            this.contract = this.contract.and(plan.contract.clone());
        }
        this
    }

    /// How a difference breaks the promise; `None`: it does not.
    pub fn broken(&self, error: &ErrorLadder) -> Option<String> {
        let is_budget = !self.contract.budgets().is_empty();
        if is_budget && self.keeps_depth && error.changed_depth > 0 {
            let depths = counted(error.changed_depth, "depth");
            return Some(format!("{depths} differ, which no budget allows"));
        }
        breaks(&self.contract, error)
    }
}

/// Whether the plan's triangles have the original's position bits, as its steps promise.
pub(super) fn keeps_positions(plan: &Plan) -> bool {
    let rounds = plan.steps.iter().any(|step| {
        matches!(step.contract, Contract::Rounding { turned: Some(t), .. } if t.surface == Surface::Rounded)
    });
    let is_divided = plan
        .passes
        .iter()
        .any(|pass| pass.geometry.subdivision().is_some());
    // A budget does not show whether the id joined the author's vertex stage, which moves
    // positions.
    let joined = plan.passes.iter().any(|pass| pass.role == Role::Ids)
        && !plan.contract.budgets().is_empty()
        && !shadow::has_invariant_position(plan);
    !rounds && !is_divided && !joined
}

/// How a difference breaks a contract; `None` where it does not.
pub fn breaks(contract: &Contract, error: &ErrorLadder) -> Option<String> {
    match contract {
        Contract::Exact { .. } if error.is_exact() => None,
        Contract::Exact { .. } => {
            let [x, y] = error.first_difference.unwrap_or_default();
            Some(format!(
                "{} and {} differ, the first at {x}, {y}",
                counted(error.changed_pixels, "pixel"),
                counted(error.changed_depth, "depth")
            ))
        }
        Contract::Rounding { k, turned, .. } => rounded_too_far(*k, *turned, error),
        Contract::Approximate { .. } | Contract::Budgets { .. } => {
            let broken: Vec<String> = contract
                .budgets()
                .iter()
                .filter(|budget| !budget.allows(error))
                .map(|budget| {
                    let Budget { metric, limit } = budget;
                    let value = budget.of(error);
                    format!("{metric} is {value:.6} of a budget of {limit}")
                })
                .collect();
            (!broken.is_empty()).then(|| broken.join(", "))
        }
    }
}

/// Describes a difference that exceeds `k` roundings and the allowed share of flipped decisions.
fn rounded_too_far(k: u32, turned: Option<Turned>, error: &ErrorLadder) -> Option<String> {
    // A rounding changes a stored channel by at most one step.
    let allowed = 1.0 / 255.0 + f64::from(k) * f64::from(f32::EPSILON) / 2.0;
    if error.nan_pixels > 0 {
        return Some(format!(
            "not finite: {}",
            counted(error.nan_pixels, "pixel")
        ));
    }
    // Depth is not shaded, so its bits stay equal unless positions are rounded.
    let is_kept = turned.is_none_or(|t| t.surface == Surface::Kept);
    if is_kept && error.changed_depth > 0 {
        return Some(format!(
            "differing: {}",
            counted(error.changed_depth, "depth")
        ));
    }
    match turned {
        None => (error.max_steps > allowed * 255.0 + 1e-6).then(|| {
            format!(
                "a channel differs by {} where rounding allows {allowed:.6}",
                error.max_abs
            )
        }),
        Some(Turned { share, .. }) => {
            let most = share * error.pixels as f64;
            (error.beyond_step as f64 > most).then(|| {
                format!(
                    "{} off by more than a step, where {} of {} may, for decisions that turn on a \
                     rounding",
                    counted(error.beyond_step, "pixel"),
                    most.floor(),
                    error.pixels
                )
            })
        }
    }
}

/// Explains an empty picture of opaque `plans` by the attributes that their vertex stages read.
pub(super) fn nothing_drawn(plans: &[Plan]) -> Option<String> {
    let main = || plans.iter().filter_map(|p| Some((p, p.main()?)));
    if main().any(|(_, pass)| pass.phase != Phase::Opaque) {
        return None;
    }
    let reads = |(plan, pass): (&Plan, &GpuPass)| {
        let names: Vec<String> = pass
            .attributes
            .iter()
            .map(|a| format!("`{}` at location {}", a.name, a.location))
            .collect();
        match names[..] {
            [] => format!("`{}` reads no vertex attribute", plan.material),
            _ => format!("`{}` reads {}", plan.material, names.join(", ")),
        }
    };
    let read: Vec<String> = main().map(reads).collect();
    Some(format!(
        "nothing is drawn in any view, so no picture tells anything: every triangle lies outside \
         of the view, faces away or is discarded. Look whether the vertex \
         stage gets a mesh's positions ({})",
        read.join("; ")
    ))
}
