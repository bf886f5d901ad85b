//! How deeply a module's functions call one another.
//!
//! Analyses recurse once a call, and an expression behind a chain of calls is looked at once a link: a chain of thousands exhausts the stack and the patience of
//! any of them, naga's writers and a driver's compiler included.

use naga::{Block, Function, Handle, Module, Statement};

/// Most functions on the stack at once, the entry point included. The deepest chain in the public materials known to us has 14.
pub const MOST: usize = 256;

/// The first function that stands on top of more than [`MOST`] calls.
pub fn too_deep(module: &Module) -> Option<Handle<Function>> {
    // A function comes after all that it calls: the validator has seen to it.
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
