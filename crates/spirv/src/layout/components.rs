//! Splits vectors at offsets that WGSL does not allow: each component becomes a member of the
//! struct.

use std::rc::Rc;

use rspirv::dr::{Builder, Instruction, Operand};
use rspirv::spirv::{Decoration, Op, Word};

use super::{Layouts, Memory, Unfit};
use crate::words::ids;

impl Layouts {
    /// The types of the members that replace a member.
    pub(super) fn member_types(&self, memory: &Memory) -> Vec<Word> {
        match memory {
            Memory::Components { vector, count } => {
                let scalar = self.part(*vector, 0).unwrap_or_default();
                vec![scalar; *count as usize]
            }
            other => vec![other.ty()],
        }
    }

    /// A member's memory. If WGSL allows no such member at its offset, that of its components.
    pub(super) fn aligned(
        &self,
        of: Word,
        n: u32,
        memory: Rc<Memory>,
    ) -> Result<Rc<Memory>, Unfit> {
        let at = self.offset(of, n).unwrap_or(0);
        let (_, align) = self.size(memory.ty());
        let op = self.globals.get(&memory.ty()).map(|i| i.class.opcode);
        match (&*memory, op) {
            _ if at.is_multiple_of(align) => Ok(memory),
            (Memory::Same(vector), Some(Op::TypeVector)) => Ok(Rc::new(Memory::Components {
                vector: *vector,
                count: self.count(*vector),
            })),
            _ => Err(Unfit {
                id: of,
                line: None,
                why: format!(
                    "member {n} begins at byte {at}, and WGSL has such members at multiples of {align} \
                     bytes: use the layout std140 or std430"
                ),
            }),
        }
    }

    /// Sets names and offsets of the members that replace a vector.
    pub(super) fn part_components(
        &mut self,
        module: &mut Builder,
        (of, n): (Word, u32),
        (new, at): (Word, u32),
        memory: &Memory,
    ) {
        let Memory::Components { vector, count } = memory else {
            return;
        };
        let (bytes, _) = self.size(self.part(*vector, 0).unwrap_or_default());
        let start = self.offset(of, n).unwrap_or(0);
        let is_own = |i: &Instruction| {
            ids(i).next() == Some(new) && i.operands.get(1) == Some(&Operand::LiteralBit32(at))
        };
        let is_offset = |i: &Instruction| {
            i.operands
                .contains(&Operand::Decoration(Decoration::Offset))
        };
        let names = &mut module.module_mut().debug_names;
        let name = names
            .iter()
            .find(|i| is_own(i))
            .and_then(|i| match i.operands.last() {
                Some(Operand::LiteralString(name)) => Some(name.clone()),
                _ => None,
            });
        names.retain(|i| !is_own(i));
        let taken: Vec<Operand> = names
            .iter()
            .filter(|i| ids(i).next() == Some(new))
            .filter_map(|i| i.operands.last().cloned())
            .collect();
        let annotations = &mut module.module_mut().annotations;
        annotations.retain(|i| !(is_own(i) && is_offset(i)));
        let name = name.unwrap_or_else(|| format!("_m{n}"));
        for (k, letter) in (0..*count).zip(["x", "y", "z", "w"]) {
            let mut own = format!("{name}_{letter}");
            while taken.contains(&Operand::LiteralString(own.clone())) {
                own.push('_');
            }
            module.member_name(new, at + k, own);
            self.place_member(module, new, at + k, start + k * bytes);
        }
    }
}
