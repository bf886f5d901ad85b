//! Checks properties that the other modules rely on. Each id is defined once and before its uses,
//! so no type or constant contains itself. Types are not nested too deeply, and numbers have a
//! known width.

use std::collections::{HashMap, HashSet};

use rspirv::binary::Disassemble;
use rspirv::dr::{Function, Instruction, Module, Operand};
use rspirv::spirv::{Op, Word};

use crate::words::{ids, literal};

/// The deepest nesting of structs that SPIR-V allows.
const MOST_NESTED: u32 = 255;

/// Checks a module without debug information.
pub(super) fn check(module: &Module) -> Result<(), String> {
    let mut defined: HashSet<Word> = HashSet::new();
    defined.extend(module.ext_inst_imports.iter().filter_map(|i| i.result_id));
    // Functions may be called before they are defined.
    for function in &module.functions {
        define(function.def.as_ref(), &mut defined)?;
    }
    let mut depths: HashMap<Word, u32> = HashMap::new();
    for i in &module.types_global_values {
        precedes(i, &defined)?;
        check_type(i, &mut depths)?;
        match i.class.opcode {
            Op::TypeForwardPointer => defined.extend(ids(i)),
            // `OpTypeForwardPointer` has already declared it.
            Op::TypePointer => defined.extend(i.result_id),
            _ => define(Some(i), &mut defined)?,
        }
    }
    module
        .functions
        .iter()
        .try_for_each(|function| check_function(function, &mut defined))
}

fn check_function(function: &Function, defined: &mut HashSet<Word>) -> Result<(), String> {
    let labels = function.blocks.iter().filter_map(|b| b.label.as_ref());
    for i in labels.chain(&function.parameters) {
        define(Some(i), defined)?;
    }
    for i in function.blocks.iter().flat_map(|b| &b.instructions) {
        match i.class.opcode {
            Op::Line => continue,
            // Values from a loop's end are defined later.
            Op::Phi => {}
            _ => precedes(i, defined)?,
        }
        define(Some(i), defined)?;
    }
    Ok(())
}

fn define(i: Option<&Instruction>, defined: &mut HashSet<Word>) -> Result<(), String> {
    match i.and_then(|i| i.result_id) {
        Some(id) if !defined.insert(id) => Err(format!("%{id} is defined twice")),
        _ => Ok(()),
    }
}

fn precedes(i: &Instruction, defined: &HashSet<Word>) -> Result<(), String> {
    let is_declaration = i.class.opcode == Op::TypeForwardPointer;
    let mut used = i.result_type.into_iter().chain(ids(i));
    match used.find(|id| !is_declaration && !defined.contains(id)) {
        Some(id) => Err(format!(
            "`{}` uses %{id}, which no instruction before it defines",
            i.disassemble()
        )),
        None => Ok(()),
    }
}

fn check_type(i: &Instruction, depths: &mut HashMap<Word, u32>) -> Result<(), String> {
    let op = i.class.opcode;
    if matches!(op, Op::TypeInt | Op::TypeFloat) {
        let bits = i.operands.first().and_then(literal).unwrap_or(0);
        if !matches!(bits, 8 | 16 | 32 | 64) {
            return Err(format!("`{}` has {bits} bits", i.disassemble()));
        }
    }
    let is_literal = |o: &Operand| matches!(o, Operand::LiteralBit32(0));
    let is_empty =
        matches!(op, Op::TypeVector | Op::TypeMatrix) && i.operands.get(1).is_none_or(is_literal);
    if is_empty {
        return Err(format!("`{}` is empty", i.disassemble()));
    }
    if i.class.opname.starts_with("Type")
        && let Some(id) = i.result_id
    {
        let parts = ids(i).filter_map(|id| depths.get(&id)).max();
        let depth = parts.map_or(0, |depth| depth + 1);
        if depth > MOST_NESTED {
            return Err(format!("types are nested more than {MOST_NESTED} deep"));
        }
        depths.insert(id, depth);
    }
    Ok(())
}
