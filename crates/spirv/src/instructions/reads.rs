//! Replaces samples, gathers and fetches of textures.

use rspirv::dr::{Instruction, Operand};
use rspirv::spirv::{Dim, GlslStd450Op, ImageOperands, Op, Word};

use super::{Writer, Written, is_arrayed};

impl Writer<'_> {
    /// Writes a sample, gather or fetch that naga reads.
    pub(super) fn write_read(
        &mut self,
        mut instruction: Instruction,
        image: Option<&Instruction>,
    ) -> Written {
        let op = instruction.class.opcode;
        let is_fetch = matches!(op, Op::ImageFetch | Op::ImageRead);
        let found = instruction.operands.iter().enumerate();
        let mut mask = found.filter_map(|(i, o)| match o {
            Operand::ImageOperands(mask) => Some((i, *mask)),
            _ => None,
        });
        if let Some((at, mask)) = mask.next_back() {
            let mut given = OptionalOperands::of(&instruction, at, mask);
            // These flags only affect how memory is read and how texels are converted.
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
            if compares && given.get(ImageOperands::BIAS).is_some() {
                return Err("a comparison with a bias");
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

    /// Adds an offset to the coordinates, except for the layer.
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
                // A constant of a vector and a scalar would be invalid in naga.
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

    /// Rounds the layer, which follows the coordinates. More components may follow it, such as
    /// glslang's depth.
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

/// Optional image operands of an instruction, with their ids.
struct OptionalOperands {
    all: Vec<(ImageOperands, Vec<Word>)>,
}

impl OptionalOperands {
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

pub(super) fn is_image_read(op: Op) -> bool {
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
