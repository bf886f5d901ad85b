//! Removes fall-through from GLSL's switch cases by copying the following case's statements. WGSL
//! has no fall-through, and naga's SPIR-V writer produces an invalid module for it.

use crate::copy::{CopyFunction, Copying};
use crate::writer::FunctionWriter;
use naga::{Block, Function, Module, Statement, SwitchCase};

use super::missing_returns;

/// Removes all fall-through, except for empty cases that share the next body.
pub(crate) fn remove(module: &mut Module) {
    let functions = module.functions.iter_mut().map(|(_, f)| f);
    let entries = module.entry_points.iter_mut().map(|e| &mut e.function);
    for function in functions.chain(entries) {
        let mut body = std::mem::take(&mut function.body);
        write_out_cases(function, &mut body);
        function.body = body;
    }
}

fn write_out_cases(function: &mut Function, block: &mut Block) {
    for statement in block.iter_mut() {
        for inner in naga_operands::blocks_mut(statement) {
            write_out_cases(function, inner);
        }
        let Statement::Switch { cases, .. } = statement else {
            continue;
        };
        // Go backwards, so the next case is already complete.
        for i in (0..cases.len()).rev() {
            if !cases[i].fall_through || cases[i].body.is_empty() {
                continue;
            }
            // The end is unreachable. naga's front end only looks at the last statement.
            if !missing_returns::reaches_end(&cases[i].body) {
                cases[i].fall_through = false;
                continue;
            }
            // Skip empty cases that share the next body. An empty case without fall-through is only
            // a `break`.
            let shares = |c: &&SwitchCase| c.body.is_empty() && c.fall_through;
            let next = cases[i + 1..].iter().find(|c| !shares(c));
            if let Some(next) = next.map(|c| &c.body) {
                let copy = copy(function, next);
                cases[i].body.extend_block(copy);
            }
            cases[i].fall_through = false;
        }
    }
}

/// Copies a block of a function with new expressions, because each may be emitted only once.
fn copy(function: &mut Function, block: &Block) -> Block {
    let original = function.clone();
    let writer = FunctionWriter::of(std::mem::take(function));
    let mut case = CaseCopy(Copying::new(&original, writer));
    case.block(block);
    let mut copied = case.0.writer.finish();
    let block = std::mem::take(&mut copied.body);
    *function = copied;
    block
}

/// Copies statements beside their originals, in the same function.
struct CaseCopy<'a>(Copying<'a>);

impl<'a> CopyFunction<'a> for CaseCopy<'a> {
    fn copying(&mut self) -> &mut Copying<'a> {
        &mut self.0
    }
}
