//! Where each pass applies to a material, or why it does not, with static costs.

use std::fmt;

use naga::ShaderStage;
use preshade_geometry::{PASSES, pass_named};
use preshade_passes::transforms::hoist::Hoist;
use preshade_passes::transforms::specialize::effects::{self, CalledFor, Effect};
use preshade_passes::transforms::specialize::{Specialize, as_drawn};
use preshade_plan::guard::Assumed;
use preshade_plan::pass::{Facts, Frequency, Left, Outcome, Pass, Refusal};
use preshade_plan::plan::{Change, Plan};
use serde::Serialize;
use shader_text::source::Location;

use crate::parameters::parameters;
use crate::pipeline;
use crate::recipe::{Recipe, RecipeError, Step};

#[derive(Serialize)]
pub struct Explanation {
    schema: &'static str,
    pub materials: Vec<Explained>,
}

impl From<Vec<Explained>> for Explanation {
    fn from(materials: Vec<Explained>) -> Self {
        Self {
            schema: "preshade.explain.v1",
            materials,
        }
    }
}

/// An effect of a material, over its draws.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EffectUse {
    pub material: String,
    /// The kind of effect, or the author's identifier.
    pub name: String,
    /// `vertex` or `fragment`.
    pub stage: String,
    /// Static cost of the code behind its conditions, in one run of the stage.
    pub cost: f64,
    pub draws: usize,
    /// Number of draws that use it.
    pub called_for: usize,
    /// Draws that are proved not to.
    pub not_called_for: usize,
    /// The deciding values in draws that use it, and in draws that do not.
    pub evidence: [Vec<Assumed>; 2],
    /// The first of its conditions.
    pub location: Option<Location>,
}

impl EffectUse {
    /// The number of draws that use it, in words.
    pub fn called_for_by(&self) -> String {
        let open = self.draws - self.called_for - self.not_called_for;
        match (self.called_for, open) {
            (0, 0) => "by no draw".to_owned(),
            (yes, 0) if yes == self.draws => "by every draw".to_owned(),
            (yes, 0) => format!("by {yes} of {}", self.draws),
            (yes, open) => format!("by {yes} to {} of {}", yes + open, self.draws),
        }
    }

    /// The values that decide it, in words.
    pub fn evidence_said(&self) -> String {
        let told = |of: &[Assumed], what: &str| {
            let values: Vec<String> = of.iter().map(ToString::to_string).collect();
            (!values.is_empty()).then(|| format!("{what}: {}", values.join(", ")))
        };
        let [yes, no] = &self.evidence;
        let said: Vec<String> = [told(yes, "yes"), told(no, "no")]
            .into_iter()
            .flatten()
            .collect();
        match said.is_empty() {
            true => "its values change".to_owned(),
            false => said.join("; "),
        }
    }
}

/// A material, and the effect of each pass on it.
#[derive(Serialize)]
pub struct Explained {
    pub material: String,
    /// The stages of its main pass.
    pub stages: Vec<StageCost>,
    /// The effects that the scene's draws use, the most expensive first.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub effects: Vec<EffectUse>,
    /// The code behind conditions that uniforms and constants decide, where no draw is known.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub switches: Vec<Effect>,
    pub passes: Vec<PassExplained>,
    /// By error against saved cost, the best first.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub frequencies: Vec<Frequency>,
}

/// The static cost of a stage.
#[derive(Serialize)]
pub struct StageCost {
    /// `vertex` or `fragment`.
    pub stage: &'static str,
    pub entry_point: String,
    /// In operations.
    pub cost: f64,
    /// Expressions of the entry point.
    pub expressions: usize,
    /// Effects other than computing, such as a discard.
    pub effects: Vec<String>,
}

/// The effect of a pass on a material.
#[derive(Serialize)]
pub struct PassExplained {
    /// The recipe step, with its parameters.
    pub pass: String,
    /// The description of the pass in one line.
    pub summary: &'static str,
    /// When it costs more than it saves.
    pub hurts: &'static str,
    pub source: &'static str,
    /// The change that it makes; at most one.
    pub sites: Vec<Change>,
    /// `None`: it does not apply, or it saves no operations but fragments.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub saved: Option<Saved>,
    /// The change within a budget, if the pass is refused without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub within_budget: Option<WithinBudget>,
    /// The change for each group of the material's draws, if the pass is refused for all draws
    /// together.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub versions: Vec<VersionExplained>,
    /// Why it does not apply.
    pub refusals: Vec<Refusal>,
    /// Values that it did not move.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub left: Vec<Left>,
}

/// A pass for one group of a material's draws.
#[derive(Serialize)]
pub struct VersionExplained {
    /// Name of the group, as in the output of `rewrite`.
    pub material: String,
    /// The change that it makes.
    pub change: Change,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub saved: Option<Saved>,
}

#[derive(Serialize)]
pub struct WithinBudget {
    /// The recipe step, with its budget.
    pub step: String,
    /// The change that it makes.
    pub change: Change,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub saved: Option<Saved>,
}

/// The static cost that a stage of the main pass loses.
#[derive(Serialize)]
pub struct Saved {
    stage: &'static str,
    ops: f64,
    /// Operations before the change.
    of: f64,
}

/// The least share of a stage's static cost that is worth a pass.
pub const WORTH_A_LOOK: f64 = 0.05;

/// The budget with which a pass is tried that is refused without one.
const BUDGET: f64 = 0.02;

impl Saved {
    /// `None`: no stage costs less, or `after` has more passes, so that its stages alone do not
    /// show its cost.
    fn between(before: &Plan, after: &Plan, facts: &Facts) -> Option<Self> {
        let passes = |plan: &Plan| (plan.passes.len(), plan.compute.len());
        if passes(before) != passes(after) {
            return None;
        }
        let (before, after) = (stages(before, facts), stages(after, facts));
        let stages = before.iter().zip(&after).map(|(a, b)| Self {
            stage: a.stage,
            ops: a.cost - b.cost,
            of: a.cost,
        });
        let best = stages.max_by(|a, b| a.share().total_cmp(&b.share()));
        best.filter(|s| s.ops > 0.0)
    }

    /// The saved cost of a pass. For `hoist` it is that of the moved code, because the fragments
    /// pay for the interpolation.
    fn of(before: &Plan, done: &Outcome, facts: &Facts) -> Option<Self> {
        let saved = Self::between(before, &done.plan, facts)?;
        let is_hoist = done
            .plan
            .steps
            .last()
            .is_some_and(|s| s.pass == Hoist::INFO.name);
        let ops = match is_hoist {
            true => done.change.cost.slice,
            false => saved.ops,
        };
        Some(Self { ops, ..saved })
    }

    pub fn share(&self) -> f64 {
        self.ops / self.of.max(1.0)
    }

    /// Whether it is too little to be worth a pass.
    pub fn is_small(&self) -> bool {
        self.share() < WORTH_A_LOOK
    }
}

impl fmt::Display for Saved {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { stage, ops, of } = self;
        let percent = 100.0 * self.share();
        write!(
            f,
            "saves {ops:.0} of {of:.0} ops of the {stage} stage ({percent:.0} %)"
        )
    }
}

/// Which plan each pass is explained on.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Order {
    Apart,
    /// The plan that the passes before it made.
    Chained,
}

/// Every pass, with its own defaults.
///
/// # Errors
/// None: a pass without parameters is a valid step.
pub fn every_step() -> Result<Vec<Step>, RecipeError> {
    PASSES.iter().map(|p| Step::parse(p.info().name)).collect()
}

/// The explanation of the recipe's passes, each after those before it, or, without any, of every pass
/// on its own.
///
/// # Errors
/// As [`every_step`].
pub fn steps(recipe: &Recipe) -> Result<(Vec<Step>, Order), RecipeError> {
    Ok(match recipe.steps.is_empty() {
        true => (every_step()?, Order::Apart),
        false => (recipe.steps.clone(), Order::Chained),
    })
}

/// Explains `steps` on a material of a frame. `uses` are the effects that the frame's draws use.
pub fn explain(
    plan: &Plan,
    steps: &[Step],
    facts: &Facts,
    frame: &[Plan],
    uses: &[EffectUse],
    order: Order,
) -> Explained {
    let mut before = plan.clone();
    let mut frequencies: Vec<Frequency> = facts
        .frequencies
        .iter()
        .filter(|f| f.material == plan.material)
        .cloned()
        .collect();
    // Of several values with one name at one place, the list has the one with the least error for
    // its saved cost.
    frequencies.sort_by(|a, b| {
        let key = |f: &Frequency| f.flip_mean / f.cost.max(1.0);
        key(a).total_cmp(&key(b)).then(b.cost.total_cmp(&a.cost))
    });
    let mut named = Vec::new();
    frequencies.retain(|f| {
        let name = (f.name.clone(), f.location.clone());
        let is_new = !named.contains(&name);
        named.push(name);
        is_new
    });
    let uses: Vec<EffectUse> = uses
        .iter()
        .filter(|e| e.material == plan.material)
        .cloned()
        .collect();
    let switches = match uses.is_empty() {
        true => effects::effects(plan, facts),
        false => Ok(Vec::new()),
    };
    // A condition that is known, or that no value of the host decides, is no switch.
    let is_switch = |e: &Effect| e.called_for == CalledFor::Open && e.name != effects::UNNAMED;
    Explained {
        frequencies,
        material: plan.material.clone(),
        effects: uses,
        switches: switches
            .unwrap_or_default()
            .into_iter()
            .filter(is_switch)
            .collect(),
        stages: stages(plan, facts),
        passes: steps
            .iter()
            .filter_map(|step| {
                // A step that was parsed names a pass.
                let info = pass_named(&step.pass)?.info();
                let mut explained = PassExplained {
                    pass: step.to_string(),
                    summary: info.summary,
                    hurts: info.hurts,
                    source: info.source,
                    sites: Vec::new(),
                    saved: None,
                    within_budget: None,
                    versions: Vec::new(),
                    refusals: Vec::new(),
                    left: Vec::new(),
                };
                match pipeline::run(step, &before, frame, facts) {
                    Ok(done) => {
                        explained.saved = Saved::of(&before, &done, facts);
                        explained.sites = vec![done.change];
                        explained.left = done.left;
                        if order == Order::Chained {
                            before = done.plan;
                        }
                    }
                    Err(refused) => {
                        explained.refusals = refused.refusals;
                        explained.left = refused.left;
                        let within = with_budget(step)
                            .map(|step| (pipeline::run(&step, &before, frame, facts), step));
                        match within {
                            Some((Ok(done), step)) => {
                                explained.within_budget = Some(WithinBudget {
                                    step: step.to_string(),
                                    saved: Saved::of(&before, &done, facts),
                                    change: done.change,
                                });
                            }
                            Some((Err(still), _)) => {
                                still_refused(&mut explained.refusals, &still.first());
                            }
                            None => {}
                        }
                    }
                }
                Some(explained)
            })
            .collect(),
    }
}

impl Explained {
    /// Whether `specialize` is refused for all draws of the material together.
    pub fn is_general(&self) -> bool {
        self.passes.iter().any(is_general)
    }

    /// Adds the result of `specialize` for each group of the material's draws, if it is refused for
    /// all of them together.
    pub fn with_groups(mut self, groups: &[&Plan], frame: &[Plan], facts: &Facts) -> Self {
        for pass in self.passes.iter_mut().filter(|p| is_general(p)) {
            let Ok(step) = Step::parse(&pass.pass) else {
                continue;
            };
            pass.versions = groups
                .iter()
                .filter_map(|plan| {
                    let done = pipeline::run(&step, plan, frame, facts).ok()?;
                    Some(VersionExplained {
                        material: plan.material.clone(),
                        saved: Saved::of(plan, &done, facts),
                        change: done.change,
                    })
                })
                .collect();
        }
        self
    }
}

fn is_general(pass: &PassExplained) -> bool {
    let name = pass.pass.split(':').next();
    name == Some(Specialize::INFO.name) && !pass.refusals.is_empty()
}

/// A refused step with a budget. `None`: it has no such parameter, or has one already.
fn with_budget(step: &Step) -> Option<Step> {
    let pass = pass_named(&step.pass)?;
    let takes = parameters(pass).iter().any(|p| p.name == "budget");
    if !takes || step.params.contains_key("budget") {
        return None;
    }
    let mut step = step.clone();
    step.params.insert("budget".to_owned(), BUDGET.into());
    Some(step)
}

/// If a step is refused with a budget too, its budget is no remedy. Takes the remedy of `still`.
fn still_refused(refusals: &mut [Refusal], still: &Refusal) {
    for refusal in refusals.iter_mut().filter(|r| r.remedy.contains("budget=")) {
        refusal.remedy.clone_from(&still.remedy);
    }
}

fn stages(plan: &Plan, facts: &Facts) -> Vec<StageCost> {
    let Some((pass, program)) = plan.main().and_then(|p| Some((p, plan.program(p)?))) else {
        return Vec::new();
    };
    let graph = as_drawn(program, pass, &plan.material, facts);
    let mut stages = Vec::new();
    for (stage, word, name) in [
        (ShaderStage::Vertex, "vertex", Some(&pass.vertex)),
        (ShaderStage::Fragment, "fragment", pass.fragment.as_ref()),
    ] {
        let Some((index, entry)) = name.and_then(|n| program.entry_point(stage, n)) else {
            continue;
        };
        stages.push(StageCost {
            stage: word,
            entry_point: entry.name.clone(),
            cost: graph.entry_cost(index),
            expressions: entry.function.expressions.len(),
            effects: graph.entry_effects(index),
        });
    }
    stages
}

#[cfg(test)]
mod tests {
    use preshade_plan::plan::Role;
    use preshade_plan::plan::{Site, SiteCost};

    use super::*;
    use crate::command::explain_text;

    fn pass(name: &str, ops: f64) -> PassExplained {
        PassExplained {
            pass: name.to_owned(),
            summary: "",
            hurts: "",
            source: "",
            sites: vec![Change {
                key: Site {
                    role: Role::Main,
                    entry_point: "fs".to_owned(),
                    slice: String::new(),
                },
                what: String::new(),
                location: None,
                cost: SiteCost::default(),
            }],
            saved: Some(Saved {
                stage: "fragment",
                ops,
                of: 100.0,
            }),
            within_budget: None,
            versions: Vec::new(),
            refusals: Vec::new(),
            left: Vec::new(),
        }
    }

    #[test]
    fn the_largest_saving_that_was_not_drawn_is_told() {
        let explained = Explained {
            material: "m".to_owned(),
            stages: Vec::new(),
            effects: Vec::new(),
            switches: Vec::new(),
            passes: vec![
                pass("hoist", 20.0),
                pass("early-alpha", 40.0),
                pass("b", 4.0),
            ],
            frequencies: Vec::new(),
        };
        let told = |drawn: &[&str]| explain_text::largest(&explained, drawn).map(|(step, _)| step);
        assert_eq!(
            told(&["early-alpha"]).as_deref(),
            Some("hoist, which saves 20 of 100 ops of the fragment stage (20 %)")
        );
        // Less than 5 % is no hint.
        assert_eq!(told(&["early-alpha", "hoist"]), None);
    }
}
