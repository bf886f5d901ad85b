//! A recipe on a scene: one plan a material, and the refusals.

use preshade_passes::rebuild::count;
use preshade_plan::pass::{Facts, Refusal};
use preshade_plan::plan::{GpuPass, Plan};

use super::CountProgram;
use crate::measure::record::KeptMaterial;
use preshade_compiler::command::refusal::remedy;
use preshade_compiler::pipeline::{self, Frame, Skipped};
use preshade_compiler::recipe::Recipe;

/// The plans of a scene's materials that a recipe makes.
#[derive(Clone, Debug)]
pub struct Variant {
    /// Name, for the table and for files.
    pub name: String,
    /// The recipe, as it is written on a command line.
    pub recipe: String,
    /// One plan a material, in the scene's order.
    pub plans: Vec<Plan>,
    pub kept: Vec<KeptMaterial>,
}

/// Applies `recipe` to every material. Refused steps are skipped, as `rewrite` skips them, and
/// listed with their reasons.
pub fn variant(originals: &[Plan], recipe: &Recipe, facts: &Facts) -> Variant {
    let frame = Frame {
        materials: originals,
        neighbours: originals,
    };
    let (plans, skipped) = pipeline::apply_in(frame, recipe, facts, &mut |_, _, _| true);
    let kept: Vec<KeptMaterial> = skipped.iter().map(|s| kept(s, &plans)).collect();
    // A choice made by measurement is written as the values that it selected.
    let written = super::written_out(recipe, facts);
    Variant {
        recipe: written.as_ref().unwrap_or(recipe).to_string(),
        name: recipe.to_string(),
        plans,
        kept,
    }
}

/// A skipped step, for the report.
fn kept(skipped: &Skipped, plans: &[Plan]) -> KeptMaterial {
    let Skipped {
        material,
        step,
        refusal,
    } = skipped;
    let is_changed = |p: &Plan| p.material == *material && !p.steps.is_empty();
    KeptMaterial {
        material: material.clone(),
        without: plans.iter().any(is_changed).then(|| step.to_string()),
        why: why(refusal),
    }
}

impl Variant {
    /// Whether every material refused every step, so that the picture is the original's.
    pub fn is_refused(&self) -> bool {
        self.is_incomplete() && self.plans.iter().all(|p| p.steps.is_empty())
    }

    /// Whether every material refused a step, so that a shorter recipe gives the same plans.
    pub fn is_incomplete(&self) -> bool {
        let lacks = |p: &Plan| self.kept.iter().any(|k| k.material == p.material);
        !self.plans.is_empty() && self.plans.iter().all(lacks)
    }
}

/// A recipe that measurement refused: every material stays as it is.
pub fn refused(originals: &[Plan], recipe: &Recipe, refusal: &Refusal) -> Variant {
    let kept = |plan: &Plan| KeptMaterial {
        material: plan.material.clone(),
        without: None,
        why: why(refusal),
    };
    Variant {
        plans: originals.to_vec(),
        kept: originals.iter().map(kept).collect(),
        ..unwritten(recipe)
    }
}

/// Why a variant is not measured that changes no material.
pub(crate) const EVERY_REFUSES: &str = "every material refuses it";

/// The end of a refusal that has no remedy.
const DOES_NOT_APPLY: &str = "; does not apply";

/// A refusal without its remedy: `pass[code]: reason`.
pub(crate) fn without_remedy(why: &str) -> &str {
    let reason = why.split("; to make it legal").next().unwrap_or(why);
    reason.split(DOES_NOT_APPLY).next().unwrap_or(reason)
}

fn why(refusal: &Refusal) -> String {
    match remedy(refusal) {
        Some(remedy) => format!("{refusal}; to make it legal: {remedy}"),
        None => format!("{refusal}{DOES_NOT_APPLY}"),
    }
}

/// A recipe that there was no time to apply: a name, and no plans.
pub(crate) fn unwritten(recipe: &Recipe) -> Variant {
    Variant {
        recipe: recipe.to_string(),
        name: recipe.to_string(),
        plans: Vec::new(),
        kept: Vec::new(),
    }
}

/// The counting stage of a pass: the slice that decides whether a fragment survives. If the slice
/// does not validate (a bug), every fragment counts.
pub fn counting(plan: &Plan, pass: &GpuPass) -> CountProgram {
    match count::program(plan, pass) {
        Ok(program) => CountProgram::Sliced {
            program,
            vertex: pass.vertex.clone(),
            fragment: count::ENTRY.to_owned(),
        },
        Err(_) => CountProgram::Constant,
    }
}
