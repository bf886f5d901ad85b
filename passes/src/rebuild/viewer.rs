//! Leaves out of a fragment stage's coverage what depends on the viewer: parallax, fades by
//! distance.
//!
//! A texture coordinate becomes the value that the author computed before the viewer took part: of
//! `uv + offset` it is `uv`. Then each condition of a discard becomes what it is without the viewer:
//! of `far || alpha < 0.5` it is `alpha < 0.5`, of `alpha * fade < 0.5` the same, and of
//! `fade < dither` nothing remains, so that nothing is discarded.

use std::collections::{BTreeMap, BTreeSet};

use naga::{
    Arena, BinaryOperator, Binding, BuiltIn, Expression, Function, Handle, Literal, LocalVariable,
    MathFunction, Module, Span, Statement, UnaryOperator,
};

use crate::analysis::opaque::Opaque;
use crate::analysis::reach::{with_operands, with_users};
use crate::analysis::values::{Node, ValueId, Values};
use crate::analysis::view;
use crate::core::operands;
use crate::core::program::Program;
use crate::core::reflect;
use crate::graph::rate::Rate;
use crate::graph::{FunctionGraph, FunctionId, Graph, StmtId, text};
use crate::rebuild::place::{self, Replacement, Rewrite};

/// A program without what depends on the viewer.
#[derive(Debug)]
pub struct Dropped {
    /// The program.
    pub program: Program,
    /// What was left out, in a user's words.
    pub left_out: Vec<String>,
}

/// Why nothing can be left out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Stays {
    /// A discard depends on the viewer in a way that leaves nothing else: where it is.
    Discard(String),
    /// The result is invalid: a bug.
    Built(String),
}

/// The material without it. `None`: its coverage does not depend on the viewer. `follows` are the
/// uniforms that follow the viewer ([`view::view_dependent`]).
///
/// # Errors
/// [`Stays`].
pub fn dropped(opaque: &Opaque<'_>, follows: &[String]) -> Result<Option<Dropped>, Stays> {
    let Some(fragment) = opaque.fragment.filter(|_| opaque.decides.discards) else {
        return Ok(None);
    };
    let varyings = varyings(&opaque.graph, opaque.vertex, follows);
    let mut program = opaque.program.clone();
    let mut left_out = Vec::new();
    for step in [Step::Coordinates, Step::Conditions] {
        let (module, told) = {
            let graph = Graph::build(&program);
            let Some(stage) = Stage::new(&graph, fragment, follows, &varyings) else {
                return Ok(None);
            };
            stage.without(step)
        };
        if !told.is_empty() {
            let rebuilt = program.with_module(module);
            program = rebuilt.map_err(|e| Stays::Built(e.to_string()))?;
            left_out.extend(told);
        }
    }
    let graph = Graph::build(&program);
    if let Some(stage) = Stage::new(&graph, fragment, follows, &varyings)
        && let Some(place) = stage.remaining(&program)
    {
        return Err(Stays::Discard(place));
    }
    Ok((!left_out.is_empty()).then_some(Dropped { program, left_out }))
}

/// Locations of the vertex stage's outputs that depend on the viewer.
fn varyings(graph: &Graph<'_>, vertex: usize, follows: &[String]) -> BTreeSet<u32> {
    let Ok(values) = Values::new(graph, vertex) else {
        return BTreeSet::new();
    };
    let sources = (0..values.values.len()).filter(|v| view::is_read(&values, *v, follows));
    let dependent = with_users(&values, sources.collect());
    let outputs = values.outputs().into_iter();
    let locations = outputs.filter_map(|(binding, value)| match binding {
        Some(Binding::Location { location, .. }) if dependent[value] => Some(location),
        _ => None,
    });
    locations.collect()
}

/// What is replaced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    Coordinates,
    Conditions,
}

/// A fragment stage and what depends on the viewer in it.
struct Stage<'g, 'p> {
    graph: &'g Graph<'p>,
    values: Values<'g, 'p>,
    /// Whether each value depends on the viewer.
    dependent: Vec<bool>,
    /// Whether coverage depends on each value.
    decides: Vec<bool>,
}

/// What takes the place of an expression.
#[derive(Clone, Copy, Debug)]
enum Instead {
    /// Another expression of the author's.
    Other(Handle<Expression>),
    /// A constant.
    Bool(bool),
}

type Changes = BTreeMap<Handle<Expression>, Instead>;

impl<'g, 'p> Stage<'g, 'p> {
    /// `None`: the stage is too large to tell.
    fn new(
        graph: &'g Graph<'p>,
        fragment: usize,
        follows: &[String],
        varyings: &BTreeSet<u32>,
    ) -> Option<Self> {
        let values = Values::new(graph, fragment).ok()?;
        let module = graph.module();
        let inputs = reflect::inputs(module, &module.entry_points[fragment].function);
        let is_input = |i: usize| match inputs.get(i).and_then(|io| io.binding.as_ref()) {
            Some(Binding::Location { location, .. }) => varyings.contains(location),
            _ => false,
        };
        let is_position = |i: usize| {
            let binding = inputs.get(i).and_then(|io| io.binding.as_ref());
            matches!(binding, Some(Binding::BuiltIn(BuiltIn::Position { .. })))
        };
        let is_source = |value: &ValueId| match &values.values[*value].node {
            Node::Input(i) => is_input(*i),
            Node::Expression(context, e, _) => {
                // How far the surface is. Its place in the picture is no property of the viewer.
                let f = values.function(*context).function;
                let is_far = matches!(
                    f.expressions[*e],
                    Expression::AccessIndex { index: 2 | 3, .. }
                );
                let of_position = || match values.values[*value].operands[..] {
                    [one] => matches!(values.values[one].node, Node::Input(i) if is_position(i)),
                    _ => false,
                };
                (is_far && of_position()) || view::is_read(&values, *value, follows)
            }
            _ => false,
        };
        let sources: Vec<ValueId> = (0..values.values.len()).filter(is_source).collect();
        let dependent = with_users(&values, sources);
        let decides = with_operands(&values, values.coverage.clone());
        Some(Self {
            graph,
            values,
            dependent,
            decides,
        })
    }

    /// The functions of the stage.
    fn functions(&self) -> BTreeSet<FunctionId> {
        self.values.contexts.iter().map(|c| c.function).collect()
    }

    /// Whether an expression has a value, in some call of its function, that is marked.
    fn is(&self, marks: &[bool], id: FunctionId, e: Handle<Expression>) -> bool {
        let contexts = self.values.contexts.iter().enumerate();
        let mut contexts = contexts.filter(|(_, c)| c.function == id);
        contexts.any(|(i, _)| self.values.named(i, e).is_some_and(|v| marks[v]))
    }

    fn depends(&self, id: FunctionId, e: Handle<Expression>) -> bool {
        self.is(&self.dependent, id, e)
    }

    /// The module with the step taken in all functions, and what was left out.
    fn without(&self, step: Step) -> (Module, Vec<String>) {
        let mut module = self.graph.module().clone();
        let mut told = Vec::new();
        for id in self.functions() {
            let f = self.graph.function(id);
            let mut changes = Changes::new();
            match step {
                Step::Coordinates => self.coordinates(id, f, &mut changes),
                Step::Conditions => self.conditions(id, f, &mut changes),
            }
            if changes.is_empty() {
                continue;
            }
            told.extend(
                changes
                    .iter()
                    .map(|(e, instead)| self.told(id, *e, *instead)),
            );
            module = place::rewritten(&module, id, |build| {
                let replaced = changes.iter().map(|(e, instead)| {
                    let replacement = match *instead {
                        Instead::Other(other) => Replacement::Other(other),
                        Instead::Bool(value) => {
                            Replacement::Value(build.literal(Literal::Bool(value)))
                        }
                    };
                    (*e, replacement)
                });
                Rewrite {
                    replacements: replaced.collect(),
                    arguments: BTreeMap::new(),
                }
            });
            decide(place::function_mut(&mut module, id));
        }
        (module, told)
    }

    fn told(&self, id: FunctionId, e: Handle<Expression>, instead: Instead) -> String {
        let module = self.graph.module();
        let f = self.graph.function(id);
        let written = |e| text::expression(module, f, e);
        let at = self.line(f.function.expressions.get_span(e));
        match instead {
            Instead::Other(other) => {
                format!("`{}`{at}: `{}` is in its place", written(e), written(other))
            }
            Instead::Bool(value) => {
                format!("`{}`{at}: it counts as {value}", written(e))
            }
        }
    }

    fn line(&self, span: Span) -> String {
        match self.graph.program().sources().locate(span) {
            Some(at) => format!(" (line {})", at.line),
            None => String::new(),
        }
    }

    /// Texture coordinates that coverage depends on.
    fn coordinates(&self, id: FunctionId, f: &FunctionGraph<'_>, changes: &mut Changes) {
        for (e, expression) in f.function.expressions.iter() {
            let coordinate = match *expression {
                Expression::ImageSample { coordinate, .. }
                | Expression::ImageLoad { coordinate, .. } => coordinate,
                _ => continue,
            };
            if self.is(&self.decides, id, e)
                && self.depends(id, coordinate)
                && let Some(base) = self.base(id, f, coordinate, DEEPEST)
            {
                changes.insert(coordinate, Instead::Other(base));
            }
        }
    }

    /// Conditions under which something is discarded.
    fn conditions(&self, id: FunctionId, f: &FunctionGraph<'_>, changes: &mut Changes) {
        for (_, node) in f.statements.iter() {
            let Statement::If {
                condition,
                accept,
                reject,
            } = node.statement
            else {
                continue;
            };
            if !self.depends(id, *condition) {
                continue;
            }
            match (self.discards(accept), self.discards(reject)) {
                (true, false) => self.neutral(id, f, *condition, false, changes),
                (false, true) => self.neutral(id, f, *condition, true, changes),
                _ => {}
            }
        }
    }

    fn discards(&self, block: &naga::Block) -> bool {
        let mut found = false;
        operands::visit(block, &mut |statement| match statement {
            Statement::Kill => found = true,
            Statement::Call { function, .. } => {
                found |= self.graph.may_discard(FunctionId::Function(*function));
            }
            _ => {}
        });
        found
    }

    /// Takes the viewer out of a condition. A part of which nothing remains gets the value `kept`,
    /// which discards nothing.
    fn neutral(
        &self,
        id: FunctionId,
        f: &FunctionGraph<'_>,
        e: Handle<Expression>,
        kept: bool,
        changes: &mut Changes,
    ) {
        if !self.depends(id, e) {
            return;
        }
        match f.function.expressions[e] {
            Expression::Unary {
                op: UnaryOperator::LogicalNot,
                expr,
            } => return self.neutral(id, f, expr, !kept, changes),
            Expression::Binary {
                op:
                    BinaryOperator::LogicalAnd
                    | BinaryOperator::LogicalOr
                    | BinaryOperator::And
                    | BinaryOperator::InclusiveOr,
                left,
                right,
            } => {
                self.neutral(id, f, left, kept, changes);
                return self.neutral(id, f, right, kept, changes);
            }
            Expression::Binary { left, right, .. } => {
                let sides = [left, right].map(|side| (side, self.depends(id, side)));
                let bases = sides.map(|(side, depends)| match depends {
                    true => self.base(id, f, side, DEEPEST),
                    false => Some(side),
                });
                if let [Some(_), Some(_)] = bases {
                    let replaced = sides.into_iter().zip(bases).filter(|((_, d), _)| *d);
                    changes.extend(
                        replaced
                            .filter_map(|((side, _), base)| Some((side, Instead::Other(base?)))),
                    );
                    return;
                }
            }
            Expression::Load { pointer } => {
                if let Expression::LocalVariable(local) = f.function.expressions[pointer]
                    && let Some((condition, value, is_or)) = short_circuit(f, local)
                {
                    // `a || b` branches on `!a`.
                    self.neutral(id, f, condition, kept != is_or, changes);
                    return self.neutral(id, f, value, kept, changes);
                }
            }
            _ => {}
        }
        changes.insert(e, Instead::Bool(kept));
    }

    /// The value that the author computed before the viewer took part.
    fn base(
        &self,
        id: FunctionId,
        f: &FunctionGraph<'_>,
        e: Handle<Expression>,
        depth: u32,
    ) -> Option<Handle<Expression>> {
        if !self.depends(id, e) {
            // Of `1.0 - fade` nothing remains.
            return self.is_varying(id, e).then_some(e);
        }
        let module = self.graph.module();
        let inner = f.ty(module, e);
        let depth = depth.checked_sub(1)?;
        let of = |other: Handle<Expression>| {
            let is_alike = f.ty(module, other) == inner;
            is_alike.then(|| self.base(id, f, other, depth)).flatten()
        };
        // What does not depend on the viewer counts before what does and has a base.
        let free = |all: &[Handle<Expression>]| {
            let free = all
                .iter()
                .copied()
                .find(|o| !self.depends(id, *o) && of(*o).is_some());
            free.or_else(|| all.iter().copied().find_map(of))
        };
        match f.function.expressions[e] {
            Expression::Binary { op, left, right } => match op {
                BinaryOperator::Add | BinaryOperator::Multiply => free(&[left, right]),
                BinaryOperator::Subtract | BinaryOperator::Divide => of(left),
                _ => None,
            },
            Expression::Math { fun, arg, arg1, .. } => match fun {
                MathFunction::Mix | MathFunction::Clamp | MathFunction::Saturate => of(arg),
                MathFunction::Min | MathFunction::Max => free(&[arg, arg1?]),
                MathFunction::Fma => of(arg),
                _ => None,
            },
            Expression::Select { accept, reject, .. } => free(&[accept, reject]),
            Expression::Load { pointer } => {
                let Expression::LocalVariable(local) = f.function.expressions[pointer] else {
                    return None;
                };
                self.stored_before(id, f, e, local).and_then(of)
            }
            // Of a result of several numbers too: a march returns coordinates and a depth.
            Expression::CallResult(_)
            | Expression::Swizzle { .. }
            | Expression::AccessIndex { .. } => {
                let e = match f.function.expressions[e] {
                    Expression::Swizzle { vector: base, .. }
                    | Expression::AccessIndex { base, .. } => base,
                    _ => e,
                };
                if !matches!(f.function.expressions[e], Expression::CallResult(_)) {
                    return None;
                }
                let at = f.statements.evaluated_at(e)?;
                let Statement::Call { arguments, .. } = f.statements.get(at).statement else {
                    return None;
                };
                let alike = arguments
                    .iter()
                    .copied()
                    .filter(|a| f.ty(module, *a) == inner);
                let mut free = alike.filter(|a| !self.depends(id, *a));
                match (free.next(), free.next()) {
                    (Some(one), None) => self.base(id, f, one, depth),
                    _ => None,
                }
            }
            _ => None,
        }
    }

    /// Whether an expression differs from fragment to fragment.
    fn is_varying(&self, id: FunctionId, e: Handle<Expression>) -> bool {
        let contexts = self.values.contexts.iter().enumerate();
        let mut contexts = contexts.filter(|(_, c)| c.function == id);
        contexts.any(|(i, _)| {
            let value = self.values.named(i, e);
            value.is_some_and(|v| self.values.values[v].fact.rate > Rate::Instance)
        })
    }

    /// The last value that a variable certainly has, of those that do not depend on the viewer or
    /// have a part that does not.
    fn stored_before(
        &self,
        id: FunctionId,
        f: &FunctionGraph<'_>,
        load: Handle<Expression>,
        local: Handle<LocalVariable>,
    ) -> Option<Handle<Expression>> {
        let at = f.statements.evaluated_at(load)?;
        let mut last = None;
        for (store, pointer, value) in stores(f).filter(|(s, ..)| *s < at) {
            let is_whole = f.function.expressions[pointer] == Expression::LocalVariable(local);
            if !is_whole && root(f, pointer) != Some(local) {
                continue;
            }
            let is_certain = is_whole && f.statements.get(store).parent.is_none();
            match (is_certain, self.depends(id, value)) {
                (true, false) => last = self.base(id, f, value, 1).or(last),
                (true, true) => last = self.base(id, f, value, 4).or(last),
                (false, true) => {}
                // It may have another value, which is not the viewer's.
                (false, false) if self.is_controlled(id, store) => {}
                (false, false) => return None,
            }
        }
        last
    }

    /// Whether a statement runs only if something of the viewer's is so.
    fn is_controlled(&self, id: FunctionId, statement: StmtId) -> bool {
        let contexts = self.values.contexts.iter().enumerate();
        let mut contexts = contexts.filter(|(_, c)| c.function == id);
        contexts.any(|(i, _)| {
            let control = self.values.get(&Node::Control(i, statement));
            control.is_some_and(|v| self.dependent[v])
        })
    }

    /// Where a discard is that still depends on the viewer.
    fn remaining(&self, program: &Program) -> Option<String> {
        self.functions().into_iter().find_map(|id| {
            let f = self.graph.function(id);
            let mut kills = f.statements.iter();
            let (_, kill) = kills.find(|(at, node)| {
                matches!(node.statement, Statement::Kill)
                    && (self.is_controlled(id, *at)
                        || f.statements.ancestors(*at).any(|a| {
                            self.is_controlled(id, a)
                                || matches!(f.statements.get(a).statement,
                                Statement::If { condition, .. } if self.depends(id, *condition))
                        }))
            })?;
            let line = program.sources().locate(kill.span).map(|at| at.line);
            let of = self.graph.name(id);
            Some(line.map_or_else(|| format!("in `{of}`"), |line| format!("at line {line}")))
        })
    }
}

/// Replaces each `if` whose condition is a constant by what it does.
fn decide(function: &mut Function) {
    let Function {
        body, expressions, ..
    } = function;
    operands::visit_mut(body, &mut |statement| {
        if let Statement::If {
            condition,
            accept,
            reject,
        } = statement
            && let Some(value) = constant(expressions, *condition)
        {
            let taken = if value { accept } else { reject };
            *statement = Statement::Block(std::mem::take(taken));
        }
    });
}

/// The value of a constant condition.
fn constant(expressions: &Arena<Expression>, e: Handle<Expression>) -> Option<bool> {
    match expressions[e] {
        Expression::Literal(Literal::Bool(value)) => Some(value),
        Expression::Unary {
            op: UnaryOperator::LogicalNot,
            expr,
        } => constant(expressions, expr).map(|value| !value),
        _ => None,
    }
}

/// Operations that are looked into.
const DEEPEST: u32 = 12;

/// The stores of a function, in order.
fn stores<'f>(
    f: &'f FunctionGraph<'_>,
) -> impl Iterator<Item = (StmtId, Handle<Expression>, Handle<Expression>)> + 'f {
    f.statements
        .iter()
        .filter_map(|(at, node)| match node.statement {
            Statement::Store { pointer, value } => Some((at, *pointer, *value)),
            _ => None,
        })
}

/// The variable that a pointer leads into.
fn root(f: &FunctionGraph<'_>, mut pointer: Handle<Expression>) -> Option<Handle<LocalVariable>> {
    loop {
        match f.function.expressions[pointer] {
            Expression::LocalVariable(local) => return Some(local),
            Expression::Access { base, .. } | Expression::AccessIndex { base, .. } => {
                pointer = base
            }
            _ => return None,
        }
    }
}

/// The condition and the second side of `a || b` or `a && b`, which naga writes as an `if` that
/// stores `b` or a constant, and whether it is `||`.
fn short_circuit(
    f: &FunctionGraph<'_>,
    local: Handle<LocalVariable>,
) -> Option<(Handle<Expression>, Handle<Expression>, bool)> {
    let is_it = |pointer| f.function.expressions[pointer] == Expression::LocalVariable(local);
    let mut all = stores(f).filter(|(_, pointer, _)| is_it(*pointer));
    let (Some((first, _, value)), Some((second, _, constant)), None) =
        (all.next(), all.next(), all.next())
    else {
        return None;
    };
    let Expression::Literal(Literal::Bool(is_or)) = f.function.expressions[constant] else {
        return None;
    };
    let parent = f.statements.get(first).parent?;
    let Statement::If { condition, .. } = f.statements.get(parent).statement else {
        return None;
    };
    let is_alike = f.statements.get(second).parent == Some(parent);
    is_alike.then_some((*condition, value, is_or))
}
