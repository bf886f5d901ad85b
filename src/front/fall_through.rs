//! Removes fall-through from GLSL's switch cases by copying the following case's statements. WGSL
//! has no fall-through, and naga's SPIR-V writer produces an invalid module for it.

use std::collections::HashMap;

use naga::{Arena, Block, Expression, Handle, Module, Statement};

use super::missing_returns;
use crate::wgsl::operands;

/// Removes all fall-through, except for empty cases that share the next body.
pub(super) fn remove(module: &mut Module) {
    let functions = module.functions.iter_mut().map(|(_, f)| f);
    let entries = module.entry_points.iter_mut().map(|e| &mut e.function);
    for function in functions.chain(entries) {
        write_out_cases(&mut function.expressions, &mut function.body);
    }
}

fn write_out_cases(expressions: &mut Arena<Expression>, block: &mut Block) {
    for statement in block.iter_mut() {
        for inner in operands::blocks(statement) {
            write_out_cases(expressions, inner);
        }
        let Statement::Switch { cases, .. } = statement else {
            continue;
        };
        // Go backwards, so the next case is already complete.
        for i in (0..cases.len()).rev() {
            if !cases[i].fall_through || cases[i].body.is_empty() {
                continue;
            }
            // The end is unreachable. naga's front end only looks at the last statement.
            if !missing_returns::reaches_end(&cases[i].body) {
                cases[i].fall_through = false;
                continue;
            }
            // Skip empty cases, which share the next body.
            let next = cases[i + 1..].iter().find(|c| !c.body.is_empty());
            if let Some(next) = next.map(|c| &c.body) {
                let copy = copy(expressions, next, &mut HashMap::new());
                cases[i].body.extend_block(copy);
            }
            cases[i].fall_through = false;
        }
    }
}

/// Copies a block with new expressions, because each may be emitted only once.
fn copy(
    expressions: &mut Arena<Expression>,
    block: &Block,
    copies: &mut HashMap<Handle<Expression>, Handle<Expression>>,
) -> Block {
    let mut out = Block::with_capacity(block.len());
    for (statement, span) in block.span_iter() {
        let mut statement = statement.clone();
        match &mut statement {
            Statement::Emit(range) => {
                let start = expressions.len();
                for handle in range.clone() {
                    let mut expression = expressions[handle].clone();
                    operands::of_expression(&mut expression, |e| {
                        *e = copies.get(e).copied().unwrap_or(*e);
                    });
                    let span = expressions.get_span(handle);
                    copies.insert(handle, expressions.append(expression, span));
                }
                *range = expressions.range_from(start);
            }
            other => {
                if let Some(result) = result(other) {
                    let expression = expressions[result].clone();
                    let span = expressions.get_span(result);
                    copies.insert(result, expressions.append(expression, span));
                }
                operands::of_statement(other, |e| *e = copies.get(e).copied().unwrap_or(*e));
                for inner in operands::blocks(other) {
                    *inner = copy(expressions, inner, copies);
                }
                // `break_if` may name a value of the continuing block.
                if let Statement::Loop {
                    break_if: Some(e), ..
                } = other
                {
                    *e = copies.get(e).copied().unwrap_or(*e);
                }
            }
        }
        out.push(statement, *span);
    }
    out
}

/// The expression that a statement evaluates itself.
pub(super) fn result(statement: &Statement) -> Option<Handle<Expression>> {
    match statement {
        Statement::Call { result, .. } | Statement::Atomic { result, .. } => *result,
        Statement::WorkGroupUniformLoad { result, .. }
        | Statement::SubgroupBallot { result, .. }
        | Statement::SubgroupGather { result, .. }
        | Statement::SubgroupCollectiveOperation { result, .. } => Some(*result),
        _ => None,
    }
}
