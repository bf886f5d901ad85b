//! Rewrites the result of a function at each of its returns.

use naga::{Expression, Function, Handle, Span, Statement};

use super::writer::FunctionWriter;

/// Maps the value of a return (`None` for a bare one) to the new value.
pub(crate) type Rewrite<'a> =
    dyn FnMut(&mut FunctionWriter, Option<Handle<Expression>>) -> Option<Handle<Expression>> + 'a;

/// Rewrites the result of a function at each return. A body without a final return gets one first.
pub fn rewrite(function: &mut Function, f: &mut Rewrite<'_>) {
    if !function.body.last().is_some_and(ends) {
        function
            .body
            .push(Statement::Return { value: None }, Span::UNDEFINED);
    }
    FunctionWriter::rewrite(function, &mut |writer, mut statement, span| {
        if let Statement::Return { value } = &mut statement {
            *value = f(writer, *value);
        }
        writer.statement(statement, span);
    });
}

/// Drops returns without a value at the end of a block, where they have no effect.
pub fn drop_last(body: &mut naga::Block) {
    while matches!(body.last(), Some(Statement::Return { value: None })) {
        body.cull(body.len() - 1..);
    }
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
