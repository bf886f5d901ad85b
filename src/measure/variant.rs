//! A recipe on a scene: one plan a material, refusals kept beside.

use preshade_passes::count;
use preshade_passes::neighbours;
use preshade_passes::pass::{Facts, Refusal};
use preshade_passes::plan::{GpuPass, Plan};

use super::{CountProgram, Variant};
use crate::recipe::Recipe;
use crate::report::Kept;

/// `recipe` on every material that takes it. A material that refuses is drawn as its author wrote it, and the refusal is kept.
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
    // What stands alone may not stand beside the others.
    let conflicts = plans.iter().map(|p| neighbours::conflict(p, originals));
    let conflicts = conflicts.collect();
    leave(&mut plans, conflicts);
    // What is shaded from ids comes before what is not: where those tie, no order is kept.
    let ties = plans
        .iter()
        .map(|p| neighbours::tied(p, &plans, facts.depth_ties));
    let ties = ties.collect();
    leave(&mut plans, ties);
    // A choice that rests on measurement is kept as what it chose.
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

/// A refusal, and what would lift it.
fn with_remedy(refusal: &Refusal) -> String {
    format!("{refusal}; to make it legal: {}", refusal.remedy)
}

/// The counting stage of a pass: the slice that decides whether a fragment is kept. A slice that does not validate (a bug) counts every fragment.
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
