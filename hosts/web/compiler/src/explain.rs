//! `explain`.

use preshade_compiler::command::explain::{Explanation, explain, steps};
use preshade_compiler::command::explain_text;
use preshade_plan::pass::Facts;

use crate::request::Explain;
use crate::{Answer, Failure, Format, pretty};

/// Explains a material.
pub fn answer(asked: &Explain) -> Result<Answer<Explanation>, Failure> {
    let recipe = asked.passes.recipe(&asked.shader)?;
    let usage = |e: &dyn std::error::Error| Failure::usage(e.to_string());
    let (steps, order) = steps(&recipe).map_err(|e| usage(&e))?;
    let plan = asked.shader.plan(None)?;
    let frame = std::slice::from_ref(&plan);
    recipe.check_names(frame).map_err(|e| usage(&e))?;
    let material = explain(&plan, &steps, &Facts::default(), frame, &[], order);
    let text = match asked.verbose || !recipe.steps.is_empty() {
        true => explain_text::all(&material, &plan),
        false => explain_text::brief(&material),
    };
    let explanation = Explanation::from(vec![material]);
    let stdout = match asked.format {
        None => None,
        Some(Format::Json) => Some(pretty(&explanation)?),
        Some(_) => Some(text),
    };
    Ok(Answer {
        stdout,
        read: crate::rewrite::read(&plan),
        ..Answer::new(explanation)
    })
}
