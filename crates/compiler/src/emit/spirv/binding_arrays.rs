//! Declares the parts of binding arrays that Vulkan requires and naga leaves out: the capabilities
//! of arrays without a length and of indices that differ between invocations, and `NonUniform` on
//! each value from an element that such an index selects (Vulkan's specification, 15.6
//! "NonUniform").

use std::collections::{HashMap, HashSet};

use rspirv::dr::{Builder, Instruction, Module, Operand};
use rspirv::spirv::{Capability, Decoration, Op, StorageClass};

use naga_spirv::words::{decorations, globals, ids, pointee, storage_class};

/// SPIR-V before 1.5 needs it.
const EXTENSION: &str = "SPV_EXT_descriptor_indexing";

pub(super) fn declare(module: &mut Builder) {
    decorate_blocks(module);
    let types = globals(module.module_ref());
    let mut capabilities = Vec::new();
    if types
        .values()
        .any(|i| is_unsized(module.module_ref(), &types, i))
    {
        capabilities.push(Capability::RuntimeDescriptorArray);
    }
    let decorated = spread(module.module_ref());
    for i in module.module_ref().all_inst_iter() {
        let is_load = i.class.opcode == Op::Load;
        let pointer = ids(i).next().filter(|p| is_load && decorated.contains(p));
        if pointer.is_none() {
            continue;
        }
        let loaded = i.result_type.and_then(|ty| types.get(&ty));
        capabilities.extend(loaded.and_then(non_uniform));
    }
    let has = non_uniforms(module.module_ref());
    let mut new: Vec<u32> = decorated.difference(&has).copied().collect();
    new.sort_unstable();
    for id in new {
        module.decorate(id, Decoration::NonUniform, []);
    }
    if capabilities.is_empty() {
        return;
    }
    for capability in capabilities {
        let operand = Operand::Capability(capability);
        let declared = &module.module_ref().capabilities;
        if !declared.iter().any(|i| i.operands.contains(&operand)) {
            module.capability(capability);
        }
    }
    let name = Operand::LiteralString(EXTENSION.to_owned());
    let extensions = &module.module_ref().extensions;
    if !extensions.iter().any(|i| i.operands.contains(&name)) {
        module.extension(EXTENSION);
    }
}

/// Decorates the structs that are elements of arrays of blocks.
fn decorate_blocks(module: &mut Builder) {
    let types = globals(module.module_ref());
    let element = |variable: &Instruction| {
        let class = storage_class(variable)?;
        let is_block = matches!(class, StorageClass::Uniform | StorageClass::StorageBuffer);
        let array = types.get(&pointee(module.module_ref(), variable.result_type?)?)?;
        let is_array = matches!(array.class.opcode, Op::TypeArray | Op::TypeRuntimeArray);
        let element = types.get(&ids(array).next()?)?;
        let is_struct = element.class.opcode == Op::TypeStruct;
        (is_block && is_array && is_struct).then_some(element.result_id?)
    };
    let variables = types.values().filter(|i| i.class.opcode == Op::Variable);
    let mut blocks: Vec<u32> = variables.filter_map(element).collect();
    blocks.sort_unstable();
    blocks.dedup();
    let has = decorations(module.module_ref(), Decoration::Block);
    for id in blocks.into_iter().filter(|id| !has.contains_key(id)) {
        module.decorate(id, Decoration::Block, []);
    }
}

/// Whether a variable is a binding array without a length.
fn is_unsized(module: &Module, types: &HashMap<u32, Instruction>, variable: &Instruction) -> bool {
    let pointee = variable.result_type.and_then(|ty| pointee(module, ty));
    let of = pointee.and_then(|ty| types.get(&ty));
    variable.class.opcode == Op::Variable
        && of.is_some_and(|of| of.class.opcode == Op::TypeRuntimeArray)
}

/// Ids that are decorated `NonUniform`.
fn non_uniforms(module: &Module) -> HashSet<u32> {
    let decoration = Operand::Decoration(Decoration::NonUniform);
    let all = module.annotations.iter();
    all.filter(|i| i.operands.get(1) == Some(&decoration))
        .filter_map(|i| ids(i).next())
        .collect()
}

/// [`non_uniforms`], and the textures and samplers that are made of them.
fn spread(module: &Module) -> HashSet<u32> {
    let mut out = non_uniforms(module);
    if out.is_empty() {
        return out;
    }
    for i in module.all_inst_iter() {
        let makes = matches!(i.class.opcode, Op::Load | Op::Image | Op::SampledImage);
        if makes && ids(i).any(|id| out.contains(&id)) {
            out.extend(i.result_id);
        }
    }
    out
}

/// The capability to load such a value by an index that differs between invocations.
fn non_uniform(loaded: &Instruction) -> Option<Capability> {
    match loaded.class.opcode {
        Op::TypeSampledImage | Op::TypeSampler => {
            Some(Capability::SampledImageArrayNonUniformIndexing)
        }
        // A storage image, by its operand `Sampled`.
        Op::TypeImage if loaded.operands.get(5) == Some(&Operand::LiteralBit32(2)) => {
            Some(Capability::StorageImageArrayNonUniformIndexing)
        }
        Op::TypeImage => Some(Capability::SampledImageArrayNonUniformIndexing),
        _ => None,
    }
}
