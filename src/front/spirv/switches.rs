//! Finds a `default` that falls through, or that another case falls into: naga's reader puts
//! `default` last.

use std::collections::{HashMap, HashSet};

use rspirv::dr::{Block, Function, Module};
use rspirv::spirv::{Op, Word};

use crate::words::{ids, literal};

/// The place in the listing of the first such `switch`.
pub(super) fn find(module: &Module) -> Option<Option<u32>> {
    module.functions.iter().find_map(of_function)
}

fn of_function(function: &Function) -> Option<Option<u32>> {
    let blocks = function.blocks.iter();
    let blocks: HashMap<Word, &Block> = blocks.filter_map(|b| Some((b.label_id()?, b))).collect();
    let mut line = None;
    for block in &function.blocks {
        for i in &block.instructions {
            if i.class.opcode == Op::Line {
                line = i.operands.get(1).and_then(literal);
            }
        }
        let (Some(switch), Some(own)) = (block.instructions.last(), block.label_id()) else {
            continue;
        };
        if switch.class.opcode != Op::Switch {
            continue;
        }
        let mut merges = block.instructions.iter();
        let merge = merges.find(|i| i.class.opcode == Op::SelectionMerge);
        let merge = merge.and_then(|i| ids(i).next());
        let mut targets = ids(switch).skip(1);
        let Some(default) = targets.next().filter(|d| Some(*d) != merge) else {
            continue;
        };
        let cases: Vec<Word> = targets
            .filter(|c| *c != default && Some(*c) != merge)
            .collect();
        let stop = [Some(own), merge];
        let leads = |from: Word, to: Word| reached(&blocks, from, &stop).contains(&to);
        let falls = cases.iter().any(|case| leads(default, *case));
        // naga keeps the order of the others.
        let others = cases.iter().filter(|c| Some(*c) != cases.last());
        let falls_into = |case: &Word| leads(*case, default);
        if falls || others.into_iter().any(falls_into) {
            return Some(line);
        }
    }
    None
}

/// The blocks that follow one, but none behind `stop`.
fn reached(blocks: &HashMap<Word, &Block>, from: Word, stop: &[Option<Word>]) -> HashSet<Word> {
    let mut found = HashSet::new();
    let mut next = vec![from];
    while let Some(label) = next.pop() {
        if stop.contains(&Some(label)) || !found.insert(label) {
            continue;
        }
        let last = blocks.get(&label).and_then(|b| b.instructions.last());
        next.extend(
            last.into_iter()
                .flat_map(ids)
                .filter(|id| blocks.contains_key(id)),
        );
    }
    found
}
