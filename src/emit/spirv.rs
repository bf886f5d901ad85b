//! Writes an entry point as a SPIR-V 1.3 module for Vulkan.
//!
//! Positions are not flipped, so a Vulkan host needs a viewport of negative height, as WebGPU uses
//! on Vulkan. There are no bounds checks on indices or loops. Integer division by zero is defined
//! as in WGSL, and fragment depth is clamped to the viewport's range.

use naga::back::spv::{Options, PipelineOptions, WriterFlags, ZeroInitializeWorkgroupMemoryMode};
use naga::front::spv as reader;
use naga::valid::ModuleInfo;
use naga::{Binding, BuiltIn, Module, ShaderStage};
use preshade_passes::program::Program;
use preshade_passes::reflect;

mod interface;
mod position;
mod sample_mask;

use super::overrides::{self, Settled};
use super::partial_pointers;
use super::plan_json::StageFile;
use super::{EmitError, ReadBack, Target};
use crate::wgsl::fingerprint;

/// Words before the first instruction (SPIR-V 2.3).
const HEADER: usize = 5;
const OP_EXT_INST: u16 = 12;
const OP_TYPE_INT: u16 = 21;
const OP_TYPE_POINTER: u16 = 32;
const OP_VARIABLE: u16 = 59;
const OP_DECORATE: u16 = 71;
const OP_MEMBER_DECORATE: u16 = 72;
/// Opcodes of type declarations, from `OpTypeVoid`.
const OP_TYPES: std::ops::RangeInclusive<u16> = 19..=39;
const NO_CONTRACTION: u32 = 42;
const OP_TYPE_VECTOR: u16 = 23;
const OP_COMPOSITE_EXTRACT: u16 = 81;
const OP_IMAGE_QUERY_SIZE_LOD: u16 = 103;
const OP_IMAGE_QUERY_SIZE: u16 = 104;
const OP_LOGICAL_EQUAL: u16 = 164;
const OP_LOGICAL_OR: u16 = 166;
const OP_LOGICAL_AND: u16 = 167;

/// Writes the little-endian bytes and their `plan.json` entry. `name` is the file's.
pub(super) fn write(
    program: &Program,
    stage: ShaderStage,
    entry: &str,
    name: &str,
) -> Result<(Vec<u8>, StageFile), EmitError> {
    if let Some(message) = partial_pointers::find(program) {
        return Err(EmitError::Writer {
            file: name.to_owned(),
            target: Target::Spirv,
            message,
        });
    }
    let settled = overrides::settle(program, stage, entry, name, Target::Spirv)?;
    let (module, info) = match &settled {
        Some(Settled { module, info }) => (module, info),
        None => (program.module(), program.info()),
    };
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
    let mut words =
        naga::back::spv::write_vec(module, info, &options, Some(&pipeline)).map_err(|e| {
            EmitError::Writer {
                file: name.to_owned(),
                target: Target::Spirv,
                message: e.to_string(),
            }
        })?;
    if has_invariant_position(module, stage, entry) {
        words = forbid_contraction(&words);
    }
    let read = read_back(program, (module, info), &words, stage, entry);
    let stage_file = StageFile {
        overrides: settled
            .as_ref()
            .map(|s| s.values(program))
            .unwrap_or_default(),
        unread: read.unread(name, Target::Spirv)?,
        ..StageFile::new(name, entry)
    };
    let words = sample_mask::as_arrays(&words);
    Ok((to_bytes(&words), stage_file))
}

fn to_bytes(words: &[u32]) -> Vec<u8> {
    words.iter().flat_map(|w| w.to_le_bytes()).collect()
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
fn forbid_contraction(words: &[u32]) -> Vec<u32> {
    let slice = position::slice(words);
    let decides = |id: &u32| slice.as_ref().is_none_or(|slice| slice.contains(id));
    let mut decorations = Vec::new();
    let mut at = None;
    for (start, opcode, operands) in instructions(words) {
        if at.is_none()
            && (opcode == OP_DECORATE || opcode == OP_MEMBER_DECORATE || OP_TYPES.contains(&opcode))
        {
            at = Some(start);
        }
        if let (true, Some(result)) = (is_float_arithmetic(opcode), operands.get(1))
            && decides(result)
        {
            decorations.extend([3 << 16 | u32::from(OP_DECORATE), *result, NO_CONTRACTION]);
        }
    }
    let at = at.unwrap_or(words.len());
    [&words[..at], &decorations, &words[at..]].concat()
}

/// Offset, opcode and operands of each instruction.
fn instructions(words: &[u32]) -> impl Iterator<Item = (usize, u16, &[u32])> {
    let mut at = HEADER;
    std::iter::from_fn(move || {
        let first = *words.get(at)?;
        let length = (first >> 16) as usize;
        let start = at;
        let operands = words.get(start + 1..start + length.max(1))?;
        at += length.max(1);
        Some((start, first as u16, operands))
    })
}

/// `OpFNegate`, `OpFAdd`, `OpFSub`, `OpFMul`, `OpFDiv`, `OpFRem`, `OpFMod`, and products from
/// `OpVectorTimesScalar` to `OpDot`.
fn is_float_arithmetic(opcode: u16) -> bool {
    matches!(opcode, 127 | 129 | 131 | 133 | 136 | 140 | 141 | 142..=148)
}

/// Compares the stage's interface with the words, and, if naga can read them, with the module that
/// they make.
fn read_back(
    program: &Program,
    (module, info): (&Module, &ModuleInfo),
    words: &[u32],
    stage: ShaderStage,
    entry: &str,
) -> ReadBack {
    let wanted = fingerprint::interface(module, stage, entry);
    let untyped = |line: &String| line.split(':').next().unwrap_or(line).to_owned();
    let mut names: Vec<String> = wanted.iter().map(untyped).collect();
    names.extend(fingerprint::bindings(module, info, stage, entry));
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
    let read = match reader::parse_u8_slice(&to_bytes(&for_the_reader(words)), &options) {
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
fn for_the_reader(words: &[u32]) -> Vec<u32> {
    let mut words = words.to_vec();
    let mut sizes = Vec::new();
    let mut vectors = Vec::new();
    let mut patches = Vec::new();
    for (start, opcode, operands) in instructions(&words) {
        match (opcode, operands) {
            (OP_TYPE_VECTOR, [result, ..]) => vectors.push(*result),
            (OP_IMAGE_QUERY_SIZE_LOD | OP_IMAGE_QUERY_SIZE, [_, result, ..]) => sizes.push(*result),
            (OP_COMPOSITE_EXTRACT, [_, _, of, _]) if sizes.contains(of) => {
                patches.push((start + 4, 0));
            }
            (OP_LOGICAL_OR | OP_LOGICAL_AND, [ty, ..]) if vectors.contains(ty) => {
                let length = words[start] & 0xffff_0000;
                patches.push((start, length | u32::from(OP_LOGICAL_EQUAL)));
            }
            _ => {}
        }
    }
    for (at, word) in patches {
        words[at] = word;
    }
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arithmetic_is_decorated_ahead_of_the_annotations() {
        // A header, one decoration, a float type, an OpFAdd 7 of type 6, an OpIAdd 8.
        let words = [
            0x0723_0203,
            0x0001_0300,
            0,
            9,
            0, //
            3 << 16 | 71,
            5,
            18, //
            3 << 16 | 22,
            6,
            32, //
            5 << 16 | 129,
            6,
            7,
            3,
            4, //
            5 << 16 | 128,
            2,
            8,
            3,
            4,
        ];
        let decorated = forbid_contraction(&words);
        let ops: Vec<(u16, Vec<u32>)> = instructions(&decorated)
            .map(|(_, op, operands)| (op, operands.to_vec()))
            .collect();
        assert_eq!(ops[0], (71, vec![7, NO_CONTRACTION]));
        assert_eq!(ops[1], (71, vec![5, 18]));
        assert_eq!(decorated.len(), words.len() + 3);
        assert_eq!(ops.len(), 5);
    }
}
