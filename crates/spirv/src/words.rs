//! Edits SPIR-V modules. Shared by the reader in `front` and the writer in `emit`.

use std::collections::{HashMap, HashSet};

use rspirv::dr::{self, Builder, Instruction, Operand};
use rspirv::spirv::{Decoration, Op, StorageClass, Word};

pub mod position;

/// The little-endian bytes of `words`.
pub fn to_bytes(words: &[u32]) -> Vec<u8> {
    words.iter().flat_map(|w| w.to_le_bytes()).collect()
}

/// The ids among an instruction's operands.
pub fn ids(instruction: &Instruction) -> impl Iterator<Item = Word> {
    instruction.operands.iter().filter_map(Operand::id_ref_any)
}

/// The number in an operand.
pub fn literal(operand: &Operand) -> Option<u32> {
    match operand {
        Operand::LiteralBit32(n) => Some(*n),
        _ => None,
    }
}

/// The type to which a pointer type points.
pub fn pointee(module: &dr::Module, pointer: Word) -> Option<Word> {
    let mut types = module.types_global_values.iter();
    ids(types.find(|i| i.result_id == Some(pointer))?).next()
}

/// Rewrites the functions: `change` receives each instruction and writes its replacement.
pub fn rewrite(
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

/// Replaces ids in the functions' operands, and drops the names of replaced ids.
pub fn replace_ids(module: &mut Builder, with: &HashMap<Word, Word>) {
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

/// Appends an instruction with a result, and returns its id.
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
pub fn globals(module: &dr::Module) -> HashMap<Word, Instruction> {
    let all = module.types_global_values.iter();
    all.filter_map(|i| Some((i.result_id?, i.clone())))
        .collect()
}

/// The numeric operand of all decorations of a kind, by target.
pub fn decorations(module: &dr::Module, kind: Decoration) -> HashMap<Word, u32> {
    let decorated = |i: &Instruction| match i.operands.as_slice() {
        [Operand::IdRef(id), Operand::Decoration(of), number @ ..] if *of == kind => {
            Some((*id, number.first().and_then(literal).unwrap_or(0)))
        }
        _ => None,
    };
    module.annotations.iter().filter_map(decorated).collect()
}

/// The class of a variable or of a pointer type.
pub fn storage_class(instruction: &Instruction) -> Option<StorageClass> {
    match instruction.operands.first() {
        Some(Operand::StorageClass(class)) => Some(*class),
        _ => None,
    }
}

/// Sorts the definitions outside of functions by dependency. Drops unused ones, except for those
/// that `is_kept` selects.
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
    // Search from each use: in a valid module definitions precede their uses, but not the ones that
    // we added.
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

/// The names of ids.
pub fn names(module: &dr::Module) -> HashMap<Word, String> {
    let all = module.debug_names.iter();
    let named = all.filter_map(|i| match i.operands.as_slice() {
        [Operand::IdRef(id), Operand::LiteralString(name)] => Some((*id, name.clone())),
        _ => None,
    });
    named.collect()
}

/// The decorations of members, by struct and index.
pub(crate) fn member_decorations(module: &dr::Module) -> HashMap<(Word, u32), Vec<Instruction>> {
    let mut members: HashMap<(Word, u32), Vec<Instruction>> = HashMap::new();
    for i in &module.annotations {
        if let [Operand::IdRef(id), Operand::LiteralBit32(n), ..] = i.operands.as_slice() {
            members.entry((*id, *n)).or_default().push(i.clone());
        }
    }
    members
}

/// Whether an instruction computes a pointer to a part of a value.
pub(crate) fn is_access(instruction: &Instruction) -> bool {
    matches!(
        instruction.class.opcode,
        Op::AccessChain | Op::InBoundsAccessChain
    )
}

/// Index of the first instruction after the variables of a function's first block.
pub(crate) fn after_variables(first: &dr::Block) -> usize {
    let is_head = |i: &Instruction| matches!(i.class.opcode, Op::Variable | Op::Line);
    let body = first.instructions.iter().position(|i| !is_head(i));
    body.unwrap_or(0)
}

/// How many scalars, vectors and matrices a value of this type holds. Without `is_whole`, each
/// column of a matrix counts.
pub(crate) fn count_parts(globals: &HashMap<Word, Instruction>, ty: Word, is_whole: bool) -> u32 {
    let Some(i) = globals.get(&ty) else { return 1 };
    let of = |ty: Word| count_parts(globals, ty, is_whole);
    match i.class.opcode {
        Op::TypeStruct => ids(i).fold(0, |sum, member| of(member).saturating_add(sum)),
        Op::TypeArray => {
            let length = ids(i).nth(1).and_then(|n| globals.get(&n));
            let length = length.and_then(|n| n.operands.first()).and_then(literal);
            let element = ids(i).next().map_or(1, of);
            length.map_or(u32::MAX, |n| element.saturating_mul(n))
        }
        Op::TypeMatrix if !is_whole => i.operands.get(1).and_then(literal).unwrap_or(1),
        _ => 1,
    }
}

/// The numeric operand of a decoration among those of an id or a member.
pub(crate) fn decoration(all: &[Instruction], kind: Decoration) -> Option<u32> {
    let is = |i: &&Instruction| i.operands.contains(&Operand::Decoration(kind));
    let found = all.iter().find(is)?;
    Some(found.operands.last().and_then(literal).unwrap_or(0))
}
