//! Rebuilds functions with some terms behind branches.

use std::collections::{BTreeMap, BTreeSet};

use naga::{
    BinaryOperator, Block, DerivativeAxis, DerivativeControl, Expression, Function, Handle,
    Literal, LocalVariable, MathFunction, Module, SampleLevel, Span, Statement, Type,
};

use super::find::{Term, Weight};
use naga_edit::copy::{CopyFunction, Copying};
use naga_edit::writer::FunctionWriter;
use preshade_dataflow::graph::{FunctionGraph, FunctionId, Graph};

/// The module in which each term is computed only if its weight's magnitude exceeds `threshold`,
/// and is 0 otherwise. With a threshold of 0, a weight that is NaN counts as other than 0.
pub(crate) fn skipping(graph: &Graph<'_>, terms: &[Term], threshold: f32) -> Module {
    let mut module = graph.module().clone();
    let functions: BTreeSet<FunctionId> = terms.iter().map(|t| t.function).collect();
    for id in functions {
        let of: Vec<&Term> = terms.iter().filter(|t| t.function == id).collect();
        let function = TermCopier::new(graph.function(id), &mut module, &of, threshold).run();
        match id {
            FunctionId::Function(h) => module.functions[h] = function,
            FunctionId::EntryPoint(i) => module.entry_points[i].function = function,
        }
    }
    module
}

/// Copies a function; the terms go behind branches.
struct TermCopier<'a, 'p> {
    f: &'a FunctionGraph<'p>,
    module: &'a mut Module,
    threshold: f32,
    /// The terms of each product.
    terms: BTreeMap<Handle<Expression>, Vec<&'a Term>>,
    /// Expressions that are computed behind a branch, with their term: the innermost of several.
    /// `None`: a vector of terms, just before their product.
    late: BTreeMap<Handle<Expression>, Option<&'a Term>>,
    copying: Copying<'p>,
    /// Gradients of samples behind a branch.
    gradients: BTreeMap<Handle<Expression>, [Handle<Expression>; 2]>,
}

impl<'p> CopyFunction<'p> for TermCopier<'_, 'p> {
    fn copying(&mut self) -> &mut Copying<'p> {
        &mut self.copying
    }

    fn emit(&mut self, range: naga::Range<Expression>, span: Span) {
        for e in range {
            match self.late.contains_key(&e) {
                true => self.evaluate_gradients(e),
                false => self.evaluate(e),
            }
        }
        self.copying.writer.flush(span);
    }

    fn statement(&mut self, statement: &'p Statement, span: Span) {
        if let Statement::Call {
            result: Some(result),
            ..
        } = statement
            && self.late.contains_key(result)
        {
            return;
        }
        let copy = self.copied(statement, span);
        self.copying.writer.statement(copy, span);
    }
}

impl<'a, 'p> TermCopier<'a, 'p> {
    fn new(
        f: &'a FunctionGraph<'p>,
        module: &'a mut Module,
        of: &[&'a Term],
        threshold: f32,
    ) -> Self {
        let mut terms: BTreeMap<_, Vec<&Term>> = BTreeMap::new();
        let mut late: BTreeMap<Handle<Expression>, Option<&'a Term>> = BTreeMap::new();
        for term in of {
            terms.entry(term.product).or_default().push(term);
            late.extend(term.vector.map(|v| (v, None)));
        }
        for term in of {
            for e in &term.alone {
                let is_inner = late.get(e).is_none_or(|have| {
                    have.is_some_and(|have| have.alone.len() > term.alone.len())
                });
                if is_inner {
                    late.insert(*e, Some(term));
                }
            }
        }
        Self {
            f,
            module,
            threshold,
            terms,
            late,
            copying: Copying::new(f.function, FunctionWriter::like(f.function)),
            gradients: BTreeMap::new(),
        }
    }

    fn run(mut self) -> Function {
        self.unevaluated();
        self.copying.initialisers();
        self.block(&self.f.function.body);
        self.copying.finish()
    }

    /// Evaluates the gradients of an implicit sample, before the branch.
    fn evaluate_gradients(&mut self, e: Handle<Expression>) {
        let Expression::ImageSample {
            coordinate,
            level: SampleLevel::Auto,
            gather: None,
            ..
        } = self.f.function.expressions[e]
        else {
            return;
        };
        let Copying { copies, writer, .. } = &mut self.copying;
        let expr = copies.mapped(coordinate);
        let gradients = [DerivativeAxis::X, DerivativeAxis::Y].map(|axis| {
            let ctrl = DerivativeControl::Coarse;
            writer.expression(Expression::Derivative { axis, ctrl, expr })
        });
        let name = self.f.function.named_expressions.get(&coordinate).cloned();
        let name = name.unwrap_or_else(|| "tap".to_owned());
        for (gradient, suffix) in gradients.iter().zip(["dx", "dy"]) {
            let names = &mut writer.function.named_expressions;
            names.insert(*gradient, format!("{name}_{suffix}"));
        }
        self.gradients.insert(e, gradients);
    }

    /// Copies an expression at its evaluation. The terms of a product come before it, each behind
    /// its branch.
    fn evaluate(&mut self, e: Handle<Expression>) {
        let terms = self.terms.get(&e).cloned().unwrap_or_default();
        for term in &terms {
            self.guarded(term);
        }
        let vectors: BTreeSet<_> = terms.iter().filter_map(|t| t.vector).collect();
        for e in vectors.into_iter().chain([e]) {
            let copying = &mut self.copying;
            let mut copy = copying
                .copies
                .with_operands(&copying.original.expressions[e]);
            if let (Some([x, y]), Expression::ImageSample { level, .. }) =
                (self.gradients.get(&e), &mut copy)
            {
                *level = SampleLevel::Gradient { x: *x, y: *y };
            }
            copying.writer.begin();
            copying.append(e, copy);
        }
    }

    /// Writes `if abs(weight) > threshold { tap = .. } else { tap = 0 }`. Readers of the term read
    /// `tap`.
    fn guarded(&mut self, term: &Term) {
        let span = Span::UNDEFINED;
        let Copying { copies, writer, .. } = &mut self.copying;
        let weight = match term.weight {
            Weight::Value(w) => copies.mapped(w),
            Weight::Component(vector, index) => {
                let base = copies.mapped(vector);
                writer.expression(Expression::AccessIndex { base, index })
            }
            Weight::Rest(w) => {
                let left = writer.expression(Expression::Literal(Literal::F32(1.0)));
                let right = copies.mapped(w);
                let op = BinaryOperator::Subtract;
                writer.expression(Expression::Binary { op, left, right })
            }
        };
        let right = writer.expression(Expression::Literal(Literal::F32(self.threshold)));
        let (op, left) = match self.threshold > 0.0 {
            false => (BinaryOperator::NotEqual, weight),
            true => {
                let magnitude = Expression::Math {
                    fun: MathFunction::Abs,
                    arg: weight,
                    arg1: None,
                    arg2: None,
                    arg3: None,
                };
                (BinaryOperator::Greater, writer.expression(magnitude))
            }
        };
        let condition = writer.expression(Expression::Binary { op, left, right });
        let inner = self.f.info[term.tap]
            .ty
            .inner_with(&self.module.types)
            .clone();
        let ty = Type { name: None, inner };
        let ty = self.module.types.insert(ty, span);
        let variable = LocalVariable {
            name: Some("tap".to_owned()),
            ty,
            init: None,
        };
        let variable = writer.function.local_variables.append(variable, span);
        let pointer = writer.expression(Expression::LocalVariable(variable));
        let zero = writer.expression(Expression::ZeroValue(ty));
        let enclosing = writer.open(span);
        for e in &term.alone {
            if self.late.get(e).is_some_and(|of| *of == Some(term)) {
                self.late_one(*e);
            }
        }
        let Copying { copies, writer, .. } = &mut self.copying;
        let value = copies.mapped(term.tap);
        writer.statement(Statement::Store { pointer, value }, span);
        let accept = writer.close(enclosing, span);
        let mut reject = Block::new();
        let value = zero;
        reject.push(Statement::Store { pointer, value }, span);
        let branch = Statement::If {
            condition,
            accept,
            reject,
        };
        writer.statement(branch, span);
        let tap = writer.expression(Expression::Load { pointer });
        copies.insert(term.tap, tap);
    }

    /// Copies an expression or a call of a term, inside the branch.
    fn late_one(&mut self, e: Handle<Expression>) {
        if !matches!(self.f.function.expressions[e], Expression::CallResult(_)) {
            self.evaluate(e);
        } else if let Some(at) = self.f.statements.evaluated_at(e) {
            let node = self.f.statements.get(at);
            let copy = self.copied(node.statement, node.span);
            self.copying.writer.statement(copy, node.span);
        }
    }
}
