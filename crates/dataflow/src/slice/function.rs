//! The backward slice of one function for one demand of its caller.

use std::collections::{BTreeMap, BTreeSet};
use std::rc::Rc;

use naga::{Expression, Handle, Statement};

use super::fault::{self, Fault};
use super::need::Need;
use super::{Demand, Termination, components};
use crate::graph::cells::{self, Cell, Root};
use crate::graph::memory::{self, Origin, VersionId};
use crate::graph::{FunctionGraph, FunctionId, Graph, StmtId, counted};

/// The part of a function that its caller's demand depends on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FunctionSlice {
    /// Kept statements, by [`StmtId`], including `Emit`s.
    pub statements: Vec<bool>,
    /// The needed part of each expression, by handle.
    pub expressions: Vec<Option<Need>>,
    /// The needed part of each argument.
    pub arguments: Vec<Option<Need>>,
    /// The caller's cells whose entry values are needed.
    pub entry_cells: BTreeSet<Cell>,
    /// The demand on each kept call.
    pub calls: BTreeMap<StmtId, Demand>,
}

/// Slices functions on demand, each (function, demand) once.
pub(crate) struct Slicer<'g, 'p> {
    graph: &'g Graph<'p>,
    termination: Termination,
    memo: BTreeMap<(FunctionId, Demand), Rc<FunctionSlice>>,
}

impl<'g, 'p> Slicer<'g, 'p> {
    /// A slicer without any results.
    pub fn new(graph: &'g Graph<'p>, termination: Termination) -> Self {
        Self {
            graph,
            termination,
            memo: BTreeMap::new(),
        }
    }

    /// The slice of a function for a demand.
    pub fn slice(&mut self, id: FunctionId, demand: &Demand) -> Rc<FunctionSlice> {
        let key = (id, demand.clone());
        if let Some(done) = self.memo.get(&key) {
            return Rc::clone(done);
        }
        let graph = self.graph;
        let mut work = Work::new(graph, graph.function(id), demand, self.termination);
        while let Some(item) = work.list.pop() {
            match item {
                Item::Expression(e) => work.expression(e),
                Item::Statement(s) => work.statement(s),
                Item::Version(v) => work.version(v),
                Item::Call(s) => {
                    let Statement::Call { function, .. } = work.f.statements.get(s).statement
                    else {
                        continue;
                    };
                    let Some(demand) = work.out.calls.get(&s).cloned() else {
                        continue;
                    };
                    let callee = self.slice(FunctionId::Function(*function), &demand);
                    work.called(s, &callee);
                }
            }
        }
        let done = Rc::new(work.out);
        self.memo.insert(key, Rc::clone(&done));
        done
    }
}

enum Item {
    Expression(Handle<Expression>),
    Statement(StmtId),
    Version(VersionId),
    Call(StmtId),
}

struct Work<'g, 'p> {
    graph: &'g Graph<'p>,
    f: &'g FunctionGraph<'p>,
    demand: Demand,
    out: FunctionSlice,
    /// The needed part of each version.
    versions: Vec<Option<Need>>,
    list: Vec<Item>,
}

impl<'g, 'p> Work<'g, 'p> {
    fn new(
        graph: &'g Graph<'p>,
        f: &'g FunctionGraph<'p>,
        demand: &Demand,
        termination: Termination,
    ) -> Self {
        let mut this = Self {
            graph,
            f,
            demand: demand.clone(),
            out: FunctionSlice {
                statements: vec![false; f.statements.len()],
                expressions: vec![None; f.function.expressions.len()],
                arguments: vec![None; f.function.arguments.len()],
                entry_cells: BTreeSet::new(),
                calls: BTreeMap::new(),
            },
            versions: vec![None; f.memory.versions.len()],
            list: Vec::new(),
        };
        for (id, node) in f.statements.iter() {
            if !f.control.is_reachable(id) {
                continue;
            }
            match node.statement {
                Statement::Return { value } => {
                    if let (Some(need), Some(value)) = (&demand.result, value) {
                        this.keep(id);
                        this.need(*value, need);
                    }
                }
                Statement::Kill if demand.discards => this.keep(id),
                Statement::Call { function, .. } => {
                    let callee = FunctionId::Function(*function);
                    let mut asked = Demand {
                        discards: demand.discards && graph.may_discard(callee),
                        ..Demand::default()
                    };
                    asked.values.extend(
                        demand
                            .values
                            .iter()
                            .filter(|(within, _)| graph.reaches(callee, *within)),
                    );
                    let loops = termination.keeps(graph.ends(callee));
                    if asked != Demand::default() || loops {
                        this.ask(id, |d| {
                            d.discards |= asked.discards;
                            d.values.extend(asked.values.iter().copied());
                        });
                        this.list.push(Item::Call(id));
                    }
                }
                Statement::Loop { .. }
                    if termination.keeps(counted::ends(graph.module(), f, id)) =>
                {
                    this.keep(id);
                    for inner in id.index() + 1..node.end.index() {
                        let inner = StmtId::from(inner);
                        if matches!(
                            f.statements.get(inner).statement,
                            Statement::Break | Statement::Return { .. }
                        ) && f.control.is_reachable(inner)
                        {
                            this.keep(inner);
                        }
                    }
                }
                _ => {}
            }
        }
        for cell in &demand.cells {
            let exits: Vec<VersionId> = f
                .memory
                .overlapping(cell.root, &cell.path)
                .filter_map(|c| f.memory.exit.get(&c).copied())
                .collect();
            for version in exits {
                this.see(version, &Need::All);
            }
        }
        for (within, value) in &demand.values {
            if *within == f.id {
                this.need(*value, &Need::All);
            }
        }
        this
    }

    fn keep(&mut self, id: StmtId) {
        if !std::mem::replace(&mut self.out.statements[id.index()], true) {
            self.list.push(Item::Statement(id));
        }
    }

    fn need(&mut self, expression: Handle<Expression>, need: &Need) {
        if Need::add_to(&mut self.out.expressions[expression.index()], need) {
            self.list.push(Item::Expression(expression));
        }
    }

    /// Adds a need for a part of a version of a cell.
    fn see(&mut self, version: VersionId, need: &Need) {
        if Need::add_to(&mut self.versions[version.index()], need) {
            self.list.push(Item::Version(version));
        }
    }

    /// Adds to the demand on a call. If that changes it, slices the callee again.
    fn ask(&mut self, call: StmtId, more: impl FnOnce(&mut Demand)) {
        let demand = self.out.calls.entry(call).or_default();
        let before = demand.clone();
        more(demand);
        if *demand != before {
            self.list.push(Item::Call(call));
        }
    }

    fn statement(&mut self, id: StmtId) {
        let f = self.f;
        for ancestor in f.statements.ancestors(id) {
            self.keep(ancestor);
        }
        if !fault::has(Fault::Control) {
            for predicate in f.control.of(id) {
                self.keep(*predicate);
            }
        }
        match f.statements.get(id).statement {
            // Expressions are needed individually: a store's value if it is read, a call to the
            // extent of its demand, and a returned value to the extent that the caller needs.
            Statement::Emit(_) | Statement::Call { .. } => {}
            Statement::Store { pointer, .. } => self.need(*pointer, &Need::All),
            Statement::Return { value } => {
                if let (Some(value), Some(need)) = (value, self.demand.result.clone()) {
                    self.need(*value, &need);
                }
            }
            statement => {
                for operand in naga_operands::of_statement(statement) {
                    self.need(operand, &Need::All);
                }
                // If operands are needed, so is the memory they access; an atomic's result depends
                // on it.
                for version in f.memory.reads.get(&id).into_iter().flatten() {
                    self.see(*version, &Need::All);
                }
            }
        }
    }

    fn expression(&mut self, e: Handle<Expression>) {
        let Some(need) = self.out.expressions[e.index()].clone() else {
            return;
        };
        let (f, module) = (self.f, self.graph.module());
        if let Some(at) = f.statements.evaluated_at(e) {
            self.keep(at);
            if matches!(f.statements.get(at).statement, Statement::Call { .. }) {
                self.ask(at, |d| {
                    Need::add_to(&mut d.result, &need);
                });
            }
        }
        for (operand, need) in components::of_operands(module, f, e, &need) {
            self.need(operand, &need);
        }
        if let Expression::FunctionArgument(i) = &f.function.expressions[e] {
            Need::add_to(&mut self.out.arguments[*i as usize], &need);
        }
        let Some(seen) = f.memory.loads.get(&e) else {
            return;
        };
        let path = match &f.function.expressions[e] {
            Expression::Load { pointer } => cells::place(module, f.function, *pointer)
                .filter(|p| !p.dynamic)
                .map(|p| p.path),
            _ => None,
        };
        for version in seen {
            let cell = &f.memory.cell(*version).path;
            // A cell within the loaded part is needed like that part; a cell that contains it is
            // needed whole.
            let wanted = match path.as_ref().and_then(|path| cell.get(path.len()..)) {
                Some(rest) => need.below(rest),
                None => Some(Need::All),
            };
            if let Some(wanted) = wanted {
                self.see(*version, &wanted);
            }
        }
    }

    fn version(&mut self, version: VersionId) {
        let Some(need) = self.versions[version.index()].clone() else {
            return;
        };
        let (f, module) = (self.f, self.graph.module());
        let cell = f.memory.cell(version);
        match f.memory.origin(version) {
            Origin::Initial => {
                if !matches!(cell.root, Root::Local(_)) {
                    self.out.entry_cells.insert(cell.clone());
                }
            }
            Origin::Phi { operands, .. } => {
                let forgotten = usize::from(fault::has(Fault::Merge));
                for operand in operands.iter().rev().skip(forgotten) {
                    self.see(*operand, &need);
                }
            }
            Origin::Written { by, over } => {
                if let Some(over) = over.filter(|_| !fault::has(Fault::Under)) {
                    self.see(over, &need);
                }
                match f.statements.get(*by).statement {
                    Statement::Store { pointer, value } => {
                        self.keep(*by);
                        let need = cells::place(module, f.function, *pointer)
                            .filter(|p| !p.dynamic)
                            .and_then(|p| cell.path.get(p.path.len()..))
                            .map_or(Need::All, |rest| {
                                Need::at(module, f.ty(module, *value), rest, &need)
                            });
                        self.need(*value, &need);
                    }
                    Statement::Call {
                        function,
                        arguments,
                        ..
                    } => {
                        let footprint = &self
                            .graph
                            .function(FunctionId::Function(*function))
                            .memory
                            .footprint;
                        let written: Vec<Cell> = footprint
                            .writes
                            .keys()
                            .filter(|c| {
                                memory::in_caller(module, f.function, arguments, c)
                                    .is_some_and(|p| cell.overlaps(p.root, &p.path))
                            })
                            .cloned()
                            .collect();
                        if !fault::has(Fault::Callee) {
                            self.ask(*by, |d| d.cells.extend(written));
                        }
                    }
                    _ => self.keep(*by),
                }
            }
        }
    }

    /// Adds the needs of a callee that was sliced for the current demand.
    fn called(&mut self, call: StmtId, callee: &FunctionSlice) {
        let (f, module) = (self.f, self.graph.module());
        self.keep(call);
        let Statement::Call { arguments, .. } = f.statements.get(call).statement else {
            return;
        };
        for (argument, need) in arguments.iter().zip(&callee.arguments) {
            if let Some(need) = need {
                self.need(*argument, need);
            }
        }
        let seen = f.memory.reads.get(&call).cloned().unwrap_or_default();
        for cell in &callee.entry_cells {
            let Some(place) = memory::in_caller(module, f.function, arguments, cell) else {
                continue;
            };
            for version in &seen {
                if f.memory.cell(*version).overlaps(place.root, &place.path) {
                    self.see(*version, &Need::All);
                }
            }
        }
    }
}
