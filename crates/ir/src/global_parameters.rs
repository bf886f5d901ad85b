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

use crate::copy::{CopyFunction, Copying};
use crate::writer::FunctionWriter;
use naga::{
    AddressSpace, Expression, Function, FunctionArgument, GlobalVariable, Handle, LocalVariable,
    Module, Range, Span, Statement,
};
use naga_operands::calls;

use super::inline_main::{global_of, wrapped};

/// Larger variables, in bytes, are not passed: copying a table at each call costs too much.
const MOST_BYTES: u32 = 256;

/// Maximum number of parameters (WGSL 15.3).
const MOST_PARAMETERS: usize = 255;

/// The variables that become parameters of each function, in declaration order.
type Parameters = HashMap<Handle<Function>, Vec<Handle<GlobalVariable>>>;

/// Passes variables as parameters to the functions that `main` calls. `module` must be valid and
/// stays valid.
pub(super) fn pass_globals(module: &mut Module) {
    // Compaction leaves only expressions that are used.
    naga::compact::compact(module, naga::compact::KeepUnused::Yes);
    // With several stages, functions would be shared.
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

/// How a function uses a variable other than by loading it.
#[derive(Clone, Copy)]
enum Use {
    /// Stores to all or part of it.
    Written,
    /// Passes a pointer to it to code that we do not analyse.
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
        let escape = naga_operands::of_expression(expression).into_iter();
        let globals = escape.filter_map(|e| global_of(expressions, e));
        found.extend(globals.map(|g| (g, Use::Escapes)));
    }
    naga_operands::visit(&function.body, &mut |statement| {
        if let Statement::Store { pointer, .. } = statement {
            found.extend(global_of(expressions, *pointer).map(|g| (g, Use::Written)));
            return;
        }
        let escape = naga_operands::of_statement(statement).into_iter();
        let globals = escape.filter_map(|e| global_of(expressions, e));
        found.extend(globals.map(|g| (g, Use::Escapes)));
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
        let callees = calls::callees(&function.body);
        needed.extend(callees.iter().filter_map(|f| parameters.get(f)).flatten());
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
    let mut to = FunctionWriter::like(from).function;
    // A dynamic index needs a local to point into.
    let indexed: HashSet<Handle<GlobalVariable>> = from
        .expressions
        .iter()
        .filter_map(|(_, e)| match e {
            Expression::Access { base, .. } => global_of(&from.expressions, *base),
            _ => None,
        })
        .collect();
    let mut stores = Vec::new();
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
                stores.push((Statement::Store { pointer, value }, span));
                pointer
            }
        };
        places.insert(*handle, place);
    }

    let mut copying = Copying::new(from, FunctionWriter::of(to));
    for (handle, expression) in from.expressions.iter() {
        let same = match expression {
            Expression::GlobalVariable(global) => places.get(global).copied(),
            Expression::Load { pointer } => global_of(&from.expressions, *pointer)
                .filter(|g| places.contains_key(g) && !indexed.contains(g))
                .and_then(|_| copying.copies.get(*pointer)),
            _ => None,
        };
        match same {
            Some(same) => copying.copies.insert(handle, same),
            None => copying.append(handle, copying.copies.with_operands(expression)),
        }
    }
    for (_, local) in copying.writer.function.local_variables.iter_mut() {
        local.init = local.init.map(|e| copying.copies.mapped(e));
    }
    for (statement, span) in stores {
        copying.writer.statement(statement, span);
    }
    let mut statements = StatementCopy {
        copying,
        arguments: &arguments,
        parameters,
    };
    statements.block(&from.body);
    let mut to = statements.copying.finish();
    let expressions = &to.expressions;
    to.named_expressions
        .retain(|e, _| !matches!(expressions[*e], Expression::FunctionArgument(_)));
    to
}

/// Copies the statements of a function whose expressions have already been copied.
struct StatementCopy<'a> {
    copying: Copying<'a>,
    arguments: &'a HashMap<Handle<GlobalVariable>, Handle<Expression>>,
    parameters: &'a Parameters,
}

impl<'a> CopyFunction<'a> for StatementCopy<'a> {
    fn copying(&mut self) -> &mut Copying<'a> {
        &mut self.copying
    }

    fn expression(&mut self, _: Handle<Expression>) {}

    fn emit(&mut self, range: Range<Expression>, span: Span) {
        let Copying {
            original,
            copies,
            writer,
        } = &mut self.copying;
        // A value replaced some loads.
        let is_value = |e: &Handle<Expression>| match original.expressions[*e] {
            Expression::Load { pointer } => copies.get(pointer) == copies.get(*e),
            _ => false,
        };
        let left = range.filter(|e| !is_value(e));
        writer.emit_existing(left.filter_map(|e| copies.get(e)), span);
    }

    fn statement(&mut self, statement: &'a Statement, span: Span) {
        let mut copy = self.copied(statement, span);
        if let Statement::Call {
            function,
            arguments,
            ..
        } = &mut copy
        {
            let more = self.parameters.get(function).into_iter().flatten();
            arguments.extend(more.map(|g| self.arguments[g]));
        }
        self.copying.writer.statement(copy, span);
    }
}

/// In `main`, loads the variables before each call that takes them as arguments.
fn pass_arguments(main: &mut Function, parameters: &Parameters) {
    FunctionWriter::rewrite(main, &mut |writer, mut statement, span| {
        if let Statement::Call {
            function,
            arguments,
            ..
        } = &mut statement
            && let Some(variables) = parameters.get(function)
        {
            let pointers: Vec<Handle<Expression>> = variables
                .iter()
                .map(|g| pointer(&mut writer.function, *g, span))
                .collect();
            writer.begin();
            let loads = pointers.into_iter();
            arguments.extend(loads.map(|p| writer.append(Expression::Load { pointer: p }, span)));
        }
        writer.statement(statement, span);
    });
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
