//! Rewrites a function: new statements at its start, then the author's with some expressions
//! replaced.

use std::collections::BTreeMap;

use naga::{
    BinaryOperator, Expression, Function, Handle, MathFunction, Module, SampleLevel, Span,
    Statement,
};

use super::CodeBuilder;
use naga_edit::copy::{CopyFunction, Copying};
use naga_edit::writer::FunctionWriter;
use preshade_dataflow::graph::FunctionId;

/// The replacement of an author's expression behind a prologue.
#[derive(Clone, Copy, Debug)]
pub enum Replacement {
    /// A value of the prologue.
    Value(Handle<Expression>),
    /// Another expression of the author's, evaluated before it.
    Other(Handle<Expression>),
    /// The same texture sample, with gradients from the prologue.
    Gradients {
        x: Handle<Expression>,
        y: Handle<Expression>,
    },
    /// The same texture sample, with these gradients of its coordinate. A bias scales them.
    Footprint {
        x: Handle<Expression>,
        y: Handle<Expression>,
    },
    /// The same texture sample, its implicit level moved by this number.
    Level(Handle<Expression>),
    /// The same value, times this number.
    Times(Handle<Expression>),
}

/// Replacements by the author's expression.
pub type Replacements = BTreeMap<Handle<Expression>, Replacement>;

/// The module with the statements of `build` at the start of an entry point. The author's
/// expressions are copied into a fresh arena behind them; `build` may add arguments, types and
/// globals.
pub fn prologue(module: &Module, entry: usize, build: impl FnOnce(&mut CodeBuilder<'_>)) -> Module {
    prologue_replacing(module, entry, |builder| {
        build(builder);
        Replacements::new()
    })
}

/// [`prologue`] with replacements: the author's code uses the expressions that `build` returns.
pub fn prologue_replacing(
    module: &Module,
    entry: usize,
    build: impl FnOnce(&mut CodeBuilder<'_>) -> Replacements,
) -> Module {
    rewritten(module, FunctionId::EntryPoint(entry), |builder| Rewrite {
        replacements: build(builder),
        arguments: BTreeMap::new(),
    })
}

/// Changes to the author's code behind a prologue.
#[derive(Clone, Debug, Default)]
pub struct Rewrite {
    pub replacements: Replacements,
    /// Additional arguments for calls, by callee, after the existing ones.
    pub arguments: BTreeMap<Handle<Function>, Vec<Handle<Expression>>>,
}

/// The module with a function or entry point rewritten: the statements of `build`, then the
/// author's with the changes in [`Rewrite`].
pub fn rewritten(
    module: &Module,
    id: FunctionId,
    build: impl FnOnce(&mut CodeBuilder<'_>) -> Rewrite,
) -> Module {
    let mut module = module.clone();
    let original = std::mem::take(function_mut(&mut module, id));
    let mut builder = CodeBuilder::new(&mut module, FunctionWriter::like(&original));
    let rewrite = build(&mut builder);
    let mut author = AuthorCopy {
        copying: Copying::new(&original, builder.finish()),
        rewrite,
    };
    author.unevaluated();
    author.block(&original.body);
    author.copying.initialisers();
    *function_mut(&mut module, id) = author.copying.finish();
    module
}

pub fn function_mut(module: &mut Module, id: FunctionId) -> &mut Function {
    match id {
        FunctionId::Function(h) => &mut module.functions[h],
        FunctionId::EntryPoint(i) => &mut module.entry_points[i].function,
    }
}

/// Copies the author's code behind the prologue.
struct AuthorCopy<'a> {
    copying: Copying<'a>,
    rewrite: Rewrite,
}

impl<'a> CopyFunction<'a> for AuthorCopy<'a> {
    fn copying(&mut self) -> &mut Copying<'a> {
        &mut self.copying
    }

    fn expression(&mut self, e: Handle<Expression>) {
        let copying = &mut self.copying;
        let replacement = self.rewrite.replacements.get(&e);
        if let Some(Replacement::Value(value)) = replacement {
            copying.copies.insert(e, *value);
            return;
        }
        if let Some(Replacement::Other(other)) = replacement {
            let value = copying.copies.mapped(*other);
            copying.copies.insert(e, value);
            return;
        }
        let mut copy = copying
            .copies
            .with_operands(&copying.original.expressions[e]);
        if let (Some(replacement), Expression::ImageSample { level, .. }) = (replacement, &mut copy)
        {
            *level = match (*replacement, *level) {
                (Replacement::Footprint { x, y }, SampleLevel::Bias(bias)) => {
                    biased(&mut copying.writer, bias, x, y)
                }
                (Replacement::Gradients { x, y } | Replacement::Footprint { x, y }, _) => {
                    SampleLevel::Gradient { x, y }
                }
                (Replacement::Level(by), SampleLevel::Auto) => SampleLevel::Bias(by),
                (Replacement::Level(by), SampleLevel::Bias(bias)) => {
                    SampleLevel::Bias(copying.writer.expression(Expression::Binary {
                        op: BinaryOperator::Add,
                        left: bias,
                        right: by,
                    }))
                }
                (_, level) => level,
            };
        }
        copying.append(e, copy);
        if let Some(Replacement::Times(by)) = replacement {
            copying.append(
                e,
                Expression::Binary {
                    op: BinaryOperator::Multiply,
                    left: copying.copies.mapped(e),
                    right: *by,
                },
            );
        }
    }

    fn result(&mut self, e: Handle<Expression>) -> Handle<Expression> {
        self.expression(e);
        let copying = &mut self.copying;
        if let Some(Replacement::Value(_) | Replacement::Other(_)) =
            self.rewrite.replacements.get(&e)
        {
            // The call still returns a result that is not read.
            let expression = copying.original.expressions[e].clone();
            let span = copying.original.expressions.get_span(e);
            return copying.writer.append(expression, span);
        }
        copying.copies.mapped(e)
    }

    fn statement(&mut self, statement: &'a Statement, span: Span) {
        let mut copy = self.copied(statement, span);
        if let Statement::Call {
            function,
            arguments,
            ..
        } = &mut copy
        {
            let more = self.rewrite.arguments.get(function);
            arguments.extend(more.into_iter().flatten());
        }
        self.copying.writer.statement(copy, span);
    }
}

/// One level more is a footprint of twice the size. `bias` is evaluated at the sample.
fn biased(
    writer: &mut FunctionWriter,
    bias: Handle<Expression>,
    x: Handle<Expression>,
    y: Handle<Expression>,
) -> SampleLevel {
    let right = writer.expression(Expression::Math {
        fun: MathFunction::Exp2,
        arg: bias,
        arg1: None,
        arg2: None,
        arg3: None,
    });
    let op = BinaryOperator::Multiply;
    let [x, y] = [x, y].map(|left| writer.expression(Expression::Binary { op, left, right }));
    SampleLevel::Gradient { x, y }
}
