//! Obstacles to an early return of single lanes, and to a vote.

use naga::{Expression, ShaderStage, Statement};

use super::{EarlyDiscard, Mode, Params, prologue};
use crate::analysis::opaque::{self, Opaque};
use crate::core::pass::{Pass, Refusal};
use crate::core::plan::Plan;
use crate::graph::effect::{self, Effect};
use crate::graph::{FunctionId, Graph};
use crate::rebuild::gradients;

/// Why single lanes must not return: a derivative that cannot be evaluated first, a rounded
/// derivative that decides coverage, or no budget for the rounding.
pub fn refuse_lane(opaque: &Opaque, fragment: usize, params: &Params) -> Option<Refusal> {
    const VOTE: &str =
        "take quad=vote, which leaves only when the whole quad is behind and touches no sample";
    let refuse = |code: &str, reason: &str, remedy: &str, span| {
        Refusal::new(EarlyDiscard::INFO.name, code, reason, remedy)
            .at(opaque.program.sources(), span)
    };
    let taken = match gradients::find(&opaque.graph, fragment) {
        Ok(taken) => taken,
        Err(span) => {
            return Some(refuse(
                "lane-spoils-derivatives",
                "the fragment stage takes a derivative, or an implicit level of detail, of something that cannot be computed ahead of the discard, and a lane that left would spoil it for its neighbours",
                VOTE,
                span,
            ));
        }
    };
    let decides = opaque.decides.slice(&opaque.graph, fragment);
    let expressions = &opaque.program.module().entry_points[fragment]
        .function
        .expressions;
    let coverage = taken.iter().find(|e| {
        matches!(expressions[**e], Expression::ImageSample { .. })
            && decides.root().kept.expressions[e.index()].is_some()
    });
    let Some(sample) = coverage else {
        // A diagnostic picture differs everywhere and has no contract.
        let unsaid = params.budget.is_none() && params.mode == Mode::Cull;
        let first = taken.first().filter(|_| unsaid)?;
        return Some(refuse(
            "lane-needs-budget",
            "gradients have to be taken ahead of the discard, and the level of detail they choose rounds otherwise than the implicit one: up to 4/255 were measured in \
             trilinear textures, and anisotropic filtering is worst",
            "take quad=vote, which is exact, or say what difference is allowed: budget=0.02, say",
            expressions.get_span(*first),
        ));
    };
    Some(refuse(
        "lane-decides-coverage",
        "a sample decides what a fragment covers, or its depth: with gradients taken first it would round otherwise than in the pre-pass",
        VOTE,
        expressions.get_span(*sample),
    ))
}

/// Whether the quads of the main pass vote to keep their lanes alive for derivatives or
/// implicit-LOD samples behind the prologue. A language without fine derivatives cannot express
/// this vote.
pub fn vote_shields_derivatives(plan: &Plan) -> bool {
    let votes = plan
        .steps
        .iter()
        .any(|s| s.pass == EarlyDiscard::INFO.name && s.params["quad"] == "vote");
    let main = plan.main().and_then(|p| Some((p, plan.program(p)?)));
    let (true, Some((pass, program))) = (votes, main) else {
        return false;
    };
    let Some((entry, _)) = pass
        .fragment
        .as_deref()
        .and_then(|f| program.entry_point(ShaderStage::Fragment, f))
    else {
        return false;
    };
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
            let name = program.module().functions[*function].name.as_deref();
            !name.is_some_and(|n| n.starts_with(prologue::HIDDEN))
                && opaque::derivative(&graph, FunctionId::Function(*function)).is_some()
        }
        _ => false,
    })
}
