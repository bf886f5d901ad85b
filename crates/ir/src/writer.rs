//! Writes a function: expressions and statements in order, with the `Emit`s between them. No other
//! code creates an `Emit`.

use naga::proc::{
    ConstantEvaluator, ConstantEvaluatorError, Emitter, ExpressionKindTracker, Layouter,
};
use naga::{Arena, Block, Expression, Function, Handle, Module, Range, Span, Statement};

/// Appends `Emit`s for existing expressions: one for each run of consecutive handles.
pub fn emit_existing(
    evaluated: impl IntoIterator<Item = Handle<Expression>>,
    out: &mut Block,
    span: Span,
) {
    let mut evaluated = evaluated.into_iter().peekable();
    while let Some(first) = evaluated.next() {
        let mut last = first;
        while let Some(next) = evaluated.next_if(|next| next.index() == last.index() + 1) {
            last = next;
        }
        let run = Range::new_from_bounds(first, last);
        out.push(Statement::Emit(run), span);
    }
}

/// The open `Emit`, if there is one.
#[derive(Debug, Default)]
pub struct OpenEmit(Emitter);

impl OpenEmit {
    /// Opens an `Emit` for the following expressions, unless one is open.
    pub fn begin(&mut self, expressions: &Arena<Expression>) {
        if !self.0.is_running() {
            self.0.start(expressions);
        }
    }

    /// Ends the open `Emit` with this span. Does not write an empty one.
    pub fn end(&mut self, expressions: &Arena<Expression>, out: &mut Block, span: Span) {
        if self.0.is_running()
            && let Some((emit, _)) = self.0.finish(expressions)
        {
            out.push(emit, span);
        }
    }
}

/// A function under construction, and its current block.
#[derive(Debug, Default)]
pub struct FunctionWriter {
    /// The function. Its body is empty until [`FunctionWriter::finish`].
    pub function: Function,
    block: Block,
    emit: OpenEmit,
}

impl FunctionWriter {
    /// A function without a body whose name, signature and variables are those of `original`. The
    /// initialisers of the variables are still expressions of `original`.
    pub fn like(original: &Function) -> Self {
        Self::of(Function {
            name: original.name.clone(),
            arguments: original.arguments.clone(),
            result: original.result.clone(),
            local_variables: original.local_variables.clone(),
            diagnostic_filter_leaf: original.diagnostic_filter_leaf,
            ..Function::default()
        })
    }

    /// Starts to write the body of a function that has none.
    pub fn of(function: Function) -> Self {
        Self {
            function,
            ..Self::default()
        }
    }

    /// Rewrites the body of `function`. `change` receives each statement, whose blocks have already
    /// been rewritten, and writes its replacement.
    pub fn rewrite(function: &mut Function, change: &mut dyn FnMut(&mut Self, Statement, Span)) {
        let body = std::mem::take(&mut function.body);
        let mut writer = Self::of(std::mem::take(function));
        writer.rewrite_block(body, change);
        *function = writer.finish();
    }

    /// Writes statements before the body of `function`. Handles of its expressions stay valid.
    pub fn start<T>(function: &mut Function, write: impl FnOnce(&mut Self) -> T) -> T {
        let mut body = std::mem::take(&mut function.body);
        let mut writer = Self::of(std::mem::take(function));
        let written = write(&mut writer);
        writer.flush(Span::UNDEFINED);
        writer.block.append(&mut body);
        *function = writer.finish();
        written
    }

    fn rewrite_block(&mut self, block: Block, change: &mut dyn FnMut(&mut Self, Statement, Span)) {
        for (mut statement, span) in block.span_into_iter() {
            for inner in naga_operands::blocks_mut(&mut statement) {
                let enclosing = self.open(span);
                self.rewrite_block(std::mem::take(inner), change);
                *inner = self.close(enclosing, span);
            }
            change(self, statement, span);
        }
    }

    /// Appends an expression without a span, evaluated here if it needs evaluation.
    pub fn expression(&mut self, expression: Expression) -> Handle<Expression> {
        if expression.needs_pre_emit() {
            self.flush(Span::UNDEFINED);
        } else {
            self.begin();
        }
        self.append(expression, Span::UNDEFINED)
    }

    /// Appends an expression, which the open `Emit` evaluates if there is one.
    pub fn append(&mut self, expression: Expression, span: Span) -> Handle<Expression> {
        self.function.expressions.append(expression, span)
    }

    /// Appends an expression that is evaluated here. If it is a constant expression in GLSL,
    /// appends its value instead. `known` holds the kinds of all expressions of the function.
    ///
    /// # Errors
    ///
    /// The expression is constant but has no value.
    pub fn fold(
        &mut self,
        expression: Expression,
        span: Span,
        module: &mut Module,
        known: &mut ExpressionKindTracker,
        layouter: &mut Layouter,
    ) -> Result<Handle<Expression>, ConstantEvaluatorError> {
        self.begin();
        ConstantEvaluator::for_glsl_function(
            module,
            &mut self.function.expressions,
            known,
            layouter,
            &mut self.emit.0,
            &mut self.block,
        )
        .try_eval_and_append(expression, span)
    }

    /// Opens an `Emit` for the following expressions, unless one is open.
    pub fn begin(&mut self) {
        self.emit.begin(&self.function.expressions);
    }

    /// Ends the open `Emit`, with this span.
    pub fn flush(&mut self, span: Span) {
        self.emit
            .end(&self.function.expressions, &mut self.block, span);
    }

    /// Ends the open `Emit`, and appends `Emit`s for existing expressions.
    pub fn emit_existing(
        &mut self,
        evaluated: impl IntoIterator<Item = Handle<Expression>>,
        span: Span,
    ) {
        self.flush(span);
        emit_existing(evaluated, &mut self.block, span);
    }

    /// Ends the open `Emit` and appends a statement.
    pub fn statement(&mut self, statement: Statement, span: Span) {
        self.flush(span);
        self.block.push(statement, span);
    }

    /// Calls a function with a result, and returns the result.
    pub fn call(
        &mut self,
        function: Handle<Function>,
        arguments: Vec<Handle<Expression>>,
    ) -> Handle<Expression> {
        self.flush(Span::UNDEFINED);
        let result = self.append(Expression::CallResult(function), Span::UNDEFINED);
        let call = Statement::Call {
            function,
            arguments,
            result: Some(result),
        };
        self.statement(call, Span::UNDEFINED);
        result
    }

    /// Starts an inner block. Pass the enclosing one, which it returns, to
    /// [`FunctionWriter::close`].
    #[must_use]
    pub fn open(&mut self, span: Span) -> Block {
        self.flush(span);
        std::mem::take(&mut self.block)
    }

    /// Continues an inner block. Pass the enclosing one, which it returns, to
    /// [`FunctionWriter::close`].
    #[must_use]
    pub fn reopen(&mut self, inner: Block, span: Span) -> Block {
        self.flush(span);
        std::mem::replace(&mut self.block, inner)
    }

    /// Ends an inner block, which it returns, and continues the enclosing one.
    #[must_use]
    pub fn close(&mut self, enclosing: Block, span: Span) -> Block {
        self.flush(span);
        std::mem::replace(&mut self.block, enclosing)
    }

    /// The function with the written block as its body.
    pub fn finish(mut self) -> Function {
        self.flush(Span::UNDEFINED);
        self.function.body = self.block;
        self.function
    }
}
