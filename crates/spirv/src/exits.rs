//! Lets control leave a switch by its merge block alone: naga's reader takes a branch to the merge
//! block of the loop around a switch for one that leaves the switch only, and forgets a `default`
//! that leaves the loop.
//!
//! ```text
//! %h = OpSelectionMerge %m            %h = OpSelectionMerge %gathered
//!      OpSwitch %x %m 1 %loop_merge        OpSwitch %x %gathered 1 %leaf
//!                                     %leaf = OpBranch %gathered
//!                                     %gathered = %leaves = OpPhi %bool %true %leaf %false %h
//!                                          OpSelectionMerge %stays
//!                                          OpBranchConditional %leaves %loop_merge %stays
//!                                     %stays = OpBranch %m
//! ```

use std::collections::{BTreeSet, HashMap, HashSet};

use rspirv::dr::{Block, Builder, Instruction, Operand};
use rspirv::spirv::{Op, SelectionControl, Word};

use super::blocks::{LoopEnd, branch, find, loop_ends, phis, retarget, targets};
use super::body::Body;
use crate::words::{ids, push};

/// Changes all such switches of a module.
pub(super) fn gather(module: &mut Builder) {
    let mut functions = std::mem::take(&mut module.module_mut().functions);
    for function in &mut functions {
        let switches = function
            .blocks
            .iter()
            .filter(|b| find(b, Op::Switch).is_some());
        let switches: Vec<Word> = switches.filter_map(Block::label_id).collect();
        if switches.is_empty() {
            continue;
        }
        let blocks = std::mem::take(&mut function.blocks);
        let mut flow = Flow {
            module,
            loops: loop_ends(&blocks),
            body: Body::new(blocks),
            bools: None,
        };
        // In this order, inner switches come after outer ones.
        for header in switches.into_iter().rev() {
            flow.change(header);
        }
        function.blocks = flow.body.into_blocks();
    }
    module.module_mut().functions = functions;
}

/// The blocks between a switch and its merge block.
struct Inside {
    header: Word,
    merge: Word,
    labels: BTreeSet<Word>,
    /// Labels of successors outside, without the switch's merge block: the merge and continue
    /// blocks of the surrounding loop.
    out: BTreeSet<Word>,
}

struct Flow<'a> {
    module: &'a mut Builder,
    body: Body,
    loops: HashMap<Word, LoopEnd>,
    /// The boolean type, `true` and `false`.
    bools: Option<[Word; 3]>,
}

impl Flow<'_> {
    fn change(&mut self, header: Word) -> Option<()> {
        let header = self.alone(header)?;
        let inside = self.inside(header)?;
        // A target outside gets an intermediate block inside.
        let entered: BTreeSet<Word> = targets(self.body.get(header)?).collect();
        for to in entered.intersection(&inside.out) {
            self.split((header, *to));
        }
        self.part_falls(&inside);
        let inside = self.inside(header)?;
        let is_merge = |label: &&Word| self.loops.get(label).is_some_and(|end| end.is_merge);
        let left = inside.out.iter().find(is_merge).copied();
        let is_continue = self.loops.contains_key(&inside.merge);
        let Some(left) = left else {
            if is_continue {
                self.gathered(&inside, &[]);
            }
            return Some(());
        };
        let mut leaves = Vec::new();
        for label in self.leading_to(&inside, left) {
            let is_only = find(self.body.get(label)?, Op::Branch).is_some();
            leaves.push(match is_only {
                true => label,
                false => self.split((label, left))?,
            });
        }
        let (gathered, stays) = self.gathered(&inside, &leaves)?;
        self.leave(left, (gathered, stays), &leaves)
    }

    /// Inserts a block for each conditional branch into the next case. naga's reader would
    /// otherwise read that case as a part of the branch.
    fn part_falls(&mut self, inside: &Inside) {
        let cases = self.body.get(inside.header).into_iter().flat_map(targets);
        let cases: BTreeSet<Word> = cases.collect();
        for case in cases.intersection(&inside.labels) {
            for label in self.leading_to(inside, *case) {
                let block = self.body.get(label);
                if block.is_some_and(|b| find(b, Op::BranchConditional).is_some()) {
                    self.split((label, *case));
                }
            }
        }
    }

    /// Gives a switch its own block and a merge block, unless it has one. Returns the block's
    /// label.
    fn alone(&mut self, header: Word) -> Option<Word> {
        let block = self.body.get(header)?;
        if find(block, Op::SelectionMerge).is_some() {
            return Some(header);
        }
        let successors: BTreeSet<Word> = targets(block).collect();
        let [own, merge] = [self.module.id(), self.module.id()];
        let mut switch = self.body.edit(header, |block| {
            let mut switch = vec![block.instructions.pop()?];
            let is_line = |i: &Instruction| i.class.opcode == Op::Line;
            if block.instructions.last().is_some_and(is_line) {
                switch.insert(0, block.instructions.pop()?);
            }
            block.instructions.push(branch(own));
            Some(switch)
        })??;
        let operands = vec![
            Operand::IdRef(merge),
            Operand::SelectionControl(SelectionControl::NONE),
        ];
        switch.insert(
            0,
            Instruction::new(Op::SelectionMerge, None, None, operands),
        );
        let unreachable = Instruction::new(Op::Unreachable, None, None, Vec::new());
        for label in successors {
            self.rename_predecessor(label, (header, own));
        }
        self.body.insert_after(header, own, switch);
        self.body.insert_after(own, merge, vec![unreachable]);
        Some(own)
    }

    /// Replaces a predecessor in a block's phis.
    fn rename_predecessor(&mut self, block: Word, (from, to): (Word, Word)) {
        self.body.edit(block, |block| {
            for phi in phis(block) {
                for operand in phi.operands.iter_mut().skip(1).step_by(2) {
                    if *operand == Operand::IdRef(from) {
                        *operand = Operand::IdRef(to);
                    }
                }
            }
        });
    }

    /// Inserts a block on an edge, and returns its label.
    fn split(&mut self, (from, to): (Word, Word)) -> Option<Word> {
        let between = self.module.id();
        self.body.edit(from, |block| retarget(block, to, between))?;
        self.body.insert_after(from, between, vec![branch(to)]);
        self.rename_predecessor(to, (from, between));
        Some(between)
    }

    fn inside(&self, header: Word) -> Option<Inside> {
        let block = self.body.get(header)?;
        let merge = ids(find(block, Op::SelectionMerge)?).next()?;
        let mut labels = BTreeSet::new();
        let mut out = BTreeSet::new();
        let mut open: Vec<Word> = targets(block).collect();
        while let Some(label) = open.pop() {
            if label == merge || label == header || labels.contains(&label) {
                continue;
            }
            // Every path to the end of an inner loop goes through its header.
            let end = self.loops.get(&label);
            if end.is_some_and(|end| !labels.contains(&end.header)) {
                out.insert(label);
                continue;
            }
            labels.insert(label);
            open.extend(self.body.get(label).into_iter().flat_map(targets));
        }
        Some(Inside {
            header,
            merge,
            labels,
            out,
        })
    }

    /// The predecessors of a block: the header, and blocks inside.
    fn leading_to(&self, inside: &Inside, to: Word) -> Vec<Word> {
        let before = self.body.before(to);
        // Iterates over the smaller set. Either may be as large as the function: a case has few
        // predecessors, but a loop's end has some in every switch.
        let leading: Vec<Word> = match before.len() < inside.labels.len() {
            true => before
                .iter()
                .filter(|l| inside.labels.contains(l))
                .copied()
                .collect(),
            false => inside
                .labels
                .iter()
                .filter(|l| before.contains(l))
                .copied()
                .collect(),
        };
        let header = before.contains(&inside.header).then_some(inside.header);
        header.into_iter().chain(leading).collect()
    }

    /// Inserts two blocks before the merge block of a switch. The first is the new merge block,
    /// which the `leaves` branch to as well. It branches to the second. Returns both.
    fn gathered(&mut self, inside: &Inside, leaves: &[Word]) -> Option<(Word, Word)> {
        let [gathered, stays] = [self.module.id(), self.module.id()];
        let before = self.leading_to(inside, inside.merge);
        for label in &before {
            self.body
                .edit(*label, |block| retarget(block, inside.merge, gathered))?;
        }
        self.body.edit(inside.header, |block| {
            let merges = |i: &&mut Instruction| i.class.opcode == Op::SelectionMerge;
            if let Some(merge) = block.instructions.iter_mut().find(merges) {
                merge.operands[0] = Operand::IdRef(gathered);
            }
        });
        let module = &mut *self.module;
        let mut first = self.body.edit(inside.merge, |block| {
            let mut first = Vec::new();
            for phi in phis(block) {
                let ty = phi.result_type?;
                let (mut inner, outer) = parted(phi, &before);
                let null = module.constant_null(ty);
                inner.extend(
                    leaves
                        .iter()
                        .flat_map(|leaf| [null, *leaf].map(Operand::IdRef)),
                );
                let value = match inner.is_empty() {
                    true => null,
                    false => push(module, &mut first, (Op::Phi, ty), inner),
                };
                phi.operands = outer;
                if !before.is_empty() {
                    phi.operands.extend([value, stays].map(Operand::IdRef));
                }
            }
            Some(first)
        })??;
        first.push(branch(stays));
        self.body.insert_before(inside.merge, gathered, first);
        if !before.is_empty() {
            self.body
                .insert_after(gathered, stays, vec![branch(inside.merge)]);
        }
        Some((gathered, stays))
    }

    /// Routes `leaves`, which branch to the block `left`, through the merge block of their switch.
    fn leave(
        &mut self,
        left: Word,
        (gathered, stays): (Word, Word),
        leaves: &[Word],
    ) -> Option<()> {
        let before: Vec<Word> = self.body.before(gathered).iter().copied().collect();
        for leaf in leaves {
            self.body
                .edit(*leaf, |block| retarget(block, left, gathered))?;
        }
        let module = &mut *self.module;
        let mut first = self.body.edit(left, |block| {
            let mut first = Vec::new();
            for phi in phis(block) {
                let ty = phi.result_type?;
                let (mut inner, outer) = parted(phi, leaves);
                let null = module.constant_null(ty);
                inner.extend(
                    before
                        .iter()
                        .flat_map(|label| [null, *label].map(Operand::IdRef)),
                );
                let value = push(module, &mut first, (Op::Phi, ty), inner);
                phi.operands = outer;
                phi.operands.extend([value, gathered].map(Operand::IdRef));
            }
            Some(first)
        })??;
        let is_only = before.is_empty();
        if !is_only {
            let module = &mut *self.module;
            let [bool, yes, no] = *self.bools.get_or_insert_with(|| {
                let bool = module.type_bool();
                [
                    bool,
                    module.constant_true(bool),
                    module.constant_false(bool),
                ]
            });
            let yes = leaves.iter().map(|leaf| [yes, *leaf]);
            let no = before.iter().map(|label| [no, *label]);
            let pairs = yes.chain(no).flatten().map(Operand::IdRef);
            let flag = push(self.module, &mut first, (Op::Phi, bool), pairs);
            let merge = vec![
                Operand::IdRef(stays),
                Operand::SelectionControl(SelectionControl::NONE),
            ];
            let operands = [flag, left, stays].map(Operand::IdRef).to_vec();
            first.push(Instruction::new(Op::SelectionMerge, None, None, merge));
            first.push(Instruction::new(
                Op::BranchConditional,
                None,
                None,
                operands,
            ));
        } else {
            first.push(branch(left));
        }
        self.body.edit(gathered, |block| {
            block.instructions.pop();
            block.instructions.extend(first);
        })
    }
}

/// Removes the pairs of a phi that come from some blocks. Returns them, and the others.
fn parted(phi: &mut Instruction, from: &[Word]) -> (Vec<Operand>, Vec<Operand>) {
    let from: HashSet<Word> = from.iter().copied().collect();
    let pairs = std::mem::take(&mut phi.operands);
    let comes_from = |pair: &&[Operand]| {
        let label = pair.last().and_then(Operand::id_ref_any);
        label.is_some_and(|label| from.contains(&label))
    };
    let (inner, outer): (Vec<_>, Vec<_>) = pairs.chunks(2).partition(comes_from);
    (inner.concat(), outer.concat())
}

#[cfg(test)]
mod tests {
    use super::*;

    const ENTRY: Word = 1;
    const HEADER: Word = 2;
    const CONTINUE: Word = 3;
    const MERGE: Word = 4;

    fn block(label: Word, instructions: Vec<Instruction>) -> Block {
        let label = Some(Instruction::new(Op::Label, None, Some(label), Vec::new()));
        Block {
            label,
            instructions,
        }
    }

    fn instruction(op: Op, ids: &[Word]) -> Instruction {
        let operands = ids.iter().copied().map(Operand::IdRef).collect();
        Instruction::new(op, None, None, operands)
    }

    /// A loop of switches, each with a case that leaves the loop. A quadratic algorithm would not
    /// finish.
    #[test]
    fn many_switches_are_gathered() {
        let many: Word = 20_000;
        let label = |n: Word| 10 + n;
        let mut blocks = vec![
            block(ENTRY, vec![branch(HEADER)]),
            block(
                HEADER,
                vec![
                    instruction(Op::LoopMerge, &[MERGE, CONTINUE]),
                    branch(label(0)),
                ],
            ),
        ];
        blocks.extend((0..many).map(|n| {
            let next = label(n + 1);
            let mut switch = instruction(Op::Switch, &[5, next]);
            let case = [Operand::LiteralBit32(1), Operand::IdRef(MERGE)];
            switch.operands.extend(case);
            let merge = instruction(Op::SelectionMerge, &[next]);
            block(label(n), vec![merge, switch])
        }));
        blocks.push(block(label(many), vec![branch(CONTINUE)]));
        blocks.push(block(CONTINUE, vec![branch(HEADER)]));
        blocks.push(block(MERGE, vec![instruction(Op::Return, &[])]));
        let mut module = rspirv::dr::Module::new();
        let mut function = rspirv::dr::Function::new();
        function.blocks = blocks;
        module.functions.push(function);
        module.header = Some(rspirv::dr::ModuleHeader::new(label(many) + 1));
        let mut builder = Builder::new_from_module(module);
        gather(&mut builder);
        let module = builder.module();
        let blocks = &module.functions[0].blocks;
        let leading: Vec<&Block> = blocks
            .iter()
            .filter(|b| targets(b).any(|to| to == MERGE))
            .collect();
        assert_eq!(leading.len(), many as usize);
        let leaves = |b: &&Block| find(b, Op::BranchConditional).is_some();
        assert!(leading.iter().all(leaves));
        // Each switch has a leaf and two blocks after it, in order.
        assert_eq!(blocks.len(), 5 + 4 * many as usize);
        let labels: Vec<Word> = blocks.iter().filter_map(Block::label_id).collect();
        let of_switches = labels
            .iter()
            .filter(|l| (label(0)..=label(many)).contains(l));
        assert!(of_switches.is_sorted());
    }
}
