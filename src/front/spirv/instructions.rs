//! Replaces instructions that naga's reader lacks, or reads as something else, by others that mean
//! the same.
//!
//! | instruction | replaced by |
//! |---|---|
//! | `OpTerminateInvocation` | `OpKill` |
//! | `OpDemoteToHelperInvocation` | a call of a function that ends with `OpKill`, see [`demote`] |
//! | `OpLogicalAnd`, `OpLogicalOr` of vectors | `OpBitwiseAnd`, `OpBitwiseOr` |
//! | `OpSMod`, which naga divides as floats | `OpSRem` |
//! | `OpFUnordLessThan` and its like | the negated opposite |
//! | `OpCopyLogical` | the members, one by one |
//! | `OpIAddCarry`, `OpISubBorrow`, `Modf`, `ModfStruct` | arithmetic |
//! | an instruction on integers of the other sign than its name's | the same between `OpBitcast`s |
//! | the layer of a sampled array texture | rounded to the nearest even (Vulkan 17.5.3) |
//! | the number of layers in `OpImageQuerySize` | `OpImageQuerySamples`, see [`layers`] |
//! | offsets of `OpImageFetch` | added to the coordinates |

use std::collections::{HashMap, HashSet};
use std::ops::Range;

use naga::{Block, Expression, Function, Handle, ImageQuery, Module, Statement, TypeInner};
use preshade_passes::graph::operands;
use rspirv::dr::{self, Builder, Instruction, Operand};
use rspirv::spirv::{Dim, FunctionControl, GlslStd450Op, ImageOperands, Op, Word};

use crate::words::{globals, ids, literal, push, rewrite};

/// Name of the function that demotes its invocation.
const DEMOTE: &str = "preshade_demote";

/// Instructions that mean something else to naga, and that nothing here replaces: the name of what
/// naga would ignore.
pub(crate) struct Lost {
    /// Index of the instruction in the listing.
    pub(super) instruction: Option<u32>,
    pub(crate) what: &'static str,
}

/// Replaces all of them.
pub(crate) fn replace(module: &mut Builder) -> Result<(), Lost> {
    let mut types = Types::of(module);
    let mut line = None;
    let mut lost = None;
    let mut demote = None;
    rewrite(module, |module, block, instruction| {
        if instruction.class.opcode == Op::Line {
            line = instruction.operands.get(1).and_then(literal);
        }
        let mut writer = Writer {
            module,
            block,
            types: &mut types,
            demote: &mut demote,
        };
        if let Err(what) = writer.write(instruction)
            && lost.is_none()
        {
            lost = Some(Lost {
                instruction: line,
                what,
            });
        }
    });
    if let Some(demote) = demote {
        declare_demote(module, demote);
    }
    lost.map_or(Ok(()), Err)
}

/// Types of values, and what types are.
struct Types {
    globals: HashMap<Word, Instruction>,
    values: HashMap<Word, Word>,
    constants: HashSet<Word>,
    /// The textures that others are copies of.
    copies: HashMap<Word, Word>,
    glsl: Option<Word>,
}

impl Types {
    fn of(module: &Builder) -> Self {
        let module = module.module_ref();
        let values = module.all_inst_iter();
        let mut glsl = module.ext_inst_imports.iter();
        let is_glsl = |i: &&Instruction| matches!(&i.operands[..], [Operand::LiteralString(s)] if s == "GLSL.std.450");
        let constants = module.types_global_values.iter();
        Self {
            globals: globals(module),
            values: values
                .filter_map(|i| Some((i.result_id?, i.result_type?)))
                .collect(),
            constants: constants
                .filter(|i| i.class.opcode != Op::Variable)
                .filter_map(|i| i.result_id)
                .collect(),
            copies: HashMap::new(),
            glsl: glsl.find(is_glsl).and_then(|i| i.result_id),
        }
    }

    fn ty(&self, id: Word) -> Option<&Instruction> {
        self.globals.get(&id)
    }

    /// The type of a value.
    fn value(&self, id: Word) -> Option<&Instruction> {
        self.ty(*self.values.get(&id)?)
    }

    /// The components of a vector type; 1 for a scalar.
    fn size(&self, ty: Word) -> u32 {
        match self.ty(ty) {
            Some(i) if i.class.opcode == Op::TypeVector => {
                i.operands.get(1).and_then(literal).unwrap_or(1)
            }
            _ => 1,
        }
    }

    /// The type of a vector's components, or the type itself.
    fn scalar(&self, ty: Word) -> Word {
        match self.ty(ty) {
            Some(i) if i.class.opcode == Op::TypeVector => ids(i).next().unwrap_or(ty),
            _ => ty,
        }
    }

    /// The `OpTypeImage` of an image or a sampled image.
    fn image(&self, value: Word) -> Option<&Instruction> {
        let ty = self.value(value)?;
        match ty.class.opcode {
            Op::TypeImage => Some(ty),
            Op::TypeSampledImage => self.ty(ids(ty).next()?),
            _ => None,
        }
    }
}

fn is_arrayed(image: &Instruction) -> bool {
    image.operands.get(3).and_then(literal) == Some(1)
}

struct Writer<'a> {
    module: &'a mut Builder,
    block: &'a mut Vec<Instruction>,
    types: &'a mut Types,
    /// The function that demotes, once it is needed.
    demote: &'a mut Option<Word>,
}

type Written = Result<(), &'static str>;

impl Writer<'_> {
    fn push(&mut self, op: Op, ty: Word, operands: impl IntoIterator<Item = Operand>) -> Word {
        let id = push(self.module, self.block, (op, ty), operands);
        self.types.values.insert(id, ty);
        id
    }

    fn push_ids(&mut self, op: Op, ty: Word, ids: &[Word]) -> Word {
        self.push(op, ty, ids.iter().copied().map(Operand::IdRef))
    }

    /// Writes an instruction that keeps the result's id.
    fn keep(&mut self, of: &Instruction, op: Op, operands: impl IntoIterator<Item = Operand>) {
        let operands = operands.into_iter().collect();
        let new = Instruction::new(op, of.result_type, of.result_id, operands);
        self.block.push(new);
    }

    fn keep_ids(&mut self, of: &Instruction, op: Op, ids: &[Word]) {
        self.keep(of, op, ids.iter().copied().map(Operand::IdRef));
    }

    fn glsl(&mut self, function: GlslStd450Op, ty: Word, ids: &[Word]) -> Word {
        let set = *self
            .types
            .glsl
            .get_or_insert_with(|| self.module.ext_inst_import("GLSL.std.450"));
        let head = [
            Operand::IdRef(set),
            Operand::LiteralExtInstInteger(function as u32),
        ];
        let operands = head
            .into_iter()
            .chain(ids.iter().copied().map(Operand::IdRef));
        self.push(Op::ExtInst, ty, operands)
    }

    fn write(&mut self, mut instruction: Instruction) -> Written {
        for id in instruction
            .operands
            .iter_mut()
            .filter_map(Operand::id_ref_any_mut)
        {
            if let Some(of) = self.types.copies.get(id) {
                *id = *of;
            }
        }
        let cast = self.cast_signs(&mut instruction);
        self.write_one(instruction)?;
        self.block.extend(cast);
        Ok(())
    }

    /// Gives an instruction the operands and the result whose sign its name says: naga takes the
    /// sign from the type. Returns the instruction that casts the result back.
    fn cast_signs(&mut self, instruction: &mut Instruction) -> Option<Instruction> {
        let signs = Signs::of(instruction, self.types.glsl)?;
        let first = signs.operands.start;
        let operand = instruction.operands.get(first)?.id_ref_any()?;
        let of = *self.types.values.get(&operand)?;
        let mut is_signed = match signs.operand {
            Some(is_signed) => is_signed,
            None => self.is_signed(of).unwrap_or_default(),
        };
        for at in signs.operands {
            let operand = instruction.operands.get(at)?.id_ref_any()?;
            let own = *self.types.values.get(&operand)?;
            if self.is_signed(own).is_some_and(|own| own != is_signed) {
                let ty = self.with_sign(own, is_signed)?;
                let cast = self.push_ids(Op::Bitcast, ty, &[operand]);
                instruction.operands[at] = Operand::IdRef(cast);
            }
        }
        is_signed = signs.result.unwrap_or(is_signed);
        let (ty, id) = instruction.result_type.zip(instruction.result_id)?;
        if self.is_signed(ty)? == is_signed {
            return None;
        }
        let given = self.module.id();
        let of = self.with_sign(ty, is_signed)?;
        instruction.result_type = Some(of);
        instruction.result_id = Some(given);
        self.types.values.insert(given, of);
        let operands = vec![Operand::IdRef(given)];
        Some(Instruction::new(Op::Bitcast, Some(ty), Some(id), operands))
    }

    /// Whether a type of integers is of signed ones.
    fn is_signed(&self, ty: Word) -> Option<bool> {
        let scalar = self.types.ty(self.types.scalar(ty))?;
        let is_int = scalar.class.opcode == Op::TypeInt;
        is_int.then(|| scalar.operands.get(1).and_then(literal) == Some(1))
    }

    /// The same type of integers with another sign.
    fn with_sign(&mut self, ty: Word, is_signed: bool) -> Option<Word> {
        let width = self.types.ty(self.types.scalar(ty))?;
        let width = width.operands.first().and_then(literal)?;
        let scalar = self.module.type_int(width, is_signed.into());
        let new = match self.types.size(ty) {
            1 => scalar,
            n => self.module.type_vector(scalar, n),
        };
        for id in [scalar, new] {
            let mut all = self.module.module_ref().types_global_values.iter();
            if let Some(i) = all.find(|i| i.result_id == Some(id)) {
                self.types.globals.insert(id, i.clone());
            }
        }
        Some(new)
    }

    fn write_one(&mut self, instruction: Instruction) -> Written {
        let operands: Vec<Word> = ids(&instruction).collect();
        let result = instruction.result_type.zip(instruction.result_id);
        match (instruction.class.opcode, result, operands.as_slice()) {
            // How memory is accessed only matters to optimisers.
            (Op::Load, ..) => self.keep_ids(&instruction, Op::Load, &operands[..1]),
            (Op::Store, ..) => {
                let operands = instruction.operands[..2].to_vec();
                self.block
                    .push(Instruction::new(Op::Store, None, None, operands));
            }
            // The reader does not know that a copy of a texture is one.
            (Op::CopyObject, Some((_, id)), [of]) if self.types.image(*of).is_some() => {
                self.types.copies.insert(id, *of);
            }
            (Op::TerminateInvocation, ..) => {
                self.block
                    .push(Instruction::new(Op::Kill, None, None, Vec::new()));
            }
            (Op::DemoteToHelperInvocation, ..) => {
                let void = self.module.type_void();
                let function = *self.demote.get_or_insert_with(|| self.module.id());
                self.push_ids(Op::FunctionCall, void, &[function]);
            }
            // The reader takes these for the bitwise operators of WGSL, which vectors of bools have.
            (op @ (Op::LogicalAnd | Op::LogicalOr), Some((ty, _)), _)
                if self.types.size(ty) > 1 =>
            {
                let bitwise = match op {
                    Op::LogicalAnd => Op::BitwiseAnd,
                    _ => Op::BitwiseOr,
                };
                self.keep_ids(&instruction, bitwise, &operands);
            }
            (Op::SMod, Some((ty, _)), [a, b]) => {
                // The remainder has the sign of the dividend, the modulus that of the divisor.
                let rest = self.push_ids(Op::SRem, ty, &[*a, *b]);
                let zero = self.number(ty, 0);
                let bools = self.bools(ty);
                let signs = self.push_ids(Op::BitwiseXor, ty, &[rest, *b]);
                let differ = self.push_ids(Op::SLessThan, bools, &[signs, zero]);
                let other = self.push_ids(Op::IAdd, ty, &[rest, *b]);
                let moved = self.push_ids(Op::Select, ty, &[differ, other, rest]);
                let is_zero = self.push_ids(Op::IEqual, bools, &[rest, zero]);
                self.keep_ids(&instruction, Op::Select, &[is_zero, zero, moved]);
            }
            (op, Some((ty, _)), [a, b]) if opposite(op).is_some() => {
                let opposite = opposite(op).unwrap_or(op);
                let is = self.push_ids(opposite, ty, &[*a, *b]);
                self.keep_ids(&instruction, Op::LogicalNot, &[is]);
            }
            (Op::CopyLogical, Some((ty, id)), [from]) => {
                let copy = self.copy_logical(ty, *from)?;
                self.block.push(Instruction::new(
                    Op::CopyObject,
                    Some(ty),
                    Some(id),
                    vec![Operand::IdRef(copy)],
                ));
            }
            (op @ (Op::IAddCarry | Op::ISubBorrow), Some((ty, _)), [a, b]) => {
                let members = self.types.ty(ty).map(|i| ids(i).collect::<Vec<_>>());
                let first = members.and_then(|m| m.first().copied()).unwrap_or(ty);
                let is_sum = op == Op::IAddCarry;
                let value = match is_sum {
                    true => self.push_ids(Op::IAdd, first, &[*a, *b]),
                    false => self.push_ids(Op::ISub, first, &[*a, *b]),
                };
                let bools = self.bools(first);
                let carries = match is_sum {
                    true => self.push_ids(Op::ULessThan, bools, &[value, *a]),
                    false => self.push_ids(Op::ULessThan, bools, &[*a, *b]),
                };
                let [one, zero] = [1, 0].map(|n| self.number(first, n));
                let carry = self.push_ids(Op::Select, first, &[carries, one, zero]);
                self.keep_ids(&instruction, Op::CompositeConstruct, &[value, carry]);
            }
            (Op::ExtInst, Some(_), [set, value, rest @ ..]) if Some(*set) == self.types.glsl => {
                let (value, pointer) = (*value, rest.first().copied());
                self.write_glsl(instruction, value, pointer);
            }
            (Op::ImageQuerySize | Op::ImageQuerySizeLod, Some((ty, _)), [image, ..])
                if self.types.image(*image).is_some_and(is_arrayed) =>
            {
                let scalar = self.types.scalar(ty);
                let plane = self
                    .module
                    .type_vector(scalar, self.types.size(ty).max(2) - 1);
                let size = self.push(
                    instruction.class.opcode,
                    plane,
                    instruction.operands.clone(),
                );
                let layers = self.push_ids(Op::ImageQuerySamples, scalar, &[*image]);
                self.keep_ids(&instruction, Op::CompositeConstruct, &[size, layers]);
            }
            (op, Some(_), [image, ..]) if is_image_read(op) => {
                let image = self.types.image(*image).cloned();
                return self.write_read(instruction, image.as_ref());
            }
            _ => self.block.push(instruction),
        }
        Ok(())
    }

    /// The type of booleans with as many components as `ty`.
    fn bools(&mut self, ty: Word) -> Word {
        let bool = self.module.type_bool();
        match self.types.size(ty) {
            1 => bool,
            n => self.module.type_vector(bool, n),
        }
    }

    /// A constant with `n` in each component.
    fn number(&mut self, ty: Word, n: u32) -> Word {
        let scalar = self.types.scalar(ty);
        let one = self.module.constant_bit32(scalar, n);
        match self.types.size(ty) {
            1 => one,
            size => self.module.constant_composite(ty, vec![one; size as usize]),
        }
    }

    fn write_glsl(&mut self, instruction: Instruction, value: Word, pointer: Option<Word>) {
        let function = match instruction.operands.get(1) {
            Some(Operand::LiteralExtInstInteger(n)) => GlslStd450Op::from_u32(*n),
            _ => None,
        };
        let ty = self.types.values.get(&value).copied();
        match (function, pointer, ty) {
            (Some(GlslStd450Op::Modf), Some(pointer), Some(ty)) => {
                let whole = self.glsl(GlslStd450Op::Trunc, ty, &[value]);
                let store = [pointer, whole].map(Operand::IdRef).to_vec();
                self.block
                    .push(Instruction::new(Op::Store, None, None, store));
                self.keep_ids(&instruction, Op::FSub, &[value, whole]);
            }
            (Some(GlslStd450Op::ModfStruct), _, Some(ty)) => {
                let whole = self.glsl(GlslStd450Op::Trunc, ty, &[value]);
                let rest = self.push_ids(Op::FSub, ty, &[value, whole]);
                self.keep_ids(&instruction, Op::CompositeConstruct, &[rest, whole]);
            }
            _ => self.block.push(instruction),
        }
    }

    /// Copies a value to a type of the same shape.
    fn copy_logical(&mut self, to: Word, from: Word) -> Result<Word, &'static str> {
        let of = self.types.values.get(&from).copied();
        if of == Some(to) {
            return Ok(from);
        }
        let (Some(of), Some(target)) = (of.and_then(|of| self.types.ty(of)), self.types.ty(to))
        else {
            return Err("`OpCopyLogical`");
        };
        let members = |ty: &Instruction| -> Vec<Word> { ids(ty).collect() };
        let (from_members, to_members) = match target.class.opcode {
            Op::TypeStruct => (members(of), members(target)),
            Op::TypeArray => {
                let length = ids(target).nth(1).and_then(|n| self.types.ty(n));
                let length = length.and_then(|n| n.operands.first()).and_then(literal);
                let repeat = |ty: &Instruction| -> Vec<Word> {
                    let element = ids(ty).take(1);
                    let n = length.unwrap_or(0).min(MOST_COPIED) as usize;
                    element.flat_map(|e| vec![e; n]).collect()
                };
                if length.is_none_or(|n| n > MOST_COPIED) {
                    return Err("`OpCopyLogical` of a large array");
                }
                (repeat(of), repeat(target))
            }
            _ => return Err("`OpCopyLogical`"),
        };
        let mut parts = Vec::new();
        for (i, (from_member, to_member)) in from_members.into_iter().zip(to_members).enumerate() {
            let path = [Operand::IdRef(from), Operand::LiteralBit32(i as u32)];
            let part = self.push(Op::CompositeExtract, from_member, path);
            parts.push(self.copy_logical(to_member, part)?);
        }
        Ok(self.push_ids(Op::CompositeConstruct, to, &parts))
    }

    /// Samples, gathers and fetches.
    fn write_read(&mut self, mut instruction: Instruction, image: Option<&Instruction>) -> Written {
        let op = instruction.class.opcode;
        let is_fetch = matches!(op, Op::ImageFetch | Op::ImageRead | Op::ImageWrite);
        let found = instruction.operands.iter().enumerate();
        let mut mask = found.filter_map(|(i, o)| match o {
            Operand::ImageOperands(mask) => Some((i, *mask)),
            _ => None,
        });
        if let Some((at, mask)) = mask.next_back() {
            let mut given = Given::of(&instruction, at, mask);
            // These say how memory is read, and how a texel is converted.
            given.drop_words(
                ImageOperands::NON_PRIVATE_TEXEL
                    | ImageOperands::VOLATILE_TEXEL
                    | ImageOperands::SIGN_EXTEND
                    | ImageOperands::ZERO_EXTEND,
            );
            if is_fetch
                && let Some(offset) = given
                    .take(ImageOperands::CONST_OFFSET)
                    .or_else(|| given.take(ImageOperands::OFFSET))
            {
                self.add_offset(&mut instruction, offset);
            }
            if let Some(offset) = given.take(ImageOperands::OFFSET) {
                if !self.types.constants.contains(&offset) {
                    return Err("an offset that is not constant");
                }
                given.all.push((ImageOperands::CONST_OFFSET, vec![offset]));
            }
            let compares = is_comparison(op);
            let level = given.get(ImageOperands::LOD);
            if compares && level.is_some_and(|id| !self.is_zero(id)) {
                return Err("a comparison at another level than 0");
            }
            if compares && given.get(ImageOperands::GRAD).is_some() {
                return Err("a comparison with gradients");
            }
            for (operand, what) in [
                (ImageOperands::MIN_LOD, "a lower limit of the level"),
                (ImageOperands::CONST_OFFSETS, "four offsets of a gather"),
                (ImageOperands::OFFSETS, "four offsets of a gather"),
            ] {
                if given.get(operand).is_some() {
                    return Err(what);
                }
            }
            given.write(&mut instruction, at);
        }
        if let Some(image) = image.filter(|image| !is_fetch && is_arrayed(image)) {
            self.round_layer(&mut instruction, image);
        }
        self.block.push(instruction);
        Ok(())
    }

    fn is_zero(&self, id: Word) -> bool {
        self.types.ty(id).is_some_and(|i| {
            i.class.opcode == Op::ConstantNull
                || (i.class.opcode == Op::Constant
                    && matches!(
                        i.operands.first(),
                        Some(Operand::LiteralBit32(0 | 0x8000_0000))
                    ))
        })
    }

    /// Adds an offset to the coordinates, without the layer.
    fn add_offset(&mut self, instruction: &mut Instruction, offset: Word) {
        let Some(Operand::IdRef(at)) = instruction.operands.get(1).cloned() else {
            return;
        };
        let (Some(ty), Some(of)) = (
            self.types.values.get(&at).copied(),
            self.types.values.get(&offset).copied(),
        ) else {
            return;
        };
        let missing = self.types.size(ty) - self.types.size(of).min(self.types.size(ty));
        let offset = match missing {
            0 => offset,
            _ => {
                let scalar = self.types.scalar(ty);
                let zero = self.module.constant_bit32(scalar, 0);
                // naga makes an invalid constant of a vector and a scalar.
                let mut parts = match self.types.size(of) {
                    1 => vec![offset],
                    n => (0..n)
                        .map(|i| {
                            let part = [Operand::IdRef(offset), Operand::LiteralBit32(i)];
                            self.push(Op::CompositeExtract, scalar, part)
                        })
                        .collect(),
                };
                parts.extend(std::iter::repeat_n(zero, missing as usize));
                self.push_ids(Op::CompositeConstruct, ty, &parts)
            }
        };
        let sum = self.push_ids(Op::IAdd, ty, &[at, offset]);
        instruction.operands[1] = Operand::IdRef(sum);
    }

    /// The layer follows the coordinates; more components may follow it, such as glslang's depth.
    fn round_layer(&mut self, instruction: &mut Instruction, image: &Instruction) {
        let Some(Operand::IdRef(at)) = instruction.operands.get(1).cloned() else {
            return;
        };
        let Some(ty) = self.types.values.get(&at).copied() else {
            return;
        };
        let layer = match image.operands.get(1) {
            Some(Operand::Dim(Dim::Dim1D)) => 1,
            Some(Operand::Dim(Dim::DimCube)) => 3,
            _ => 2,
        };
        let scalar = self.types.scalar(ty);
        let index = Operand::LiteralBit32(layer);
        let layer = self.push(
            Op::CompositeExtract,
            scalar,
            [Operand::IdRef(at), index.clone()],
        );
        let rounded = self.glsl(GlslStd450Op::RoundEven, scalar, &[layer]);
        let parts = [Operand::IdRef(rounded), Operand::IdRef(at), index];
        let at = self.push(Op::CompositeInsert, ty, parts);
        instruction.operands[1] = Operand::IdRef(at);
    }
}

/// Arrays of more elements are not copied one by one.
const MOST_COPIED: u32 = 256;

/// Image operands with their ids.
struct Given {
    all: Vec<(ImageOperands, Vec<Word>)>,
}

impl Given {
    fn of(instruction: &Instruction, at: usize, mask: ImageOperands) -> Self {
        let mut rest = instruction.operands[at + 1..]
            .iter()
            .filter_map(Operand::id_ref_any);
        let all = mask.iter().map(|bit| {
            let n = match bit {
                ImageOperands::GRAD => 2,
                ImageOperands::NON_PRIVATE_TEXEL
                | ImageOperands::VOLATILE_TEXEL
                | ImageOperands::SIGN_EXTEND
                | ImageOperands::ZERO_EXTEND => 0,
                _ => 1,
            };
            (bit, rest.by_ref().take(n).collect())
        });
        Self { all: all.collect() }
    }

    fn get(&self, bit: ImageOperands) -> Option<Word> {
        let (_, ids) = self.all.iter().find(|(b, _)| *b == bit)?;
        ids.first().copied()
    }

    fn take(&mut self, bit: ImageOperands) -> Option<Word> {
        let id = self.get(bit);
        self.all.retain(|(b, _)| *b != bit);
        id
    }

    fn drop_words(&mut self, bits: ImageOperands) {
        self.all.retain(|(b, _)| !bits.contains(*b));
    }

    fn write(mut self, instruction: &mut Instruction, at: usize) {
        instruction.operands.truncate(at);
        if self.all.is_empty() {
            return;
        }
        self.all.sort_by_key(|(bit, _)| bit.bits());
        let mask = self
            .all
            .iter()
            .fold(ImageOperands::NONE, |m, (b, _)| m | *b);
        instruction.operands.push(Operand::ImageOperands(mask));
        let ids = self.all.into_iter().flat_map(|(_, ids)| ids);
        instruction.operands.extend(ids.map(Operand::IdRef));
    }
}

/// The signs of the integers that an instruction takes and gives.
struct Signs {
    /// The indices of the operands whose sign counts.
    operands: Range<usize>,
    /// `None`: as the first one's type has it.
    operand: Option<bool>,
    /// `None`: as the operands have it.
    result: Option<bool>,
}

impl Signs {
    fn of(instruction: &Instruction, glsl: Option<Word>) -> Option<Self> {
        let all = instruction.operands.len();
        let both = |operands, is_signed| Self {
            operands,
            operand: Some(is_signed),
            result: None,
        };
        let own = |operands| Self {
            operands,
            operand: None,
            result: None,
        };
        Some(match instruction.class.opcode {
            Op::SDiv | Op::SRem | Op::SMod => both(0..2, true),
            Op::UDiv | Op::UMod => both(0..2, false),
            Op::ShiftRightLogical | Op::BitFieldUExtract | Op::ConvertUToF => both(0..1, false),
            Op::ShiftRightArithmetic | Op::BitFieldSExtract | Op::ConvertSToF => both(0..1, true),
            Op::ConvertFToS | Op::ConvertFToU => Self {
                operands: 0..1,
                operand: None,
                result: Some(instruction.class.opcode == Op::ConvertFToS),
            },
            Op::BitCount | Op::ShiftLeftLogical | Op::BitReverse => own(0..1),
            Op::ExtInst if instruction.operands.first()?.id_ref_any() == glsl => {
                let Operand::LiteralExtInstInteger(n) = instruction.operands.get(1)? else {
                    return None;
                };
                match GlslStd450Op::from_u32(*n)? {
                    GlslStd450Op::UMin | GlslStd450Op::UMax | GlslStd450Op::UClamp => {
                        both(2..all, false)
                    }
                    GlslStd450Op::SMin
                    | GlslStd450Op::SMax
                    | GlslStd450Op::SClamp
                    | GlslStd450Op::SAbs
                    | GlslStd450Op::SSign => both(2..all, true),
                    GlslStd450Op::FindUMsb => both(2..3, false),
                    GlslStd450Op::FindSMsb => both(2..3, true),
                    GlslStd450Op::FindILsb => own(2..3),
                    _ => return None,
                }
            }
            _ => return None,
        })
    }
}

/// The comparison that holds exactly where an unordered one does not.
fn opposite(op: Op) -> Option<Op> {
    Some(match op {
        Op::FUnordLessThan => Op::FOrdGreaterThanEqual,
        Op::FUnordGreaterThan => Op::FOrdLessThanEqual,
        Op::FUnordLessThanEqual => Op::FOrdGreaterThan,
        Op::FUnordGreaterThanEqual => Op::FOrdLessThan,
        _ => return None,
    })
}

fn is_comparison(op: Op) -> bool {
    matches!(
        op,
        Op::ImageSampleDrefImplicitLod
            | Op::ImageSampleDrefExplicitLod
            | Op::ImageSampleProjDrefImplicitLod
            | Op::ImageSampleProjDrefExplicitLod
            | Op::ImageDrefGather
    )
}

fn is_image_read(op: Op) -> bool {
    is_comparison(op)
        || matches!(
            op,
            Op::ImageSampleImplicitLod
                | Op::ImageSampleExplicitLod
                | Op::ImageSampleProjImplicitLod
                | Op::ImageSampleProjExplicitLod
                | Op::ImageFetch
                | Op::ImageRead
                | Op::ImageGather
        )
}

fn declare_demote(module: &mut Builder, id: Word) {
    let void = module.type_void();
    let ty = module.type_function(void, []);
    let def = Instruction::new(
        Op::Function,
        Some(void),
        Some(id),
        vec![
            Operand::FunctionControl(FunctionControl::NONE),
            Operand::IdRef(ty),
        ],
    );
    let label = Instruction::new(Op::Label, None, Some(module.id()), Vec::new());
    let mut function = dr::Function::new();
    function.def = Some(def);
    function.blocks.push(dr::Block {
        label: Some(label),
        instructions: vec![Instruction::new(Op::Kill, None, None, Vec::new())],
    });
    function.end = Some(Instruction::new(Op::FunctionEnd, None, None, Vec::new()));
    module.module_mut().functions.push(function);
    module.name(id, DEMOTE);
}

/// Writes `discard` where [`replace`] calls the function that demotes: SPIR-V has no such
/// instruction inside of a block that naga reads.
pub(super) fn demote(module: &mut Module) {
    let is_demote = |f: &Function| f.name.as_deref() == Some(DEMOTE);
    let all: Vec<_> = module.functions.iter().collect();
    let named = all.into_iter().find(|(_, f)| is_demote(f));
    let Some(demote) = named.map(|(handle, _)| handle) else {
        return;
    };
    fn discard(block: &mut Block, demote: Handle<Function>) {
        for statement in block.iter_mut() {
            match statement {
                Statement::Call { function, .. } if *function == demote => {
                    *statement = Statement::Kill;
                }
                other => operands::blocks_mut(other)
                    .into_iter()
                    .for_each(|b| discard(b, demote)),
            }
        }
    }
    for (_, function) in module.functions.iter_mut() {
        discard(&mut function.body, demote);
    }
    for entry in &mut module.entry_points {
        discard(&mut entry.function.body, demote);
    }
    naga::compact::compact(module, naga::compact::KeepUnused::No);
}

/// Queries the layers where [`replace`] asks an array texture for its samples, which it has not.
pub(crate) fn layers(module: &mut Module) {
    let types = &module.types;
    let globals = &module.global_variables;
    let functions = module.functions.iter_mut().map(|(_, f)| f);
    let entries = module.entry_points.iter_mut().map(|e| &mut e.function);
    for function in functions.chain(entries) {
        let is_array = |image: Handle<Expression>| {
            let ty = match function.expressions[image] {
                Expression::GlobalVariable(handle) => globals[handle].ty,
                Expression::FunctionArgument(i) => function.arguments[i as usize].ty,
                _ => return false,
            };
            matches!(types[ty].inner, TypeInner::Image { arrayed: true, .. })
        };
        let all = function.expressions.iter();
        let found: Vec<Handle<Expression>> = all
            .filter(|(_, e)| {
                matches!(e, Expression::ImageQuery { image, query: ImageQuery::NumSamples } if is_array(*image))
            })
            .map(|(handle, _)| handle)
            .collect();
        for handle in found {
            if let Expression::ImageQuery { query, .. } = &mut function.expressions[handle] {
                *query = ImageQuery::NumLayers;
            }
        }
    }
}
