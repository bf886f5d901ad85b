//! The expressions that an expression or a statement refers to, for remapping them: the one table of `preshade-passes`, with results counted in.

use naga::{Expression, Handle, Statement};
use preshade_passes::graph::operands;

#[cfg(any(feature = "glsl", test))]
pub(crate) use operands::blocks_mut as blocks;

/// Calls `f` on every operand of `expression`.
pub(crate) fn of_expression(
    expression: &mut Expression,
    mut f: impl FnMut(&mut Handle<Expression>),
) {
    operands::map_expression(expression, &mut f);
}

/// Calls `f` on every expression that `statement` itself names, results included; not on those of `Emit`s nor of nested blocks.
#[cfg_attr(
    not(any(test, feature = "glsl")),
    allow(dead_code, reason = "only GLSL's rewrites rebuild statements")
)]
pub(crate) fn of_statement(statement: &mut Statement, mut f: impl FnMut(&mut Handle<Expression>)) {
    operands::map_statement(statement, &mut f);
    operands::result_mut(statement).into_iter().for_each(f);
}
