//! Inserts statements at the start of an entry point.

use std::collections::BTreeMap;

use naga::{
    Binding, Block, BuiltIn, Expression, Function, FunctionArgument, Handle, Literal,
    LocalVariable, Module, SampleLevel, Span, Statement, Type, TypeInner,
};

use crate::graph::{FunctionId, operands};

/// Appends expressions and statements to a function under construction and maintains `Emit`s.
#[derive(Debug)]
pub struct Builder<'m> {
    module: &'m mut Module,
    function: Function,
    block: Block,
    /// Length of the expression arena at the start of the current `Emit`.
    emitting: Option<usize>,
}

/// The replacement of an author's expression behind a prologue.
#[derive(Clone, Copy, Debug)]
pub enum Replacement {
    /// A value of the prologue.
    Value(Handle<Expression>),
    /// The same texture sample, with gradients from the prologue.
    Gradients {
        /// Along x.
        x: Handle<Expression>,
        /// Along y.
        y: Handle<Expression>,
    },
    /// The same texture sample, with these gradients of its coordinate. A bias scales them.
    Footprint {
        /// Along x.
        x: Handle<Expression>,
        /// Along y.
        y: Handle<Expression>,
    },
}

/// Replacements by the author's expression.
pub type Replacements = BTreeMap<Handle<Expression>, Replacement>;

/// The module with the statements of `build` at the start of an entry point. The author's
/// expressions are copied into a fresh arena behind them; `build` may add arguments, types and
/// globals.
pub fn prologue(module: &Module, entry: usize, build: impl FnOnce(&mut Builder<'_>)) -> Module {
    prologue_replacing(module, entry, |builder| {
        build(builder);
        Replacements::new()
    })
}

/// [`prologue`] with replacements: the author's code uses the expressions that `build` returns.
pub fn prologue_replacing(
    module: &Module,
    entry: usize,
    build: impl FnOnce(&mut Builder<'_>) -> Replacements,
) -> Module {
    rewritten(module, FunctionId::EntryPoint(entry), |builder| Rewrite {
        replacements: build(builder),
        arguments: BTreeMap::new(),
    })
}

/// Changes to the author's code behind a prologue.
#[derive(Clone, Debug, Default)]
pub struct Rewrite {
    /// Replaced expressions.
    pub replacements: Replacements,
    /// Additional arguments for calls, by callee, after the existing ones.
    pub arguments: BTreeMap<Handle<Function>, Vec<Handle<Expression>>>,
}

/// The module with a function or entry point rewritten: the statements of `build`, then the
/// author's with the changes in [`Rewrite`].
pub fn rewritten(
    module: &Module,
    id: FunctionId,
    build: impl FnOnce(&mut Builder<'_>) -> Rewrite,
) -> Module {
    let mut module = module.clone();
    let original = std::mem::take(function_mut(&mut module, id));
    let locals = original.local_variables.len();
    let mut builder = Builder {
        module: &mut module,
        function: Function {
            name: original.name.clone(),
            arguments: original.arguments.clone(),
            result: original.result.clone(),
            local_variables: original.local_variables.clone(),
            diagnostic_filter_leaf: original.diagnostic_filter_leaf,
            ..Function::default()
        },
        block: Block::new(),
        emitting: None,
    };
    let rewrite = build(&mut builder);
    builder.flush();
    let Builder {
        mut function,
        block: mut body,
        ..
    } = builder;
    append_body(&original, locals, &rewrite, &mut function, &mut body);
    function.body = body;
    *function_mut(&mut module, id) = function;
    module
}

fn function_mut(module: &mut Module, id: FunctionId) -> &mut Function {
    match id {
        FunctionId::Function(h) => &mut module.functions[h],
        FunctionId::EntryPoint(i) => &mut module.entry_points[i].function,
    }
}

/// Copies the body of `original` behind `body`. The first `locals` variables of `function` are the
/// original's, with the same handles.
fn append_body(
    original: &Function,
    locals: usize,
    rewrite: &Rewrite,
    function: &mut Function,
    body: &mut Block,
) {
    let mut emitted = vec![false; original.expressions.len()];
    note_evaluated(&original.body, &mut emitted);
    let mut map = Map {
        copies: vec![None; original.expressions.len()],
        rewrite,
    };
    for (e, _) in original.expressions.iter() {
        if !emitted[e.index()] {
            copy(original, e, &mut map, function);
        }
    }
    copy_block(original, &original.body, &mut map, function, body);
    initialise(original, function, locals);
    for (e, name) in &original.named_expressions {
        if let Some(new) = map.copies[e.index()] {
            function.named_expressions.insert(new, name.clone());
        }
    }
}

/// Copies the initialisers of the first `locals` variables. An initialiser that a statement also
/// evaluates, as in naga's GLSL front end, must be outside of any `Emit`, so it needs a copy.
pub(crate) fn initialise(original: &Function, function: &mut Function, locals: usize) {
    let mut copies = BTreeMap::new();
    for (handle, variable) in original.local_variables.iter().take(locals) {
        let init = variable
            .init
            .map(|e| constant(original, e, &mut copies, function));
        function.local_variables[handle].init = init;
    }
}

/// Copies a constant expression and its operands.
fn constant(
    original: &Function,
    e: Handle<Expression>,
    copies: &mut BTreeMap<Handle<Expression>, Handle<Expression>>,
    function: &mut Function,
) -> Handle<Expression> {
    if let Some(copy) = copies.get(&e) {
        return *copy;
    }
    let mut expression = original.expressions[e].clone();
    for operand in operands::of_expression(&expression) {
        constant(original, operand, copies, function);
    }
    operands::map_expression(&mut expression, &mut |o| {
        if let Some(copy) = copies.get(o) {
            *o = *copy;
        }
    });
    let span = original.expressions.get_span(e);
    let copy = function.expressions.append(expression, span);
    copies.insert(e, copy);
    copy
}

fn note_evaluated(block: &Block, emitted: &mut [bool]) {
    for statement in block {
        if let Statement::Emit(range) = statement {
            for e in range.clone() {
                emitted[e.index()] = true;
            }
        }
        if let Some(e) = operands::result(statement) {
            emitted[e.index()] = true;
        }
        for inner in operands::blocks(statement) {
            note_evaluated(inner, emitted);
        }
    }
}

struct Map<'r> {
    /// The new handle of each of the author's expressions.
    copies: Vec<Option<Handle<Expression>>>,
    rewrite: &'r Rewrite,
}

fn copy(original: &Function, e: Handle<Expression>, map: &mut Map<'_>, function: &mut Function) {
    let replacement = map.rewrite.replacements.get(&e);
    if let Some(Replacement::Value(value)) = replacement {
        map.copies[e.index()] = Some(*value);
        return;
    }
    let mut expression = original.expressions[e].clone();
    operands::map_expression(&mut expression, &mut |o| {
        if let Some(new) = map.copies[o.index()] {
            *o = new;
        }
    });
    if let (Some(Replacement::Gradients { x, y }), Expression::ImageSample { level, .. }) =
        (replacement, &mut expression)
    {
        *level = SampleLevel::Gradient { x: *x, y: *y };
    }
    if let (Some(Replacement::Footprint { x, y }), Expression::ImageSample { level, .. }) =
        (replacement, &mut expression)
    {
        *level = match *level {
            SampleLevel::Bias(bias) => biased(function, bias, *x, *y),
            _ => SampleLevel::Gradient { x: *x, y: *y },
        };
    }
    let span = original.expressions.get_span(e);
    map.copies[e.index()] = Some(function.expressions.append(expression, span));
}

/// One level more is a footprint of twice the size. `bias` is evaluated at the sample.
fn biased(
    function: &mut Function,
    bias: Handle<Expression>,
    x: Handle<Expression>,
    y: Handle<Expression>,
) -> SampleLevel {
    let mut append = |e| function.expressions.append(e, Span::UNDEFINED);
    let right = append(Expression::Math {
        fun: naga::MathFunction::Exp2,
        arg: bias,
        arg1: None,
        arg2: None,
        arg3: None,
    });
    let [x, y] = [x, y].map(|left| {
        append(Expression::Binary {
            op: naga::BinaryOperator::Multiply,
            left,
            right,
        })
    });
    SampleLevel::Gradient { x, y }
}

fn copy_block(
    original: &Function,
    block: &Block,
    map: &mut Map<'_>,
    function: &mut Function,
    out: &mut Block,
) {
    for (statement, span) in block.span_iter() {
        if let Statement::Emit(range) = statement {
            let start = function.expressions.len();
            for e in range.clone() {
                copy(original, e, map, function);
            }
            if function.expressions.len() > start {
                let range = function.expressions.range_from(start);
                out.push(Statement::Emit(range), *span);
            }
            continue;
        }
        let mut shell = operands::shell(statement);
        if let Some(result) = operands::result_mut(&mut shell) {
            let old = *result;
            copy(original, old, map, function);
            match (map.rewrite.replacements.get(&old), map.copies[old.index()]) {
                // The call still returns a result, which nobody reads.
                (Some(Replacement::Value(_)), _) => {
                    let expression = original.expressions[old].clone();
                    let span = original.expressions.get_span(old);
                    *result = function.expressions.append(expression, span);
                }
                (_, Some(new)) => *result = new,
                (_, None) => {}
            }
        }
        let inner = operands::blocks(statement).into_iter().map(|b| {
            let mut copied = Block::new();
            copy_block(original, b, map, function, &mut copied);
            copied
        });
        operands::fill(&mut shell, statement, inner);
        // A loop's `break_if` may read expressions of its blocks, so map operands last.
        operands::map_statement(&mut shell, &mut |o| {
            if let Some(new) = map.copies[o.index()] {
                *o = new;
            }
        });
        if let Statement::Call {
            function: callee,
            arguments,
            ..
        } = &mut shell
        {
            let more = map.rewrite.arguments.get(callee);
            arguments.extend(more.into_iter().flatten());
        }
        out.push(shell, *span);
    }
}

impl Builder<'_> {
    /// The module, for its types, globals and functions.
    pub fn module(&mut self) -> &mut Module {
        self.module
    }

    /// The unnamed type of this shape.
    pub fn ty(&mut self, inner: TypeInner) -> Handle<Type> {
        self.module
            .types
            .insert(Type { name: None, inner }, Span::UNDEFINED)
    }

    /// Appends an expression, evaluated here if it needs evaluation.
    pub fn expression(&mut self, expression: Expression) -> Handle<Expression> {
        if expression.needs_pre_emit() {
            self.flush();
        } else if self.emitting.is_none() {
            self.emitting = Some(self.function.expressions.len());
        }
        self.function
            .expressions
            .append(expression, Span::UNDEFINED)
    }

    /// Appends a named expression, which is printed as a `let`.
    pub fn named(&mut self, name: &str, expression: Expression) -> Handle<Expression> {
        let e = self.expression(expression);
        self.name(e, name);
        e
    }

    /// Names an expression of the prologue, for example a call's result.
    pub fn name(&mut self, e: Handle<Expression>, name: &str) {
        self.function.named_expressions.insert(e, name.to_owned());
    }

    /// A literal.
    pub fn literal(&mut self, literal: Literal) -> Handle<Expression> {
        self.expression(Expression::Literal(literal))
    }

    /// Adds a local variable and returns a pointer to it.
    pub fn local(&mut self, name: &str, ty: Handle<Type>) -> Handle<Expression> {
        let variable = self.function.local_variables.append(
            LocalVariable {
                name: Some(name.to_owned()),
                ty,
                init: None,
            },
            Span::UNDEFINED,
        );
        self.expression(Expression::LocalVariable(variable))
    }

    /// The entry input with this binding: the author's argument or member, or a new argument with
    /// this name and type. Positions match with or without `@invariant`.
    pub fn input(&mut self, name: &str, ty: Handle<Type>, binding: &Binding) -> Handle<Expression> {
        let same = |b: &Option<Binding>| match (b, binding) {
            (
                Some(Binding::BuiltIn(BuiltIn::Position { .. })),
                Binding::BuiltIn(BuiltIn::Position { .. }),
            ) => true,
            (
                Some(Binding::Location { location: a, .. }),
                Binding::Location { location: b, .. },
            ) => a == b,
            (Some(a), b) => a == b,
            (None, _) => false,
        };
        let arguments = self.function.arguments.clone();
        for (i, argument) in arguments.iter().enumerate() {
            if same(&argument.binding) {
                return self.expression(Expression::FunctionArgument(i as u32));
            }
            if let (None, TypeInner::Struct { members, .. }) =
                (&argument.binding, &self.module.types[argument.ty].inner)
                && let Some(index) = members.iter().position(|m| same(&m.binding))
            {
                let base = self.expression(Expression::FunctionArgument(i as u32));
                return self.expression(Expression::AccessIndex {
                    base,
                    index: index as u32,
                });
            }
        }
        self.function.arguments.push(FunctionArgument {
            name: Some(name.to_owned()),
            ty,
            binding: Some(binding.clone()),
        });
        self.expression(Expression::FunctionArgument(arguments.len() as u32))
    }

    /// Adds an argument at the end.
    pub fn argument(
        &mut self,
        name: &str,
        ty: Handle<Type>,
        binding: Option<Binding>,
    ) -> Handle<Expression> {
        let index = self.function.arguments.len() as u32;
        self.function.arguments.push(FunctionArgument {
            name: Some(name.to_owned()),
            ty,
            binding,
        });
        self.expression(Expression::FunctionArgument(index))
    }

    /// Appends a statement. Not for `Emit`, which this type maintains, nor for calls: see
    /// [`Builder::call`].
    pub fn statement(&mut self, statement: Statement) {
        self.flush();
        self.block.push(statement, Span::UNDEFINED);
    }

    /// Calls a function; returns its result, if it has one.
    pub fn call(
        &mut self,
        function: Handle<Function>,
        arguments: Vec<Handle<Expression>>,
    ) -> Option<Handle<Expression>> {
        self.flush();
        let result = self.module.functions[function].result.is_some().then(|| {
            self.function
                .expressions
                .append(Expression::CallResult(function), Span::UNDEFINED)
        });
        self.block.push(
            Statement::Call {
                function,
                arguments,
                result,
            },
            Span::UNDEFINED,
        );
        result
    }

    /// `if condition { .. }`.
    pub fn if_then(&mut self, condition: Handle<Expression>, then: impl FnOnce(&mut Self)) {
        let accept = self.nested(then);
        self.block.push(
            Statement::If {
                condition,
                accept,
                reject: Block::new(),
            },
            Span::UNDEFINED,
        );
    }

    fn nested(&mut self, build: impl FnOnce(&mut Self)) -> Block {
        self.flush();
        let outer = std::mem::take(&mut self.block);
        build(self);
        self.flush();
        std::mem::replace(&mut self.block, outer)
    }

    fn flush(&mut self) {
        if let Some(start) = self.emitting.take()
            && self.function.expressions.len() > start
        {
            let range = self.function.expressions.range_from(start);
            self.block.push(Statement::Emit(range), Span::UNDEFINED);
        }
    }
}
