//! Selects the vertex and fragment entry points and the code that they use. A module may also hold
//! other stages of a pipeline, whose instructions naga may not support.

use std::collections::{HashMap, HashSet};

use rspirv::dr::{Instruction, Module, Operand};
use rspirv::spirv::{ExecutionModel, Op, StorageClass, Word};

use crate::words::{ids, sort_globals, storage_class};

/// The stage and the function of an entry point.
pub(super) fn entry(instruction: &Instruction) -> Option<(ExecutionModel, Word)> {
    match instruction.operands.as_slice() {
        [Operand::ExecutionModel(model), Operand::IdRef(function), ..] => Some((*model, *function)),
        _ => None,
    }
}

/// Whether a material uses this stage.
pub(super) fn is_of_material(model: ExecutionModel) -> bool {
    matches!(model, ExecutionModel::Vertex | ExecutionModel::Fragment)
}

#[derive(Clone, Copy, Default)]
pub(super) struct Chosen<'a> {
    /// The only stage to keep. `None`: both.
    pub(super) stage: Option<ExecutionModel>,
    /// The author's names of the vertex and fragment entry points, for stages with several.
    pub(super) names: [Option<&'a str>; 2],
}

/// Drops the entry points that are not selected, and code that is then unused. Entry points of
/// other stages stay only in a module that has no others.
pub(super) fn prune(module: &mut Module, chosen: Chosen<'_>) {
    let models = |module: &Module| -> Vec<ExecutionModel> {
        let entries = module.entry_points.iter();
        entries.filter_map(|e| Some(entry(e)?.0)).collect()
    };
    if models(module).into_iter().any(is_of_material) {
        module
            .entry_points
            .retain(|e| entry(e).is_some_and(|(model, _)| is_of_material(model)));
    }
    if let Some(only) = chosen.stage
        && models(module).contains(&only)
    {
        module
            .entry_points
            .retain(|e| entry(e).is_some_and(|(model, _)| model == only));
    }
    let of_material = [ExecutionModel::Vertex, ExecutionModel::Fragment];
    for (of, name) in of_material.into_iter().zip(chosen.names) {
        let is = |e: &Instruction| {
            let own = e.operands.get(2);
            let is_name = matches!((own, name), (Some(Operand::LiteralString(own)), Some(name)) if own == name);
            is_name && entry(e).is_some_and(|(model, _)| model == of)
        };
        // For an unknown name, a later error lists the others.
        if module.entry_points.iter().any(is) {
            module
                .entry_points
                .retain(|e| is(e) || entry(e).is_none_or(|(model, _)| model != of));
        }
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

/// Whether a variable is an output with an initial value.
pub(super) fn is_initial_output(i: &Instruction) -> bool {
    let is_output = storage_class(i) == Some(StorageClass::Output);
    i.class.opcode == Op::Variable && is_output && ids(i).next().is_some()
}

/// Drops unused definitions with their names and decorations, and sorts the others.
pub(super) fn drop_unused(module: &mut Module) {
    let listed: HashSet<Word> = module.entry_points.iter().flat_map(ids).collect();
    // An entry point may leave an output at its initial value.
    sort_globals(module, |i| {
        is_initial_output(i) && i.result_id.is_some_and(|id| listed.contains(&id))
    });
    let left: HashSet<Word> = module.all_inst_iter().filter_map(|i| i.result_id).collect();
    let is_left = |i: &Instruction| ids(i).next().is_none_or(|id| left.contains(&id));
    module.debug_names.retain(is_left);
    module.annotations.retain(is_left);
    for entry in &mut module.entry_points {
        let is_left = |o: &Operand| o.id_ref_any().is_none_or(|id| left.contains(&id));
        entry.operands.retain(is_left);
    }
}
