//! Writes code of our own behind the author's evaluation of a value.

use naga::{Expression, Function, Handle, Statement};
use naga_edit::writer::FunctionWriter;

/// Calls `then` behind each statement, for each expression that the statement evaluates.
pub(crate) fn after(
    function: &mut Function,
    then: &mut dyn FnMut(&mut FunctionWriter, Handle<Expression>),
) {
    FunctionWriter::rewrite(function, &mut |writer, statement, span| {
        let evaluated: Vec<Handle<Expression>> = match &statement {
            Statement::Emit(range) => range.clone().collect(),
            other => naga_operands::result(other).into_iter().collect(),
        };
        writer.statement(statement, span);
        for value in evaluated {
            then(writer, value);
        }
    });
}
