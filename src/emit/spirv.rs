//! Writes an entry point as a SPIR-V 1.3 module for Vulkan.
//!
//! Positions are not flipped. For WGSL, whose y points up, a Vulkan host needs a viewport of negative
//! height, as WebGPU uses on Vulkan; Vulkan's GLSL has its own direction. There are no bounds checks on indices or loops. Integer division by zero is defined
//! as in WGSL, and fragment depth is clamped to the viewport's range.

use std::collections::HashMap;

use naga::back::spv::{Options, PipelineOptions, WriterFlags, ZeroInitializeWorkgroupMemoryMode};
use naga::front::spv as reader;
use naga::{Binding, BuiltIn, Module, ShaderStage};
use preshade_passes::program::Program;
use preshade_passes::reflect;
use rspirv::binary::Assemble;
use rspirv::dr::{self, Builder, Instruction, Operand};
use rspirv::spirv::{Decoration, Op};

mod blocks;
mod combined;
mod constants;
mod interface;
mod position;
mod sample_mask;

use super::combined::{Combined, CombinedSamplers};
use super::overrides::{SpecIds, Specialised};
use super::partial_pointers;
use super::plan_json::StageFile;
use super::{EmitError, ReadBack, Target};
use crate::wgsl::fingerprint;

/// Writes the little-endian bytes and their `plan.json` entry. `name` is the file's.
pub(super) fn write(
    program: &Program,
    stage: ShaderStage,
    entry: &str,
    name: &str,
    ids: &SpecIds,
    pairs: &CombinedSamplers,
) -> Result<(Vec<u8>, StageFile), EmitError> {
    let failed = |message: String| EmitError::Writer {
        file: name.to_owned(),
        target: Target::Spirv,
        message,
    };
    if let Some(message) = partial_pointers::find(program) {
        return Err(failed(message));
    }
    let without_padding = blocks::without_padding(program);
    let program = without_padding.as_ref().unwrap_or(program);
    let specialised = Specialised::of(program, (stage, entry), ids, name, Target::Spirv)?;
    let (module, info) = specialised.module();
    let options = Options {
        lang_version: (1, 3),
        flags: WriterFlags::LABEL_VARYINGS | WriterFlags::CLAMP_FRAG_DEPTH | WriterFlags::DEBUG,
        force_loop_bounding: false,
        zero_initialize_workgroup_memory: ZeroInitializeWorkgroupMemoryMode::None,
        ..Options::default()
    };
    let pipeline = PipelineOptions {
        shader_stage: stage,
        entry_point: entry.to_owned(),
    };
    let words = naga::back::spv::write_vec(module, info, &options, Some(&pipeline))
        .map_err(|e| failed(e.to_string()))?;
    let read = dr::load_words(words).map_err(|e| failed(e.to_string()))?;
    let mut words = Builder::new_from_module(read);
    let unexpected = |what: &str| failed(format!("{what} has an unexpected form in naga's words"));
    constants::declare(&mut words, &specialised.variables)
        .ok_or_else(|| unexpected("an override"))?;
    blocks::unwrap(&mut words);
    if has_invariant_position(module, stage, entry) {
        forbid_contraction(&mut words);
    }
    let mut resources = fingerprint::bindings(module, info, stage, entry);
    let constants = specialised.variables.iter();
    resources.extend(constants.map(|v| format!("specialisation constant {}", v.constant.id)));
    let written = words.module_ref();
    let read = read_back(program, module, &resources, written, stage, entry);
    let mut stage_file = specialised.stage_file(name, entry);
    stage_file.unread = read.unread(name, Target::Spirv)?;
    let before = interface::lines(words.module_ref());
    let is_read = |c: &&Combined| before.contains(&interface::bound(c.texture));
    let listed = pairs.all.iter().filter(is_read).map(Combined::listed);
    stage_file.textures = listed.collect();
    stage_file.notes.extend(pairs.notes.iter().cloned());
    combined::combine(&mut words, &pairs.all).ok_or_else(|| unexpected("a combined sampler"))?;
    let wanted = combined::expected(before, &pairs.all);
    // naga's reader takes no combined samplers.
    if let Some(difference) =
        fingerprint::difference(&wanted, &interface::lines(words.module_ref()))
    {
        ReadBack::Differs(difference).unread(name, Target::Spirv)?;
    }
    sample_mask::as_arrays(&mut words);
    Ok((to_bytes(&words.module().assemble()), stage_file))
}

fn to_bytes(words: &[u32]) -> Vec<u8> {
    words.iter().flat_map(|w| w.to_le_bytes()).collect()
}

/// The ids among an instruction's operands.
fn ids(instruction: &Instruction) -> impl Iterator<Item = u32> {
    instruction.operands.iter().filter_map(Operand::id_ref_any)
}

/// The type to which a pointer type points.
fn pointee(module: &dr::Module, pointer: u32) -> Option<u32> {
    let mut types = module.types_global_values.iter();
    ids(types.find(|i| i.result_id == Some(pointer))?).next()
}

/// Writes the functions again: `change` gets each instruction, and writes what replaces it.
fn rewrite(
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
fn replace_ids(module: &mut Builder, with: &HashMap<u32, u32>) {
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

fn has_invariant_position(module: &Module, stage: ShaderStage, entry: &str) -> bool {
    module
        .entry_points
        .iter()
        .filter(|e| e.stage == stage && e.name == entry)
        .flat_map(|e| reflect::outputs(module, &e.function))
        .any(|o| o.binding == Some(Binding::BuiltIn(BuiltIn::Position { invariant: true })))
}

/// Adds `NoContraction` to float arithmetic that may affect the position: otherwise two pipelines
/// may fuse a multiply and an add differently, in spite of `Invariant`. If the analysis fails, all
/// arithmetic is decorated.
fn forbid_contraction(words: &mut Builder) {
    let slice = position::slice(words.module_ref());
    let decides = |id: &u32| slice.as_ref().is_none_or(|slice| slice.contains(id));
    let all = words.module_ref().all_inst_iter();
    let arithmetic = all.filter(|i| is_float_arithmetic(i.class.opcode));
    let decorated: Vec<u32> = arithmetic
        .filter_map(|i| i.result_id)
        .filter(decides)
        .collect();
    for id in decorated {
        words.decorate(id, Decoration::NoContraction, []);
    }
}

fn is_float_arithmetic(opcode: Op) -> bool {
    use Op::{FAdd, FDiv, FMod, FMul, FNegate, FRem, FSub};
    matches!(opcode, FNegate | FAdd | FSub | FMul | FDiv | FRem | FMod)
        || (Op::VectorTimesScalar as u32..=Op::Dot as u32).contains(&(opcode as u32))
}

/// Compares the stage's interface with the words, and, if naga can read them, with the module that
/// they make. `resources` are the lines of bindings and specialisation constants.
fn read_back(
    program: &Program,
    module: &Module,
    resources: &[String],
    words: &dr::Module,
    stage: ShaderStage,
    entry: &str,
) -> ReadBack {
    let wanted = fingerprint::interface(module, stage, entry);
    let untyped = |line: &String| line.split(':').next().unwrap_or(line).to_owned();
    let mut names: Vec<String> = wanted.iter().map(untyped).collect();
    names.extend_from_slice(resources);
    names.sort();
    if let Some(difference) = fingerprint::difference(&names, &interface::lines(words)) {
        return ReadBack::Differs(difference);
    }
    if let Some(what) = interface::unreadable(words) {
        return ReadBack::Unread(what.to_owned());
    }
    let options = reader::Options {
        adjust_coordinate_space: false,
        strict_capabilities: false,
        block_ctx_dump_prefix: None,
    };
    let bytes = to_bytes(&for_the_reader(words).assemble());
    let read = match reader::parse_u8_slice(&bytes, &options) {
        Ok(read) => read,
        Err(
            e @ (reader::Error::UnsupportedInstruction(..)
            | reader::Error::UnsupportedExtension(_)
            | reader::Error::UnsupportedCapability(_)
            | reader::Error::UnsupportedExtInst(_)),
        ) => return ReadBack::Unread(e.to_string().replace("unsupported ", "the ")),
        Err(e) => return ReadBack::Differs(format!("it does not parse: {e}")),
    };
    let found = match program.with_module(read) {
        Ok(read) => fingerprint::interface(read.module(), stage, entry),
        Err(invalid) => return ReadBack::Differs(format!("it is not valid: {invalid}")),
    };
    match fingerprint::difference(&wanted, &found) {
        Some(difference) => ReadBack::Differs(difference),
        None => ReadBack::Same,
    }
}

/// Works around defects of naga's reader, for validation only. `OpImageQuerySizeLod` (SPIR-V
/// 3.52.10) of an arrayed image drops the number of layers, so the first component replaces it.
/// `OpLogicalAnd` and `OpLogicalOr` are read as scalar operators, so `OpLogicalEqual` replaces them
/// for vectors.
fn for_the_reader(words: &dr::Module) -> dr::Module {
    let mut words = words.clone();
    let mut sizes = Vec::new();
    let mut vectors = Vec::new();
    for instruction in words.all_inst_iter_mut() {
        let (ty, id) = (instruction.result_type, instruction.result_id);
        match instruction.class.opcode {
            Op::TypeVector => vectors.push(id),
            Op::ImageQuerySizeLod | Op::ImageQuerySize => sizes.push(id),
            Op::CompositeExtract
                if sizes.contains(&instruction.operands.first().and_then(Operand::id_ref_any)) =>
            {
                instruction.operands[1] = Operand::LiteralBit32(0);
            }
            Op::LogicalOr | Op::LogicalAnd if vectors.contains(&ty) => {
                let operands = std::mem::take(&mut instruction.operands);
                *instruction = Instruction::new(Op::LogicalEqual, ty, id, operands);
            }
            _ => {}
        }
    }
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn float_arithmetic_is_decorated() {
        let mut words = Builder::new();
        let float = words.type_float(32, None);
        let add = |op, id| {
            let operands = vec![Operand::IdRef(90), Operand::IdRef(91)];
            Instruction::new(op, Some(float), Some(id), operands)
        };
        let all = [add(Op::FAdd, 7), add(Op::IAdd, 8), add(Op::Dot, 9)];
        words.module_mut().types_global_values.extend(all);
        forbid_contraction(&mut words);
        let decorated: Vec<u32> = words
            .module_ref()
            .annotations
            .iter()
            .flat_map(ids)
            .collect();
        assert_eq!(decorated, [7, 9]);
    }
}
