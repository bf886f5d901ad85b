//! The branches, switches and loops of a draw, and the way that known values send it through each.
//!
//! A measured budget holds for the ways that were drawn. `measure` therefore asks here, for each
//! draw and frame, which way it went.

use std::collections::BTreeMap;

use super::decision::{Decision, DecisionKind};
use super::{SpecializeParams, assumptions, examine, folded};
use preshade_dataflow::graph::{FunctionId, Graph, StmtId};
use preshade_plan::guard::Assumed;
use preshade_plan::pass::{Facts, Refusal};
use preshade_plan::plan::Plan;
use shader_text::source::Location;

/// A statement of the material. The same in every list that [`branches`] makes of one plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct BranchId(FunctionId, StmtId);

/// The way through a branch.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Way {
    /// The arm with this index: 0 for `true`, 1 for `false`, or the index of a switch's case.
    Arm(usize),
    /// This many iterations of a loop.
    Iterations(u32),
    /// The known values don't decide it.
    Open,
}

/// A branch, switch or loop whose condition is the same for the whole draw.
#[derive(Clone, Debug, PartialEq)]
pub struct Branch {
    /// The way that the known values take. Several if its function is called with several
    /// arguments.
    pub ways: Vec<Way>,
    /// Number of arms; `None` for a loop, which may have any number of iterations.
    pub arms: Option<usize>,
    /// The known values that its condition depends on, by place.
    pub values: Vec<Assumed>,
    /// The author's text of the condition, or a description.
    pub condition: String,
    /// Start of the statement.
    pub location: Option<Location>,
}

/// Every branch of the plan's main pass that the values in `facts` lead to. A branch inside of an
/// arm that is not taken is not among them.
///
/// # Errors
/// The plan can't be specialised.
pub fn branches(plan: &Plan, facts: &Facts) -> Result<BTreeMap<BranchId, Branch>, Box<Refusal>> {
    let (pass, program) = examine(plan)?;
    let params = SpecializeParams::default();
    let assumptions = assumptions(plan, program, facts, &params)?;
    let graph = Graph::build(program);
    let mut found: BTreeMap<BranchId, Branch> = BTreeMap::new();
    for placed in
        folded(&graph, pass, &assumptions, (facts, &plan.material), &params).decisions(&graph)
    {
        let decision = &placed.decision;
        let values = decision.sources.iter();
        let values = values.filter_map(|i| assumptions.values.get(*i).cloned());
        let branch = found
            .entry(BranchId(decision.function, decision.statement))
            .or_insert_with(|| described(&graph, decision));
        branch.ways.push(way(decision));
        branch.values.extend(values);
    }
    for branch in found.values_mut() {
        branch.ways.sort_unstable();
        branch.ways.dedup();
        branch.values.sort_by(|a, b| a.place.cmp(&b.place));
        branch.values.dedup_by(|a, b| a.place == b.place);
    }
    Ok(found)
}

fn way(decision: &Decision) -> Way {
    match (decision.kind, decision.taken) {
        (DecisionKind::Loop { turns: Some(turns) }, _) => Way::Iterations(turns),
        (DecisionKind::Branch | DecisionKind::Switch, Some(arm)) => Way::Arm(arm),
        _ => Way::Open,
    }
}

fn described(graph: &Graph<'_>, decision: &Decision) -> Branch {
    let f = graph.function(decision.function);
    let sources = graph.program().sources();
    let span = f.statements.get(decision.statement).span;
    let of_condition = f.function.expressions.get_span(decision.condition);
    let written = |span: naga::Span| {
        let (file, range) = (sources.file_of(span)?, span.to_range()?);
        let base = file.base as usize;
        let text = file.text.get(range.start - base..range.end - base)?;
        (!text.is_empty() && !text.contains('\n')).then(|| text.to_owned())
    };
    let kind = match decision.kind {
        DecisionKind::Branch => "a branch",
        DecisionKind::Switch => "a switch",
        DecisionKind::Loop { .. } => "a loop",
    };
    Branch {
        ways: Vec::new(),
        arms: match decision.kind {
            DecisionKind::Loop { .. } => None,
            _ => Some(decision.arms.len()),
        },
        values: Vec::new(),
        condition: written(of_condition).unwrap_or_else(|| kind.to_owned()),
        location: sources.locate(span),
    }
}
