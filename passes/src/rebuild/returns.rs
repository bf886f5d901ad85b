//! Rewrites the result of a function at each of its returns.

use naga::{Arena, Block, Expression, Function, Handle, Range, Span, Statement};

/// Appends expressions to a function and emits each at the end of a block.
pub struct Emitter<'e> {
    expressions: &'e mut Arena<Expression>,
    block: Block,
}

impl<'e> Emitter<'e> {
    /// Starts with an empty block.
    pub fn new(expressions: &'e mut Arena<Expression>) -> Self {
        Self {
            expressions,
            block: Block::new(),
        }
    }

    /// Appends an expression that is evaluated here.
    pub fn emit(&mut self, expression: Expression) -> Handle<Expression> {
        let handle = self.expressions.append(expression, Span::UNDEFINED);
        self.block.push(
            Statement::Emit(Range::new_from_bounds(handle, handle)),
            Span::UNDEFINED,
        );
        handle
    }

    /// Calls a function and returns its result.
    pub fn call(
        &mut self,
        function: Handle<Function>,
        arguments: Vec<Handle<Expression>>,
    ) -> Handle<Expression> {
        let result = self
            .expressions
            .append(Expression::CallResult(function), Span::UNDEFINED);
        self.block.push(
            Statement::Call {
                function,
                arguments,
                result: Some(result),
            },
            Span::UNDEFINED,
        );
        result
    }

    /// Appends an expression that naga evaluates before the function runs: a literal, a constant,
    /// an argument.
    pub fn constant(&mut self, expression: Expression) -> Handle<Expression> {
        self.expressions.append(expression, Span::UNDEFINED)
    }
}

/// Maps the value of a return (`None` for a bare one) to the new value.
pub type Rewrite<'a> =
    dyn FnMut(&mut Emitter, Option<Handle<Expression>>) -> Option<Handle<Expression>> + 'a;

/// Rewrites the result of a function at each return. A body without a final return gets one first.
pub fn rewrite(function: &mut Function, f: &mut Rewrite<'_>) {
    if !function.body.last().is_some_and(ends) {
        function
            .body
            .push(Statement::Return { value: None }, Span::UNDEFINED);
    }
    let body = std::mem::take(&mut function.body);
    function.body = returns_in(&mut function.expressions, body, f);
}

/// Whether nothing can follow a statement.
fn ends(statement: &Statement) -> bool {
    match statement {
        Statement::Return { .. } => true,
        Statement::Block(b) => b.last().is_some_and(ends),
        Statement::If { accept, reject, .. } => {
            accept.last().is_some_and(ends) && reject.last().is_some_and(ends)
        }
        _ => false,
    }
}

fn returns_in(expressions: &mut Arena<Expression>, block: Block, f: &mut Rewrite<'_>) -> Block {
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
            Statement::Loop {
                body, continuing, ..
            } => {
                *body = returns_in(expressions, std::mem::take(body), f);
                *continuing = returns_in(expressions, std::mem::take(continuing), f);
            }
            _ => {}
        }
        rebuilt.push(statement, span);
    }
    rebuilt
}
