//! Replaces uses of specialisation constants that naga's reader lacks. `OpSpecConstantOp` and
//! `OpSpecConstantComposite` are computed at the start of each function that uses them. Array
//! lengths get their default values.

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};

use naga_edit::declared::{FinalConstant, LengthConstant};
use rspirv::dr::{Block, Builder, Instruction, Module, Operand};
use rspirv::spirv::{Decoration, Op, StorageClass, Word};

use super::names::identifier;
use crate::words::{after_variables, decorations, globals, ids, literal, names};

/// Specialisation constants that determine array lengths, in all modules of a material.
#[derive(Default)]
pub(super) struct Lengths {
    /// Constants of arrays with a named type, each with its default.
    pub(super) kept: BTreeMap<u32, (LengthConstant, u32)>,
    /// Ids and names of constants that can no longer be specialised.
    pub(super) fixed: BTreeSet<(u32, String)>,
}

impl Lengths {
    pub(super) fn of<'m>(modules: impl Iterator<Item = &'m Module>) -> Self {
        let mut out = Self::default();
        modules.for_each(|module| out.add(module));
        let Self { kept, fixed } = &mut out;
        kept.retain(|id, _| fixed.iter().all(|(fixed, _)| fixed != id));
        out
    }

    /// The constants that can no longer be specialised, with their defaults.
    pub(super) fn finals<'m>(
        &self,
        modules: impl Iterator<Item = &'m Module>,
    ) -> Vec<FinalConstant> {
        let all: Vec<Known> = modules.map(Known::of).collect();
        let default = |constant: &(u32, String)| {
            let mut found = all.iter().flat_map(|known| {
                let is_it =
                    |id: &Word| known.ids[id] == constant.0 && known.name(*id) == constant.1;
                let id = known.ids.keys().copied().find(is_it)?;
                known.values.get(&id).copied()
            });
            found.next()
        };
        let finals = self.fixed.iter().map(|constant| FinalConstant {
            id: constant.0,
            own: constant.1.clone(),
            default: default(constant),
        });
        finals.collect()
    }

    fn add(&mut self, module: &Module) {
        let known = Known::of(module);
        let unnamed = unnamed(module, &known.globals);
        for ty in arrays(module) {
            let Some((length, default)) = known.length(ty) else {
                continue;
            };
            let is_unnamed = ty.result_id.is_some_and(|ty| unnamed.contains(&ty));
            match known.itself(length).filter(|_| !is_unnamed) {
                Some(constant) => {
                    let constant = (constant, default);
                    let first = self.kept.entry(constant.0.id);
                    let first = first.or_insert_with(|| constant.clone());
                    // A pass may merge the arrays of both stages.
                    if *first != constant {
                        let both = [&constant.0, &first.0];
                        let both = both.map(|of| (of.id, of.own.clone()));
                        self.fixed.extend(both);
                    }
                }
                None => known.roots(length, &mut self.fixed),
            }
        }
    }
}

fn arrays(module: &Module) -> impl Iterator<Item = &Instruction> {
    let types = module.types_global_values.iter();
    types.filter(|i| i.class.opcode == Op::TypeArray)
}

/// The types that cannot have a name in the IR: types of inputs and outputs, whose elements become
/// variables, and arrays of resources.
fn unnamed(module: &Module, globals: &HashMap<Word, Instruction>) -> HashSet<Word> {
    let mut found = HashSet::new();
    let mut open = Vec::new();
    for variable in &module.types_global_values {
        let (Op::Variable, Some(Operand::StorageClass(class))) =
            (variable.class.opcode, variable.operands.first())
        else {
            continue;
        };
        let pointee = variable.result_type.and_then(|ty| globals.get(&ty));
        let pointee = pointee.and_then(|ty| ids(ty).next());
        match class {
            StorageClass::Input | StorageClass::Output | StorageClass::UniformConstant => {
                open.extend(pointee);
            }
            StorageClass::Uniform | StorageClass::StorageBuffer => {
                found.extend(pointee);
            }
            _ => {}
        }
    }
    while let Some(ty) = open.pop() {
        if found.insert(ty) {
            open.extend(globals.get(&ty).into_iter().flat_map(ids));
        }
    }
    found
}

/// Replaces array lengths by their defaults, and names the array types whose constant can still be
/// specialised.
pub(super) fn settle(module: &mut Builder, lengths: &Lengths) {
    let known = Known::of(module.module_ref());
    let arrays: Vec<Instruction> = arrays(module.module_ref()).cloned().collect();
    for array in arrays {
        let (Some(ty), Some((length, default))) = (array.result_id, known.length(&array)) else {
            continue;
        };
        let of = known.globals.get(&length).and_then(|i| i.result_type);
        let Some(of) = of else { continue };
        let value = module.constant_bit32(of, default);
        let types = &mut module.module_mut().types_global_values;
        if let Some(array) = types.iter_mut().find(|i| i.result_id == Some(ty)) {
            array.operands[1] = Operand::IdRef(value);
        }
        let kept = known.itself(length);
        if let Some((kept, _)) = kept.and_then(|kept| lengths.kept.get(&kept.id)) {
            let names = &mut module.module_mut().debug_names;
            names.retain(|i| !(i.class.opcode == Op::Name && ids(i).next() == Some(ty)));
            module.name(ty, kept.type_name());
        }
    }
    known.compute(module);
    let is_fixed = |id: Option<Word>| {
        let Some((id, spec)) = id.and_then(|id| Some((id, *known.ids.get(&id)?))) else {
            return false;
        };
        lengths.fixed.contains(&(spec, known.name(id)))
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

/// The first specialisation constant with an infinite or NaN default, with its name.
pub(super) fn not_finite(module: &Module) -> Option<(Word, String)> {
    let known = Known::of(module);
    let found = module.types_global_values.iter().find(|i| {
        i.class.opcode == Op::SpecConstant
            && is_float(i, &known.globals)
            && infinite_bits(i).is_some()
    });
    let id = found?.result_id?;
    Some((id, known.name(id)))
}

fn is_float(i: &Instruction, globals: &HashMap<Word, Instruction>) -> bool {
    let ty = i.result_type.and_then(|ty| globals.get(&ty));
    ty.is_some_and(|ty| {
        ty.class.opcode == Op::TypeFloat && ty.operands.first().and_then(literal) == Some(32)
    })
}

/// The bits of a 32-bit float constant that is infinite or NaN.
fn infinite_bits(i: &Instruction) -> Option<u32> {
    let bits = i.operands.first().and_then(literal)?;
    (!f32::from_bits(bits).is_finite()).then_some(bits)
}

/// Turns infinite and NaN constants, and their composites, into operations. naga refuses them as
/// literals, but a function can compute them.
pub(super) fn compute_infinite(module: &mut Builder) {
    let globals = globals(module.module_ref());
    let mut computed = HashSet::new();
    let (mut scalars, mut composites) = (Vec::new(), Vec::new());
    for (at, i) in module.module_ref().types_global_values.iter().enumerate() {
        match (i.class.opcode, infinite_bits(i)) {
            (Op::Constant, Some(bits)) if is_float(i, &globals) => scalars.push((at, bits)),
            (Op::ConstantComposite, _) if ids(i).any(|id| computed.contains(&id)) => {
                composites.push(at);
            }
            _ => continue,
        }
        computed.extend(i.result_id);
    }
    if computed.is_empty() {
        return;
    }
    let uint = module.type_int(32, 0);
    for (at, bits) in scalars {
        let bits = module.constant_bit32(uint, bits);
        let i = &mut module.module_mut().types_global_values[at];
        let operation = Operand::LiteralSpecConstantOpInteger(Op::Bitcast);
        let operands = vec![operation, Operand::IdRef(bits)];
        *i = Instruction::new(Op::SpecConstantOp, i.result_type, i.result_id, operands);
    }
    for at in composites {
        let i = &mut module.module_mut().types_global_values[at];
        let operands = std::mem::take(&mut i.operands);
        *i = Instruction::new(
            Op::SpecConstantComposite,
            i.result_type,
            i.result_id,
            operands,
        );
    }
}

/// Facts about the constants. Each constant follows its parts, so one walk in order finds
/// everything.
struct Known {
    globals: HashMap<Word, Instruction>,
    ids: HashMap<Word, u32>,
    names: HashMap<Word, String>,
    /// Default values of 32-bit integers and booleans.
    values: HashMap<Word, i64>,
    /// The specialisation constants, and the operations and composites of them. naga's reader does
    /// not know their values.
    specialised: HashSet<Word>,
    /// The constants that functions compute, in order: operations, and composites of specialised
    /// parts, which naga's reader would treat as constants.
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
                // Even if all its operands are plain constants, because `spirv-opt` froze them.
                Op::SpecConstantOp => {
                    known.computed.push(id);
                    true
                }
                Op::SpecConstantComposite => {
                    let is_specialised = ids(i).any(|id| known.specialised.contains(&id));
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

    /// The specialised length of an array, and its default. `None` if the length is not
    /// specialised.
    fn length(&self, array: &Instruction) -> Option<(Word, u32)> {
        let length = ids(array).nth(1)?;
        let is_specialised = self.specialised.contains(&length);
        let default = *self.values.get(&length).filter(|_| is_specialised)?;
        Some((length, default as u32))
    }

    /// The constant, if the length is a specialisation constant and no expression.
    fn itself(&self, length: Word) -> Option<LengthConstant> {
        let ty = self.globals.get(&length)?.result_type?;
        let sign = self.globals.get(&ty)?.operands.get(1).and_then(literal)?;
        Some(LengthConstant {
            id: *self.ids.get(&length)?,
            own: self.name(length),
            is_signed: sign == 1,
        })
    }

    /// The name of a specialisation constant.
    fn name(&self, id: Word) -> String {
        let by_id = || format!("constant_{}", self.ids.get(&id).copied().unwrap_or(id));
        let own = self.names.get(&id).map(|name| identifier(name));
        own.unwrap_or_else(by_id)
    }

    /// Collects ids and names of the specialisation constants that a value depends on.
    fn roots(&self, id: Word, into: &mut BTreeSet<(u32, String)>) {
        let mut seen = HashSet::new();
        let mut open = vec![id];
        while let Some(id) = open.pop() {
            if !seen.insert(id) {
                continue;
            }
            if let Some(spec) = self.ids.get(&id) {
                into.insert((*spec, self.name(id)));
            }
            open.extend(self.globals.get(&id).into_iter().flat_map(ids));
        }
    }

    /// The default value, in the width and signedness of its type.
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
                // The result has the sign of the divisor.
                Op::SMod => {
                    let [a, b] = [of(0)?, of(1)?];
                    a.checked_rem(b)?.checked_add(b)?.checked_rem(b)?
                }
                Op::SNegate => of(0)?.checked_neg()?,
                Op::BitwiseAnd | Op::LogicalAnd => of(0)? & of(1)?,
                Op::BitwiseOr | Op::LogicalOr => of(0)? | of(1)?,
                Op::BitwiseXor => of(0)? ^ of(1)?,
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

    /// Computes the values at the start of each function that uses them.
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

    /// Writes the computation of a value, after its parts.
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

/// Inserts instructions after a function's variables. Variables whose initial value is in `made`
/// get it by a store.
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
