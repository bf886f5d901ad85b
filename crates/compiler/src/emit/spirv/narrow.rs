//! Gives the outputs of the fragment stage their author's number of components. The IR fills them up
//! to four, which WebGPU needs and Vulkan does not.

use naga_edit::declared::{Declared, Located};
use rspirv::dr::{Builder, Instruction, Operand};
use rspirv::spirv::{Decoration, Op, StorageClass};

use naga_spirv::words::{decorations, globals, ids, names};

/// Narrows the outputs of a text that is Vulkan's.
pub(super) fn narrow(words: &mut Builder, declared: &Declared) {
    for target in declared.widened() {
        let _ = one(words, target);
    }
}

/// Narrows an output. `None` if it has another form than the front end gives it.
fn one(words: &mut Builder, target: &Located) -> Option<()> {
    let count = target.components()?;
    let module = words.module_ref();
    let (locations, names) = (decorations(module, Decoration::Location), names(module));
    let is_it = |i: &&Instruction| {
        let id = i.result_id.unwrap_or_default();
        let is_output = i.operands == [Operand::StorageClass(StorageClass::Output)];
        let is_named = |name: &String| target.is_widened_as(name);
        is_output
            && locations.get(&id) == Some(&target.location)
            && names.get(&id).is_some_and(is_named)
    };
    let mut all = module.types_global_values.iter();
    let mut variable = all.find(is_it)?.clone();
    let id = variable.result_id?;
    let is_stored_to =
        |i: &Instruction| i.class.opcode == Op::Store && ids(i).nth(1).is_some_and(|v| v != id);
    let is_other_use = |i: &Instruction| ids(i).any(|used| used == id) && !is_stored_to(i);
    let functions = module.functions.iter();
    let is_used_otherwise = functions.flat_map(|f| f.all_inst_iter()).any(is_other_use);
    if is_used_otherwise {
        return None;
    }
    let globals = globals(module);
    let vector = ids(globals.get(&variable.result_type?)?).next()?;
    let scalar = ids(globals.get(&vector)?).next()?;
    let ty = match count {
        1 => scalar,
        _ => words.type_vector(scalar, count),
    };
    variable.result_type = Some(words.type_pointer(None, StorageClass::Output, ty));
    // Behind its new type.
    let types = &mut words.module_mut().types_global_values;
    types.retain(|i| i.result_id != Some(id));
    types.push(variable);

    let mut functions = std::mem::take(&mut words.module_mut().functions);
    for block in functions.iter_mut().flat_map(|f| &mut f.blocks) {
        for mut i in std::mem::take(&mut block.instructions) {
            let stored = ids(&i).take(2).collect::<Vec<_>>();
            if let (Op::Store, [to, value]) = (i.class.opcode, &stored[..])
                && *to == id
            {
                let part = words.id();
                let letters = (0..count).map(Operand::LiteralBit32);
                let (op, values) = match count {
                    1 => (Op::CompositeExtract, 1),
                    _ => (Op::VectorShuffle, 2),
                };
                let values = std::iter::repeat_n(Operand::IdRef(*value), values);
                let operands = values.chain(letters).collect();
                let extract = Instruction::new(op, Some(ty), Some(part), operands);
                block.instructions.push(extract);
                i.operands[1] = Operand::IdRef(part);
            }
            block.instructions.push(i);
        }
    }
    words.module_mut().functions = functions;
    for name in &mut words.module_mut().debug_names {
        if name.class.opcode == Op::Name && ids(name).next() == Some(id) {
            name.operands[1] = Operand::LiteralString(target.declaration.name.clone());
        }
    }
    Some(())
}
