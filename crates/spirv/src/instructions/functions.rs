//! Functions that WGSL lacks, or supports only for other types.

use rspirv::dr::{Instruction, Operand};
use rspirv::spirv::{GlslStd450Op as Function, Op, Word};

use super::Writer;
use crate::words::{ids, literal};

impl Writer<'_> {
    /// Writes a call of a function, or its replacement.
    pub(super) fn write_function(&mut self, instruction: Instruction, arguments: &[Word]) {
        let function = match instruction.operands.get(1) {
            Some(Operand::LiteralExtInstInteger(n)) => Function::from_u32(*n),
            _ => None,
        };
        let (Some(function), Some(ty)) = (function, self.type_of(arguments)) else {
            self.block.push(instruction);
            return;
        };
        let is_scalar = self.types.size(ty) == 1;
        match (function, arguments) {
            (Function::Modf, [value, pointer]) => {
                let whole = self.glsl(Function::Trunc, ty, &[*value]);
                let store = [*pointer, whole].map(Operand::IdRef).to_vec();
                self.block
                    .push(Instruction::new(Op::Store, None, None, store));
                self.keep_ids(&instruction, Op::FSub, &[*value, whole]);
            }
            (Function::ModfStruct, [value]) => {
                let whole = self.glsl(Function::Trunc, ty, &[*value]);
                let rest = self.push_ids(Op::FSub, ty, &[*value, whole]);
                self.keep_ids(&instruction, Op::CompositeConstruct, &[rest, whole]);
            }
            (Function::NMin, [a, b]) => self.write_chosen(&instruction, Function::FMin, [*a, *b]),
            (Function::NMax, [a, b]) => self.write_chosen(&instruction, Function::FMax, [*a, *b]),
            (Function::NClamp, [value, low, high]) => {
                if [low, high].into_iter().any(|id| self.may_be_nan(*id)) {
                    let limited = self.chosen(Function::FMax, ty, [*value, *low]);
                    self.write_chosen(&instruction, Function::FMin, [limited, *high]);
                } else {
                    let limited = self.glsl(Function::FClamp, ty, arguments);
                    let limited = self.unless_nan(*value, ty, [limited, *low]);
                    self.keep_ids(&instruction, Op::CopyObject, &[limited]);
                }
            }
            (Function::Normalize, [value]) if is_scalar => {
                let size = self.glsl(Function::FAbs, ty, &[*value]);
                self.keep_ids(&instruction, Op::FDiv, &[*value, size]);
            }
            (Function::Reflect, [value, normal]) if is_scalar => {
                let dot = self.push_ids(Op::FMul, ty, &[*normal, *value]);
                let twice = self.push_ids(Op::FAdd, ty, &[dot, dot]);
                let moved = self.push_ids(Op::FMul, ty, &[twice, *normal]);
                self.keep_ids(&instruction, Op::FSub, &[*value, moved]);
            }
            (Function::FaceForward, [normal, value, reference]) if is_scalar => {
                let dot = self.push_ids(Op::FMul, ty, &[*reference, *value]);
                let zero = self.number(ty, 0);
                let bools = self.bools(ty);
                let faces = self.push_ids(Op::FOrdLessThan, bools, &[dot, zero]);
                let other = self.push_ids(Op::FNegate, ty, &[*normal]);
                self.keep_ids(&instruction, Op::Select, &[faces, *normal, other]);
            }
            (Function::Refract, [value, normal, ratio]) if is_scalar => {
                self.write_refract(&instruction, ty, [*value, *normal, *ratio]);
            }
            _ => self.block.push(instruction),
        }
    }

    fn type_of(&self, arguments: &[Word]) -> Option<Word> {
        self.types.values.get(arguments.first()?).copied()
    }

    /// Refraction of scalars, computed by its definition.
    fn write_refract(&mut self, of: &Instruction, ty: Word, [value, normal, ratio]: [Word; 3]) {
        let one = self.number(ty, 1_f32.to_bits());
        let zero = self.number(ty, 0);
        let bools = self.bools(ty);
        let mut push = |op, operands: &[Word]| self.push_ids(op, ty, operands);
        let dot = push(Op::FMul, &[normal, value]);
        let square = push(Op::FMul, &[dot, dot]);
        let rest = push(Op::FSub, &[one, square]);
        let ratios = push(Op::FMul, &[ratio, ratio]);
        let rest = push(Op::FMul, &[ratios, rest]);
        let k = push(Op::FSub, &[one, rest]);
        let along = push(Op::FMul, &[ratio, dot]);
        let incident = push(Op::FMul, &[ratio, value]);
        let root = self.glsl(Function::Sqrt, ty, &[k]);
        let scale = self.push_ids(Op::FAdd, ty, &[along, root]);
        let across = self.push_ids(Op::FMul, ty, &[scale, normal]);
        let bent = self.push_ids(Op::FSub, ty, &[incident, across]);
        let is_reflected = self.push_ids(Op::FOrdLessThan, bools, &[k, zero]);
        self.keep_ids(of, Op::Select, &[is_reflected, zero, bent]);
    }

    /// An outer product: the first vector times each component of the second.
    pub(super) fn write_outer(&mut self, of: &Instruction, [a, b]: [Word; 2]) {
        let columns = self.types.parts(of.result_type.unwrap_or_default());
        let columns = (0..).zip(columns).map(|(n, column)| {
            let path = [Operand::IdRef(b), Operand::LiteralBit32(n)];
            let factor = self.push(Op::CompositeExtract, self.types.scalar(column), path);
            self.push_ids(Op::VectorTimesScalar, column, &[a, factor])
        });
        let columns: Vec<Word> = columns.collect();
        self.keep_ids(of, Op::CompositeConstruct, &columns);
    }

    /// `OpFOrdNotEqual`, which is false for NaN, unlike WGSL's `!=`; or its negation.
    pub(super) fn write_order(&mut self, of: &Instruction, [a, b]: [Word; 2]) {
        let ty = of.result_type.unwrap_or_default();
        let less = self.push_ids(Op::FOrdLessThan, ty, &[a, b]);
        let greater = self.push_ids(Op::FOrdGreaterThan, ty, &[a, b]);
        let or = match self.types.size(ty) {
            1 => Op::LogicalOr,
            _ => Op::BitwiseOr,
        };
        if of.class.opcode == Op::FOrdNotEqual {
            self.keep_ids(of, or, &[less, greater]);
        } else {
            let differ = self.push_ids(or, ty, &[less, greater]);
            self.keep_ids(of, Op::LogicalNot, &[differ]);
        }
    }

    fn write_chosen(&mut self, of: &Instruction, function: Function, operands: [Word; 2]) {
        let ty = of.result_type.unwrap_or_default();
        let chosen = self.chosen(function, ty, operands);
        self.keep_ids(of, Op::CopyObject, &[chosen]);
    }

    /// The minimum or maximum, ignoring NaN. In WGSL a NaN operand could be the result. The SPIR-V
    /// writer turns this back into `NMin` and the like.
    fn chosen(&mut self, function: Function, ty: Word, [a, b]: [Word; 2]) -> Word {
        let either = self.glsl(function, ty, &[a, b]);
        let either = self.unless_nan(b, ty, [either, a]);
        self.unless_nan(a, ty, [either, b])
    }

    /// `value`, or `other` if `of` is NaN.
    fn unless_nan(&mut self, of: Word, ty: Word, [value, other]: [Word; 2]) -> Word {
        if !self.may_be_nan(of) {
            return value;
        }
        let bools = self.bools(ty);
        let (compare, operands) = match self.types.width(of) {
            Some(32) => self.test_bits(Op::IsNan, of),
            _ => (Op::FUnordNotEqual, [of, of]),
        };
        let is_nan = self.push_ids(compare, bools, &operands);
        self.push_ids(Op::Select, ty, &[is_nan, other, value])
    }

    /// Whether a value may be NaN: all but constants of known bits.
    fn may_be_nan(&self, id: Word) -> bool {
        let Some(i) = self.types.globals.get(&id) else {
            return true;
        };
        match i.class.opcode {
            Op::ConstantNull => false,
            Op::ConstantComposite => ids(i).any(|part| self.may_be_nan(part)),
            Op::Constant if self.types.width(id) == Some(32) => {
                let bits = i.operands.first().and_then(literal);
                bits.is_none_or(|bits| f32::from_bits(bits).is_nan())
            }
            _ => true,
        }
    }

    /// The comparison that tests 32-bit floats by their bits, and its operands. WGSL has neither
    /// `isnan` nor `isinf`, and no compiler assumes that the bits are those of a finite number.
    pub(super) fn test_bits(&mut self, test: Op, value: Word) -> (Op, [Word; 2]) {
        let uint = self.module.type_int(32, 0);
        let ty = self.type_of(&[value]).unwrap_or_default();
        let of = match self.types.size(ty) {
            1 => uint,
            n => self.module.type_vector(uint, n),
        };
        self.learn([uint, of]);
        let [magnitude, infinity] = [0x7fff_ffff, 0x7f80_0000].map(|n| self.number(of, n));
        let bits = self.push_ids(Op::Bitcast, of, &[value]);
        let bits = self.push_ids(Op::BitwiseAnd, of, &[bits, magnitude]);
        let compare = match test {
            Op::IsNan => Op::UGreaterThan,
            _ => Op::IEqual,
        };
        (compare, [bits, infinity])
    }
}
