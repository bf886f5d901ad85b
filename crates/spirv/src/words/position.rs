//! Finds the SPIR-V instructions that affect the position, by a conservative backward walk over
//! ids.
//!
//! Memory is distinguished by variable and struct member, but not by time: every store that may
//! reach a value counts, and every branch condition. If the module has anything unknown, there is
//! no result.

use std::collections::{HashMap, HashSet};

use rspirv::dr::{self, Instruction, Operand};
use rspirv::spirv::{BuiltIn, Decoration, Op};

use super::ids;

/// A variable or pointer parameter, and its member (`None`: all of it).
type Memory = (u32, Option<u32>);

struct Write {
    to: Memory,
    pointer: u32,
    value: u32,
}

struct Module<'a> {
    /// By result id.
    defined: HashMap<u32, &'a Instruction>,
    writes: Vec<Write>,
    /// By function.
    parameters: HashMap<u32, Vec<u32>>,
    returns: HashMap<u32, Vec<u32>>,
    /// Callee and arguments.
    calls: Vec<Vec<u32>>,
}

/// All ids that may affect the position. `None` if the analysis fails.
pub fn slice(module: &dr::Module) -> Option<HashSet<u32>> {
    let (module, mut asked) = read(module)?;
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
fn read(all: &dr::Module) -> Option<(Module<'_>, Vec<Memory>)> {
    let with_results = all.all_inst_iter();
    let mut module = Module {
        defined: with_results
            .filter_map(|i| Some((i.result_id?, i)))
            .collect(),
        writes: Vec::new(),
        parameters: HashMap::new(),
        returns: HashMap::new(),
        calls: Vec::new(),
    };
    let is_position = |i: &&Instruction| {
        let of = [
            Operand::Decoration(Decoration::BuiltIn),
            Operand::BuiltIn(BuiltIn::Position),
        ];
        i.class.opcode == Op::Decorate && i.operands.ends_with(&of)
    };
    let mut positions = all.annotations.iter().filter(is_position).flat_map(ids);
    // With two positions it is unknown which one the entry point uses.
    let (Some(position), None) = (positions.next(), positions.next()) else {
        return None;
    };
    let mut asked: Vec<Memory> = vec![(position, None)];
    let mut stores = Vec::new();
    for function in &all.functions {
        let own = function.def_id()?;
        let parameters = function.parameters.iter().filter_map(|p| p.result_id);
        module.parameters.insert(own, parameters.collect());
        for instruction in function.all_inst_iter() {
            let mut operands = ids(instruction);
            match instruction.class.opcode {
                Op::Store | Op::CopyMemory | Op::CopyMemorySized => {
                    stores.push((operands.next()?, operands.next()?));
                }
                Op::BranchConditional | Op::Switch => asked.push((operands.next()?, None)),
                Op::ReturnValue => module.returns.entry(own).or_default().extend(operands),
                Op::FunctionCall => module.calls.push(operands.collect()),
                opcode if is_atomic(opcode) => {
                    asked.extend(operands.chain(instruction.result_id).map(|id| (id, None)));
                }
                _ => {}
            }
        }
    }
    for (pointer, value) in stores {
        let to = module.place(pointer)?;
        module.writes.push(Write { to, pointer, value });
    }
    Some((module, asked))
}

/// `OpAtomicLoad` to `OpAtomicXor` (SPIR-V 3.52.18).
fn is_atomic(opcode: Op) -> bool {
    (Op::AtomicLoad as u32..=Op::AtomicXor as u32).contains(&(opcode as u32))
}

impl Module<'_> {
    /// Visits `member` of `id`.
    fn ask(&self, id: u32, member: Option<u32>, asked: &mut Vec<Memory>) -> Option<()> {
        // An unknown id is a label.
        let Some(instruction) = self.defined.get(&id).copied() else {
            return Some(());
        };
        let mut operands = ids(instruction);
        match instruction.class.opcode {
            Op::Variable | Op::FunctionParameter => self.ask_memory(id, member, asked)?,
            Op::AccessChain | Op::InBoundsAccessChain => {
                let base = operands.next()?;
                asked.push(self.place(id)?);
                asked.extend(operands.map(|i| (i, None)));
                // The base variable was visited by member above. A chain on another chain has its
                // own indices.
                if self.opcode(base).is_some_and(is_access_chain) {
                    asked.push((base, None));
                }
            }
            Op::Load => {
                let pointer = operands.next()?;
                let (root, part) = self.place(pointer)?;
                match root == pointer {
                    true => asked.push((root, member)),
                    false => asked.extend([(pointer, None), (root, part)]),
                }
            }
            Op::CompositeExtract => {
                let composite = operands.next()?;
                let index = match instruction.operands.get(1)? {
                    Operand::LiteralBit32(index) => *index,
                    _ => return None,
                };
                asked.push((composite, self.is_struct(composite).then_some(index)));
            }
            Op::CompositeConstruct => match member {
                Some(i) if self.is_struct(id) => asked.push((operands.nth(i as usize)?, None)),
                _ => asked.extend(operands.map(|p| (p, None))),
            },
            Op::CopyObject => asked.push((operands.next()?, member)),
            Op::Phi => asked.extend(operands.step_by(2).map(|value| (value, member))),
            Op::FunctionCall => {
                let returns = self.returns.get(&operands.next()?).into_iter().flatten();
                asked.extend(returns.map(|r| (*r, member)));
            }
            _ => asked.extend(operands.map(|o| (o, None))),
        }
        Some(())
    }

    /// Visits every store to `member` of a variable or of a parameter's target. For a by-value
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
        for call in &self.calls {
            let (callee, arguments) = call.split_first()?;
            let Some(parameters) = self.parameters.get(callee) else {
                continue;
            };
            for (parameter, argument) in parameters.iter().zip(arguments) {
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
        let instruction = self.defined.get(&pointer)?;
        match instruction.class.opcode {
            Op::Variable | Op::FunctionParameter => Some((pointer, None)),
            opcode if is_access_chain(opcode) => {
                let mut operands = ids(instruction);
                let base = operands.next()?;
                let (root, part) = self.place(base)?;
                if part.is_some() || root != base {
                    return Some((root, part));
                }
                Some((root, self.member(root, operands.next()?)))
            }
            _ => None,
        }
    }

    /// The struct member selected by `index`, if `root` points to a struct.
    fn member(&self, root: u32, index: u32) -> Option<u32> {
        let pointer = self.defined.get(&self.defined.get(&root)?.result_type?)?;
        let pointee = ids(pointer).next()?;
        let index = self.defined.get(&index)?;
        match (
            self.opcode(pointee)?,
            index.class.opcode,
            index.operands.first()?,
        ) {
            (Op::TypeStruct, Op::Constant, Operand::LiteralBit32(value)) => Some(*value),
            _ => None,
        }
    }

    fn opcode(&self, id: u32) -> Option<Op> {
        self.defined.get(&id).map(|i| i.class.opcode)
    }

    fn type_of(&self, id: u32) -> Option<Op> {
        self.opcode(self.defined.get(&id)?.result_type?)
    }

    fn is_struct(&self, id: u32) -> bool {
        self.type_of(id) == Some(Op::TypeStruct)
    }

    fn is_pointer(&self, id: u32) -> bool {
        self.type_of(id) == Some(Op::TypePointer)
    }
}

fn is_access_chain(opcode: Op) -> bool {
    matches!(opcode, Op::AccessChain | Op::InBoundsAccessChain)
}

#[cfg(test)]
mod tests {
    use rspirv::dr::{Builder, Operand};
    use rspirv::spirv::{BuiltIn, Decoration};

    use super::slice;

    #[test]
    fn a_second_position_has_no_answer() {
        let module = |positions: &[u32]| {
            let mut module = Builder::new();
            for position in positions {
                let builtin = Operand::BuiltIn(BuiltIn::Position);
                module.decorate(*position, Decoration::BuiltIn, [builtin]);
            }
            module.module()
        };
        assert_eq!(slice(&module(&[])), None);
        assert_eq!(slice(&module(&[7])), Some([7].into()));
        assert_eq!(slice(&module(&[7, 8])), None);
    }
}
