//! Makes the position invariant if arithmetic behind it has `NoContraction`. naga's reader drops
//! that decoration, and the writer restores it for the arithmetic of invariant positions.

use std::collections::HashSet;

use rspirv::dr::{Builder, Instruction, Operand};
use rspirv::spirv::{BuiltIn, Decoration, Op, Word};

use crate::words::{ids, position};

/// Marks the position. Returns whether arithmetic elsewhere has the decoration too.
pub(super) fn keep(module: &mut Builder) -> bool {
    let is_precise = |i: &&Instruction| {
        i.operands.get(1) == Some(&Operand::Decoration(Decoration::NoContraction))
    };
    let annotations = &module.module_ref().annotations;
    let precise: HashSet<Word> = annotations
        .iter()
        .filter(is_precise)
        .flat_map(ids)
        .collect();
    if precise.is_empty() {
        return false;
    }
    let of_position = Operand::BuiltIn(BuiltIn::Position);
    let is_position = |i: &&Instruction| {
        i.class.opcode == Op::Decorate && i.operands.last() == Some(&of_position)
    };
    let positions: Vec<Word> = annotations
        .iter()
        .filter(is_position)
        .flat_map(ids)
        .collect();
    let slice = position::slice(module.module_ref());
    let decides = |id: &Word| slice.as_ref().is_none_or(|slice| slice.contains(id));
    let of_positions = match positions.is_empty() {
        true => 0,
        false => precise.iter().filter(|id| decides(id)).count(),
    };
    if of_positions > 0 {
        for id in positions {
            module.decorate(id, Decoration::Invariant, []);
        }
    }
    of_positions < precise.len()
}
