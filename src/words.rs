//! Edits SPIR-V modules: what the reader in `front` and the writer in `emit` share.

use std::collections::{HashMap, HashSet};

use rspirv::dr::{self, Builder, Instruction, Operand};
use rspirv::spirv::{Decoration, Op, StorageClass, Word};

pub(crate) mod position;

/// The little-endian bytes of `words`.
pub(crate) fn to_bytes(words: &[u32]) -> Vec<u8> {
    words.iter().flat_map(|w| w.to_le_bytes()).collect()
}

/// The ids among an instruction's operands.
pub(crate) fn ids(instruction: &Instruction) -> impl Iterator<Item = Word> {
    instruction.operands.iter().filter_map(Operand::id_ref_any)
}

/// The number in an operand.
pub(crate) fn literal(operand: &Operand) -> Option<u32> {
    match operand {
        Operand::LiteralBit32(n) => Some(*n),
        _ => None,
    }
}

/// The type to which a pointer type points.
pub(crate) fn pointee(module: &dr::Module, pointer: Word) -> Option<Word> {
    let mut types = module.types_global_values.iter();
    ids(types.find(|i| i.result_id == Some(pointer))?).next()
}

/// Writes the functions again: `change` gets each instruction, and writes what replaces it.
pub(crate) fn rewrite(
    module: &mut Builder,
    mut change: impl FnMut(&mut Builder, &mut Vec<Instruction>, Instruction),
) {
    let mut functions = std::mem::take(&mut module.module_mut().functions);
    for block in functions.iter_mut().flat_map(|f| &mut f.blocks) {
        for instruction in std::mem::take(&mut block.instructions) {
            change(module, &mut block.instructions, instruction);
        }
    }
    module.module_mut().functions = functions;
}

/// Replaces operands of the functions, and drops the names of replaced ids.
pub(crate) fn replace_ids(module: &mut Builder, with: &HashMap<Word, Word>) {
    let module = module.module_mut();
    let is_replaced = |i: &Instruction| ids(i).any(|id| with.contains_key(&id));
    module.debug_names.retain(|i| !is_replaced(i));
    let functions = module.functions.iter_mut();
    let instructions = functions.flat_map(dr::Function::all_inst_iter_mut);
    for operand in instructions.flat_map(|i| &mut i.operands) {
        if let Some(id) = operand.id_ref_any_mut()
            && let Some(new) = with.get(id)
        {
            *id = *new;
        }
    }
}

/// Writes an instruction with a result, and returns its id.
pub(crate) fn push(
    module: &mut Builder,
    block: &mut Vec<Instruction>,
    (op, ty): (Op, Word),
    operands: impl IntoIterator<Item = Operand>,
) -> Word {
    let id = module.id();
    let operands = operands.into_iter().collect();
    block.push(Instruction::new(op, Some(ty), Some(id), operands));
    id
}

/// The definitions outside of functions, by id.
pub(crate) fn globals(module: &dr::Module) -> HashMap<Word, Instruction> {
    let all = module.types_global_values.iter();
    all.filter_map(|i| Some((i.result_id?, i.clone())))
        .collect()
}

/// The numbers of the decorations of a kind, by target.
pub(crate) fn decorations(module: &dr::Module, kind: Decoration) -> HashMap<Word, u32> {
    let decorated = |i: &Instruction| match i.operands.as_slice() {
        [Operand::IdRef(id), Operand::Decoration(of), number @ ..] if *of == kind => {
            Some((*id, number.first().and_then(literal).unwrap_or(0)))
        }
        _ => None,
    };
    module.annotations.iter().filter_map(decorated).collect()
}

/// The class of a variable or of a pointer type.
pub(crate) fn storage_class(instruction: &Instruction) -> Option<StorageClass> {
    match instruction.operands.first() {
        Some(Operand::StorageClass(class)) => Some(*class),
        _ => None,
    }
}

/// Sorts the definitions outside of functions, so that each follows those that it refers to, and
/// drops those that nothing refers to if `is_kept` does not keep them.
pub(crate) fn sort_globals(module: &mut dr::Module, is_kept: impl Fn(&Instruction) -> bool) {
    let all = std::mem::take(&mut module.types_global_values);
    let place: HashMap<Word, usize> = all
        .iter()
        .enumerate()
        .filter_map(|(i, g)| Some((g.result_id?, i)))
        .collect();
    let roots = module
        .functions
        .iter()
        .flat_map(dr::Function::all_inst_iter);
    let roots = roots.flat_map(|i| i.result_type.into_iter().chain(ids(i)));
    let kept = all
        .iter()
        .filter(|i| is_kept(i))
        .filter_map(|i| i.result_id);
    let mut used: HashSet<Word> = roots.chain(kept).collect();
    // Definitions precede their uses in a valid module, except for the ones that we added: so we
    // search from each use.
    let mut sorted: Vec<usize> = Vec::new();
    let mut seen: HashSet<usize> = HashSet::new();
    let mut wanted: Vec<usize> = used
        .drain()
        .filter_map(|id| place.get(&id).copied())
        .collect();
    wanted.sort_unstable();
    for root in wanted {
        let mut open = vec![(root, false)];
        while let Some((at, is_done)) = open.pop() {
            if is_done {
                sorted.push(at);
                continue;
            }
            if !seen.insert(at) {
                continue;
            }
            open.push((at, true));
            let needed = all[at].result_type.into_iter().chain(ids(&all[at]));
            open.extend(needed.filter_map(|id| Some((*place.get(&id)?, false))));
        }
    }
    let mut all: Vec<Option<Instruction>> = all.into_iter().map(Some).collect();
    let sorted = sorted.into_iter().filter_map(|i| all[i].take());
    module.types_global_values = sorted.collect();
}
