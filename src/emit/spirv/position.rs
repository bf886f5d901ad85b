//! Finds the SPIR-V instructions that affect the position, by a conservative backward walk over
//! ids.
//!
//! Memory is distinguished by variable and struct member, but not by time: every store that may
//! reach a value counts, and every branch condition. If the module has anything unknown, there is
//! no result.

use std::collections::{HashMap, HashSet};

use super::instructions;

const OP_TYPE_STRUCT: u16 = 30;
const OP_TYPE_POINTER: u16 = 32;
const OP_CONSTANT: u16 = 43;
const OP_FUNCTION: u16 = 54;
const OP_FUNCTION_PARAMETER: u16 = 55;
const OP_FUNCTION_CALL: u16 = 57;
const OP_VARIABLE: u16 = 59;
const OP_LOAD: u16 = 61;
const OP_STORE: u16 = 62;
const OP_COPY_MEMORY: std::ops::RangeInclusive<u16> = 63..=64;
const OP_ACCESS_CHAIN: std::ops::RangeInclusive<u16> = 65..=66;
const OP_DECORATE: u16 = 71;
const OP_COMPOSITE_CONSTRUCT: u16 = 80;
const OP_COMPOSITE_EXTRACT: u16 = 81;
const OP_COPY_OBJECT: u16 = 83;
const OP_ATOMICS: std::ops::RangeInclusive<u16> = 227..=242;
const OP_PHI: u16 = 245;
const OP_BRANCH_CONDITIONAL: u16 = 250;
const OP_SWITCH: u16 = 251;
const OP_RETURN_VALUE: u16 = 254;
const BUILT_IN: u32 = 11;
const POSITION: u32 = 0;

/// A variable or pointer parameter and its member; `None`: all of it.
type Memory = (u32, Option<u32>);

/// A write to memory.
struct Write {
    to: Memory,
    pointer: u32,
    value: u32,
}

struct Module<'a> {
    /// Opcode and operands by result.
    defined: HashMap<u32, (u16, &'a [u32])>,
    writes: Vec<Write>,
    /// By function.
    parameters: HashMap<u32, Vec<u32>>,
    returns: HashMap<u32, Vec<u32>>,
    /// Callee and arguments.
    calls: Vec<(u32, &'a [u32])>,
}

/// All ids that may affect the position, or `None` if the analysis fails.
pub(super) fn slice(words: &[u32]) -> Option<HashSet<u32>> {
    let (module, mut asked) = read(words)?;
    let mut seen: HashSet<(u32, Option<u32>)> = HashSet::new();
    while let Some((id, member)) = asked.pop() {
        if seen.contains(&(id, None)) || !seen.insert((id, member)) {
            continue;
        }
        module.ask(id, member, &mut asked)?;
    }
    Some(seen.into_iter().map(|(id, _)| id).collect())
}

/// Reads the module, and collects the first targets: the position and all branch conditions.
fn read(words: &[u32]) -> Option<(Module<'_>, Vec<Memory>)> {
    let mut module = Module {
        defined: HashMap::new(),
        writes: Vec::new(),
        parameters: HashMap::new(),
        returns: HashMap::new(),
        calls: Vec::new(),
    };
    let mut asked: Vec<Memory> = Vec::new();
    let mut position = None;
    let mut function = 0;
    let mut stores = Vec::new();
    for (_, opcode, operands) in instructions(words) {
        match (opcode, operands) {
            // With two positions, the entry point's is unknown.
            (OP_DECORATE, [_, BUILT_IN, POSITION]) if position.is_some() => return None,
            (OP_DECORATE, [variable, BUILT_IN, POSITION]) => position = Some(*variable),
            // Type instructions have no type id before their result.
            (19..=39, [result, ..]) => {
                module.defined.insert(*result, (opcode, operands));
            }
            (OP_STORE, [pointer, value, ..]) => stores.push((*pointer, *value)),
            (o, [to, from, ..]) if OP_COPY_MEMORY.contains(&o) => stores.push((*to, *from)),
            (OP_BRANCH_CONDITIONAL | OP_SWITCH, [condition, ..]) => asked.push((*condition, None)),
            (OP_RETURN_VALUE, [value]) => module.returns.entry(function).or_default().push(*value),
            (o, operands) if OP_ATOMICS.contains(&o) => {
                asked.extend(operands.iter().map(|id| (*id, None)));
                if let (true, [_, result, ..]) = (has_result(o), operands) {
                    module.defined.insert(*result, (opcode, operands));
                }
            }
            (_, [_, result, rest @ ..]) if has_result(opcode) => {
                module.defined.insert(*result, (opcode, operands));
                match opcode {
                    OP_FUNCTION => function = *result,
                    OP_FUNCTION_PARAMETER => {
                        module.parameters.entry(function).or_default().push(*result);
                    }
                    OP_FUNCTION_CALL => module.calls.push((*rest.first()?, rest.get(1..)?)),
                    _ => {}
                }
            }
            _ => {}
        }
    }
    asked.push((position?, None));
    for (pointer, value) in stores {
        let to = module.place(pointer)?;
        module.writes.push(Write { to, pointer, value });
    }
    Some((module, asked))
}

/// Whether an instruction has a type and a result. All have, except for annotations, names, types,
/// control flow and writes (SPIR-V 3.52).
fn has_result(opcode: u16) -> bool {
    !matches!(
        opcode,
        0 | 2..=11 | 14..=17 | 19..=39 | 56 | 62..=64 | 71..=76 | 99 | 218..=221 | 224 | 225 | 228 | 246..=256 | 317 | 331 | 332
    )
}

impl Module<'_> {
    /// Visits `member` of `id`.
    fn ask(&self, id: u32, member: Option<u32>, asked: &mut Vec<Memory>) -> Option<()> {
        // An unknown id is a literal or a label.
        let Some((opcode, operands)) = self.defined.get(&id).copied() else {
            return Some(());
        };
        match (opcode, operands) {
            (OP_VARIABLE | OP_FUNCTION_PARAMETER, _) => self.ask_memory(id, member, asked)?,
            (o, [_, _, base, indices @ ..]) if OP_ACCESS_CHAIN.contains(&o) => {
                asked.push(self.place(id)?);
                asked.extend(indices.iter().map(|i| (*i, None)));
                // The base variable was visited by member above. A chain on a chain has its own
                // indices.
                if self
                    .opcode(*base)
                    .is_some_and(|o| OP_ACCESS_CHAIN.contains(&o))
                {
                    asked.push((*base, None));
                }
            }
            (OP_LOAD, [_, _, pointer, ..]) => {
                let (root, part) = self.place(*pointer)?;
                match root == *pointer {
                    true => asked.push((root, member)),
                    false => asked.extend([(*pointer, None), (root, part)]),
                }
            }
            (OP_COMPOSITE_EXTRACT, [_, _, composite, index, ..]) => {
                asked.push((*composite, self.is_struct(*composite).then_some(*index)));
            }
            (OP_COMPOSITE_CONSTRUCT, [ty, _, parts @ ..]) => match member {
                Some(i) if self.opcode(*ty) == Some(OP_TYPE_STRUCT) => {
                    asked.push((*parts.get(i as usize)?, None));
                }
                _ => asked.extend(parts.iter().map(|p| (*p, None))),
            },
            (OP_COPY_OBJECT, [_, _, from]) => asked.push((*from, member)),
            (OP_PHI, [_, _, pairs @ ..]) => {
                asked.extend(pairs.iter().step_by(2).map(|p| (*p, member)));
            }
            (OP_FUNCTION_CALL, [_, _, callee, ..]) => {
                let returns = self.returns.get(callee).into_iter().flatten();
                asked.extend(returns.map(|r| (*r, member)));
            }
            (_, [_, _, rest @ ..]) => asked.extend(rest.iter().map(|o| (*o, None))),
            _ => {}
        }
        Some(())
    }

    /// Visits every store to `member` of a variable or a parameter's target. For a by-value
    /// parameter, visits the arguments.
    fn ask_memory(&self, root: u32, member: Option<u32>, asked: &mut Vec<Memory>) -> Option<()> {
        for write in self.writes.iter().filter(|w| w.to.0 == root) {
            match (write.to.1, member) {
                (Some(a), Some(b)) if a != b => {}
                (part, _) => {
                    let whole = write.pointer == root;
                    asked.push((write.value, member.filter(|_| whole && part.is_none())));
                    if !whole {
                        asked.push((write.pointer, None));
                    }
                }
            }
        }
        for (callee, arguments) in &self.calls {
            let Some(parameters) = self.parameters.get(callee) else {
                continue;
            };
            for (parameter, argument) in parameters.iter().zip(*arguments) {
                if *parameter == root {
                    asked.push((*argument, member));
                } else if self.is_pointer(*argument) && self.place(*argument)?.0 == root {
                    // The callee may write through it.
                    asked.push((*parameter, None));
                }
            }
        }
        Some(())
    }

    /// A pointer's target. `None` for pointers that are not access chains.
    fn place(&self, pointer: u32) -> Option<Memory> {
        let (opcode, operands) = self.defined.get(&pointer)?;
        match (*opcode, *operands) {
            (OP_VARIABLE | OP_FUNCTION_PARAMETER, _) => Some((pointer, None)),
            (o, [_, _, base, indices @ ..]) if OP_ACCESS_CHAIN.contains(&o) => {
                let (root, part) = self.place(*base)?;
                if part.is_some() || root != *base {
                    return Some((root, part));
                }
                Some((root, self.member(root, *indices.first()?)))
            }
            _ => None,
        }
    }

    /// The struct member selected by `index`, if `root` points to a struct.
    fn member(&self, root: u32, index: u32) -> Option<u32> {
        let (_, [ty, ..]) = self.defined.get(&root)? else {
            return None;
        };
        let (OP_TYPE_POINTER, [_, _, pointee]) = self.defined.get(ty)? else {
            return None;
        };
        match (self.opcode(*pointee)?, self.defined.get(&index)?) {
            (OP_TYPE_STRUCT, (OP_CONSTANT, [_, _, value])) => Some(*value),
            _ => None,
        }
    }

    fn opcode(&self, id: u32) -> Option<u16> {
        self.defined.get(&id).map(|(opcode, _)| *opcode)
    }

    fn type_of(&self, id: u32) -> Option<u16> {
        let (_, operands) = self.defined.get(&id)?;
        self.opcode(*operands.first()?)
    }

    fn is_struct(&self, id: u32) -> bool {
        self.type_of(id) == Some(OP_TYPE_STRUCT)
    }

    fn is_pointer(&self, id: u32) -> bool {
        self.type_of(id) == Some(OP_TYPE_POINTER)
    }
}

#[cfg(test)]
mod tests {
    use super::{BUILT_IN, OP_DECORATE, POSITION, slice};

    #[test]
    fn a_second_position_has_no_answer() {
        let decorate = |variable| {
            [
                4 << 16 | u32::from(OP_DECORATE),
                variable,
                BUILT_IN,
                POSITION,
            ]
        };
        let module = |positions: &[u32]| -> Vec<u32> {
            let header = [0; crate::emit::spirv::HEADER];
            let decorations = positions.iter().flat_map(|p| decorate(*p));
            header.into_iter().chain(decorations).collect()
        };
        assert_eq!(slice(&module(&[])), None);
        assert_eq!(slice(&module(&[7])), Some([7].into()));
        assert_eq!(slice(&module(&[7, 8])), None);
    }
}
