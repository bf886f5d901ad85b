//! What of an author's SPIR-V neither WebGPU nor naga's extensions of it can say.
//!
//! This is told by the words that glslang makes of the author's text, not by what preshade says of
//! it.

use rspirv::spirv::{BuiltIn, Capability, Op};

/// Capabilities that WebGPU's core or an extension of naga's has.
const SAYABLE: &[Capability] = {
    use Capability as C;
    &[
        C::Matrix,
        C::Shader,
        // Of `gl_PrimitiveID`; `gl_Layer` is told by its built-in.
        C::Geometry,
        C::ImageGatherExtended,
        C::ClipDistance,
        C::SampleRateShading,
        C::Sampled1D,
        C::Image1D,
        C::SampledCubeArray,
        C::StorageImageExtendedFormats,
        C::ImageQuery,
        C::DerivativeControl,
        C::Float16,
        C::StorageBuffer16BitAccess,
        C::UniformAndStorageBuffer16BitAccess,
        C::StoragePushConstant16,
        C::StorageInputOutput16,
        C::AtomicFloat32AddEXT,
        C::GroupNonUniform,
        C::GroupNonUniformVote,
        C::GroupNonUniformArithmetic,
        C::GroupNonUniformBallot,
        C::GroupNonUniformShuffle,
        C::GroupNonUniformShuffleRelative,
        C::GroupNonUniformQuad,
        C::MultiView,
        C::RuntimeDescriptorArray,
        C::ShaderNonUniform,
        C::UniformBufferArrayDynamicIndexing,
        C::SampledImageArrayDynamicIndexing,
        C::StorageBufferArrayDynamicIndexing,
        C::StorageImageArrayDynamicIndexing,
        C::UniformBufferArrayNonUniformIndexing,
        C::SampledImageArrayNonUniformIndexing,
        C::StorageBufferArrayNonUniformIndexing,
        C::StorageImageArrayNonUniformIndexing,
        C::FragmentBarycentricKHR,
        C::DemoteToHelperInvocation,
    ]
};

/// Built-ins that have no capability of their own, or share one with what is sayable.
const BUILT_INS: &[BuiltIn] = &[
    BuiltIn::PointCoord,
    BuiltIn::HelperInvocation,
    BuiltIn::SamplePosition,
    BuiltIn::Layer,
    BuiltIn::ViewportIndex,
];

/// An entry point of a vertex stage.
const VERTEX: u32 = 0;
const BUILT_IN: u32 = 11;
const POSITION: u32 = 0;
const PER_VERTEX: u32 = 5285;
const DIM_1D: u32 = 0;
const DIM_CUBE: u32 = 3;
/// Image operands: an offset that is no constant, and four of them.
const OFFSETS: u32 = 0x10 | 0x20;

/// The first thing in a file of SPIR-V that cannot be said.
pub fn unsayable(bytes: &[u8]) -> Option<String> {
    let words: Vec<u32> = bytes
        .as_chunks::<4>()
        .0
        .iter()
        .map(|w| u32::from_le_bytes(*w))
        .collect();
    let mut instructions: Vec<(Op, &[u32])> = Vec::new();
    let mut rest = words.get(5..)?;
    while let Some(&first) = rest.first() {
        let length = ((first >> 16) as usize).clamp(1, rest.len());
        let (instruction, after) = rest.split_at(length);
        if let Some(op) = Op::from_u32(first & 0xffff) {
            instructions.push((op, &instruction[1..]));
        }
        rest = after;
    }
    let mut all = instructions.iter();
    let of_one = all.find_map(|(op, operands)| of_instruction(*op, operands));
    of_one
        .or_else(|| image_atomic(&instructions))
        .or_else(|| position(&instructions))
}

/// An image atomic that returns something, or exchanges: those of naga's extension do neither.
fn image_atomic(all: &[(Op, &[u32])]) -> Option<String> {
    let texels = all.iter().filter(|(op, _)| *op == Op::ImageTexelPointer);
    let texels: Vec<u32> = texels.filter_map(|(_, o)| o.get(1).copied()).collect();
    let is_used = |id: u32| {
        let uses = all.iter().filter(|(_, o)| o[..].contains(&id)).count();
        // Itself, and perhaps a name.
        uses > 1
    };
    all.iter().find_map(|(op, operands)| {
        let is_texel = operands.get(2).is_some_and(|p| texels.contains(p));
        let is_atomic = format!("{op:?}").starts_with("Atomic");
        if !is_texel || !is_atomic {
            return None;
        }
        let exchanges = matches!(op, Op::AtomicExchange | Op::AtomicCompareExchange);
        (exchanges || is_used(operands[1])).then(|| "image atomic with a result".to_owned())
    })
}

/// A vertex stage that has no position: WebGPU's has one.
fn position(all: &[(Op, &[u32])]) -> Option<String> {
    let is_vertex = |(op, o): &(Op, &[u32])| *op == Op::EntryPoint && o[0] == VERTEX;
    if !all.iter().any(is_vertex) {
        return None;
    }
    let position = |(op, o): &(Op, &[u32])| match op {
        Op::MemberDecorate if o[2..] == [BUILT_IN, POSITION] => Some(o[0]),
        Op::Decorate if o[1..] == [BUILT_IN, POSITION] => Some(o[0]),
        _ => None,
    };
    let lacks = || Some("vertex stage without a position".to_owned());
    let Some(of) = all.iter().find_map(position) else {
        return lacks();
    };
    // The variable of the block that has it, or the variable itself.
    let pointer = |(op, o): &(Op, &[u32])| {
        let is = *op == Op::TypePointer && o[2] == of;
        is.then(|| o[0])
    };
    let pointer = all.iter().find_map(pointer);
    let variable = |(op, o): &(Op, &[u32])| {
        let is = *op == Op::Variable && Some(o[0]) == pointer;
        is.then(|| o[1])
    };
    let variable = all.iter().find_map(variable).unwrap_or(of);
    let writes = |(op, o): &(Op, &[u32])| match op {
        Op::Store => o[0] == variable,
        Op::AccessChain => o[2] == variable,
        Op::FunctionCall => o.contains(&variable),
        _ => false,
    };
    match all.iter().any(writes) {
        true => None,
        false => lacks(),
    }
}

fn of_instruction(op: Op, operands: &[u32]) -> Option<String> {
    let at = |i: usize| operands.get(i).copied().unwrap_or_default();
    match op {
        Op::Capability => match Capability::from_u32(at(0)) {
            Some(capability) if SAYABLE.contains(&capability) => None,
            Some(capability) => Some(format!("{capability:?}")),
            None => Some(format!("capability {}", at(0))),
        },
        Op::Decorate if at(1) == BUILT_IN => built_in(at(2)),
        Op::MemberDecorate if at(2) == BUILT_IN => built_in(at(3)),
        Op::Decorate if at(1) == PER_VERTEX => Some("PerVertexKHR".to_owned()),
        Op::TypeImage => {
            let (dim, arrayed, multisampled, sampled) = (at(2), at(4), at(5), at(6));
            let lacks = [
                (dim == DIM_1D && arrayed == 1, "1D array texture"),
                (dim == DIM_CUBE && sampled == 2, "storage cube texture"),
                (multisampled == 1 && arrayed == 1, "multisampled array"),
                (
                    sampled == 2 && at(7) == 0,
                    "storage texture of unknown format",
                ),
            ];
            let lacking = lacks.into_iter().find(|(is, _)| *is)?;
            Some(lacking.1.to_owned())
        }
        Op::ImageQueryLod | Op::IsHelperInvocationEXT => Some(format!("{op:?}")),
        Op::ImageGather | Op::ImageDrefGather if at(5) & OFFSETS != 0 => {
            Some("gather with other than constant offsets".to_owned())
        }
        _ => None,
    }
}

fn built_in(number: u32) -> Option<String> {
    let built_in = BuiltIn::from_u32(number)?;
    BUILT_INS
        .contains(&built_in)
        .then(|| format!("{built_in:?}"))
}
