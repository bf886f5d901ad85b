//! Makes one variable of the texture and the sampler that naga writes for a combined image sampler.
//!
//! ```text
//! %t = OpVariable %ptr_image              %t = OpVariable %ptr_sampled
//! %s = OpVariable %ptr_sampler
//! %1 = OpLoad %image %t                   %3 = OpLoad %sampled %t
//! %2 = OpLoad %sampler %s                 %1 = OpImage %image %3
//!                                         %2 = OpLoad %sampled %t
//! %4 = OpSampledImage %sampled %1 %2
//! %5 = OpImageSampleImplicitLod .. %4     %5 = OpImageSampleImplicitLod .. %2
//! %6 = OpImageQueryLevels .. %1           %6 = OpImageQueryLevels .. %1
//! ```
//!
//! A function that receives both gets the combined one twice.

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};

use rspirv::dr::{Builder, Instruction, Operand};
use rspirv::spirv::{Decoration, Op, StorageClass};

use super::interface;
use crate::emit::combined::{BindingPlace, Combined};
use naga_spirv::words::{ids, pointee, replace_ids, rewrite};

/// The replacement for a variable or parameter of a texture or a sampler.
#[derive(Clone)]
struct SampledSource {
    sampled: u32,
    /// The type of the texture, if it was one.
    image: Option<u32>,
    variable: u32,
    /// The type of a pointer to an element, and its index.
    element: Option<(u32, u32)>,
    /// Of a binding array: the type of a pointer to an element.
    array: Option<u32>,
    /// The index that selected it of a binding array.
    index: Option<u32>,
}

impl SampledSource {
    /// Writes the access chain to the element, if there is one, and returns the pointer.
    fn pointer(&self, module: &mut Builder, block: &mut Vec<Instruction>) -> u32 {
        let Some((pointer, index)) = self.element else {
            return self.variable;
        };
        let element = module.id();
        let path = [self.variable, index].map(Operand::IdRef).to_vec();
        block.push(Instruction::new(
            Op::AccessChain,
            Some(pointer),
            Some(element),
            path,
        ));
        element
    }
}

/// Combines the variables of `all`. `None` if one has an unexpected form.
pub(super) fn combine(module: &mut Builder, all: &[Combined]) -> Option<()> {
    let mut sources = declare(module, all)?;
    if sources.is_empty() {
        return Some(());
    }
    parameters(module, &mut sources)?;
    let mut samplers: HashSet<u32> = HashSet::new();
    // Of each load, the index in a binding array.
    let mut indices: HashMap<u32, Option<u32>> = HashMap::new();
    let mut is_passed = false;
    rewrite(module, |module, block, mut instruction| {
        let is_call = instruction.class.opcode == Op::FunctionCall;
        if is_call {
            for operand in instruction
                .operands
                .iter_mut()
                .filter_map(Operand::id_ref_any_mut)
            {
                if let Some(source) = sources.get(operand) {
                    is_passed |= source.index.is_some() || source.array.is_some();
                    *operand = source.pointer(module, block);
                }
            }
        }
        let source = ids(&instruction).next().and_then(|id| sources.get(&id));
        if let (Op::AccessChain, Some(array), Some(result)) = (
            instruction.class.opcode,
            source.filter(|s| s.array.is_some()).cloned(),
            instruction.result_id,
        ) {
            instruction.result_type = array.array;
            if let Some(base) = instruction.operands.first_mut() {
                *base = Operand::IdRef(array.variable);
            }
            let element = SampledSource {
                variable: result,
                array: None,
                index: ids(&instruction).nth(1),
                ..array
            };
            sources.insert(result, element);
            block.push(instruction);
            return;
        }
        let (Op::Load, Some(source), Some(result)) =
            (instruction.class.opcode, source, instruction.result_id)
        else {
            block.push(instruction);
            return;
        };
        indices.insert(result, source.index);
        let pointer = vec![Operand::IdRef(source.pointer(module, block))];
        let load = |id| Instruction::new(Op::Load, Some(source.sampled), Some(id), pointer);
        match source.image {
            None => {
                samplers.insert(result);
                block.push(load(result));
            }
            Some(image) => {
                let sampled = module.id();
                block.push(load(sampled));
                let of = vec![Operand::IdRef(sampled)];
                block.push(Instruction::new(Op::Image, Some(image), Some(result), of));
            }
        }
    });
    sample(module, &samplers, &indices)?;
    drop_unused(module);
    // naga passes no elements of binding arrays to functions.
    (!is_passed).then_some(())
}

/// The lines of the interface after [`combine`].
pub(super) fn expected(mut lines: Vec<String>, all: &[Combined]) -> Vec<String> {
    let mut places = BTreeSet::new();
    for combined in all {
        let [texture, sampler] = [combined.texture, combined.sampler].map(interface::bound);
        if lines.contains(&texture) {
            lines.retain(|l| *l != texture && *l != sampler);
            places.insert(combined.place);
        }
    }
    lines.extend(places.into_iter().map(interface::bound));
    lines.sort();
    lines
}

/// Declares the combined variables. Returns the variable to load in place of each old one.
fn declare(module: &mut Builder, all: &[Combined]) -> Option<HashMap<u32, SampledSource>> {
    let mut sources = HashMap::new();
    let mut arrays: BTreeMap<BindingPlace, (u32, u32)> = BTreeMap::new();
    // One may move to a place that another one leaves.
    let variables = all.iter().filter_map(|combined| {
        let texture = variable_at(module, combined.texture)?;
        Some((combined, texture, variable_at(module, combined.sampler)))
    });
    let variables: Vec<_> = variables.collect();
    for (combined, texture, sampler) in variables {
        let pointer = take(module, texture)?;
        let texture_type = pointee(module.module_ref(), pointer)?;
        let class = StorageClass::UniformConstant;
        let [length, image] = array(module, texture_type)?;
        let image = image.unwrap_or(texture_type);
        let sampled = module.type_sampled_image(image);
        let mut pointer = module.type_pointer(None, class, sampled);
        let is_array = image != texture_type;
        let array = is_array.then_some(pointer);
        if is_array {
            let all = match length {
                Some(length) => module.type_array(sampled, length),
                None => module.type_runtime_array(sampled),
            };
            pointer = module.type_pointer(None, class, all);
        }
        let (variable, element) = match combined.element {
            None => (texture, None),
            Some((index, length)) => {
                let (variable, uint) = *arrays.entry(combined.place).or_insert_with(|| {
                    let uint = module.type_int(32, 0);
                    let length = module.constant_bit32(uint, length);
                    let array = module.type_array(sampled, length);
                    let pointer = module.type_pointer(None, class, array);
                    (module.variable(pointer, None, class, None), uint)
                });
                (
                    variable,
                    Some((pointer, module.constant_bit32(uint, index))),
                )
            }
        };
        let is_new = decorated(module, variable).is_none();
        for old in [Some(texture), sampler].into_iter().flatten() {
            undecorate(module, old, old != variable);
        }
        if let Some(sampler) = sampler {
            take(module, sampler)?;
        }
        if element.is_none() {
            module.variable(pointer, Some(variable), class, None);
        } else if is_new {
            module.name(variable, combined.root());
        }
        if element.is_none() || is_new {
            let (set, binding) = combined.place;
            for (decoration, n) in [
                (Decoration::DescriptorSet, set),
                (Decoration::Binding, binding),
            ] {
                module.decorate(variable, decoration, [Operand::LiteralBit32(n)]);
            }
        }
        let source = |image| SampledSource {
            sampled,
            image,
            variable,
            element,
            array,
            index: None,
        };
        sources.insert(texture, source(Some(image)));
        sources.extend(sampler.map(|sampler| (sampler, source(None))));
    }
    Some(sources)
}

/// Length and elements of a binding array's type: ids of a constant and a type.
fn array(module: &Builder, ty: u32) -> Option<[Option<u32>; 2]> {
    let mut types = module.module_ref().types_global_values.iter();
    let ty = types.find(|i| i.result_id == Some(ty))?;
    let mut operands = ids(ty);
    Some(match ty.class.opcode {
        Op::TypeArray | Op::TypeRuntimeArray => {
            let element = operands.next();
            [operands.next(), element]
        }
        _ => [None, None],
    })
}

fn variable_at(module: &Builder, (set, binding): BindingPlace) -> Option<u32> {
    let decorations = interface::decorations(module.module_ref());
    let is = |id: u32, decoration, n| {
        decorations.get(&(id, decoration)) == Some(&&Operand::LiteralBit32(n))
    };
    let mut all = decorations.keys().map(|(id, _)| *id);
    all.find(|id| is(*id, Decoration::DescriptorSet, set) && is(*id, Decoration::Binding, binding))
}

fn decorated(module: &Builder, variable: u32) -> Option<()> {
    let decorations = interface::decorations(module.module_ref());
    decorations
        .contains_key(&(variable, Decoration::Binding))
        .then_some(())
}

/// Removes a global variable, and returns the type of its pointer.
fn take(module: &mut Builder, variable: u32) -> Option<u32> {
    let globals = &mut module.module_mut().types_global_values;
    let at = globals.iter().position(|i| i.result_id == Some(variable))?;
    globals.remove(at).result_type
}

/// Removes the decorations of a variable, and its name if it is gone.
fn undecorate(module: &mut Builder, variable: u32, is_gone: bool) {
    let module = module.module_mut();
    let is_of = |i: &Instruction| ids(i).next() == Some(variable);
    module.annotations.retain(|i| !is_of(i));
    module.debug_names.retain(|i| !(is_gone && is_of(i)));
}

/// Changes the types of the parameters that receive one of `sources`, and adds them.
fn parameters(module: &mut Builder, sources: &mut HashMap<u32, SampledSource>) -> Option<()> {
    loop {
        let mut found = None;
        let functions = &module.module_ref().functions;
        let calls = functions.iter().flat_map(|f| f.all_inst_iter());
        for call in calls.filter(|i| i.class.opcode == Op::FunctionCall) {
            let mut operands = ids(call);
            let callee = operands.next();
            let at = functions.iter().position(|f| f.def_id() == callee)?;
            for (i, argument) in operands.enumerate() {
                let own = functions[at].parameters.get(i)?.result_id?;
                if let (Some(source), false) = (sources.get(&argument), sources.contains_key(&own))
                {
                    found = Some((at, i, own, source.clone()));
                }
            }
        }
        let Some((at, i, own, source)) = found else {
            return Some(());
        };
        let class = StorageClass::UniformConstant;
        let pointer = module.type_pointer(None, class, source.sampled);
        let function = &mut module.module_mut().functions[at];
        function.parameters[i].result_type = Some(pointer);
        let types = function.parameters.iter().filter_map(|p| p.result_type);
        let types: Vec<u32> = types.collect();
        let result = function.def.as_ref()?.result_type?;
        let ty = module.type_function(result, types);
        let function = &mut module.module_mut().functions[at];
        *function.def.as_mut()?.operands.get_mut(1)? = Operand::IdRef(ty);
        let received = SampledSource {
            variable: own,
            element: None,
            ..source
        };
        sources.insert(own, received);
    }
}

/// Samples the combined values themselves. `None` if a texture meets a sampler with another index.
fn sample(
    module: &mut Builder,
    samplers: &HashSet<u32>,
    indices: &HashMap<u32, Option<u32>>,
) -> Option<()> {
    let mut replaced = HashMap::new();
    let mut is_mixed = false;
    rewrite(module, |_, block, instruction| {
        let [image, sampler] = [0, 1].map(|n| ids(&instruction).nth(n));
        match (instruction.class.opcode, sampler, instruction.result_id) {
            (Op::SampledImage, Some(sampler), Some(result)) if samplers.contains(&sampler) => {
                let index = |id: Option<u32>| id.and_then(|id| indices.get(&id));
                is_mixed |= index(image) != index(Some(sampler));
                replaced.insert(result, sampler);
            }
            _ => block.push(instruction),
        }
    });
    replace_ids(module, &replaced);
    (!is_mixed).then_some(())
}

/// Drops loads of textures and samplers that nothing reads now.
fn drop_unused(module: &mut Builder) {
    // An `OpImage` reads a load, which may read an access chain.
    for _ in 0..3 {
        let functions = module.module_ref().functions.iter();
        let read: HashSet<u32> = functions
            .flat_map(|f| f.all_inst_iter())
            .flat_map(ids)
            .collect();
        let handles: HashSet<u32> = handle_types(module);
        rewrite(module, |_, block, instruction| {
            let is_handle = instruction
                .result_type
                .is_some_and(|ty| handles.contains(&ty));
            let is_read = instruction.result_id.is_some_and(|id| read.contains(&id));
            let op = instruction.class.opcode;
            if !(is_handle && !is_read && matches!(op, Op::Load | Op::Image | Op::AccessChain)) {
                block.push(instruction);
            }
        });
    }
    let all = module.module_ref().all_inst_iter();
    let defined: HashSet<u32> = all.filter_map(|i| i.result_id).collect();
    let is_there = |i: &Instruction| ids(i).next().is_none_or(|id| defined.contains(&id));
    let module = module.module_mut();
    module.annotations.retain(is_there);
    module.debug_names.retain(is_there);
}

/// The types of textures, samplers, combined samplers, and of pointers to them.
fn handle_types(module: &Builder) -> HashSet<u32> {
    let types = module.module_ref().types_global_values.iter();
    let is_handle = |i: &&Instruction| match i.class.opcode {
        Op::TypeImage | Op::TypeSampler | Op::TypeSampledImage => true,
        Op::TypePointer => {
            i.operands.first() == Some(&Operand::StorageClass(StorageClass::UniformConstant))
        }
        _ => false,
    };
    types
        .filter(is_handle)
        .filter_map(|i| i.result_id)
        .collect()
}
