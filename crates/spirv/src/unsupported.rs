//! Refuses features of SPIR-V that naga's reader or WebGPU lacks. Each has a GLSL name, under which
//! the table of unsupported names gives the reason and a remedy.

use std::collections::HashMap;

use rspirv::dr::{Instruction, Module, Operand};
use rspirv::spirv::{BuiltIn, Decoration, Dim, GlslStd450Op, Op, StorageClass, Word};

use crate::words::{globals, ids, is_access, literal, storage_class};
use shader_text::error::{Code, Error};

pub(super) struct Lack {
    /// SPIR-V's name, such as `OpImageQueryLod`.
    pub(super) name: String,
    /// GLSL's name, with an entry in the table or in [`OWN`].
    pub(super) glsl: &'static str,
    /// The instruction's result id, to locate it.
    pub(super) id: Option<Word>,
    /// Index of the instruction in the listing, if it is in a block.
    pub(super) line: Option<u32>,
}

/// The first unsupported feature of a module.
pub(super) fn find(module: &Module) -> Option<Lack> {
    let all = globals(module);
    let at = |name: String, glsl, id| Lack {
        name,
        glsl,
        id,
        line: None,
    };
    for i in &module.types_global_values {
        if let Some((name, glsl)) = of_type(i) {
            return Some(at(name, glsl, i.result_id));
        }
    }
    let is_used = uses(module, &all);
    for i in &module.annotations {
        let (id, member, built_in) = match i.operands.as_slice() {
            [
                Operand::IdRef(id),
                Operand::Decoration(Decoration::BuiltIn),
                Operand::BuiltIn(b),
            ] => (*id, None, *b),
            [
                Operand::IdRef(id),
                Operand::LiteralBit32(n),
                Operand::Decoration(Decoration::BuiltIn),
                Operand::BuiltIn(b),
            ] => (*id, Some(*n), *b),
            _ => continue,
        };
        if let Some(glsl) = of_built_in(built_in)
            && is_used(id, member)
        {
            return Some(at(format!("BuiltIn {built_in:?}"), glsl, Some(id)));
        }
    }
    for i in &module.annotations {
        let packs = Operand::Decoration(Decoration::Component);
        let at_index = i.operands.iter().position(|o| *o == packs);
        let value = at_index
            .and_then(|n| i.operands.get(n + 1))
            .and_then(literal);
        if value.is_some_and(|n| n > 0) {
            return Some(at("Component".to_owned(), "component", ids(i).next()));
        }
    }
    let values: HashMap<Word, Word> = module
        .all_inst_iter()
        .filter_map(|i| Some((i.result_id?, i.result_type?)))
        .collect();
    let made = module.functions.iter().flat_map(|f| f.all_inst_iter());
    let made: HashMap<Word, &Instruction> = made.filter_map(|i| Some((i.result_id?, i))).collect();
    let mut line = None;
    for i in module.functions.iter().flat_map(|f| f.all_inst_iter()) {
        if i.class.opcode == Op::Line {
            line = i.operands.get(1).and_then(literal);
        }
        let read = of_instruction(i).or_else(|| of_integers(i, &values, &all));
        let read = read.or_else(|| of_samplers(i, &made));
        if let Some((name, glsl)) = read {
            return Some(Lack {
                name,
                glsl,
                id: None,
                line,
            });
        }
    }
    None
}

/// Whether an instruction reads or writes a variable or a struct member.
fn uses(
    module: &Module,
    all: &HashMap<Word, Instruction>,
) -> impl Fn(Word, Option<u32>) -> bool + use<> {
    let mut variables = Vec::new();
    let mut members = Vec::new();
    for i in module.functions.iter().flat_map(|f| f.all_inst_iter()) {
        let mut path = ids(i);
        let Some(base) = path.next() else { continue };
        variables.push(base);
        let variable = all.get(&base).filter(|i| i.class.opcode == Op::Variable);
        let pointer = variable.and_then(|v| all.get(&v.result_type?));
        let ty = pointer.and_then(|p| ids(p).next());
        let index = path.next().and_then(|id| all.get(&id));
        let index = index.and_then(|i| i.operands.first()).and_then(literal);
        members.extend(ty.zip(index));
    }
    move |id, member| match member {
        None => variables.contains(&id),
        Some(n) => members.contains(&(id, n)),
    }
}

fn of_type(i: &Instruction) -> Option<(String, &'static str)> {
    let is = |n: usize| i.operands.get(n).and_then(literal) == Some(1);
    let [is_depth, is_arrayed, is_multisampled] = [2, 3, 4].map(is);
    let glsl = match i.class.opcode {
        Op::TypeAccelerationStructureKHR => "accelerationStructureEXT",
        Op::TypeRayQueryKHR => "rayQueryEXT",
        Op::TypeForwardPointer => "buffer_reference",
        Op::TypePointer if storage_class(i) == Some(StorageClass::PhysicalStorageBuffer) => {
            "buffer_reference"
        }
        Op::TypeImage => match i.operands.get(1) {
            Some(Operand::Dim(Dim::DimSubpassData)) => "subpassInput",
            Some(Operand::Dim(Dim::DimBuffer)) => "textureBuffer",
            Some(Operand::Dim(Dim::DimRect)) => RECTANGLE,
            Some(Operand::Dim(Dim::Dim1D)) if is_depth || is_arrayed => LINES,
            _ if is_arrayed && is_multisampled => SAMPLES,
            _ => return None,
        },
        Op::TypeFloat if i.operands.first().and_then(literal) == Some(8) => "floate5m2_t",
        Op::TypeFloat if i.operands.len() > 1 => "bfloat16_t",
        Op::TypeInt => match i.operands.first().and_then(literal) {
            Some(8 | 16) => "int16_t",
            Some(64) => "int64_t",
            _ => return None,
        },
        _ => return None,
    };
    let name = match (i.class.opcode, i.operands.get(1)) {
        (Op::TypeImage, Some(Operand::Dim(dim))) => format!("OpTypeImage {dim:?}"),
        (Op::TypeInt, _) => {
            let bits = i.operands.first().and_then(literal).unwrap_or_default();
            format!("OpTypeInt {bits}")
        }
        _ => format!("Op{}", i.class.opname),
    };
    Some((name, glsl))
}

fn of_built_in(built_in: BuiltIn) -> Option<&'static str> {
    Some(match built_in {
        BuiltIn::PointCoord => "gl_PointCoord",
        BuiltIn::HelperInvocation => "gl_HelperInvocation",
        BuiltIn::Layer => "gl_Layer",
        BuiltIn::ViewportIndex => "gl_ViewportIndex",
        BuiltIn::CullDistance => "gl_CullDistance",
        BuiltIn::DeviceIndex => "gl_DeviceIndex",
        BuiltIn::SamplePosition => "gl_SamplePosition",
        BuiltIn::FragSizeEXT => "gl_FragSizeEXT",
        BuiltIn::FragInvocationCountEXT => "gl_FragInvocationCountEXT",
        BuiltIn::ShadingRateKHR | BuiltIn::PrimitiveShadingRateKHR => "gl_ShadingRateEXT",
        BuiltIn::FullyCoveredEXT => "gl_FullyCoveredEXT",
        _ => return None,
    })
}

fn of_instruction(i: &Instruction) -> Option<(String, &'static str)> {
    if i.class.opcode == Op::ExtInst {
        let Some(Operand::LiteralExtInstInteger(n)) = i.operands.get(1) else {
            return None;
        };
        let function = GlslStd450Op::from_u32(*n)?;
        return match function {
            GlslStd450Op::InterpolateAtCentroid
            | GlslStd450Op::InterpolateAtSample
            | GlslStd450Op::InterpolateAtOffset => {
                Some((format!("{function:?}"), "interpolateAtCentroid"))
            }
            GlslStd450Op::Frexp | GlslStd450Op::FrexpStruct => {
                Some((format!("{function:?}"), "frexp"))
            }
            _ => None,
        };
    }
    let name = i.class.opname;
    let starts = |start: &str| name.starts_with(start);
    let glsl = match i.class.opcode {
        Op::ImageQueryLod => "textureQueryLod",
        Op::ImageTexelPointer => "imageAtomicAdd",
        Op::IsHelperInvocationEXT => "helperInvocationEXT",
        Op::ReadClockKHR => "clockARB",
        Op::BeginInvocationInterlockEXT => "beginInvocationInterlockARB",
        Op::PtrAccessChain | Op::ConvertUToPtr | Op::ConvertPtrToU => "buffer_reference",
        Op::ImageQuerySamples => "textureSamples",
        _ if starts("ImageSparse") => "sparseTextureARB",
        _ if starts("RayQuery") => "rayQueryInitializeEXT",
        _ if starts("CooperativeMatrix") => "coopmat",
        _ => return None,
    };
    Some((format!("Op{name}"), glsl))
}

/// A sample of an integer texture.
fn of_integers(
    i: &Instruction,
    values: &HashMap<Word, Word>,
    all: &HashMap<Word, Instruction>,
) -> Option<(String, &'static str)> {
    let name = i.class.opname;
    if !name.starts_with("ImageSample") {
        return None;
    }
    let sampled = all.get(values.get(&ids(i).next()?)?)?;
    let image = all.get(&ids(sampled).next()?)?;
    let of = all.get(&ids(image).next()?)?;
    let is_of_ints = image.class.opcode == Op::TypeImage && of.class.opcode == Op::TypeInt;
    is_of_ints.then(|| (format!("Op{name}"), INTEGERS))
}

/// A comparison with an element of a sampler array.
fn of_samplers(
    i: &Instruction,
    made: &HashMap<Word, &Instruction>,
) -> Option<(String, &'static str)> {
    let name = i.class.opname;
    if !name.contains("Dref") {
        return None;
    }
    let sampled = made.get(&ids(i).next()?)?;
    let sampler = made.get(&ids(sampled).nth(1)?)?;
    let pointer = made.get(&ids(sampler).next()?)?;
    is_access(pointer).then(|| (format!("Op{name}"), SAMPLERS))
}

const INTEGERS: &str = "a texture of integers";
const LINES: &str = "a texture of one dimension with layers or depths";
const RECTANGLE: &str = "a texture with coordinates in texels";
const SAMPLERS: &str = "a comparison by an element of an array of samplers";
const SAMPLES: &str = "a texture with layers and samples";

/// Name, reason and remedy of features without an entry in the common table.
const OWN: [(&str, &str, &str); 6] = [
    (
        "frexp",
        "naga has no such function",
        "take the bits by `floatBitsToInt`",
    ),
    (
        INTEGERS,
        "WebGPU samples no textures of integers",
        "read the texel by `texelFetch`",
    ),
    (
        LINES,
        "WebGPU has no textures of one dimension with layers or depths",
        "use one of two dimensions that is one texel high",
    ),
    (
        RECTANGLE,
        "WebGPU has no textures whose coordinates are texels",
        "use a `sampler2D`, and divide the coordinates by `textureSize`",
    ),
    (
        SAMPLERS,
        "naga reads no arrays of samplers that compare",
        "give each sampler a binding of its own",
    ),
    (
        SAMPLES,
        "WebGPU has no textures with layers and several samples",
        "give each layer a binding of its own",
    ),
];

/// The error for an unsupported feature.
pub(super) fn refuse(lack: &Lack) -> Error {
    if let Some(absent) = shader_text::unsupported::absent(lack.glsl) {
        return absent.refuse(&lack.name, None);
    }
    let error = |why: &str| {
        let message = format!("`{}` is not supported{why}", lack.name);
        Error::new(Code::Unsupported, message)
    };
    match OWN.iter().find(|(glsl, ..)| *glsl == lack.glsl) {
        Some((_, why, remedy)) => error(&format!(": {why}")).note(*remedy),
        None => error(""),
    }
}
