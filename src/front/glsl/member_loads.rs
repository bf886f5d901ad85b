//! Loads the member that an expression reads instead of the struct, array, matrix or vector around
//! it, as naga's WGSL front end does.
//!
//! naga's GLSL front end loads `block` for `block.member`. Passes would then take the whole block
//! for read, and writers could not tell which members a stage reads.

use naga::{Expression, FastHashMap, Function, Handle, Module, Statement};
use preshade_passes::core::operands;

/// Rewrites all functions.
pub(super) fn narrow(module: &mut Module) {
    let functions = module.functions.iter_mut().map(|(_, f)| f);
    let entries = module.entry_points.iter_mut().map(|e| &mut e.function);
    functions.chain(entries).for_each(narrow_function);
}

/// ```text
/// %1 = Load { pointer: %0 }                      %1 = AccessIndex { base: %0, index: 3 }
/// %2 = AccessIndex { base: %1, index: 3 }        %2 = Load { pointer: %1 }
/// ```
fn narrow_function(function: &mut Function) {
    let mut uses: FastHashMap<Handle<Expression>, usize> = FastHashMap::default();
    for (_, expression) in function.expressions.iter() {
        for operand in operands::of_expression(expression) {
            *uses.entry(operand).or_default() += 1;
        }
    }
    // One `Emit` evaluates both, so no store comes between them.
    let mut emits: FastHashMap<Handle<Expression>, usize> = FastHashMap::default();
    let mut emit = 0;
    operands::visit(&function.body, &mut |statement| {
        if let Statement::Emit(range) = statement {
            emit += 1;
            emits.extend(range.clone().map(|h| (h, emit)));
        }
        for operand in operands::of_statement(statement) {
            *uses.entry(operand).or_default() += 1;
        }
    });
    let expressions = &mut function.expressions;
    let all: Vec<Handle<Expression>> = expressions.iter().map(|(h, _)| h).collect();
    for member in all {
        let Expression::AccessIndex { base: load, index } = expressions[member] else {
            continue;
        };
        let Expression::Load { pointer } = expressions[load] else {
            continue;
        };
        let is_at_once = emits
            .get(&load)
            .is_some_and(|e| emits.get(&member) == Some(e));
        if is_at_once && uses.get(&load) == Some(&1) {
            expressions[load] = Expression::AccessIndex {
                base: pointer,
                index,
            };
            expressions[member] = Expression::Load { pointer: load };
        }
    }
}
