//! Signedness of integers: SPIR-V defines it by the instruction, naga by the type.

use std::ops::Range;

use rspirv::dr::{Instruction, Operand};
use rspirv::spirv::{GlslStd450Op, Op, Word};

use super::Writer;
use crate::words::literal;

impl Writer<'_> {
    /// Casts operands and result to the signedness that the instruction's name implies, because
    /// naga takes it from the type. Returns the instruction that casts the result back.
    pub(super) fn cast_signs(&mut self, instruction: &mut Instruction) -> Option<Instruction> {
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

    /// Whether a type has signed integers. `None` for other types.
    fn is_signed(&self, ty: Word) -> Option<bool> {
        let scalar = self.types.ty(self.types.scalar(ty))?;
        let is_int = scalar.class.opcode == Op::TypeInt;
        is_int.then(|| scalar.operands.get(1).and_then(literal) == Some(1))
    }

    /// The same integer type with the given signedness.
    fn with_sign(&mut self, ty: Word, is_signed: bool) -> Option<Word> {
        let width = self.types.ty(self.types.scalar(ty))?;
        let width = width.operands.first().and_then(literal)?;
        let scalar = self.module.type_int(width, is_signed.into());
        let new = match self.types.size(ty) {
            1 => scalar,
            n => self.module.type_vector(scalar, n),
        };
        self.learn([scalar, new]);
        Some(new)
    }

    /// Records types that the builder created.
    pub(super) fn learn(&mut self, types: [Word; 2]) {
        for id in types {
            let mut all = self.module.module_ref().types_global_values.iter();
            if let Some(i) = all.find(|i| i.result_id == Some(id)) {
                self.types.globals.insert(id, i.clone());
            }
        }
    }
}

/// The signedness of the integers that an instruction reads and returns.
struct Signs {
    /// Indices of the operands whose signedness matters.
    operands: Range<usize>,
    /// `None`: that of the first operand's type.
    operand: Option<bool>,
    /// `None`: that of the operands.
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
            Op::SNegate => both(0..1, true),
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
                    GlslStd450Op::Ldexp => both(3..4, true),
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
