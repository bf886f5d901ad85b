//! Replaces uses of specialisation constants that naga's reader lacks: `OpSpecConstantOp` is computed
//! at the start of each function that uses it, and array lengths have their defaults.

use std::collections::{BTreeMap, HashMap};

use rspirv::dr::{Builder, Instruction, Module, Operand};
use rspirv::spirv::{Decoration, Op, Word};

use super::combined::names;
use crate::words::{decorations, globals, ids, literal};

/// The constants that give the lengths of arrays, by id: their names. Their defaults are final.
pub(super) fn lengths(module: &Module, into: &mut BTreeMap<u32, String>) {
    let known = Known::of(module);
    for (length, _) in known.lengths(module) {
        known.roots(length, into);
    }
}

/// Settles them. `fixed` are the constants whose defaults are final, in all modules of a material.
pub(super) fn settle(module: &mut Builder, fixed: &BTreeMap<u32, String>) {
    let known = Known::of(module.module_ref());
    for (length, value) in known.lengths(module.module_ref()) {
        let of = known.globals.get(&length).and_then(|i| i.result_type);
        let Some(of) = of else { continue };
        let id = module.constant_bit32(of, value);
        for ty in &mut module.module_mut().types_global_values {
            if ty.class.opcode == Op::TypeArray && ids(ty).nth(1) == Some(length) {
                ty.operands[1] = Operand::IdRef(id);
            }
        }
    }
    known.compute(module);
    let is_fixed = |id: Option<Word>| {
        let spec = id.and_then(|id| known.ids.get(&id));
        spec.is_some_and(|spec| fixed.contains_key(spec))
    };
    let module = module.module_mut();
    for i in &mut module.types_global_values {
        let op = match i.class.opcode {
            Op::SpecConstant => Op::Constant,
            Op::SpecConstantTrue => Op::ConstantTrue,
            Op::SpecConstantFalse => Op::ConstantFalse,
            _ => continue,
        };
        if is_fixed(i.result_id) {
            *i = Instruction::new(op, i.result_type, i.result_id, i.operands.clone());
        }
    }
    let spec_id = Operand::Decoration(Decoration::SpecId);
    let annotations = &mut module.annotations;
    annotations.retain(|i| !(i.operands.get(1) == Some(&spec_id) && is_fixed(ids(i).next())));
}

/// The note on a constant whose default is final.
pub(super) fn fixed_note((id, name): (&u32, &String)) -> String {
    format!(
        "the specialisation constant {id}, `{name}`, gives the length of an array: its default is \
         final, and it is no constant of the output"
    )
}

struct Known {
    globals: HashMap<Word, Instruction>,
    ids: HashMap<Word, u32>,
    names: HashMap<Word, String>,
}

impl Known {
    fn of(module: &Module) -> Self {
        Self {
            globals: globals(module),
            ids: decorations(module, Decoration::SpecId),
            names: names(module),
        }
    }

    /// The specialised lengths of arrays, and their defaults.
    fn lengths(&self, module: &Module) -> Vec<(Word, u32)> {
        let types = module.types_global_values.iter();
        let arrays = types.filter(|i| i.class.opcode == Op::TypeArray);
        let lengths = arrays.filter_map(|ty| ids(ty).nth(1));
        let specialised = lengths.filter(|length| self.is_specialised(*length));
        specialised
            .filter_map(|length| Some((length, self.value(length)? as u32)))
            .collect()
    }

    fn is_specialised(&self, id: Word) -> bool {
        self.globals.get(&id).is_some_and(|i| match i.class.opcode {
            Op::SpecConstantOp => ids(i).any(|id| self.is_specialised(id)),
            _ => self.ids.contains_key(&id),
        })
    }

    /// Whether an operation is among its parts.
    fn is_computed(&self, id: Word) -> bool {
        self.globals.get(&id).is_some_and(|i| match i.class.opcode {
            Op::SpecConstantOp => true,
            Op::SpecConstantComposite => ids(i).any(|id| self.is_computed(id)),
            _ => false,
        })
    }

    /// The ids and names of the constants that decide a value.
    fn roots(&self, id: Word, into: &mut BTreeMap<u32, String>) {
        if let Some(spec) = self.ids.get(&id) {
            let name = self.names.get(&id).cloned();
            into.insert(*spec, name.unwrap_or_else(|| format!("%{id}")));
        }
        if let Some(i) = self.globals.get(&id) {
            ids(i).for_each(|id| self.roots(id, into));
        }
    }

    /// The default of an integer of 32 bits, or of a boolean.
    fn value(&self, id: Word) -> Option<i64> {
        let ty = self
            .globals
            .get(&id)
            .and_then(|i| self.globals.get(&i.result_type?))?;
        let value = self.wide_value(id)?;
        let is_signed = ty.operands.get(1).and_then(literal) == Some(1);
        Some(match ty.class.opcode {
            Op::TypeInt if is_signed => i64::from(value as i32),
            Op::TypeInt => i64::from(value as u32),
            _ => value,
        })
    }

    fn wide_value(&self, id: Word) -> Option<i64> {
        let i = self.globals.get(&id)?;
        let of = |n: usize| self.value(ids(i).nth(n)?);
        Some(match i.class.opcode {
            Op::Constant | Op::SpecConstant => {
                let ty = self.globals.get(&i.result_type?)?;
                let n = i.operands.first().and_then(literal)?;
                match ty.class.opcode {
                    Op::TypeInt if ty.operands.get(1).and_then(literal) == Some(1) => {
                        i64::from(n.cast_signed())
                    }
                    Op::TypeInt => i64::from(n),
                    _ => return None,
                }
            }
            Op::ConstantTrue | Op::SpecConstantTrue => 1,
            Op::ConstantFalse | Op::SpecConstantFalse | Op::ConstantNull => 0,
            Op::SpecConstantOp => match operation(i)? {
                Op::IAdd => of(0)?.checked_add(of(1)?)?,
                Op::ISub => of(0)?.checked_sub(of(1)?)?,
                Op::IMul => of(0)?.checked_mul(of(1)?)?,
                Op::UDiv | Op::SDiv => of(0)?.checked_div(of(1)?)?,
                Op::UMod | Op::SRem => of(0)?.checked_rem(of(1)?)?,
                // With the sign of the divisor.
                Op::SMod => {
                    let [a, b] = [of(0)?, of(1)?];
                    a.checked_rem(b)?.checked_add(b)?.checked_rem(b)?
                }
                Op::ShiftLeftLogical => of(0)?.checked_shl(u32::try_from(of(1)?).ok()?)?,
                Op::Select if of(0)? != 0 => of(1)?,
                Op::Select => of(2)?,
                Op::IEqual => i64::from(of(0)? == of(1)?),
                Op::INotEqual => i64::from(of(0)? != of(1)?),
                Op::UGreaterThan | Op::SGreaterThan => i64::from(of(0)? > of(1)?),
                Op::ULessThan | Op::SLessThan => i64::from(of(0)? < of(1)?),
                Op::LogicalNot => i64::from(of(0)? == 0),
                _ => return None,
            },
            _ => return None,
        })
    }

    /// Computes values in the functions that use them.
    fn compute(&self, module: &mut Builder) {
        let mut functions = std::mem::take(&mut module.module_mut().functions);
        for function in &mut functions {
            let mut new: HashMap<Word, Word> = HashMap::new();
            let mut start = Vec::new();
            let all = function.all_inst_iter().flat_map(ids);
            let used: Vec<Word> = all.filter(|id| self.is_computed(*id)).collect();
            for id in used {
                self.write(id, module, &mut start, &mut new);
            }
            if new.is_empty() {
                continue;
            }
            for block in &mut function.blocks {
                for operand in block.instructions.iter_mut().flat_map(|i| &mut i.operands) {
                    if let Some(id) = operand.id_ref_any_mut()
                        && let Some(new) = new.get(id)
                    {
                        *id = *new;
                    }
                }
            }
            if let Some(first) = function.blocks.first_mut() {
                let is_variable =
                    |i: &Instruction| matches!(i.class.opcode, Op::Variable | Op::Line);
                let body = first.instructions.iter().position(|i| !is_variable(i));
                let at = body.unwrap_or(0);
                first.instructions.splice(at..at, start);
            }
        }
        module.module_mut().functions = functions;
    }

    fn write(
        &self,
        id: Word,
        module: &mut Builder,
        into: &mut Vec<Instruction>,
        new: &mut HashMap<Word, Word>,
    ) -> Word {
        if let Some(id) = new.get(&id) {
            return *id;
        }
        let Some(i) = self.globals.get(&id).filter(|_| self.is_computed(id)) else {
            return id;
        };
        let op = match i.class.opcode {
            Op::SpecConstantOp => operation(i),
            _ => Some(Op::CompositeConstruct),
        };
        let mut operands = Vec::new();
        for operand in &i.operands {
            match operand {
                Operand::LiteralSpecConstantOpInteger(_) => {}
                Operand::IdRef(part) => {
                    operands.push(Operand::IdRef(self.write(*part, module, into, new)));
                }
                other => operands.push(other.clone()),
            }
        }
        let Some(op) = op else { return id };
        let result = module.id();
        into.push(Instruction::new(op, i.result_type, Some(result), operands));
        new.insert(id, result);
        result
    }
}

fn operation(i: &Instruction) -> Option<Op> {
    match i.operands.first() {
        Some(Operand::LiteralSpecConstantOpInteger(op)) => Some(*op),
        _ => None,
    }
}
