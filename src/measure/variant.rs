//! A recipe on a scene: one plan a material, refusals kept beside.

use preshade_passes::count;
use preshade_passes::neighbours;
use preshade_passes::pass::{Facts, Refusal};
use preshade_passes::plan::{GpuPass, Plan};

use super::{CountProgram, Variant};
use crate::measure::record::Kept;
use crate::recipe::Recipe;

/// Applies `recipe` to every material. A material that refuses is drawn as written, and the refusal
/// is kept.
pub fn variant(originals: &[Plan], recipe: &Recipe, facts: &Facts) -> Variant {
    let mut kept = Vec::new();
    let mut plans: Vec<Plan> = originals
        .iter()
        .map(|original| {
            recipe.apply(original, facts).unwrap_or_else(|refusal| {
                kept.push(Kept {
                    material: original.material.clone(),
                    why: with_remedy(&refusal),
                });
                original.clone()
            })
        })
        .collect();
    let mut leave = |plans: &mut [Plan], refusals: Vec<Option<Refusal>>| {
        for ((plan, original), refusal) in plans.iter_mut().zip(originals).zip(refusals) {
            if let Some(refusal) = refusal {
                kept.push(Kept {
                    material: original.material.clone(),
                    why: with_remedy(&refusal),
                });
                *plan = original.clone();
            }
        }
    };
    // A plan may be legal alone but not beside the others.
    let conflicts = plans.iter().map(|p| neighbours::conflict(p, originals));
    let conflicts = conflicts.collect();
    leave(&mut plans, conflicts);
    // Materials resolved from IDs are drawn before all others. If depths tie, this changes the
    // order.
    let ties = plans
        .iter()
        .map(|p| neighbours::tied(p, &plans, facts.depth_ties));
    let ties = ties.collect();
    leave(&mut plans, ties);
    // A choice made by measurement is kept as the values it selected.
    let written = super::written_out(recipe, facts);
    Variant {
        recipe: written.as_ref().unwrap_or(recipe).to_string(),
        name: recipe.to_string(),
        plans,
        kept,
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

/// A refusal with its remedy.
fn with_remedy(refusal: &Refusal) -> String {
    format!("{refusal}; to make it legal: {}", refusal.remedy)
}

/// The counting stage of a pass: the slice that decides whether a fragment is kept. If the slice
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
