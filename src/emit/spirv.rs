//! Writes an entry point as a SPIR-V 1.3 module for Vulkan.
//!
//! Positions are not flipped, so a Vulkan host needs a viewport of negative height, as WebGPU uses
//! on Vulkan. There are no bounds checks on indices or loops. Integer division by zero is defined
//! as in WGSL, and fragment depth is clamped to the viewport's range.

use std::collections::BTreeMap;

use naga::back::spv::{Options, PipelineOptions, WriterFlags, ZeroInitializeWorkgroupMemoryMode};
use naga::front::spv as reader;
use naga::{Binding, BuiltIn, Module, ShaderStage};
use preshade_passes::program::Program;
use preshade_passes::reflect;

mod position;

use super::overrides::{self, Settled};
use super::partial_pointers;
use super::{Error, Target};
use crate::wgsl::fingerprint;

/// Words before the first instruction (SPIR-V 2.3).
const HEADER: usize = 5;
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

/// The little-endian bytes, and the values that replace overrides. `name` is the file's, for
/// errors.
pub(super) fn write(
    program: &Program,
    stage: ShaderStage,
    entry: &str,
    name: &str,
) -> Result<(Vec<u8>, BTreeMap<String, f64>), Error> {
    if let Some(message) = partial_pointers::find(program) {
        return Err(Error::Writer {
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
            Error::Writer {
                file: name.to_owned(),
                target: Target::Spirv,
                message: e.to_string(),
            }
        })?;
    if has_invariant_position(module, stage, entry) {
        words = forbid_contraction(&words);
    }
    let bytes: Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).collect();
    let wanted = fingerprint::interface(module, info, stage, entry);
    check(program, &wanted, &bytes, stage, entry, name)?;
    Ok((
        bytes,
        settled.map(|s| s.values(program)).unwrap_or_default(),
    ))
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

/// Reads the bytes back, validates them, and compares the stage's interface.
fn check(
    program: &Program,
    wanted: &[String],
    bytes: &[u8],
    stage: ShaderStage,
    entry: &str,
    name: &str,
) -> Result<(), Error> {
    let differs = |difference: String| Error::Differs {
        file: name.to_owned(),
        target: Target::Spirv,
        difference,
    };
    let options = reader::Options {
        adjust_coordinate_space: false,
        strict_capabilities: false,
        block_ctx_dump_prefix: None,
    };
    let bytes = for_the_reader(bytes);
    let read = reader::parse_u8_slice(&bytes, &options)
        .map_err(|e| differs(format!("it does not parse: {e}")))?;
    let read = program
        .with_module(read)
        .map_err(|invalid| differs(format!("it is not valid: {invalid}")))?;
    let found = fingerprint::interface(read.module(), read.info(), stage, entry);
    match fingerprint::difference(wanted, &found) {
        Some(difference) => Err(differs(difference)),
        None => Ok(()),
    }
}

/// Works around defects of naga's reader, for validation only. `OpImageQuerySizeLod` (SPIR-V
/// 3.52.10) of an arrayed image drops the number of layers, so the first component replaces it.
/// `OpLogicalAnd` and `OpLogicalOr` are read as scalar operators, so `OpLogicalEqual` replaces them
/// for vectors.
fn for_the_reader(bytes: &[u8]) -> Vec<u8> {
    let mut words: Vec<u32> = bytes
        .chunks_exact(4)
        .map(|w| u32::from_le_bytes([w[0], w[1], w[2], w[3]]))
        .collect();
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
    words.iter().flat_map(|w| w.to_le_bytes()).collect()
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
