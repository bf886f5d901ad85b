//! Copies the functions of a cut, one for each chain of calls, so that a change affects one use
//! only.

use std::collections::{BTreeMap, BTreeSet};

use naga::{Expression, Function, Handle, Module, Statement};

use crate::analysis::values::{ContextId, Values};
use preshade_dataflow::graph::{FunctionId, StmtId};

/// The module with copies of the functions of `contexts` and of their callers; calls on the way use
/// the copies. The walk starts at the entry point `entry`, which has the same statements and
/// expressions as in `values`. Copies keep expression handles, statement numbers and names, because
/// most originals are removed in the end.
pub fn isolate(
    module: &Module,
    entry: usize,
    values: &Values<'_, '_>,
    contexts: &BTreeSet<ContextId>,
) -> (Module, BTreeMap<ContextId, FunctionId>) {
    let mut module = module.clone();
    let mut chain: BTreeSet<ContextId> = BTreeSet::new();
    for context in contexts {
        let mut at = Some(*context);
        while let Some(context) = at {
            chain.insert(context);
            at = values.contexts[context].call.map(|(caller, _)| caller);
        }
    }
    let mut copies = BTreeMap::from([(0, FunctionId::EntryPoint(entry))]);
    // Contexts follow their callers. Reversed, callees come first, as the arena requires.
    for context in chain.iter().rev() {
        let calls: BTreeMap<StmtId, Handle<Function>> = chain
            .iter()
            .filter_map(|child| {
                let (caller, at) = values.contexts[*child].call?;
                match copies.get(child) {
                    Some(FunctionId::Function(copy)) if caller == *context => Some((at, *copy)),
                    _ => None,
                }
            })
            .collect();
        match values.contexts[*context].function {
            FunctionId::Function(original) => {
                let mut copy = module.functions[original].clone();
                redirect(&mut copy, &calls);
                let span = module.functions.get_span(original);
                let copy = module.functions.append(copy, span);
                copies.insert(*context, FunctionId::Function(copy));
            }
            FunctionId::EntryPoint(_) => {
                redirect(&mut module.entry_points[entry].function, &calls);
            }
        }
    }
    (module, copies)
}

/// For each copied context, the `wanted` contexts it leads to, including itself: data for those
/// passes through it.
pub fn reachable_contexts(
    values: &Values<'_, '_>,
    copies: &BTreeMap<ContextId, FunctionId>,
    wanted: &[ContextId],
) -> BTreeMap<ContextId, Vec<usize>> {
    let through = |context: ContextId| {
        let all = wanted.iter().enumerate();
        let through = all.filter(|(_, to)| leads_to(values, context, **to));
        through.map(|(i, _)| i).collect()
    };
    copies.keys().map(|c| (*c, through(*c))).collect()
}

/// The copies that a context calls, each with the contexts `below` it.
pub fn callees<'b>(
    values: &Values<'_, '_>,
    copies: &BTreeMap<ContextId, FunctionId>,
    below: &'b BTreeMap<ContextId, Vec<usize>>,
    context: ContextId,
) -> Vec<(Handle<Function>, &'b Vec<usize>)> {
    copies
        .iter()
        .filter_map(|(callee, id)| match (values.contexts[*callee].call, id) {
            (Some((caller, _)), FunctionId::Function(h)) if caller == context => {
                Some((*h, &below[callee]))
            }
            _ => None,
        })
        .collect()
}

/// Whether a chain of calls is a prefix of another.
fn leads_to(values: &Values<'_, '_>, context: ContextId, mut to: ContextId) -> bool {
    loop {
        if context == to {
            return true;
        }
        match values.contexts[to].call {
            Some((caller, _)) => to = caller,
            None => return false,
        }
    }
}

fn redirect(function: &mut Function, calls: &BTreeMap<StmtId, Handle<Function>>) {
    let mut next = 0;
    let mut results = Vec::new();
    naga_operands::visit_mut(&mut function.body, &mut |statement| {
        let id = StmtId::from(next);
        next += 1;
        if let (
            Some(copy),
            Statement::Call {
                function, result, ..
            },
        ) = (calls.get(&id), statement)
        {
            *function = *copy;
            results.extend(result.map(|r| (r, *copy)));
        }
    });
    for (result, copy) in results {
        function.expressions[result] = Expression::CallResult(copy);
    }
}
