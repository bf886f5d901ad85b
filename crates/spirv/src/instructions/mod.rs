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
//! | `OpFOrdNotEqual`, `OpFUnordEqual` | whether one is less than the other, or not |
//! | `OpCopyLogical`, `OpSelect` of matrices, arrays and structs | the members, one by one |
//! | `OpUndef` | zero |
//! | `OpIsNan`, `OpIsInf` | tests of the bits |
//! | `OpIAddCarry`, `OpISubBorrow`, `OpOuterProduct`, `Modf`, `ModfStruct` | arithmetic |
//! | `NMin`, `NMax`, `NClamp` | `FMin` and its like, and a choice by the bits of what may be NaN |
//! | `Normalize`, `Reflect`, `Refract`, `FaceForward` of scalars | arithmetic |
//! | an instruction on integers of the other sign than its name's | the same between `OpBitcast`s |
//! | the layer of a sampled array texture | rounded to the nearest even (Vulkan 17.5.3) |
//! | the number of layers in `OpImageQuerySize` | `OpImageQuerySamples`, see [`layers`] |
//! | offsets of `OpImageFetch` | added to the coordinates |

mod after_reading;
mod functions;
mod reads;
mod signs;

use std::collections::{HashMap, HashSet};

use rspirv::dr::{Builder, Instruction, Operand};
use rspirv::spirv::{GlslStd450Op, Op, Word};

pub(super) use self::after_reading::demote;
pub use self::after_reading::layers;
use self::reads::is_image_read;
use crate::words::{count_parts, globals, ids, literal, push, replace_ids, rewrite};

/// An instruction that naga misreads and that has no replacement here.
pub struct Lost {
    /// Index of the instruction in the listing.
    pub(super) instruction: Option<u32>,
    /// Name of the part that naga's reader would ignore.
    pub what: &'static str,
}

/// Replaces all instructions of the table above.
pub fn replace(module: &mut Builder) -> Result<(), Lost> {
    define_undefined(module);
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
        after_reading::declare_demote(module, demote);
    }
    lost.map_or(Ok(()), Err)
}

/// Turns undefined values in functions into constants. naga's reader would emit their expressions
/// once for each use.
fn define_undefined(module: &mut Builder) {
    let all = globals(module.module_ref());
    let is_value = |ty: Word| {
        all.get(&ty).is_some_and(|i| {
            !matches!(
                i.class.opcode,
                Op::TypePointer | Op::TypeImage | Op::TypeSampler | Op::TypeSampledImage
            )
        })
    };
    let mut zeros = HashMap::new();
    rewrite(module, |module, block, i| {
        match (i.class.opcode, i.result_type, i.result_id) {
            (Op::Undef, Some(ty), Some(id)) if is_value(ty) => {
                zeros.insert(id, module.constant_null(ty));
            }
            _ => block.push(i),
        }
    });
    if !zeros.is_empty() {
        replace_ids(module, &zeros);
    }
}

/// Types of values, and definitions of types.
struct Types {
    globals: HashMap<Word, Instruction>,
    values: HashMap<Word, Word>,
    constants: HashSet<Word>,
    /// The textures behind copies of textures.
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

    /// Number of bits of a value's scalars.
    fn width(&self, value: Word) -> Option<u32> {
        let scalar = self.ty(self.scalar(*self.values.get(&value)?))?;
        scalar.operands.first().and_then(literal)
    }

    /// Whether a type is a struct, array or matrix.
    fn has_parts(&self, ty: Word) -> bool {
        let op = self.ty(ty).map(|i| i.class.opcode);
        matches!(op, Some(Op::TypeStruct | Op::TypeArray | Op::TypeMatrix))
    }

    /// The types of a type's members, elements or columns.
    fn parts(&self, ty: Word) -> Vec<Word> {
        let Some(i) = self.ty(ty) else {
            return Vec::new();
        };
        let first = ids(i).next().unwrap_or_default();
        let count = match i.class.opcode {
            Op::TypeStruct => return ids(i).collect(),
            Op::TypeArray => {
                let length = ids(i).nth(1).and_then(|n| self.ty(n));
                length.and_then(|n| n.operands.first()).and_then(literal)
            }
            Op::TypeMatrix => i.operands.get(1).and_then(literal),
            _ => None,
        };
        vec![first; count.unwrap_or(0) as usize]
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
    /// The function that demotes, once one is needed.
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

    /// Writes an instruction with the same result id.
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

    fn write_one(&mut self, instruction: Instruction) -> Written {
        let operands: Vec<Word> = ids(&instruction).collect();
        let result = instruction.result_type.zip(instruction.result_id);
        match (instruction.class.opcode, result, operands.as_slice()) {
            // Memory access flags only matter to optimisers.
            (Op::Load, ..) => self.keep_ids(&instruction, Op::Load, &operands[..1]),
            (Op::Store, ..) => {
                let operands = instruction.operands[..2].to_vec();
                self.block
                    .push(Instruction::new(Op::Store, None, None, operands));
            }
            // The reader does not recognise copies of textures.
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
            // The reader confuses these with WGSL's bitwise operators, which vectors of bools have.
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
                // `OpSRem` has the sign of the dividend, and `OpSMod` that of the divisor.
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
            (Op::FOrdNotEqual | Op::FUnordEqual, Some(_), [a, b]) => {
                self.write_order(&instruction, [*a, *b]);
            }
            (Op::OuterProduct, Some(_), [a, b]) => self.write_outer(&instruction, [*a, *b]),
            (Op::CopyLogical, Some((ty, _)), [from]) => {
                let copy = self.by_parts(ty, &[*from], &|_, _, parts| parts[0])?;
                self.keep_ids(&instruction, Op::CopyObject, &[copy]);
            }
            (Op::Select, Some((ty, _)), [condition, a, b]) if self.types.has_parts(ty) => {
                let all = [*a, *b];
                let made = self.by_parts(ty, &all, &|own, ty, parts| {
                    own.push_ids(Op::Select, ty, &[&[*condition], parts].concat())
                })?;
                self.keep_ids(&instruction, Op::CopyObject, &[made]);
            }
            (Op::IsNan | Op::IsInf, Some(_), [value]) if self.types.width(*value) == Some(32) => {
                let (compare, bits) = self.test_bits(instruction.class.opcode, *value);
                self.keep_ids(&instruction, compare, &bits);
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
                let arguments = [&[*value], rest].concat();
                self.write_function(instruction, &arguments);
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

    /// The boolean type with as many components as `ty`.
    fn bools(&mut self, ty: Word) -> Word {
        let bool = self.module.type_bool();
        match self.types.size(ty) {
            1 => bool,
            n => self.module.type_vector(bool, n),
        }
    }

    /// A constant of a type with `n` in each component.
    fn number(&mut self, ty: Word, n: u32) -> Word {
        let scalar = self.types.scalar(ty);
        let one = self.module.constant_bit32(scalar, n);
        match self.types.size(ty) {
            1 => one,
            size => self.module.constant_composite(ty, vec![one; size as usize]),
        }
    }

    /// Builds a value of a type from values of the same shape, part by part.
    fn by_parts(
        &mut self,
        to: Word,
        from: &[Word],
        make: &impl Fn(&mut Self, Word, &[Word]) -> Word,
    ) -> Result<Word, &'static str> {
        if count_parts(&self.types.globals, to, false) > MOST_COPIED {
            return Err("a copy or a choice of a large array");
        }
        Ok(self.by_members(to, from, make))
    }

    fn by_members(
        &mut self,
        to: Word,
        from: &[Word],
        make: &impl Fn(&mut Self, Word, &[Word]) -> Word,
    ) -> Word {
        if !self.types.has_parts(to) {
            return make(self, to, from);
        }
        let mut parts = Vec::new();
        for (n, member) in self.types.parts(to).into_iter().enumerate() {
            let mut own = Vec::new();
            for value in from {
                let ty = self.types.values.get(value).copied().unwrap_or_default();
                let of = self.types.parts(ty).get(n).copied().unwrap_or(member);
                let path = [Operand::IdRef(*value), Operand::LiteralBit32(n as u32)];
                own.push(self.push(Op::CompositeExtract, of, path));
            }
            parts.push(self.by_members(member, &own, make));
        }
        self.push_ids(Op::CompositeConstruct, to, &parts)
    }
}

/// Values with more parts are not copied part by part.
const MOST_COPIED: u32 = 1024;

/// The ordered comparison that negates an unordered one.
fn opposite(op: Op) -> Option<Op> {
    Some(match op {
        Op::FUnordLessThan => Op::FOrdGreaterThanEqual,
        Op::FUnordGreaterThan => Op::FOrdLessThanEqual,
        Op::FUnordLessThanEqual => Op::FOrdGreaterThan,
        Op::FUnordGreaterThanEqual => Op::FOrdLessThan,
        _ => return None,
    })
}
