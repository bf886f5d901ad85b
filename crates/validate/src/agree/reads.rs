//! The parts of variables that a program reads.

use std::collections::BTreeSet;

use naga::{Expression, Function, GlobalVariable, Handle, Span};

use crate::stage::Stage;
use naga_operands::calls;

/// A variable and a part of it.
type VariablePart = (Handle<GlobalVariable>, Vec<usize>);

/// The parts that a stage reads at places that count, by their variable's group and binding: the
/// longest constant paths.
pub(super) fn parts(
    stage: Stage<'_>,
    counts: &dyn Fn(Span) -> bool,
) -> BTreeSet<((u32, u32), Vec<usize>)> {
    let module = stage.module();
    let mut found = BTreeSet::new();
    of_function(stage.function(), counts, &mut found);
    for function in calls::called(module, &stage.function().body) {
        of_function(&module.functions[function], counts, &mut found);
    }
    let place = |global| naga_interp::place(&module.global_variables[global]);
    let found = found.into_iter();
    found
        .filter_map(|(global, steps)| Some((place(global)?, steps)))
        .collect()
}

fn of_function(
    function: &Function,
    counts: &dyn Fn(Span) -> bool,
    found: &mut BTreeSet<VariablePart>,
) {
    let mut roots: Vec<Option<VariablePart>> = Vec::with_capacity(function.expressions.len());
    for (handle, expression) in function.expressions.iter() {
        let root = match expression {
            Expression::GlobalVariable(global) => Some((*global, Vec::new())),
            Expression::Load { .. } if !counts(function.expressions.get_span(handle)) => None,
            Expression::Load { pointer } => roots[pointer.index()].clone(),
            Expression::AccessIndex { base, index } => {
                roots[base.index()].clone().map(|(global, mut steps)| {
                    steps.push(*index as usize);
                    (global, steps)
                })
            }
            other => {
                for operand in naga_operands::of_expression(other) {
                    found.extend(roots[operand.index()].clone());
                }
                None
            }
        };
        roots.push(root);
    }
    of_block(&function.body, &roots, found);
}

fn of_block(
    block: &naga::Block,
    roots: &[Option<VariablePart>],
    found: &mut BTreeSet<VariablePart>,
) {
    for statement in block {
        for operand in naga_operands::of_statement(statement) {
            found.extend(roots[operand.index()].clone());
        }
        for inner in naga_operands::blocks(statement) {
            of_block(inner, roots, found);
        }
    }
}

/// Whether two parts of one variable overlap.
pub(super) fn overlap(a: &[usize], b: &[usize]) -> bool {
    a.starts_with(b) || b.starts_with(a)
}
