//! Writes `NMin`, `NMax` and `NClamp`. The SPIR-V reader represents each as a choice that tests the
//! bits of a value for NaN.
//!
//! ```text
//! %least = FMin %a %b
//! %nan = OpUGreaterThan %abs_bits_of_a %infinity
//! %r = OpSelect %nan %b %least                        %r = NMin %a %b
//! ```

use std::collections::{HashMap, HashSet};

use rspirv::dr::{Builder, Instruction, Operand};
use rspirv::spirv::{GlslStd450Op as Function, Op, Word};

use naga_spirv::words::{ids, literal};

/// Replaces all such choices, and drops the instructions that nothing else reads.
pub(super) fn choose(module: &mut Builder) {
    let all = module.module_ref().all_inst_iter();
    let mut values: HashMap<Word, Instruction> = all
        .filter_map(|i| Some((i.result_id?, i.clone())))
        .collect();
    let mut unread = HashSet::new();
    let functions = module.module_mut().functions.iter_mut();
    for i in functions.flat_map(|f| f.all_inst_iter_mut()) {
        if let Some((chosen, read)) = chosen(i, &values) {
            unread.extend(read);
            values.extend(chosen.result_id.map(|id| (id, chosen.clone())));
            *i = chosen;
        }
    }
    // From the choices back to their operands.
    while !unread.is_empty() {
        let module = module.module_mut();
        let all = module.functions.iter().flat_map(|f| f.all_inst_iter());
        let read: HashSet<Word> = all.flat_map(ids).collect();
        unread.retain(|id| !read.contains(id));
        let mut next = HashSet::new();
        for block in module.functions.iter_mut().flat_map(|f| &mut f.blocks) {
            block.instructions.retain(|i| {
                let is_kept = i.result_id.is_none_or(|id| !unread.contains(&id));
                if !is_kept {
                    let operands = ids(i).filter_map(|id| values.get(&id));
                    let pure = operands.filter(|i| is_test(i) || function(i).is_some());
                    next.extend(pure.filter_map(|i| i.result_id));
                }
                is_kept
            });
        }
        module
            .debug_names
            .retain(|i| ids(i).all(|id| !unread.contains(&id)));
        unread = next;
    }
}

fn is_test(i: &Instruction) -> bool {
    matches!(
        i.class.opcode,
        Op::UGreaterThan | Op::BitwiseAnd | Op::Bitcast
    )
}

fn function(i: &Instruction) -> Option<Function> {
    match i.operands.get(1)? {
        Operand::LiteralExtInstInteger(n) if i.class.opcode == Op::ExtInst => {
            Function::from_u32(*n)
        }
        _ => None,
    }
}

/// The call that an `OpSelect` stands for, and the two results that the choice read.
fn chosen(
    i: &Instruction,
    values: &HashMap<Word, Instruction>,
) -> Option<(Instruction, [Word; 2])> {
    if i.class.opcode != Op::Select {
        return None;
    }
    let [test, other, call] = ids(i).collect::<Vec<_>>().try_into().ok()?;
    let value = tested(values.get(&test)?, values)?;
    let limited = values.get(&call)?;
    let arguments: Vec<Word> = ids(limited).skip(1).collect();
    let (function, is_it) = match (function(limited)?, arguments.as_slice()) {
        (of @ (Function::FMin | Function::NMin), [a, b]) => (Function::NMin, (of, [*a, *b])),
        (of @ (Function::FMax | Function::NMax), [a, b]) => (Function::NMax, (of, [*a, *b])),
        (of @ Function::FClamp, [a, low, _]) => (Function::NClamp, (of, [*a, *low])),
        _ => return None,
    };
    let (of, [a, b]) = is_it;
    let is_swapped = of != Function::FClamp && [value, other] == [b, a];
    if [value, other] != [a, b] && !is_swapped {
        return None;
    }
    let mut new = limited.clone();
    new.operands[1] = Operand::LiteralExtInstInteger(function as u32);
    new.result_id = i.result_id;
    Some((new, [test, call]))
}

/// The value that an instruction tests for NaN.
fn tested(i: &Instruction, values: &HashMap<Word, Instruction>) -> Option<Word> {
    let is = |id: Word, n: u32| {
        let of = |i: &Instruction| i.operands.first().and_then(literal) == Some(n);
        values.get(&id).is_some_and(|i| match i.class.opcode {
            Op::ConstantComposite => ids(i).all(|id| values.get(&id).is_some_and(of)),
            _ => of(i),
        })
    };
    let operands =
        |i: &Instruction, op: Op| (i.class.opcode == op).then(|| ids(i).collect::<Vec<_>>());
    let [magnitude, infinity] = operands(i, Op::UGreaterThan)?.try_into().ok()?;
    let [bits, mask] = operands(values.get(&magnitude)?, Op::BitwiseAnd)?
        .try_into()
        .ok()?;
    let value = operands(values.get(&bits)?, Op::Bitcast)?.first().copied();
    value.filter(|_| is(infinity, 0x7f80_0000) && is(mask, 0x7fff_ffff))
}
