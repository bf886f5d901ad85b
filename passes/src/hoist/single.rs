//! One value by itself: carried, or as a function. What it is measured and bounded on.

use super::{Class, Found, Hoist, Material, Params, candidates, choose, hoisted, refuse};
use crate::graph::Graph;
use crate::pass::{Pass, Refusal};
use crate::plan::Plan;

use super::values::Values;

/// The plan with one value carried as an approximation, and nothing else, whether that pays or not. `id` is [`super::Candidate::id`].
///
/// # Errors
/// Where nothing can be hoisted, or that value cannot.
pub fn alone(plan: &Plan, id: &str) -> Result<Plan, Box<Refusal>> {
    let params = Params {
        budget: Some(1.0),
        carry: Some(id.to_owned()),
        ..Params::default()
    };
    let material = Material::examine(plan, &params)?;
    let graph = Graph::build(material.program);
    let found = one(material.values(&graph)?, id, &material)?;
    let program = found
        .rebuild(&material)
        .map_err(|why| Box::new(refuse(why)))?;
    Ok(found.plan(plan, &material, program, &params))
}

/// What computes a value from the author's varyings.
#[derive(Clone, Debug)]
pub struct Computed {
    /// The author's module, with one more function.
    pub module: naga::Module,
    /// That function.
    pub function: naga::Handle<naga::Function>,
    /// Locations of the varyings that each of its arguments, or each member of a struct argument, comes from.
    pub arguments: Vec<Vec<u32>>,
    /// Index of the vertex entry point that gives them.
    pub vertex: usize,
}

/// The function that computes one value of a plan's fragment stage. `id` is [`super::Candidate::id`].
///
/// # Errors
/// As [`alone`].
pub fn computed(plan: &Plan, id: &str) -> Result<Computed, Box<Refusal>> {
    let material = Material::examine(plan, &Params::default())?;
    let graph = Graph::build(material.program);
    let found = one(material.values(&graph)?, id, &material)?;
    let hoisted = hoisted::add(material.program, &found.values, &found.wanted);
    let hoisted = hoisted.map_err(|why| Box::new(refuse(why)))?;
    Ok(Computed {
        module: hoisted.module,
        function: hoisted.function,
        arguments: hoisted.arguments,
        vertex: material.vertex,
    })
}

fn one<'g, 'p>(
    values: Values<'g, 'p>,
    id: &str,
    material: &Material<'p>,
) -> Result<Found<'g, 'p>, Box<Refusal>> {
    let (verdicts, value) = candidates::only(&values, id);
    let choice = value.and_then(|v| choose::one(&values, &verdicts, v));
    let choice = choice.filter(|c| c.class() == Some(Class::Smooth));
    let Some(choice) = choice else {
        return Err(Box::new(Refusal::new(
            Hoist::INFO.name,
            "not-carried",
            format!("there is no value `{id}`, or the varyings leave it no room"),
            "take one of those that explain --scene lists",
        )));
    };
    Ok(Found::of(values, choice, Vec::new(), material))
}
