//! Visits the operands of expressions and statements, results included, using the table of
//! `preshade-passes`.

use naga::{Expression, Handle, Statement};
use naga_operands as operands;

/// Calls `f` on each operand of `expression`.
pub(crate) fn of_expression(
    expression: &mut Expression,
    mut f: impl FnMut(&mut Handle<Expression>),
) {
    operands::map_expression(expression, &mut f);
}

/// Calls `f` on each expression that `statement` names, results included, except in `Emit`s and
/// nested blocks.
#[cfg_attr(
    not(any(test, feature = "glsl")),
    allow(dead_code, reason = "only GLSL's rewrites rebuild statements")
)]
pub(crate) fn of_statement(statement: &mut Statement, mut f: impl FnMut(&mut Handle<Expression>)) {
    operands::map_statement(statement, &mut f);
    operands::result_mut(statement).into_iter().for_each(f);
}
