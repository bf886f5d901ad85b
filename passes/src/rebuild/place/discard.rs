//! Removes discards from an entry point.

use std::collections::BTreeMap;

use naga::{Block, Expression, Function, Handle, Module, Statement};

use crate::core::{calls, operands};

/// Suffix of functions copied without discards.
const SUFFIX: &str = "undiscarded";

/// The module with all discards of an entry point removed. Callees that discard, directly or not,
/// are copied as `{name}_undiscarded`; the originals remain. Empty `if`s are removed.
pub fn without_discard(module: &Module, entry: usize) -> Module {
    let mut out = module.clone();
    let mut copies: BTreeMap<Handle<Function>, Handle<Function>> = BTreeMap::new();
    let called = calls::called(module, &module.entry_points[entry].function.body);
    // Callees come first in the arena, so their copies exist when a caller is rewritten.
    for (handle, original) in module.functions.iter() {
        if !called.contains(&handle) || !touched(&original.body, &copies) {
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

/// Whether a block discards, or calls a function that does.
fn touched(block: &Block, copies: &BTreeMap<Handle<Function>, Handle<Function>>) -> bool {
    let mut found = false;
    operands::visit(block, &mut |statement| {
        found |= match statement {
            Statement::Kill => true,
            Statement::Call { function, .. } => copies.contains_key(function),
            _ => false,
        }
    });
    found
}

fn rewrite(function: &mut Function, copies: &BTreeMap<Handle<Function>, Handle<Function>>) {
    for (_, expression) in function.expressions.iter_mut() {
        if let Expression::CallResult(callee) = expression
            && let Some(new) = copies.get(callee)
        {
            *callee = *new;
        }
    }
    strip(&mut function.body, copies);
}

fn strip(block: &mut Block, copies: &BTreeMap<Handle<Function>, Handle<Function>>) {
    let does_nothing = |block: &Block| block.iter().all(|s| matches!(s, Statement::Emit(_)));
    let is_idle = |statement: &Statement| match statement {
        Statement::If { accept, reject, .. } => does_nothing(accept) && does_nothing(reject),
        _ => false,
    };
    for (mut statement, span) in std::mem::take(block).span_into_iter() {
        let was_idle = is_idle(&statement);
        for inner in operands::blocks_mut(&mut statement) {
            strip(inner, copies);
        }
        if matches!(statement, Statement::Kill) || (!was_idle && is_idle(&statement)) {
            continue;
        }
        if let Statement::Call { function, .. } = &mut statement
            && let Some(copy) = copies.get(function)
        {
            *function = *copy;
        }
        block.push(statement, span);
    }
}
