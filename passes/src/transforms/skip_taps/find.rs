//! Finds weighted texture samples in sums, and the expressions that only one of them needs.

use std::collections::{BTreeMap, BTreeSet};

use naga::{
    BinaryOperator, Expression, Handle, ImageClass, ImageDimension, MathFunction, SampleLevel,
    ScalarKind, Span, Statement, TypeInner,
};

use super::refuse;
use crate::analysis::coverage::Decides;
use crate::analysis::refusals as shared;
use crate::analysis::values::Values;
use crate::analysis::zero::{ZeroEffect, Zeros};
use preshade_dataflow::graph::cells::Root;
use preshade_dataflow::graph::counted::Ends;
use preshade_dataflow::graph::effect::Effect;
use preshade_dataflow::graph::{FunctionGraph, FunctionId, Graph, Rate, StmtId};
use preshade_plan::pass::{Facts, Left, Refused};
use preshade_plan::plan::GpuPass;

/// The scalar weight of a term.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Weight {
    /// A scalar.
    Value(Handle<Expression>),
    /// A component of a vector.
    Component(Handle<Expression>, u32),
    /// 1 minus a scalar.
    Rest(Handle<Expression>),
}

/// A term that can be skipped.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Term {
    /// The function that contains it.
    pub function: FunctionId,
    /// The product, or the expression that takes both the term and its weight.
    pub product: Handle<Expression>,
    /// A vector of several terms that only the product uses.
    pub vector: Option<Handle<Expression>>,
    /// The weighted expression.
    pub tap: Handle<Expression>,
    pub weight: Weight,
    /// The expressions that only this term needs, including itself. A call is represented by its
    /// result.
    pub alone: BTreeSet<Handle<Expression>>,
    /// The implicit-LOD samples among them.
    pub implicit: Vec<Handle<Expression>>,
    /// Static cost of these expressions in one run of the function.
    pub cost: f64,
    /// Source span of the product.
    pub span: Span,
}

/// Terms, and the candidates that are none.
#[derive(Clone, Debug, Default)]
pub(crate) struct Terms {
    /// Terms in the order of functions and of their products.
    pub terms: Vec<Term>,
    /// Rejected candidates, most expensive first.
    pub left: Vec<Left>,
}

impl Terms {
    /// Keeps the terms that may be left out where their weight is 0, and moves the others to
    /// `left`. Returns the remaining effect of leaving them out.
    ///
    /// # Errors
    /// The stage is too large.
    pub fn only_zeros(
        &mut self,
        graph: &Graph<'_>,
        fragment: usize,
        facts: &Facts,
        material: &str,
    ) -> Result<ZeroEffect, Refused> {
        let values = Values::new(graph, fragment)
            .map_err(|e| refuse(&shared::TOO_LARGE, e.to_string(), "set a budget"))?;
        let zeros = Zeros::new(&values, facts, material);
        let mut seen = ZeroEffect::Nothing;
        for term in std::mem::take(&mut self.terms) {
            match zeros.left_out(term.function, term.product, Some(term.tap)) {
                Ok(more) => {
                    seen = seen.max(more);
                    self.terms.push(term);
                }
                Err(kept) => self.left.push(Left {
                    name: format!("tap of {}", graph.name(term.function)),
                    reason: format!("{kept}: set a budget"),
                    cost: term.cost,
                    location: graph.program().sources().locate(term.span),
                }),
            }
        }
        self.left.sort_by(|a, b| b.cost.total_cmp(&a.cost));
        Ok(seen)
    }
}

pub(crate) fn terms(
    graph: &Graph<'_>,
    pass: &GpuPass,
    fragment: usize,
    meant: &BTreeSet<FunctionId>,
) -> Terms {
    let program = graph.program();
    let decides = Decides::of(graph, program, fragment, pass);
    let covers = decides.anything().then(|| decides.slice(graph, fragment));
    let others: Vec<FunctionId> = (0..program.module().entry_points.len())
        .filter(|i| *i != fragment)
        .map(FunctionId::EntryPoint)
        .collect();
    let mut found = Terms::default();
    for id in meant {
        let is_shared = others.iter().any(|entry| graph.reaches(*entry, *id));
        let covering = |e: Handle<Expression>| {
            covers.as_ref().is_some_and(|slice| {
                let mut parts = slice.parts.iter().filter(|p| p.function == *id);
                parts.any(|p| p.kept.expressions[e.index()].is_some())
            })
        };
        let within = Within::new(graph, *id);
        for weighed in within.weighed() {
            let term = match () {
                () if !within.samples[weighed.tap.index()] => continue,
                () if is_shared => {
                    Err("the vertex stage runs it too, where it decides the position")
                }
                () if covering(weighed.product) => {
                    Err("it decides a discard, a depth or a coverage")
                }
                () => within.term(&weighed),
            };
            match term {
                Ok(term) => found.terms.push(term),
                Err(reason) => found.left.push(Left {
                    name: format!("tap of {}", graph.name(*id)),
                    reason: reason.to_owned(),
                    cost: within.cost(std::iter::once(weighed.tap)),
                    location: program.sources().locate(within.span(weighed.product)),
                }),
            }
        }
    }
    found.left.sort_by(|a, b| b.cost.total_cmp(&a.cost));
    found
}

/// A candidate with its weight.
struct Weighed {
    product: Handle<Expression>,
    vector: Option<Handle<Expression>>,
    tap: Handle<Expression>,
    weight: Weight,
}

/// A reader of an expression.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum User {
    /// An expression. A call's arguments are read by its result.
    Expression(Handle<Expression>),
    Statement(StmtId),
}

struct Within<'g, 'p> {
    graph: &'g Graph<'p>,
    f: &'g FunctionGraph<'p>,
    users: BTreeMap<Handle<Expression>, Vec<User>>,
    /// Whether an expression needs a texture sample, in this function or a callee.
    samples: Vec<bool>,
}

impl<'g, 'p> Within<'g, 'p> {
    fn new(graph: &'g Graph<'p>, id: FunctionId) -> Self {
        let f = graph.function(id);
        let mut users: BTreeMap<Handle<Expression>, Vec<User>> = BTreeMap::new();
        for (e, expression) in f.function.expressions.iter() {
            for operand in naga_operands::of_expression(expression) {
                users.entry(operand).or_default().push(User::Expression(e));
            }
        }
        for (at, node) in f.statements.iter() {
            let user = match node.statement {
                Statement::Call {
                    result: Some(result),
                    ..
                } => User::Expression(*result),
                _ => User::Statement(at),
            };
            for operand in naga_operands::of_statement(node.statement) {
                users.entry(operand).or_default().push(user);
            }
        }
        let mut this = Self {
            graph,
            f,
            users,
            samples: vec![false; f.function.expressions.len()],
        };
        this.find_samples(&BTreeSet::new());
        // Stored values that may come from a texture.
        let stored = f.statements.iter().filter_map(|(at, node)| {
            let sampled = match node.statement {
                Statement::Store { value, .. } => this.samples[value.index()],
                _ => false,
            };
            sampled.then(|| f.memory.writes.get(&at))?
        });
        let cells: BTreeSet<Root> = stored.flatten().map(|v| f.memory.cell(*v).root).collect();
        if !cells.is_empty() {
            this.find_samples(&cells);
        }
        this
    }

    fn find_samples(&mut self, variables: &BTreeSet<Root>) {
        let f = self.f;
        for (e, expression) in f.function.expressions.iter() {
            let itself = match expression {
                Expression::ImageSample { .. } | Expression::ImageLoad { .. } => true,
                Expression::CallResult(function) => {
                    samples(self.graph, FunctionId::Function(*function))
                }
                Expression::Load { .. } => {
                    let mut seen = f.memory.loads.get(&e).into_iter().flatten();
                    seen.any(|v| variables.contains(&f.memory.cell(*v).root))
                }
                _ => false,
            };
            let mut below = naga_operands::of_expression(expression).into_iter();
            self.samples[e.index()] = itself || below.any(|o| self.samples[o.index()]);
        }
    }

    fn expression(&self, e: Handle<Expression>) -> &'g Expression {
        &self.f.function.expressions[e]
    }

    fn span(&self, e: Handle<Expression>) -> Span {
        self.f.function.expressions.get_span(e)
    }

    fn users(&self, e: Handle<Expression>) -> &[User] {
        self.users.get(&e).map_or(&[], Vec::as_slice)
    }

    fn callee(&self, result: Handle<Expression>) -> Option<FunctionId> {
        match self.expression(result) {
            Expression::CallResult(function) => Some(FunctionId::Function(*function)),
            _ => None,
        }
    }

    /// Products in sums, with either operand as the candidate.
    fn weighed(&self) -> Vec<Weighed> {
        let mut found: Vec<Weighed> = Vec::new();
        for (product, expression) in self.f.function.expressions.iter() {
            let mut add = |tap: Handle<Expression>, weight: Option<Weight>| {
                found.extend(weight.map(|weight| Weighed {
                    product,
                    vector: None,
                    tap,
                    weight,
                }));
            };
            match expression {
                Expression::Binary {
                    op: BinaryOperator::Multiply,
                    left,
                    right,
                } if self.is_summed(product) => {
                    // If both operands sample, the candidate is the one without other readers: a
                    // splat map has many.
                    let [a, b] = [(*left, *right), (*right, *left)];
                    let is_only = |e| self.users(e) == [User::Expression(product)];
                    let (tap, weight) = match self.samples[left.index()] && is_only(*left) {
                        true => a,
                        false => b,
                    };
                    let (tap, weight) = match self.samples[tap.index()] {
                        true => (tap, weight),
                        false => (weight, tap),
                    };
                    add(tap, self.scalar(weight).map(Weight::Value));
                }
                Expression::Math {
                    fun: MathFunction::Fma,
                    arg,
                    arg1: Some(arg1),
                    ..
                } => {
                    let (tap, weight) = match self.samples[arg.index()] {
                        true => (*arg, *arg1),
                        false => (*arg1, *arg),
                    };
                    add(tap, self.scalar(weight).map(Weight::Value));
                }
                Expression::Math {
                    fun: MathFunction::Mix,
                    arg,
                    arg1: Some(arg1),
                    arg2: Some(by),
                    ..
                } => {
                    add(*arg, self.scalar(*by).map(Weight::Rest));
                    add(*arg1, self.scalar(*by).map(Weight::Value));
                }
                Expression::Math {
                    fun: MathFunction::Dot,
                    arg,
                    arg1: Some(arg1),
                    ..
                } => {
                    for (vector, weights) in [(*arg, *arg1), (*arg1, *arg)] {
                        found.extend(self.components(product, vector, weights));
                    }
                }
                _ => {}
            }
        }
        found
    }

    /// The terms of a vector that is weighted as a whole.
    fn components(
        &self,
        product: Handle<Expression>,
        vector: Handle<Expression>,
        weights: Handle<Expression>,
    ) -> Vec<Weighed> {
        let Expression::Compose { components, .. } = self.expression(vector) else {
            return Vec::new();
        };
        let scalars = components.iter().all(|c| self.is_scalar(*c));
        if !scalars
            || self.samples[weights.index()]
            || self.users(vector) != [User::Expression(product)]
        {
            return Vec::new();
        }
        let each = components.iter().enumerate();
        each.map(|(i, tap)| Weighed {
            product,
            vector: Some(vector),
            tap: *tap,
            weight: Weight::Component(weights, i as u32),
        })
        .collect()
    }

    /// Whether a product is added to a sum, possibly after scaling.
    fn is_summed(&self, product: Handle<Expression>) -> bool {
        let mut at = product;
        loop {
            let [first, more @ ..] = self.users(at) else {
                return false;
            };
            let adds = |user: &User| match user {
                User::Expression(e) => matches!(
                    self.expression(*e),
                    Expression::Binary {
                        op: BinaryOperator::Add | BinaryOperator::Subtract,
                        ..
                    }
                ),
                User::Statement(at) => {
                    let statement = self.f.statements.get(*at).statement;
                    matches!(statement, Statement::Store { .. })
                }
            };
            if adds(first) && more.iter().all(adds) {
                return true;
            }
            match (first, more) {
                (User::Expression(e), []) => match self.expression(*e) {
                    Expression::Binary {
                        op: BinaryOperator::Multiply | BinaryOperator::Divide,
                        ..
                    }
                    | Expression::Swizzle { .. }
                    | Expression::AccessIndex { .. } => at = *e,
                    _ => return false,
                },
                _ => return false,
            }
        }
    }

    fn is_scalar(&self, e: Handle<Expression>) -> bool {
        matches!(
            self.f.ty(self.graph.module(), e),
            TypeInner::Scalar(naga::Scalar {
                kind: ScalarKind::Float,
                width: 4
            })
        )
    }

    /// A scalar weight that is not constant.
    fn scalar(&self, weight: Handle<Expression>) -> Option<Handle<Expression>> {
        let weight = match self.expression(weight) {
            Expression::Splat { value, .. } => *value,
            _ => weight,
        };
        let is_constant = self.graph.rate(self.f.id, weight) == Rate::Const;
        (self.is_scalar(weight) && !is_constant).then_some(weight)
    }

    /// The term of a candidate, or why it is none.
    fn term(&self, weighed: &Weighed) -> Result<Term, &'static str> {
        let reader = weighed.vector.unwrap_or(weighed.product);
        if self.users(weighed.tap) != [User::Expression(reader)] {
            return Err("it has another use, perhaps in its own weight");
        }
        if !self.is_float(weighed.tap) {
            return Err("it is not a number or a vector");
        }
        let block = self.block(weighed.product);
        if block.is_none() {
            return Err("no statement evaluates it");
        }
        if let Some(vector) = weighed.vector
            && self.block(vector) != block
        {
            return Err("it is computed in another block than the product with its weight");
        }
        let mut alone = BTreeSet::new();
        let mut implicit = Vec::new();
        // Operands precede their readers, so a backward walk sees all readers first.
        for (e, _) in self.f.function.expressions.iter().rev() {
            let users = self.users(e);
            let is_tap = e == weighed.tap;
            let only = !users.is_empty()
                && users.iter().all(|u| match u {
                    User::Expression(u) => alone.contains(u) && !self.is_ahead(*u, e),
                    User::Statement(_) => false,
                });
            if !(is_tap || only) || self.block(e) != block {
                continue;
            }
            match self.moves(e) {
                Ok(()) => {
                    alone.insert(e);
                }
                Err(reason) if is_tap => return Err(reason),
                Err(_) => {}
            }
        }
        if !alone.contains(&weighed.tap) {
            return Err("it is computed in another block than the product with its weight");
        }
        implicit.extend(alone.iter().copied().filter(|e| self.is_implicit(*e)));
        let samples = alone.iter().any(|e| match self.expression(*e) {
            Expression::ImageSample { .. } | Expression::ImageLoad { .. } => true,
            Expression::CallResult(_) => self.callee(*e).is_some_and(|c| samples(self.graph, c)),
            _ => false,
        });
        if !samples {
            return Err(self.why_not(weighed.tap));
        }
        let cost = self.cost(alone.iter().copied());
        Ok(Term {
            function: self.f.id,
            product: weighed.product,
            vector: weighed.vector,
            tap: weighed.tap,
            weight: weighed.weight,
            alone,
            implicit,
            cost,
            span: self.span(weighed.product),
        })
    }

    /// Why the samples of an expression are not its own.
    fn why_not(&self, tap: Handle<Expression>) -> &'static str {
        let mut work = vec![tap];
        let mut seen = BTreeSet::new();
        while let Some(e) = work.pop() {
            if !seen.insert(e) {
                continue;
            }
            if let Err(reason) = self.moves(e) {
                return reason;
            }
            let below = naga_operands::of_expression(self.expression(e)).into_iter();
            work.extend(below.filter(|o| self.samples[o.index()]));
        }
        "its sample has another use"
    }

    fn is_float(&self, e: Handle<Expression>) -> bool {
        matches!(
            self.f.ty(self.graph.module(), e),
            TypeInner::Scalar(s) | TypeInner::Vector { scalar: s, .. }
                if s.kind == ScalarKind::Float && s.width == 4
        )
    }

    /// The statement whose block evaluates an expression; `None` if no block does.
    fn block(&self, e: Handle<Expression>) -> Option<Option<StmtId>> {
        let at = self.f.statements.evaluated_at(e)?;
        Some(self.f.statements.get(at).parent)
    }

    fn is_implicit(&self, e: Handle<Expression>) -> bool {
        matches!(
            self.expression(e),
            Expression::ImageSample {
                level: SampleLevel::Auto,
                gather: None,
                ..
            }
        )
    }

    /// Whether an operand is needed before the branch: the coordinate of a gradient.
    fn is_ahead(&self, reader: Handle<Expression>, operand: Handle<Expression>) -> bool {
        self.is_implicit(reader)
            && matches!(self.expression(reader), Expression::ImageSample { coordinate, .. } if *coordinate == operand)
    }

    /// Whether an expression has the same value later, behind a branch.
    fn moves(&self, e: Handle<Expression>) -> Result<(), &'static str> {
        let module = self.graph.module();
        match self.expression(e) {
            Expression::Compose { .. }
            | Expression::Access { .. }
            | Expression::AccessIndex { .. }
            | Expression::Splat { .. }
            | Expression::Swizzle { .. }
            | Expression::Unary { .. }
            | Expression::Binary { .. }
            | Expression::Select { .. }
            | Expression::Relational { .. }
            | Expression::Math { .. }
            | Expression::As { .. }
            | Expression::ImageQuery { .. } => match self.f.ty(module, e) {
                TypeInner::Pointer { .. } | TypeInner::ValuePointer { .. } => {
                    Err("it is read from a variable")
                }
                _ => Ok(()),
            },
            Expression::Load { .. } if self.f.memory.loads.get(&e).is_none_or(Vec::is_empty) => {
                Ok(())
            }
            Expression::Load { .. } => Err("it is read from a variable"),
            Expression::ImageSample {
                image,
                depth_ref,
                level,
                gather,
                ..
            } => match (gather, level) {
                (None, SampleLevel::Bias(_)) => Err("it is sampled with a level bias"),
                (None, SampleLevel::Auto) => match self.f.ty(module, *image) {
                    TypeInner::Image {
                        dim: ImageDimension::D2 | ImageDimension::D3 | ImageDimension::Cube,
                        class: ImageClass::Sampled { .. },
                        ..
                    } if depth_ref.is_none() => Ok(()),
                    _ => Err("its texture type cannot be sampled with gradients"),
                },
                _ => Ok(()),
            },
            Expression::ImageLoad { .. }
                if self.f.memory.loads.get(&e).is_none_or(Vec::is_empty) =>
            {
                Ok(())
            }
            Expression::CallResult(function) => self.call_moves(FunctionId::Function(*function), e),
            _ => Err("it depends on a derivative or on memory"),
        }
    }

    fn call_moves(
        &self,
        callee: FunctionId,
        result: Handle<Expression>,
    ) -> Result<(), &'static str> {
        let effects = self.graph.effects(callee);
        if effects.contains(&Effect::ImplicitLod) || effects.contains(&Effect::Derivative) {
            return Err(
                "a function that it calls samples at an implicit level or computes a derivative",
            );
        }
        if !effects.is_empty() {
            return Err("a function that it calls has side effects");
        }
        if self.graph.ends(callee) > Ends::Always {
            return Err("a function that it calls has a loop that may not end");
        }
        let footprint = &self.graph.function(callee).memory.footprint;
        let arguments = self
            .f
            .statements
            .evaluated_at(result)
            .map(|at| naga_operands::of_statement(self.f.statements.get(at).statement));
        let is_pointer = |e: &Handle<Expression>| {
            let ty = self.f.ty(self.graph.module(), *e);
            ty.pointer_space().is_some()
        };
        let has_pointer = arguments.iter().flatten().any(is_pointer);
        match has_pointer || !footprint.reads.is_empty() || !footprint.writes.is_empty() {
            true => Err("a function that it calls reads or writes variables"),
            false => Ok(()),
        }
    }

    /// Static cost of expressions, including calls.
    fn cost(&self, of: impl Iterator<Item = Handle<Expression>>) -> f64 {
        let of: BTreeSet<Handle<Expression>> = of.collect();
        let module = self.graph.module();
        let own = self.f.own_cost(module, |_| true, |e| of.contains(&e))
            - self.f.own_cost(module, |_| true, |_| false);
        let calls: f64 = of
            .iter()
            .filter_map(|e| {
                let at = self.f.statements.evaluated_at(*e)?;
                Some(self.graph.cost(self.callee(*e)?) * self.f.times[at.index()])
            })
            .sum();
        own + calls
    }
}

/// Whether a function or one of its callees samples a texture.
fn samples(graph: &Graph<'_>, function: FunctionId) -> bool {
    let mut below = graph.functions().iter();
    below.any(|f| {
        graph.reaches(function, f.id)
            && f.function.expressions.iter().any(|(_, e)| {
                matches!(
                    e,
                    Expression::ImageSample { .. } | Expression::ImageLoad { .. }
                )
            })
    })
}
