//! Makes a pointer again in each block that uses it: naga's reader keeps what a block takes from another
//! in a local variable, which holds no pointers.

use std::collections::HashMap;

use rspirv::dr::{Builder, Instruction, Operand};
use rspirv::spirv::{Op, Word};

use crate::words::{ids, is_access};

/// Makes all such pointers again.
pub(super) fn renew(module: &mut Builder) {
    let mut functions = std::mem::take(&mut module.module_mut().functions);
    for function in &mut functions {
        let mut made: HashMap<Word, (usize, Instruction)> = HashMap::new();
        for (n, block) in function.blocks.iter().enumerate() {
            let pointers = block.instructions.iter().filter(|i| is_access(i));
            made.extend(pointers.filter_map(|i| Some((i.result_id?, (n, i.clone())))));
        }
        for (n, block) in function.blocks.iter_mut().enumerate() {
            let mut renewed = HashMap::new();
            for mut i in std::mem::take(&mut block.instructions) {
                let foreign = |id: &Word| made.get(id).is_some_and(|(at, _)| *at != n);
                if i.class.opcode != Op::Phi && ids(&i).any(|id| foreign(&id)) {
                    let mut again = Again {
                        module,
                        made: &made,
                        at: n,
                        renewed: &mut renewed,
                    };
                    again.replace(&mut i, &mut block.instructions);
                }
                block.instructions.push(i);
            }
        }
    }
    module.module_mut().functions = functions;
}

struct Again<'a> {
    module: &'a mut Builder,
    /// The instructions that make pointers, and the indices of their blocks.
    made: &'a HashMap<Word, (usize, Instruction)>,
    /// The index of the block at hand.
    at: usize,
    /// The pointers that it has made again.
    renewed: &'a mut HashMap<Word, Word>,
}

impl Again<'_> {
    /// Replaces pointers of other blocks among the operands.
    fn replace(&mut self, i: &mut Instruction, block: &mut Vec<Instruction>) {
        for id in i.operands.iter_mut().filter_map(Operand::id_ref_any_mut) {
            if let Some((at, made)) = self.made.get(id)
                && *at != self.at
            {
                *id = self.pointer(*id, made, block);
            }
        }
    }

    fn pointer(&mut self, id: Word, made: &Instruction, block: &mut Vec<Instruction>) -> Word {
        if let Some(known) = self.renewed.get(&id) {
            return *known;
        }
        let mut made = made.clone();
        self.replace(&mut made, block);
        let new = self.module.id();
        made.result_id = Some(new);
        block.push(made);
        self.renewed.insert(id, new);
        new
    }
}
