//! Distinguishes loops over the terms of a convergent series from loops over the scene's objects.
//! The last object matters as much as the first.

use std::collections::BTreeSet;

use naga::{
    AddressSpace, BinaryOperator, Expression, Function, GlobalVariable, Handle, Literal,
    LocalVariable, Module, Statement, TypeInner,
};

use preshade_dataflow::graph::counted::Counted;
use preshade_dataflow::graph::{FunctionGraph, FunctionId, Graph, StmtId};

/// The scene data that a loop reads by its counter, one item per iteration: `lights[i]`, the layer
/// of a texture, a texel. `None` if it reads none, in the function or its callees.
pub(crate) fn scene_data(
    graph: &Graph<'_>,
    function: FunctionId,
    counted: &Counted,
) -> Option<String> {
    let counters = BTreeSet::from([counted.counter]);
    read_by(graph, function, counters, &BTreeSet::new(), 0)
}

/// Depth of calls to follow.
const DEPTH: usize = 8;

/// The scene data that `function` reads by values that depend on these locals or arguments.
fn read_by(
    graph: &Graph<'_>,
    function: FunctionId,
    mut locals: BTreeSet<Handle<LocalVariable>>,
    arguments: &BTreeSet<u32>,
    depth: usize,
) -> Option<String> {
    let f = graph.function(function);
    let statements = all(f.function);
    // Locals hold stored values, in any order of statements, so we iterate to a fixed point.
    let resting = loop {
        let resting = resting(f.function, &locals, arguments);
        let before = locals.len();
        for statement in &statements {
            if let Statement::Store { pointer, value } = statement
                && let Some(local) = local(f.function, *pointer)
                && resting.contains(value)
                && is_index(graph.module(), f, *value)
            {
                locals.insert(local);
            }
        }
        if locals.len() == before {
            break resting;
        }
    };
    for (_, e) in f.function.expressions.iter() {
        let read = match e {
            Expression::Access { base, index } if resting.contains(index) => {
                global(f.function, *base).filter(|g| is_data(&graph.module().global_variables[*g]))
            }
            Expression::ImageLoad {
                image,
                coordinate,
                array_index,
                ..
            } => [Some(*coordinate), *array_index]
                .into_iter()
                .flatten()
                .any(|e| resting.contains(&e))
                .then(|| global(f.function, *image))
                .flatten(),
            Expression::ImageSample {
                image,
                array_index: Some(layer),
                ..
            } if resting.contains(layer) => global(f.function, *image),
            _ => None,
        };
        if let Some(read) = read {
            let name = graph.module().global_variables[read].name.clone();
            return Some(name.unwrap_or_else(|| "a buffer".to_owned()));
        }
    }
    if depth == DEPTH {
        return None;
    }
    statements.iter().find_map(|statement| {
        let Statement::Call {
            function: callee,
            arguments: given,
            ..
        } = statement
        else {
            return None;
        };
        let passed: BTreeSet<u32> = (0..)
            .zip(given)
            .filter(|(_, e)| resting.contains(e))
            .map(|(i, _)| i)
            .collect();
        let callee = FunctionId::Function(*callee);
        (!passed.is_empty())
            .then(|| read_by(graph, callee, BTreeSet::new(), &passed, depth + 1))
            .flatten()
    })
}

/// The expressions that depend on these locals and arguments. Operands precede readers in naga's
/// arenas.
fn resting(
    function: &Function,
    locals: &BTreeSet<Handle<LocalVariable>>,
    arguments: &BTreeSet<u32>,
) -> BTreeSet<Handle<Expression>> {
    let mut resting = BTreeSet::new();
    for (handle, e) in function.expressions.iter() {
        let rests = match e {
            Expression::FunctionArgument(i) => arguments.contains(i),
            Expression::Load { pointer } => {
                local(function, *pointer).is_some_and(|l| locals.contains(&l))
                    || resting.contains(pointer)
            }
            e => naga_operands::of_expression(e)
                .iter()
                .any(|o| resting.contains(o)),
        };
        if rests {
            resting.insert(handle);
        }
    }
    resting
}

/// Whether a value may be an index. Float sums that depend on the counter are not.
fn is_index(module: &Module, f: &FunctionGraph<'_>, e: Handle<Expression>) -> bool {
    let scalar = match f.ty(module, e) {
        TypeInner::Scalar(scalar) | TypeInner::Vector { scalar, .. } => *scalar,
        _ => return false,
    };
    matches!(scalar.kind, naga::ScalarKind::Sint | naga::ScalarKind::Uint)
}

/// Whether a variable holds the host's data.
fn is_data(variable: &GlobalVariable) -> bool {
    matches!(
        variable.space,
        AddressSpace::Uniform | AddressSpace::Storage { .. } | AddressSpace::Handle
    )
}

fn local(function: &Function, pointer: Handle<Expression>) -> Option<Handle<LocalVariable>> {
    match function.expressions[naga_operands::base(&function.expressions, pointer)] {
        Expression::LocalVariable(local) => Some(local),
        _ => None,
    }
}

/// The global of a pointer, or of a loaded value.
fn global(function: &Function, of: Handle<Expression>) -> Option<Handle<GlobalVariable>> {
    match function.expressions[naga_operands::base(&function.expressions, of)] {
        Expression::GlobalVariable(global) => Some(global),
        Expression::Load { pointer } => global(function, pointer),
        _ => None,
    }
}

/// Whether a loop-carried local shrinks in each iteration: it is multiplied by a number of
/// magnitude below 1, or divided by one above 1, as the weight of a convergent series. A local with
/// other stores in the loop restarts there, and an inner loop's local belongs to that loop.
pub(crate) fn ebbs(module: &Module, f: &FunctionGraph<'_>, at: StmtId) -> bool {
    let end = f.statements.get(at).end;
    let inner: Vec<(StmtId, StmtId)> = f
        .statements
        .iter()
        .filter(|(id, node)| {
            *id > at && *id < end && matches!(node.statement, Statement::Loop { .. })
        })
        .map(|(id, node)| (id, node.end))
        .collect();
    let is_inner = |id: StmtId| inner.iter().any(|(from, to)| (*from..*to).contains(&id));
    let within = || f.statements.iter().filter(|(id, _)| (at..end).contains(id));
    let stores_to = |to: Handle<LocalVariable>| {
        let stores = within().filter(|(_, node)| match node.statement {
            Statement::Store { pointer, .. } => local(f.function, *pointer) == Some(to),
            Statement::Call { arguments, .. } => {
                arguments.iter().any(|a| local(f.function, *a) == Some(to))
            }
            _ => false,
        });
        stores.count()
    };
    within().any(|(id, node)| {
        let Statement::Store { pointer, value } = node.statement else {
            return false;
        };
        let is_carried =
            local(f.function, *pointer).is_some_and(|to| stores_to(to) == 1) && !is_inner(id);
        if !is_carried {
            return false;
        }
        let Expression::Binary { op, left, right } = f.function.expressions[*value] else {
            return false;
        };
        let own = |e: Handle<Expression>| match f.function.expressions[e] {
            Expression::Load { pointer: from } => {
                let to = local(f.function, *pointer);
                to.is_some() && local(f.function, from) == to
            }
            _ => false,
        };
        let number = |e: Handle<Expression>| float(module, f.function, e).map(f64::abs);
        match op {
            BinaryOperator::Multiply => {
                let factor = match (own(left), own(right)) {
                    (true, false) => number(right),
                    (false, true) => number(left),
                    _ => None,
                };
                factor.is_some_and(|c| c < 1.0)
            }
            BinaryOperator::Divide => own(left) && number(right).is_some_and(|c| c > 1.0),
            _ => false,
        }
    })
}

/// A float literal, or a named constant of the author's.
fn float(module: &Module, function: &Function, e: Handle<Expression>) -> Option<f64> {
    let literal = |e: &Expression| match e {
        Expression::Literal(Literal::F32(v)) => Some(f64::from(*v)),
        Expression::Literal(Literal::F64(v)) => Some(*v),
        Expression::Literal(Literal::F16(v)) => Some(f64::from(v.to_f32())),
        _ => None,
    };
    match &function.expressions[e] {
        Expression::Constant(c) => literal(&module.global_expressions[module.constants[*c].init]),
        Expression::Splat { value, .. } => float(module, function, *value),
        e => literal(e),
    }
}

/// Every statement of a function, with nested blocks.
fn all(function: &Function) -> Vec<&Statement> {
    let mut found = Vec::new();
    let mut blocks = vec![&function.body];
    while let Some(block) = blocks.pop() {
        for statement in block {
            found.push(statement);
            blocks.extend(naga_operands::blocks(statement));
        }
    }
    found
}
