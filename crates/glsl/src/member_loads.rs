//! Loads the member that an expression reads instead of the struct, array or matrix around it, as
//! naga's WGSL front end does. Vectors stay whole.
//!
//! naga's GLSL front end loads `block` for `block.member`. Passes would then take the whole block
//! for read, and writers could not tell which members a stage reads.

use std::collections::HashSet;

use naga::front::Typifier;
use naga::proc::ResolveContext;
use naga::{Expression, FastHashMap, Function, Handle, Module, Statement, TypeInner};

/// Rewrites all functions.
pub(super) fn narrow(module: &mut Module) {
    let functions = module.functions.iter().map(|(_, f)| f);
    let entries = module.entry_points.iter().map(|e| &e.function);
    let vectors: Vec<_> = functions
        .chain(entries)
        .map(|f| vectors(module, f))
        .collect();
    let functions = module.functions.iter_mut().map(|(_, f)| f);
    let entries = module.entry_points.iter_mut().map(|e| &mut e.function);
    for (function, vectors) in functions.chain(entries).zip(vectors) {
        narrow_function(function, &vectors);
    }
}

/// The expressions that are vectors.
fn vectors(module: &Module, function: &Function) -> HashSet<Handle<Expression>> {
    let context =
        ResolveContext::with_locals(module, &function.local_variables, &function.arguments);
    let mut types = Typifier::new();
    let mut found = HashSet::new();
    for (handle, _) in function.expressions.iter() {
        if types.grow(handle, &function.expressions, &context).is_err() {
            // The validator says so later.
            break;
        }
        if matches!(
            types[handle].inner_with(&module.types),
            TypeInner::Vector { .. }
        ) {
            found.insert(handle);
        }
    }
    found
}

/// ```text
/// %1 = Load { pointer: %0 }                      %1 = AccessIndex { base: %0, index: 3 }
/// %2 = AccessIndex { base: %1, index: 3 }        %2 = Load { pointer: %1 }
/// ```
fn narrow_function(function: &mut Function, vectors: &HashSet<Handle<Expression>>) {
    let mut uses: FastHashMap<Handle<Expression>, usize> = FastHashMap::default();
    for (_, expression) in function.expressions.iter() {
        for operand in naga_operands::of_expression(expression) {
            *uses.entry(operand).or_default() += 1;
        }
    }
    // One `Emit` evaluates both, so no store comes between them.
    let mut emits: FastHashMap<Handle<Expression>, usize> = FastHashMap::default();
    let mut emit = 0;
    naga_operands::visit(&function.body, &mut |statement| {
        if let Statement::Emit(range) = statement {
            emit += 1;
            emits.extend(range.clone().map(|h| (h, emit)));
        }
        for operand in naga_operands::of_statement(statement) {
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
        if is_at_once && !vectors.contains(&load) && uses.get(&load) == Some(&1) {
            expressions[load] = Expression::AccessIndex {
                base: pointer,
                index,
            };
            expressions[member] = Expression::Load { pointer: load };
        }
    }
}
