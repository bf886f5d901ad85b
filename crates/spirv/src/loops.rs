//! Gives loops the form of hand-written ones: naga's reader puts the body of a loop into the branch
//! that does not leave it.
//!
//! ```text
//! loop { if c { work; continue; } else { break; } }      loop { if c { } else { break; } work; }
//! ```

use naga::{Block, Module, Statement};

/// Changes all loops of a module.
pub(super) fn settle(module: &mut Module) {
    let functions = module.functions.iter_mut().map(|(_, f)| f);
    let entries = module.entry_points.iter_mut().map(|e| &mut e.function);
    for function in functions.chain(entries) {
        settle_block(&mut function.body);
    }
}

fn settle_block(block: &mut Block) {
    for statement in block.iter_mut() {
        if let Statement::Loop { body, .. } = statement {
            while open_last(body) {}
        }
        for inner in naga_operands::blocks_mut(statement) {
            settle_block(inner);
        }
    }
}

/// Moves the branch that stays in the loop behind the last `if`. Returns whether it changed
/// anything.
fn open_last(body: &mut Block) -> bool {
    if matches!(body.last(), Some(Statement::Continue)) {
        let last = body.len() - 1;
        body.cull(last..);
    }
    let Some(Statement::If { accept, reject, .. }) = body.last_mut() else {
        return false;
    };
    let leaves = |b: &Block| matches!(b.last(), Some(Statement::Break)) && b.len() == 1;
    let stays = match (leaves(accept), leaves(reject)) {
        (false, true) => accept,
        (true, false) => reject,
        _ => return false,
    };
    if stays.is_empty() {
        return false;
    }
    let moved = std::mem::take(stays);
    for (statement, span) in moved.span_into_iter() {
        body.push(statement, span);
    }
    true
}
