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

use std::collections::HashMap;

use rspirv::dr::{Builder, Instruction, Operand};
use rspirv::spirv::{Decoration, Op};

use super::{pointee, replace_ids, rewrite};
use crate::emit::overrides::Variable;

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
