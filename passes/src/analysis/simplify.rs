//! Shared by the passes that remove parts of the fragment stage: the plans they accept, the
//! selected functions, and the plan with the new stage.

use std::collections::BTreeSet;

use naga::{ShaderStage, Span};
use serde::Serialize;

use crate::analysis::implicit_inputs::{ImplicitInputs, PassEffect};
use crate::analysis::refusals;
use preshade_dataflow::graph::{FunctionId, Graph};
use preshade_dataflow::slice::{self, Criterion, OutputFilter, Slice};
use preshade_plan::contract::{Assumption, Contract};
use preshade_plan::pass::{Left, Outcome, Refusal, Refused};
use preshade_plan::plan::{Change, GpuPass, Plan, Role, Site, SiteCost};
use preshade_plan::program::Program;
use preshade_plan::reflect;

/// A material's main pass with less work.
pub(crate) struct Simplified {
    pub program: Program,
    /// Key of the replaced program.
    pub of: String,
    /// The changed code and the savings.
    pub change: Change,
    /// Candidates that were not taken, with the reason.
    pub left: Vec<Left>,
    /// The contract of the picture.
    pub contract: Contract,
}

impl Simplified {
    /// The plan with the new program, as a step of the pass with this name.
    pub fn outcome(self, plan: &Plan, name: &str, params: &impl Serialize) -> Outcome {
        let mut next = plan.clone();
        for pass in next.passes.iter_mut().filter(|p| p.program == self.of) {
            reflect::fill(pass, &self.program);
        }
        next.add_step(name, params, &self.change, self.contract);
        next.programs.insert(self.of, self.program);
        Outcome {
            plan: next,
            change: self.change,
            left: self.left,
        }
    }
}

/// The change of code that `slice` decides, in the fragment stage of `pass`.
pub(crate) fn change(
    graph: &Graph<'_>,
    pass: &GpuPass,
    slice: &Slice,
    what: String,
    (span, cost): (Span, SiteCost),
) -> Change {
    Change {
        key: Site {
            role: Role::Main,
            entry_point: pass.fragment.clone().unwrap_or_default(),
            slice: slice.hash(graph),
        },
        what,
        location: graph.program().sources().locate(span),
        cost,
    }
}

/// All that decides an output of an entry point.
pub(crate) fn whole(graph: &Graph<'_>, entry: usize) -> Slice {
    slice::backward(graph, entry, &[Criterion::Output(OutputFilter::All)])
}

/// The fragment stage that a pass changes.
pub(crate) struct FragmentStage<'p> {
    pub pass: &'p GpuPass,
    pub graph: Graph<'p>,
    /// Index of the entry point.
    pub entry: usize,
    /// The assumptions under which other code may stand in it.
    pub given: Vec<Assumption>,
}

/// The fragment stage of a single-pass plan. `first` is the remedy if there are other passes,
/// `nothing` the message if there is no fragment stage.
///
/// # Errors
/// There is no such stage, or it depends on the code around an operation.
pub(crate) fn examine<'p>(
    plan: &'p Plan,
    name: &'static str,
    first: &str,
    nothing: &str,
) -> Result<FragmentStage<'p>, Refused> {
    let refuse =
        |code, reason, remedy: &str| Err(Box::new(Refusal::new(name, code, reason, remedy)).into());
    let Some((pass, program)) = plan.main().and_then(|p| Some((p, plan.program(p)?))) else {
        let remedy = "start from the original plan";
        return refuse(&refusals::NO_MAIN_PASS, "the plan has no main pass", remedy);
    };
    if plan.passes.len() > 1 || !plan.compute.is_empty() || !pass.geometry.is_as_given() {
        let reason = "another pass of the plan was made of the stage that would change";
        return refuse(&refusals::NOT_FIRST, reason, first);
    }
    let fragment = pass.fragment.as_deref();
    let found = fragment.and_then(|f| program.entry_point(ShaderStage::Fragment, f));
    let Some((entry, _)) = found else {
        let reason = "the material has no fragment stage";
        return refuse(&refusals::NO_FRAGMENT_STAGE, reason, nothing);
    };
    let graph = Graph::build(program);
    let inputs = ImplicitInputs::new(plan, pass, &graph);
    let given = inputs.examine(name, &[PassEffect::EditsFragmentStage])?;
    Ok(FragmentStage {
        pass,
        graph,
        entry,
        given,
    })
}

/// The functions in `of`, joined by `+`, among the fragment stage and its callees; all of them if
/// it is absent.
///
/// # Errors
/// A name is unknown.
pub(crate) fn meant(
    graph: &Graph<'_>,
    fragment: usize,
    of: Option<&str>,
    name: &str,
) -> Result<BTreeSet<FunctionId>, Box<Refusal>> {
    let entry = FunctionId::EntryPoint(fragment);
    let below = graph.functions().iter().map(|f| f.id);
    let below: BTreeSet<FunctionId> = below.filter(|id| graph.reaches(entry, *id)).collect();
    let Some(of) = of else {
        return Ok(below);
    };
    of.split('+')
        .map(str::trim)
        .map(|wanted| {
            let found = below.iter().find(|id| graph.name(**id) == wanted);
            found.copied().ok_or_else(|| {
                let names: Vec<String> = below.iter().map(|id| graph.name(*id)).collect();
                Box::new(Refusal::new(
                    name,
                    &refusals::UNKNOWN_FUNCTION,
                    format!("the fragment stage calls no `{wanted}`"),
                    format!("`of` names functions of its own: {}", names.join(", ")),
                ))
            })
        })
        .collect()
}
