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

use std::collections::{HashMap, HashSet};

use rspirv::dr::{Block, Builder, Function, Instruction, Operand};
use rspirv::spirv::{Op, SelectionControl, Word};

use super::blocks::{branch, find, phis, retarget, targets};
use crate::words::{ids, push};

/// Changes all such switches.
pub(super) fn gather(module: &mut Builder) {
    let mut functions = std::mem::take(&mut module.module_mut().functions);
    for function in &mut functions {
        let switches = function
            .blocks
            .iter()
            .filter(|b| find(b, Op::Switch).is_some());
        let switches: Vec<Word> = switches.filter_map(Block::label_id).collect();
        let mut flow = Flow { module, function };
        // Inner switches come behind the outer ones.
        for header in switches.into_iter().rev() {
            flow.change(header);
        }
    }
    module.module_mut().functions = functions;
}

/// The blocks between a switch and its merge block.
struct Inside {
    header: Word,
    merge: Word,
    labels: HashSet<Word>,
    /// The labels outside that blocks inside lead to, but for the merge block: the merge and the
    /// continue block of the loop around.
    out: HashSet<Word>,
}

struct Flow<'a> {
    module: &'a mut Builder,
    function: &'a mut Function,
}

impl Flow<'_> {
    fn index(&self, label: Word) -> Option<usize> {
        let mut blocks = self.function.blocks.iter();
        blocks.position(|b| b.label_id() == Some(label))
    }

    fn block(&mut self, label: Word) -> Option<&mut Block> {
        let index = self.index(label)?;
        self.function.blocks.get_mut(index)
    }

    /// The merge and the continue blocks of all loops, with their headers.
    fn loops(&self) -> HashMap<Word, Word> {
        let mut all = HashMap::new();
        for block in &self.function.blocks {
            if let (Some(merge), Some(own)) = (find(block, Op::LoopMerge), block.label_id()) {
                all.extend(ids(merge).map(|label| (label, own)));
            }
        }
        all
    }

    fn change(&mut self, header: Word) -> Option<()> {
        let header = self.alone(header)?;
        let inside = self.inside(header)?;
        let loops = self.loops();
        // A case, or the `default`, that is outside gets a block inside.
        let block = self.block(header)?;
        for to in targets(block).collect::<HashSet<_>>() {
            if inside.out.contains(&to) {
                self.split((header, to));
            }
        }
        self.part_falls(&inside);
        let inside = self.inside(header)?;
        let is_merge = |label: &&Word| {
            let loop_header = loops.get(label).and_then(|h| self.index(*h));
            let merge = loop_header.and_then(|at| find(&self.function.blocks[at], Op::LoopMerge));
            merge.and_then(|i| ids(i).next()) == Some(**label)
        };
        let left = inside.out.iter().find(is_merge).copied();
        let is_continue = loops.contains_key(&inside.merge);
        let Some(left) = left else {
            if is_continue {
                self.gathered(&inside, &[]);
            }
            return Some(());
        };
        let mut leaves = Vec::new();
        for label in self.leading_to(&inside, left) {
            let block = self.block(label)?;
            let is_only = find(block, Op::Branch).is_some();
            leaves.push(match is_only {
                true => label,
                false => self.split((label, left))?,
            });
        }
        let (gathered, stays) = self.gathered(&inside, &leaves)?;
        self.leave(left, (gathered, stays), &leaves)
    }

    /// Gives each conditional branch into the next case a block: naga's reader would read that case as
    /// a part of the branch.
    fn part_falls(&mut self, inside: &Inside) {
        let header = self.index(inside.header);
        let cases = header.map(|at| targets(&self.function.blocks[at]).collect::<HashSet<_>>());
        for case in cases.into_iter().flatten() {
            let is_inside = inside.labels.contains(&case);
            for label in self
                .leading_to(inside, case)
                .into_iter()
                .filter(|_| is_inside)
            {
                let block = self.block(label);
                if block.is_some_and(|b| find(b, Op::BranchConditional).is_some()) {
                    self.split((label, case));
                }
            }
        }
    }

    /// Gives a switch a block of its own and a merge block. Returns the block's label.
    fn alone(&mut self, header: Word) -> Option<Word> {
        let at = self.index(header)?;
        if find(&self.function.blocks[at], Op::SelectionMerge).is_some() {
            return Some(header);
        }
        let [own, merge] = [self.module.id(), self.module.id()];
        let block = &mut self.function.blocks[at];
        let mut switch = vec![block.instructions.pop()?];
        if block
            .instructions
            .last()
            .is_some_and(|i| i.class.opcode == Op::Line)
        {
            switch.insert(0, block.instructions.pop()?);
        }
        let operands = vec![
            Operand::IdRef(merge),
            Operand::SelectionControl(SelectionControl::NONE),
        ];
        switch.insert(
            0,
            Instruction::new(Op::SelectionMerge, None, None, operands),
        );
        block.instructions.push(branch(own));
        let unreachable = Instruction::new(Op::Unreachable, None, None, Vec::new());
        self.rename_predecessor(header, own);
        self.insert(at + 1, own, switch);
        self.insert(at + 2, merge, vec![unreachable]);
        Some(own)
    }

    fn insert(&mut self, at: usize, label: Word, instructions: Vec<Instruction>) {
        let label = Some(Instruction::new(Op::Label, None, Some(label), Vec::new()));
        let block = Block {
            label,
            instructions,
        };
        self.function.blocks.insert(at, block);
    }

    fn rename_predecessor(&mut self, from: Word, to: Word) {
        for phi in self.function.blocks.iter_mut().flat_map(phis) {
            for operand in phi.operands.iter_mut().skip(1).step_by(2) {
                if *operand == Operand::IdRef(from) {
                    *operand = Operand::IdRef(to);
                }
            }
        }
    }

    /// Puts a block between two, and returns its label.
    fn split(&mut self, (from, to): (Word, Word)) -> Option<Word> {
        let between = self.module.id();
        let at = self.index(from)?;
        retarget(&mut self.function.blocks[at], to, between);
        self.insert(at + 1, between, vec![branch(to)]);
        for phi in phis(self.block(to)?) {
            for operand in phi.operands.iter_mut().skip(1).step_by(2) {
                if *operand == Operand::IdRef(from) {
                    *operand = Operand::IdRef(between);
                }
            }
        }
        Some(between)
    }

    fn inside(&self, header: Word) -> Option<Inside> {
        let loops = self.loops();
        let at = |label| Some(&self.function.blocks[self.index(label)?]);
        let merge = ids(find(at(header)?, Op::SelectionMerge)?).next()?;
        let mut labels = HashSet::new();
        let mut out = HashSet::new();
        let mut open: Vec<Word> = targets(at(header)?).collect();
        while let Some(label) = open.pop() {
            if label == merge || label == header || labels.contains(&label) {
                continue;
            }
            // Each way to the end of a loop inside leads over its header.
            if loops.get(&label).is_some_and(|of| !labels.contains(of)) {
                out.insert(label);
                continue;
            }
            labels.insert(label);
            open.extend(at(label).into_iter().flat_map(targets));
        }
        Some(Inside {
            header,
            merge,
            labels,
            out,
        })
    }

    /// The header and the blocks inside that lead to a block.
    fn leading_to(&self, inside: &Inside, to: Word) -> Vec<Word> {
        let blocks = self.function.blocks.iter();
        let labels = blocks.filter(|b| targets(b).any(|target| target == to));
        let labels = labels.filter_map(Block::label_id);
        labels
            .filter(|label| *label == inside.header || inside.labels.contains(label))
            .collect()
    }

    /// Puts two blocks before the merge block of a switch: the first is the new merge block, which
    /// `leaves` lead to as well, and leads to the second. Returns both.
    fn gathered(&mut self, inside: &Inside, leaves: &[Word]) -> Option<(Word, Word)> {
        let [gathered, stays] = [self.module.id(), self.module.id()];
        let before = self.leading_to(inside, inside.merge);
        for label in &before {
            retarget(self.block(*label)?, inside.merge, gathered);
        }
        let block = self.block(inside.header)?;
        let merges = |i: &&mut Instruction| i.class.opcode == Op::SelectionMerge;
        block.instructions.iter_mut().find(merges)?.operands[0] = Operand::IdRef(gathered);
        let mut first = Vec::new();
        let at = self.index(inside.merge)?;
        for phi in phis(&mut self.function.blocks[at]) {
            let ty = phi.result_type?;
            let pairs = std::mem::take(&mut phi.operands);
            let (mut inner, outer): (Vec<_>, Vec<_>) = pairs.chunks(2).partition(|pair| {
                pair.last()
                    .is_some_and(|o| before.iter().any(|b| *o == Operand::IdRef(*b)))
            });
            let null = self.module.constant_null(ty);
            let others: Vec<[Operand; 2]> = leaves
                .iter()
                .map(|leaf| [null, *leaf].map(Operand::IdRef))
                .collect();
            inner.extend(others.iter().map(|pair| &pair[..]));
            let value = match inner.is_empty() {
                true => null,
                false => push(self.module, &mut first, (Op::Phi, ty), inner.concat()),
            };
            phi.operands = outer.concat();
            if !before.is_empty() {
                phi.operands.extend([value, stays].map(Operand::IdRef));
            }
        }
        first.push(branch(stays));
        self.insert(at, gathered, first);
        if !before.is_empty() {
            self.insert(at + 1, stays, vec![branch(inside.merge)]);
        }
        Some((gathered, stays))
    }

    /// Sends `leaves`, which lead to the block `left`, over the merge block of their switch.
    fn leave(
        &mut self,
        left: Word,
        (gathered, stays): (Word, Word),
        leaves: &[Word],
    ) -> Option<()> {
        let before = self.leading_to_label(gathered);
        for leaf in leaves {
            retarget(self.block(*leaf)?, left, gathered);
        }
        let mut first = Vec::new();
        let at = self.index(left)?;
        for phi in phis(&mut self.function.blocks[at]) {
            let ty = phi.result_type?;
            let is_leaf = |pair: &&[Operand]| {
                pair.last()
                    .is_some_and(|o| leaves.iter().any(|leaf| *o == Operand::IdRef(*leaf)))
            };
            let pairs = std::mem::take(&mut phi.operands);
            let (mut inner, outer): (Vec<_>, Vec<_>) = pairs.chunks(2).partition(is_leaf);
            let null = self.module.constant_null(ty);
            let others: Vec<[Operand; 2]> = before
                .iter()
                .map(|label| [null, *label].map(Operand::IdRef))
                .collect();
            inner.extend(others.iter().map(|pair| &pair[..]));
            let value = push(self.module, &mut first, (Op::Phi, ty), inner.concat());
            phi.operands = outer.concat();
            phi.operands.extend([value, gathered].map(Operand::IdRef));
        }
        let is_only = before.is_empty();
        if !is_only {
            let bool = self.module.type_bool();
            let [yes, no] = [
                self.module.constant_true(bool),
                self.module.constant_false(bool),
            ];
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
        let block = self.block(gathered)?;
        block.instructions.pop();
        block.instructions.extend(first);
        Some(())
    }

    fn leading_to_label(&self, to: Word) -> Vec<Word> {
        let blocks = self.function.blocks.iter();
        let labels = blocks.filter(|b| targets(b).any(|target| target == to));
        labels.filter_map(Block::label_id).collect()
    }
}
