//! Rebuilds a function from its slice.

use std::collections::BTreeMap;

use naga::{
    Block, Expression, Function, Handle, Literal, LocalVariable, Module, Range, Scalar, Span,
    Statement, SwitchCase, Type, TypeInner,
};

use super::interface::{self, Narrowed, Placement, Returned};
use super::members::Slot;
use crate::graph::{FunctionGraph, FunctionId, Graph, StmtId, operands};
use crate::slice::{Coverage, Part, Slice, components};

pub fn place(graph: &Graph<'_>, slice: &Slice, onto: &Module, placement: &Placement<'_>) -> Module {
    let mut module = onto.clone();
    let mut placed: Vec<Option<Placed>> = Vec::new();
    for part in &slice.parts {
        let became = match part.function {
            FunctionId::Function(h) if part.coverage == Coverage::Whole => Some(Placed {
                function: h,
                arguments: BTreeMap::new(),
                returned: Returned::Whole,
            }),
            FunctionId::Function(h) => {
                let copier = Copier::new(graph, part, &slice.parts, &placed);
                let (mut function, arguments, returned) =
                    copier.callee(&mut module, placement.suffix);
                let name = graph.module().functions[h].name.as_deref();
                function.name = name.map(|n| free_name(&module, n, placement.suffix));
                let span = graph.module().functions.get_span(h);
                Some(Placed {
                    function: module.functions.append(function, span),
                    arguments,
                    returned,
                })
            }
            FunctionId::EntryPoint(index) => {
                let original = &graph.module().entry_points[index];
                let copier = Copier::new(graph, part, &slice.parts, &placed);
                let mut function = copier.entry(&mut module, slice, placement);
                function.name = Some(placement.name.to_owned());
                let entry = naga::EntryPoint {
                    name: placement.name.to_owned(),
                    function,
                    ..original.clone()
                };
                module.entry_points.push(entry);
                None
            }
        };
        placed.push(became);
    }
    module
}

/// A rebuilt part of a slice.
#[derive(Clone, Debug)]
pub(super) struct Placed {
    pub function: Handle<Function>,
    /// Arguments of the original of which only some members are passed.
    pub arguments: BTreeMap<u32, Narrowed>,
    /// The part of the original's result that is returned.
    pub returned: Returned,
}

/// A free function name: `{name}_{suffix}`, with a letter added if it is taken.
pub(crate) fn free_name(module: &Module, name: &str, suffix: &str) -> String {
    let taken = |n: &str| {
        module
            .functions
            .iter()
            .any(|(_, f)| f.name.as_deref() == Some(n))
    };
    let first = format!("{name}_{suffix}");
    if !taken(&first) {
        return first;
    }
    // naga's writers append their own number to a name that ends in a digit.
    let letters = ('b'..='z').map(|letter| format!("{first}_{letter}"));
    letters
        .into_iter()
        .find(|name| !taken(name))
        .unwrap_or(first)
}

pub(super) struct Copier<'a, 'p> {
    pub(super) module: &'p Module,
    pub(super) f: &'a FunctionGraph<'p>,
    pub(super) part: &'a Part,
    pub(super) parts: &'a [Part],
    /// The rebuilt function of each part of the slice.
    pub(super) placed: &'a [Option<Placed>],
    pub(super) out: Function,
    pub(super) map: Vec<Option<Handle<Expression>>>,
    pub(super) locals: BTreeMap<Handle<LocalVariable>, Handle<LocalVariable>>,
    /// New index of each kept argument.
    pub(super) arguments: Vec<Option<u32>>,
    pub(super) narrowed: BTreeMap<u32, Narrowed>,
    /// Call results of which the callee returns only a part.
    pub(super) results: BTreeMap<Handle<Expression>, Returned>,
    /// Narrowed arguments and results, completed with zeros for users of the whole.
    pub(super) whole: BTreeMap<Handle<Expression>, Handle<Expression>>,
    pub(super) zeros: BTreeMap<Handle<Type>, Handle<Expression>>,
    zero_scalars: BTreeMap<Scalar, Handle<Expression>>,
    pub(super) returned: Returned,
    /// Expressions that only a narrowed `return` reads; it reads their parts instead.
    pub(super) dissolved: Vec<bool>,
    pub(super) next: usize,
}

impl<'a, 'p> Copier<'a, 'p> {
    fn new(
        graph: &'a Graph<'p>,
        part: &'a Part,
        parts: &'a [Part],
        placed: &'a [Option<Placed>],
    ) -> Self {
        let f = graph.function(part.function);
        let mut arguments = Vec::new();
        let mut count = 0;
        for need in &part.kept.arguments {
            arguments.push(need.as_ref().map(|_| {
                count += 1;
                count - 1
            }));
        }
        Self {
            module: graph.module(),
            f,
            part,
            parts,
            placed,
            out: Function {
                diagnostic_filter_leaf: f.function.diagnostic_filter_leaf,
                ..Function::default()
            },
            map: vec![None; f.function.expressions.len()],
            locals: BTreeMap::new(),
            arguments,
            narrowed: BTreeMap::new(),
            results: BTreeMap::new(),
            whole: BTreeMap::new(),
            zeros: BTreeMap::new(),
            zero_scalars: BTreeMap::new(),
            returned: Returned::Whole,
            dissolved: vec![false; f.function.expressions.len()],
            next: 0,
        }
    }

    fn callee(
        mut self,
        module: &mut Module,
        suffix: &str,
    ) -> (Function, BTreeMap<u32, Narrowed>, Returned) {
        self.narrow_arguments(module, suffix);
        self.returned = match (&self.part.demand.result, &self.f.function.result) {
            (Some(need), Some(result)) => {
                let (result, returned) = interface::callee_result(module, result, need, suffix);
                self.out.result = Some(result);
                returned
            }
            _ => Returned::Nothing,
        };
        self.dissolve();
        let (narrowed, returned) = (self.narrowed.clone(), self.returned.clone());
        (self.finish(), narrowed, returned)
    }

    fn entry(mut self, module: &mut Module, slice: &Slice, placement: &Placement<'_>) -> Function {
        self.narrow_arguments(module, placement.suffix);
        let result = self.f.function.result.as_ref();
        (self.out.result, self.returned) =
            interface::result(module, result, &slice.outputs, placement);
        self.dissolve();
        self.finish()
    }

    fn narrow_arguments(&mut self, module: &mut Module, suffix: &str) {
        let arguments = self.f.function.arguments.iter();
        for (i, (argument, need)) in arguments.zip(&self.part.kept.arguments).enumerate() {
            if let Some(need) = need {
                let (argument, narrowed) = interface::argument(module, argument, need, suffix);
                self.out.arguments.push(argument);
                if let Some(narrowed) = narrowed {
                    self.narrowed.insert(i as u32, narrowed);
                }
            }
        }
    }

    fn finish(mut self) -> Function {
        let f = self.f.function;
        // Initialisers are constant expressions outside of any `Emit`.
        let mut constant = vec![false; self.map.len()];
        for (e, expression) in f.expressions.iter() {
            if let Expression::LocalVariable(v) = expression
                && self.part.kept.expressions[e.index()].is_some()
                && let Some(init) = f.local_variables[*v].init
            {
                constant[init.index()] = true;
            }
        }
        for (e, expression) in f.expressions.iter().rev() {
            if constant[e.index()] {
                for operand in operands::of_expression(expression) {
                    constant[operand.index()] = true;
                }
            }
        }
        for (e, expression) in f.expressions.iter() {
            let kept = self.part.kept.expressions[e.index()].is_some();
            let unevaluated = self.f.statements.evaluated_at(e).is_none();
            if constant[e.index()] || (kept && unevaluated) {
                self.copy_expression(e);
            }
            // Zeros for unused parts must be outside of any `Emit`.
            if let (true, Expression::Compose { ty, components }) =
                (kept && !self.dissolved[e.index()], expression)
            {
                self.zeros_of(*ty, components);
            }
        }
        let mut body = Block::new();
        self.reassemble_arguments(&mut body);
        self.block(&f.body, &mut body);
        if self.out.result.is_none() {
            while matches!(body.last(), Some(Statement::Return { value: None })) {
                body.cull(body.len() - 1..);
            }
        }
        if let Some(ty) = self.out.result.as_ref().map(|r| r.ty) {
            // Code behind a loop that only returns never runs, so the slice drops it. But the text
            // does not parse without a return.
            naga::proc::ensure_block_returns(&mut body);
            self.return_something(&mut body, ty);
        }
        self.out.body = body;
        for (e, name) in &f.named_expressions {
            if let Some(new) = self.map[e.index()] {
                self.out.named_expressions.insert(new, name.clone());
            }
        }
        self.out
    }

    /// Gives bare returns at unreachable block ends a value.
    fn return_something(&mut self, block: &mut Block, ty: Handle<Type>) {
        match block.last_mut() {
            Some(Statement::Return {
                value: value @ None,
            }) => {
                *value = Some(self.append(Expression::ZeroValue(ty), Span::UNDEFINED));
            }
            Some(
                last @ (Statement::Block(_) | Statement::If { .. } | Statement::Switch { .. }),
            ) => {
                for inner in operands::blocks_mut(last) {
                    self.return_something(inner, ty);
                }
            }
            _ => {}
        }
    }

    pub(super) fn append(&mut self, expression: Expression, span: Span) -> Handle<Expression> {
        self.out.expressions.append(expression, span)
    }

    pub(super) fn zero(&mut self, ty: Handle<Type>) -> Handle<Expression> {
        if let Some(zero) = self.zeros.get(&ty) {
            return *zero;
        }
        let zero = self.append(Expression::ZeroValue(ty), Span::UNDEFINED);
        self.zeros.insert(ty, zero);
        zero
    }

    /// Creates the zeros for [`Self::composed`].
    fn zeros_of(&mut self, ty: Handle<Type>, components: &[Handle<Expression>]) {
        let kept = |c: &Handle<Expression>| self.part.kept.expressions[c.index()].is_some();
        match &self.module.types[ty].inner {
            TypeInner::Struct { members, .. } => {
                for (component, member) in components.iter().zip(members) {
                    if !kept(component) {
                        self.zero(member.ty);
                    }
                }
            }
            TypeInner::Vector { scalar, .. } if !components.iter().all(kept) => {
                self.zero_scalar(*scalar);
            }
            _ => {}
        }
    }

    /// The components of a struct or vector, with zeros for unused ones.
    fn composed(
        &mut self,
        ty: Handle<Type>,
        components: &[Handle<Expression>],
    ) -> Vec<Handle<Expression>> {
        let mut copied = Vec::new();
        for (i, component) in components.iter().enumerate() {
            match (self.operand(*component), &self.module.types[ty].inner) {
                (Some(new), _) => copied.push(new),
                (None, TypeInner::Struct { members, .. }) => {
                    copied.push(self.zero(members[i].ty));
                }
                (None, TypeInner::Vector { scalar, .. }) => {
                    let zero = self.zero_scalar(*scalar).unwrap_or(*component);
                    let width = components::width(self.f.ty(self.module, *component));
                    copied.extend((0..width.unwrap_or(1)).map(|_| zero));
                }
                (None, _) => copied.push(*component),
            }
        }
        copied
    }

    fn zero_scalar(&mut self, scalar: Scalar) -> Option<Handle<Expression>> {
        if let Some(zero) = self.zero_scalars.get(&scalar) {
            return Some(*zero);
        }
        let zero = Expression::Literal(Literal::zero(scalar)?);
        let zero = self.append(zero, Span::UNDEFINED);
        self.zero_scalars.insert(scalar, zero);
        Some(zero)
    }

    /// The copy of an expression. The copy of a dropped operand must already exist.
    pub(super) fn copied(&self, e: Handle<Expression>) -> Option<Handle<Expression>> {
        self.map[e.index()]
    }

    pub(super) fn emit(&mut self, start: usize, span: Span, body: &mut Block) {
        if self.out.expressions.len() > start {
            let range: Range<Expression> = self.out.expressions.range_from(start);
            body.push(Statement::Emit(range), span);
        }
    }

    fn copy_expression(&mut self, e: Handle<Expression>) {
        if self.map[e.index()].is_some() {
            return;
        }
        let span = self.f.function.expressions.get_span(e);
        let mut copy = self.f.function.expressions[e].clone();
        match &mut copy {
            Expression::LocalVariable(v) => *v = self.local(*v),
            Expression::FunctionArgument(i) => {
                if let Some(new) = self.arguments[*i as usize] {
                    *i = new;
                }
            }
            Expression::AccessIndex { base, index } => match self.slot(*base, *index) {
                Some(Slot::Whole(value)) => {
                    self.map[e.index()] = Some(value);
                    return;
                }
                Some(Slot::Member(new, at)) => (*base, *index) = (new, at),
                None => {}
            },
            Expression::Compose { ty, components } => {
                *components = self.composed(*ty, components);
            }
            other => operands::map_expression(other, &mut |o| {
                if let Some(new) = self.operand(*o) {
                    *o = new;
                }
            }),
        }
        let new = self.append(copy, span);
        self.map[e.index()] = Some(new);
    }

    fn local(&mut self, v: Handle<LocalVariable>) -> Handle<LocalVariable> {
        if let Some(new) = self.locals.get(&v) {
            return *new;
        }
        let original = &self.f.function.local_variables[v];
        let init = original.init.and_then(|i| {
            self.copy_constant(i);
            self.copied(i)
        });
        let new = self.out.local_variables.append(
            LocalVariable {
                init,
                ..original.clone()
            },
            self.f.function.local_variables.get_span(v),
        );
        self.locals.insert(v, new);
        new
    }

    /// Copies an initialiser and its operands, which may follow the variable's own expression in
    /// the arena.
    fn copy_constant(&mut self, e: Handle<Expression>) {
        for operand in operands::of_expression(&self.f.function.expressions[e]) {
            self.copy_constant(operand);
        }
        self.copy_expression(e);
    }

    fn block(&mut self, block: &Block, out: &mut Block) {
        for (statement, span) in block.span_iter() {
            let id = StmtId::from(self.next);
            let end = self.f.statements.get(id).end.index();
            if self.part.kept.statements[id.index()] {
                self.next += 1;
                self.statement(id, statement, *span, out);
            }
            self.next = end;
        }
    }

    fn inner(&mut self, block: &Block) -> Block {
        let mut out = Block::new();
        self.block(block, &mut out);
        out
    }

    pub(super) fn value(&self, e: Handle<Expression>) -> Handle<Expression> {
        self.operand(e).unwrap_or(e)
    }

    fn statement(&mut self, id: StmtId, statement: &Statement, span: Span, out: &mut Block) {
        let copy = match statement {
            Statement::Emit(range) => {
                let start = self.out.expressions.len();
                for e in range.clone() {
                    if self.part.kept.expressions[e.index()].is_some() && !self.dissolved[e.index()]
                    {
                        self.copy_expression(e);
                    }
                }
                return self.emit(start, span, out);
            }
            Statement::Block(block) => Statement::Block(self.inner(block)),
            Statement::If {
                condition,
                accept,
                reject,
            } => Statement::If {
                condition: self.value(*condition),
                accept: self.inner(accept),
                reject: self.inner(reject),
            },
            Statement::Switch { selector, cases } => Statement::Switch {
                selector: self.value(*selector),
                cases: cases
                    .iter()
                    .map(|case| SwitchCase {
                        value: case.value,
                        body: self.inner(&case.body),
                        fall_through: case.fall_through,
                    })
                    .collect(),
            },
            Statement::Loop {
                body,
                continuing,
                break_if,
            } => Statement::Loop {
                body: self.inner(body),
                continuing: self.inner(continuing),
                break_if: break_if.map(|e| self.value(e)),
            },
            Statement::Return { value } => Statement::Return {
                value: value.and_then(|value| self.returned(value, out)),
            },
            Statement::Call {
                function: _,
                arguments,
                result,
            } => return self.call(id, arguments, *result, span, out),
            other => {
                let mut copy = operands::shell(other);
                operands::map_statement(&mut copy, &mut |e| *e = self.value(*e));
                if let Some(result) = operands::result_mut(&mut copy) {
                    self.copy_expression(*result);
                    *result = self.value(*result);
                }
                copy
            }
        };
        out.push(copy, span);
    }

    fn call(
        &mut self,
        id: StmtId,
        arguments: &[Handle<Expression>],
        result: Option<Handle<Expression>>,
        span: Span,
        out: &mut Block,
    ) {
        let (Some(&part), Some(asked)) = (self.part.calls.get(&id), self.part.kept.calls.get(&id))
        else {
            return;
        };
        let Some(placed) = &self.placed[part] else {
            return;
        };
        let function = placed.function;
        // The caller's needs decide which parameters remain.
        let mut passed = Vec::new();
        for (i, (argument, need)) in arguments
            .iter()
            .zip(&self.parts[part].kept.arguments)
            .enumerate()
        {
            if need.is_some() {
                passed.push(match placed.arguments.get(&(i as u32)) {
                    Some(narrowed) => self.pass_members(*argument, narrowed, span, out),
                    None => self.value(*argument),
                });
            }
        }
        let arguments = passed;
        let asked = asked.result.is_some();
        let provides = result;
        let result = result.filter(|_| asked).map(|r| {
            let new = self.append(
                Expression::CallResult(function),
                self.f.function.expressions.get_span(r),
            );
            self.map[r.index()] = Some(new);
            new
        });
        out.push(
            Statement::Call {
                function,
                arguments,
                result,
            },
            span,
        );
        if let (Some(original), Some(new)) = (provides, result) {
            self.narrow_result(original, new, &placed.returned, span, out);
        }
    }
}
