//! Leaves the function after a `discard` in a loop. GLSL's `discard` and SPIR-V's `OpKill` end the
//! invocation. WGSL's only demotes it, so a loop that nothing else ends would never end.

use naga::{Block, Expression, Function, Handle, Module, Span, Statement};
use preshade_passes::graph::operands;

/// Adds a `return` behind each `discard` in a loop.
pub(super) fn end(module: &mut Module) {
    let functions = module.functions.iter_mut().map(|(_, f)| f);
    let entries = module.entry_points.iter_mut().map(|e| &mut e.function);
    for function in functions.chain(entries) {
        let mut body = std::mem::take(&mut function.body);
        end_block(function, &mut body, false);
        function.body = body;
    }
}

fn end_block(function: &mut Function, block: &mut Block, is_in_loop: bool) {
    let mut kills = Vec::new();
    for (i, statement) in block.iter_mut().enumerate() {
        if matches!(statement, Statement::Kill) && is_in_loop {
            kills.push(i + 1);
        }
        let is_in_loop = is_in_loop || matches!(statement, Statement::Loop { .. });
        for inner in operands::blocks_mut(statement) {
            end_block(function, inner, is_in_loop);
        }
    }
    for at in kills.into_iter().rev() {
        if at == block.len() || !matches!(block[at], Statement::Return { .. }) {
            let value = zero(function);
            let mut leaves = Block::new();
            leaves.push(Statement::Return { value }, Span::UNDEFINED);
            block.splice(at..at, leaves);
        }
    }
}

/// The value that an invocation returns which no longer counts.
fn zero(function: &mut Function) -> Option<Handle<Expression>> {
    let ty = function.result.as_ref()?.ty;
    Some(
        function
            .expressions
            .append(Expression::ZeroValue(ty), Span::UNDEFINED),
    )
}
