//! Call depth of a module.
//!
//! Analyses recurse once per call, and so do naga's writers and driver compilers. A chain of
//! thousands of calls would exhaust the stack.

use naga::{Block, Function, Handle, Module, Statement};

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

fn callees(body: &Block) -> Vec<Handle<Function>> {
    let mut found = Vec::new();
    let mut work = vec![body];
    while let Some(block) = work.pop() {
        for statement in block.iter() {
            match statement {
                Statement::Call { function, .. } => found.push(*function),
                Statement::Block(inner) => work.push(inner),
                Statement::If { accept, reject, .. } => work.extend([accept, reject]),
                Statement::Switch { cases, .. } => work.extend(cases.iter().map(|c| &c.body)),
                Statement::Loop {
                    body, continuing, ..
                } => work.extend([body, continuing]),
                _ => {}
            }
        }
    }
    found
}
