//! Every value of a fragment stage, each call's apart: what the minimum cut chooses from.
//!
//! The dataflow graph analyses a function once for all its calls. Here each chain of calls from the entry point has values of its own, so that
//! a function used twice may have one of its uses moved. The nodes are expressions, versions of memory and what decides whether a statement runs;
//! operands may be circular where a loop carries a value from turn to turn.

use std::collections::{BTreeMap, HashMap};

use naga::{AddressSpace, Binding, BuiltIn, Expression, Handle, ShaderStage, Statement, TypeInner};

use crate::graph::cells::{self, Root};
use crate::graph::effect::{self, Effect};
use crate::graph::memory::{self, Origin, VersionId};
use crate::graph::rate::{self, Fact, Rate, Stages};
use crate::graph::{FunctionGraph, FunctionId, Graph, StmtId, cost, operands};
use crate::reflect;

/// A chain of calls from the entry point; 0 is the entry point itself.
pub type ContextId = usize;

/// A function as one chain of calls reaches it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Context {
    /// The function.
    pub function: FunctionId,
    /// Who calls it, and where. `None` for the entry point.
    pub call: Option<(ContextId, StmtId)>,
    /// How often it runs for one fragment, as far as that can be told.
    pub times: f64,
}

/// A value's index in [`Values::values`].
pub type ValueId = usize;

/// What a value is.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Node {
    /// An input of the entry point, by index in the order of [`reflect::inputs`].
    Input(usize),
    /// An expression, or the part of a struct expression at a path of members.
    Expression(ContextId, Handle<Expression>, Vec<u32>),
    /// A version of a variable.
    Version(ContextId, VersionId),
    /// What decides whether a statement runs.
    Control(ContextId, StmtId),
}

/// A value.
#[derive(Clone, Debug, PartialEq)]
pub struct Value {
    /// What it is.
    pub node: Node,
    /// Values it is made of.
    pub operands: Vec<ValueId>,
    /// What computing it costs one fragment, operands apart, in the units of [`crate::graph::cost`].
    pub cost: f64,
    /// How often it changes, and which stages can have it.
    pub fact: Fact,
}

/// All values that what is observed of a fragment rests on.
#[derive(Debug)]
pub struct Values<'g, 'p> {
    /// The dataflow graph.
    pub graph: &'g Graph<'p>,
    /// Index of the fragment entry point.
    pub entry: usize,
    /// Chains of calls.
    pub contexts: Vec<Context>,
    /// The values.
    pub values: Vec<Value>,
    /// What is observed: outputs, and what decides the discards.
    pub roots: Vec<ValueId>,
    /// Those of `roots` that decide which fragments there are, and how deep: discards, the depth and the sample mask.
    pub coverage: Vec<ValueId>,
    index: HashMap<Node, ValueId>,
    children: BTreeMap<(ContextId, StmtId), ContextId>,
    /// Own facts, before what operands add.
    own: Vec<Fact>,
}

/// Most values that are looked at: beyond it the calls of a shader are nested too deeply to tell them all apart.
pub const MOST_VALUES: usize = 200_000;

/// A shader with more than [`MOST_VALUES`] values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the fragment stage has more than {MOST_VALUES} values, each call's counted apart")]
pub struct TooLarge;

impl<'g, 'p> Values<'g, 'p> {
    /// The values behind the outputs and discards of a fragment entry point.
    ///
    /// # Errors
    /// [`TooLarge`].
    pub fn new(graph: &'g Graph<'p>, entry: usize) -> Result<Self, TooLarge> {
        let mut this = Self {
            graph,
            entry,
            contexts: vec![Context {
                function: FunctionId::EntryPoint(entry),
                call: None,
                times: 1.0,
            }],
            values: Vec::new(),
            roots: Vec::new(),
            coverage: Vec::new(),
            index: HashMap::new(),
            children: BTreeMap::new(),
            own: Vec::new(),
        };
        this.find_roots();
        let mut next = 0;
        while next < this.values.len() {
            this.expand(next);
            next += 1;
            if this.values.len() > MOST_VALUES {
                return Err(TooLarge);
            }
        }
        // What decides whether a value is computed at all is not among its operands, and yet asked for.
        let candidates: Vec<(ContextId, StmtId)> = this
            .values
            .iter()
            .filter_map(|v| match v.node {
                Node::Expression(context, e, _) => {
                    Some((context, this.function(context).statements.evaluated_at(e)?))
                }
                _ => None,
            })
            .collect();
        for (context, statement) in candidates {
            this.control(context, statement);
        }
        while next < this.values.len() {
            this.expand(next);
            next += 1;
            if this.values.len() > MOST_VALUES {
                return Err(TooLarge);
            }
        }
        this.find_facts();
        Ok(this)
    }

    /// The function a context is a call of.
    pub fn function(&self, context: ContextId) -> &'g FunctionGraph<'p> {
        self.graph.function(self.contexts[context].function)
    }

    /// The value of a node, if anything observed rests on it.
    pub fn get(&self, node: &Node) -> Option<ValueId> {
        self.index.get(node).copied()
    }

    /// The context that a call leads to.
    pub fn child(&self, context: ContextId, call: StmtId) -> Option<ContextId> {
        self.children.get(&(context, call)).copied()
    }

    /// The expression a value is, if it is a whole one that some statement evaluates.
    pub fn expression(&self, value: ValueId) -> Option<(ContextId, Handle<Expression>, StmtId)> {
        match &self.values[value].node {
            Node::Expression(context, e, path) if path.is_empty() => {
                let at = self.function(*context).statements.evaluated_at(*e)?;
                Some((*context, *e, at))
            }
            _ => None,
        }
    }

    /// The values that each value is an operand of.
    pub fn users(&self) -> Vec<Vec<ValueId>> {
        let mut users = vec![Vec::new(); self.values.len()];
        for (user, value) in self.values.iter().enumerate() {
            for operand in &value.operands {
                users[*operand].push(user);
            }
        }
        users
    }

    /// The rate of what decides whether a statement runs in a context.
    pub fn control_rate(&self, context: ContextId, statement: StmtId) -> Rate {
        self.decider(context, statement)
            .and_then(|node| self.get(&node))
            .map_or(Rate::Const, |v| self.values[v].fact.rate)
    }

    fn find_roots(&mut self) {
        let module = self.graph.module();
        let f = self.function(0);
        let is_struct = f.function.result.as_ref().is_some_and(|r| {
            r.binding.is_none() && matches!(module.types[r.ty].inner, TypeInner::Struct { .. })
        });
        let outputs = reflect::outputs(module, f.function);
        for (id, node) in f.statements.iter() {
            if let Statement::Return { value: Some(value) } = node.statement
                && f.control.is_reachable(id)
            {
                for (m, output) in outputs.iter().enumerate() {
                    let path = if is_struct {
                        vec![m as u32]
                    } else {
                        Vec::new()
                    };
                    let root = self.value(0, *value, path);
                    self.roots.push(root);
                    if matches!(
                        output.binding,
                        Some(Binding::BuiltIn(BuiltIn::FragDepth | BuiltIn::SampleMask))
                    ) {
                        self.coverage.push(root);
                    }
                }
                let control = self.control(0, id);
                self.roots.extend(control);
            }
        }
        self.find_discards(0);
        self.roots.sort_unstable();
        self.roots.dedup();
    }

    fn find_discards(&mut self, context: ContextId) {
        let f = self.function(context);
        for (id, node) in f.statements.iter() {
            match node.statement {
                Statement::Kill if f.control.is_reachable(id) => {
                    let control = self.control(context, id);
                    self.roots.extend(control);
                    self.coverage.extend(control);
                }
                Statement::Call { function, .. }
                    if f.control.is_reachable(id)
                        && self.graph.may_discard(FunctionId::Function(*function)) =>
                {
                    if let Some(child) = self.enter(context, id) {
                        self.find_discards(child);
                    }
                }
                _ => {}
            }
        }
    }

    fn intern(&mut self, node: Node) -> ValueId {
        if let Some(known) = self.index.get(&node) {
            return *known;
        }
        let id = self.values.len();
        self.index.insert(node.clone(), id);
        self.values.push(Value {
            node,
            operands: Vec::new(),
            cost: 0.0,
            fact: Fact::default(),
        });
        self.own.push(Fact::default());
        id
    }

    fn enter(&mut self, context: ContextId, call: StmtId) -> Option<ContextId> {
        let f = self.function(context);
        let Statement::Call { function, .. } = f.statements.get(call).statement else {
            return None;
        };
        if let Some(child) = self.children.get(&(context, call)) {
            return Some(*child);
        }
        let child = self.contexts.len();
        self.contexts.push(Context {
            function: FunctionId::Function(*function),
            call: Some((context, call)),
            times: self.contexts[context].times * f.times[call.index()],
        });
        self.children.insert((context, call), child);
        Some(child)
    }

    /// The value of an expression, or of a part of it.
    fn value(&mut self, context: ContextId, e: Handle<Expression>, path: Vec<u32>) -> ValueId {
        let node = self.resolve(context, e, path);
        self.intern(node)
    }

    /// The value that an expression is, if anything observed rests on it.
    pub fn named(&self, context: ContextId, e: Handle<Expression>) -> Option<ValueId> {
        self.get(&self.resolve(context, e, Vec::new()))
    }

    /// The node of an expression, or of the part of it at a path: what merely names another value is that value.
    fn resolve(&self, context: ContextId, e: Handle<Expression>, path: Vec<u32>) -> Node {
        let f = self.function(context);
        let module = self.graph.module();
        match &f.function.expressions[e] {
            Expression::AccessIndex { base, index }
                if matches!(f.ty(module, *base), TypeInner::Struct { .. }) =>
            {
                // A member of a call's or a load's result stays an expression, for it can be replaced; one of an argument or of what was
                // just put together is what it was made of.
                match f.function.expressions[*base] {
                    Expression::CallResult(_) | Expression::Load { .. } => {
                        Node::Expression(context, e, path)
                    }
                    _ => {
                        let mut inner = vec![*index];
                        inner.extend(path);
                        self.resolve(context, *base, inner)
                    }
                }
            }
            Expression::Compose { ty, components }
                if matches!(module.types[*ty].inner, TypeInner::Struct { .. }) =>
            {
                match path.split_first() {
                    Some((first, rest)) => {
                        self.resolve(context, components[*first as usize], rest.to_vec())
                    }
                    None => Node::Expression(context, e, path),
                }
            }
            Expression::FunctionArgument(i) => match self.contexts[context].call {
                Some((caller, call)) => {
                    match self.function(caller).statements.get(call).statement {
                        Statement::Call { arguments, .. } => {
                            self.resolve(caller, arguments[*i as usize], path)
                        }
                        _ => Node::Expression(context, e, path),
                    }
                }
                None => match self.input(*i, &path) {
                    Some(input) => Node::Input(input),
                    None => Node::Expression(context, e, path),
                },
            },
            _ => Node::Expression(context, e, path),
        }
    }

    /// Index of the input that an argument of the entry point, or a member of it, is; `None` for a whole struct.
    fn input(&self, argument: u32, path: &[u32]) -> Option<usize> {
        let module = self.graph.module();
        let mut at = 0;
        for (i, a) in self.function(0).function.arguments.iter().enumerate() {
            let members = match &module.types[a.ty].inner {
                TypeInner::Struct { members, .. } if a.binding.is_none() => Some(members.len()),
                _ => None,
            };
            if i as u32 == argument {
                return match (members, path.first()) {
                    (Some(_), Some(m)) => Some(at + *m as usize),
                    (Some(_), None) => None,
                    (None, _) => Some(at),
                };
            }
            at += members.unwrap_or(1);
        }
        None
    }

    /// The node of what decides whether a statement runs; `None` if it always does.
    fn decider(&self, mut context: ContextId, mut statement: StmtId) -> Option<Node> {
        loop {
            if !self.function(context).control.of(statement).is_empty() {
                return Some(Node::Control(context, statement));
            }
            (context, statement) = self.contexts[context].call?;
        }
    }

    fn control(&mut self, context: ContextId, statement: StmtId) -> Option<ValueId> {
        let node = self.decider(context, statement)?;
        Some(self.intern(node))
    }

    fn expand(&mut self, id: ValueId) {
        let mut found = Vec::new();
        let own = match self.values[id].node.clone() {
            Node::Input(input) => self.of_input(input),
            Node::Expression(context, e, path) => {
                let f = self.function(context);
                if path.is_empty()
                    && let Some(at) = f.statements.evaluated_at(e)
                {
                    let times = self.contexts[context].times * f.times[at.index()];
                    self.values[id].cost = times * cost::of_expression(self.graph.module(), f, e);
                }
                self.of_expression(context, e, path, &mut found)
            }
            Node::Version(context, version) => self.of_version(context, version, &mut found),
            Node::Control(context, statement) => {
                let f = self.function(context);
                for predicate in f.control.of(statement) {
                    let p = f.statements.get(*predicate).statement;
                    if !matches!(p, Statement::Return { .. }) {
                        for e in operands::of_statement(p) {
                            found.push(self.value(context, e, Vec::new()));
                        }
                    }
                    found.extend(self.control(context, *predicate));
                }
                if let Some((caller, call)) = self.contexts[context].call {
                    found.extend(self.control(caller, call));
                }
                Fact::default()
            }
        };
        found.sort_unstable();
        found.dedup();
        self.values[id].operands = found;
        self.own[id] = own;
    }

    fn of_input(&self, input: usize) -> Fact {
        let module = self.graph.module();
        let inputs = reflect::inputs(module, self.function(0).function);
        let Some(io) = inputs.get(input) else {
            return PINNED;
        };
        io.binding.as_ref().map_or(PINNED, |b| {
            rate::of_binding(ShaderStage::Fragment, b, &module.types[io.ty].inner)
        })
    }

    fn of_expression(
        &mut self,
        context: ContextId,
        e: Handle<Expression>,
        path: Vec<u32>,
        found: &mut Vec<ValueId>,
    ) -> Fact {
        let f = self.function(context);
        let module = self.graph.module();
        let expression = &f.function.expressions[e];
        match expression {
            Expression::AccessIndex { base, index }
                if matches!(f.ty(module, *base), TypeInner::Struct { .. }) =>
            {
                let mut inner = vec![*index];
                inner.extend(path);
                found.push(self.value(context, *base, inner));
                Fact::default()
            }
            Expression::FunctionArgument(i) => {
                // A whole struct argument of the entry point.
                let ty = f.function.arguments[*i as usize].ty;
                if let TypeInner::Struct { members, .. } = &module.types[ty].inner {
                    for m in 0..members.len() as u32 {
                        found.push(self.value(context, e, vec![m]));
                    }
                }
                Fact::default()
            }
            Expression::CallResult(_) => {
                let call = f.statements.evaluated_at(e);
                let Some(child) = call.and_then(|at| self.enter(context, at)) else {
                    return PINNED;
                };
                let callee = self.function(child);
                for (id, node) in callee.statements.iter() {
                    if let Statement::Return { value: Some(value) } = node.statement
                        && callee.control.is_reachable(id)
                    {
                        found.push(self.value(child, *value, path.clone()));
                        if !callee.control.of(id).is_empty() {
                            found.extend(self.control(child, id));
                        }
                    }
                }
                Fact::default()
            }
            Expression::Load { pointer } => {
                self.indices(context, *pointer, found);
                let place = cells::place(module, f.function, *pointer);
                let base = place.as_ref().map_or(0, |p| p.path.len());
                for version in f.memory.loads.get(&e).into_iter().flatten() {
                    let at = &f.memory.cell(*version).path;
                    let apart = at
                        .get(base..)
                        .is_some_and(|rest| rest.iter().zip(&path).any(|(a, b)| a != b));
                    if !apart {
                        found.push(self.intern(Node::Version(context, *version)));
                    }
                }
                match f.ty(module, *pointer).pointer_space() {
                    Some(AddressSpace::Function | AddressSpace::Private) => Fact::default(),
                    Some(AddressSpace::Uniform | AddressSpace::Immediate) => DRAW,
                    Some(AddressSpace::Storage { access })
                        if !access.contains(naga::StorageAccess::STORE) =>
                    {
                        DRAW
                    }
                    _ => PINNED,
                }
            }
            _ => {
                for operand in operands::of_expression(expression) {
                    if f.ty(module, operand).pointer_space().is_none() {
                        found.push(self.value(context, operand, Vec::new()));
                    } else {
                        self.indices(context, operand, found);
                    }
                }
                for version in f.memory.loads.get(&e).into_iter().flatten() {
                    found.push(self.intern(Node::Version(context, *version)));
                }
                own_fact(expression)
            }
        }
    }

    /// The dynamic indices on the way to a pointer.
    fn indices(
        &mut self,
        context: ContextId,
        pointer: Handle<Expression>,
        found: &mut Vec<ValueId>,
    ) {
        let f = self.function(context);
        let mut at = pointer;
        loop {
            match f.function.expressions[at] {
                Expression::Access { base, index } => {
                    found.push(self.value(context, index, Vec::new()));
                    at = base;
                }
                Expression::AccessIndex { base, .. } => at = base,
                Expression::FunctionArgument(i) => {
                    // The caller's way to it.
                    if let Some((caller, call)) = self.contexts[context].call
                        && let Statement::Call { arguments, .. } =
                            self.function(caller).statements.get(call).statement
                    {
                        self.indices(caller, arguments[i as usize], found);
                    }
                    return;
                }
                _ => return,
            }
        }
    }

    fn of_version(
        &mut self,
        context: ContextId,
        version: VersionId,
        found: &mut Vec<ValueId>,
    ) -> Fact {
        let f = self.function(context);
        let module = self.graph.module();
        let cell = f.memory.cell(version);
        match f.memory.origin(version) {
            Origin::Initial => match (cell.root, self.contexts[context].call) {
                (Root::Local(_), _) => Fact::default(),
                (_, Some((caller, call))) => {
                    let outer = self.function(caller);
                    let Statement::Call { arguments, .. } = outer.statements.get(call).statement
                    else {
                        return PINNED;
                    };
                    let Some(place) = memory::in_caller(module, outer.function, arguments, cell)
                    else {
                        return PINNED;
                    };
                    for seen in outer.memory.reads.get(&call).into_iter().flatten() {
                        if outer.memory.cell(*seen).overlaps(place.root, &place.path) {
                            found.push(self.intern(Node::Version(caller, *seen)));
                        }
                    }
                    Fact::default()
                }
                (Root::Global(g), None)
                    if module.global_variables[g].space == AddressSpace::Private =>
                {
                    Fact::default()
                }
                _ => PINNED,
            },
            Origin::Phi { operands, .. } => {
                for operand in operands {
                    found.push(self.intern(Node::Version(context, *operand)));
                }
                Fact::default()
            }
            Origin::Written { by, over } => {
                if let Some(over) = over {
                    found.push(self.intern(Node::Version(context, *over)));
                }
                if !f.control.of(*by).is_empty() {
                    found.extend(self.control(context, *by));
                }
                match f.statements.get(*by).statement {
                    Statement::Store { pointer, value } => {
                        self.indices(context, *pointer, found);
                        let rest = cells::place(module, f.function, *pointer)
                            .filter(|p| !p.dynamic)
                            .and_then(|p| cell.path.get(p.path.len()..))
                            .unwrap_or_default();
                        let path = self.members_of(context, *value, rest);
                        found.push(self.value(context, *value, path));
                        Fact::default()
                    }
                    Statement::Call {
                        function,
                        arguments,
                        ..
                    } => {
                        let Some(child) = self.enter(context, *by) else {
                            return PINNED;
                        };
                        let callee = self.graph.function(FunctionId::Function(*function));
                        for written in callee.memory.footprint.writes.keys() {
                            let here = memory::in_caller(module, f.function, arguments, written)
                                .is_some_and(|p| cell.overlaps(p.root, &p.path));
                            if !here {
                                continue;
                            }
                            for c in callee.memory.overlapping(written.root, &written.path) {
                                if let Some(exit) = callee.memory.exit.get(&c) {
                                    found.push(self.intern(Node::Version(child, *exit)));
                                }
                            }
                        }
                        Fact::default()
                    }
                    statement => {
                        for operand in operands::of_statement(statement) {
                            if f.ty(module, operand).pointer_space().is_none() {
                                found.push(self.value(context, operand, Vec::new()));
                            }
                        }
                        PINNED
                    }
                }
            }
        }
    }

    /// The leading steps of a path into an expression that go through structs.
    fn members_of(&self, context: ContextId, e: Handle<Expression>, path: &[u32]) -> Vec<u32> {
        let module = self.graph.module();
        let f = self.function(context);
        let mut ty = f.ty(module, e);
        let mut members = Vec::new();
        for step in path {
            let TypeInner::Struct { members: all, .. } = ty else {
                break;
            };
            let Some(member) = all.get(*step as usize) else {
                break;
            };
            members.push(*step);
            ty = &module.types[member.ty].inner;
        }
        members
    }

    /// The join of own facts and operands', to a fixed point.
    fn find_facts(&mut self) {
        for (value, own) in self.values.iter_mut().zip(&self.own) {
            value.fact = *own;
        }
        let users = self.users();
        let mut work: Vec<ValueId> = (0..self.values.len()).collect();
        let mut queued = vec![true; self.values.len()];
        while let Some(id) = work.pop() {
            queued[id] = false;
            let fact = self.values[id]
                .operands
                .iter()
                .fold(self.own[id], |fact, o| fact.join(self.values[*o].fact));
            if fact != self.values[id].fact {
                self.values[id].fact = fact;
                for user in &users[id] {
                    if !std::mem::replace(&mut queued[*user], true) {
                        work.push(*user);
                    }
                }
            }
        }
    }

    /// Whether a value is tied to the fragment stage by itself, not through its operands.
    pub fn is_pinned(&self, value: ValueId) -> bool {
        !self.own[value].stages.vertex
    }
}

const DRAW: Fact = Fact::new(Rate::Draw, Stages::ANY);
const PINNED: Fact = Fact::new(Rate::Fragment, Stages::FRAGMENT);

/// What an expression adds to its operands' rate.
fn own_fact(expression: &Expression) -> Fact {
    match effect::of_expression(expression) {
        Some(Effect::Derivative | Effect::ImplicitLod) => return PINNED,
        Some(_) => return PINNED,
        None => {}
    }
    match expression {
        Expression::ImageSample { .. }
        | Expression::ImageLoad { .. }
        | Expression::ImageQuery { .. }
        | Expression::ArrayLength(_) => DRAW,
        Expression::AtomicResult { .. }
        | Expression::SubgroupBallotResult
        | Expression::SubgroupOperationResult { .. }
        | Expression::WorkGroupUniformLoadResult { .. }
        | Expression::RayQueryProceedResult
        | Expression::RayQueryGetIntersection { .. }
        | Expression::RayQueryVertexPositions { .. }
        | Expression::CooperativeLoad { .. }
        | Expression::CooperativeMultiplyAdd { .. } => PINNED,
        _ => Fact::default(),
    }
}
