//! Keeps the vertex and the fragment entry points, and what they reach. One module may hold a
//! pipeline's other stages too, whose instructions naga may not read.

use std::collections::{HashMap, HashSet};

use rspirv::dr::{Instruction, Module, Operand};
use rspirv::spirv::{ExecutionModel, Op, Word};

use crate::words::{ids, sort_globals};

/// The stage and the function of an entry point.
pub(super) fn entry(instruction: &Instruction) -> Option<(ExecutionModel, Word)> {
    match instruction.operands.as_slice() {
        [Operand::ExecutionModel(model), Operand::IdRef(function), ..] => Some((*model, *function)),
        _ => None,
    }
}

fn is_of_material(model: ExecutionModel) -> bool {
    matches!(model, ExecutionModel::Vertex | ExecutionModel::Fragment)
}

/// Drops the entry points of other stages, except for a module that has no others, and what is not
/// used then. `only`: drops the others of these two stages as well.
pub(super) fn prune(module: &mut Module, only: Option<ExecutionModel>) {
    let models = |module: &Module| -> Vec<ExecutionModel> {
        let entries = module.entry_points.iter();
        entries.filter_map(|e| Some(entry(e)?.0)).collect()
    };
    if models(module).into_iter().any(is_of_material) {
        module
            .entry_points
            .retain(|e| entry(e).is_some_and(|(model, _)| is_of_material(model)));
    }
    if let Some(only) = only
        && models(module).contains(&only)
    {
        module
            .entry_points
            .retain(|e| entry(e).is_some_and(|(model, _)| model == only));
    }
    let roots: Vec<Word> = module
        .entry_points
        .iter()
        .filter_map(|e| Some(entry(e)?.1))
        .collect();
    module
        .execution_modes
        .retain(|mode| ids(mode).next().is_some_and(|id| roots.contains(&id)));
    let calls: HashMap<Word, Vec<Word>> = module
        .functions
        .iter()
        .filter_map(|f| {
            let all = f.all_inst_iter();
            let called = all.filter(|i| i.class.opcode == Op::FunctionCall);
            Some((f.def_id()?, called.filter_map(|i| ids(i).next()).collect()))
        })
        .collect();
    let mut reached: HashSet<Word> = HashSet::new();
    let mut open = roots;
    while let Some(id) = open.pop() {
        if reached.insert(id) {
            open.extend(calls.get(&id).into_iter().flatten());
        }
    }
    let is_reached = |id: Option<Word>| id.is_some_and(|id| reached.contains(&id));
    module.functions.retain(|f| is_reached(f.def_id()));
    drop_unused(module);
}

/// Drops definitions, names and decorations of what no function uses, and sorts the definitions.
pub(super) fn drop_unused(module: &mut Module) {
    sort_globals(module, |_| false);
    let left: HashSet<Word> = module.all_inst_iter().filter_map(|i| i.result_id).collect();
    let is_left = |i: &Instruction| ids(i).next().is_none_or(|id| left.contains(&id));
    module.debug_names.retain(is_left);
    module.annotations.retain(is_left);
    for entry in &mut module.entry_points {
        let is_left = |o: &Operand| o.id_ref_any().is_none_or(|id| left.contains(&id));
        entry.operands.retain(is_left);
    }
}
