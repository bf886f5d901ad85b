//! The rates of all nodes. Each function is analysed once, in terms of its inputs; a call
//! substitutes its arguments.

use std::collections::BTreeSet;

use naga::{
    AddressSpace, Expression, Handle, Module, ShaderStage, Statement, StorageAccess, TypeInner,
};

use super::cells::{Cell, Root};
use super::memory::{self, Origin, VersionId};
use super::rate::{Fact, Rate, Stages, of_binding};
use super::{Effect, FunctionGraph, FunctionId, StmtId, effect};

/// A value from a function's caller.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum CallerValue {
    /// An argument, or a member of one.
    Argument(u32, Option<u32>),
    /// A cell at entry.
    Cell(Cell),
}

/// A fact in terms of a function's inputs.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Dependence {
    own: Fact,
    inputs: BTreeSet<u32>,
}

impl Dependence {
    fn of(own: Fact) -> Self {
        Self {
            own,
            inputs: BTreeSet::new(),
        }
    }

    fn join(&mut self, other: &Self) {
        self.own = self.own.join(other.own);
        self.inputs.extend(&other.inputs);
    }

    fn with(&self, context: &[Fact]) -> Fact {
        self.inputs
            .iter()
            .fold(self.own, |f, i| f.join(context[*i as usize]))
    }
}

/// A function's results in terms of its inputs.
#[derive(Clone, Debug, Default)]
struct Summary {
    inputs: Vec<CallerValue>,
    /// Per result member, or for the whole result.
    result: Vec<Dependence>,
    /// Per cell that its caller can see.
    cells: Vec<(Cell, Dependence)>,
    expressions: Vec<Dependence>,
    statements: Vec<Dependence>,
    versions: Vec<Dependence>,
}

/// The rates of all functions' nodes.
#[derive(Clone, Debug, Default)]
pub(crate) struct Rates {
    expressions: Vec<Vec<Fact>>,
    statements: Vec<Vec<Fact>>,
    versions: Vec<Vec<Fact>>,
    results: Vec<Vec<Fact>>,
    inputs: Vec<Vec<(CallerValue, Fact)>>,
}

impl Rates {
    /// Analyses functions in order, callees first and entry points last. Facts of a function are
    /// joined over all its calls.
    pub fn new(module: &Module, functions: &[FunctionGraph<'_>]) -> Self {
        let mut summaries: Vec<Summary> = Vec::new();
        for f in functions {
            let summary = Analysis::new(module, f, &summaries).run();
            summaries.push(summary);
        }
        // In the other direction: the inputs of each function, over all calls from entry points.
        let mut contexts: Vec<Vec<Fact>> = summaries
            .iter()
            .map(|s| vec![Fact::default(); s.inputs.len()])
            .collect();
        for (index, f) in functions.iter().enumerate().rev() {
            if let FunctionId::EntryPoint(entry) = f.id {
                contexts[index] = summaries[index]
                    .inputs
                    .iter()
                    .map(|i| entry_input(module, entry, i))
                    .collect();
            }
            let context = contexts[index].clone();
            let analysis = Analysis {
                module,
                f,
                summaries: &summaries,
                out: summaries[index].clone(),
            };
            for (at, callee) in f.calls() {
                let facts: Vec<Fact> = summaries[callee.index()]
                    .inputs
                    .iter()
                    .map(|input| analysis.argument(at, input).with(&context))
                    .collect();
                for (have, more) in contexts[callee.index()].iter_mut().zip(facts) {
                    *have = have.join(more);
                }
            }
        }
        let mut rates = Self::default();
        for ((f, summary), context) in functions.iter().zip(&summaries).zip(&contexts) {
            // Nothing varies faster than a vertex in a vertex stage.
            let vertex = match f.id {
                FunctionId::EntryPoint(i) => module.entry_points[i].stage == ShaderStage::Vertex,
                FunctionId::Function(_) => false,
            };
            let fact = |d: &Dependence| {
                let fact = d.with(context);
                match fact.rate {
                    Rate::Fragment if vertex => Fact::new(Rate::Vertex, fact.stages),
                    _ => fact,
                }
            };
            rates
                .expressions
                .push(summary.expressions.iter().map(fact).collect());
            rates
                .statements
                .push(summary.statements.iter().map(fact).collect());
            rates
                .versions
                .push(summary.versions.iter().map(fact).collect());
            rates
                .results
                .push(summary.result.iter().map(fact).collect());
            let inputs = summary.inputs.iter().cloned().zip(context.iter().copied());
            rates.inputs.push(inputs.collect());
        }
        rates
    }

    /// The fact of an expression of the n-th function.
    pub fn expression(&self, function: usize, e: Handle<Expression>) -> Fact {
        self.expressions[function][e.index()]
    }

    /// The fact of a version of a cell of the n-th function.
    pub fn version(&self, function: usize, version: VersionId) -> Fact {
        self.versions[function][version.index()]
    }

    /// The facts of each member of the n-th function's result.
    pub fn outputs(&self, function: usize) -> &[Fact] {
        &self.results[function]
    }

    /// The fact of an argument of the n-th function, or of a member of it.
    pub fn argument(&self, function: usize, argument: u32, member: Option<u32>) -> Fact {
        let wanted = CallerValue::Argument(argument, member);
        self.inputs[function]
            .iter()
            .find(|(input, _)| *input == wanted)
            .map(|(_, fact)| *fact)
            .unwrap_or_default()
    }

    /// The fact of a statement's control dependence in the n-th function.
    pub fn statement(&self, function: usize, id: StmtId) -> Fact {
        self.statements[function][id.index()]
    }
}

/// The fact of an input of an entry point.
fn entry_input(module: &Module, entry: usize, input: &CallerValue) -> Fact {
    let point = &module.entry_points[entry];
    match input {
        CallerValue::Argument(i, member) => {
            let argument = &point.function.arguments[*i as usize];
            let (binding, ty) = match (member, &module.types[argument.ty].inner) {
                (Some(m), TypeInner::Struct { members, .. }) => {
                    let member = &members[*m as usize];
                    (member.binding.as_ref(), member.ty)
                }
                _ => (argument.binding.as_ref(), argument.ty),
            };
            binding.map_or(Fact::new(Rate::Fragment, Stages::ANY), |b| {
                of_binding(point.stage, b, &module.types[ty].inner)
            })
        }
        CallerValue::Cell(cell) => match cell.root {
            Root::Global(g) if module.global_variables[g].space == AddressSpace::Private => {
                Fact::default()
            }
            _ => Fact::new(Rate::Fragment, Stages::ANY),
        },
    }
}

fn set(slot: &mut Dependence, value: Dependence) -> bool {
    let changed = *slot != value;
    *slot = value;
    changed
}

struct Analysis<'a, 'p> {
    module: &'a Module,
    f: &'a FunctionGraph<'p>,
    summaries: &'a [Summary],
    out: Summary,
}

impl<'a, 'p> Analysis<'a, 'p> {
    fn new(module: &'a Module, f: &'a FunctionGraph<'p>, summaries: &'a [Summary]) -> Self {
        let mut inputs = Vec::new();
        for (i, argument) in f.function.arguments.iter().enumerate() {
            match &module.types[argument.ty].inner {
                TypeInner::Struct { members, .. } => inputs.extend(
                    (0..members.len()).map(|m| CallerValue::Argument(i as u32, Some(m as u32))),
                ),
                _ => inputs.push(CallerValue::Argument(i as u32, None)),
            }
        }
        let mut versions = vec![Dependence::default(); f.memory.versions.len()];
        for (v, version) in f.memory.versions.iter().enumerate() {
            let cell = &f.memory.cells[version.cell];
            if version.origin == Origin::Initial && !matches!(cell.root, Root::Local(_)) {
                versions[v].inputs.insert(inputs.len() as u32);
                inputs.push(CallerValue::Cell(cell.clone()));
            }
        }
        Self {
            module,
            f,
            summaries,
            out: Summary {
                inputs,
                expressions: vec![Dependence::default(); f.function.expressions.len()],
                statements: vec![Dependence::default(); f.statements.len()],
                versions,
                ..Summary::default()
            },
        }
    }

    /// Iterates to a fixed point: one pass without loops, a few with.
    fn run(mut self) -> Summary {
        for (e, _) in self.f.function.expressions.iter() {
            if self.f.statements.evaluated_at(e).is_none() {
                self.out.expressions[e.index()] = self.value(e);
            }
        }
        let merges = self.merges();
        while self.pass(&merges) {}
        self.finish()
    }

    /// The merges to visit before each statement, and after the last one. A loop's header merges at
    /// its beginning, other merges belong to the end of their statement.
    fn merges(&self) -> Vec<Vec<usize>> {
        let f = self.f;
        let mut merges = vec![Vec::new(); f.statements.len() + 1];
        for (v, version) in f.memory.versions.iter().enumerate() {
            match version.origin {
                Origin::Phi { at: Some(at), .. } => {
                    merges[at.index()].push(v);
                    merges[f.statements.get(at).end.index()].push(v);
                }
                Origin::Phi { at: None, .. } => merges[f.statements.len()].push(v),
                _ => {}
            }
        }
        merges
    }

    fn merge(&mut self, phi: usize) -> bool {
        let Origin::Phi { operands, .. } = &self.f.memory.versions[phi].origin else {
            return false;
        };
        let mut value = self.out.versions[phi].clone();
        for operand in operands {
            value.join(&self.out.versions[operand.index()]);
        }
        set(&mut self.out.versions[phi], value)
    }

    /// One forward walk. Returns whether any fact changed.
    fn pass(&mut self, merges: &[Vec<usize>]) -> bool {
        let f = self.f;
        let mut changed = false;
        for (id, node) in f.statements.iter() {
            for phi in &merges[id.index()] {
                changed |= self.merge(*phi);
            }
            let mut control = Dependence::default();
            for predicate in f.control.of(id) {
                control.join(&self.out.statements[predicate.index()]);
                let statement = f.statements.get(*predicate).statement;
                if !matches!(statement, Statement::Return { .. }) {
                    for e in naga_operands::of_statement(statement) {
                        control.join(&self.out.expressions[e.index()]);
                    }
                }
            }
            if let Statement::Emit(range) = node.statement {
                for e in range.clone() {
                    let mut value = self.value(e);
                    value.join(&control);
                    changed |= set(&mut self.out.expressions[e.index()], value);
                }
            }
            for version in f.memory.writes.get(&id).into_iter().flatten() {
                let mut value = self.written(id, *version);
                value.join(&control);
                changed |= set(&mut self.out.versions[version.index()], value);
            }
            if let Some(result) = naga_operands::result(node.statement) {
                let mut value = self.provided(id, node.statement, None);
                value.join(&control);
                changed |= set(&mut self.out.expressions[result.index()], value);
            }
            changed |= set(&mut self.out.statements[id.index()], control);
        }
        for phi in &merges[f.statements.len()] {
            changed |= self.merge(*phi);
        }
        changed
    }

    fn finish(mut self) -> Summary {
        let members =
            self.f
                .function
                .result
                .as_ref()
                .map_or(0, |r| match &self.module.types[r.ty].inner {
                    TypeInner::Struct { members, .. } => members.len(),
                    _ => 1,
                });
        let is_struct = self
            .f
            .function
            .result
            .as_ref()
            .is_some_and(|r| matches!(self.module.types[r.ty].inner, TypeInner::Struct { .. }));
        let mut result = vec![Dependence::default(); members];
        for (id, node) in self.f.statements.iter() {
            let Statement::Return { value: Some(value) } = node.statement else {
                continue;
            };
            for (m, dependence) in result.iter_mut().enumerate() {
                dependence.join(&self.out.statements[id.index()]);
                dependence.join(&self.member(*value, is_struct.then_some(m as u32)));
            }
        }
        self.out.result = result;
        self.out.cells = self
            .f
            .memory
            .exit
            .iter()
            .map(|(cell, version)| {
                (
                    self.f.memory.cells[*cell].clone(),
                    self.out.versions[version.index()].clone(),
                )
            })
            .collect();
        self.out
    }

    fn dependence_of(&self, versions: &[VersionId], path: Option<(&[u32], u32)>) -> Dependence {
        let mut out = Dependence::default();
        for version in versions {
            let relevant = path.is_none_or(|(base, member)| {
                self.f
                    .memory
                    .cell(*version)
                    .path
                    .get(base.len())
                    .is_none_or(|step| *step == member)
            });
            if relevant {
                out.join(&self.out.versions[version.index()]);
            }
        }
        out
    }

    /// A value, or one member of a struct value.
    fn member(&self, e: Handle<Expression>, member: Option<u32>) -> Dependence {
        let Some(member) = member else {
            return self.out.expressions[e.index()].clone();
        };
        match &self.f.function.expressions[e] {
            Expression::Compose { components, .. } => components
                .get(member as usize)
                .map_or_else(Dependence::default, |c| {
                    self.out.expressions[c.index()].clone()
                }),
            Expression::FunctionArgument(i) => self.input(&CallerValue::Argument(*i, Some(member))),
            Expression::CallResult(_) => match self.f.statements.evaluated_at(e) {
                Some(at) => {
                    let mut value =
                        self.provided(at, self.f.statements.get(at).statement, Some(member));
                    value.join(&self.out.statements[at.index()]);
                    value
                }
                None => Dependence::default(),
            },
            Expression::Load { pointer } => {
                let place = super::cells::place(self.module, self.f.function, *pointer);
                match (place, self.f.memory.loads.get(&e)) {
                    (Some(place), Some(seen)) if !place.dynamic => {
                        self.dependence_of(seen, Some((&place.path, member)))
                    }
                    _ => self.out.expressions[e.index()].clone(),
                }
            }
            _ => self.out.expressions[e.index()].clone(),
        }
    }

    fn input(&self, input: &CallerValue) -> Dependence {
        let mut out = Dependence::default();
        for (i, known) in self.out.inputs.iter().enumerate() {
            let same = match (input, known) {
                (CallerValue::Argument(a, None), CallerValue::Argument(b, _)) => a == b,
                (a, b) => a == b,
            };
            if same {
                out.inputs.insert(i as u32);
            }
        }
        out
    }

    fn value(&self, e: Handle<Expression>) -> Dependence {
        let expression = &self.f.function.expressions[e];
        let mut out = Dependence::default();
        match expression {
            Expression::FunctionArgument(i) => return self.input(&CallerValue::Argument(*i, None)),
            Expression::AccessIndex { base, index }
                if matches!(self.f.ty(self.module, *base), TypeInner::Struct { .. }) =>
            {
                return self.member(*base, Some(*index));
            }
            // A variable's address does not depend on its content, so only the indices of the
            // access count.
            Expression::Load { pointer } if self.f.memory.loads.contains_key(&e) => {
                out = self.content(&self.f.memory.loads[&e]);
                for index in indices(self.f, *pointer) {
                    out.join(&self.out.expressions[index.index()]);
                }
                return out;
            }
            Expression::Override(_) | Expression::GlobalVariable(_) => {
                out.own.rate = Rate::Draw;
            }
            _ => {}
        }
        for operand in naga_operands::of_expression(expression) {
            out.join(&self.out.expressions[operand.index()]);
        }
        if let Some(effect) = effect::of_expression(expression) {
            let stages = match effect {
                Effect::Derivative | Effect::ImplicitLod => Stages::FRAGMENT,
                _ => Stages::ANY,
            };
            out.join(&Dependence::of(Fact::new(Rate::Fragment, stages)));
        }
        if let Some(seen) = self.f.memory.loads.get(&e) {
            out.join(&self.content(seen));
        }
        out
    }

    /// The fact of memory content.
    fn content(&self, seen: &[VersionId]) -> Dependence {
        let mut out = self.dependence_of(seen, None);
        if self.reads_shared(seen) {
            out.own.rate = out.own.rate.join(Rate::Fragment);
        }
        out
    }

    /// Whether other invocations may write the memory.
    fn reads_shared(&self, seen: &[VersionId]) -> bool {
        seen.iter().any(|v| match self.f.memory.cell(*v).root {
            Root::Global(g) => match self.module.global_variables[g].space {
                AddressSpace::Private => false,
                AddressSpace::Storage { access } => access.contains(StorageAccess::STORE),
                _ => true,
            },
            _ => false,
        })
    }

    /// The fact of a version that a statement writes.
    fn written(&self, id: StmtId, version: VersionId) -> Dependence {
        let mut out = Dependence::default();
        let cell = self.f.memory.cell(version);
        if let Origin::Written {
            over: Some(over), ..
        } = self.f.memory.origin(version)
        {
            out.join(&self.out.versions[over.index()]);
        }
        match self.f.statements.get(id).statement {
            Statement::Store { pointer, value } => {
                let place = super::cells::place(self.module, self.f.function, *pointer);
                let member = place
                    .filter(|p| !p.dynamic)
                    .and_then(|p| cell.path.get(p.path.len()).copied())
                    .filter(|_| matches!(self.f.ty(self.module, *value), TypeInner::Struct { .. }));
                out.join(&self.member(*value, member));
                for index in indices(self.f, *pointer) {
                    out.join(&self.out.expressions[index.index()]);
                }
            }
            Statement::Call {
                function,
                arguments,
                ..
            } => {
                for (written, dependence) in &self.summaries[function.index()].cells {
                    let overlaps =
                        memory::in_caller(self.module, self.f.function, arguments, written)
                            .is_some_and(|p| cell.overlaps(p.root, &p.path));
                    if overlaps {
                        out.join(&self.instantiate(id, *function, dependence));
                    }
                }
            }
            _ => out.join(&Dependence::of(Fact::new(Rate::Fragment, Stages::ANY))),
        }
        out
    }

    /// The value a statement provides, or one member of it.
    fn provided(&self, id: StmtId, statement: &Statement, member: Option<u32>) -> Dependence {
        let Statement::Call { function, .. } = statement else {
            // Atomics, subgroup operations and ray queries are never moved.
            return Dependence::of(Fact::new(Rate::Fragment, Stages::ANY));
        };
        let mut out = Dependence::default();
        for (m, dependence) in self.summaries[function.index()].result.iter().enumerate() {
            if member.is_none_or(|want| want as usize == m) {
                out.join(&self.instantiate(id, *function, dependence));
            }
        }
        out
    }

    fn instantiate(
        &self,
        call: StmtId,
        callee: Handle<naga::Function>,
        dependence: &Dependence,
    ) -> Dependence {
        let mut out = Dependence::of(dependence.own);
        for i in &dependence.inputs {
            out.join(&self.argument(call, &self.summaries[callee.index()].inputs[*i as usize]));
        }
        out
    }

    /// The call's value for an input of its callee.
    fn argument(&self, call: StmtId, input: &CallerValue) -> Dependence {
        let Statement::Call { arguments, .. } = self.f.statements.get(call).statement else {
            return Dependence::default();
        };
        match input {
            CallerValue::Argument(i, member) => self.member(arguments[*i as usize], *member),
            CallerValue::Cell(cell) => {
                let seen = self.f.memory.reads.get(&call);
                match memory::in_caller(self.module, self.f.function, arguments, cell) {
                    Some(place) => {
                        let mut out = Dependence::default();
                        for version in seen.into_iter().flatten() {
                            if self
                                .f
                                .memory
                                .cell(*version)
                                .overlaps(place.root, &place.path)
                            {
                                out.join(&self.out.versions[version.index()]);
                            }
                        }
                        out
                    }
                    None => Dependence::default(),
                }
            }
        }
    }
}

/// The dynamic indices along a pointer's chain.
fn indices(f: &FunctionGraph<'_>, pointer: Handle<Expression>) -> Vec<Handle<Expression>> {
    let mut out = Vec::new();
    let mut at = pointer;
    loop {
        match f.function.expressions[at] {
            Expression::AccessIndex { base, .. } => at = base,
            Expression::Access { base, index } => {
                out.push(index);
                at = base;
            }
            _ => return out,
        }
    }
}
