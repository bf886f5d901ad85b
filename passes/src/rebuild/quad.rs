//! The vote of a 2x2 quad: its lanes leave together, so that no survivor loses a neighbour that its
//! derivatives need.

use naga::{
    DerivativeAxis, DerivativeControl, Expression, Function, Handle, Module, ShaderStage, Statement,
};

use crate::analysis::effects;
use crate::rebuild::snippet::{InjectError, link_snippet};
use preshade_dataflow::graph::effect::{self, Effect};
use preshade_dataflow::graph::{FunctionId, Graph};
use preshade_plan::plan::Plan;

/// Name of the function that compares with a pre-pass's depth; with a vote if its quad votes.
pub(crate) const HIDDEN: &str = "hidden_by_prepass";

/// Name of the function of [`vote`].
const LEAVES: &str = "leaves_with_quad";

/// The vote in WGSL: 1 in `quad` if `{lane}` is true in all four lanes. A fine derivative is the
/// difference of two neighbouring lanes, so a lane less its magnitude is 1 only where both are.
/// Where a language has only coarse ones, the vote may be wrong about a neighbour, but never about
/// the lane itself.
pub(crate) fn vote_wgsl(lane: &str) -> String {
    format!(
        "let lane = select(0.0, 1.0, {lane});
    let row = lane - abs(dpdxFine(lane));
    let quad = row - abs(dpdyFine(row));
    "
    )
}

/// Adds a function from a lane's `bool` to whether all four lanes of the quad have it.
///
/// # Errors
/// When our own text does not parse or link.
pub(crate) fn vote(module: Module) -> Result<(Module, Handle<Function>), InjectError> {
    let vote = vote_wgsl("fails");
    let text = format!("fn {LEAVES}(fails: bool) -> bool {{\n    {vote}return quad > 0.5;\n}}\n");
    link_snippet(module, &text)
}

/// Whether a function is one of ours that votes.
fn votes(function: &Function) -> bool {
    let fine_x = |e: &Expression| {
        matches!(
            e,
            Expression::Derivative {
                axis: DerivativeAxis::X,
                ctrl: DerivativeControl::Fine,
                ..
            }
        )
    };
    is_ours(function) && function.expressions.iter().any(|(_, e)| fine_x(e))
}

fn is_ours(function: &Function) -> bool {
    let name = function.name.as_deref().unwrap_or_default();
    name.starts_with(HIDDEN) || name.starts_with(LEAVES)
}

/// Whether the main pass of `plan` lets the lanes of a quad vote for the sake of their neighbours:
/// it takes a derivative or an implicit level of detail behind the vote. A language without fine
/// derivatives cannot make such a vote.
pub fn vote_shields_derivatives(plan: &Plan) -> bool {
    let main = plan.main().and_then(|p| Some((p, plan.program(p)?)));
    let Some((pass, program)) = main.filter(|_| !plan.steps.is_empty()) else {
        return false;
    };
    let fragment = pass.fragment.as_deref();
    let found = fragment.and_then(|f| program.entry_point(ShaderStage::Fragment, f));
    let Some((entry, _)) = found else {
        return false;
    };
    let functions = &program.module().functions;
    if !functions.iter().any(|(_, f)| votes(f)) {
        return false;
    }
    let graph = Graph::build(program);
    let f = graph.function(FunctionId::EntryPoint(entry));
    f.statements.iter().any(|(_, node)| match node.statement {
        Statement::Emit(range) => range.clone().any(|e| {
            matches!(
                effect::of_expression(&f.function.expressions[e]),
                Some(Effect::Derivative | Effect::ImplicitLod)
            )
        }),
        Statement::Call { function, .. } => {
            !is_ours(&functions[*function])
                && effects::derivative(&graph, FunctionId::Function(*function)).is_some()
        }
        _ => false,
    })
}
