//! Where a function has an effect, or one effect after another.

use naga::{Span, Statement};

use preshade_dataflow::graph::effect::{self, Effect};
use preshade_dataflow::graph::{FunctionId, Graph, StmtId};

/// Effects that read neighbours in the quad.
const DERIVATIVES: [Effect; 2] = [Effect::Derivative, Effect::ImplicitLod];

/// Where a function or one of its callees first takes a derivative, explicitly or by an implicit
/// level of detail.
pub(crate) fn derivative(graph: &Graph, function: FunctionId) -> Option<Span> {
    find(graph, function, &DERIVATIVES)
}

/// Whether a function or one of its callees may take a derivative after a fragment of its quad was
/// discarded. SPIR-V's `OpKill` ends such a fragment, so its neighbours read undefined values from
/// it.
pub(crate) fn differentiates_after_discard(graph: &Graph, id: FunctionId) -> bool {
    let effects = graph.effects(id);
    if !effects.contains(&Effect::Discard) || DERIVATIVES.iter().all(|d| !effects.contains(d)) {
        return false;
    }
    let f = graph.function(id);
    let callee = |statement: &Statement| match statement {
        Statement::Call { function, .. } => Some(FunctionId::Function(*function)),
        _ => None,
    };
    // The next iteration of a loop comes after a discard in this one.
    let outermost_loop = |mut at: StmtId| {
        let mut first = at;
        while let Some(parent) = f.statements.get(at).parent {
            at = parent;
            if matches!(f.statements.get(at).statement, Statement::Loop { .. }) {
                first = at;
            }
        }
        first
    };
    let discards = f.statements.iter().filter(|(_, node)| {
        matches!(node.statement, Statement::Kill)
            || callee(node.statement).is_some_and(|c| graph.effects(c).contains(&Effect::Discard))
    });
    let Some(first) = discards.map(|(at, _)| outermost_loop(at)).min() else {
        return false;
    };
    f.statements.iter().any(|(at, node)| match node.statement {
        Statement::Emit(range) if at > first => range.clone().any(|e| {
            effect::of_expression(&f.function.expressions[e])
                .is_some_and(|e| DERIVATIVES.contains(&e))
        }),
        Statement::Call { function, .. } => {
            let callee = FunctionId::Function(*function);
            (at > first && derivative(graph, callee).is_some())
                || differentiates_after_discard(graph, callee)
        }
        _ => false,
    })
}

/// The first node of a function with one of these effects. If the callee has no source span, the
/// call takes its place.
pub(crate) fn find(graph: &Graph, id: FunctionId, wanted: &[Effect]) -> Option<Span> {
    if graph.effects(id).iter().all(|e| !wanted.contains(e)) {
        return None;
    }
    let f = graph.function(id);
    let is_wanted = |e: Option<Effect>| e.is_some_and(|e| wanted.contains(&e));
    for (at, node) in f.statements.iter() {
        if is_wanted(effect::of_statement(graph.module(), f, at)) {
            return Some(node.span);
        }
        let found = match node.statement {
            Statement::Emit(range) => range
                .clone()
                .find(|e| is_wanted(effect::of_expression(&f.function.expressions[*e])))
                .map(|e| f.function.expressions.get_span(e)),
            Statement::Call { function, .. } => {
                find(graph, FunctionId::Function(*function), wanted)
            }
            _ => None,
        };
        if found.is_some() {
            return found;
        }
    }
    None
}
