//! The recipes that each material takes.

use preshade_plan::pass::Facts;
use preshade_plan::plan::Plan;
use serde::Serialize;

use super::frame_work::Counting;
use crate::measure;
use preshade_compiler::pipeline::{self, Frame};
use preshade_compiler::recipe::Recipe;

/// A recipe that a material takes.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// The recipe; without steps it is the original.
    pub recipe: Recipe,
    /// The plan it makes of the material.
    pub plan: Plan,
    /// Its passes, ready to be counted.
    pub counting: Counting,
}

/// A recipe that a material does not take.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Refused {
    pub recipe: String,
    /// The reason, and the remedy.
    pub why: String,
}

/// The candidates of one material.
#[derive(Clone, Debug)]
pub struct Choices {
    pub material: String,
    /// The original first.
    pub candidates: Vec<Candidate>,
    pub refused: Vec<Refused>,
    /// Pixels of the scene in which depths tie: see [`Facts::depth_ties`].
    pub depth_ties: Option<u64>,
}

impl Choices {
    /// The candidate of that recipe, as its text.
    pub fn position(&self, recipe: &str) -> Option<usize> {
        self.candidates
            .iter()
            .position(|c| c.recipe.to_string() == recipe)
    }
}

/// Applies each recipe to each material. Refused recipes are listed with their reasons. A recipe
/// also counts as refused if it conflicts with the other materials, or makes the same plan as an
/// earlier recipe.
pub fn choices(originals: &[Plan], recipes: &[Recipe], facts: &Facts) -> Vec<Choices> {
    originals
        .iter()
        .map(|original| {
            let mut choices = Choices {
                material: original.material.clone(),
                candidates: vec![Candidate {
                    recipe: Recipe::default(),
                    counting: Counting::of(original, facts),
                    plan: original.clone(),
                }],
                refused: Vec::new(),
                depth_ties: facts.depth_ties,
            };
            for recipe in recipes {
                let refuse = |why| Refused {
                    recipe: recipe.to_string(),
                    why,
                };
                let frame = Frame {
                    materials: std::slice::from_ref(original),
                    neighbours: originals,
                };
                let (plans, skipped) =
                    pipeline::apply_in(frame, recipe, facts, &mut |_, _, _| true);
                // Without a skipped step it is another candidate.
                if let Some(r) = skipped.first().map(|s| &s.refusal) {
                    let why = format!("{r}; to make it legal: {}", r.remedy);
                    choices.refused.push(refuse(why));
                    continue;
                }
                let Some(plan) = plans.into_iter().next() else {
                    continue;
                };
                let same =
                    |c: &&Candidate| c.plan.passes == plan.passes && same_programs(&c.plan, &plan);
                if let Some(same) = choices.candidates.iter().find(same) {
                    let why = match same.recipe.steps.is_empty() {
                        true => "it changes nothing here".to_owned(),
                        false => format!("it makes the same plan as `{}`", same.recipe),
                    };
                    choices.refused.push(refuse(why));
                    continue;
                }
                choices.candidates.push(Candidate {
                    // A choice made by measurement is written as the values that it selected.
                    recipe: measure::written_out(recipe, facts).unwrap_or_else(|| recipe.clone()),
                    counting: Counting::of(&plan, facts),
                    plan,
                });
            }
            choices
        })
        .collect()
}

fn same_programs(a: &Plan, b: &Plan) -> bool {
    let text = |plan: &Plan| -> Vec<(String, String)> {
        let each = plan.programs.iter();
        each.map(|(k, p)| (k.clone(), format!("{:?}", p.module())))
            .collect()
    };
    a.compute == b.compute && text(a) == text(b)
}
