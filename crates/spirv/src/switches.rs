//! Orders the cases of switches: naga's reader takes a case to fall into the next one of its list,
//! and puts `default` last. A `default` that falls through gets a literal, and so a place among the
//! cases; literals that have the default's label are dropped.
//!
//! ```text
//! OpSwitch %x %default 1 %one 2 %two      %known = %x == 1 || %x == 2
//!                                         %y = OpSelect %known %x 3
//!                                         OpSwitch %y %merge 1 %one 3 %default 2 %two
//! ```

use std::collections::{HashMap, HashSet};

use rspirv::dr::{Block, Builder, Function, Instruction, Operand};
use rspirv::spirv::{Op, Word};

use super::blocks;
use crate::words::{ids, literal, push};

/// Changes all switches of a module that need it.
pub(super) fn order(module: &mut Builder) {
    let values: HashMap<Word, Word> = module
        .module_ref()
        .all_inst_iter()
        .filter_map(|i| Some((i.result_id?, i.result_type?)))
        .collect();
    let mut functions = std::mem::take(&mut module.module_mut().functions);
    for function in &mut functions {
        let all = find(function);
        let needs_bool = all.iter().any(|found| found.needs_place);
        let bool = needs_bool.then(|| module.type_bool());
        for found in all {
            change(module, function, &found, (&values, bool));
        }
    }
    module.module_mut().functions = functions;
}

/// A switch with its new order of cases.
struct ReorderedSwitch {
    /// Index of the switch's block.
    block: usize,
    merge: Word,
    /// Index of the merge block.
    merge_block: Option<usize>,
    /// Literals and targets of the cases, each before the case that it falls through into. Includes
    /// `default` if it needs a literal.
    cases: Vec<(Option<u32>, Word)>,
    needs_place: bool,
}

/// The blocks of a function.
struct Flow<'f> {
    blocks: &'f [Block],
    /// Index of each block by label.
    labels: HashMap<Word, usize>,
    loops: HashMap<Word, blocks::LoopEnd>,
}

impl Flow<'_> {
    fn targets(&self, label: Word) -> impl Iterator<Item = Word> {
        let block = self.labels.get(&label).and_then(|at| self.blocks.get(*at));
        block.into_iter().flat_map(blocks::targets)
    }
}

fn find(function: &Function) -> Vec<ReorderedSwitch> {
    let blocks = &function.blocks;
    let labels = blocks.iter().enumerate();
    let labels = labels.filter_map(|(at, b)| Some((b.label_id()?, at)));
    let flow = Flow {
        blocks,
        labels: labels.collect(),
        loops: blocks::loop_ends(blocks),
    };
    let mut found = Vec::new();
    for (index, block) in function.blocks.iter().enumerate() {
        let switch = blocks::find(block, Op::Switch);
        let merge = blocks::find(block, Op::SelectionMerge).and_then(|i| ids(i).next());
        if let (Some(switch), Some(merge), Some(own)) = (switch, merge, block.label_id()) {
            found.extend(ReorderedSwitch::of(index, switch, &flow, [own, merge]));
        }
    }
    found
}

impl ReorderedSwitch {
    fn of(
        block: usize,
        switch: &Instruction,
        flow: &Flow<'_>,
        [own, merge]: [Word; 2],
    ) -> Option<Self> {
        let default = ids(switch).nth(1)?;
        let given = switch.operands.iter().filter_map(literal);
        let given: Vec<(u32, Word)> = given.zip(ids(switch).skip(2)).collect();
        // `default` also covers literals with its label.
        let others = given.iter().filter(|(_, label)| *label != default);
        let mut cases: Vec<Word> = others.map(|(_, label)| *label).collect();
        let mut seen = HashSet::new();
        cases.retain(|label| seen.insert(*label));
        let entered: Vec<Word> = cases.iter().copied().chain([default]).collect();
        let is_entered: HashSet<Word> = entered.iter().copied().collect();
        let falls = |from: Word| -> Option<Word> {
            let mut seen = HashSet::from([own, merge]);
            let mut open = vec![from];
            while let Some(label) = open.pop() {
                if label != from && is_entered.contains(&label) && label != merge {
                    return Some(label);
                }
                // The end of a surrounding loop leads to a case only through the switch again.
                let end = flow.loops.get(&label);
                let is_around = end.is_some_and(|end| !seen.contains(&end.header));
                if !is_around && seen.insert(label) {
                    open.extend(flow.targets(label));
                }
            }
            None
        };
        let next: HashMap<Word, Word> = entered
            .iter()
            .filter_map(|l| Some((*l, falls(*l)?)))
            .collect();
        let fallen_into: HashSet<Word> = next.values().copied().collect();
        let is_first = |label: &&Word| !fallen_into.contains(*label);
        let mut order = Vec::new();
        let mut last = Vec::new();
        for first in entered.iter().filter(is_first) {
            // Each label falls through into at most one other.
            let steps = std::iter::successors(Some(*first), |label| next.get(label).copied());
            let chain: Vec<Word> = steps.take(entered.len()).collect();
            match chain.last() == Some(&default) {
                true => last = chain,
                false => order.extend(chain),
            }
        }
        order.extend(last);
        let needs_place = next.contains_key(&default);
        if !needs_place {
            order.retain(|label| *label != default);
        }
        let mut by_label: HashMap<Word, Vec<u32>> = HashMap::new();
        for (n, label) in &given {
            by_label.entry(*label).or_default().push(*n);
        }
        let literals = |label: Word| -> Vec<(Option<u32>, Word)> {
            let own = by_label.get(&label).into_iter().flatten();
            match label == default {
                true => vec![(None, label)],
                false => own.map(|n| (Some(*n), label)).collect(),
            }
        };
        let cases: Vec<_> = order.into_iter().flat_map(literals).collect();
        let is_same = given
            .iter()
            .map(|(n, label)| (Some(*n), *label))
            .eq(cases.iter().copied());
        (!is_same).then_some(Self {
            block,
            merge,
            merge_block: flow.labels.get(&merge).copied(),
            cases,
            needs_place,
        })
    }
}

fn change(
    module: &mut Builder,
    function: &mut Function,
    found: &ReorderedSwitch,
    (values, bool): (&HashMap<Word, Word>, Option<Word>),
) {
    let block = &mut function.blocks[found.block];
    let (Some(own), Some(mut switch)) = (block.label_id(), block.instructions.pop()) else {
        return;
    };
    if !found.needs_place {
        switch.operands.truncate(2);
        for (n, label) in &found.cases {
            let n = Operand::LiteralBit32(n.unwrap_or_default());
            switch.operands.extend([n, Operand::IdRef(*label)]);
        }
        block.instructions.push(switch);
        return;
    }
    let selector = ids(&switch).next().unwrap_or_default();
    let (Some(ty), Some(bool)) = (values.get(&selector).copied(), bool) else {
        block.instructions.push(switch);
        return;
    };
    let merges = |i: &Instruction| i.class.opcode == Op::SelectionMerge;
    let at = block.instructions.iter().position(merges).unwrap_or(0);
    let rest = block.instructions.split_off(at);
    let literals: Vec<u32> = found.cases.iter().filter_map(|(n, _)| *n).collect();
    let taken: HashSet<u32> = literals.iter().copied().collect();
    let unused = (0..).find(|n| !taken.contains(n)).unwrap_or_default();
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
    // The merge block follows the switch now, though this path is never taken.
    let merge = found.merge_block;
    let Some(merge) = merge.and_then(|at| function.blocks.get_mut(at)) else {
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
