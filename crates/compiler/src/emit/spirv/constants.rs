//! Turns the variables of [`overrides::Specialised`](crate::emit::overrides::Specialised) into
//! specialisation constants (SPIR-V 2.12).
//!
//! ```text
//! OpName %7 "preshade_override0"          OpName %7 "MODE"
//!                                         OpDecorate %7 SpecId 3
//! %7 = OpVariable %_ptr_int Private %1    %7 = OpSpecConstant %int 0
//! %9 = OpLoad %int %7
//! OpIAdd %int %9 %9                       OpIAdd %int %7 %7
//! ```

use std::collections::{HashMap, HashSet};

use naga::Module;
use naga_edit::declared::LengthConstant;
use rspirv::dr::{Builder, Instruction, Operand};
use rspirv::spirv::{Decoration, Op};

use crate::emit::overrides::Variable;
use naga_spirv::words::{ids, pointee, replace_ids, rewrite};

/// Declares `variables` as specialisation constants, and reads them as such. `None` if one has an
/// unexpected form.
pub(super) fn declare(module: &mut Builder, variables: &[Variable]) -> Option<()> {
    let mut declared = Vec::new();
    for variable in variables {
        // A stage may have lost its uses of a variable.
        if let Some(id) = rename(module, variable) {
            specialise(module, id)?;
            let spec_id = Operand::LiteralBit32(variable.constant.id);
            module.decorate(id, Decoration::SpecId, [spec_id]);
            declared.push(id);
        }
    }
    let mut read = HashMap::new();
    rewrite(module, |_, block, instruction| {
        match (
            instruction.class.opcode,
            instruction.operands.first(),
            instruction.result_id,
        ) {
            (Op::Load, Some(Operand::IdRef(id)), Some(result)) if declared.contains(id) => {
                read.insert(result, *id);
            }
            _ => block.push(instruction),
        }
    });
    replace_ids(module, &read);
    Some(())
}

/// Gives a variable the author's name.
fn rename(module: &mut Builder, variable: &Variable) -> Option<u32> {
    let marker = Operand::LiteralString(variable.marker.clone());
    let names = &mut module.module_mut().debug_names;
    let name = names
        .iter_mut()
        .find(|i| i.operands.get(1) == Some(&marker))?;
    name.operands[1] = Operand::LiteralString(variable.constant.name.clone());
    name.operands[0].id_ref_any()
}

/// Replaces the declaration of a variable by that of a constant with its initial value.
fn specialise(module: &mut Builder, id: u32) -> Option<()> {
    let globals = &module.module_ref().types_global_values;
    let at = globals.iter().position(|i| i.result_id == Some(id))?;
    let scalar = pointee(module.module_ref(), globals[at].result_type?)?;
    let init = globals[at].operands.get(1)?.id_ref_any();
    let init = globals.iter().find(|i| i.result_id == init)?;
    let opcode = match init.class.opcode {
        Op::Constant => Op::SpecConstant,
        Op::ConstantTrue => Op::SpecConstantTrue,
        Op::ConstantFalse => Op::SpecConstantFalse,
        _ => return None,
    };
    let constant = Instruction::new(opcode, Some(scalar), Some(id), init.operands.clone());
    module.module_mut().types_global_values[at] = constant;
    Some(())
}

/// Gives arrays the constants of their lengths. Their types have the defaults, and names. Returns
/// the constants of arrays in this module, and their defaults.
pub(super) fn size<'l>(
    module: &mut Builder,
    lengths: &'l [LengthConstant],
    of: &Module,
) -> Vec<(&'l LengthConstant, u32)> {
    let mut sized = HashSet::new();
    let lengths = lengths.iter();
    let found = lengths.filter_map(|length| Some((length, size_by(module, length, &mut sized)?)));
    let found = found.collect();
    if !sized.is_empty() && !has_initial_values(of) {
        drop_initial_zeros(module, sized);
    }
    // Names of types whose lengths are constants with their defaults.
    let is_of_length = |i: &Instruction| match i.operands.get(1) {
        Some(Operand::LiteralString(name)) => LengthConstant::is_type_name(name),
        _ => false,
    };
    let names = &mut module.module_mut().debug_names;
    names.retain(|i| !is_of_length(i));
    found
}

/// Whether the author gave such an array an initial value.
fn has_initial_values(module: &Module) -> bool {
    let functions = module.functions.iter().map(|(_, f)| f);
    let functions = functions.chain(module.entry_points.iter().map(|e| &e.function));
    let locals = functions.flat_map(|f| f.local_variables.iter());
    let locals = locals.map(|(_, l)| (l.ty, l.init));
    let globals = module.global_variables.iter().map(|(_, g)| (g.ty, g.init));
    let mut all = locals.chain(globals).filter(|(_, init)| init.is_some());
    all.any(|(ty, _)| LengthConstant::is_any_in(module, ty))
}

/// Leaves variables of these arrays uninitialised, as authors must in GLSL. naga writes zeros, which
/// `spirv-cross` does not read.
fn drop_initial_zeros(module: &mut Builder, mut sized: HashSet<u32>) {
    let globals = &module.module_ref().types_global_values;
    let mut pointers = HashSet::new();
    let mut zeros = HashSet::new();
    // Parts come first.
    for i in globals {
        let Some(id) = i.result_id else { continue };
        let is_of_sized = ids(i).any(|part| sized.contains(&part));
        match i.class.opcode {
            Op::TypeStruct | Op::TypeArray if is_of_sized => drop(sized.insert(id)),
            Op::TypePointer if is_of_sized => drop(pointers.insert(id)),
            Op::ConstantNull if i.result_type.is_some_and(|ty| sized.contains(&ty)) => {
                zeros.insert(id);
            }
            _ => {}
        }
    }
    let drop_zero = |i: &mut Instruction| {
        let is_zero = ids(i).next().is_some_and(|value| zeros.contains(&value));
        let is_sized = i.result_type.is_some_and(|ty| pointers.contains(&ty));
        if i.class.opcode == Op::Variable && is_sized && is_zero {
            i.operands.truncate(1);
        }
    };
    let module = module.module_mut();
    module.types_global_values.iter_mut().for_each(drop_zero);
    for function in &mut module.functions {
        let all = function.blocks.iter_mut().flat_map(|b| &mut b.instructions);
        all.for_each(drop_zero);
    }
    let used: HashSet<u32> = module.all_inst_iter().flat_map(ids).collect();
    let is_unused = |i: &Instruction| {
        i.result_id
            .is_some_and(|id| zeros.contains(&id) && !used.contains(&id))
    };
    module.types_global_values.retain(|i| !is_unused(i));
}

fn size_by(module: &mut Builder, length: &LengthConstant, sized: &mut HashSet<u32>) -> Option<u32> {
    let name = Operand::LiteralString(length.type_name());
    let (of_arrays, names) = std::mem::take(&mut module.module_mut().debug_names)
        .into_iter()
        .partition::<Vec<_>, _>(|i| i.operands.get(1) == Some(&name));
    module.module_mut().debug_names = names;
    let arrays: Vec<u32> = of_arrays.iter().filter_map(|i| ids(i).next()).collect();
    let is_array = |i: &Instruction| {
        let is_it = i.result_id.is_some_and(|id| arrays.contains(&id));
        is_it && i.class.opcode == Op::TypeArray
    };
    let globals = &module.module_ref().types_global_values;
    let default = globals.iter().find(|i| is_array(i))?;
    let default = ids(default).nth(1)?;
    let default = globals.iter().find(|i| i.result_id == Some(default))?;
    let default = default
        .operands
        .first()
        .and_then(naga_spirv::words::literal)?;
    let constant = declared(module, length.id).unwrap_or_else(|| {
        let ty = module.type_int(32, u32::from(length.is_signed));
        let id = module.spec_constant_bit32(ty, default);
        module.decorate(id, Decoration::SpecId, [Operand::LiteralBit32(length.id)]);
        module.name(id, length.own.clone());
        id
    });
    let globals = &mut module.module_mut().types_global_values;
    for array in globals.iter_mut().filter(|i| is_array(i)) {
        array.operands[1] = Operand::IdRef(constant);
    }
    sized.extend(arrays);
    // An array's length comes before it.
    let at = globals.iter().position(|i| i.result_id == Some(constant))?;
    let constant = globals.remove(at);
    let ty = globals
        .iter()
        .position(|i| i.result_id == constant.result_type)?;
    let ty = globals.remove(ty);
    globals.splice(0..0, [ty, constant]);
    Some(default)
}

/// The specialisation constant of this `SpecId`.
fn declared(module: &Builder, id: u32) -> Option<u32> {
    let mut all = module.module_ref().annotations.iter();
    let spec_id = [
        Operand::Decoration(Decoration::SpecId),
        Operand::LiteralBit32(id),
    ];
    all.find(|i| i.operands.get(1..) == Some(&spec_id))
        .and_then(|i| ids(i).next())
}
