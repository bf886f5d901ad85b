//! Replaces uses of specialisation constants that naga's reader lacks: `OpSpecConstantOp` and
//! `OpSpecConstantComposite` are computed at the start of each function that uses them, and array
//! lengths have their defaults.

use std::collections::{BTreeMap, HashMap, HashSet};

use rspirv::dr::{Block, Builder, Instruction, Module, Operand};
use rspirv::spirv::{Decoration, Op, Word};

use crate::words::{after_variables, decorations, globals, ids, literal, names};

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

/// What is known of the constants. Each follows its parts, so one walk in order finds everything.
struct Known {
    globals: HashMap<Word, Instruction>,
    ids: HashMap<Word, u32>,
    names: HashMap<Word, String>,
    /// The defaults of integers of 32 bits, and of booleans.
    values: HashMap<Word, i64>,
    /// Those that a specialisation constant decides.
    specialised: HashSet<Word>,
    /// Those that functions compute, in order: the operations, and the composites of specialised
    /// parts, which naga's reader takes for constants.
    computed: Vec<Word>,
}

impl Known {
    fn of(module: &Module) -> Self {
        let mut known = Self {
            globals: globals(module),
            ids: decorations(module, Decoration::SpecId),
            names: names(module),
            values: HashMap::new(),
            specialised: HashSet::new(),
            computed: Vec::new(),
        };
        for i in &module.types_global_values {
            let Some(id) = i.result_id else { continue };
            let value = known.value(i);
            known.values.extend(value.map(|value| (id, value)));
            let op = i.class.opcode;
            let is_specialised = match op {
                Op::SpecConstant | Op::SpecConstantTrue | Op::SpecConstantFalse => true,
                Op::SpecConstantOp => {
                    known.computed.push(id);
                    ids(i).any(|id| known.specialised.contains(&id))
                }
                Op::SpecConstantComposite => {
                    let is = |id: &Word| {
                        let part = known.globals.get(id).map(|i| i.class.opcode);
                        known.specialised.contains(id) || part == Some(Op::SpecConstantOp)
                    };
                    let is_specialised = ids(i).any(|id| is(&id));
                    if is_specialised {
                        known.computed.push(id);
                    }
                    is_specialised
                }
                _ => false,
            };
            if is_specialised {
                known.specialised.insert(id);
            }
        }
        known
    }

    /// The specialised lengths of arrays, and their defaults.
    fn lengths(&self, module: &Module) -> Vec<(Word, u32)> {
        let types = module.types_global_values.iter();
        let arrays = types.filter(|i| i.class.opcode == Op::TypeArray);
        let lengths = arrays.filter_map(|ty| ids(ty).nth(1));
        let specialised = lengths.filter(|length| self.specialised.contains(length));
        specialised
            .filter_map(|length| Some((length, *self.values.get(&length)? as u32)))
            .collect()
    }

    /// The ids and names of the constants that decide a value.
    fn roots(&self, id: Word, into: &mut BTreeMap<u32, String>) {
        let mut seen = HashSet::new();
        let mut open = vec![id];
        while let Some(id) = open.pop() {
            if !seen.insert(id) {
                continue;
            }
            if let Some(spec) = self.ids.get(&id) {
                let name = self.names.get(&id).cloned();
                into.insert(*spec, name.unwrap_or_else(|| format!("%{id}")));
            }
            open.extend(self.globals.get(&id).into_iter().flat_map(ids));
        }
    }

    /// The default, as the type's width and sign have it.
    fn value(&self, i: &Instruction) -> Option<i64> {
        let ty = self.globals.get(&i.result_type?)?;
        let value = self.wide_value(i)?;
        let is_signed = ty.operands.get(1).and_then(literal) == Some(1);
        Some(match ty.class.opcode {
            Op::TypeInt if is_signed => i64::from(value as i32),
            Op::TypeInt => i64::from(value as u32),
            _ => value,
        })
    }

    fn wide_value(&self, i: &Instruction) -> Option<i64> {
        let of = |n: usize| self.values.get(&ids(i).nth(n)?).copied();
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
        let computed: HashSet<Word> = self.computed.iter().copied().collect();
        let mut functions = std::mem::take(&mut module.module_mut().functions);
        for function in &mut functions {
            let mut needed: HashSet<Word> = HashSet::new();
            let mut open: Vec<Word> = function.all_inst_iter().flat_map(ids).collect();
            while let Some(id) = open.pop() {
                if computed.contains(&id) && needed.insert(id) {
                    open.extend(self.globals.get(&id).into_iter().flat_map(ids));
                }
            }
            if needed.is_empty() {
                continue;
            }
            let mut new: HashMap<Word, Word> = HashMap::new();
            let mut start = Vec::new();
            for id in self.computed.iter().filter(|id| needed.contains(id)) {
                self.write(*id, module, &mut start, &mut new);
            }
            for block in &mut function.blocks {
                for operand in block.instructions.iter_mut().flat_map(|i| &mut i.operands) {
                    replace(operand, &new);
                }
            }
            let made: HashSet<Word> = new.into_values().collect();
            if let Some(first) = function.blocks.first_mut() {
                enter(first, start, &made);
            }
        }
        module.module_mut().functions = functions;
    }

    /// Writes the computation of a value whose parts are written.
    fn write(
        &self,
        id: Word,
        module: &mut Builder,
        into: &mut Vec<Instruction>,
        new: &mut HashMap<Word, Word>,
    ) {
        let Some(i) = self.globals.get(&id) else {
            return;
        };
        let op = operation(i).unwrap_or(Op::CompositeConstruct);
        let is_operation = |o: &Operand| matches!(o, Operand::LiteralSpecConstantOpInteger(_));
        let operands = i.operands.iter().filter(|o| !is_operation(o));
        let mut operands: Vec<Operand> = operands.cloned().collect();
        operands.iter_mut().for_each(|o| replace(o, new));
        let result = module.id();
        into.push(Instruction::new(op, i.result_type, Some(result), operands));
        new.insert(id, result);
    }
}

fn replace(operand: &mut Operand, new: &HashMap<Word, Word>) {
    if let Some(id) = operand.id_ref_any_mut()
        && let Some(new) = new.get(id)
    {
        *id = *new;
    }
}

/// Writes the start of a function behind its variables. Those whose initial values are `made` there
/// get them by a store.
fn enter(first: &mut Block, mut start: Vec<Instruction>, made: &HashSet<Word>) {
    for i in &mut first.instructions {
        let value = ids(i).next().filter(|value| made.contains(value));
        if i.class.opcode == Op::Variable
            && let (Some(id), Some(value)) = (i.result_id, value)
        {
            i.operands.truncate(1);
            let store = [id, value].map(Operand::IdRef).to_vec();
            start.push(Instruction::new(Op::Store, None, None, store));
        }
    }
    let at = after_variables(first);
    first.instructions.splice(at..at, start);
}

fn operation(i: &Instruction) -> Option<Op> {
    match i.operands.first() {
        Some(Operand::LiteralSpecConstantOpInteger(op)) => Some(*op),
        _ => None,
    }
}
