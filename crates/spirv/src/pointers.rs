//! Recomputes a pointer in each block that uses it. naga's reader passes values between blocks in
//! local variables, which cannot hold pointers.

use std::collections::HashMap;

use rspirv::dr::{Builder, Instruction, Operand};
use rspirv::spirv::{Op, Word};

use crate::words::{ids, is_access};

/// Recomputes the pointers in all functions.
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
    /// The instructions that compute pointers, and the indices of their blocks.
    made: &'a HashMap<Word, (usize, Instruction)>,
    /// Index of the current block.
    at: usize,
    /// The pointers that the block has recomputed.
    renewed: &'a mut HashMap<Word, Word>,
}

impl Again<'_> {
    /// Replaces pointers from other blocks in an instruction's operands.
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
