//! Writes an entry point as a SPIR-V 1.3 module for Vulkan.
//!
//! Positions are not flipped. For WGSL, whose y points up, a Vulkan host needs a viewport of negative
//! height, as WebGPU uses on Vulkan; Vulkan's GLSL has its own direction. There are no bounds checks on indices or loops. Integer division by zero is defined
//! as in WGSL, and fragment depth is clamped to the viewport's range.

use naga::back::spv::{Options, PipelineOptions, WriterFlags, ZeroInitializeWorkgroupMemoryMode};
use naga::front::spv as reader;
use naga::{Binding, BuiltIn, Module, ShaderStage};
use naga_edit::interface as program_interface;
use preshade_plan::program::Program;
use rspirv::binary::Assemble;
use rspirv::dr::{self, Builder, Instruction, Operand};
use rspirv::spirv::{self, Decoration, Op};

mod binding_arrays;
mod blocks;
mod combined;
mod constants;
mod demote;
mod interface;
mod nan_selects;
mod narrow;
mod rows;
mod sample_mask;

use super::combined::{Combined, CombinedSamplers};
use super::overrides::{SpecIds, Specialised};
use super::{EmitError, ReadBack, partial_pointers};
use crate::wgsl::fingerprint;
use naga_spirv::instructions;
use naga_spirv::words::{position, to_bytes};
use preshade_plan::plan_file::{StageFile, Target};

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
    let demoting = demote::marked(program);
    let program = demoting.as_ref().unwrap_or(program);
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
    // naga's reader takes no arrays whose lengths are specialisation constants either.
    for (length, default) in constants::size(&mut words, &program.declared().lengths, module) {
        stage_file.add_length(length, default);
    }
    match demoting.is_some() {
        true => demote::write(&mut words),
        false if program.declared().demotes && stage == ShaderStage::Fragment => {
            let note = "`discard` ends the invocation here, where yours demotes it: a function ends \
                        with it";
            stage_file.notes.push(format!("{name}: {note}"));
        }
        false => {}
    }
    nan_selects::choose(&mut words);
    sample_mask::as_arrays(&mut words);
    binding_arrays::declare(&mut words);
    draw_parameters(&mut words);
    if !rows::turn(&mut words, program.declared()) {
        let note = "a `row_major` matrix is declared as its transpose, which is the same memory";
        stage_file.notes.push(format!("{name}: {note}"));
    }
    rows::rename_copies(&mut words, program.declared());
    if stage == ShaderStage::Fragment {
        narrow::narrow(&mut words, program.declared());
    }
    if program.declared().mains.contains(&stage) {
        // Hosts give pipelines the author's name, and each stage has a file of its own.
        stage_file.entry_point = "main".to_owned();
        for entry in &mut words.module_mut().entry_points {
            if let Some(Operand::LiteralString(name)) = entry.operands.get_mut(2) {
                name.clone_from(&stage_file.entry_point);
            }
        }
    }
    Ok((to_bytes(&words.module().assemble()), stage_file))
}

/// Declares the capability of `gl_BaseVertex` and the like, which naga leaves out.
fn draw_parameters(words: &mut Builder) {
    let is_parameter = |i: &Instruction| {
        let Some(Operand::BuiltIn(of)) = i.operands.get(2) else {
            return false;
        };
        matches!(
            of,
            spirv::BuiltIn::BaseVertex | spirv::BuiltIn::BaseInstance | spirv::BuiltIn::DrawIndex
        )
    };
    if words.module_ref().annotations.iter().any(is_parameter) {
        words.capability(spirv::Capability::DrawParameters);
    }
}

fn has_invariant_position(module: &Module, stage: ShaderStage, entry: &str) -> bool {
    module
        .entry_points
        .iter()
        .filter(|e| e.stage == stage && e.name == entry)
        .flat_map(|e| program_interface::outputs(module, &e.function))
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
    let mut readable = Builder::new_from_module(words.clone());
    if let Err(lost) = instructions::replace(&mut readable) {
        return ReadBack::Unread(lost.what.to_owned());
    }
    let bytes = to_bytes(&readable.module().assemble());
    let read = match reader::parse_u8_slice(&bytes, &options) {
        Ok(mut read) => {
            instructions::layers(&mut read);
            read
        }
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
            .flat_map(naga_spirv::words::ids)
            .collect();
        assert_eq!(decorated, [7, 9]);
    }
}
