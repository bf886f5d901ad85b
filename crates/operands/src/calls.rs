//! The calls of a module, and their depth.
//!
//! Analyses recurse once per call, and so do naga's writers and driver compilers. A chain of
//! thousands of calls would exhaust the stack.

use std::collections::BTreeSet;

use naga::{Block, Expression, Function, Handle, Module, Statement};

/// Largest accepted call depth, the entry point included. The deepest public material we know has
/// 14.
pub const MOST: usize = 256;

/// The first function whose call depth exceeds [`MOST`].
pub fn too_deep(module: &Module) -> Option<Handle<Function>> {
    // The validator guarantees that callees come before their callers.
    let mut depths: Vec<usize> = Vec::with_capacity(module.functions.len());
    for (handle, function) in module.functions.iter() {
        let mut depth = 1;
        for callee in callees(&function.body) {
            depth = depth.max(1 + depths.get(callee.index()).copied().unwrap_or_default());
        }
        if depth >= MOST {
            return Some(handle);
        }
        depths.push(depth);
    }
    None
}

/// The functions that a body calls itself, once for each call.
pub fn callees(body: &Block) -> Vec<Handle<Function>> {
    let mut found = Vec::new();
    crate::visit(body, &mut |statement| {
        if let Statement::Call { function, .. } = statement {
            found.push(*function);
        }
    });
    found
}

/// The functions that a body calls, directly or not.
pub fn called(module: &Module, body: &Block) -> BTreeSet<Handle<Function>> {
    let mut found = BTreeSet::new();
    let mut left = callees(body);
    while let Some(function) = left.pop() {
        if found.insert(function) {
            left.extend(callees(&module.functions[function].body));
        }
    }
    found
}

/// A call.
#[derive(Clone, Copy)]
pub struct Call<'m> {
    /// The function that calls, `None` for an entry point, and its handle.
    pub caller: (Option<Handle<Function>>, &'m Function),
    /// The function that is called.
    pub callee: Handle<Function>,
    /// What is passed, in the caller.
    pub arguments: &'m [Handle<Expression>],
}

/// Visits all calls of a module. Those of a function come before those in it.
pub fn visit<'m>(module: &'m Module, each: &mut dyn FnMut(Call<'m>)) {
    let entries = module.entry_points.iter().map(|e| (None, &e.function));
    // The validator guarantees that callees come before their callers.
    let functions = module.functions.iter().rev().map(|(h, f)| (Some(h), f));
    for caller in entries.chain(functions) {
        crate::visit(&caller.1.body, &mut |statement| {
            if let Statement::Call {
                function,
                arguments,
                ..
            } = statement
            {
                each(Call {
                    caller,
                    callee: *function,
                    arguments,
                });
            }
        });
    }
}
