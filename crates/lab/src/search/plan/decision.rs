//! The decision, as data: the JSON of record, with everything a host needs.

use std::collections::BTreeMap;

use preshade_plan::contract::{Contract, Verdict};
use serde::Serialize;

use super::choices::Refused;
use super::frame_work::Fragments;
use super::model::Model;
use super::partial_prepass::Ahead;
use super::policy::{Policy, Rule};
use super::sorting::Sorting;
use crate::measure::{Clock, ErrorLadder, Estimate, View};
use preshade_draw::render::AdapterReport;

/// Version of the JSON that [`Decision`] serialises to.
pub(crate) const SCHEMA: &str = "preshade.decision.v2";

/// The plans for a scene on an adapter.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Decision {
    pub schema: String,
    pub scene: String,
    /// For a captured frame, the part of it that `scene` is, in words.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub part: Option<String>,
    /// Width and height, in pixels.
    pub resolution: [u32; 2],
    /// The command that made it.
    pub command: String,
    /// Where it was measured. It holds there.
    pub adapter: AdapterReport,
    /// The clock of all times. `None`: nothing was timed, and the choice is a prediction.
    pub clock: Option<Clock>,
    /// The plan to draw with.
    pub policy: Policy,
    pub materials: Vec<MaterialDecision>,
    /// The plans of the whole frame that were considered, the original first. Other fields refer to
    /// them by index.
    pub plans: Vec<PlanReport>,
    /// The views they were weighed in.
    pub views: Vec<ViewReport>,
    /// Reasons to trust the pictures less: a single colour, or attributes that are made up.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
    /// The extra cost of switching, by rule of the policy. `None`: the rule has no switch.
    pub switch_cost: Vec<Option<SwitchCost>>,
    pub model: Model,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MaterialDecision {
    /// Name; of a group of draws, which was made a material of its own, the material's with a number.
    pub material: String,
    /// Its draws, by their place in the scene.
    pub draws: Vec<usize>,
    /// Its recipe in each plan of the policy, in the order of [`Policy::plans`]; empty for the original.
    pub recipes: Vec<String>,
    pub reasons: Vec<String>,
    /// The refused recipes with their reasons.
    pub refused: Vec<Refused>,
    /// Each recipe's predicted time of the frame over the original's, with the other materials as
    /// written. Mean of all views.
    pub predicted: Vec<PredictedRecipe>,
}

/// A prediction of one recipe on one material.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PredictedRecipe {
    pub recipe: String,
    /// Time of the frame over the original's.
    pub relative_time: f64,
}

/// A plan of the whole frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PlanReport {
    pub name: String,
    /// Recipe of each material that is not drawn as written.
    pub recipes: BTreeMap<String, String>,
    pub contract: Contract,
    /// Whether its pictures keep the contract.
    pub verdict: Verdict,
    /// The worst of its pictures; `None`: it was not compared.
    pub error: Option<ErrorLadder>,
    /// The costs of having it. `None`: it was not built.
    pub cost: Option<PlanCost>,
    /// Materials that stay as written, with the reasons.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    pub by_view: Vec<PlanView>,
}

/// Costs of a plan other than GPU time.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PlanCost {
    pub pipelines: usize,
    pub creation_ms: f64,
    /// Bytes of each of its attachments, by name and format.
    pub targets: BTreeMap<String, u64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PlanView {
    /// Milliseconds a frame.
    pub predicted_ms: f64,
    /// Milliseconds a frame, measured; `None`: not measured.
    pub time_ms: Option<Estimate>,
    /// The original's time over this one's, of samples taken side by side. Of a chosen plan, of
    /// samples taken after the choice.
    pub speedup: Option<Estimate>,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ViewReport {
    /// From where, in which order.
    #[serde(flatten)]
    pub view: View,
    /// Fragments that the original shades for each pixel of the frame: the measure of the switch.
    pub shaded_per_pixel: f64,
    /// Fragments that it shades for each visible one.
    pub overdraw: f64,
    pub materials: Vec<Fragments>,
    /// The plan it is drawn with.
    pub plan: usize,
    /// The plan it would be drawn with if there were no other view.
    pub alone: usize,
    /// The original's time over its own, of another pair of samples from the same rounds as the
    /// chosen plans': how far the machine can be trusted. `None`: nothing was chosen.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub again: Option<Estimate>,
    /// Another order of the draws, if the scene has one of its own and another one hides more.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sorted: Option<Sorting>,
    /// The draws that a pre-pass needs, if some of them hide much.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ahead: Option<Ahead>,
}

/// Costs of a second set of pipelines.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SwitchCost {
    /// Pipelines of both plans together.
    pub pipelines: usize,
    pub creation_ms: f64,
    /// Bytes of attachments that only one of the two plans has: the extra memory for keeping both.
    pub target_bytes: u64,
}

impl SwitchCost {
    /// The cost of two plans that a host holds both.
    pub fn of(below: &PlanCost, above: &PlanCost) -> Self {
        let alone = |plan: &PlanCost, other: &PlanCost| {
            let own = plan.targets.iter();
            let own = own.filter(|(name, bytes)| other.targets.get(*name) != Some(bytes));
            own.map(|(_, bytes)| bytes).sum::<u64>()
        };
        Self {
            pipelines: below.pipelines + above.pipelines,
            creation_ms: below.creation_ms + above.creation_ms,
            target_bytes: alone(below, above) + alone(above, below),
        }
    }
}

impl Decision {
    /// Numbers of the plans that the policy draws with.
    pub fn drawn(&self) -> Vec<usize> {
        self.policy.plans()
    }

    /// The plans that the policy draws with, each with the folder of its shaders. A single plan has
    /// no folder. The plans of one switch are in `below` and `above`, those of several rules in
    /// numbered folders.
    pub fn folders(&self) -> Vec<(String, usize)> {
        match self.policy.0.as_slice() {
            [held] => match held.rule {
                Rule::One { plan } => vec![(String::new(), plan)],
                Rule::Switch(s) => [("below", s.below), ("above", s.above)]
                    .map(|(name, plan)| (name.to_owned(), plan))
                    .into(),
            },
            _ => {
                let drawn = self.drawn().into_iter();
                drawn.map(|plan| (format!("plan-{plan}"), plan)).collect()
            }
        }
    }

    /// Whether a plan of the policy broke its contract. Other plans that broke theirs do not count.
    pub fn is_broken(&self) -> bool {
        let broken = |p: &PlanReport| matches!(p.verdict, Verdict::Broken { .. });
        let drawn = self.policy.plans();
        drawn.iter().filter_map(|p| self.plans.get(*p)).any(broken)
    }

    /// The JSON of record, indented, with a newline at its end.
    pub fn to_json(&self) -> serde_json::Result<String> {
        Ok(serde_json::to_string_pretty(self)? + "\n")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn attachments_of_one_size_are_not_one_attachment() {
        let cost = |own: &str| PlanCost {
            pipelines: 2,
            creation_ms: 1.0,
            targets: [("scene-depth (Depth32Float)", 400), (own, 100)]
                .map(|(name, bytes)| (name.to_owned(), bytes))
                .into(),
        };
        let (ids, depth) = (cost("ids (R32Uint)"), cost("depth-copy (R32Float)"));
        assert_eq!(SwitchCost::of(&ids, &depth).target_bytes, 200);
        assert_eq!(SwitchCost::of(&ids, &ids).target_bytes, 0);
    }
}
