//! Statements put at the ends of an entry point: ahead of everything it does, and at its returns.
//!
//! The entry point's own expressions and statements keep their handles and their order: what is added is appended to the arena and runs first.

use naga::{Arena, Binding, Block, BuiltIn, Expression, Function, FunctionArgument, Handle, Module, Range, Scalar, Span, Statement, Type, TypeInner, VectorSize};

/// Where an entry point receives an input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Input {
    /// An argument of its own.
    Argument(u32),
    /// A member of a struct argument.
    Member {
        /// Index of the argument.
        argument: u32,
        /// Index of the member.
        member: u32,
    },
}

/// An argument to pass on to a function.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Argument {
    /// An input of the entry point.
    Input(Input),
    /// A struct made of inputs.
    Struct {
        /// Its type.
        ty: Handle<Type>,
        /// One input a member.
        members: Vec<Input>,
    },
}

/// The inputs of a function with their bindings, in order.
pub fn inputs(module: &Module, function: &Function) -> Vec<(Input, Binding)> {
    let mut found = Vec::new();
    for (argument, a) in (0u32..).zip(&function.arguments) {
        match (&a.binding, &module.types[a.ty].inner) {
            (Some(binding), _) => found.push((Input::Argument(argument), binding.clone())),
            (None, TypeInner::Struct { members, .. }) => found.extend(
                (0u32..)
                    .zip(members)
                    .filter_map(|(member, m)| Some((Input::Member { argument, member }, m.binding.clone()?))),
            ),
            (None, _) => {}
        }
    }
    found
}

/// Whether two bindings are the same input, however they are interpolated.
pub fn same_input(a: &Binding, b: &Binding) -> bool {
    match (a, b) {
        (Binding::Location { location: a, .. }, Binding::Location { location: b, .. }) => a == b,
        (Binding::BuiltIn(BuiltIn::Position { .. }), Binding::BuiltIn(BuiltIn::Position { .. })) => true,
        (Binding::BuiltIn(a), Binding::BuiltIn(b)) => a == b,
        _ => false,
    }
}

/// The framebuffer position of a fragment entry point; an argument is added where the author asked for none.
pub fn fragment_position(module: &mut Module, entry: usize) -> Input {
    let wanted = Binding::BuiltIn(BuiltIn::Position { invariant: false });
    let function = &module.entry_points[entry].function;
    if let Some((input, _)) = inputs(module, function).into_iter().find(|(_, b)| same_input(b, &wanted)) {
        return input;
    }
    let ty = module.types.insert(
        Type { name: None, inner: TypeInner::Vector { size: VectorSize::Quad, scalar: Scalar::F32 } },
        Span::UNDEFINED,
    );
    let arguments = &mut module.entry_points[entry].function.arguments;
    arguments.push(FunctionArgument { name: Some("position".to_owned()), ty, binding: Some(wanted) });
    Input::Argument(arguments.len() as u32 - 1)
}

/// Appends expressions to a function and emits each at the end of a block.
pub struct Emitter<'e> {
    expressions: &'e mut Arena<Expression>,
    block: Block,
}

impl<'e> Emitter<'e> {
    /// Emits into an empty block.
    pub fn new(expressions: &'e mut Arena<Expression>) -> Self {
        Self { expressions, block: Block::new() }
    }

    /// An expression that is evaluated here.
    pub fn emit(&mut self, expression: Expression) -> Handle<Expression> {
        let handle = self.expressions.append(expression, Span::UNDEFINED);
        self.block.push(Statement::Emit(Range::new_from_bounds(handle, handle)), Span::UNDEFINED);
        handle
    }

    /// An expression that naga evaluates before the function runs: a literal, a constant, an argument.
    pub fn constant(&mut self, expression: Expression) -> Handle<Expression> {
        self.expressions.append(expression, Span::UNDEFINED)
    }
}

/// Rewrites what a function returns, at each of its returns. `f` gets the value returned (`None` for a bare return) and gives the new one; a body that runs
/// off its end is given a return first.
pub fn rewrite_returns(
    function: &mut Function,
    f: &mut dyn FnMut(&mut Emitter, Option<Handle<Expression>>) -> Option<Handle<Expression>>,
) {
    if !function.body.last().is_some_and(ends) {
        function.body.push(Statement::Return { value: None }, Span::UNDEFINED);
    }
    let body = std::mem::take(&mut function.body);
    function.body = returns_in(&mut function.expressions, body, f);
}

/// Whether nothing can follow a statement.
fn ends(statement: &Statement) -> bool {
    match statement {
        Statement::Return { .. } => true,
        Statement::Block(b) => b.last().is_some_and(ends),
        Statement::If { accept, reject, .. } => accept.last().is_some_and(ends) && reject.last().is_some_and(ends),
        _ => false,
    }
}

fn returns_in(
    expressions: &mut Arena<Expression>,
    block: Block,
    f: &mut dyn FnMut(&mut Emitter, Option<Handle<Expression>>) -> Option<Handle<Expression>>,
) -> Block {
    let mut rebuilt = Block::with_capacity(block.len());
    for (mut statement, span) in block.span_into_iter() {
        match &mut statement {
            Statement::Return { value } => {
                let mut emitter = Emitter::new(expressions);
                *value = f(&mut emitter, *value);
                rebuilt.extend_block(emitter.block);
            }
            Statement::Block(b) => *b = returns_in(expressions, std::mem::take(b), f),
            Statement::If { accept, reject, .. } => {
                *accept = returns_in(expressions, std::mem::take(accept), f);
                *reject = returns_in(expressions, std::mem::take(reject), f);
            }
            Statement::Switch { cases, .. } => {
                for case in cases {
                    case.body = returns_in(expressions, std::mem::take(&mut case.body), f);
                }
            }
            Statement::Loop { body, continuing, .. } => {
                *body = returns_in(expressions, std::mem::take(body), f);
                *continuing = returns_in(expressions, std::mem::take(continuing), f);
            }
            _ => {}
        }
        rebuilt.push(statement, span);
    }
    rebuilt
}

/// Builds the statements.
pub struct Head<'f> {
    function: &'f mut Function,
    block: Block,
}

impl<'f> Head<'f> {
    /// Nothing yet.
    pub fn new(function: &'f mut Function) -> Self {
        Self { function, block: Block::new() }
    }

    fn emitted(&mut self, expression: Expression) -> Handle<Expression> {
        let mut emitter = Emitter::new(&mut self.function.expressions);
        let handle = emitter.emit(expression);
        self.block.extend_block(emitter.block);
        handle
    }

    /// The value of an input.
    pub fn input(&mut self, input: Input) -> Handle<Expression> {
        let argument = |head: &mut Self, i: u32| {
            let found = head.function.expressions.iter().find(|(_, e)| **e == Expression::FunctionArgument(i)).map(|(h, _)| h);
            found.unwrap_or_else(|| head.function.expressions.append(Expression::FunctionArgument(i), Span::UNDEFINED))
        };
        match input {
            Input::Argument(i) => argument(self, i),
            Input::Member { argument: i, member } => {
                let base = argument(self, i);
                self.emitted(Expression::AccessIndex { base, index: member })
            }
        }
    }

    /// The value of an argument to pass on.
    pub fn argument(&mut self, argument: &Argument) -> Handle<Expression> {
        match argument {
            Argument::Input(input) => self.input(*input),
            Argument::Struct { ty, members } => {
                let components = members.iter().map(|m| self.input(*m)).collect();
                self.emitted(Expression::Compose { ty: *ty, components })
            }
        }
    }

    /// `base.index`.
    pub fn access(&mut self, base: Handle<Expression>, index: u32) -> Handle<Expression> {
        self.emitted(Expression::AccessIndex { base, index })
    }

    /// The result of a call.
    pub fn call(&mut self, function: Handle<Function>, arguments: Vec<Handle<Expression>>) -> Handle<Expression> {
        let result = self.function.expressions.append(Expression::CallResult(function), Span::UNDEFINED);
        self.block.push(Statement::Call { function, arguments, result: Some(result) }, Span::UNDEFINED);
        result
    }

    /// Gives a value a name in the emitted text.
    pub fn name(&mut self, value: Handle<Expression>, name: &str) {
        self.function.named_expressions.insert(value, name.to_owned());
    }

    /// `if (condition) { discard; }`
    pub fn discard_if(&mut self, condition: Handle<Expression>) {
        let mut accept = Block::new();
        accept.push(Statement::Kill, Span::UNDEFINED);
        self.block.push(Statement::If { condition, accept, reject: Block::new() }, Span::UNDEFINED);
    }

    /// Puts the statements ahead of the function's own.
    pub fn finish(self) {
        let Self { function, mut block } = self;
        block.extend_block(std::mem::take(&mut function.body));
        function.body = block;
    }
}
