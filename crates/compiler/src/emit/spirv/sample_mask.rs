//! naga declares `sample_mask` as a scalar. Vulkan demands an array (VUID-SampleMask-SampleMask-04359).

use std::collections::HashMap;

use rspirv::dr::{Builder, Instruction, Operand};
use rspirv::spirv::{BuiltIn, Decoration, Op};

use super::interface;
use naga_spirv::words::{pointee, rewrite};

/// Declares each sample mask as an array of one element, and reads and writes that element.
pub(super) fn as_arrays(module: &mut Builder) {
    let decorations = interface::decorations(module.module_ref());
    let is_mask = |id: Option<u32>| {
        let builtin = decorations.get(&(id?, Decoration::BuiltIn));
        builtin.filter(|b| ***b == Operand::BuiltIn(BuiltIn::SampleMask))
    };
    let globals = module.module_ref().types_global_values.iter();
    let masks: Vec<Instruction> = globals
        .filter(|i| i.class.opcode == Op::Variable && is_mask(i.result_id).is_some())
        .cloned()
        .collect();
    // The type of a pointer to the element, and the constant 0, by variable.
    let mut elements: HashMap<u32, [u32; 2]> = HashMap::new();
    for mask in masks {
        let (Some(id), Some(pointer), Some(Operand::StorageClass(class))) =
            (mask.result_id, mask.result_type, mask.operands.first())
        else {
            continue;
        };
        let Some(scalar) = pointee(module.module_ref(), pointer) else {
            continue;
        };
        let [one, zero] = [1, 0].map(|n| module.constant_bit32(scalar, n));
        let array = module.type_array(scalar, one);
        let own = module.type_pointer(None, *class, array);
        let globals = &mut module.module_mut().types_global_values;
        globals.retain(|i| i.result_id != Some(id));
        module.variable(own, Some(id), *class, None);
        elements.insert(id, [pointer, zero]);
    }
    if elements.is_empty() {
        return;
    }
    rewrite(module, |module, block, mut instruction| {
        if matches!(instruction.class.opcode, Op::Load | Op::Store)
            && let Some(Operand::IdRef(id)) = instruction.operands.first_mut()
            && let Some([pointer, zero]) = elements.get(id)
        {
            let element = module.id();
            let path = vec![Operand::IdRef(*id), Operand::IdRef(*zero)];
            let chain = Instruction::new(Op::AccessChain, Some(*pointer), Some(element), path);
            block.push(chain);
            *id = element;
        }
        block.push(instruction);
    });
}
