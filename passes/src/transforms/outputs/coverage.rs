//! Leaves out of a fragment stage's coverage the parts that depend on the viewer: parallax, fades
//! by distance. [`analysis::viewer`](super::viewer) gives their replacements.

use std::collections::{BTreeMap, BTreeSet};

use naga::{
    Arena, BinaryOperator, Expression, Function, Handle, Literal, LocalVariable, Module, Span,
    Statement, UnaryOperator,
};

use super::viewer::{self, Changes, Instead, Stage, Unclear};
use crate::analysis::opaque::Opaque;
use crate::analysis::values::ContextId;
use crate::rebuild::isolate::isolate;
use crate::rebuild::place::{self, Replacement, Rewrite};
use preshade_dataflow::graph::{FunctionGraph, Graph, text};
use preshade_plan::program::Program;

/// A program without code that depends on the viewer.
#[derive(Debug)]
pub(crate) struct Dropped {
    pub program: Program,
    /// The parts that were left out, in a user's words.
    pub left_out: Vec<String>,
}

/// Why the viewer cannot be left out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Stays {
    /// It is unclear which fragments are discarded without it; with the reason.
    Discard(String),
    /// The result is invalid: a bug.
    Built(String),
}

/// The material without it. `None`: its coverage does not depend on the viewer. `follows` are the
/// uniforms that follow the viewer ([`view_dependent`](crate::analysis::view::view_dependent)).
///
/// # Errors
/// [`Stays`].
pub(crate) fn dropped(opaque: &Opaque<'_>, follows: &[String]) -> Result<Option<Dropped>, Stays> {
    let Some(fragment) = opaque.fragment.filter(|_| opaque.decides.discards) else {
        return Ok(None);
    };
    let varyings = viewer::varyings(&opaque.graph, opaque.vertex, follows);
    let mut program = opaque.program.clone();
    let mut left_out = Vec::new();
    for is_last in [false, true] {
        let (module, told) = {
            let graph = Graph::build(&program);
            let Some(stage) = Stage::new(&graph, fragment, follows, &varyings) else {
                return Ok(None);
            };
            // Conditions read the textures, at coordinates that are the author's by then.
            let changes = match is_last {
                false => stage.coordinates(),
                true => stage.conditions().map_err(|at| unclear(&stage, at))?,
            };
            (without(&stage, fragment, &changes), notes(&stage, &changes))
        };
        if !told.is_empty() {
            let rebuilt = program.with_module(module);
            program = rebuilt.map_err(|e| Stays::Built(e.to_string()))?;
            left_out.extend(told);
        }
    }
    let graph = Graph::build(&program);
    if let Some(stage) = Stage::new(&graph, fragment, follows, &varyings)
        && let Some((context, span)) = stage.remaining()
    {
        let of = graph.name(stage.values.contexts[context].function);
        let line = line(&stage, span);
        return Err(Stays::Discard(format!(
            "the discard in `{of}`{line} depends on the viewer"
        )));
    }
    let mut seen = BTreeSet::new();
    left_out.retain(|told| seen.insert(told.clone()));
    Ok((!left_out.is_empty()).then_some(Dropped { program, left_out }))
}

fn unclear(stage: &Stage<'_, '_>, Unclear((context, e)): Unclear) -> Stays {
    let f = stage.f(context);
    let written = written(stage, f, e);
    let line = line(stage, f.function.expressions.get_span(e));
    Stays::Discard(format!(
        "no rule says what `{written}`{line} is without the viewer"
    ))
}

/// The module with the changes, each in its own chain of calls.
fn without(stage: &Stage<'_, '_>, fragment: usize, changes: &Changes) -> Module {
    let mut of: BTreeMap<ContextId, Vec<(Handle<Expression>, Instead)>> = BTreeMap::new();
    for ((context, e), instead) in changes {
        of.entry(*context).or_default().push((*e, *instead));
    }
    // A function that is called in one way needs no copy.
    let shared = stage.shared();
    let contexts = &stage.values.contexts;
    let is_shared = |context: ContextId| {
        let mut at = Some(context);
        std::iter::from_fn(|| {
            let context = at?;
            at = contexts[context].call.map(|(caller, _)| caller);
            Some(contexts[context].function)
        })
        .any(|function| shared.contains(&function))
    };
    let apart: BTreeSet<ContextId> = of.keys().copied().filter(|c| is_shared(*c)).collect();
    let module = stage.values.graph.module();
    let (mut module, copies) = isolate(module, fragment, &stage.values, &apart);
    for (context, changes) in of {
        let own = copies.get(&context).copied();
        let id = own.unwrap_or(contexts[context].function);
        module = place::rewritten(&module, id, |build| {
            let replaced = changes.into_iter().map(|(e, instead)| {
                let replacement = match instead {
                    Instead::Other(other) => Replacement::Other(other),
                    Instead::Bool(value) => Replacement::Value(build.literal(Literal::Bool(value))),
                };
                (e, replacement)
            });
            Rewrite {
                replacements: replaced.collect(),
                arguments: BTreeMap::new(),
            }
        });
        decide(place::function_mut(&mut module, id));
    }
    module
}

fn notes(stage: &Stage<'_, '_>, changes: &Changes) -> Vec<String> {
    changes
        .iter()
        .map(|((context, e), instead)| {
            let f = stage.f(*context);
            let written = |e| written(stage, f, e);
            let at = line(stage, span_of(f, *e));
            let own = written(*e);
            match *instead {
                Instead::Other(other) => match written(other) {
                    other if other == own => {
                        format!("`{own}`{at}: an earlier value is in its place")
                    }
                    other => format!("`{own}`{at}: `{other}` is in its place"),
                },
                Instead::Bool(value) => format!("`{own}`{at}: it counts as {value}"),
            }
        })
        .collect()
}

/// An expression as the author wrote it: WebGL's plain uniforms have no block.
fn written(stage: &Stage<'_, '_>, f: &FunctionGraph<'_>, e: Handle<Expression>) -> String {
    let module = stage.values.graph.module();
    let text = text::expression(module, f, e);
    let declared = stage.values.graph.program().declared();
    let mut globals = module.global_variables.iter();
    let block = globals.find(|(_, g)| declared.is_loose(g.binding));
    match block.and_then(|(_, g)| g.name.as_deref()) {
        Some(name) => text.replace(&format!("{name}."), ""),
        None => text,
    }
}

/// The place of an expression, or of one that reads it: loads of variables have none.
fn span_of(f: &FunctionGraph<'_>, e: Handle<Expression>) -> Span {
    let expressions = &f.function.expressions;
    let span = expressions.get_span(e);
    if span.is_defined() {
        return span;
    }
    let mut users = expressions
        .iter()
        .filter(|(_, user)| naga_operands::of_expression(user).contains(&e));
    users
        .next()
        .map_or(span, |(user, _)| expressions.get_span(user))
}

fn line(stage: &Stage<'_, '_>, span: Span) -> String {
    match stage.values.graph.program().sources().locate(span) {
        Some(at) => format!(" (line {})", at.line),
        None => String::new(),
    }
}

/// Replaces each `if` whose condition is a constant by the taken arm. A stage that discards nothing
/// must not keep its `discard`, which switches early depth tests off.
fn decide(function: &mut Function) {
    loop {
        let never = never_true(function);
        let Function {
            body, expressions, ..
        } = function;
        let mut is_changed = false;
        naga_operands::visit_mut(body, &mut |statement| {
            let Statement::If {
                condition,
                accept,
                reject,
            } = statement
            else {
                return;
            };
            *condition = essential(expressions, &never, *condition);
            if let Some(value) = constant(expressions, &never, *condition) {
                let taken = if value { accept } else { reject };
                *statement = Statement::Block(std::mem::take(taken));
                is_changed = true;
            }
        });
        if !is_changed {
            return;
        }
    }
}

/// The local variables that begin with false, and that nothing but false is stored to.
fn never_true(function: &Function) -> BTreeSet<Handle<LocalVariable>> {
    let all = function.local_variables.iter();
    let begins = all.filter(|(_, local)| match local.init {
        Some(init) => constant(&function.expressions, &BTreeSet::new(), init) == Some(false),
        None => true,
    });
    let mut never: BTreeSet<_> = begins.map(|(handle, _)| handle).collect();
    let variable = |e: Handle<Expression>| match function.expressions[e] {
        Expression::LocalVariable(local) => Some(local),
        _ => None,
    };
    let mut remove = |e: Handle<Expression>| {
        if let Some(local) = variable(e) {
            never.remove(&local);
        }
    };
    for (_, expression) in function.expressions.iter() {
        if !matches!(expression, Expression::Load { .. }) {
            naga_operands::of_expression(expression)
                .into_iter()
                .for_each(&mut remove);
        }
    }
    naga_operands::visit(&function.body, &mut |statement| match statement {
        Statement::Store { pointer, value }
            if constant(&function.expressions, &BTreeSet::new(), *value) != Some(false) =>
        {
            remove(*pointer);
        }
        Statement::Store { .. } | Statement::Emit(_) => {}
        other => naga_operands::of_statement(other)
            .into_iter()
            .for_each(&mut remove),
    });
    never
}

/// A condition without the constants that do not decide it.
fn essential(
    expressions: &mut Arena<Expression>,
    never: &BTreeSet<Handle<LocalVariable>>,
    e: Handle<Expression>,
) -> Handle<Expression> {
    let Expression::Binary { op, left, right } = expressions[e] else {
        return e;
    };
    let neutral = match op {
        BinaryOperator::LogicalOr => false,
        BinaryOperator::LogicalAnd => true,
        _ => return e,
    };
    let left = essential(expressions, never, left);
    let right = essential(expressions, never, right);
    if constant(expressions, never, left) == Some(neutral) {
        return right;
    }
    if constant(expressions, never, right) == Some(neutral) {
        return left;
    }
    expressions[e] = Expression::Binary { op, left, right };
    e
}

/// The value of a constant condition.
fn constant(
    expressions: &Arena<Expression>,
    never: &BTreeSet<Handle<LocalVariable>>,
    e: Handle<Expression>,
) -> Option<bool> {
    let known = |e| constant(expressions, never, e);
    match expressions[e] {
        Expression::Literal(Literal::Bool(value)) => Some(value),
        Expression::Unary {
            op: UnaryOperator::LogicalNot,
            expr,
        } => known(expr).map(|value| !value),
        Expression::Binary {
            op: BinaryOperator::LogicalOr,
            left,
            right,
        } => match [known(left), known(right)] {
            [Some(true), _] | [_, Some(true)] => Some(true),
            [Some(false), Some(false)] => Some(false),
            _ => None,
        },
        Expression::Binary {
            op: BinaryOperator::LogicalAnd,
            left,
            right,
        } => match [known(left), known(right)] {
            [Some(false), _] | [_, Some(false)] => Some(false),
            [Some(true), Some(true)] => Some(true),
            _ => None,
        },
        Expression::Load { pointer } => match expressions[pointer] {
            Expression::LocalVariable(local) => never.contains(&local).then_some(false),
            _ => None,
        },
        _ => None,
    }
}
