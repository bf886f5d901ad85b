//! Gives blocks a layout that WGSL can express: columns for rows, and padding for strides.
//!
//! | in memory | becomes |
//! |---|---|
//! | a block that begins at an offset | the same, after padding |
//! | a row-major matrix | its transpose |
//! | an array whose stride is larger than its elements | an array of structs with padding |
//! | members that are not in the order of their offsets | the same in that order |
//! | a matrix whose stride is larger than its columns, as `mat2` in std140 | the same, of its columns |
//! | a vector that begins where WGSL has none, as a `float3` at byte 4 of a cbuffer | a member for each component |
//!
//! Only memory changes: a loaded value has the author's type. The bytes stay where they are.

mod access;
mod components;

use std::collections::{HashMap, HashSet};
use std::rc::Rc;

use naga_edit::declared::padding;
use rspirv::dr::{Builder, Instruction, Operand};
use rspirv::spirv::{Decoration, Op, StorageClass, Word};

use self::access::Places;
use crate::words::{
    decorations, globals, ids, literal, member_decorations, names, rewrite, storage_class,
};

/// The largest type that naga supports, in bytes.
const MOST_BYTES: u32 = 1 << 30;

/// The layout of a value in memory.
#[derive(Debug)]
enum Memory {
    /// As its type specifies.
    Same(Word),
    Struct {
        ty: Word,
        /// The author's members, with their indices in memory. Other indices are padding.
        members: Vec<(u32, Rc<Memory>)>,
    },
    Array {
        ty: Word,
        element: Rc<Memory>,
        is_wrapped: bool,
    },
    /// The columns, or the rows if transposed. If wrapped, each is an element of an array.
    Matrix {
        ty: Word,
        is_transposed: bool,
        /// Type of a column or row in memory, if wrapped.
        wrapped: Option<Word>,
        /// Type of a matrix with the columns as they are in memory.
        matrix: Word,
    },
    /// A vector whose components are members of the enclosing struct.
    Components { vector: Word, count: u32 },
}

impl Memory {
    fn ty(&self) -> Word {
        match self {
            Self::Same(ty)
            | Self::Struct { ty, .. }
            | Self::Array { ty, .. }
            | Self::Matrix { ty, .. }
            | Self::Components { vector: ty, .. } => *ty,
        }
    }

    /// How many members of the enclosing struct it occupies.
    fn width(&self) -> u32 {
        match self {
            Self::Components { count, .. } => *count,
            _ => 1,
        }
    }

    fn is_same(&self) -> bool {
        matches!(self, Self::Same(_))
    }
}

/// Why WGSL has no layout for a block, and the instruction at fault.
pub(super) struct Unfit {
    /// Id of the type, or 0 for a use, which `line` locates.
    pub(super) id: Word,
    pub(super) line: Option<u32>,
    pub(super) why: String,
}

/// Changes the layout of all blocks. Returns the structs and members that the author declared
/// row-major.
pub(super) fn fit(module: &mut Builder) -> Result<Vec<(String, String)>, Unfit> {
    let mut layouts = Layouts::of(module);
    let mut places = Places::default();
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
        layouts.block = layouts.name(value);
        let memory = layouts.memory(module, value, None)?;
        if memory.is_same() {
            continue;
        }
        let pointer = module.type_pointer(None, class, memory.ty());
        let all = &mut module.module_mut().types_global_values;
        for i in all.iter_mut().filter(|i| i.result_id == Some(id)) {
            i.result_type = Some(pointer);
        }
        places.add(id, class, memory, value);
    }
    if places.is_empty() {
        return Ok(Vec::new());
    }
    let mut line = None;
    let mut failed = None;
    rewrite(module, |module, block, i| {
        if i.class.opcode == Op::Line {
            line = i.operands.get(1).and_then(literal);
        }
        let mut accesses = places.of(&layouts, module, block);
        if let Err(why) = accesses.write(i)
            && failed.is_none()
        {
            failed = Some(Unfit { id: 0, line, why });
        }
    });
    layouts.strip(module);
    failed.map_or(Ok(layouts.rows), Err)
}

/// How a struct's member stores its matrices.
#[derive(Clone, Copy)]
struct MatrixStorage {
    is_row_major: bool,
    stride: u32,
}

struct Layouts {
    globals: HashMap<Word, Instruction>,
    strides: HashMap<Word, u32>,
    names: HashMap<Word, String>,
    /// Decorations of members, by struct and index.
    members: HashMap<(Word, u32), Vec<Instruction>>,
    /// Structs in memory, by type and size.
    known: HashMap<(Word, Option<u32>), Rc<Memory>>,
    /// Structs of an element and its padding, by type and size.
    wrappers: HashMap<(Word, u32), Word>,
    /// The author's types that have another type in memory.
    changed: HashSet<Word>,
    /// Row-major members, with their structs.
    rows: Vec<(String, String)>,
    /// Name of the current block, from which new structs are named.
    block: String,
    taken: HashSet<String>,
}

impl Layouts {
    fn of(module: &Builder) -> Self {
        let module = module.module_ref();
        let names = names(module);
        Self {
            globals: globals(module),
            strides: decorations(module, Decoration::ArrayStride),
            members: member_decorations(module),
            known: HashMap::new(),
            wrappers: HashMap::new(),
            changed: HashSet::new(),
            rows: Vec::new(),
            block: String::new(),
            taken: names.values().cloned().collect(),
            names,
        }
    }

    fn name(&self, id: Word) -> String {
        let name = self.names.get(&id).cloned();
        name.unwrap_or_else(|| format!("_{id}"))
    }

    fn member(&self, of: Word, member: u32) -> Option<MatrixStorage> {
        let all = self.members.get(&(of, member))?;
        let find = |kind: Decoration| {
            let mut all = all.iter();
            all.find(|i| i.operands.get(2) == Some(&Operand::Decoration(kind)))
        };
        Some(MatrixStorage {
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

    /// The number of a struct's members.
    fn members_of(&self, ty: Word) -> usize {
        self.globals.get(&ty).map_or(0, |i| i.operands.len())
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

    /// Size and alignment in bytes by WGSL's rules.
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
                (
                    one.saturating_mul(n),
                    one.saturating_mul(n.next_power_of_two()),
                )
            }
            Op::TypeMatrix => {
                let (_, align) = self.size(ids(i).next().unwrap_or_default());
                (align.saturating_mul(self.count(ty)), align)
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
                    let at = at.unwrap_or_else(|| next_multiple(end, align));
                    // Members need not be in the order of their offsets.
                    end = end.max(at.saturating_add(size));
                    most = most.max(align);
                }
                (next_multiple(end, most), most)
            }
            _ => (4, 4),
        }
    }

    /// The layout of a type in memory, with matrices stored as `held` specifies.
    fn memory(
        &mut self,
        module: &mut Builder,
        ty: Word,
        held: Option<MatrixStorage>,
    ) -> Result<Rc<Memory>, Unfit> {
        let Some(i) = self.globals.get(&ty).cloned() else {
            return Ok(Rc::new(Memory::Same(ty)));
        };
        Ok(match i.class.opcode {
            Op::TypeStruct => self.struct_memory(module, ty, None)?,
            Op::TypeArray | Op::TypeRuntimeArray => {
                let of = ids(&i).next().unwrap_or_default();
                let mut element = self.memory(module, of, held)?;
                let (size, align) = self.size(element.ty());
                let natural = next_multiple(size, align);
                let stride = self.strides.get(&ty).copied().unwrap_or(natural);
                let op = self.globals.get(&of).map(|i| i.class.opcode);
                if op == Some(Op::TypeStruct) && stride > natural {
                    // In a uniform block, no member may follow a struct this closely, so the
                    // padding goes inside.
                    check_stride(ty, (size, align), stride)?;
                    element = self.struct_memory(module, of, Some(stride))?;
                }
                let inner = self.wrapped(module, ty, element.ty(), stride)?;
                if inner == element.ty() && element.is_same() {
                    return Ok(Rc::new(Memory::Same(ty)));
                }
                let is_wrapped = inner != element.ty();
                let mut operands = i.operands.clone();
                operands[0] = Operand::IdRef(inner);
                let new = self.declare(module, i.class.opcode, operands);
                self.decorate_stride(module, new, stride);
                self.changed.insert(ty);
                // The name of an array type determines its length.
                if let Some(name) = names(module.module_ref()).remove(&ty) {
                    module.name(new, name);
                }
                Rc::new(Memory::Array {
                    ty: new,
                    element,
                    is_wrapped,
                })
            }
            Op::TypeMatrix => {
                let Some(MatrixStorage {
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
                    Some(_) => self.array(module, inner, count, stride),
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

    /// The layout of a struct in memory. `size`: its size, if larger than that of its members.
    fn struct_memory(
        &mut self,
        module: &mut Builder,
        ty: Word,
        size: Option<u32>,
    ) -> Result<Rc<Memory>, Unfit> {
        if let Some(known) = self.known.get(&(ty, size)) {
            return Ok(Rc::clone(known));
        }
        let memory = Rc::new(self.new_struct(module, ty, size)?);
        self.known.insert((ty, size), Rc::clone(&memory));
        Ok(memory)
    }

    fn new_struct(
        &mut self,
        module: &mut Builder,
        ty: Word,
        size: Option<u32>,
    ) -> Result<Memory, Unfit> {
        let mut members = Vec::new();
        let types: Vec<Word> = self.globals.get(&ty).into_iter().flat_map(ids).collect();
        for (n, member) in types.iter().enumerate() {
            let held = self.member(ty, n as u32);
            let memory = self.memory(module, *member, held)?;
            members.push(self.aligned(ty, n as u32, memory)?);
        }
        let mut order: Vec<usize> = (0..members.len()).collect();
        order.sort_by_key(|n| self.offset(ty, *n as u32));
        let first = order.first().and_then(|n| self.offset(ty, *n as u32));
        let gap = first.unwrap_or(0);
        let is_same = gap == 0 && order.is_sorted() && members.iter().all(|m| m.is_same());
        if is_same && size.is_none() {
            return Ok(Memory::Same(ty));
        }
        let (end, _) = self.size(ty);
        check_size(ty, gap.max(size.unwrap_or(0)))?;
        let before = self.fill(module, 0, gap);
        let after = self.fill(module, end, size.unwrap_or(end));
        let own = order.iter().flat_map(|n| self.member_types(&members[*n]));
        let all = before.iter().map(|(ty, _)| *ty).chain(own);
        let all = all.chain(after.iter().map(|(ty, _)| *ty));
        let operands = all.map(Operand::IdRef).collect();
        let new = self.declare(module, Op::TypeStruct, operands);
        let name = self.name(ty);
        let pads = before.len() as u32;
        let mut indices = vec![0; members.len()];
        let mut behind = pads;
        for n in order {
            indices[n] = behind;
            behind += members[n].width();
        }
        let fills = (0..).zip(&before).chain((behind..).zip(&after));
        for (n, (_, at)) in fills {
            module.member_name(new, n, padding(&name, at));
            self.place_member(module, new, n, *at);
        }
        module.name(new, name.clone());
        self.move_names(module, (ty, new), &name, &indices);
        self.move_decorations(module, (ty, new), &indices);
        for (n, (at, member)) in indices.iter().zip(&members).enumerate() {
            self.part_components(module, (ty, n as u32), (new, *at), member);
        }
        self.changed.insert(ty);
        Ok(Memory::Struct {
            ty: new,
            members: indices.into_iter().zip(members).collect(),
        })
    }

    /// Copies member names to a new struct.
    fn move_names(
        &mut self,
        module: &mut Builder,
        (ty, new): (Word, Word),
        name: &str,
        indices: &[u32],
    ) {
        let mut copied = Vec::new();
        for i in &module.module_ref().debug_names {
            if let [
                Operand::IdRef(of),
                Operand::LiteralBit32(n),
                Operand::LiteralString(member),
            ] = i.operands.as_slice()
                && *of == ty
            {
                copied.extend(indices.get(*n as usize).map(|at| (*at, member.clone())));
                if self.member(ty, *n).is_some_and(|held| held.is_row_major) {
                    self.rows.push((name.to_owned(), member.clone()));
                }
            }
        }
        for (n, member) in copied {
            module.member_name(new, n, member);
        }
    }

    /// Copies decorations to a new struct.
    fn move_decorations(&mut self, module: &mut Builder, (ty, new): (Word, Word), indices: &[u32]) {
        let is_row_major = Operand::Decoration(Decoration::RowMajor);
        let annotations = module.module_ref().annotations.iter();
        let own = annotations
            .filter(|i| ids(i).next() == Some(ty) && !i.operands.contains(&is_row_major));
        for mut decoration in own.cloned().collect::<Vec<_>>() {
            decoration.operands[0] = Operand::IdRef(new);
            if let (Op::MemberDecorate, Some(Operand::LiteralBit32(n))) =
                (decoration.class.opcode, decoration.operands.get_mut(1))
            {
                *n = indices.get(*n as usize).copied().unwrap_or(*n);
                let all = self.members.entry((new, *n)).or_default();
                all.push(decoration.clone());
            }
            module.module_mut().annotations.push(decoration);
        }
    }

    /// Drops layout decorations of the author's types that have another type in memory. On a type
    /// of plain values, naga's reader would misinterpret them.
    fn strip(&self, module: &mut Builder) {
        let is_layout = |o: &Operand| {
            matches!(
                o,
                Operand::Decoration(
                    Decoration::Offset
                        | Decoration::MatrixStride
                        | Decoration::RowMajor
                        | Decoration::ColMajor
                        | Decoration::ArrayStride
                        | Decoration::Block
                        | Decoration::BufferBlock
                )
            )
        };
        let is_changed =
            |i: &Instruction| ids(i).next().is_some_and(|id| self.changed.contains(&id));
        let annotations = &mut module.module_mut().annotations;
        annotations.retain(|i| !(is_changed(i) && i.operands.iter().any(is_layout)));
    }

    /// Types and offsets of members that fill the bytes from `start` to `end`.
    fn fill(&mut self, module: &mut Builder, start: u32, end: u32) -> Vec<(Word, u32)> {
        let float = module.type_float(32, None);
        self.learn(module, float);
        let floats = |from: u32, to: u32| (from..to).step_by(4).map(move |at| (float, at));
        let from = next_multiple(start, 16).min(end);
        let whole = (end - from) / 16;
        if whole == 0 {
            return floats(start, end).collect();
        }
        let vector = module.type_vector(float, 4);
        self.learn(module, vector);
        let middle = match whole {
            1 => vector,
            _ => self.array(module, vector, whole, 16),
        };
        floats(start, from)
            .chain([(middle, from)])
            .chain(floats(from + 16 * whole, end))
            .collect()
    }

    fn array(&mut self, module: &mut Builder, of: Word, length: u32, stride: u32) -> Word {
        let uint = module.type_int(32, 0);
        let length = module.constant_bit32(uint, length);
        self.learn(module, length);
        let operands = [of, length].map(Operand::IdRef).to_vec();
        let array = self.declare(module, Op::TypeArray, operands);
        self.decorate_stride(module, array, stride);
        array
    }

    /// Records a definition that the builder made.
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

    /// `of`, or a struct with `of` and padding up to `stride`.
    fn wrapped(
        &mut self,
        module: &mut Builder,
        array: Word,
        of: Word,
        stride: u32,
    ) -> Result<Word, Unfit> {
        let (size, align) = self.size(of);
        if stride == next_multiple(size, align) {
            return Ok(of);
        }
        if let Some(known) = self.wrappers.get(&(of, stride)) {
            return Ok(*known);
        }
        check_stride(array, (size, align), stride)?;
        let fills = self.fill(module, size, stride);
        let members = [of].into_iter().chain(fills.iter().map(|(ty, _)| *ty));
        let members = members.map(Operand::IdRef).collect();
        let new = self.declare(module, Op::TypeStruct, members);
        let mut name = format!("{}_stride_{stride}", self.block);
        let mut others = 2..;
        while !self.taken.insert(name.clone()) {
            let n = others.next().unwrap_or_default();
            name = format!("{}_stride_{stride}_{n}", self.block);
        }
        module.member_name(new, 0, "value");
        self.place_member(module, new, 0, 0);
        for (n, (_, at)) in (1..).zip(fills) {
            module.member_name(new, n, padding(&name, at));
            self.place_member(module, new, n, at);
        }
        module.name(new, name);
        self.wrappers.insert((of, stride), new);
        Ok(new)
    }
}

fn next_multiple(n: u32, of: u32) -> u32 {
    n.checked_next_multiple_of(of).unwrap_or(u32::MAX)
}

fn check_size(id: Word, bytes: u32) -> Result<(), Unfit> {
    match bytes > MOST_BYTES {
        false => Ok(()),
        true => Err(Unfit {
            id,
            line: None,
            why: format!("its members or elements are {bytes} bytes apart, more than 1 GiB"),
        }),
    }
}

fn check_stride(array: Word, (size, align): (u32, u32), stride: u32) -> Result<(), Unfit> {
    check_size(array, stride)?;
    let natural = next_multiple(size, align);
    if stride < natural || !stride.is_multiple_of(align) || !size.is_multiple_of(4) {
        return Err(Unfit {
            id: array,
            line: None,
            why: format!(
                "its elements are {stride} bytes apart, and WGSL has them {natural} bytes apart: use \
                 the layout std140 or std430"
            ),
        });
    }
    Ok(())
}
