//! A function rebuilt from the part of it that a slice keeps.

use std::collections::BTreeMap;

use naga::{
    Block, Expression, Function, Handle, LocalVariable, Module, Range, Span, Statement, SwitchCase,
    Type, TypeInner,
};

use super::interface::{self, Narrowed, Placement, Returned};
use crate::graph::{FunctionGraph, FunctionId, Graph, StmtId, operands};
use crate::slice::{Coverage, Part, Slice};

pub fn place(graph: &Graph<'_>, slice: &Slice, onto: &Module, placement: &Placement<'_>) -> Module {
    let mut module = onto.clone();
    // The function each part became.
    let mut placed: Vec<Option<Handle<Function>>> = Vec::new();
    for part in &slice.parts {
        let handle = match part.function {
            FunctionId::Function(h) if part.coverage == Coverage::Whole => Some(h),
            FunctionId::Function(h) => {
                let mut function = Copier::new(graph, part, &slice.parts, &placed).callee();
                let name = graph.module().functions[h].name.as_deref();
                function.name = name.map(|n| free_name(&module, n, placement.suffix));
                Some(
                    module
                        .functions
                        .append(function, graph.module().functions.get_span(h)),
                )
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
        placed.push(handle);
    }
    module
}

fn free_name(module: &Module, name: &str, suffix: &str) -> String {
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
    let mut n = 2;
    loop {
        let next = format!("{first}{n}");
        if !taken(&next) {
            return next;
        }
        n += 1;
    }
}

struct Copier<'a, 'p> {
    module: &'p Module,
    f: &'a FunctionGraph<'p>,
    part: &'a Part,
    parts: &'a [Part],
    /// The function each part of the slice became.
    placed: &'a [Option<Handle<Function>>],
    out: Function,
    map: Vec<Option<Handle<Expression>>>,
    locals: BTreeMap<Handle<LocalVariable>, Handle<LocalVariable>>,
    /// New index of each kept argument.
    arguments: Vec<Option<u32>>,
    narrowed: BTreeMap<u32, Narrowed>,
    /// A narrowed argument put together again with zeros, for those who use it whole.
    reassembled: BTreeMap<u32, Handle<Expression>>,
    zeros: BTreeMap<Handle<Type>, Handle<Expression>>,
    returned: Returned,
    /// Expressions only a narrowed `return` reads: it reads their parts instead.
    dissolved: Vec<bool>,
    next: usize,
}

impl<'a, 'p> Copier<'a, 'p> {
    fn new(
        graph: &'a Graph<'p>,
        part: &'a Part,
        parts: &'a [Part],
        placed: &'a [Option<Handle<Function>>],
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
            reassembled: BTreeMap::new(),
            zeros: BTreeMap::new(),
            returned: Returned::Whole,
            dissolved: vec![false; f.function.expressions.len()],
            next: 0,
        }
    }

    fn callee(mut self) -> Function {
        let original = self.f.function;
        self.out.arguments = original
            .arguments
            .iter()
            .zip(&self.part.kept.arguments)
            .filter(|(_, need)| need.is_some())
            .map(|(a, _)| a.clone())
            .collect();
        match self.part.demand.result {
            Some(_) => self.out.result.clone_from(&original.result),
            None => self.returned = Returned::Nothing,
        }
        self.finish()
    }

    fn entry(mut self, module: &mut Module, slice: &Slice, placement: &Placement<'_>) -> Function {
        let original = self.f.function;
        for (i, (argument, need)) in original
            .arguments
            .iter()
            .zip(&self.part.kept.arguments)
            .enumerate()
        {
            if let Some(need) = need {
                let (argument, narrowed) =
                    interface::argument(module, argument, need, placement.suffix);
                self.out.arguments.push(argument);
                if let Some(narrowed) = narrowed {
                    self.narrowed.insert(i as u32, narrowed);
                }
            }
        }
        let (result, returned) =
            interface::result(module, original.result.as_ref(), &slice.outputs, placement);
        self.out.result = result;
        self.returned = returned;
        self.dissolve();
        self.finish()
    }

    /// What only a narrowed `return` reads need not be built: a `Compose` gives its components, a load of a variable becomes loads of its
    /// members where nothing happens between the two.
    fn dissolve(&mut self) {
        if !matches!(self.returned, Returned::Member(_) | Returned::Members(..)) {
            return;
        }
        let mut uses = vec![0_usize; self.map.len()];
        let mut returned = Vec::new();
        let mut last_emit = None;
        for (id, node) in self.f.statements.iter() {
            if let Statement::Return { value: Some(value) } = node.statement
                && self.part.kept.statements[id.index()]
            {
                returned.push((*value, last_emit));
            }
            last_emit = matches!(node.statement, Statement::Emit(_)).then_some(id);
            if self.part.kept.statements[id.index()] {
                for e in operands::of_statement(node.statement) {
                    uses[e.index()] += 1;
                }
            }
        }
        for (e, expression) in self.f.function.expressions.iter() {
            if self.part.kept.expressions[e.index()].is_some() {
                for operand in operands::of_expression(expression) {
                    uses[operand.index()] += 1;
                }
            }
        }
        for (value, emit) in returned {
            let alone = uses[value.index()] == 1;
            self.dissolved[value.index()] = match &self.f.function.expressions[value] {
                Expression::Compose { .. } => alone,
                Expression::Load { .. } => {
                    alone && emit.is_some() && self.f.statements.evaluated_at(value) == emit
                }
                _ => false,
            };
        }
    }

    fn finish(mut self) -> Function {
        let f = self.f.function;
        // Initialisers are constant expressions outside any `Emit`.
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
            // Zeros for what a struct is not asked for must not come to lie within an `Emit`.
            if let (true, Expression::Compose { ty, components }) =
                (kept && !self.dissolved[e.index()], expression)
                && let TypeInner::Struct { members, .. } = &self.module.types[*ty].inner
            {
                for (component, member) in components.iter().zip(members) {
                    if self.part.kept.expressions[component.index()].is_none() {
                        self.zero(member.ty);
                    }
                }
            }
        }
        let mut body = Block::new();
        self.reassemble(&mut body);
        self.block(&f.body, &mut body);
        if self.out.result.is_none() {
            while matches!(body.last(), Some(Statement::Return { value: None })) {
                body.cull(body.len() - 1..);
            }
        }
        self.out.body = body;
        for (e, name) in &f.named_expressions {
            if let Some(new) = self.map[e.index()] {
                self.out.named_expressions.insert(new, name.clone());
            }
        }
        self.out
    }

    fn append(&mut self, expression: Expression, span: Span) -> Handle<Expression> {
        self.out.expressions.append(expression, span)
    }

    fn zero(&mut self, ty: Handle<Type>) -> Handle<Expression> {
        if let Some(zero) = self.zeros.get(&ty) {
            return *zero;
        }
        let zero = self.append(Expression::ZeroValue(ty), Span::UNDEFINED);
        self.zeros.insert(ty, zero);
        zero
    }

    /// The copy of an expression: for an operand that is not kept, whatever was made of it must be there already.
    fn copied(&self, e: Handle<Expression>) -> Option<Handle<Expression>> {
        self.map[e.index()]
    }

    /// Builds narrowed struct arguments up again for uses of the whole struct.
    fn reassemble(&mut self, body: &mut Block) {
        let mut whole = Vec::new();
        for (argument, narrowed) in self.narrowed.clone() {
            let is_argument = |e: Handle<Expression>| matches!(self.f.function.expressions[e], Expression::FunctionArgument(i) if i == argument);
            let by_expression = self.f.function.expressions.iter().any(|(e, expression)| {
                self.part.kept.expressions[e.index()].is_some()
                    && !matches!(expression, Expression::AccessIndex { .. })
                    && operands::of_expression(expression)
                        .into_iter()
                        .any(is_argument)
            });
            let by_statement = self.f.statements.iter().any(|(id, node)| {
                self.part.kept.statements[id.index()]
                    && operands::of_statement(node.statement)
                        .into_iter()
                        .any(is_argument)
            });
            if by_expression || by_statement {
                whole.push((argument, narrowed));
            }
        }
        for (argument, narrowed) in whole {
            let TypeInner::Struct { members, .. } = &self.module.types[narrowed.whole].inner else {
                continue;
            };
            let Some(base) = self
                .f
                .function
                .expressions
                .iter()
                .find_map(|(e, expression)| {
                    matches!(expression, Expression::FunctionArgument(i) if *i == argument)
                        .then(|| self.copied(e))
                        .flatten()
                })
            else {
                continue;
            };
            let zeros: Vec<_> = members
                .iter()
                .enumerate()
                .map(|(i, m)| (!narrowed.members.contains(&(i as u32))).then(|| self.zero(m.ty)))
                .collect();
            let start = self.out.expressions.len();
            let mut index = 0;
            let components = zeros
                .into_iter()
                .map(|zero| {
                    zero.unwrap_or_else(|| {
                        index += 1;
                        self.append(
                            Expression::AccessIndex {
                                base,
                                index: index - 1,
                            },
                            Span::UNDEFINED,
                        )
                    })
                })
                .collect();
            let built = self.append(
                Expression::Compose {
                    ty: narrowed.whole,
                    components,
                },
                Span::UNDEFINED,
            );
            self.emit(start, Span::UNDEFINED, body);
            self.reassembled.insert(argument, built);
        }
    }

    fn emit(&mut self, start: usize, span: Span, body: &mut Block) {
        if self.out.expressions.len() > start {
            let range: Range<Expression> = self.out.expressions.range_from(start);
            body.push(Statement::Emit(range), span);
        }
    }

    /// The copy of an operand as its user wants it: a narrowed argument's whole where the user is not a member access.
    fn operand(&self, e: Handle<Expression>) -> Option<Handle<Expression>> {
        if let Expression::FunctionArgument(i) = self.f.function.expressions[e]
            && let Some(whole) = self.reassembled.get(&i)
        {
            return Some(*whole);
        }
        self.copied(e)
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
            Expression::AccessIndex { base, index } => {
                let narrowed = match self.f.function.expressions[*base] {
                    Expression::FunctionArgument(i) => self.narrowed.get(&i),
                    _ => None,
                };
                if let Some(narrowed) = narrowed
                    && let Some(new) = narrowed.members.iter().position(|m| m == index)
                {
                    *index = new as u32;
                }
                if let Some(new) = self.copied(*base) {
                    *base = new;
                }
            }
            Expression::Compose { ty, components } => {
                let members = match &self.module.types[*ty].inner {
                    TypeInner::Struct { members, .. } => members.as_slice(),
                    _ => &[],
                };
                let copied: Vec<_> = components
                    .iter()
                    .enumerate()
                    .map(|(i, c)| match (self.operand(*c), members.get(i)) {
                        (Some(new), _) => new,
                        (None, Some(member)) => self.zero(member.ty),
                        (None, None) => *c,
                    })
                    .collect();
                *components = copied;
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

    /// Copies an initialiser and its operands, which may come later in the arena than the variable's own expression.
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

    fn value(&self, e: Handle<Expression>) -> Handle<Expression> {
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
        let Some(function) = self.placed[part] else {
            return;
        };
        // Which parameters the callee still has follows from what it needs of its caller.
        let arguments = self.parts[part]
            .kept
            .arguments
            .iter()
            .zip(arguments)
            .filter(|(need, _)| need.is_some())
            .map(|(_, a)| self.value(*a))
            .collect();
        let result = result.filter(|_| asked.result.is_some()).map(|r| {
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
    }

    /// The value a `return` gives in place of the author's.
    fn returned(
        &mut self,
        value: Handle<Expression>,
        out: &mut Block,
    ) -> Option<Handle<Expression>> {
        let members = match &self.returned {
            Returned::Nothing => return None,
            Returned::Whole => return Some(self.value(value)),
            Returned::Member(m) => vec![*m],
            Returned::Members(members, _) => members.clone(),
        };
        let span = self.f.function.expressions.get_span(value);
        let start = self.out.expressions.len();
        let parts: Vec<Handle<Expression>> = match &self.f.function.expressions[value] {
            Expression::Compose { components, .. } if self.dissolved[value.index()] => members
                .iter()
                .map(|m| self.value(components[*m as usize]))
                .collect(),
            Expression::Load { pointer } if self.dissolved[value.index()] => {
                let base = self.value(*pointer);
                members
                    .iter()
                    .map(|m| {
                        let pointer =
                            self.append(Expression::AccessIndex { base, index: *m }, span);
                        self.append(Expression::Load { pointer }, span)
                    })
                    .collect()
            }
            _ => {
                let base = self.value(value);
                members
                    .iter()
                    .map(|m| self.append(Expression::AccessIndex { base, index: *m }, span))
                    .collect()
            }
        };
        let result = match (&self.returned, parts.as_slice()) {
            (Returned::Members(_, ty), _) => {
                let ty = *ty;
                self.append(
                    Expression::Compose {
                        ty,
                        components: parts,
                    },
                    span,
                )
            }
            (_, parts) => *parts.first()?,
        };
        self.emit(start, span, out);
        Some(result)
    }
}
