//! Converts GLSL entry points to the form of hand-written WGSL.
//!
//! GLSL's inputs, outputs and globals are private variables, and a wrapper calls `main`:
//!
//! ```wgsl
//! @fragment fn wrapper(uv: vec2f) -> Output { uv_1 = uv; main(); return Output(color); }
//! ```
//!
//! This inlines `main` into the wrapper. Private variables that only these two use become locals.
//! Reads of an input that is never written become reads of the argument. Each `return` of `main`
//! returns the outputs.

use std::collections::{HashMap, HashSet};

use crate::copy::{Copies, CopyFunction, Copying};
use crate::returns;
use crate::writer::FunctionWriter;
use naga::{
    AddressSpace, Arena, Block, Expression, Function, GlobalVariable, Handle, LocalVariable,
    Module, Span, Statement,
};
use naga_operands::calls;

/// Inlines `main` into each wrapper entry point. `module` must be valid and stays valid.
pub(super) fn inline_main(module: &mut Module) {
    // Compaction leaves only expressions that are used.
    naga::compact::compact(module, naga::compact::KeepUnused::Yes);
    for index in 0..module.entry_points.len() {
        let Some((at, main)) = wrapped(module, index) else {
            continue;
        };
        let wrapper = &module.entry_points[index].function;
        let function = inline(module, wrapper, at, &module.functions[main]);
        module.entry_points[index].function = function;
    }
    naga::compact::compact(module, naga::compact::KeepUnused::No);
}

/// The index of the wrapper's only call and its callee, if there are no other calls of that
/// function.
pub(crate) fn wrapped(module: &Module, index: usize) -> Option<(usize, Handle<Function>)> {
    let wrapper = &module.entry_points[index].function;
    let mut calls = wrapper
        .body
        .iter()
        .enumerate()
        .filter_map(|(i, s)| match s {
            Statement::Call {
                function,
                arguments,
                result: None,
            } if arguments.is_empty() => Some((i, *function)),
            _ => None,
        });
    let (at, main) = calls.next()?;
    let others = module
        .functions
        .iter()
        .map(|(_, f)| f)
        .chain(module.entry_points.iter().map(|e| &e.function))
        .flat_map(|f| calls::callees(&f.body))
        .filter(|callee| *callee == main)
        .count();
    (calls.next().is_none() && others == 1).then_some((at, main))
}

fn inline(module: &Module, wrapper: &Function, at: usize, main: &Function) -> Function {
    let mut function = Function {
        name: wrapper.name.clone(),
        arguments: wrapper.arguments.clone(),
        result: wrapper.result.clone(),
        diagnostic_filter_leaf: main.diagnostic_filter_leaf,
        ..Function::default()
    };
    let variables = promotable(module, wrapper, main);
    let inputs = read_only_inputs(wrapper, at, main, &variables);
    let mut locals = HashMap::new();
    for handle in variables.iter().filter(|h| !inputs.contains_key(h)) {
        let global = &module.global_variables[*handle];
        let init = global
            .init
            .map(|e| constant(module, &mut function.expressions, e));
        let local = LocalVariable {
            name: global.name.clone(),
            ty: global.ty,
            init,
        };
        let span = module.global_variables.get_span(*handle);
        locals.insert(*handle, function.local_variables.append(local, span));
    }
    let mut outer = Inliner {
        copying: Copying::new(wrapper, FunctionWriter::of(function)),
        inputs: &inputs,
        locals: &locals,
        main_locals: HashMap::new(),
        epilogue: None,
    };
    outer.unevaluated();
    let writer = std::mem::take(&mut outer.copying.writer);
    let mut inner = outer.for_callee(Copying::new(main, writer));
    inner.add_locals();
    outer.copying.writer = std::mem::take(&mut inner.copying.writer);
    for statement in &wrapper.body[..at] {
        let stored = match statement {
            Statement::Store { pointer, .. } => global_of(&wrapper.expressions, *pointer),
            _ => None,
        };
        // The argument replaces the variable, so skip the copy.
        if stored.is_none_or(|g| !inputs.contains_key(&g)) {
            outer.copy(statement, Span::UNDEFINED);
        }
    }
    inner.copying.writer = outer.copying.writer;
    inner.epilogue = Some((wrapper, at + 1, outer.copying.copies));
    inner.block(&main.body);
    if !ends(&main.body) {
        inner.write_epilogue();
    }
    let mut function = inner.copying.finish();
    returns::drop_last(&mut function.body);
    function
}

/// Whether the block ends in a `return` or `discard`, possibly nested in braces.
fn ends(block: &Block) -> bool {
    match block.last() {
        Some(Statement::Return { .. } | Statement::Kill) => true,
        Some(Statement::Block(inner)) => ends(inner),
        _ => false,
    }
}

/// Private variables that no other function uses.
fn promotable(module: &Module, wrapper: &Function, main: &Function) -> Vec<Handle<GlobalVariable>> {
    let named = |function: &Function| -> HashSet<Handle<GlobalVariable>> {
        let expressions = function.expressions.iter();
        expressions
            .filter_map(|(_, e)| match e {
                Expression::GlobalVariable(g) => Some(*g),
                _ => None,
            })
            .collect()
    };
    let ours: HashSet<_> = named(wrapper).union(&named(main)).copied().collect();
    let elsewhere: HashSet<_> = module
        .functions
        .iter()
        .map(|(_, f)| f)
        .filter(|f| !std::ptr::eq(*f, main))
        .chain(module.entry_points.iter().map(|e| &e.function))
        .filter(|f| !std::ptr::eq(*f, wrapper))
        .flat_map(named)
        .collect();
    module
        .global_variables
        .iter()
        .filter(|(h, g)| {
            g.space == AddressSpace::Private && ours.contains(h) && !elsewhere.contains(h)
        })
        .map(|(h, _)| h)
        .collect()
}

/// The `variables` that the wrapper sets from a whole argument and `main` only loads, with the
/// index of the argument.
fn read_only_inputs(
    wrapper: &Function,
    at: usize,
    main: &Function,
    variables: &[Handle<GlobalVariable>],
) -> HashMap<Handle<GlobalVariable>, u32> {
    let mut inputs = HashMap::new();
    for statement in &wrapper.body[..at] {
        if let Statement::Store { pointer, value } = statement
            && let Expression::GlobalVariable(global) = wrapper.expressions[*pointer]
            && let Expression::FunctionArgument(index) = wrapper.expressions[*value]
            && variables.contains(&global)
        {
            inputs.insert(global, index);
        }
    }
    // Any use except for loads and access chains might write.
    let mut written = HashSet::new();
    for (_, expression) in main.expressions.iter() {
        let reads = matches!(
            expression,
            Expression::Load { .. } | Expression::AccessIndex { .. } | Expression::Access { .. }
        );
        if !reads {
            let operands = naga_operands::of_expression(expression);
            written.extend(
                operands
                    .iter()
                    .filter_map(|e| global_of(&main.expressions, *e)),
            );
        }
        // A dynamic index needs a local to point into.
        if let Expression::Access { base, .. } = expression {
            written.extend(global_of(&main.expressions, *base));
        }
    }
    naga_operands::visit(&main.body, &mut |statement| {
        let read = naga_operands::of_statement(statement);
        written.extend(read.iter().filter_map(|e| global_of(&main.expressions, *e)));
    });
    for statement in &wrapper.body[at + 1..] {
        let mut read = naga_operands::of_statement(statement);
        if let Statement::Emit(range) = statement {
            read.extend(range.clone());
        }
        let globals = read.iter().map(|e| global_of(&wrapper.expressions, *e));
        written.extend(globals.flatten());
    }
    inputs.retain(|global, _| !written.contains(global));
    inputs
}

/// The global variable that a pointer is based on.
pub(super) fn global_of(
    expressions: &Arena<Expression>,
    mut at: Handle<Expression>,
) -> Option<Handle<GlobalVariable>> {
    loop {
        match &expressions[at] {
            Expression::Access { base, .. } | Expression::AccessIndex { base, .. } => at = *base,
            Expression::GlobalVariable(global) => return Some(*global),
            _ => return None,
        }
    }
}

/// Copies a global constant expression into a function.
fn constant(
    module: &Module,
    expressions: &mut Arena<Expression>,
    handle: Handle<Expression>,
) -> Handle<Expression> {
    let mut expression = module.global_expressions[handle].clone();
    naga_operands::map_expression(&mut expression, &mut |e| {
        *e = constant(module, expressions, *e)
    });
    expressions.append(expression, module.global_expressions.get_span(handle))
}

/// Copies the wrapper or `main` into the new entry point.
struct Inliner<'a> {
    copying: Copying<'a>,
    inputs: &'a HashMap<Handle<GlobalVariable>, u32>,
    locals: &'a HashMap<Handle<GlobalVariable>, Handle<LocalVariable>>,
    main_locals: HashMap<Handle<LocalVariable>, Handle<LocalVariable>>,
    /// In `main`, the code that replaces each `return`: the wrapper's statements from this one on,
    /// and the copies of the wrapper's expressions.
    epilogue: Option<(&'a Function, usize, Copies)>,
}

impl<'a> Inliner<'a> {
    /// Copies another function into the same entry point.
    fn for_callee(&self, copying: Copying<'a>) -> Self {
        Self {
            copying,
            inputs: self.inputs,
            locals: self.locals,
            main_locals: HashMap::new(),
            epilogue: None,
        }
    }

    /// Copies the local variables, and the expressions that need no `Emit`.
    fn add_locals(&mut self) {
        let original = self.copying.original;
        for (handle, local) in original.local_variables.iter() {
            let local = LocalVariable {
                init: None,
                ..local.clone()
            };
            let span = original.local_variables.get_span(handle);
            let locals = &mut self.copying.writer.function.local_variables;
            self.main_locals.insert(handle, locals.append(local, span));
        }
        self.unevaluated();
        // An `Emit` may also evaluate a constant initialiser, so it gets a copy before everything
        // else.
        let mut copies = self.copying.copies.clone();
        let function = &mut self.copying.writer.function;
        for (handle, local) in original.local_variables.iter() {
            let init = local.init;
            let init = init.map(|e| copies.constant(original, e, function));
            function.local_variables[self.main_locals[&handle]].init = init;
        }
    }

    fn write_epilogue(&mut self) {
        let Some((wrapper, from, copies)) = &self.epilogue else {
            return;
        };
        let writer = std::mem::take(&mut self.copying.writer);
        let mut epilogue = self.for_callee(Copying {
            original: wrapper,
            copies: copies.clone(),
            writer,
        });
        for statement in &wrapper.body[*from..] {
            epilogue.copy(statement, Span::UNDEFINED);
        }
        if !ends(&wrapper.body) {
            let end = Statement::Return { value: None };
            epilogue.copying.writer.statement(end, Span::UNDEFINED);
        }
        self.copying.writer = epilogue.copying.writer;
    }
}

impl<'a> CopyFunction<'a> for Inliner<'a> {
    fn copying(&mut self) -> &mut Copying<'a> {
        &mut self.copying
    }

    fn expression(&mut self, e: Handle<Expression>) {
        let Copying {
            original, copies, ..
        } = &mut self.copying;
        // The argument's value replaces the pointer.
        if let Expression::Load { pointer } = original.expressions[e]
            && let Some(global) = global_of(&original.expressions, pointer)
            && self.inputs.contains_key(&global)
            && let Some(value) = copies.get(pointer)
        {
            copies.insert(e, value);
            return;
        }
        let mut copy = copies.with_operands(&original.expressions[e]);
        match &mut copy {
            Expression::GlobalVariable(global) => {
                if let Some(argument) = self.inputs.get(global) {
                    copy = Expression::FunctionArgument(*argument);
                } else if let Some(local) = self.locals.get(global) {
                    copy = Expression::LocalVariable(*local);
                }
            }
            Expression::LocalVariable(local) => {
                if let Some(new) = self.main_locals.get(local) {
                    *local = *new;
                }
            }
            _ => {}
        }
        self.copying.append(e, copy);
    }

    fn statement(&mut self, statement: &'a Statement, span: Span) {
        match statement {
            // A block does not scope variables in the IR.
            Statement::Block(inner) => self.block(inner),
            Statement::Return { .. } if self.epilogue.is_some() => self.write_epilogue(),
            _ => {
                let copy = self.copied(statement, span);
                self.copying.writer.statement(copy, span);
            }
        }
    }
}
