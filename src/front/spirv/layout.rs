//! Gives blocks a layout that WGSL can express: columns for rows, and padding for strides.
//!
//! | in memory | becomes |
//! |---|---|
//! | a block that begins at an offset | the same, after padding |
//! | a row-major matrix | its transpose |
//! | an array whose stride is larger than its elements | an array of structs with padding |
//! | a matrix whose stride is larger than its columns, as `mat2` in std140 | the same, of its columns |
//!
//! Only memory changes: a loaded value has the author's type. The bytes stay where they are.

use std::collections::HashMap;
use std::rc::Rc;

use preshade_passes::declared::padding;
use rspirv::dr::{Builder, Instruction, Operand};
use rspirv::spirv::{Decoration, Op, StorageClass, Word};

use super::combined::names;
use crate::words::{decorations, globals, ids, literal, push, rewrite, storage_class};

/// Larger arrays are not loaded as a whole.
const MOST_ELEMENTS: u32 = 256;

/// How a value lies in memory.
#[derive(Debug)]
enum Memory {
    /// As its type says.
    Same(Word),
    Struct {
        ty: Word,
        /// The author's.
        members: Vec<Rc<Memory>>,
        /// The number of members before them, which fill the space.
        pads: u32,
    },
    Array {
        ty: Word,
        element: Rc<Memory>,
        is_wrapped: bool,
    },
    /// The columns, or the rows if it is transposed, one by one in an array if they are wrapped.
    Matrix {
        ty: Word,
        is_transposed: bool,
        /// Type of a column or row in memory, if they are wrapped.
        wrapped: Option<Word>,
        /// The matrix of the columns in memory.
        matrix: Word,
    },
}

impl Memory {
    fn ty(&self) -> Word {
        match self {
            Self::Same(ty)
            | Self::Struct { ty, .. }
            | Self::Array { ty, .. }
            | Self::Matrix { ty, .. } => *ty,
        }
    }

    fn is_same(&self) -> bool {
        matches!(self, Self::Same(_))
    }
}

/// A pointer to changed memory.
#[derive(Clone)]
struct Place {
    pointer: Word,
    class: StorageClass,
    memory: Rc<Memory>,
    /// The type of the value there.
    value: Word,
    /// The column of a transposed matrix: its components lie apart.
    column: Option<Word>,
}

/// Why a block has no layout in WGSL, and the instruction that says so.
pub(super) struct Unfit {
    /// Id of the type; 0 for a use, and then `line` says where.
    pub(super) id: Word,
    pub(super) line: Option<u32>,
    pub(super) why: String,
}

/// Changes the layout of all blocks. Returns the structs and members that the author has by rows.
pub(super) fn fit(module: &mut Builder) -> Result<Vec<(String, String)>, Unfit> {
    let mut layouts = Layouts::of(module);
    let blocks: Vec<Instruction> = module
        .module_ref()
        .types_global_values
        .iter()
        .filter(|i| i.class.opcode == Op::Variable)
        .filter(|i| {
            matches!(
                storage_class(i),
                Some(
                    StorageClass::Uniform
                        | StorageClass::StorageBuffer
                        | StorageClass::PushConstant
                )
            )
        })
        .cloned()
        .collect();
    for variable in blocks {
        let (Some(id), Some(class)) = (variable.result_id, storage_class(&variable)) else {
            continue;
        };
        let pointer = variable.result_type.and_then(|ty| layouts.globals.get(&ty));
        let Some(value) = pointer.and_then(|p| ids(p).next()) else {
            continue;
        };
        let memory = layouts.memory(module, value, None)?;
        if memory.is_same() {
            continue;
        }
        let pointer = module.type_pointer(None, class, memory.ty());
        let all = &mut module.module_mut().types_global_values;
        for i in all.iter_mut().filter(|i| i.result_id == Some(id)) {
            i.result_type = Some(pointer);
        }
        layouts.places.insert(
            id,
            Place {
                pointer: id,
                class,
                memory,
                value,
                column: None,
            },
        );
    }
    if layouts.places.is_empty() {
        return Ok(Vec::new());
    }
    let mut line = None;
    let mut failed = None;
    rewrite(module, |module, block, i| {
        if i.class.opcode == Op::Line {
            line = i.operands.get(1).and_then(literal);
        }
        if let Err(why) = layouts.write(module, block, i)
            && failed.is_none()
        {
            failed = Some(Unfit { id: 0, line, why });
        }
    });
    failed.map_or(Ok(layouts.rows), Err)
}

/// How a struct's member holds its matrices.
#[derive(Clone, Copy)]
struct Held {
    is_row_major: bool,
    stride: u32,
}

struct Layouts {
    globals: HashMap<Word, Instruction>,
    strides: HashMap<Word, u32>,
    names: HashMap<Word, String>,
    /// The decorations of members, by struct and index.
    members: HashMap<(Word, u32), Vec<Instruction>>,
    known: HashMap<Word, Rc<Memory>>,
    /// Structs and members by rows.
    rows: Vec<(String, String)>,
    places: HashMap<Word, Place>,
}

impl Layouts {
    fn of(module: &Builder) -> Self {
        let module = module.module_ref();
        let mut members: HashMap<(Word, u32), Vec<Instruction>> = HashMap::new();
        for i in &module.annotations {
            if let (Op::MemberDecorate, [Operand::IdRef(id), Operand::LiteralBit32(n), ..]) =
                (i.class.opcode, i.operands.as_slice())
            {
                members.entry((*id, *n)).or_default().push(i.clone());
            }
        }
        Self {
            globals: globals(module),
            strides: decorations(module, Decoration::ArrayStride),
            names: names(module),
            members,
            known: HashMap::new(),
            rows: Vec::new(),
            places: HashMap::new(),
        }
    }

    fn held(&self, of: Word, member: u32) -> Option<Held> {
        let all = self.members.get(&(of, member))?;
        let find = |kind: Decoration| {
            let mut all = all.iter();
            all.find(|i| i.operands.get(2) == Some(&Operand::Decoration(kind)))
        };
        Some(Held {
            is_row_major: find(Decoration::RowMajor).is_some(),
            stride: find(Decoration::MatrixStride)?
                .operands
                .get(3)
                .and_then(literal)?,
        })
    }

    fn offset(&self, of: Word, member: u32) -> Option<u32> {
        let all = self.members.get(&(of, member))?;
        let is =
            |i: &&Instruction| i.operands.get(2) == Some(&Operand::Decoration(Decoration::Offset));
        all.iter().find(is)?.operands.get(3).and_then(literal)
    }

    fn number(&self, id: Word) -> Option<u32> {
        self.globals.get(&id)?.operands.first().and_then(literal)
    }

    fn part(&self, ty: Word, n: usize) -> Option<Word> {
        ids(self.globals.get(&ty)?).nth(n)
    }

    /// The count in a vector's or a matrix's type.
    fn count(&self, ty: Word) -> u32 {
        let i = self.globals.get(&ty);
        i.and_then(|i| i.operands.get(1))
            .and_then(literal)
            .unwrap_or(1)
    }

    fn declare(&mut self, module: &mut Builder, op: Op, operands: Vec<Operand>) -> Word {
        let id = module.id();
        let i = Instruction::new(op, None, Some(id), operands);
        module.module_mut().types_global_values.push(i.clone());
        self.globals.insert(id, i);
        id
    }

    /// Size and alignment in bytes, by WGSL's rules.
    fn size(&self, ty: Word) -> (u32, u32) {
        let Some(i) = self.globals.get(&ty) else {
            return (4, 4);
        };
        match i.class.opcode {
            Op::TypeInt | Op::TypeFloat => {
                let bytes = i.operands.first().and_then(literal).unwrap_or(32) / 8;
                (bytes, bytes)
            }
            Op::TypeVector => {
                let (one, _) = self.size(ids(i).next().unwrap_or_default());
                let n = self.count(ty);
                (one * n, one * n.next_power_of_two())
            }
            Op::TypeMatrix => {
                let (_, align) = self.size(ids(i).next().unwrap_or_default());
                (align * self.count(ty), align)
            }
            Op::TypeArray => {
                let (_, align) = self.size(ids(i).next().unwrap_or_default());
                let length = ids(i).nth(1).and_then(|n| self.number(n)).unwrap_or(1);
                let stride = self.strides.get(&ty).copied().unwrap_or(align);
                (stride.saturating_mul(length), align)
            }
            Op::TypeRuntimeArray => {
                let (_, align) = self.size(ids(i).next().unwrap_or_default());
                (self.strides.get(&ty).copied().unwrap_or(align), align)
            }
            Op::TypeStruct => {
                let mut end = 0_u32;
                let mut most = 1;
                for (n, member) in ids(i).enumerate() {
                    let (size, align) = self.size(member);
                    let at = self.offset(ty, n as u32);
                    end = at
                        .unwrap_or_else(|| end.next_multiple_of(align))
                        .saturating_add(size);
                    most = most.max(align);
                }
                (end.checked_next_multiple_of(most).unwrap_or(end), most)
            }
            _ => (4, 4),
        }
    }

    /// How a type lies in memory; `held` says how the matrices in it do.
    fn memory(
        &mut self,
        module: &mut Builder,
        ty: Word,
        held: Option<Held>,
    ) -> Result<Rc<Memory>, Unfit> {
        let Some(i) = self.globals.get(&ty).cloned() else {
            return Ok(Rc::new(Memory::Same(ty)));
        };
        Ok(match i.class.opcode {
            Op::TypeStruct => {
                if let Some(known) = self.known.get(&ty) {
                    return Ok(Rc::clone(known));
                }
                let memory = Rc::new(self.struct_memory(module, ty, &i)?);
                self.known.insert(ty, Rc::clone(&memory));
                memory
            }
            Op::TypeArray | Op::TypeRuntimeArray => {
                let of = ids(&i).next().unwrap_or_default();
                let element = self.memory(module, of, held)?;
                let (size, align) = self.size(element.ty());
                let natural = size.next_multiple_of(align);
                let stride = self.strides.get(&ty).copied().unwrap_or(natural);
                let inner = self.wrapped(module, ty, element.ty(), stride)?;
                if inner == element.ty() && element.is_same() {
                    return Ok(Rc::new(Memory::Same(ty)));
                }
                let is_wrapped = inner != element.ty();
                let mut operands = i.operands.clone();
                operands[0] = Operand::IdRef(inner);
                let new = self.declare(module, i.class.opcode, operands);
                self.decorate_stride(module, new, stride);
                Rc::new(Memory::Array {
                    ty: new,
                    element,
                    is_wrapped,
                })
            }
            Op::TypeMatrix => {
                let Some(Held {
                    is_row_major,
                    stride,
                }) = held
                else {
                    return Ok(Rc::new(Memory::Same(ty)));
                };
                let column = ids(&i).next().unwrap_or_default();
                let scalar = self.part(column, 0).unwrap_or_default();
                let (columns, rows) = (self.count(ty), self.count(column));
                let (vector, count, matrix) = match is_row_major {
                    false => (column, columns, ty),
                    true => {
                        let row = module.type_vector(scalar, columns);
                        let matrix = module.type_matrix(row, rows);
                        self.learn(module, row);
                        self.learn(module, matrix);
                        (row, rows, matrix)
                    }
                };
                let inner = self.wrapped(module, ty, vector, stride)?;
                let wrapped = (inner != vector).then_some(vector);
                let new = match wrapped {
                    None if !is_row_major => return Ok(Rc::new(Memory::Same(ty))),
                    None => matrix,
                    Some(_) => {
                        let uint = module.type_int(32, 0);
                        let length = module.constant_bit32(uint, count);
                        self.learn(module, length);
                        let operands = [inner, length].map(Operand::IdRef).to_vec();
                        let array = self.declare(module, Op::TypeArray, operands);
                        self.decorate_stride(module, array, stride);
                        array
                    }
                };
                Rc::new(Memory::Matrix {
                    ty: new,
                    is_transposed: is_row_major,
                    wrapped,
                    matrix,
                })
            }
            _ => Rc::new(Memory::Same(ty)),
        })
    }

    fn struct_memory(
        &mut self,
        module: &mut Builder,
        ty: Word,
        i: &Instruction,
    ) -> Result<Memory, Unfit> {
        let mut members = Vec::new();
        for (n, member) in ids(i).enumerate() {
            let held = self.held(ty, n as u32);
            members.push(self.memory(module, member, held)?);
        }
        // Members need not be in the order of their offsets.
        let offsets = (0..members.len() as u32).filter_map(|n| self.offset(ty, n));
        let gap = offsets.min().unwrap_or(0);
        if gap == 0 && members.iter().all(|m| m.is_same()) {
            return Ok(Memory::Same(ty));
        }
        let fill = self.fill(module, gap);
        let pads = fill.len() as u32;
        let all = fill
            .iter()
            .map(|(ty, _)| *ty)
            .chain(members.iter().map(|m| m.ty()));
        let operands = all.map(Operand::IdRef).collect();
        let new = self.declare(module, Op::TypeStruct, operands);
        let name = self
            .names
            .get(&ty)
            .cloned()
            .unwrap_or_else(|| format!("_{ty}"));
        for (n, (_, at)) in fill.iter().enumerate() {
            module.member_name(new, n as u32, padding(&name, at));
            self.place_member(module, new, n as u32, *at);
        }
        module.name(new, name.clone());
        let mut copied = Vec::new();
        for i in &module.module_ref().debug_names {
            if let [Operand::IdRef(of), rest @ ..] = i.operands.as_slice()
                && *of == ty
                && i.class.opcode == Op::MemberName
            {
                copied.push(rest.to_vec());
                if let [Operand::LiteralBit32(n), Operand::LiteralString(member)] = rest
                    && self.held(ty, *n).is_some_and(|held| held.is_row_major)
                {
                    self.rows.push((name.clone(), member.clone()));
                }
            }
        }
        let moved = |n: &mut Operand| {
            if let Operand::LiteralBit32(n) = n {
                *n += pads;
            }
        };
        for mut rest in copied {
            rest.first_mut().into_iter().for_each(moved);
            let operands = [vec![Operand::IdRef(new)], rest].concat();
            let name = Instruction::new(Op::MemberName, None, None, operands);
            module.module_mut().debug_names.push(name);
        }
        let is_row_major = Operand::Decoration(Decoration::RowMajor);
        let own: Vec<Instruction> = module
            .module_ref()
            .annotations
            .iter()
            .filter(|i| ids(i).next() == Some(ty) && !i.operands.contains(&is_row_major))
            .cloned()
            .collect();
        for mut decoration in own {
            decoration.operands[0] = Operand::IdRef(new);
            if decoration.class.opcode == Op::MemberDecorate {
                decoration.operands.get_mut(1).into_iter().for_each(moved);
                let n = decoration
                    .operands
                    .get(1)
                    .and_then(literal)
                    .unwrap_or_default();
                let all = self.members.entry((new, n)).or_default();
                all.push(decoration.clone());
            }
            module.module_mut().annotations.push(decoration);
        }
        Ok(Memory::Struct {
            ty: new,
            members,
            pads,
        })
    }

    /// Types and offsets of members that fill the first bytes of a block.
    fn fill(&mut self, module: &mut Builder, bytes: u32) -> Vec<(Word, u32)> {
        if bytes == 0 {
            return Vec::new();
        }
        let float = module.type_float(32, None);
        let vector = module.type_vector(float, 4);
        for id in [float, vector] {
            self.learn(module, id);
        }
        let whole = bytes / 16 * 16;
        let vectors = (0..whole).step_by(16).map(|at| (vector, at));
        vectors
            .chain((whole..bytes).step_by(4).map(|at| (float, at)))
            .collect()
    }

    /// Takes note of a definition that the builder made.
    fn learn(&mut self, module: &Builder, id: Word) {
        let mut all = module.module_ref().types_global_values.iter();
        if let Some(i) = all.find(|i| i.result_id == Some(id)) {
            self.globals.insert(id, i.clone());
        }
    }

    fn place_member(&mut self, module: &mut Builder, of: Word, n: u32, at: u32) {
        module.member_decorate(of, n, Decoration::Offset, [Operand::LiteralBit32(at)]);
        let operands = vec![
            Operand::IdRef(of),
            Operand::LiteralBit32(n),
            Operand::Decoration(Decoration::Offset),
            Operand::LiteralBit32(at),
        ];
        let decoration = Instruction::new(Op::MemberDecorate, None, None, operands);
        self.members.insert((of, n), vec![decoration]);
    }

    fn decorate_stride(&mut self, module: &mut Builder, ty: Word, stride: u32) {
        module.decorate(ty, Decoration::ArrayStride, [Operand::LiteralBit32(stride)]);
        self.strides.insert(ty, stride);
    }

    /// `of`, or a struct of it with floats that fill `stride`.
    fn wrapped(
        &mut self,
        module: &mut Builder,
        array: Word,
        of: Word,
        stride: u32,
    ) -> Result<Word, Unfit> {
        let (size, align) = self.size(of);
        let natural = size.next_multiple_of(align);
        if stride == natural {
            return Ok(of);
        }
        if stride < natural || !stride.is_multiple_of(align) || !size.is_multiple_of(4) {
            return Err(Unfit {
                id: array,
                line: None,
                why: format!(
                    "its elements are {stride} bytes apart, and WGSL has them {natural} bytes \
                     apart: use the layout std140 or std430"
                ),
            });
        }
        let float = module.type_float(32, None);
        self.learn(module, float);
        let pads = (stride - size) / 4;
        let mut members = vec![Operand::IdRef(of)];
        members.extend((0..pads).map(|_| Operand::IdRef(float)));
        let new = self.declare(module, Op::TypeStruct, members);
        let name = format!("stride_{stride}_{new}");
        module.member_name(new, 0, "value");
        for n in 0..=pads {
            let at = match n {
                0 => 0,
                _ => size + 4 * (n - 1),
            };
            if n > 0 {
                module.member_name(new, n, padding(&name, at));
            }
            self.place_member(module, new, n, at);
        }
        module.name(new, name);
        Ok(new)
    }
}

/// What cannot be written, in words.
type Written<T = ()> = Result<T, String>;

/// Writes accesses to changed memory.
impl Layouts {
    fn write(
        &mut self,
        module: &mut Builder,
        block: &mut Vec<Instruction>,
        i: Instruction,
    ) -> Written {
        let place = ids(&i).next().and_then(|id| self.places.get(&id)).cloned();
        let Some(place) = place else {
            let other = ids(&i).skip(1).any(|id| self.places.contains_key(&id));
            block.push(i);
            return match other {
                true => Err("a pointer into a block is an argument".to_owned()),
                false => Ok(()),
            };
        };
        match (i.class.opcode, i.result_id) {
            (Op::AccessChain | Op::InBoundsAccessChain, Some(id)) => {
                self.chain(module, block, &place, &i, id);
            }
            (Op::Load, Some(id)) => {
                let value = self.load(module, block, &place)?;
                let copy = vec![Operand::IdRef(value)];
                block.push(Instruction::new(
                    Op::CopyObject,
                    i.result_type,
                    Some(id),
                    copy,
                ));
            }
            (Op::Store, _) => {
                let value = ids(&i).nth(1).unwrap_or_default();
                self.store(module, block, &place, value)?;
            }
            (Op::ArrayLength, _) => {
                let mut i = i;
                i.operands[0] = Operand::IdRef(place.pointer);
                if let (Memory::Struct { pads, .. }, Some(Operand::LiteralBit32(n))) =
                    (&*place.memory, i.operands.get_mut(1))
                {
                    *n += pads;
                }
                block.push(i);
            }
            _ => return Err(format!("`Op{}` of a block", i.class.opname)),
        }
        Ok(())
    }

    fn constant(&mut self, module: &mut Builder, n: u32) -> Word {
        let uint = module.type_int(32, 0);
        module.constant_bit32(uint, n)
    }

    fn chain(
        &mut self,
        module: &mut Builder,
        block: &mut Vec<Instruction>,
        place: &Place,
        i: &Instruction,
        id: Word,
    ) {
        let mut indices: Vec<Word> = place.column.into_iter().chain(ids(i).skip(1)).collect();
        indices.reverse();
        let mut path: Vec<Word> = Vec::new();
        let mut memory = Rc::clone(&place.memory);
        let mut value = place.value;
        let mut column = None;
        while let Some(index) = indices.pop() {
            let next = match &*memory {
                Memory::Same(_) => {
                    path.push(index);
                    continue;
                }
                Memory::Struct { members, pads, .. } => {
                    let n = self.number(index).unwrap_or(0);
                    path.push(match pads {
                        0 => index,
                        _ => self.constant(module, n + pads),
                    });
                    let n = n as usize;
                    value = self.part(value, n).unwrap_or_default();
                    Rc::clone(&members[n.min(members.len() - 1)])
                }
                Memory::Array {
                    element,
                    is_wrapped,
                    ..
                } => {
                    path.push(index);
                    if *is_wrapped {
                        path.push(self.constant(module, 0));
                    }
                    value = self.part(value, 0).unwrap_or_default();
                    Rc::clone(element)
                }
                Memory::Matrix {
                    is_transposed,
                    wrapped,
                    ..
                } => {
                    let row = match is_transposed {
                        true => indices.pop(),
                        false => None,
                    };
                    if *is_transposed && row.is_none() {
                        column = Some(index);
                        break;
                    }
                    path.push(row.unwrap_or(index));
                    if wrapped.is_some() {
                        path.push(self.constant(module, 0));
                    }
                    value = self.part(value, 0).unwrap_or_default();
                    if row.is_some() {
                        path.push(index);
                        value = self.part(value, 0).unwrap_or_default();
                    }
                    Rc::new(Memory::Same(value))
                }
            };
            memory = next;
        }
        let pointer = match path.is_empty() {
            true => place.pointer,
            false => {
                let to = match memory.is_same() {
                    true => i.result_type.unwrap_or_default(),
                    false => module.type_pointer(None, place.class, memory.ty()),
                };
                let base = [place.pointer].into_iter().chain(path);
                let operands = base.map(Operand::IdRef).collect();
                block.push(Instruction::new(
                    i.class.opcode,
                    Some(to),
                    Some(id),
                    operands,
                ));
                id
            }
        };
        if !memory.is_same() || column.is_some() {
            let class = place.class;
            self.places.insert(
                id,
                Place {
                    pointer,
                    class,
                    memory,
                    value,
                    column,
                },
            );
        }
    }

    /// The pointers to the components of a column, and their type.
    fn components(
        &mut self,
        module: &mut Builder,
        block: &mut Vec<Instruction>,
        place: &Place,
        column: Word,
    ) -> (Vec<Word>, Word) {
        let vector = self.part(place.value, 0).unwrap_or_default();
        let scalar = self.part(vector, 0).unwrap_or_default();
        let pointer = module.type_pointer(None, place.class, scalar);
        let is_wrapped = matches!(
            &*place.memory,
            Memory::Matrix {
                wrapped: Some(_),
                ..
            }
        );
        let all = (0..self.count(vector)).map(|row| {
            let mut path = vec![place.pointer, self.constant(module, row)];
            if is_wrapped {
                path.push(self.constant(module, 0));
            }
            path.push(column);
            let path = path.into_iter().map(Operand::IdRef);
            push(module, block, (Op::AccessChain, pointer), path)
        });
        (all.collect(), scalar)
    }

    fn load(
        &mut self,
        module: &mut Builder,
        block: &mut Vec<Instruction>,
        place: &Place,
    ) -> Written<Word> {
        if let Some(column) = place.column {
            let (pointers, scalar) = self.components(module, block, place, column);
            let mut load = |p: Word| push(module, block, (Op::Load, scalar), [Operand::IdRef(p)]);
            let parts: Vec<Operand> = pointers
                .into_iter()
                .map(&mut load)
                .map(Operand::IdRef)
                .collect();
            let vector = self.part(place.value, 0).unwrap_or_default();
            return Ok(push(module, block, (Op::CompositeConstruct, vector), parts));
        }
        let pointer = [Operand::IdRef(place.pointer)];
        let memory = push(module, block, (Op::Load, place.memory.ty()), pointer);
        self.convert(module, block, (memory, place.value), &place.memory, true)
    }

    fn store(
        &mut self,
        module: &mut Builder,
        block: &mut Vec<Instruction>,
        place: &Place,
        value: Word,
    ) -> Written {
        let store = |block: &mut Vec<Instruction>, pointer: Word, value: Word| {
            let operands = [pointer, value].map(Operand::IdRef).to_vec();
            block.push(Instruction::new(Op::Store, None, None, operands));
        };
        if let Some(column) = place.column {
            let (pointers, scalar) = self.components(module, block, place, column);
            for (n, pointer) in pointers.into_iter().enumerate() {
                let path = [Operand::IdRef(value), Operand::LiteralBit32(n as u32)];
                let part = push(module, block, (Op::CompositeExtract, scalar), path);
                store(block, pointer, part);
            }
            return Ok(());
        }
        let value = self.convert(module, block, (value, place.value), &place.memory, false)?;
        store(block, place.pointer, value);
        Ok(())
    }

    /// Converts a value from memory (`is_load`) or to it. `ty` is the author's type.
    fn convert(
        &mut self,
        module: &mut Builder,
        block: &mut Vec<Instruction>,
        (id, ty): (Word, Word),
        memory: &Memory,
        is_load: bool,
    ) -> Written<Word> {
        let target = if is_load { ty } else { memory.ty() };
        let extract = |module: &mut Builder, block: &mut Vec<Instruction>, ty, path: &[u32]| {
            let path = path.iter().copied().map(Operand::LiteralBit32);
            let operands = [Operand::IdRef(id)].into_iter().chain(path);
            push(module, block, (Op::CompositeExtract, ty), operands)
        };
        let construct =
            |module: &mut Builder, block: &mut Vec<Instruction>, ty, parts: Vec<Word>| {
                let parts = parts.into_iter().map(Operand::IdRef);
                push(module, block, (Op::CompositeConstruct, ty), parts)
            };
        match memory {
            Memory::Same(_) => Ok(id),
            Memory::Struct {
                ty: own,
                members,
                pads,
            } => {
                let mut parts = Vec::new();
                for n in (0..*pads).filter(|_| !is_load) {
                    let ty = self.part(*own, n as usize).unwrap_or_default();
                    parts.push(module.constant_null(ty));
                }
                let first = if is_load { *pads } else { 0 };
                for (n, member) in members.iter().enumerate() {
                    let value = self.part(ty, n).unwrap_or_default();
                    let from = if is_load { member.ty() } else { value };
                    let part = extract(module, block, from, &[first + n as u32]);
                    parts.push(self.convert(module, block, (part, value), member, is_load)?);
                }
                Ok(construct(module, block, target, parts))
            }
            Memory::Array {
                ty: own,
                element,
                is_wrapped,
            } => {
                let length = self.part(ty, 1).and_then(|n| self.number(n));
                let Some(length) = length.filter(|n| *n <= MOST_ELEMENTS) else {
                    return Err("an array of more than 256 elements is read at once".to_owned());
                };
                let value = self.part(ty, 0).unwrap_or_default();
                let wrapper = self.part(*own, 0).unwrap_or_default();
                let mut parts = Vec::new();
                for n in 0..length {
                    let from = if is_load { element.ty() } else { value };
                    let path: &[u32] = if is_load && *is_wrapped {
                        &[n, 0]
                    } else {
                        &[n]
                    };
                    let part = extract(module, block, from, path);
                    let part = self.convert(module, block, (part, value), element, is_load)?;
                    parts.push(match !is_load && *is_wrapped {
                        true => self.wrap(module, block, wrapper, part),
                        false => part,
                    });
                }
                Ok(construct(module, block, target, parts))
            }
            Memory::Matrix {
                ty: own,
                is_transposed,
                wrapped,
                matrix,
            } => {
                let count = self.count(*matrix);
                let transpose = |module: &mut Builder, block: &mut Vec<Instruction>, ty, id| {
                    match is_transposed {
                        true => push(module, block, (Op::Transpose, ty), [Operand::IdRef(id)]),
                        false => id,
                    }
                };
                let Some(vector) = *wrapped else {
                    return Ok(transpose(module, block, target, id));
                };
                if is_load {
                    let parts = (0..count).map(|n| extract(module, block, vector, &[n, 0]));
                    let parts = parts.collect();
                    let whole = construct(module, block, *matrix, parts);
                    return Ok(transpose(module, block, ty, whole));
                }
                let whole = transpose(module, block, *matrix, id);
                let wrapper = self.part(*own, 0).unwrap_or_default();
                let mut parts = Vec::new();
                for n in 0..count {
                    let path = [Operand::IdRef(whole), Operand::LiteralBit32(n)];
                    let part = push(module, block, (Op::CompositeExtract, vector), path);
                    parts.push(self.wrap(module, block, wrapper, part));
                }
                Ok(construct(module, block, target, parts))
            }
        }
    }

    /// A struct of a value and its padding.
    fn wrap(
        &mut self,
        module: &mut Builder,
        block: &mut Vec<Instruction>,
        wrapper: Word,
        value: Word,
    ) -> Word {
        let float = module.type_float(32, None);
        let zero = module.constant_bit32(float, 0);
        let pads = self
            .globals
            .get(&wrapper)
            .map_or(0, |i| i.operands.len())
            .saturating_sub(1);
        let parts = std::iter::once(value).chain(std::iter::repeat_n(zero, pads));
        push(
            module,
            block,
            (Op::CompositeConstruct, wrapper),
            parts.map(Operand::IdRef),
        )
    }
}
