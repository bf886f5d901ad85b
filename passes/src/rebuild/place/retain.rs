//! Removes items that no entry point uses any more.

use naga::{Expression, Function, Module, ShaderStage};

/// The module with only these entry points and their dependences, without unused functions,
/// globals, types, constants and dead `let`s.
pub fn retain(module: &Module, entries: &[(ShaderStage, &str)]) -> Module {
    let mut module = module.clone();
    module
        .entry_points
        .retain(|e| entries.contains(&(e.stage, e.name.as_str())));
    module.doc_comments = None;
    let functions = module
        .functions
        .iter_mut()
        .map(|(_, f)| f)
        .chain(module.entry_points.iter_mut().map(|e| &mut e.function));
    for function in functions {
        drop_dead_names(function);
    }
    naga::compact::compact(&mut module, naga::compact::KeepUnused::No);
    // Compaction keeps named constants, so remove unused names first.
    while drop_unused_constant_names(&mut module) {
        naga::compact::compact(&mut module, naga::compact::KeepUnused::No);
    }
    module
}

/// Removes the names of unused constants; returns whether there were any.
fn drop_unused_constant_names(module: &mut Module) -> bool {
    let mut used = vec![false; module.constants.len()];
    let functions = module
        .functions
        .iter()
        .map(|(_, f)| f)
        .chain(module.entry_points.iter().map(|e| &e.function));
    let arenas = functions
        .map(|f| &f.expressions)
        .chain(std::iter::once(&module.global_expressions));
    for (_, expression) in arenas.flat_map(|a| a.iter()) {
        if let Expression::Constant(c) = expression {
            used[c.index()] = true;
        }
    }
    let mut dropped = false;
    for (handle, constant) in module.constants.iter_mut() {
        if !used[handle.index()] {
            dropped |= constant.name.take().is_some();
        }
    }
    dropped
}

/// Removes the names of expressions without dependent statements: compaction keeps named
/// expressions.
fn drop_dead_names(function: &mut Function) {
    let mut used = vec![false; function.expressions.len()];
    naga_operands::visit(&function.body, &mut |statement| {
        let read = naga_operands::of_statement(statement);
        for e in read.into_iter().chain(naga_operands::result(statement)) {
            used[e.index()] = true;
        }
    });
    for (e, expression) in function.expressions.iter().rev() {
        if used[e.index()] {
            for operand in naga_operands::of_expression(expression) {
                used[operand.index()] = true;
            }
        }
    }
    function.named_expressions.retain(|e, _| used[e.index()]);
}
