//! Removes discards from an entry point.

use naga::{Block, Function, Module, Statement};

use super::copies::{copy_called, redirect};
use naga_operands::calls;

/// Suffix of functions copied without discards.
const SUFFIX: &str = "undiscarded";

/// The module with all discards of an entry point removed. Callees that discard, directly or not,
/// are copied as `{name}_undiscarded`; the originals remain. Empty `if`s are removed.
pub fn without_discard(module: &Module, entry: usize) -> Module {
    let mut out = module.clone();
    let called = calls::called(module, &module.entry_points[entry].function.body);
    let copies = copy_called(&mut out, &called, SUFFIX, &discards, &mut |copy| {
        strip(&mut copy.body);
    });
    let function = &mut out.entry_points[entry].function;
    redirect(function, &copies);
    strip(&mut function.body);
    out
}

/// Whether a function discards by itself.
fn discards(function: &Function) -> bool {
    let mut found = false;
    naga_operands::visit(&function.body, &mut |statement| {
        found |= matches!(statement, Statement::Kill);
    });
    found
}

fn strip(block: &mut Block) {
    let does_nothing = |block: &Block| block.iter().all(|s| matches!(s, Statement::Emit(_)));
    let is_idle = |statement: &Statement| match statement {
        Statement::If { accept, reject, .. } => does_nothing(accept) && does_nothing(reject),
        _ => false,
    };
    for (mut statement, span) in std::mem::take(block).span_into_iter() {
        let was_idle = is_idle(&statement);
        for inner in naga_operands::blocks_mut(&mut statement) {
            strip(inner);
        }
        if matches!(statement, Statement::Kill) || (!was_idle && is_idle(&statement)) {
            continue;
        }
        block.push(statement, span);
    }
}
