//! Completes a block with the members and names that another stage has for it. `spirv-opt -Os`
//! drops unread members but keeps the offsets of the others, and SPIR-V's names have no meaning.
//! [`super::layout`] sorts the members by offset.

use std::collections::{HashMap, HashSet};

use rspirv::dr::{Builder, Instruction, Module, Operand};
use rspirv::spirv::{Decoration, Op, Word};

use crate::words::{decorations, globals, ids, literal, member_decorations};

/// Completes the blocks of all modules that share a binding.
pub(super) fn complete(modules: &mut [Module]) {
    for to in 0..modules.len() {
        for from in (0..modules.len()).filter(|from| *from != to) {
            of_pairs(modules, (to, from), |copier, own, other| {
                copier.extend(own, other)
            });
        }
    }
    for to in 1..modules.len() {
        for from in 0..to {
            of_pairs(modules, (to, from), |copier, own, other| {
                copier.rename(own, other)
            });
        }
    }
}

/// Completes the blocks of one module from those of another.
fn of_pairs(
    modules: &mut [Module],
    (to, from): (usize, usize),
    change: impl Fn(&mut Copier<'_>, Word, Word),
) {
    let source = Blocks::of(&modules[from]);
    let target = Blocks::of(&modules[to]);
    let pairs = target.bound().into_iter().filter_map(|(place, own)| {
        let mut others = source.bound().into_iter();
        let (_, other) = others.find(|(of, _)| *of == place)?;
        target.fits(own, &source, other).then_some((own, other))
    });
    let pairs: Vec<(Word, Word)> = pairs.collect();
    if pairs.is_empty() {
        return;
    }
    let module = std::mem::take(&mut modules[to]);
    let mut copier = Copier {
        source: &source,
        target,
        module: Builder::new_from_module(module),
    };
    for (own, other) in pairs {
        change(&mut copier, own, other);
    }
    modules[to] = copier.module.module();
}

/// Descriptor set and binding.
type MemberPlace = (u32, u32);

/// The blocks of a module.
struct Blocks {
    globals: HashMap<Word, Instruction>,
    strides: HashMap<Word, u32>,
    members: HashMap<(Word, u32), Vec<Instruction>>,
    names: Vec<Instruction>,
    sets: HashMap<Word, u32>,
    bindings: HashMap<Word, u32>,
    /// Types whose values are constructed from their members.
    constructed: HashSet<Word>,
}

impl Blocks {
    fn of(module: &Module) -> Self {
        let all = module.all_inst_iter();
        let constructed = all.filter(|i| {
            matches!(
                i.class.opcode,
                Op::CompositeConstruct | Op::ConstantComposite | Op::SpecConstantComposite
            )
        });
        Self {
            globals: globals(module),
            strides: decorations(module, Decoration::ArrayStride),
            members: member_decorations(module),
            names: module.debug_names.clone(),
            sets: decorations(module, Decoration::DescriptorSet),
            bindings: decorations(module, Decoration::Binding),
            constructed: constructed.filter_map(|i| i.result_type).collect(),
        }
    }

    /// The bindings of variables, with the types of their values.
    fn bound(&self) -> Vec<(MemberPlace, Word)> {
        let all = self.bindings.iter().filter_map(|(id, binding)| {
            let pointer = self.globals.get(id)?.result_type?;
            let value = ids(self.globals.get(&pointer)?).next()?;
            Some(((*self.sets.get(id)?, *binding), value))
        });
        all.collect()
    }

    fn op(&self, ty: Word) -> Option<Op> {
        self.globals.get(&ty).map(|i| i.class.opcode)
    }

    fn number(&self, ty: Word, operand: usize) -> u32 {
        let found = self.globals.get(&ty).and_then(|i| i.operands.get(operand));
        found.and_then(literal).unwrap_or(0)
    }

    fn part(&self, ty: Word) -> Word {
        self.globals
            .get(&ty)
            .and_then(|i| ids(i).next())
            .unwrap_or_default()
    }

    /// The length of an array. `None` if it is not constant.
    fn length(&self, ty: Word) -> Option<u32> {
        let length = ids(self.globals.get(&ty)?).nth(1)?;
        (self.op(length) == Some(Op::Constant)).then(|| self.number(length, 0))
    }

    /// The innermost element type of nested arrays. Other types are returned unchanged.
    fn inner(&self, ty: Word) -> Word {
        match self.op(ty) {
            Some(Op::TypeArray | Op::TypeRuntimeArray) => self.inner(self.part(ty)),
            _ => ty,
        }
    }

    fn decoration(&self, of: Word, member: u32, kind: Decoration) -> Option<u32> {
        let all = self.members.get(&(of, member))?;
        let is = |i: &&Instruction| i.operands.get(2) == Some(&Operand::Decoration(kind));
        let found = all.iter().find(is)?;
        Some(found.operands.get(3).and_then(literal).unwrap_or(1))
    }

    /// Index, offset, type and end of each member with an offset.
    fn members_of(&self, ty: Word) -> Vec<(u32, u32, Word, u32)> {
        let all = self.globals.get(&ty).into_iter().flat_map(ids);
        let placed = (0..).zip(all).filter_map(|(n, member)| {
            let at = self.decoration(ty, n, Decoration::Offset)?;
            let size = self.size(member, self.decoration(ty, n, Decoration::MatrixStride));
            Some((n, at, member, at.saturating_add(size)))
        });
        placed.collect()
    }

    fn size(&self, ty: Word, matrix: Option<u32>) -> u32 {
        let (of, count) = (self.part(ty), self.number(ty, 1));
        match self.op(ty) {
            Some(Op::TypeInt | Op::TypeFloat) => self.number(ty, 0) / 8,
            Some(Op::TypeVector) => self.size(of, None).saturating_mul(count),
            // A row-major matrix may be larger. Members then overlap, and nothing is completed.
            Some(Op::TypeMatrix) => matrix.unwrap_or(16).saturating_mul(count),
            Some(Op::TypeArray) => {
                let stride = self.strides.get(&ty).copied().unwrap_or(0);
                self.length(ty)
                    .map_or(u32::MAX, |n| stride.saturating_mul(n))
            }
            Some(Op::TypeStruct) => {
                let ends = self.members_of(ty).into_iter().map(|(.., end)| end);
                ends.max().unwrap_or(0)
            }
            _ => u32::MAX,
        }
    }

    /// Whether a type equals one of another module, except for members that either of them lacks.
    fn fits(&self, own: Word, others: &Self, other: Word) -> bool {
        if self.op(own) != others.op(other) {
            return false;
        }
        match self.op(own) {
            Some(Op::TypeStruct) => {
                let other_members = others.members_of(other);
                self.members_of(own).into_iter().all(|(n, at, ty, end)| {
                    other_members
                        .iter()
                        .all(|(m, other_at, other_ty, other_end)| {
                            let kinds = [Decoration::MatrixStride, Decoration::RowMajor];
                            let same = |kind| {
                                self.decoration(own, n, kind) == others.decoration(other, *m, kind)
                            };
                            match at == *other_at {
                                true => {
                                    kinds.into_iter().all(same) && self.fits(ty, others, *other_ty)
                                }
                                false => end <= *other_at || *other_end <= at,
                            }
                        })
                })
            }
            Some(Op::TypeArray | Op::TypeRuntimeArray) => {
                self.length(own) == others.length(other)
                    && self.strides.get(&own) == others.strides.get(&other)
                    && self.fits(self.part(own), others, others.part(other))
            }
            Some(Op::TypeVector | Op::TypeMatrix) => {
                self.number(own, 1) == others.number(other, 1)
                    && self.fits(self.part(own), others, others.part(other))
            }
            Some(Op::TypeInt | Op::TypeFloat) => {
                let [a, b] = [(self, own), (others, other)].map(|(all, ty)| all.globals.get(&ty));
                a.map(|i| &i.operands) == b.map(|i| &i.operands)
            }
            _ => false,
        }
    }
}

struct Copier<'a> {
    source: &'a Blocks,
    target: Blocks,
    module: Builder,
}

impl Copier<'_> {
    /// Appends the members that a struct lacks.
    fn extend(&mut self, own: Word, other: Word) {
        let (own, other) = (self.target.inner(own), self.source.inner(other));
        if self.target.op(own) != Some(Op::TypeStruct) || self.target.constructed.contains(&own) {
            return;
        }
        let mut added = Vec::new();
        for (n, at, ty, _) in self.source.members_of(other) {
            let members = self.target.members_of(own);
            match members.iter().find(|(_, own_at, ..)| *own_at == at) {
                Some((_, _, of, _)) => self.extend(*of, ty),
                None => added.extend(self.copy(ty).map(|copy| (n, copy))),
            }
        }
        for (n, copy) in added {
            let Some(i) = self.target.globals.get_mut(&own) else {
                return;
            };
            let at = i.operands.len() as u32;
            i.operands.push(Operand::IdRef(copy));
            let types = &mut self.module.module_mut().types_global_values;
            for ty in types.iter_mut().filter(|ty| ty.result_id == Some(own)) {
                ty.operands.push(Operand::IdRef(copy));
            }
            self.describe((other, n), (own, at));
        }
    }

    /// Copies the names of a struct and its members from the other module.
    fn rename(&mut self, own: Word, other: Word) {
        let (own, other) = (self.target.inner(own), self.source.inner(other));
        if self.target.op(own) != Some(Op::TypeStruct) {
            return;
        }
        let source = self.source;
        let name_of = |head: &[Operand]| {
            let mut names = source.names.iter();
            names.find_map(|i| match i.operands.split_last() {
                Some((Operand::LiteralString(name), of)) if of == head => Some(name.clone()),
                _ => None,
            })
        };
        let names = &mut self.module.module_mut().debug_names;
        names.retain(|i| ids(i).next() != Some(own));
        // As `names` does for unnamed structs.
        let name = name_of(&[Operand::IdRef(other)]);
        self.module
            .name(own, name.unwrap_or_else(|| format!("_{other}")));
        let members = self.target.members_of(own);
        for (n, at, ty, _) in source.members_of(other) {
            if let Some((index, _, of, _)) = members.iter().find(|(_, own_at, ..)| *own_at == at) {
                let name = name_of(&[Operand::IdRef(other), Operand::LiteralBit32(n)]);
                let name = name.unwrap_or_else(|| format!("_m{n}"));
                self.module.member_name(own, *index, name);
                self.rename(*of, ty);
            }
        }
    }

    /// Copies a member's name and decorations from another module.
    fn describe(&mut self, (from, n): (Word, u32), (to, at): (Word, u32)) {
        let moved = |i: &Instruction| {
            let mut i = i.clone();
            i.operands[0] = Operand::IdRef(to);
            i.operands[1] = Operand::LiteralBit32(at);
            i
        };
        let is_own = |i: &&Instruction| {
            i.operands.first() == Some(&Operand::IdRef(from))
                && i.operands.get(1) == Some(&Operand::LiteralBit32(n))
        };
        let decorations = self.source.members.get(&(from, n)).into_iter().flatten();
        let decorations: Vec<Instruction> = decorations.map(moved).collect();
        let module = self.module.module_mut();
        module.annotations.extend(decorations.iter().cloned());
        let names = self.source.names.iter();
        module.debug_names.extend(names.filter(is_own).map(moved));
        self.target.members.insert((to, at), decorations);
    }

    /// Copies a type from the other module. `None` if its size is not constant.
    fn copy(&mut self, ty: Word) -> Option<Word> {
        let source = self.source;
        let of = source.part(ty);
        let new = match source.op(ty)? {
            Op::TypeFloat => self.module.type_float(source.number(ty, 0), None),
            Op::TypeInt => self
                .module
                .type_int(source.number(ty, 0), source.number(ty, 1)),
            Op::TypeVector => {
                let scalar = self.copy(of)?;
                self.module.type_vector(scalar, source.number(ty, 1))
            }
            Op::TypeMatrix => {
                let column = self.copy(of)?;
                self.module.type_matrix(column, source.number(ty, 1))
            }
            Op::TypeArray => {
                let (element, length) = (self.copy(of)?, source.length(ty)?);
                let uint = self.module.type_int(32, 0);
                let length = self.module.constant_bit32(uint, length);
                let new = self.declare(Op::TypeArray, &[element, length]);
                if let Some(stride) = source.strides.get(&ty) {
                    let stride = Operand::LiteralBit32(*stride);
                    self.module.decorate(new, Decoration::ArrayStride, [stride]);
                }
                new
            }
            Op::TypeStruct => {
                let members: Option<Vec<Word>> = ids(source.globals.get(&ty)?)
                    .map(|member| self.copy(member))
                    .collect();
                let members = members?;
                let new = self.declare(Op::TypeStruct, &members);
                for n in 0..members.len() as u32 {
                    self.describe((ty, n), (new, n));
                }
                for name in &source.names {
                    if let [Operand::IdRef(id), Operand::LiteralString(name)] = &name.operands[..]
                        && *id == ty
                    {
                        self.module.name(new, name.clone());
                    }
                }
                new
            }
            _ => return None,
        };
        let mut all = self.module.module_ref().types_global_values.iter();
        let found = all.find(|i| i.result_id == Some(new))?.clone();
        self.target.globals.insert(new, found);
        Some(new)
    }

    fn declare(&mut self, op: Op, operands: &[Word]) -> Word {
        let id = self.module.id();
        let operands = operands.iter().copied().map(Operand::IdRef).collect();
        let i = Instruction::new(op, None, Some(id), operands);
        self.module.module_mut().types_global_values.push(i);
        id
    }
}
