//! Writes the statements at the start of a function: a prologue, or all of a function of our own.

use naga::{
    Binding, Block, BuiltIn, Expression, Function, FunctionArgument, Handle, Literal,
    LocalVariable, Module, Span, Statement, Type, TypeInner,
};

use naga_edit::writer::FunctionWriter;

/// Appends expressions and statements to a function of a module.
#[derive(Debug)]
pub struct CodeBuilder<'m> {
    module: &'m mut Module,
    writer: FunctionWriter,
}

impl<'m> CodeBuilder<'m> {
    pub(super) fn new(module: &'m mut Module, writer: FunctionWriter) -> Self {
        Self { module, writer }
    }

    /// The writer, between two statements.
    pub(super) fn finish(mut self) -> FunctionWriter {
        self.writer.flush(Span::UNDEFINED);
        self.writer
    }

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
        self.writer.expression(expression)
    }

    /// Appends a named expression, which is printed as a `let`.
    pub fn named(&mut self, name: &str, expression: Expression) -> Handle<Expression> {
        let e = self.expression(expression);
        self.name(e, name);
        e
    }

    /// Names an expression of the prologue, for example a call's result.
    pub fn name(&mut self, e: Handle<Expression>, name: &str) {
        self.writer
            .function
            .named_expressions
            .insert(e, name.to_owned());
    }

    pub fn literal(&mut self, literal: Literal) -> Handle<Expression> {
        self.expression(Expression::Literal(literal))
    }

    /// Adds a local variable and returns a pointer to it.
    pub fn local(&mut self, name: &str, ty: Handle<Type>) -> Handle<Expression> {
        let variable = self.writer.function.local_variables.append(
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
        let arguments = self.writer.function.arguments.clone();
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
        self.writer.function.arguments.push(FunctionArgument {
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
        let index = self.writer.function.arguments.len() as u32;
        self.writer.function.arguments.push(FunctionArgument {
            name: Some(name.to_owned()),
            ty,
            binding,
        });
        self.expression(Expression::FunctionArgument(index))
    }

    /// Appends a statement. Not for `Emit`, which this type maintains, nor for calls: see
    /// [`CodeBuilder::call`].
    pub fn statement(&mut self, statement: Statement) {
        self.writer.statement(statement, Span::UNDEFINED);
    }

    /// Calls a function with new inputs of its arguments' names, types and bindings.
    pub fn call_with_inputs(
        &mut self,
        function: Handle<Function>,
        arguments: &[FunctionArgument],
    ) -> Option<Handle<Expression>> {
        let inputs = arguments.iter().map(|a| {
            let name = a.name.as_deref().unwrap_or("input");
            self.argument(name, a.ty, a.binding.clone())
        });
        let inputs = inputs.collect();
        self.call(function, inputs)
    }

    /// Calls a function; returns its result, if it has one.
    pub fn call(
        &mut self,
        function: Handle<Function>,
        arguments: Vec<Handle<Expression>>,
    ) -> Option<Handle<Expression>> {
        if self.module.functions[function].result.is_some() {
            return Some(self.writer.call(function, arguments));
        }
        self.statement(Statement::Call {
            function,
            arguments,
            result: None,
        });
        None
    }

    pub fn if_then(&mut self, condition: Handle<Expression>, then: impl FnOnce(&mut Self)) {
        let enclosing = self.writer.open(Span::UNDEFINED);
        then(self);
        let accept = self.writer.close(enclosing, Span::UNDEFINED);
        self.statement(Statement::If {
            condition,
            accept,
            reject: Block::new(),
        });
    }
}
