//! One value alone: moved, or as a function. Measurements and bounds use this.

use std::collections::BTreeSet;

use super::candidates::{self, Candidate};
use super::movable::{self, Class, Precision, Verdict};
use super::{Hoist, HoistMaterial, HoistParams, HoistedValues, choose, refusals, refuse};
use crate::analysis::values::{ValueId, Values};
use crate::rebuild::outline;
use preshade_dataflow::graph::Graph;
use preshade_plan::pass::{Facts, Pass, Refusal};
use preshade_plan::plan::Plan;

/// The stages of a plan between which values may move.
pub struct HoistStages<'p> {
    plan: &'p Plan,
    material: HoistMaterial<'p>,
}

impl<'p> HoistStages<'p> {
    /// The stages of a plan's main pass.
    ///
    /// # Errors
    /// Nothing can be hoisted.
    pub fn of(plan: &'p Plan) -> Result<Self, Box<Refusal>> {
        let material = HoistMaterial::examine(plan, &HoistParams::default())?;
        Ok(Self { plan, material })
    }

    /// The dataflow graph for [`Candidates`].
    pub fn graph(&self) -> Graph<'p> {
        Graph::build(self.material.program)
    }
}

/// The approximable values of a fragment stage, with the analyses that found them. Callers examine
/// one after another.
pub struct Candidates<'a, 'p> {
    stages: &'a HoistStages<'p>,
    values: Values<'a, 'p>,
    /// Each value's verdict if everything is finite and continuous.
    verdicts: Vec<Verdict>,
    found: Vec<(ValueId, Candidate)>,
}

impl<'a, 'p> Candidates<'a, 'p> {
    /// Finds the candidates. Only the ranges in `facts` matter.
    ///
    /// # Errors
    /// Nothing can be hoisted.
    pub fn new(
        stages: &'a HoistStages<'p>,
        graph: &'a Graph<'p>,
        facts: &Facts,
    ) -> Result<Self, Box<Refusal>> {
        Self::within(stages, graph, &stages.material.precision(facts))
    }

    fn within(
        stages: &'a HoistStages<'p>,
        graph: &'a Graph<'p>,
        precision: &Precision,
    ) -> Result<Self, Box<Refusal>> {
        let values = stages.material.values(graph)?;
        let verdicts = movable::judge(&values, precision).verdicts;
        let sources = stages.material.program.sources();
        let found = candidates::describe(&values, &verdicts, sources);
        Ok(Self {
            stages,
            values,
            verdicts,
            found,
        })
    }

    /// The candidates, most expensive first.
    pub fn list(&self) -> impl ExactSizeIterator<Item = &Candidate> {
        self.found.iter().map(|(_, candidate)| candidate)
    }

    /// The plan with only this value approximated, whether or not it pays. `id` is
    /// [`Candidate::id`].
    ///
    /// # Errors
    /// The value cannot move.
    pub fn alone(&self, id: &str) -> Result<Plan, Box<Refusal>> {
        let params = HoistParams {
            budget: Some(1.0),
            carry: Some(id.to_owned()),
            ..HoistParams::default()
        };
        let material = &self.stages.material;
        let found = self.one(id)?;
        let program = found
            .rebuild(material)
            .map_err(|why| Box::new(refuse(why)))?;
        let outcome = found.outcome(self.stages.plan, material, program, &params, Vec::new());
        Ok(outcome.plan)
    }

    /// The function that computes one value. `id` is [`Candidate::id`].
    ///
    /// # Errors
    /// As [`Self::alone`].
    pub fn computed(&self, id: &str) -> Result<Computed, Box<Refusal>> {
        let material = &self.stages.material;
        let found = self.one(id)?;
        let hoisted = outline::add(material.program, &self.values, &found.moved.wanted);
        let hoisted = hoisted.map_err(|why| Box::new(refuse(why)))?;
        Ok(Computed {
            module: hoisted.module,
            function: hoisted.function,
            arguments: hoisted.arguments,
            vertex: material.vertex,
        })
    }

    fn one(&self, id: &str) -> Result<HoistedValues<'_, 'a, 'p>, Box<Refusal>> {
        let (values, verdicts) = (&self.values, &self.verdicts);
        let candidate = self.found.iter().find(|(_, c)| c.id == id).map(|(v, _)| *v);
        let value = candidate.or_else(|| {
            let others = candidates::find(values, verdicts, &BTreeSet::from([id]));
            others.into_keys().next()
        });
        let choice = value.and_then(|v| choose::one(values, verdicts, v));
        let choice = choice.filter(|c| c.class() == Some(Class::Smooth));
        let Some(choice) = choice else {
            return Err(Box::new(Refusal::new(
                Hoist::INFO.name,
                &refusals::NOT_CARRIED,
                format!("there is no value `{id}`, or the varyings have no room for it"),
                "use one that `preshade explain --scene` lists",
            )));
        };
        Ok(HoistedValues::of(values, choice, Vec::new()))
    }
}

/// [`Candidates::alone`] for one plan.
///
/// # Errors
/// Nothing can be hoisted, or this value cannot move.
pub fn alone(plan: &Plan, id: &str) -> Result<Plan, Box<Refusal>> {
    let stages = HoistStages::of(plan)?;
    let graph = stages.graph();
    Candidates::within(&stages, &graph, &Precision::EXACT)?.alone(id)
}

/// The computation of a value from the author's varyings.
#[derive(Clone, Debug)]
pub struct Computed {
    /// The author's module with one more function.
    pub module: naga::Module,
    pub function: naga::Handle<naga::Function>,
    /// Locations of the varyings for each argument, or for each member of a struct argument.
    pub arguments: Vec<Vec<u32>>,
    /// Index of the vertex entry point that writes them.
    pub vertex: usize,
}

/// [`Candidates::computed`] for one plan.
///
/// # Errors
/// As [`alone`].
pub fn computed(plan: &Plan, id: &str) -> Result<Computed, Box<Refusal>> {
    let stages = HoistStages::of(plan)?;
    let graph = stages.graph();
    Candidates::within(&stages, &graph, &Precision::EXACT)?.computed(id)
}
