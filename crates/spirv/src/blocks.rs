//! Control flow between the blocks of a function, and removal of unreachable blocks.

use std::collections::{HashMap, HashSet};

use rspirv::dr::{Block, Builder, Function, Instruction, Operand};
use rspirv::spirv::{Op, Word};

use crate::words::ids;

/// The first instruction of a kind in a block.
pub(super) fn find(block: &Block, op: Op) -> Option<&Instruction> {
    block.instructions.iter().find(|i| i.class.opcode == op)
}

pub(super) fn phis(block: &mut Block) -> impl Iterator<Item = &mut Instruction> {
    let all = block.instructions.iter_mut();
    all.filter(|i| i.class.opcode == Op::Phi)
}

pub(super) fn branch(to: Word) -> Instruction {
    Instruction::new(Op::Branch, None, None, vec![Operand::IdRef(to)])
}

fn is_branch(i: &Instruction) -> bool {
    let op = i.class.opcode;
    matches!(op, Op::Branch | Op::BranchConditional | Op::Switch)
}

/// Index of a branch's first target among its ids.
fn first_target(i: &Instruction) -> usize {
    usize::from(i.class.opcode != Op::Branch)
}

/// The labels of a block's successors.
pub(super) fn targets(block: &Block) -> impl Iterator<Item = Word> {
    let last = block.instructions.last().filter(|i| is_branch(i));
    last.into_iter().flat_map(|i| ids(i).skip(first_target(i)))
}

/// Replaces a target of a block's last instruction.
pub(super) fn retarget(block: &mut Block, from: Word, to: Word) {
    let Some(last) = block.instructions.last_mut().filter(|i| is_branch(i)) else {
        return;
    };
    let first = first_target(last);
    let targets = last.operands.iter_mut().filter_map(Operand::id_ref_any_mut);
    for id in targets.skip(first).filter(|id| **id == from) {
        *id = to;
    }
}

/// The header of the loop that a block ends.
pub(super) struct LoopEnd {
    pub(super) header: Word,
    pub(super) is_merge: bool,
}

/// The merge and continue blocks of all loops.
pub(super) fn loop_ends(blocks: &[Block]) -> HashMap<Word, LoopEnd> {
    let mut all = HashMap::new();
    for block in blocks {
        if let (Some(merge), Some(header)) = (find(block, Op::LoopMerge), block.label_id()) {
            let ends = ids(merge).zip([true, false]);
            all.extend(ends.map(|(label, is_merge)| (label, LoopEnd { header, is_merge })));
        }
    }
    all
}

/// Drops unreachable blocks, which naga's reader would execute with the first blocks of the
/// function.
pub(super) fn drop_unreachable(module: &mut Builder) {
    let mut functions = std::mem::take(&mut module.module_mut().functions);
    for function in &mut functions {
        drop_in(module, function);
    }
    module.module_mut().functions = functions;
}

fn drop_in(module: &mut Builder, function: &mut Function) {
    let blocks = function.blocks.iter();
    let by_label: HashMap<Word, &Block> = blocks.filter_map(|b| Some((b.label_id()?, b))).collect();
    let mut reached = HashSet::new();
    let mut open: Vec<Word> = function
        .blocks
        .first()
        .and_then(Block::label_id)
        .into_iter()
        .collect();
    while let Some(label) = open.pop() {
        if reached.insert(label) {
            open.extend(by_label.get(&label).into_iter().flat_map(|b| targets(b)));
        }
    }
    // The merge and continue blocks of a header have to exist.
    let mut named: HashMap<Word, Instruction> = HashMap::new();
    for (label, block) in by_label.iter().filter(|(label, _)| reached.contains(label)) {
        let merges = find(block, Op::LoopMerge).or_else(|| find(block, Op::SelectionMerge));
        let unreachable = Instruction::new(Op::Unreachable, None, None, Vec::new());
        let mut all = merges.into_iter().flat_map(ids);
        named.extend(all.next().map(|merge| (merge, unreachable)));
        named.extend(all.next().map(|continues| (continues, branch(*label))));
    }
    if reached.len() == by_label.len() {
        return;
    }
    let is_reached = |label: Option<Word>| label.is_some_and(|label| reached.contains(&label));
    function.blocks.retain_mut(|block| {
        let label = block.label_id();
        if is_reached(label) {
            return true;
        }
        let ends = label.and_then(|label| named.get(&label));
        block.instructions = ends.into_iter().cloned().collect();
        ends.is_some()
    });
    let null = |module: &mut Builder, ty| Operand::IdRef(module.constant_null(ty));
    for block in &mut function.blocks {
        for phi in phis(block) {
            let Some(ty) = phi.result_type else { continue };
            let pairs = std::mem::take(&mut phi.operands);
            for pair in pairs.chunks(2) {
                let from = pair.last().and_then(Operand::id_ref_any);
                match from {
                    _ if is_reached(from) => phi.operands.extend_from_slice(pair),
                    Some(label) if named.contains_key(&label) => {
                        phi.operands
                            .extend([null(module, ty), Operand::IdRef(label)]);
                    }
                    _ => {}
                }
            }
        }
    }
}
