//! Declares `row_major` matrices as their author does. The IR has the transposes, by columns: that
//! is the same memory, but a host that reflects the words finds other types.
//!
//! ```text
//! OpMemberDecorate %B 0 ColMajor          OpMemberDecorate %B 0 RowMajor
//! %B = OpTypeStruct %mat2v3float          %B = OpTypeStruct %mat3v2float
//! %1 = OpAccessChain %ptr_2v3 %b %zero    %1 = OpAccessChain %ptr_3v2 %b %zero
//! %2 = OpLoad %mat2v3float %1             %5 = OpLoad %mat3v2float %1
//! %3 = OpTranspose %mat3v2float %2
//! OpMatrixTimesVector .. %3 ..            OpMatrixTimesVector .. %5 ..
//! OpAccessChain .. %b %zero %i %j         OpAccessChain .. %b %zero %j %i
//! ```

use std::collections::{HashMap, HashSet};

use naga_edit::declared::Declared;
use rspirv::dr::{Builder, Instruction, Module, Operand};
use rspirv::spirv::{Decoration, Op, StorageClass};

use naga_spirv::words::{ids, replace_ids, rewrite};

/// A matrix type and its transpose.
#[derive(Clone, Copy)]
struct Turned {
    /// As the IR has it.
    own: u32,
    author: u32,
}

/// The part of a row-major matrix at the end of a path. Columns and elements are the IR's.
enum MatrixPart {
    Matrix,
    Column,
    Element,
}

#[derive(Default)]
struct Rows {
    members: HashMap<(u32, u32), Turned>,
    /// Declarations of types, by id.
    types: HashMap<u32, Instruction>,
    /// Values of integer constants, by id.
    constants: HashMap<u32, u32>,
    /// Types of results, by id.
    results: HashMap<u32, u32>,
    /// The pointers to such matrices.
    matrices: HashMap<u32, Turned>,
    /// The pointers to a column: type and pointer of its matrix, and the column's index.
    columns: HashMap<u32, (Turned, u32, Operand)>,
    /// The originals of the matrices that we transposed, by result. They may have become unused.
    transposed: HashMap<u32, u32>,
    /// Something has an unexpected form.
    is_strange: bool,
}

/// Gives struct copies their author's names.
pub(super) fn rename_copies(module: &mut Builder, declared: &Declared) {
    for name in &mut module.module_mut().debug_names {
        let copy = |(copy, _): &&(String, String)| {
            name.class.opcode == Op::Name
                && name.operands.get(1) == Some(&Operand::LiteralString(copy.clone()))
        };
        if let Some((_, own)) = declared.copies.iter().find(copy) {
            name.operands[1] = Operand::LiteralString(own.clone());
        }
    }
}

/// Declares the members by rows. Returns false, and changes nothing, if one is used in another way
/// than naga writes for the front end's code.
pub(super) fn turn(module: &mut Builder, declared: &Declared) -> bool {
    let members = members(module.module_ref(), declared);
    if members.is_empty() {
        return true;
    }
    let kept = module.module_ref().clone();
    let bound = module.id();
    let is_done = Rows::default()
        .declare(module, &members)
        .is_some_and(|mut rows| {
            rows.uses(module);
            !rows.is_strange
        });
    if !is_done {
        let mut kept = kept;
        if let Some(header) = &mut kept.header {
            header.bound = bound;
        }
        *module = Builder::new_from_module(kept);
    }
    is_done
}

/// The structs and members that are declared by rows.
fn members(module: &Module, declared: &Declared) -> Vec<(u32, u32)> {
    let text = |operand: Option<&Operand>| match operand {
        Some(Operand::LiteralString(text)) => Some(text.clone()),
        _ => None,
    };
    let named = |op: Op| {
        module
            .debug_names
            .iter()
            .filter(move |i| i.class.opcode == op)
    };
    let structs: HashMap<u32, String> = named(Op::Name)
        .filter_map(|i| Some((ids(i).next()?, text(i.operands.get(1))?)))
        .collect();
    named(Op::MemberName)
        .filter_map(|i| {
            let of = ids(i).next()?;
            let key = (structs.get(&of)?.clone(), text(i.operands.get(2))?);
            let Some(Operand::LiteralBit32(index)) = i.operands.get(1) else {
                return None;
            };
            declared.rows.contains(&key).then_some((of, *index))
        })
        .collect()
}

fn is_part_of_matrix(op: Op) -> bool {
    matches!(
        op,
        Op::TypeFloat | Op::TypeInt | Op::TypeBool | Op::TypeVector | Op::TypeMatrix
    )
}

impl Rows {
    /// Changes the types and the decorations.
    fn declare(mut self, module: &mut Builder, members: &[(u32, u32)]) -> Option<Self> {
        for &(of, index) in members {
            let (mut arrays, mut own) = (Vec::new(), member(module.module_ref(), of, index)?);
            loop {
                let ty = global(module.module_ref(), own)?.clone();
                match ty.class.opcode {
                    Op::TypeMatrix => break,
                    Op::TypeArray | Op::TypeRuntimeArray => {
                        own = ids(&ty).next()?;
                        arrays.push(ty);
                    }
                    // A struct, or a matrix that is stored as an array of its columns.
                    _ => break,
                }
            }
            if global(module.module_ref(), own)?.class.opcode != Op::TypeMatrix {
                continue;
            }
            let author = transposed(module, own)?;
            let mut element = author;
            for array in arrays.into_iter().rev() {
                element = array_of(module, &array, element)?;
            }
            self.members.insert((of, index), Turned { own, author });
            let globals = &mut module.module_mut().types_global_values;
            let ty = globals.iter_mut().find(|i| i.result_id == Some(of))?;
            *ty.operands.get_mut(index as usize)? = Operand::IdRef(element);
            let target = [Operand::IdRef(of), Operand::LiteralBit32(index)];
            let annotations = &mut module.module_mut().annotations;
            let columns = Operand::Decoration(Decoration::ColMajor);
            annotations
                .iter_mut()
                .filter(|i| i.operands.starts_with(&target))
                .filter_map(|i| i.operands.get_mut(2).filter(|o| **o == columns))
                .for_each(|o| *o = Operand::Decoration(Decoration::RowMajor));
        }
        // The parts of a matrix type must precede the structs.
        let globals = &mut module.module_mut().types_global_values;
        globals.sort_by_key(|i| !is_part_of_matrix(i.class.opcode));
        for i in globals.iter() {
            if let (Op::Constant, Some(id), Some(Operand::LiteralBit32(value))) =
                (i.class.opcode, i.result_id, i.operands.first())
            {
                self.constants.insert(id, *value);
            }
            if let Some(id) = i.result_id {
                self.types.insert(id, i.clone());
            }
        }
        let module = module.module_ref();
        let all = module.all_inst_iter();
        self.results = all
            .filter_map(|i| Some((i.result_id?, i.result_type?)))
            .collect();
        Some(self)
    }

    /// The part that a path from a type selects, if it enters a member by rows.
    fn part(&mut self, mut ty: u32, path: &[Option<u32>]) -> Option<(Turned, MatrixPart)> {
        let mut path = path.iter();
        while let Some(index) = path.next() {
            let of = self.types.get(&ty)?;
            let next = match of.class.opcode {
                Op::TypeStruct => {
                    let index = (*index)?;
                    if let Some(turned) = self.members.get(&(ty, index)).copied() {
                        let mut levels = 0;
                        let mut element = ids(of).nth(index as usize)?;
                        while element != turned.author {
                            element = ids(self.types.get(&element)?).next()?;
                            levels += 1;
                        }
                        let part = match path.len().checked_sub(levels) {
                            Some(0) => MatrixPart::Matrix,
                            Some(1) => MatrixPart::Column,
                            Some(2) => MatrixPart::Element,
                            // An array of matrices as a whole.
                            _ => {
                                self.is_strange = true;
                                return None;
                            }
                        };
                        return Some((turned, part));
                    }
                    ids(of).nth(index as usize)?
                }
                _ => ids(of).next()?,
            };
            ty = next;
        }
        None
    }

    /// Whether values of a type have members by rows.
    fn has_rows(&self, ty: u32) -> bool {
        let Some(of) = self.types.get(&ty) else {
            return false;
        };
        match of.class.opcode {
            Op::TypeStruct => {
                self.members.keys().any(|(of, _)| *of == ty) || ids(of).any(|m| self.has_rows(m))
            }
            Op::TypeArray => ids(of).next().is_some_and(|m| self.has_rows(m)),
            _ => false,
        }
    }

    /// Changes the instructions that use such members.
    fn uses(&mut self, module: &mut Builder) {
        rewrite(module, |module, block, instruction| {
            if self.change(module, block, &instruction).is_none() {
                block.push(instruction);
            }
        });
        self.fold(module);
    }

    /// Writes the replacement of an instruction. `None`: it stays.
    fn change(
        &mut self,
        module: &mut Builder,
        block: &mut Vec<Instruction>,
        instruction: &Instruction,
    ) -> Option<()> {
        let (ty, result) = (instruction.result_type, instruction.result_id);
        let operands = &instruction.operands;
        let first = ids(instruction).next();
        match instruction.class.opcode {
            Op::AccessChain => {
                let pointee = self.pointee(*self.results.get(&first?)?)?;
                let path: Vec<Option<u32>> = operands[1..]
                    .iter()
                    .map(|o| self.constants.get(&o.id_ref_any()?).copied())
                    .collect();
                let (turned, part) = self.part(pointee, &path)?;
                let (mut operands, result) = (operands.clone(), result?);
                if let MatrixPart::Element = part {
                    let end = operands.len();
                    operands.swap(end - 1, end - 2);
                    block.push(Instruction::new(
                        Op::AccessChain,
                        ty,
                        Some(result),
                        operands,
                    ));
                    return Some(());
                }
                let class = self.class(ty?)?;
                let pointer = module.type_pointer(None, class, turned.author);
                let id = match part {
                    MatrixPart::Column => {
                        let column = operands.pop()?;
                        let id = module.id();
                        self.columns.insert(result, (turned, id, column));
                        id
                    }
                    _ => {
                        self.matrices.insert(result, turned);
                        result
                    }
                };
                block.push(Instruction::new(
                    Op::AccessChain,
                    Some(pointer),
                    Some(id),
                    operands,
                ));
            }
            Op::Load if self.matrices.contains_key(&first?) => {
                let turned = self.matrices[&first?];
                let read = Read::new(Op::Load, operands.clone());
                self.read(module, block, turned, read, result?);
            }
            Op::Load if self.columns.contains_key(&first?) => {
                let parts = self.read_column(module, block, first?)?;
                block.push(Instruction::new(Op::CompositeConstruct, ty, result, parts));
            }
            Op::Store if self.matrices.contains_key(&first?) => {
                let turned = self.matrices[&first?];
                let value = operands[1].clone();
                let id = module.id();
                let (author, stored) = (Some(turned.author), Some(id));
                block.push(Instruction::new(Op::Transpose, author, stored, vec![value]));
                let mut operands = operands.clone();
                operands[1] = Operand::IdRef(id);
                block.push(Instruction::new(Op::Store, None, None, operands));
            }
            Op::CompositeExtract => self.extract(module, block, instruction)?,
            op => {
                // Pointers to such matrices that go elsewhere, and structs that are made of matrices.
                let goes =
                    |id: u32| self.matrices.contains_key(&id) || self.columns.contains_key(&id);
                let is_made = matches!(op, Op::CompositeConstruct | Op::CompositeInsert);
                self.is_strange |=
                    ids(instruction).any(goes) || is_made && ty.is_some_and(|ty| self.has_rows(ty));
                return None;
            }
        }
        Some(())
    }

    /// Reads the elements of a column, which the author has in as many columns.
    fn read_column(
        &self,
        module: &mut Builder,
        block: &mut Vec<Instruction>,
        column_pointer: u32,
    ) -> Option<Vec<Operand>> {
        let (turned, pointer, column) = self.columns[&column_pointer].clone();
        // A path into a pointer to the matrix has the author's order: each row's element.
        let author = self.types.get(&turned.author)?;
        let Some(Operand::LiteralBit32(columns)) = author.operands.get(1) else {
            return None;
        };
        let vector = self.types.get(&ids(author).next()?)?;
        let scalar = ids(vector).next()?;
        let to_scalar =
            module.type_pointer(None, self.class(self.results[&column_pointer])?, scalar);
        let uint = module.type_int(32, 0);
        let mut parts = Vec::new();
        for i in 0..*columns {
            let index = Operand::IdRef(module.constant_bit32(uint, i));
            let path = vec![Operand::IdRef(pointer), index, column.clone()];
            let [at, part] = [module.id(), module.id()];
            block.push(Instruction::new(
                Op::AccessChain,
                Some(to_scalar),
                Some(at),
                path,
            ));
            let at = vec![Operand::IdRef(at)];
            block.push(Instruction::new(Op::Load, Some(scalar), Some(part), at));
            parts.push(Operand::IdRef(part));
        }
        Some(parts)
    }

    /// Extracts a part of a matrix.
    fn extract(
        &mut self,
        module: &mut Builder,
        block: &mut Vec<Instruction>,
        instruction: &Instruction,
    ) -> Option<()> {
        let (ty, result) = (instruction.result_type, instruction.result_id);
        let path: Vec<Option<u32>> = instruction.operands[1..]
            .iter()
            .map(|o| match o {
                Operand::LiteralBit32(index) => Some(*index),
                _ => None,
            })
            .collect();
        let (turned, part) = self.part(*self.results.get(&ids(instruction).next()?)?, &path)?;
        let mut operands = instruction.operands.clone();
        match part {
            MatrixPart::Element => {
                let end = operands.len();
                operands.swap(end - 1, end - 2);
                block.push(Instruction::new(Op::CompositeExtract, ty, result, operands));
            }
            MatrixPart::Matrix => {
                let read = Read::new(Op::CompositeExtract, operands);
                self.read(module, block, turned, read, result?);
            }
            MatrixPart::Column => {
                let column = operands.pop()?;
                let read = Read::new(Op::CompositeExtract, operands);
                let matrix = module.id();
                self.read(module, block, turned, read, matrix);
                let operands = vec![Operand::IdRef(matrix), column];
                block.push(Instruction::new(Op::CompositeExtract, ty, result, operands));
            }
        }
        Some(())
    }

    /// Reads a matrix as its author has it, and transposes it.
    fn read(
        &mut self,
        module: &mut Builder,
        block: &mut Vec<Instruction>,
        turned: Turned,
        read: Read,
        result: u32,
    ) {
        let id = module.id();
        block.push(Instruction::new(
            read.op,
            Some(turned.author),
            Some(id),
            read.operands,
        ));
        let operand = vec![Operand::IdRef(id)];
        block.push(Instruction::new(
            Op::Transpose,
            Some(turned.own),
            Some(result),
            operand,
        ));
        self.transposed.insert(result, id);
    }

    /// Removes transpositions by the front end that cancel ours.
    fn fold(&self, module: &mut Builder) {
        let mut same = HashMap::new();
        rewrite(module, |_, block, instruction| {
            let of = ids(&instruction)
                .next()
                .and_then(|id| self.transposed.get(&id));
            match (instruction.class.opcode, of, instruction.result_id) {
                (Op::Transpose, Some(of), Some(result)) => {
                    same.insert(result, *of);
                }
                _ => block.push(instruction),
            }
        });
        replace_ids(module, &same);
        let functions = module.module_ref().functions.iter();
        let read: HashSet<u32> = functions
            .flat_map(|f| f.all_inst_iter())
            .flat_map(ids)
            .collect();
        let is_unread = |id: u32| self.transposed.contains_key(&id) && !read.contains(&id);
        rewrite(module, |_, block, instruction| {
            if !instruction.result_id.is_some_and(is_unread) {
                block.push(instruction);
            }
        });
        let names = &mut module.module_mut().debug_names;
        names.retain(|i| !ids(i).next().is_some_and(is_unread));
    }

    fn pointee(&self, pointer: u32) -> Option<u32> {
        ids(self.types.get(&pointer)?).next()
    }

    fn class(&self, pointer: u32) -> Option<StorageClass> {
        match self.types.get(&pointer)?.operands.first() {
            Some(Operand::StorageClass(class)) => Some(*class),
            _ => None,
        }
    }
}

/// How a matrix is read.
struct Read {
    op: Op,
    operands: Vec<Operand>,
}

impl Read {
    fn new(op: Op, operands: Vec<Operand>) -> Self {
        Self { op, operands }
    }
}

fn global(module: &Module, id: u32) -> Option<&Instruction> {
    let mut globals = module.types_global_values.iter();
    globals.find(|i| i.result_id == Some(id))
}

/// The type of a struct's member.
fn member(module: &Module, of: u32, index: u32) -> Option<u32> {
    ids(global(module, of)?).nth(index as usize)
}

/// The transpose of a matrix type.
fn transposed(module: &mut Builder, matrix: u32) -> Option<u32> {
    let [of, vector] = {
        let of = global(module.module_ref(), matrix)?;
        let vector = global(module.module_ref(), ids(of).next()?)?;
        [of.clone(), vector.clone()]
    };
    let (Some(Operand::LiteralBit32(columns)), Some(Operand::LiteralBit32(rows))) =
        (of.operands.get(1), vector.operands.get(1))
    else {
        return None;
    };
    let scalar = ids(&vector).next()?;
    let column = module.type_vector(scalar, *columns);
    Some(module.type_matrix(column, *rows))
}

/// An array like `array` of other elements.
fn array_of(module: &mut Builder, array: &Instruction, element: u32) -> Option<u32> {
    if array.operands.first() == Some(&Operand::IdRef(element)) {
        return array.result_id;
    }
    let id = module.id();
    let mut own = array.clone();
    own.result_id = Some(id);
    *own.operands.first_mut()? = Operand::IdRef(element);
    let module = module.module_mut();
    let globals = &mut module.types_global_values;
    let at = globals
        .iter()
        .position(|i| i.result_id == array.result_id)?;
    globals.insert(at + 1, own);
    let of = |i: &&Instruction| ids(i).next() == array.result_id;
    let decorations = module.annotations.iter().filter(of).cloned();
    let decorations: Vec<Instruction> = decorations
        .map(|mut i| {
            i.operands[0] = Operand::IdRef(id);
            i
        })
        .collect();
    module.annotations.extend(decorations);
    Some(id)
}
