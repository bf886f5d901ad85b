//! Writes `OpDemoteToHelperInvocation` for an author whose `discard` demotes. naga writes `OpKill`,
//! after which derivatives of neighbours are undefined, and drops the statements behind it.

use naga::{Block, Expression, Function, GlobalVariable, Handle, Literal, Span, Statement};
use naga_edit::variable::private_bool;
use preshade_plan::program::Program;
use rspirv::dr::{Builder, Instruction, Operand};
use rspirv::spirv::{Capability, Op};

use naga_spirv::words::{ids, rewrite};

/// Name of the variable whose stores stand for the instruction.
const MARK: &str = "preshade_demote";

/// SPIR-V before 1.6 needs it.
const EXTENSION: &str = "SPV_EXT_demote_to_helper_invocation";

/// The program with a store to a variable in place of each `discard`. `None` if the author's does
/// not demote, or if a function ends with one.
pub(super) fn marked(program: &Program) -> Option<Program> {
    if !program.declared().demotes {
        return None;
    }
    let mut module = program.module().clone();
    let mark = private_bool(&mut module, MARK);
    let functions = module.functions.iter_mut().map(|(_, f)| f);
    let entries = module.entry_points.iter_mut().map(|e| &mut e.function);
    for function in functions.chain(entries) {
        let mut body = std::mem::take(&mut function.body);
        mark_in(&mut body, function, mark);
        function.body = body;
    }
    program.with_module(module).ok()
}

fn mark_in(block: &mut Block, function: &mut Function, mark: Handle<GlobalVariable>) {
    for statement in block.iter_mut() {
        if matches!(statement, Statement::Kill) {
            let mut add = |e| function.expressions.append(e, Span::UNDEFINED);
            *statement = Statement::Store {
                pointer: add(Expression::GlobalVariable(mark)),
                value: add(Expression::Literal(Literal::Bool(true))),
            };
            continue;
        }
        for inner in naga_operands::blocks_mut(statement) {
            mark_in(inner, function, mark);
        }
    }
}

/// Replaces the stores of [`marked`] by the instruction.
pub(super) fn write(module: &mut Builder) {
    let mut names = module.module_ref().debug_names.iter();
    let is_mark = |i: &&Instruction| {
        i.class.opcode == Op::Name
            && matches!(i.operands.as_slice(), [_, Operand::LiteralString(name)] if name == MARK)
    };
    let Some(mark) = names.find(is_mark).and_then(|i| ids(i).next()) else {
        return;
    };
    rewrite(module, |_, block, instruction| {
        let is_mark = ids(&instruction).next() == Some(mark);
        block.push(match instruction.class.opcode {
            Op::Store if is_mark => {
                Instruction::new(Op::DemoteToHelperInvocation, None, None, Vec::new())
            }
            _ => instruction,
        });
    });
    let module_mut = module.module_mut();
    let types = &mut module_mut.types_global_values;
    types.retain(|i| i.result_id != Some(mark));
    module_mut
        .debug_names
        .retain(|i| ids(i).next() != Some(mark));
    module.capability(Capability::DemoteToHelperInvocation);
    module.extension(EXTENSION);
}
