//! Gives a `default` that falls through, or that a case falls into, a place among the cases: naga's
//! reader puts `default` last.
//!
//! ```text
//! OpSwitch %x %default 1 %one 2 %two      %known = %x == 1 || %x == 2
//!                                         %y = OpSelect %known %x 3
//!                                         OpSwitch %y %merge 1 %one 3 %default 2 %two
//! ```

use std::collections::{HashMap, HashSet};

use rspirv::dr::{Block, Builder, Function, Instruction, Operand};
use rspirv::spirv::{Op, Word};

use crate::words::{ids, literal, push};

/// Changes all such switches.
pub(super) fn order(module: &mut Builder) {
    let values: HashMap<Word, Word> = module
        .module_ref()
        .all_inst_iter()
        .filter_map(|i| Some((i.result_id?, i.result_type?)))
        .collect();
    let mut functions = std::mem::take(&mut module.module_mut().functions);
    for function in &mut functions {
        for found in find(function) {
            change(module, function, &found, &values);
        }
    }
    module.module_mut().functions = functions;
}

/// A `default` that needs a place.
struct Found {
    /// Index of the block of the switch.
    block: usize,
    merge: Word,
    /// The literals of the other cases and their targets, with the default among them.
    cases: Vec<(Option<u32>, Word)>,
}

fn find(function: &Function) -> Vec<Found> {
    let blocks = function.blocks.iter();
    let blocks: HashMap<Word, &Block> = blocks.filter_map(|b| Some((b.label_id()?, b))).collect();
    let mut before: HashMap<Word, Vec<Word>> = HashMap::new();
    for label in blocks.keys() {
        for target in next(&blocks, *label) {
            before.entry(target).or_default().push(*label);
        }
    }
    let mut found = Vec::new();
    for (index, block) in function.blocks.iter().enumerate() {
        let (Some(switch), Some(own)) = (block.instructions.last(), block.label_id()) else {
            continue;
        };
        if switch.class.opcode != Op::Switch {
            continue;
        }
        let mut merges = block.instructions.iter();
        let merge = merges.find(|i| i.class.opcode == Op::SelectionMerge);
        let Some(merge) = merge.and_then(|i| ids(i).next()) else {
            continue;
        };
        let Some(default) = ids(switch).nth(1).filter(|d| *d != merge) else {
            continue;
        };
        // The default takes all literals that have its label.
        let literals = switch.operands.iter().filter_map(literal);
        let cases = literals.zip(ids(switch).skip(2));
        let mut cases: Vec<(Option<u32>, Word)> = cases
            .filter(|(_, label)| *label != default)
            .map(|(n, label)| (Some(n), label))
            .collect();
        let stop = [own, merge];
        let leads = closure(default, &stop, |label| {
            before.get(&label).cloned().unwrap_or_default()
        });
        let from = cases.iter().rposition(|(_, label)| leads.contains(label));
        let reached = closure(default, &stop, |label| next(&blocks, label).collect());
        let to = cases.iter().position(|(_, label)| reached.contains(label));
        // If only the last case falls into it, it stays last.
        let is_last = from.is_none_or(|from| {
            let (_, label) = cases[from];
            cases[from..].iter().all(|(_, of)| *of == label)
        });
        if to.is_none() && is_last {
            continue;
        }
        let at = to.or(from.map(|from| from + 1)).unwrap_or(cases.len());
        cases.insert(at, (None, default));
        found.push(Found {
            block: index,
            merge,
            cases,
        });
    }
    found
}

/// The labels that a block leads to.
fn next<'a>(
    blocks: &'a HashMap<Word, &Block>,
    label: Word,
) -> impl Iterator<Item = Word> + use<'a> {
    let last = blocks.get(&label).and_then(|b| b.instructions.last());
    let targets = last.into_iter().flat_map(ids);
    targets.filter(|id| blocks.contains_key(id))
}

/// A block and all that come next, but none behind `stop`.
fn closure(from: Word, stop: &[Word], next: impl Fn(Word) -> Vec<Word>) -> HashSet<Word> {
    let mut found = HashSet::new();
    let mut open = vec![from];
    while let Some(label) = open.pop() {
        if !stop.contains(&label) && found.insert(label) {
            open.extend(next(label));
        }
    }
    found
}

fn change(
    module: &mut Builder,
    function: &mut Function,
    found: &Found,
    values: &HashMap<Word, Word>,
) {
    let block = &mut function.blocks[found.block];
    let (Some(own), Some(mut switch)) = (block.label_id(), block.instructions.pop()) else {
        return;
    };
    let selector = ids(&switch).next().unwrap_or_default();
    let Some(ty) = values.get(&selector).copied() else {
        block.instructions.push(switch);
        return;
    };
    let merges = |i: &Instruction| i.class.opcode == Op::SelectionMerge;
    let at = block.instructions.iter().position(merges).unwrap_or(0);
    let rest = block.instructions.split_off(at);
    let literals: Vec<u32> = found.cases.iter().filter_map(|(n, _)| *n).collect();
    let unused = (0..).find(|n| !literals.contains(n)).unwrap_or_default();
    let bool = module.type_bool();
    let mut known = module.constant_false(bool);
    for n in &literals {
        let constant = module.constant_bit32(ty, *n);
        let operands = [selector, constant].map(Operand::IdRef);
        let is = push(
            module,
            &mut block.instructions,
            (Op::IEqual, bool),
            operands,
        );
        let operands = [known, is].map(Operand::IdRef);
        known = push(
            module,
            &mut block.instructions,
            (Op::LogicalOr, bool),
            operands,
        );
    }
    let other = module.constant_bit32(ty, unused);
    let operands = [known, selector, other].map(Operand::IdRef);
    let chosen = push(module, &mut block.instructions, (Op::Select, ty), operands);
    block.instructions.extend(rest);
    switch.operands = [chosen, found.merge].map(Operand::IdRef).to_vec();
    for (n, label) in &found.cases {
        let n = Operand::LiteralBit32(n.unwrap_or(unused));
        switch.operands.extend([n, Operand::IdRef(*label)]);
    }
    block.instructions.push(switch);
    // The merge follows the switch now, though control never takes this way.
    let is_merge = |b: &&mut Block| b.label_id() == Some(found.merge);
    let Some(merge) = function.blocks.iter_mut().find(is_merge) else {
        return;
    };
    for phi in &mut merge.instructions {
        if phi.class.opcode == Op::Phi
            && let Some(ty) = phi.result_type
        {
            let null = module.constant_null(ty);
            phi.operands.extend([null, own].map(Operand::IdRef));
        }
    }
}
