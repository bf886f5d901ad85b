//! Removes discards from an entry point.

use std::collections::BTreeMap;

use naga::{Block, Expression, Function, Handle, Module, Statement};

use super::is_idle;

/// Suffix of functions copied without discards.
const SUFFIX: &str = "undiscarded";

/// The module with all discards of an entry point removed. Callees that discard, directly or not,
/// are copied as `{name}_undiscarded`; the originals remain. Empty `if`s are removed.
pub fn without_discard(module: &Module, entry: usize) -> Module {
    let mut out = module.clone();
    let mut copies: BTreeMap<Handle<Function>, Handle<Function>> = BTreeMap::new();
    let reached = reached(module, &module.entry_points[entry].function);
    // Callees come first in the arena, so their copies exist when a caller is rewritten.
    for (handle, original) in module.functions.iter() {
        if !reached[handle.index()] || !touched(&original.body, &copies) {
            continue;
        }
        let mut copy = original.clone();
        rewrite(&mut copy, &copies);
        copy.name = original.name.as_ref().map(|n| format!("{n}_{SUFFIX}"));
        let new = out
            .functions
            .append(copy, module.functions.get_span(handle));
        copies.insert(handle, new);
    }
    rewrite(&mut out.entry_points[entry].function, &copies);
    out
}

fn reached(module: &Module, entry: &Function) -> Vec<bool> {
    fn calls(block: &Block, reached: &mut [bool]) {
        for statement in block {
            if let Statement::Call { function, .. } = statement {
                reached[function.index()] = true;
            }
            for inner in crate::graph::operands::blocks(statement) {
                calls(inner, reached);
            }
        }
    }
    let mut reached = vec![false; module.functions.len()];
    calls(&entry.body, &mut reached);
    for (handle, function) in module.functions.iter().rev() {
        if reached[handle.index()] {
            calls(&function.body, &mut reached);
        }
    }
    reached
}

/// Whether a block discards, or calls a function that does.
fn touched(block: &Block, copies: &BTreeMap<Handle<Function>, Handle<Function>>) -> bool {
    block.iter().any(|statement| match statement {
        Statement::Kill => true,
        Statement::Call { function, .. } => copies.contains_key(function),
        other => crate::graph::operands::blocks(other)
            .iter()
            .any(|b| touched(b, copies)),
    })
}

fn rewrite(function: &mut Function, copies: &BTreeMap<Handle<Function>, Handle<Function>>) {
    for (_, expression) in function.expressions.iter_mut() {
        if let Expression::CallResult(callee) = expression
            && let Some(new) = copies.get(callee)
        {
            *callee = *new;
        }
    }
    let body = std::mem::take(&mut function.body);
    function.body = strip(body, copies);
}

fn strip(block: Block, copies: &BTreeMap<Handle<Function>, Handle<Function>>) -> Block {
    let mut out = Block::new();
    for (statement, span) in block.span_into_iter() {
        let statement = match statement {
            Statement::Kill => continue,
            Statement::If {
                condition,
                accept,
                reject,
            } => {
                let empty_before = is_idle(&accept) && is_idle(&reject);
                let (accept, reject) = (strip(accept, copies), strip(reject, copies));
                if !empty_before && is_idle(&accept) && is_idle(&reject) {
                    continue;
                }
                Statement::If {
                    condition,
                    accept,
                    reject,
                }
            }
            Statement::Block(b) => Statement::Block(strip(b, copies)),
            Statement::Switch { selector, cases } => Statement::Switch {
                selector,
                cases: cases
                    .into_iter()
                    .map(|case| naga::SwitchCase {
                        body: strip(case.body, copies),
                        ..case
                    })
                    .collect(),
            },
            Statement::Loop {
                body,
                continuing,
                break_if,
            } => Statement::Loop {
                body: strip(body, copies),
                continuing: strip(continuing, copies),
                break_if,
            },
            Statement::Call {
                function,
                arguments,
                result,
            } => Statement::Call {
                function: copies.get(&function).copied().unwrap_or(function),
                arguments,
                result,
            },
            other => other,
        };
        out.push(statement, span);
    }
    out
}
