//! The recipes that are weighed for each material: one table, so that what is tried is read in one place.

use preshade_passes::neighbours;
use preshade_passes::pass::{Facts, Refusal};
use preshade_passes::pass_named;
use preshade_passes::plan::Plan;
use serde::Serialize;

use super::work::Counting;
use crate::measure;
use crate::recipe::{Recipe, RecipeError};
use crate::report::Budget;

/// What is tried without leave to differ: exact, or the same real numbers rounded elsewhere.
const PLAIN: &[&str] = &[
    "depth-prepass",
    "depth-prepass:form=equal",
    "early-discard",
    "hoist",
    "hoist,depth-prepass",
    "visibility-buffer",
    "visibility-buffer:select=id",
    "visibility-buffer:form=compute",
    "specialize",
    "specialize,depth-prepass",
    "specialize,hoist",
    "specialize,hoist,depth-prepass",
    "specialize,visibility-buffer",
    "skip-taps:threshold=0",
    "specialize,skip-taps:threshold=0",
];

/// What is tried besides where the user says how much may differ; `BUDGET` becomes `budget=VALUE,metric=METRIC`, of passes that count in one metric alone (`max_abs`) `MOST` the value.
const WITHIN_BUDGET: &[&str] = &[
    "hoist:BUDGET",
    "hoist:BUDGET,depth-prepass",
    "hoist:BUDGET,tessellate:form=shared,level=2",
    "hoist:BUDGET,tessellate:form=shared,level=4",
    "hoist:BUDGET,tessellate:form=shared,level=8",
    "skip-taps:BUDGET",
    "skip-taps:BUDGET,depth-prepass",
    "specialize,skip-taps:BUDGET",
    "specialize,hoist:BUDGET",
    "specialize,hoist:BUDGET,depth-prepass",
    "trim-loop:BUDGET",
    "visibility-buffer:budget=MOST",
    "visibility-buffer:select=id,budget=MOST",
    "visibility-buffer:form=compute,budget=MOST",
];

/// The recipes to weigh, those left out that name a pass which this build does not have.
///
/// # Errors
/// A recipe of the table that does not parse: a bug.
pub fn recipes(budget: Option<Budget>) -> Result<Vec<Recipe>, RecipeError> {
    let exists = |text: &&&str| {
        let pass = |step: &str| step.split(':').next().unwrap_or_default().to_owned();
        // A part with an equals sign and no colon belongs to the step before it.
        let steps = text
            .split(',')
            .filter(|s| s.contains(':') || !s.contains('='));
        steps.map(pass).all(|name| pass_named(&name).is_some())
    };
    let within = budget.map(|budget| {
        let words = format!("budget={},metric={}", budget.most, budget.name());
        let most = budget.most.to_string();
        let is_counted = move |r: &&&str| !r.contains("MOST") || budget.name() == "max_abs";
        WITHIN_BUDGET
            .iter()
            .filter(is_counted)
            .map(move |r| r.replace("BUDGET", &words).replace("MOST", &most))
    });
    PLAIN
        .iter()
        .filter(exists)
        .map(|r| (*r).to_owned())
        .chain(within.into_iter().flatten())
        .map(|text| Recipe::parse_list(&text))
        .collect()
}

/// A recipe that a material takes.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// The recipe; without steps it is the original.
    pub recipe: Recipe,
    /// What it makes of the material.
    pub plan: Plan,
    /// Its passes, ready to be counted.
    pub counting: Counting,
}

/// A recipe that a material does not take.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Refused {
    /// The recipe.
    pub recipe: String,
    /// Why not, and what would make it legal.
    pub why: String,
}

/// What may become of one material.
#[derive(Clone, Debug)]
pub struct Choices {
    /// Name of the material.
    pub material: String,
    /// The original first.
    pub candidates: Vec<Candidate>,
    /// What it refuses.
    pub refused: Vec<Refused>,
}

impl Choices {
    /// The candidate of that recipe, as its text.
    pub fn position(&self, recipe: &str) -> Option<usize> {
        self.candidates
            .iter()
            .position(|c| c.recipe.to_string() == recipe)
    }
}

/// Applies each recipe to each material. What a material refuses, or what may not stand beside the others as they are written, is kept as refused; so are recipes that make the same plan
/// as one before.
pub fn choices(originals: &[Plan], recipes: &[Recipe], facts: &Facts) -> Vec<Choices> {
    originals
        .iter()
        .map(|original| {
            let mut choices = Choices {
                material: original.material.clone(),
                candidates: vec![Candidate {
                    recipe: Recipe::default(),
                    counting: Counting::of(original),
                    plan: original.clone(),
                }],
                refused: Vec::new(),
            };
            for recipe in recipes {
                let refuse = |why| Refused {
                    recipe: recipe.to_string(),
                    why,
                };
                let told = |r: &Refusal| format!("{r}; to make it legal: {}", r.remedy);
                let plan = match recipe.apply(original, facts) {
                    Err(refusal) => {
                        choices.refused.push(refuse(told(&refusal)));
                        continue;
                    }
                    Ok(plan) => plan,
                };
                if let Some(refusal) = neighbours::conflict(&plan, originals) {
                    choices.refused.push(refuse(told(&refusal)));
                    continue;
                }
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
                    // A choice that rests on measurement is kept as what it chose.
                    recipe: measure::written_out(recipe, facts).unwrap_or_else(|| recipe.clone()),
                    counting: Counting::of(&plan),
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
