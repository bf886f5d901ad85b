//! Rebuilds functions with some terms behind branches.

use std::collections::{BTreeMap, BTreeSet};

use naga::{
    BinaryOperator, Block, DerivativeAxis, DerivativeControl, Expression, Function, Handle,
    Literal, LocalVariable, MathFunction, Module, SampleLevel, Span, Statement, Type,
};

use super::find::{Term, Weight};
use crate::graph::{FunctionGraph, FunctionId, Graph, StmtId, operands};
use crate::rebuild::place;

/// The module in which each term is computed only if its weight's magnitude exceeds `threshold`,
/// and is 0 otherwise.
pub fn skipping(graph: &Graph<'_>, terms: &[Term], threshold: f32) -> Module {
    let mut module = graph.module().clone();
    let functions: BTreeSet<FunctionId> = terms.iter().map(|t| t.function).collect();
    for id in functions {
        let of: Vec<&Term> = terms.iter().filter(|t| t.function == id).collect();
        let function = Copier::new(graph.function(id), &mut module, &of, threshold).run();
        match id {
            FunctionId::Function(h) => module.functions[h] = function,
            FunctionId::EntryPoint(i) => module.entry_points[i].function = function,
        }
    }
    module
}

struct Copier<'a, 'p> {
    f: &'a FunctionGraph<'p>,
    module: &'a mut Module,
    threshold: f32,
    /// Terms by product.
    terms: BTreeMap<Handle<Expression>, Vec<&'a Term>>,
    /// Expressions that are computed behind a branch, with their term: the innermost of several.
    /// `None`: a vector of terms, just before their product.
    late: BTreeMap<Handle<Expression>, Option<&'a Term>>,
    function: Function,
    map: Vec<Option<Handle<Expression>>>,
    /// Gradients of samples behind a branch.
    gradients: BTreeMap<Handle<Expression>, [Handle<Expression>; 2]>,
    emitting: Option<usize>,
    span: Span,
}

impl<'a, 'p> Copier<'a, 'p> {
    fn new(
        f: &'a FunctionGraph<'p>,
        module: &'a mut Module,
        of: &[&'a Term],
        threshold: f32,
    ) -> Self {
        let original = f.function;
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
            function: Function {
                name: original.name.clone(),
                arguments: original.arguments.clone(),
                result: original.result.clone(),
                local_variables: original.local_variables.clone(),
                diagnostic_filter_leaf: original.diagnostic_filter_leaf,
                ..Function::default()
            },
            map: vec![None; original.expressions.len()],
            gradients: BTreeMap::new(),
            emitting: None,
            span: Span::UNDEFINED,
        }
    }

    fn run(mut self) -> Function {
        let original = self.f.function;
        for (e, expression) in original.expressions.iter() {
            if self.f.statements.evaluated_at(e).is_none() {
                let copy = self.with_operands(expression);
                let copy = self.function.expressions.append(copy, self.span_of(e));
                self.map[e.index()] = Some(copy);
            }
        }
        let locals = original.local_variables.len();
        place::initialise(original, &mut self.function, locals);
        let body = self.block(&original.body, StmtId::from(0));
        self.function.body = body;
        for (e, name) in &original.named_expressions {
            if let Some(new) = self.map[e.index()] {
                let names = &mut self.function.named_expressions;
                names.insert(new, name.clone());
            }
        }
        self.function
    }

    fn span_of(&self, e: Handle<Expression>) -> Span {
        self.f.function.expressions.get_span(e)
    }

    fn with_operands(&self, expression: &Expression) -> Expression {
        let mut copy = expression.clone();
        operands::map_expression(&mut copy, &mut |o| *o = self.map[o.index()].unwrap_or(*o));
        copy
    }

    fn block(&mut self, block: &Block, first: StmtId) -> Block {
        let mut out = Block::new();
        let mut id = first;
        for (statement, span) in block.span_iter() {
            self.span = *span;
            self.statement(statement, id, &mut out);
            id = self.f.statements.get(id).end;
        }
        self.flush(&mut out);
        out
    }

    fn statement(&mut self, statement: &Statement, id: StmtId, out: &mut Block) {
        if let Statement::Emit(range) = statement {
            for e in range.clone() {
                match self.late.contains_key(&e) {
                    true => self.ahead(e),
                    false => self.evaluate(e, out),
                }
            }
            return;
        }
        if let Statement::Call {
            result: Some(result),
            ..
        } = statement
            && self.late.contains_key(result)
        {
            return;
        }
        self.flush(out);
        let span = self.span;
        let mut copy = operands::shell(statement);
        let mut at = StmtId::from(id.index() + 1);
        let mut inner = Vec::new();
        for block in operands::blocks(statement) {
            inner.push(self.block(block, at));
            at = block.iter().fold(at, |at, _| self.f.statements.get(at).end);
        }
        operands::fill(&mut copy, statement, inner);
        operands::map_statement(&mut copy, &mut |o| *o = self.map[o.index()].unwrap_or(*o));
        self.result(&mut copy);
        out.push(copy, span);
    }

    /// Maps the result of a call or another statement.
    fn result(&mut self, copy: &mut Statement) {
        if let Some(result) = operands::result_mut(copy) {
            let old = *result;
            let expression = self.f.function.expressions[old].clone();
            let span = self.span_of(old);
            *result = self.function.expressions.append(expression, span);
            self.map[old.index()] = Some(*result);
        }
    }

    /// Evaluates the gradients of an implicit sample, before the branch.
    fn ahead(&mut self, e: Handle<Expression>) {
        let Expression::ImageSample {
            coordinate,
            level: SampleLevel::Auto,
            gather: None,
            ..
        } = self.f.function.expressions[e]
        else {
            return;
        };
        let expr = self.map[coordinate.index()].unwrap_or(coordinate);
        let gradients = [DerivativeAxis::X, DerivativeAxis::Y].map(|axis| {
            let ctrl = DerivativeControl::Coarse;
            self.emit(Expression::Derivative { axis, ctrl, expr })
        });
        let name = self.f.function.named_expressions.get(&coordinate).cloned();
        let name = name.unwrap_or_else(|| "tap".to_owned());
        for (gradient, suffix) in gradients.iter().zip(["dx", "dy"]) {
            let names = &mut self.function.named_expressions;
            names.insert(*gradient, format!("{name}_{suffix}"));
        }
        self.gradients.insert(e, gradients);
    }

    /// Copies an expression at its evaluation. The terms of a product come before it, each behind
    /// its branch.
    fn evaluate(&mut self, e: Handle<Expression>, out: &mut Block) {
        let terms = self.terms.get(&e).cloned().unwrap_or_default();
        for term in &terms {
            self.guarded(term, out);
        }
        let vectors: BTreeSet<_> = terms.iter().filter_map(|t| t.vector).collect();
        for vector in vectors {
            self.copy(vector);
        }
        self.copy(e);
    }

    fn copy(&mut self, e: Handle<Expression>) {
        let mut copy = self.with_operands(&self.f.function.expressions[e]);
        if let (Some([x, y]), Expression::ImageSample { level, .. }) =
            (self.gradients.get(&e), &mut copy)
        {
            *level = SampleLevel::Gradient { x: *x, y: *y };
        }
        self.emitting.get_or_insert(self.function.expressions.len());
        let copy = self.function.expressions.append(copy, self.span_of(e));
        self.map[e.index()] = Some(copy);
    }

    /// Writes `if abs(weight) > threshold { tap = .. } else { tap = 0 }`. Readers of the term read
    /// `tap`.
    fn guarded(&mut self, term: &Term, out: &mut Block) {
        let weight = match term.weight {
            Weight::Value(w) => self.mapped(w),
            Weight::Component(vector, index) => {
                let base = self.mapped(vector);
                self.emit(Expression::AccessIndex { base, index })
            }
            Weight::Rest(w) => {
                let left = self.constant(Expression::Literal(Literal::F32(1.0)), out);
                let right = self.mapped(w);
                let op = BinaryOperator::Subtract;
                self.emit(Expression::Binary { op, left, right })
            }
        };
        let right = self.constant(Expression::Literal(Literal::F32(self.threshold)), out);
        let left = self.emit(Expression::Math {
            fun: MathFunction::Abs,
            arg: weight,
            arg1: None,
            arg2: None,
            arg3: None,
        });
        let op = BinaryOperator::Greater;
        let condition = self.emit(Expression::Binary { op, left, right });
        let inner = self.f.info[term.tap]
            .ty
            .inner_with(&self.module.types)
            .clone();
        let ty = Type { name: None, inner };
        let ty = self.module.types.insert(ty, Span::UNDEFINED);
        let variable = LocalVariable {
            name: Some("tap".to_owned()),
            ty,
            init: None,
        };
        let variable = self
            .function
            .local_variables
            .append(variable, Span::UNDEFINED);
        let pointer = self.constant(Expression::LocalVariable(variable), out);
        let zero = self.constant(Expression::ZeroValue(ty), out);
        self.flush(out);
        let mut accept = Block::new();
        for e in &term.alone {
            if self.late.get(e).is_some_and(|of| *of == Some(term)) {
                self.late_one(*e, &mut accept);
            }
        }
        self.flush(&mut accept);
        let value = self.mapped(term.tap);
        accept.push(Statement::Store { pointer, value }, self.span);
        let mut reject = Block::new();
        let value = zero;
        reject.push(Statement::Store { pointer, value }, self.span);
        let branch = Statement::If {
            condition,
            accept,
            reject,
        };
        out.push(branch, self.span);
        let tap = self.emit(Expression::Load { pointer });
        self.map[term.tap.index()] = Some(tap);
    }

    /// Copies an expression or a call of a term, inside the branch.
    fn late_one(&mut self, e: Handle<Expression>, out: &mut Block) {
        if !matches!(self.f.function.expressions[e], Expression::CallResult(_)) {
            self.evaluate(e, out);
            return;
        }
        let Some(at) = self.f.statements.evaluated_at(e) else {
            return;
        };
        self.flush(out);
        let mut copy = self.f.statements.get(at).statement.clone();
        operands::map_statement(&mut copy, &mut |o| *o = self.map[o.index()].unwrap_or(*o));
        self.result(&mut copy);
        out.push(copy, self.span);
    }

    fn mapped(&self, e: Handle<Expression>) -> Handle<Expression> {
        self.map[e.index()].unwrap_or(e)
    }

    /// Appends an expression that needs an `Emit`.
    fn emit(&mut self, expression: Expression) -> Handle<Expression> {
        self.emitting.get_or_insert(self.function.expressions.len());
        self.function
            .expressions
            .append(expression, Span::UNDEFINED)
    }

    /// Appends an expression that needs no `Emit`.
    fn constant(&mut self, expression: Expression, out: &mut Block) -> Handle<Expression> {
        self.flush(out);
        self.function
            .expressions
            .append(expression, Span::UNDEFINED)
    }

    fn flush(&mut self, out: &mut Block) {
        if let Some(start) = self.emitting.take()
            && self.function.expressions.len() > start
        {
            let range = self.function.expressions.range_from(start);
            out.push(Statement::Emit(range), self.span);
        }
    }
}
