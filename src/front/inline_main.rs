//! Converts GLSL entry points to the form of hand-written WGSL.
//!
//! naga's GLSL front end stores inputs, outputs and globals in private variables and wraps `main`:
//!
//! ```wgsl
//! @fragment fn wrapper(uv: vec2f) -> Output { uv_1 = uv; main(); return Output(color); }
//! ```
//!
//! This inlines `main` into the wrapper. Private variables that only these two use become locals.
//! Reads of an input that is never written become reads of the argument. Each `return` of `main`
//! returns the outputs.

use std::collections::{HashMap, HashSet};

use naga::{
    AddressSpace, Arena, Block, Expression, Function, GlobalVariable, Handle, LocalVariable,
    Module, Statement,
};

use crate::wgsl::operands;

type Copies = HashMap<Handle<Expression>, Handle<Expression>>;

/// Inlines `main` into each wrapper entry point. `module` must be valid and stays valid.
pub(super) fn inline_main(module: &mut Module) {
    // naga's front end gives every function an expression for every global. Compaction leaves those
    // in use.
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

/// The index of the wrapper's only call and its callee, if nothing else calls that function.
pub(super) fn wrapped(module: &Module, index: usize) -> Option<(usize, Handle<Function>)> {
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
        .map(|f| count_calls(&mut f.body.clone(), main))
        .sum::<usize>();
    (calls.next().is_none() && others == 1).then_some((at, main))
}

fn count_calls(block: &mut Block, callee: Handle<Function>) -> usize {
    let mut count = 0;
    for statement in block.iter_mut() {
        if matches!(statement, Statement::Call { function, .. } if *function == callee) {
            count += 1;
        }
        for inner in operands::blocks(statement) {
            count += count_calls(inner, callee);
        }
    }
    count
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
    let mut body = Inliner {
        function: &mut function,
        inputs: &inputs,
        locals: &locals,
        main_locals: HashMap::new(),
    };
    let mut from_wrapper = body.unevaluated(wrapper);
    let mut from_main = body.locals_of(main);
    let (prologue, epilogue) = (&wrapper.body[..at], &wrapper.body[at + 1..]);
    let mut out = Block::new();
    for statement in prologue {
        let stored = match statement {
            Statement::Store { pointer, .. } => global_of(&wrapper.expressions, *pointer),
            _ => None,
        };
        // The argument replaces the variable, so skip the copy.
        if stored.is_none_or(|g| !inputs.contains_key(&g)) {
            let one = Block::from_vec(vec![statement.clone()]);
            out.extend_block(body.copy(wrapper, &one, &mut from_wrapper, None));
        }
    }
    let returns = Returns {
        wrapper,
        epilogue,
        copies: &from_wrapper,
    };
    out.extend_block(body.copy(main, &main.body, &mut from_main, Some(&returns)));
    if !ends(&main.body) {
        out.extend_block(body.epilogue(&returns));
    }
    for (handle, name) in &main.named_expressions {
        if let Some(new) = from_main.get(handle) {
            function.named_expressions.insert(*new, name.clone());
        }
    }
    function.body = out;
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

/// Those of `variables` that the wrapper sets from a whole argument and `main` only loads, with the
/// argument's index.
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
        operands::of_expression(&mut expression.clone(), |e| {
            if !reads {
                written.extend(global_of(&main.expressions, *e));
            }
        });
        // A dynamic index needs a local to point into.
        if let Expression::Access { base, .. } = expression {
            written.extend(global_of(&main.expressions, *base));
        }
    }
    for_each_statement(&mut main.body.clone(), &mut |statement| {
        operands::of_statement(statement, |e| {
            written.extend(global_of(&main.expressions, *e));
        });
    });
    for statement in &wrapper.body[at + 1..] {
        let mut statement = statement.clone();
        operands::of_statement(&mut statement, |e| {
            written.extend(global_of(&wrapper.expressions, *e));
        });
        if let Statement::Emit(range) = statement {
            written.extend(range.filter_map(|e| global_of(&wrapper.expressions, e)));
        }
    }
    inputs.retain(|global, _| !written.contains(global));
    inputs
}

pub(super) fn for_each_statement(block: &mut Block, f: &mut impl FnMut(&mut Statement)) {
    for statement in block.iter_mut() {
        f(statement);
        for inner in operands::blocks(statement) {
            for_each_statement(inner, f);
        }
    }
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
    operands::of_expression(&mut expression, |e| *e = constant(module, expressions, *e));
    expressions.append(expression, module.global_expressions.get_span(handle))
}

/// What each `return` of `main` becomes.
struct Returns<'a> {
    wrapper: &'a Function,
    epilogue: &'a [Statement],
    copies: &'a Copies,
}

struct Inliner<'a> {
    function: &'a mut Function,
    inputs: &'a HashMap<Handle<GlobalVariable>, u32>,
    locals: &'a HashMap<Handle<GlobalVariable>, Handle<LocalVariable>>,
    main_locals: HashMap<Handle<LocalVariable>, Handle<LocalVariable>>,
}

impl Inliner<'_> {
    /// Copies the local variables of `main` and the expressions that need no `Emit`.
    fn locals_of(&mut self, main: &Function) -> Copies {
        for (handle, local) in main.local_variables.iter() {
            let local = LocalVariable {
                init: None,
                ..local.clone()
            };
            let span = main.local_variables.get_span(handle);
            let new = self.function.local_variables.append(local, span);
            self.main_locals.insert(handle, new);
        }
        let copies = self.unevaluated(main);
        // A constant initialiser may also be in an `Emit`, so it gets a copy before everything
        // else.
        let mut initial = copies.clone();
        for (handle, local) in main.local_variables.iter() {
            let init = local.init.and_then(|e| {
                self.initialiser(main, e, &mut initial);
                initial.get(&e).copied()
            });
            if let Some(new) = self.main_locals.get(&handle) {
                self.function.local_variables[*new].init = init;
            }
        }
        copies
    }

    /// Copies expressions that need no `Emit`: literals, variables, arguments, constants.
    fn unevaluated(&mut self, from: &Function) -> Copies {
        let mut evaluated = HashSet::new();
        for_each_statement(&mut from.body.clone(), &mut |statement| {
            if let Statement::Emit(range) = statement {
                evaluated.extend(range.clone());
            }
            evaluated.extend(super::fall_through::result(statement));
        });
        let mut copies = Copies::new();
        for (handle, _) in from.expressions.iter() {
            if !evaluated.contains(&handle) {
                self.expression(from, handle, &mut copies);
            }
        }
        copies
    }

    /// Copies an expression with its operands.
    fn initialiser(&mut self, from: &Function, handle: Handle<Expression>, copies: &mut Copies) {
        if copies.contains_key(&handle) {
            return;
        }
        let mut made_of = Vec::new();
        operands::of_expression(&mut from.expressions[handle].clone(), |e| made_of.push(*e));
        for each in made_of {
            self.initialiser(from, each, copies);
        }
        self.expression(from, handle, copies);
    }

    fn expression(&mut self, from: &Function, handle: Handle<Expression>, copies: &mut Copies) {
        let mut expression = from.expressions[handle].clone();
        // The argument's value replaces the pointer.
        if let Expression::Load { pointer } = expression
            && let Some(global) = global_of(&from.expressions, pointer)
            && self.inputs.contains_key(&global)
            && let Some(value) = copies.get(&pointer).copied()
        {
            copies.insert(handle, value);
            return;
        }
        match &mut expression {
            Expression::GlobalVariable(global) => {
                if let Some(argument) = self.inputs.get(global) {
                    expression = Expression::FunctionArgument(*argument);
                } else if let Some(local) = self.locals.get(global) {
                    expression = Expression::LocalVariable(*local);
                }
            }
            Expression::LocalVariable(local) => {
                if let Some(new) = self.main_locals.get(local) {
                    *local = *new;
                }
            }
            other => operands::of_expression(other, |e| *e = copies.get(e).copied().unwrap_or(*e)),
        }
        let span = from.expressions.get_span(handle);
        let new = self.function.expressions.append(expression, span);
        copies.insert(handle, new);
    }

    fn copy(
        &mut self,
        from: &Function,
        block: &Block,
        copies: &mut Copies,
        returns: Option<&Returns<'_>>,
    ) -> Block {
        let mut out = Block::with_capacity(block.len());
        for (statement, span) in block.span_iter() {
            match statement {
                Statement::Emit(range) => {
                    let start = self.function.expressions.len();
                    for handle in range.clone() {
                        self.expression(from, handle, copies);
                    }
                    let range = self.function.expressions.range_from(start);
                    if !range.index_range().is_empty() {
                        out.push(Statement::Emit(range), *span);
                    }
                }
                // A block does not scope variables in the IR.
                Statement::Block(inner) => {
                    out.extend_block(self.copy(from, inner, copies, returns));
                }
                Statement::Return { .. } if returns.is_some() => {
                    if let Some(returns) = returns {
                        out.extend_block(self.epilogue(returns));
                    }
                }
                other => {
                    let mut statement = other.clone();
                    if let Some(result) = super::fall_through::result(other) {
                        self.expression(from, result, copies);
                    }
                    let mut blocks: Vec<Block> = operands::blocks(&mut statement)
                        .into_iter()
                        .map(std::mem::take)
                        .collect();
                    for inner in &mut blocks {
                        *inner = self.copy(from, inner, copies, returns);
                    }
                    for (slot, inner) in operands::blocks(&mut statement).into_iter().zip(blocks) {
                        *slot = inner;
                    }
                    // Remap after the blocks: `break_if` may name a value of the continuing block.
                    operands::of_statement(&mut statement, |e| {
                        *e = copies.get(e).copied().unwrap_or(*e);
                    });
                    out.push(statement, *span);
                }
            }
        }
        out
    }

    fn epilogue(&mut self, returns: &Returns<'_>) -> Block {
        let block = Block::from_vec(returns.epilogue.to_vec());
        let mut copies = returns.copies.clone();
        self.copy(returns.wrapper, &block, &mut copies, None)
    }
}
