//! The partial evaluator: removes the branches of a stage that its known inputs never take.
//!
//! Online partial evaluation (Jones, Gomard and Sestoft, *Partial Evaluation and Automatic Program
//! Generation*, 1993): it walks the author's statements in order with an abstract value for each
//! expression, and copies them into fresh arenas. It folds nothing that depends on no assumption:
//! that is the compiler's work. A function that is called with different abstract values becomes
//! several versions. A function without folds stays one.

use std::collections::{BTreeMap, BTreeSet};

use naga::{
    Arena, Block, Expression, Function, Handle, Literal, LocalVariable, Module, Span, Statement,
    Type, UniqueArena,
};

use super::assume::Assumptions;
use super::control::{Breaks, Ending};
use super::decision::{Call, Noted, Record};
use super::known::{AbstractValue, Sources};
use super::params::Fold;
use super::versions::Version;
use naga_edit::writer::{FunctionWriter, OpenEmit};
use preshade_dataflow::graph::{FunctionGraph, FunctionId, Graph, StmtId};

/// Whether an expression of a function may be replaced by one of its operands, and the other, if there
/// is one that is not 0, dropped.
pub(crate) type Leaves<'p> =
    &'p dyn Fn(FunctionId, Handle<Expression>, Option<Handle<Expression>>) -> bool;

/// Folds the stages of a program.
pub(crate) struct Folder<'p> {
    pub(super) graph: &'p Graph<'p>,
    pub(super) module: &'p Module,
    pub(super) assumptions: &'p Assumptions,
    pub(super) fold: Fold,
    pub(super) leaves: Leaves<'p>,
    /// Largest number of iterations to unroll.
    pub(super) turns: u32,
    /// The types and functions of the new module.
    pub(super) types: UniqueArena<Type>,
    pub(super) functions: Arena<Function>,
    /// The record of each of `functions`.
    pub(super) records: Vec<Record>,
    pub(super) versions: BTreeMap<Handle<Function>, Vec<Version>>,
}

pub(crate) struct FoldedStage {
    pub function: Function,
    /// The abstract value of its result.
    pub result: AbstractValue,
    pub record: Record,
}

/// A function under construction.
pub(super) struct FoldFrame<'p> {
    pub id: FunctionId,
    pub original: &'p Function,
    pub f: &'p FunctionGraph<'p>,
    pub function: Function,
    /// The copy of each original expression.
    pub map: Vec<Option<Handle<Expression>>>,
    pub known: Vec<AbstractValue>,
    /// Whether another expression reads it.
    pub is_operand: Vec<bool>,
    pub arguments: Vec<AbstractValue>,
    /// The abstract value of each local variable.
    pub locals: Vec<AbstractValue>,
    /// The join of the values returned so far; `None` if there is none yet.
    pub returned: Option<AbstractValue>,
    pub breaks: Vec<Breaks>,
    pub emit: OpenEmit,
    pub span: Span,
    /// Assumptions under which the current statement runs. Values behind it depend on them too.
    pub running: Sources,
    pub changed: bool,
    pub record: Record,
    /// Enclosing decisions, by index in the record.
    pub within: Vec<usize>,
    /// The statements after the current one in each enclosing block, innermost last.
    pub following: Vec<(StmtId, StmtId)>,
    /// Number of enclosing loops that are being unrolled. Abstract values there hold only for one
    /// iteration.
    pub turning: u32,
    /// Number of enclosing speculative unrolls, whose results are discarded.
    pub tried: u32,
    /// Number of expressions created by failed unrolls.
    pub wasted: usize,
    /// Loops whose unrolling failed.
    pub hopeless: BTreeSet<StmtId>,
}

impl<'p> Folder<'p> {
    pub fn new(
        graph: &'p Graph<'p>,
        assumptions: &'p Assumptions,
        (fold, leaves): (Fold, Leaves<'p>),
        turns: u32,
    ) -> Self {
        Self {
            graph,
            module: graph.module(),
            assumptions,
            fold,
            leaves,
            turns,
            types: graph.module().types.clone(),
            functions: Arena::new(),
            records: Vec::new(),
            versions: BTreeMap::new(),
        }
    }

    /// Folds a stage under the abstract values of its arguments.
    pub fn stage(&mut self, entry: usize, arguments: Vec<AbstractValue>) -> FoldedStage {
        let frame = self.run(FunctionId::EntryPoint(entry), arguments);
        FoldedStage {
            function: frame.function,
            result: frame.returned.unwrap_or_default(),
            record: frame.record,
        }
    }

    /// The types, the functions that stages call, and their records.
    pub fn into_parts(self) -> (UniqueArena<Type>, Arena<Function>, Vec<Record>) {
        (self.types, self.functions, self.records)
    }

    pub(super) fn run(&mut self, id: FunctionId, arguments: Vec<AbstractValue>) -> FoldFrame<'p> {
        let f = self.graph.function(id);
        let original = f.function;
        let mut frame = FoldFrame {
            id,
            original,
            f,
            function: FunctionWriter::like(original).function,
            map: vec![None; original.expressions.len()],
            known: vec![AbstractValue::Unknown; original.expressions.len()],
            is_operand: are_operands(original),
            arguments,
            locals: Vec::new(),
            returned: None,
            breaks: Vec::new(),
            emit: OpenEmit::default(),
            span: Span::UNDEFINED,
            running: Sources::default(),
            changed: false,
            record: Record::default(),
            within: Vec::new(),
            following: Vec::new(),
            turning: 0,
            tried: 0,
            wasted: 0,
            hopeless: BTreeSet::new(),
        };
        let mut body = Block::new();
        // Constants, arguments and variables precede all statements.
        for (e, _) in original.expressions.iter() {
            if f.statements.evaluated_at(e).is_none() {
                self.copy(&mut frame, e, &mut body, true);
            }
        }
        let variables = original.local_variables.iter();
        let locals = variables
            .map(|(v, variable)| self.begins_with(&mut frame, v, variable))
            .collect();
        frame.locals = locals;
        self.block(&mut frame, &original.body, StmtId::from(0), &mut body);
        frame.function.body = body;
        frame
    }

    /// Initialises a variable and returns its abstract value.
    fn begins_with(
        &mut self,
        frame: &mut FoldFrame<'p>,
        v: Handle<LocalVariable>,
        variable: &LocalVariable,
    ) -> AbstractValue {
        let Some(init) = variable.init else {
            return super::expressions::zero(self.module, variable.ty);
        };
        self.copy_ahead(frame, init);
        frame.function.local_variables.get_mut(v).init = frame.map[init.index()];
        frame.known[init.index()].clone()
    }

    /// Copies an initialiser and its operands. Front ends put them into an `Emit`, which would come
    /// after the variables.
    fn copy_ahead(&mut self, frame: &mut FoldFrame<'p>, e: Handle<Expression>) {
        if frame.map[e.index()].is_some() {
            return;
        }
        for operand in naga_operands::of_expression(&frame.original.expressions[e]) {
            self.copy_ahead(frame, operand);
        }
        self.copy(frame, e, &mut Block::new(), true);
    }

    /// Copies a block whose first statement has the number `first`.
    pub(super) fn block(
        &mut self,
        frame: &mut FoldFrame<'p>,
        block: &'p Block,
        first: StmtId,
        out: &mut Block,
    ) -> Ending {
        let end = frame.behind(first, block);
        let depth = frame.following.len();
        let mut id = first;
        let mut flow = Ending::Next;
        for (statement, span) in block.span_iter() {
            frame.span = *span;
            let next = frame.f.statements.get(id).end;
            frame.following.push((next, end));
            flow = self.statement(frame, statement, id, out);
            frame.following.truncate(depth);
            if flow != Ending::Next {
                break;
            }
            id = next;
        }
        frame.flush(out);
        flow
    }

    fn statement(
        &mut self,
        frame: &mut FoldFrame<'p>,
        statement: &'p Statement,
        id: StmtId,
        out: &mut Block,
    ) -> Ending {
        let inside = StmtId::from(id.index() + 1);
        let span = frame.span;
        match statement {
            Statement::Emit(range) => {
                for e in range.clone() {
                    self.copy(frame, e, out, false);
                }
                return Ending::Next;
            }
            Statement::Block(block) => {
                let mut inner = Block::new();
                frame.flush(out);
                let flow = self.block(frame, block, inside, &mut inner);
                out.push(Statement::Block(inner), span);
                return flow;
            }
            Statement::If {
                condition,
                accept,
                reject,
            } => return self.branch(frame, id, *condition, [accept, reject], out),
            Statement::Switch { selector, cases } => {
                return self.switch(frame, id, *selector, cases, out);
            }
            Statement::Loop {
                body,
                continuing,
                break_if,
            } => return self.looped(frame, id, body, continuing, *break_if, out),
            Statement::Break => {
                let locals = frame.locals.clone();
                if let Some(Breaks::Switch { locals: states, .. }) = frame.breaks.last_mut() {
                    states.push(locals);
                }
                frame.flush(out);
                out.push(Statement::Break, span);
                return Ending::Break;
            }
            Statement::Continue => {
                frame.flush(out);
                out.push(Statement::Continue, span);
                return Ending::Continue;
            }
            Statement::Return { value } => {
                let known =
                    value.map_or(AbstractValue::Unknown, |v| frame.known[v.index()].clone());
                let known = known.resting_on(&frame.running);
                let value = value.map(|v| self.read(frame, v, out));
                frame.flush(out);
                out.push(Statement::Return { value }, span);
                frame.returned = Some(match frame.returned.take() {
                    Some(before) => before.join(&known),
                    None => known,
                });
                return Ending::Return;
            }
            Statement::Store { pointer, value } => {
                let known = frame.known[value.index()]
                    .clone()
                    .resting_on(&frame.running);
                frame.store(self.module, *pointer, known);
                let value = self.read(frame, *value, out);
                let pointer = frame.mapped(*pointer);
                frame.flush(out);
                out.push(Statement::Store { pointer, value }, span);
            }
            Statement::Call {
                function,
                arguments,
                result,
            } => self.call(frame, id, (*function, &arguments[..], *result), out),
            other => {
                frame.flush(out);
                let mut copy = naga_operands::shell(other);
                naga_operands::map_statement(&mut copy, &mut |e| *e = frame.mapped(*e));
                if let Some(result) = naga_operands::result_mut(&mut copy) {
                    let old = *result;
                    let expression = frame.original.expressions[old].clone();
                    let new = frame.append(expression, old);
                    frame.map[old.index()] = Some(new);
                    frame.name(old, new);
                    *result = new;
                }
                out.push(copy, span);
            }
        }
        Ending::Next
    }

    /// Copies a call of the version of a function for known arguments.
    fn call(
        &mut self,
        frame: &mut FoldFrame<'p>,
        id: StmtId,
        (function, arguments, result): (
            Handle<Function>,
            &[Handle<Expression>],
            Option<Handle<Expression>>,
        ),
        out: &mut Block,
    ) {
        let span = frame.span;
        let known = arguments
            .iter()
            .map(|a| frame.known[a.index()].clone())
            .collect();
        let (callee, returned) = self.version(function, known);
        frame.record.notes.push(Noted::Call(Call {
            callee,
            times: frame.f.times[id.index()],
            within: frame.within.last().copied(),
        }));
        frame.changed |= self.is_folded(function, callee);
        for argument in arguments {
            frame.forget_all(*argument);
        }
        let passed = arguments
            .iter()
            .map(|a| self.read(frame, *a, out))
            .collect();
        frame.flush(out);
        let result = result.map(|r| {
            let copy = frame.append(Expression::CallResult(callee), r);
            frame.map[r.index()] = Some(copy);
            frame.known[r.index()] = returned;
            frame.name(r, copy);
            copy
        });
        let call = Statement::Call {
            function: callee,
            arguments: passed,
            result,
        };
        out.push(call, span);
    }
}

/// Which expressions are operands of others.
fn are_operands(function: &Function) -> Vec<bool> {
    let mut are = vec![false; function.expressions.len()];
    for (_, expression) in function.expressions.iter() {
        for operand in naga_operands::of_expression(expression) {
            are[operand.index()] = true;
        }
    }
    are
}

impl FoldFrame<'_> {
    /// Records a fold that depends on `sources`.
    pub fn folds(&mut self, sources: &Sources) {
        self.record.used.extend(sources.iter().copied());
        self.changed = true;
    }

    /// Ends the current `Emit`.
    pub fn flush(&mut self, out: &mut Block) {
        self.emit.end(&self.function.expressions, out, self.span);
    }

    /// Appends an expression that needs an `Emit`.
    pub fn emit(&mut self, expression: Expression, of: Handle<Expression>) -> Handle<Expression> {
        self.emit.begin(&self.function.expressions);
        self.append(expression, of)
    }

    /// Appends an expression that needs no `Emit`.
    pub fn append(&mut self, expression: Expression, of: Handle<Expression>) -> Handle<Expression> {
        let span = self.original.expressions.get_span(of);
        self.function.expressions.append(expression, span)
    }

    pub fn literal(&mut self, literal: Literal, out: &mut Block) -> Handle<Expression> {
        self.flush(out);
        let literal = Expression::Literal(literal);
        self.function.expressions.append(literal, Span::UNDEFINED)
    }

    /// The copy of an expression.
    pub fn mapped(&self, e: Handle<Expression>) -> Handle<Expression> {
        self.map[e.index()].unwrap_or(e)
    }

    /// Gives a copy the author's name.
    pub fn name(&mut self, e: Handle<Expression>, copy: Handle<Expression>) {
        if let Some(name) = self.original.named_expressions.get(&e) {
            let names = &mut self.function.named_expressions;
            names.entry(copy).or_insert_with(|| name.clone());
        }
    }

    pub fn behind(&self, first: StmtId, block: &Block) -> StmtId {
        block
            .iter()
            .fold(first, |at, _| self.f.statements.get(at).end)
    }

    pub fn starts<'b>(&self, id: StmtId, blocks: impl Iterator<Item = &'b Block>) -> Vec<StmtId> {
        let mut at = StmtId::from(id.index() + 1);
        blocks
            .map(|block| {
                let start = at;
                at = self.behind(at, block);
                start
            })
            .collect()
    }

    /// Forgets the locals that these statements may write.
    pub fn forget_stored<'b>(&mut self, blocks: impl Iterator<Item = &'b Block>) {
        let mut pointers = Vec::new();
        for block in blocks {
            naga_operands::visit(block, &mut |statement| match statement {
                Statement::Store { pointer, .. } => pointers.push(*pointer),
                Statement::Call { arguments, .. } => pointers.extend(arguments),
                other => pointers.extend(naga_operands::of_statement(other)),
            });
        }
        for pointer in pointers {
            self.forget_all(pointer);
        }
    }
}
