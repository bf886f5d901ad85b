//! Passes GLSL inputs and globals as parameters to the functions that only read them.
//!
//! In the IR, GLSL inputs and globals are variables of the whole invocation. A pass that runs part
//! of a stage separately cannot distinguish them from state:
//!
//! ```wgsl
//! var<private> uv: vec2f;
//! fn wave() -> f32 { return sin(uv.x); }                 fn wave(uv: vec2f) -> f32 { return sin(uv.x); }
//! fn main() { color = vec4f(wave()); }           ->      fn main() { color = vec4f(wave(uv)); }
//! ```
//!
//! If only `main` and its wrapper write a variable, it is constant during each call that `main`
//! makes. [`super::inline_main`] then turns the variable into a local.

use std::collections::{HashMap, HashSet};

use naga::{
    AddressSpace, Block, Expression, Function, FunctionArgument, GlobalVariable, Handle,
    LocalVariable, Module, Range, Span, Statement,
};

use super::inline_main::{for_each_statement, global_of, wrapped};
use crate::wgsl::operands;

/// Larger variables, in bytes, are not passed: copying a table at each call costs too much.
const MOST_BYTES: u32 = 256;

/// Maximum number of parameters (WGSL 15.3).
const MOST_PARAMETERS: usize = 255;

/// The variables that become parameters of each function, in declaration order.
type Parameters = HashMap<Handle<Function>, Vec<Handle<GlobalVariable>>>;

/// Passes variables as parameters to the functions that `main` calls. `module` must be valid and
/// stays valid.
pub(super) fn pass_globals(module: &mut Module) {
    // naga's front end gives every function an expression for every global. Compaction leaves those
    // in use.
    naga::compact::compact(module, naga::compact::KeepUnused::Yes);
    // Several stages would share functions.
    let [_] = module.entry_points.as_slice() else {
        return;
    };
    let Some((_, main)) = wrapped(module, 0) else {
        return;
    };
    let variables = passable(module, main);
    let added = parameters(module, main, &variables);
    let count =
        |(f, more): (&Handle<Function>, &Vec<_>)| module.functions[*f].arguments.len() + more.len();
    if added.is_empty() || added.iter().map(count).any(|n| n > MOST_PARAMETERS) {
        return;
    }
    for (handle, variables) in &added {
        let function = with_parameters(module, &module.functions[*handle], variables, &added);
        module.functions[*handle] = function;
    }
    pass_arguments(&mut module.functions[main], &added);
}

/// Private variables that only `main` or its wrapper writes and all other functions only load.
fn passable(module: &Module, main: Handle<Function>) -> HashSet<Handle<GlobalVariable>> {
    let mut layouter = naga::proc::Layouter::default();
    if layouter.update(module.to_ctx()).is_err() {
        return HashSet::new();
    }
    let mut kept = HashSet::new();
    let mut written = HashSet::new();
    for (handle, function) in module.functions.iter() {
        for (global, does) in uses(function) {
            match does {
                Use::Written if handle == main => written.insert(global),
                Use::Written | Use::Escapes => kept.insert(global),
            };
        }
    }
    for (global, does) in uses(&module.entry_points[0].function) {
        match does {
            Use::Written => written.insert(global),
            Use::Escapes => kept.insert(global),
        };
    }
    written.retain(|global| {
        let variable = &module.global_variables[*global];
        variable.space == AddressSpace::Private
            && layouter[variable.ty].size <= MOST_BYTES
            && !kept.contains(global)
    });
    written
}

/// How a function uses a variable besides loading it.
#[derive(Clone, Copy)]
enum Use {
    /// Stores to all or part of it.
    Written,
    /// Passes a pointer to it to something that we do not analyse.
    Escapes,
}

fn uses(function: &Function) -> Vec<(Handle<GlobalVariable>, Use)> {
    let expressions = &function.expressions;
    let mut found = Vec::new();
    for (_, expression) in expressions.iter() {
        if let Expression::Load { .. }
        | Expression::AccessIndex { .. }
        | Expression::Access { .. } = expression
        {
            continue;
        }
        operands::of_expression(&mut expression.clone(), |e| {
            found.extend(global_of(expressions, *e).map(|g| (g, Use::Escapes)));
        });
    }
    for_each_statement(&mut function.body.clone(), &mut |statement| {
        if let Statement::Store { pointer, .. } = statement {
            found.extend(global_of(expressions, *pointer).map(|g| (g, Use::Written)));
            return;
        }
        operands::of_statement(statement, |e| {
            found.extend(global_of(expressions, *e).map(|g| (g, Use::Escapes)));
        });
    });
    found
}

/// The `variables` that each function except `main` loads, directly or through calls.
fn parameters(
    module: &Module,
    main: Handle<Function>,
    variables: &HashSet<Handle<GlobalVariable>>,
) -> Parameters {
    let mut parameters = Parameters::new();
    // Callees come before their callers in the arena.
    for (handle, function) in module.functions.iter().filter(|(h, _)| *h != main) {
        let mut needed: Vec<Handle<GlobalVariable>> = Vec::new();
        for (_, expression) in function.expressions.iter() {
            if let Expression::GlobalVariable(global) = expression {
                needed.extend(variables.get(global));
            }
        }
        for_each_statement(&mut function.body.clone(), &mut |statement| {
            if let Statement::Call { function, .. } = statement {
                needed.extend(parameters.get(function).into_iter().flatten());
            }
        });
        needed.sort();
        needed.dedup();
        if !needed.is_empty() {
            parameters.insert(handle, needed);
        }
    }
    parameters
}

/// Rebuilds a function with parameters for `variables`.
fn with_parameters(
    module: &Module,
    from: &Function,
    variables: &[Handle<GlobalVariable>],
    parameters: &Parameters,
) -> Function {
    let mut to = Function {
        name: from.name.clone(),
        arguments: from.arguments.clone(),
        result: from.result.clone(),
        local_variables: from.local_variables.clone(),
        diagnostic_filter_leaf: from.diagnostic_filter_leaf,
        ..Function::default()
    };
    // A dynamic index needs a local to point into.
    let indexed: HashSet<Handle<GlobalVariable>> = from
        .expressions
        .iter()
        .filter_map(|(_, e)| match e {
            Expression::Access { base, .. } => global_of(&from.expressions, *base),
            _ => None,
        })
        .collect();
    let mut stores = Block::new();
    let mut arguments = HashMap::new();
    let mut places = HashMap::new();
    for handle in variables {
        let variable = &module.global_variables[*handle];
        let span = module.global_variables.get_span(*handle);
        let index = to.arguments.len() as u32;
        to.arguments.push(FunctionArgument {
            name: variable.name.clone(),
            ty: variable.ty,
            binding: None,
        });
        let argument = to
            .expressions
            .append(Expression::FunctionArgument(index), span);
        arguments.insert(*handle, argument);
        let place = match indexed.contains(handle) {
            false => argument,
            true => {
                let local = LocalVariable {
                    name: variable.name.clone(),
                    ty: variable.ty,
                    init: None,
                };
                let local = to.local_variables.append(local, span);
                let pointer = to
                    .expressions
                    .append(Expression::LocalVariable(local), span);
                let value = argument;
                stores.push(Statement::Store { pointer, value }, span);
                pointer
            }
        };
        places.insert(*handle, place);
    }

    let mut copies: HashMap<Handle<Expression>, Handle<Expression>> = HashMap::new();
    for (handle, expression) in from.expressions.iter() {
        let new = match expression {
            Expression::GlobalVariable(global) if places.contains_key(global) => places[global],
            Expression::Load { pointer }
                if global_of(&from.expressions, *pointer)
                    .is_some_and(|g| places.contains_key(&g) && !indexed.contains(&g)) =>
            {
                copies[pointer]
            }
            other => {
                let mut expression = other.clone();
                operands::of_expression(&mut expression, |e| *e = copies[e]);
                let span = from.expressions.get_span(handle);
                to.expressions.append(expression, span)
            }
        };
        copies.insert(handle, new);
    }
    for (_, local) in to.local_variables.iter_mut() {
        local.init = local.init.map(|e| copies[&e]);
    }
    for (handle, name) in &from.named_expressions {
        let new = copies[handle];
        if !matches!(to.expressions[new], Expression::FunctionArgument(_)) {
            to.named_expressions.insert(new, name.clone());
        }
    }
    to.body = stores;
    let made = RebuiltStatements {
        from,
        copies: &copies,
        arguments: &arguments,
        parameters,
    };
    to.body.extend_block(made.block(&from.body));
    to
}

/// Maps statements of the old function to the new one.
struct RebuiltStatements<'a> {
    from: &'a Function,
    copies: &'a HashMap<Handle<Expression>, Handle<Expression>>,
    arguments: &'a HashMap<Handle<GlobalVariable>, Handle<Expression>>,
    parameters: &'a Parameters,
}

impl RebuiltStatements<'_> {
    fn block(&self, block: &Block) -> Block {
        let mut out = Block::with_capacity(block.len());
        for (statement, span) in block.span_iter() {
            match statement {
                Statement::Emit(range) => {
                    // Order is unchanged, so the remaining expressions form one range.
                    let mut left = range.clone().filter(|e| !self.is_value(*e));
                    let first = left.next();
                    let last = left.last().or(first);
                    if let (Some(first), Some(last)) = (first, last) {
                        let range = Range::new_from_bounds(self.copies[&first], self.copies[&last]);
                        out.push(Statement::Emit(range), *span);
                    }
                }
                other => {
                    let mut statement = other.clone();
                    operands::of_statement(&mut statement, |e| *e = self.copies[e]);
                    for inner in operands::blocks(&mut statement) {
                        *inner = self.block(inner);
                    }
                    if let Statement::Call {
                        function,
                        arguments,
                        ..
                    } = &mut statement
                    {
                        let more = self.parameters.get(function).into_iter().flatten();
                        arguments.extend(more.map(|g| self.arguments[g]));
                    }
                    out.push(statement, *span);
                }
            }
        }
        out
    }

    /// Whether the expression is a load that a value replaced.
    fn is_value(&self, handle: Handle<Expression>) -> bool {
        match self.from.expressions[handle] {
            Expression::Load { pointer } => self.copies[&pointer] == self.copies[&handle],
            _ => false,
        }
    }
}

/// In `main`, loads the variables before each call that takes them as arguments.
fn pass_arguments(main: &mut Function, parameters: &Parameters) {
    let mut body = std::mem::take(&mut main.body);
    lender_block(main, &mut body, parameters);
    main.body = body;
}

fn lender_block(main: &mut Function, block: &mut Block, parameters: &Parameters) {
    let mut out = Block::with_capacity(block.len());
    for (mut statement, span) in std::mem::take(block).span_into_iter() {
        for inner in operands::blocks(&mut statement) {
            lender_block(main, inner, parameters);
        }
        if let Statement::Call {
            function,
            arguments,
            ..
        } = &mut statement
            && let Some(variables) = parameters.get(function)
        {
            let pointers: Vec<Handle<Expression>> =
                variables.iter().map(|g| pointer(main, *g, span)).collect();
            let start = main.expressions.len();
            let loads = pointers
                .into_iter()
                .map(|pointer| main.expressions.append(Expression::Load { pointer }, span));
            arguments.extend(loads);
            out.push(Statement::Emit(main.expressions.range_from(start)), span);
        }
        out.push(statement, span);
    }
    *block = out;
}

fn pointer(main: &mut Function, global: Handle<GlobalVariable>, span: Span) -> Handle<Expression> {
    let is_it = |e: &Expression| matches!(e, Expression::GlobalVariable(of) if *of == global);
    let there = main.expressions.iter().find(|(_, e)| is_it(e));
    let there = there.map(|(handle, _)| handle);
    there.unwrap_or_else(|| {
        main.expressions
            .append(Expression::GlobalVariable(global), span)
    })
}
