//! Rewrites accesses to memory whose layout changed: pointers to parts, loads and stores.

use std::collections::HashMap;
use std::rc::Rc;

use rspirv::dr::{Builder, Instruction, Operand};
use rspirv::spirv::{Op, StorageClass, Word};

use super::{Layouts, Memory};
use crate::words::{count_parts, ids, is_access, push};

/// Values with more parts are not loaded or stored as a whole.
const MOST_PARTS: u32 = 1024;

/// A pointer to memory whose layout changed.
#[derive(Clone)]
struct ChangedPointer {
    pointer: Word,
    class: StorageClass,
    memory: Rc<Memory>,
    /// The author's type of the value.
    value: Word,
    /// The vector that this pointer refers to, if its components are not contiguous.
    apart: Option<Apart>,
}

/// A vector whose components are not contiguous.
#[derive(Clone, Copy)]
enum Apart {
    /// A column of a transposed matrix, by its index.
    Column(Word),
    /// Consecutive members of a struct, starting at `first`. `chosen`: the dynamic index of one of
    /// them.
    Members { first: u32, chosen: Option<Word> },
}

/// The error describes the access that cannot be written.
type Written<T = ()> = Result<T, String>;

/// The pointers to memory whose layout changed.
#[derive(Default)]
pub(super) struct Places(HashMap<Word, ChangedPointer>);

impl Places {
    pub(super) fn add(&mut self, id: Word, class: StorageClass, memory: Rc<Memory>, value: Word) {
        let place = ChangedPointer {
            pointer: id,
            class,
            memory,
            value,
            apart: None,
        };
        self.0.insert(id, place);
    }

    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The rewriter for a block's accesses.
    pub(super) fn of<'a>(
        &'a mut self,
        layouts: &'a Layouts,
        module: &'a mut Builder,
        block: &'a mut Vec<Instruction>,
    ) -> Accesses<'a> {
        Accesses {
            places: &mut self.0,
            layouts,
            module,
            block,
        }
    }
}

/// Rewrites the accesses of a block.
pub(super) struct Accesses<'a> {
    places: &'a mut HashMap<Word, ChangedPointer>,
    layouts: &'a Layouts,
    module: &'a mut Builder,
    block: &'a mut Vec<Instruction>,
}

impl Accesses<'_> {
    /// Writes an instruction, or its replacement.
    pub(super) fn write(&mut self, mut i: Instruction) -> Written {
        let place = ids(&i).next().and_then(|id| self.places.get(&id)).cloned();
        let Some(place) = place else {
            let other = ids(&i).skip(1).any(|id| self.places.contains_key(&id));
            self.block.push(i);
            return match other {
                true => Err("a pointer into a block is an argument".to_owned()),
                false => Ok(()),
            };
        };
        match (i.class.opcode, i.result_id) {
            (_, Some(id)) if is_access(&i) => self.chain(&place, &i, id),
            (Op::Load, Some(id)) => {
                let value = self.load(&place)?;
                let copy = vec![Operand::IdRef(value)];
                let copy = Instruction::new(Op::CopyObject, i.result_type, Some(id), copy);
                self.block.push(copy);
            }
            (Op::Store, _) => {
                let value = ids(&i).nth(1).unwrap_or_default();
                self.store(&place, value)?;
            }
            (Op::ArrayLength, _) => {
                i.operands[0] = Operand::IdRef(place.pointer);
                if let (Memory::Struct { members, .. }, Some(Operand::LiteralBit32(n))) =
                    (&*place.memory, i.operands.get_mut(1))
                {
                    *n = members.get(*n as usize).map_or(*n, |(at, _)| *at);
                }
                self.block.push(i);
            }
            _ => return Err(format!("`Op{}` of a block", i.class.opname)),
        }
        Ok(())
    }

    fn push(&mut self, op: Op, ty: Word, operands: impl IntoIterator<Item = Operand>) -> Word {
        push(self.module, self.block, (op, ty), operands)
    }

    fn construct(&mut self, ty: Word, parts: Vec<Word>) -> Word {
        let parts = parts.into_iter().map(Operand::IdRef);
        self.push(Op::CompositeConstruct, ty, parts)
    }

    fn extract(&mut self, ty: Word, of: Word, path: &[u32]) -> Word {
        let path = path.iter().copied().map(Operand::LiteralBit32);
        let operands = [Operand::IdRef(of)].into_iter().chain(path);
        self.push(Op::CompositeExtract, ty, operands)
    }

    fn part(&self, ty: Word, n: usize) -> Word {
        self.layouts.part(ty, n).unwrap_or_default()
    }

    fn constant(&mut self, n: u32) -> Word {
        let uint = self.module.type_int(32, 0);
        self.module.constant_bit32(uint, n)
    }

    fn chain(&mut self, place: &ChangedPointer, i: &Instruction, id: Word) {
        let mut indices: Vec<Word> = ids(i).skip(1).collect();
        indices.reverse();
        let mut path: Vec<Word> = Vec::new();
        let mut memory = Rc::clone(&place.memory);
        let mut value = place.value;
        let mut apart = None;
        match place.apart {
            Some(Apart::Column(column)) => indices.push(column),
            Some(Apart::Members { first, .. }) => {
                (path, apart, value) = self.component(first, value, &mut indices);
                if apart.is_none() {
                    memory = Rc::new(Memory::Same(value));
                }
            }
            None => {}
        }
        while let Some(index) = indices.pop() {
            let next = match &*memory {
                Memory::Components { .. } => break,
                Memory::Same(_) => {
                    path.push(index);
                    continue;
                }
                Memory::Struct { members, .. } => {
                    let n = self.layouts.number(index).unwrap_or(0) as usize;
                    let n = n.min(members.len().saturating_sub(1));
                    let Some((at, member)) = members.get(n) else {
                        break;
                    };
                    value = self.part(value, n);
                    if let Memory::Components { .. } = **member {
                        let (more, of, part) = self.component(*at, value, &mut indices);
                        (apart, value) = (of, part);
                        if apart.is_none() {
                            path.extend(more);
                            memory = Rc::new(Memory::Same(value));
                        }
                        break;
                    }
                    path.push(self.constant(*at));
                    Rc::clone(member)
                }
                Memory::Array {
                    element,
                    is_wrapped,
                    ..
                } => {
                    path.push(index);
                    if *is_wrapped {
                        path.push(self.constant(0));
                    }
                    value = self.part(value, 0);
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
                        apart = Some(Apart::Column(index));
                        break;
                    }
                    path.push(row.unwrap_or(index));
                    if wrapped.is_some() {
                        path.push(self.constant(0));
                    }
                    value = self.part(value, 0);
                    if row.is_some() {
                        path.push(index);
                        value = self.part(value, 0);
                    }
                    Rc::new(Memory::Same(value))
                }
            };
            memory = next;
        }
        let class = place.class;
        let pointer = match path.is_empty() {
            true => place.pointer,
            false => {
                let to = match memory.is_same() {
                    true => i.result_type.unwrap_or_default(),
                    false => self.module.type_pointer(None, class, memory.ty()),
                };
                let base = [place.pointer].into_iter().chain(path);
                let operands = base.map(Operand::IdRef).collect();
                let chain = Instruction::new(i.class.opcode, Some(to), Some(id), operands);
                self.block.push(chain);
                id
            }
        };
        if !memory.is_same() || apart.is_some() {
            let place = ChangedPointer {
                pointer,
                class,
                memory,
                value,
                apart,
            };
            self.places.insert(id, place);
        }
    }

    /// Resolves the next index into a vector whose components are members of a struct. With a
    /// constant index, returns the path from the struct to the component. Otherwise returns the
    /// vector as [`Apart`]. Also returns the type of the value.
    fn component(
        &mut self,
        first: u32,
        vector: Word,
        indices: &mut Vec<Word>,
    ) -> (Vec<Word>, Option<Apart>, Word) {
        let index = indices.pop();
        match index.and_then(|id| self.layouts.number(id)) {
            Some(n) => (vec![self.constant(first + n)], None, self.part(vector, 0)),
            None => {
                let apart = Apart::Members {
                    first,
                    chosen: index,
                };
                (Vec::new(), Some(apart), vector)
            }
        }
    }

    /// Pointers to the components of a vector, and the vector's type.
    fn components(&mut self, place: &ChangedPointer, apart: Apart) -> (Vec<Word>, Word) {
        let column = match apart {
            Apart::Column(column) => column,
            Apart::Members { first, .. } => return self.members(place, first),
        };
        let vector = self.part(place.value, 0);
        let scalar = self.part(vector, 0);
        let pointer = self.module.type_pointer(None, place.class, scalar);
        let is_wrapped = matches!(
            &*place.memory,
            Memory::Matrix {
                wrapped: Some(_),
                ..
            }
        );
        let all = (0..self.layouts.count(vector)).map(|row| {
            let mut path = vec![place.pointer, self.constant(row)];
            if is_wrapped {
                path.push(self.constant(0));
            }
            path.push(column);
            let path = path.into_iter().map(Operand::IdRef);
            self.push(Op::AccessChain, pointer, path)
        });
        (all.collect(), vector)
    }

    /// Pointers to the members that hold the components of a vector, and the vector's type.
    fn members(&mut self, place: &ChangedPointer, first: u32) -> (Vec<Word>, Word) {
        let vector = place.value;
        let scalar = self.part(vector, 0);
        let pointer = self.module.type_pointer(None, place.class, scalar);
        let all = (0..self.layouts.count(vector)).map(|n| {
            let path = [place.pointer, self.constant(first + n)].map(Operand::IdRef);
            self.push(Op::AccessChain, pointer, path)
        });
        (all.collect(), vector)
    }

    fn load(&mut self, place: &ChangedPointer) -> Written<Word> {
        let load = |own: &mut Self, pointer: Word, ty: Word| {
            own.push(Op::Load, ty, [Operand::IdRef(pointer)])
        };
        if let Some(apart) = place.apart {
            let (pointers, vector) = self.components(place, apart);
            let scalar = self.part(vector, 0);
            let parts = pointers.into_iter().map(|p| load(self, p, scalar));
            let parts = parts.collect();
            let whole = self.construct(vector, parts);
            return Ok(match apart {
                Apart::Members {
                    chosen: Some(n), ..
                } => {
                    let operands = [whole, n].map(Operand::IdRef);
                    self.push(Op::VectorExtractDynamic, scalar, operands)
                }
                _ => whole,
            });
        }
        self.check_size(place)?;
        let memory = load(self, place.pointer, place.memory.ty());
        Ok(self.convert((memory, place.value), &place.memory, true))
    }

    fn store(&mut self, place: &ChangedPointer, value: Word) -> Written {
        let store = |own: &mut Self, pointer: Word, value: Word| {
            let operands = [pointer, value].map(Operand::IdRef).to_vec();
            let store = Instruction::new(Op::Store, None, None, operands);
            own.block.push(store);
        };
        if let Some(apart) = place.apart {
            if let Apart::Members {
                chosen: Some(_), ..
            } = apart
            {
                return Err("a component that a variable index chooses is written".to_owned());
            }
            let (pointers, vector) = self.components(place, apart);
            let scalar = self.part(vector, 0);
            for (n, pointer) in pointers.into_iter().enumerate() {
                let part = self.extract(scalar, value, &[n as u32]);
                store(self, pointer, part);
            }
            return Ok(());
        }
        self.check_size(place)?;
        let value = self.convert((value, place.value), &place.memory, false);
        store(self, place.pointer, value);
        Ok(())
    }

    fn check_size(&self, place: &ChangedPointer) -> Written {
        match count_parts(&self.layouts.globals, place.value, false) > MOST_PARTS {
            true => Err(format!(
                "a value of more than {MOST_PARTS} scalars and vectors is read or written at once"
            )),
            false => Ok(()),
        }
    }

    /// Converts a value from memory (`is_load`) or to it. `ty` is the author's type.
    fn convert(&mut self, (id, ty): (Word, Word), memory: &Memory, is_load: bool) -> Word {
        let target = if is_load { ty } else { memory.ty() };
        match memory {
            // The enclosing struct separates the components.
            Memory::Same(_) | Memory::Components { .. } => id,
            Memory::Struct { ty: own, members } => {
                let mut parts: Vec<Option<Word>> = match is_load {
                    true => vec![None; members.len()],
                    false => vec![None; self.layouts.members_of(*own)],
                };
                for (n, (at, member)) in members.iter().enumerate() {
                    let value = self.part(ty, n);
                    if let Memory::Components { vector, count } = **member {
                        let scalar = self.part(vector, 0);
                        let own = (0..count).map(|k| match is_load {
                            true => self.extract(scalar, id, &[at + k]),
                            false => self.extract(scalar, id, &[n as u32, k]),
                        });
                        let own: Vec<Word> = own.collect();
                        match is_load {
                            true => parts[n] = Some(self.construct(vector, own)),
                            false => {
                                let into = parts[*at as usize..].iter_mut();
                                into.zip(own).for_each(|(part, own)| *part = Some(own));
                            }
                        }
                        continue;
                    }
                    let at = *at as usize;
                    let (from, index, to) = match is_load {
                        true => (member.ty(), at, n),
                        false => (value, n, at),
                    };
                    let part = self.extract(from, id, &[index as u32]);
                    parts[to] = Some(self.convert((part, value), member, is_load));
                }
                let parts = parts.into_iter().enumerate().map(|(n, part)| {
                    part.unwrap_or_else(|| {
                        let padding = self.part(*own, n);
                        self.module.constant_null(padding)
                    })
                });
                let parts = parts.collect();
                self.construct(target, parts)
            }
            Memory::Array {
                ty: own,
                element,
                is_wrapped,
            } => {
                let length = self.part(ty, 1);
                let length = self.layouts.number(length).unwrap_or(0);
                let value = self.part(ty, 0);
                let wrapper = self.part(*own, 0);
                let mut parts = Vec::new();
                for n in 0..length {
                    let from = if is_load { element.ty() } else { value };
                    let path: &[u32] = match is_load && *is_wrapped {
                        true => &[n, 0],
                        false => &[n],
                    };
                    let part = self.extract(from, id, path);
                    let part = self.convert((part, value), element, is_load);
                    parts.push(match !is_load && *is_wrapped {
                        true => self.wrap(wrapper, part),
                        false => part,
                    });
                }
                self.construct(target, parts)
            }
            Memory::Matrix {
                ty: own,
                is_transposed,
                wrapped,
                matrix,
            } => {
                let count = self.layouts.count(*matrix);
                let transpose = |own: &mut Self, ty, id| match is_transposed {
                    true => own.push(Op::Transpose, ty, [Operand::IdRef(id)]),
                    false => id,
                };
                let Some(vector) = *wrapped else {
                    return transpose(self, target, id);
                };
                if is_load {
                    let parts = (0..count).map(|n| self.extract(vector, id, &[n, 0]));
                    let parts = parts.collect();
                    let whole = self.construct(*matrix, parts);
                    return transpose(self, ty, whole);
                }
                let whole = transpose(self, *matrix, id);
                let wrapper = self.part(*own, 0);
                let parts = (0..count).map(|n| {
                    let part = self.extract(vector, whole, &[n]);
                    self.wrap(wrapper, part)
                });
                let parts = parts.collect();
                self.construct(target, parts)
            }
        }
    }

    /// A struct of a value and its padding.
    fn wrap(&mut self, wrapper: Word, value: Word) -> Word {
        let pads = (1..self.layouts.members_of(wrapper)).map(|n| {
            let padding = self.part(wrapper, n);
            self.module.constant_null(padding)
        });
        let parts = [value].into_iter().chain(pads).collect();
        self.construct(wrapper, parts)
    }
}
