//! Copies the functions that some code calls, so that a change to them affects this code alone.

use std::collections::{BTreeMap, BTreeSet};

use naga::{Expression, Function, Handle, Module, Statement};

use super::free_name;
use naga_operands::calls;

/// The copy of each function that has one.
pub(crate) type FunctionCopies = BTreeMap<Handle<Function>, Handle<Function>>;

/// Adds a copy, `{name}_{suffix}`, of each of the `called` functions that `is_changed` chooses, and
/// of those that call one. A copy calls copies, and `change` has been applied to it.
pub(crate) fn copy_called(
    module: &mut Module,
    called: &BTreeSet<Handle<Function>>,
    suffix: &str,
    is_changed: &dyn Fn(&Function) -> bool,
    change: &mut dyn FnMut(&mut Function),
) -> FunctionCopies {
    let mut copies = FunctionCopies::new();
    // Callees come first in the arena, so their copies exist before a caller's.
    for original in called {
        let function = &module.functions[*original];
        let calls_copy = || {
            let callees = calls::callees(&function.body);
            callees.iter().any(|callee| copies.contains_key(callee))
        };
        if !is_changed(function) && !calls_copy() {
            continue;
        }
        let mut copy = function.clone();
        redirect(&mut copy, &copies);
        change(&mut copy);
        copy.name = copy.name.map(|name| free_name(module, &name, suffix));
        let span = module.functions.get_span(*original);
        copies.insert(*original, module.functions.append(copy, span));
    }
    copies
}

/// Makes a function call copies.
pub(crate) fn redirect(function: &mut Function, copies: &FunctionCopies) {
    for (_, expression) in function.expressions.iter_mut() {
        if let Expression::CallResult(callee) = expression
            && let Some(copy) = copies.get(callee)
        {
            *callee = *copy;
        }
    }
    naga_operands::visit_mut(&mut function.body, &mut |statement| {
        if let Statement::Call { function, .. } = statement
            && let Some(copy) = copies.get(function)
        {
            *function = *copy;
        }
    });
}
