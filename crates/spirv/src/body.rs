//! The blocks of a function during changes: by label, in order, and with their predecessors.

use std::collections::{BTreeSet, HashMap};

use rspirv::dr::{Block, Instruction};
use rspirv::spirv::{Op, Word};

use super::blocks::targets;

pub(super) struct Body {
    blocks: HashMap<Word, Block>,
    /// The label that follows each label.
    next: HashMap<Word, Word>,
    /// The label that precedes each label.
    ahead: HashMap<Word, Word>,
    first: Option<Word>,
    /// The predecessors of each block.
    before: HashMap<Word, BTreeSet<Word>>,
}

impl Body {
    pub(super) fn new(blocks: Vec<Block>) -> Self {
        let mut body = Self {
            blocks: HashMap::new(),
            next: HashMap::new(),
            ahead: HashMap::new(),
            first: blocks.first().and_then(Block::label_id),
            before: HashMap::new(),
        };
        let mut last = None;
        for block in blocks {
            let Some(label) = block.label_id() else {
                continue;
            };
            if let Some(last) = last {
                body.link(last, label);
            }
            last = Some(label);
            body.enter(label, block);
        }
        body
    }

    /// The blocks, in their order.
    pub(super) fn into_blocks(mut self) -> Vec<Block> {
        let labels = std::iter::successors(self.first, |label| self.next.get(label).copied());
        let blocks = &mut self.blocks;
        labels.filter_map(|label| blocks.remove(&label)).collect()
    }

    pub(super) fn get(&self, label: Word) -> Option<&Block> {
        self.blocks.get(&label)
    }

    /// The predecessors of a block.
    pub(super) fn before(&self, label: Word) -> &BTreeSet<Word> {
        static NONE: BTreeSet<Word> = BTreeSet::new();
        self.before.get(&label).unwrap_or(&NONE)
    }

    /// Changes a block, and updates the predecessors of its successors.
    pub(super) fn edit<T>(
        &mut self,
        label: Word,
        change: impl FnOnce(&mut Block) -> T,
    ) -> Option<T> {
        let block = self.blocks.get_mut(&label)?;
        let were: BTreeSet<Word> = targets(block).collect();
        let result = change(block);
        let are: BTreeSet<Word> = targets(block).collect();
        for to in were.difference(&are) {
            if let Some(before) = self.before.get_mut(to) {
                before.remove(&label);
            }
        }
        for to in are.difference(&were) {
            self.before.entry(*to).or_default().insert(label);
        }
        Some(result)
    }

    /// Inserts a new block after another.
    pub(super) fn insert_after(&mut self, at: Word, label: Word, instructions: Vec<Instruction>) {
        let next = self.next.get(&at).copied();
        self.link(at, label);
        if let Some(next) = next {
            self.link(label, next);
        }
        self.create(label, instructions);
    }

    /// Inserts a new block before another.
    pub(super) fn insert_before(&mut self, at: Word, label: Word, instructions: Vec<Instruction>) {
        match self.ahead.get(&at).copied() {
            Some(ahead) => self.link(ahead, label),
            None => self.first = Some(label),
        }
        self.link(label, at);
        self.create(label, instructions);
    }

    fn create(&mut self, label: Word, instructions: Vec<Instruction>) {
        let own = Instruction::new(Op::Label, None, Some(label), Vec::new());
        let block = Block {
            label: Some(own),
            instructions,
        };
        self.enter(label, block);
    }

    fn enter(&mut self, label: Word, block: Block) {
        for to in targets(&block) {
            self.before.entry(to).or_default().insert(label);
        }
        self.blocks.insert(label, block);
    }

    fn link(&mut self, label: Word, next: Word) {
        self.next.insert(label, next);
        self.ahead.insert(next, label);
    }
}
