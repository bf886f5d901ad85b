//! Rebuilds a function from its slice.

use std::collections::BTreeMap;

use naga::{
    Arena, Block, Expression, Function, Handle, Literal, LocalVariable, Module, Range, Scalar,
    Span, Statement, Type, TypeInner,
};

use super::interface::{self, Narrowed, Placement, Returned};
use super::members::MemberCopy;
use naga_edit::copy::{CopyFunction, Copying};
use naga_edit::returns;
use naga_edit::writer::FunctionWriter;
use preshade_dataflow::graph::{FunctionGraph, FunctionId, Graph, StmtId};
use preshade_dataflow::slice::{Coverage, Part, Slice, components};

pub(crate) fn place(
    graph: &Graph<'_>,
    slice: &Slice,
    onto: &Module,
    placement: &Placement<'_>,
) -> Module {
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
                let copier = SliceCopier::new(graph, part, &slice.parts, &placed);
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
                let copier = SliceCopier::new(graph, part, &slice.parts, &placed);
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
pub struct Placed {
    pub function: Handle<Function>,
    /// Arguments of the original that are passed in part: only some members.
    pub arguments: BTreeMap<u32, Narrowed>,
    /// The part of the original's result that is returned.
    pub returned: Returned,
}

/// A free function name: `{name}_{suffix}`, with a letter added if it is taken.
pub fn free_name(module: &Module, name: &str, suffix: &str) -> String {
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

pub(super) struct SliceCopier<'a, 'p> {
    pub(super) module: &'p Module,
    pub(super) f: &'a FunctionGraph<'p>,
    pub(super) part: &'a Part,
    pub(super) parts: &'a [Part],
    /// The rebuilt function of each part of the slice.
    pub(super) placed: &'a [Option<Placed>],
    pub(super) copying: Copying<'p>,
    pub(super) locals: BTreeMap<Handle<LocalVariable>, Handle<LocalVariable>>,
    /// New index of each kept argument.
    pub(super) arguments: Vec<Option<u32>>,
    pub(super) narrowed: BTreeMap<u32, Narrowed>,
    /// Call results that the callee returns only in part.
    pub(super) results: BTreeMap<Handle<Expression>, Returned>,
    /// Narrowed arguments and results, completed with zeros for users of the whole.
    pub(super) whole: BTreeMap<Handle<Expression>, Handle<Expression>>,
    pub(super) zeros: BTreeMap<Handle<Type>, Handle<Expression>>,
    zero_scalars: BTreeMap<Scalar, Handle<Expression>>,
    pub(super) returned: Returned,
    /// Expressions that only a narrowed `return` reads; it reads their parts instead.
    pub(super) dissolved: Vec<bool>,
    /// Number of the next original statement.
    next: usize,
}

impl<'a, 'p> SliceCopier<'a, 'p> {
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
        let out = Function {
            diagnostic_filter_leaf: f.function.diagnostic_filter_leaf,
            ..Function::default()
        };
        Self {
            module: graph.module(),
            f,
            part,
            parts,
            placed,
            copying: Copying::new(f.function, FunctionWriter::of(out)),
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
                self.copying.writer.function.result = Some(result);
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
        (self.copying.writer.function.result, self.returned) =
            interface::result(module, result, &slice.outputs, placement);
        self.dissolve();
        self.finish()
    }

    fn narrow_arguments(&mut self, module: &mut Module, suffix: &str) {
        let arguments = self.f.function.arguments.iter();
        for (i, (argument, need)) in arguments.zip(&self.part.kept.arguments).enumerate() {
            if let Some(need) = need {
                let (argument, narrowed) = interface::argument(module, argument, need, suffix);
                self.copying.writer.function.arguments.push(argument);
                if let Some(narrowed) = narrowed {
                    self.narrowed.insert(i as u32, narrowed);
                }
            }
        }
    }

    fn finish(mut self) -> Function {
        let f = self.f.function;
        // Initialisers are constant expressions outside of any `Emit`.
        let mut constant = vec![false; f.expressions.len()];
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
                for operand in naga_operands::of_expression(expression) {
                    constant[operand.index()] = true;
                }
            }
        }
        for (e, expression) in f.expressions.iter() {
            let kept = self.part.kept.expressions[e.index()].is_some();
            let unevaluated = self.f.statements.evaluated_at(e).is_none();
            if constant[e.index()] || (kept && unevaluated) {
                self.expression(e);
            }
            // Zeros for unused parts must be outside of any `Emit`.
            if let (true, Expression::Compose { ty, components }) =
                (kept && !self.dissolved[e.index()], expression)
            {
                self.zeros_of(*ty, components);
            }
        }
        self.reassemble_arguments();
        self.block(&f.body);
        let mut function = self.copying.finish();
        let Some(result) = &function.result else {
            returns::drop_last(&mut function.body);
            return function;
        };
        // Code behind a loop that only returns never runs, so the slice drops it. But the text does
        // not parse without a return.
        naga::proc::ensure_block_returns(&mut function.body);
        return_something(&mut function.expressions, &mut function.body, result.ty);
        function
    }

    pub(super) fn append(&mut self, expression: Expression, span: Span) -> Handle<Expression> {
        self.copying.writer.append(expression, span)
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
            match (self.whole_copy(*component), &self.module.types[ty].inner) {
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
    pub(super) fn copy_of(&self, e: Handle<Expression>) -> Option<Handle<Expression>> {
        self.copying.copies.get(e)
    }

    fn local(&mut self, v: Handle<LocalVariable>) -> Handle<LocalVariable> {
        if let Some(new) = self.locals.get(&v) {
            return *new;
        }
        let original = &self.f.function.local_variables[v];
        let init = original.init.and_then(|i| {
            self.copy_constant(i);
            self.copy_of(i)
        });
        let new = self.copying.writer.function.local_variables.append(
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
        for operand in naga_operands::of_expression(&self.f.function.expressions[e]) {
            self.copy_constant(operand);
        }
        self.expression(e);
    }

    fn call(
        &mut self,
        id: StmtId,
        arguments: &[Handle<Expression>],
        result: Option<Handle<Expression>>,
        span: Span,
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
                    Some(narrowed) => self.pass_members(*argument, narrowed, span),
                    None => self.operand(*argument),
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
            self.copying.copies.insert(r, new);
            new
        });
        let call = Statement::Call {
            function,
            arguments,
            result,
        };
        self.copying.writer.statement(call, span);
        if let (Some(original), Some(new)) = (provides, result) {
            self.narrow_result(original, new, &placed.returned, span);
        }
    }
}

impl<'p> CopyFunction<'p> for SliceCopier<'_, 'p> {
    fn copying(&mut self) -> &mut Copying<'p> {
        &mut self.copying
    }

    fn expression(&mut self, e: Handle<Expression>) {
        if self.copy_of(e).is_some() {
            return;
        }
        let mut copy = self.f.function.expressions[e].clone();
        match &mut copy {
            Expression::LocalVariable(v) => *v = self.local(*v),
            Expression::FunctionArgument(i) => {
                if let Some(new) = self.arguments[*i as usize] {
                    *i = new;
                }
            }
            Expression::AccessIndex { base, index } => match self.member_copy(*base, *index) {
                Some(MemberCopy::Whole(value)) => {
                    self.copying.copies.insert(e, value);
                    return;
                }
                Some(MemberCopy::Member(new, at)) => (*base, *index) = (new, at),
                None => {}
            },
            Expression::Compose { ty, components } => {
                *components = self.composed(*ty, components);
            }
            other => naga_operands::map_expression(other, &mut |o| {
                if let Some(new) = self.whole_copy(*o) {
                    *o = new;
                }
            }),
        }
        self.copying.append(e, copy);
    }

    fn operand(&mut self, e: Handle<Expression>) -> Handle<Expression> {
        self.whole_copy(e).unwrap_or(e)
    }

    fn emit(&mut self, range: Range<Expression>, span: Span) {
        self.copying.writer.begin();
        for e in range {
            if self.part.kept.expressions[e.index()].is_some() && !self.dissolved[e.index()] {
                self.expression(e);
            }
        }
        self.copying.writer.flush(span);
    }

    fn statement(&mut self, statement: &'p Statement, span: Span) {
        let copy = match statement {
            Statement::Return { value } => Statement::Return {
                value: value.and_then(|value| self.returned(value)),
            },
            Statement::Call {
                arguments, result, ..
            } => return self.call(StmtId::from(self.next - 1), arguments, *result, span),
            other => self.copied(other, span),
        };
        self.copying.writer.statement(copy, span);
    }

    fn block(&mut self, block: &'p Block) {
        for (statement, span) in block.span_iter() {
            let id = StmtId::from(self.next);
            let end = self.f.statements.get(id).end.index();
            if self.part.kept.statements[id.index()] {
                self.next += 1;
                self.copy(statement, *span);
            }
            self.next = end;
        }
    }
}

/// Gives bare returns at unreachable block ends a value.
fn return_something(expressions: &mut Arena<Expression>, block: &mut Block, ty: Handle<Type>) {
    match block.last_mut() {
        Some(Statement::Return {
            value: value @ None,
        }) => {
            *value = Some(expressions.append(Expression::ZeroValue(ty), Span::UNDEFINED));
        }
        Some(last @ (Statement::Block(_) | Statement::If { .. } | Statement::Switch { .. })) => {
            for inner in naga_operands::blocks_mut(last) {
                return_something(expressions, inner, ty);
            }
        }
        _ => {}
    }
}
