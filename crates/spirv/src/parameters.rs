//! Fixes types of parameters. naga's reader declares textures and samplers as if they did not
//! compare, and glslang passes pointers to copies where the author passes values.

use std::collections::{BTreeMap, HashMap, HashSet};

use naga::{
    AddressSpace, Block, Expression, Function, Handle, LocalVariable, Module, Range, Span,
    Statement, Type, TypeInner,
};
use naga_operands::calls;

/// Changes all functions of a module.
pub(super) fn settle(module: &mut Module) {
    let textures = opaque(module);
    for ((function, index), ty) in textures {
        module.functions[function].arguments[index].ty = ty;
    }
    let values = read_only(module);
    for (handle, function) in module.functions.iter_mut() {
        if let Some(values) = values.get(&handle) {
            take_values(function, values);
        }
        pass_values(function, &values);
    }
    for entry in &mut module.entry_points {
        pass_values(&mut entry.function, &values);
    }
}

/// The textures and samplers that callers pass, if their types differ from the parameter's.
fn opaque(module: &Module) -> HashMap<(Handle<Function>, usize), Handle<Type>> {
    let mut found: HashMap<(Handle<Function>, usize), Handle<Type>> = HashMap::new();
    calls::visit(module, &mut |call| {
        let (caller, function) = call.caller;
        for (i, argument) in call.arguments.iter().enumerate() {
            let ty = match function.expressions[*argument] {
                Expression::GlobalVariable(handle) => module.global_variables[handle].ty,
                Expression::FunctionArgument(n) => {
                    let own = function.arguments[n as usize].ty;
                    let changed = caller.and_then(|c| found.get(&(c, n as usize)));
                    changed.copied().unwrap_or(own)
                }
                _ => continue,
            };
            let is_opaque = matches!(
                module.types[ty].inner,
                TypeInner::Image { .. } | TypeInner::Sampler { .. }
            );
            if is_opaque && ty != module.functions[call.callee].arguments[i].ty {
                found.insert((call.callee, i), ty);
            }
        }
    });
    found
}

/// The parameters of each function that point to variables of the caller and are only loaded from,
/// with the types of their values.
fn read_only(module: &Module) -> HashMap<Handle<Function>, BTreeMap<usize, Handle<Type>>> {
    let mut found = HashMap::new();
    for (handle, function) in module.functions.iter() {
        let arguments = function.arguments.iter().enumerate();
        let pointers = arguments.filter_map(|(i, a)| match module.types[a.ty].inner {
            TypeInner::Pointer {
                base,
                space: AddressSpace::Function,
            } => Some((i, base)),
            _ => None,
        });
        let written = written(function);
        let own: BTreeMap<usize, Handle<Type>> =
            pointers.filter(|(i, _)| !written.contains(i)).collect();
        if !own.is_empty() {
            found.insert(handle, own);
        }
    }
    found
}

/// The parameters whose pointer a statement uses.
fn written(function: &Function) -> HashSet<usize> {
    let mut found = HashSet::new();
    let root = |mut e: Handle<Expression>| loop {
        match function.expressions[e] {
            Expression::Access { base, .. } | Expression::AccessIndex { base, .. } => e = base,
            Expression::FunctionArgument(i) => return Some(i as usize),
            _ => return None,
        }
    };
    naga_operands::visit(&function.body, &mut |statement| {
        let pointers = match statement {
            Statement::Store { pointer, .. } => vec![*pointer],
            other => naga_operands::of_statement(other),
        };
        found.extend(pointers.into_iter().filter_map(root));
    });
    found
}

/// Turns these parameters into values, copied to local variables.
fn take_values(function: &mut Function, values: &BTreeMap<usize, Handle<Type>>) {
    let mut copies = Block::new();
    for (index, ty) in values {
        let argument = &mut function.arguments[*index];
        argument.ty = *ty;
        let local = LocalVariable {
            name: argument.name.clone(),
            ty: *ty,
            init: None,
        };
        let local = function.local_variables.append(local, Span::UNDEFINED);
        let is_own = |e: &Expression| *e == Expression::FunctionArgument(*index as u32);
        for (_, expression) in function.expressions.iter_mut() {
            if is_own(expression) {
                *expression = Expression::LocalVariable(local);
            }
        }
        let argument = Expression::FunctionArgument(*index as u32);
        let value = function.expressions.append(argument, Span::UNDEFINED);
        let pointer = Expression::LocalVariable(local);
        let pointer = function.expressions.append(pointer, Span::UNDEFINED);
        copies.push(Statement::Store { pointer, value }, Span::UNDEFINED);
    }
    copies.extend_block(std::mem::take(&mut function.body));
    function.body = copies;
}

/// Loads the values before calls.
fn pass_values(
    function: &mut Function,
    values: &HashMap<Handle<Function>, BTreeMap<usize, Handle<Type>>>,
) {
    let mut body = std::mem::take(&mut function.body);
    load_arguments(&mut body, function, values);
    function.body = body;
}

fn load_arguments(
    block: &mut Block,
    function: &mut Function,
    values: &HashMap<Handle<Function>, BTreeMap<usize, Handle<Type>>>,
) {
    let old = std::mem::take(block);
    for (mut statement, span) in old.span_into_iter() {
        for inner in naga_operands::blocks_mut(&mut statement) {
            load_arguments(inner, function, values);
        }
        if let Statement::Call {
            function: callee,
            arguments,
            ..
        } = &mut statement
            && let Some(values) = values.get(callee)
        {
            let start = function.expressions.len();
            for index in values.keys() {
                let pointer = arguments[*index];
                let load = Expression::Load { pointer };
                arguments[*index] = function.expressions.append(load, span);
            }
            let loads: Range<Expression> = function.expressions.range_from(start);
            block.push(Statement::Emit(loads), span);
        }
        block.push(statement, span);
    }
}
