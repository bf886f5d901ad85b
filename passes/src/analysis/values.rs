//! The value graph: every value of a fragment stage, with each call separate. The minimum cut
//! chooses among these.
//!
//! The dataflow graph analyses a function once for all its calls. Here each chain of calls from the
//! entry point has its own values, so that one use of a function can move without the others. Nodes
//! are expressions, memory versions, and the conditions under which statements run. Operands form
//! cycles through loop-carried values.

use std::cell::OnceCell;
use std::collections::BTreeMap;
use std::num::NonZeroU32;
use std::sync::Arc;

use naga::{Binding, BuiltIn, Expression, Handle, Scalar, Statement, TypeInner};
use rustc_hash::FxHashMap;

use crate::analysis::refusals;
use crate::analysis::users::Users;
use naga_edit::interface::{self, Io};
use preshade_dataflow::graph::memory::VersionId;
use preshade_dataflow::graph::rate::{Fact, Rate};
use preshade_dataflow::graph::{FunctionGraph, FunctionId, Graph, StmtId};
use preshade_plan::pass::Refusal;

pub(crate) mod cycle;
mod expand;
mod same;

/// A chain of calls from the entry point; 0 is the entry point itself.
pub type ContextId = usize;

/// A function in one chain of calls.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Context {
    pub function: FunctionId,
    /// Caller and call statement. `None` for the entry point.
    pub call: Option<(ContextId, StmtId)>,
    /// Number of calls that lead to it; 0 for the entry point.
    pub depth: u32,
    /// Estimated runs per fragment.
    pub times: f64,
}

/// A value's index in [`Values::values`].
pub type ValueId = usize;

/// A value's identity.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Node {
    /// An input of the entry point, by index in [`Values::inputs`].
    Input(usize),
    /// An expression, or the part of a struct expression at a path of members.
    Expression(ContextId, Handle<Expression>, Vec<u32>),
    Version(ContextId, VersionId),
    /// The condition under which a statement runs.
    Control(ContextId, StmtId),
}

#[derive(Clone, Debug, PartialEq)]
pub struct Value {
    pub node: Node,
    pub operands: Vec<ValueId>,
    /// Cost per fragment without operands, in the units of [`preshade_dataflow::graph::cost`].
    pub cost: f64,
    /// Its rate, and the stages that can compute it.
    pub fact: Fact,
}

/// All values that the observed results of a fragment depend on.
#[derive(Debug)]
pub struct Values<'g, 'p> {
    pub graph: &'g Graph<'p>,
    /// Index of the fragment entry point.
    pub entry: usize,
    /// Inputs of the entry point.
    pub inputs: Vec<Io>,
    /// Chains of calls.
    pub contexts: Vec<Context>,
    pub values: Vec<Value>,
    /// Observed values: outputs, and the conditions of discards.
    pub roots: Vec<ValueId>,
    /// The `roots` that decide coverage and depth: discards, depth, sample mask.
    pub coverage: Vec<ValueId>,
    index: FxHashMap<Node, ValueId>,
    /// Values of whole expressions by context and arena index; empty for contexts without room.
    named: Vec<Box<[Option<NonZeroU32>]>>,
    /// Number of entries that `named` may still get.
    room: usize,
    users: Arc<Users>,
    cycles: OnceCell<Vec<Vec<ValueId>>>,
    children: BTreeMap<(ContextId, StmtId), ContextId>,
    /// Facts of the values themselves, before operands.
    own: Vec<Fact>,
}

/// Most values to analyse. Beyond this, calls are nested too deeply to separate them.
pub(crate) const MOST_VALUES: usize = 200_000;

/// Most entries for direct lookup. Many calls of a large function with few observed values use
/// hashes instead.
const MOST_NAMED: usize = 8 * MOST_VALUES;

/// The shader has more than [`MOST_VALUES`] values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the fragment stage has more than {MOST_VALUES} values, each call's counted apart")]
pub struct TooLarge;

/// The refusal of a fragment stage that writes memory, by a pass that follows values.
pub(crate) fn refuse_writes(graph: &Graph<'_>, entry: usize, name: &str) -> Option<Refusal> {
    graph.writes_memory(FunctionId::EntryPoint(entry)).then(|| {
        Refusal::new(
            name,
            &refusals::FRAGMENT_STORES,
            format!(
                "the fragment stage writes memory, and `{name}` does not follow what it writes"
            ),
            "move the writes to a pass of their own",
        )
    })
}

impl<'g, 'p> Values<'g, 'p> {
    /// The values behind the outputs and discards of a fragment entry point.
    ///
    /// # Errors
    /// [`TooLarge`].
    pub fn new(graph: &'g Graph<'p>, entry: usize) -> Result<Self, TooLarge> {
        let mut this = Self {
            graph,
            entry,
            inputs: {
                let module = graph.module();
                interface::inputs(module, &module.entry_points[entry].function)
            },
            contexts: vec![Context {
                function: FunctionId::EntryPoint(entry),
                call: None,
                depth: 0,
                times: 1.0,
            }],
            values: Vec::new(),
            roots: Vec::new(),
            coverage: Vec::new(),
            index: FxHashMap::default(),
            named: Vec::new(),
            room: MOST_NAMED,
            users: Arc::default(),
            cycles: OnceCell::new(),
            children: BTreeMap::new(),
            own: Vec::new(),
        };
        this.find_roots()?;
        let mut next = 0;
        while next < this.values.len() {
            this.expand(next);
            next += 1;
            if this.values.len() > MOST_VALUES {
                return Err(TooLarge);
            }
        }
        // Callers also ask for the condition under which a value is computed, which is not an
        // operand.
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
        let operands = this.values.iter().enumerate();
        let operands = operands.flat_map(|(user, v)| v.operands.iter().map(move |o| (*o, user)));
        this.users = Arc::new(Users::new(this.values.len(), operands));
        this.find_facts();
        Ok(this)
    }

    /// The values of a stage of which the pass `name` moves some.
    ///
    /// # Errors
    /// It writes memory, or it is too large.
    pub fn examine(graph: &'g Graph<'p>, entry: usize, name: &str) -> Result<Self, Box<Refusal>> {
        match refuse_writes(graph, entry, name) {
            Some(refusal) => Err(Box::new(refusal)),
            None => Self::new(graph, entry).map_err(|e| {
                let code = &refusals::TOO_LARGE;
                Box::new(Refusal::new(name, code, e.to_string(), "split the shader"))
            }),
        }
    }

    /// Scalar type and number of components of a value that is a scalar or a vector.
    pub fn shape(&self, value: ValueId) -> Option<(Scalar, u8)> {
        let (context, e, _) = self.expression(value)?;
        match self.function(context).ty(self.graph.module(), e) {
            TypeInner::Scalar(scalar) => Some((*scalar, 1)),
            TypeInner::Vector { size, scalar } => Some((*scalar, *size as u8)),
            _ => None,
        }
    }

    pub fn function(&self, context: ContextId) -> &'g FunctionGraph<'p> {
        self.graph.function(self.contexts[context].function)
    }

    /// The value of a node, if an observed value depends on it.
    pub fn get(&self, node: &Node) -> Option<ValueId> {
        self.index.get(node).copied()
    }

    pub fn child(&self, context: ContextId, call: StmtId) -> Option<ContextId> {
        self.children.get(&(context, call)).copied()
    }

    /// The expression of a value, if the value is a whole expression that a statement evaluates.
    pub fn expression(&self, value: ValueId) -> Option<(ContextId, Handle<Expression>, StmtId)> {
        match &self.values[value].node {
            Node::Expression(context, e, path) if path.is_empty() => {
                let at = self.function(*context).statements.evaluated_at(*e)?;
                Some((*context, *e, at))
            }
            _ => None,
        }
    }

    /// The strongly connected components, users before operands.
    pub fn cycles(&self) -> &[Vec<ValueId>] {
        self.cycles.get_or_init(|| cycle::cycles(&self.values))
    }

    pub fn users(&self) -> &Arc<Users> {
        &self.users
    }

    /// Rate of the condition under which a statement runs.
    pub fn control_rate(&self, context: ContextId, statement: StmtId) -> Rate {
        self.decider(context, statement)
            .and_then(|node| self.get(&node))
            .map_or(Rate::Const, |v| self.values[v].fact.rate)
    }

    /// The values of the entry point's outputs, one for each output and return.
    pub fn outputs(&self) -> Vec<(Option<Binding>, ValueId)> {
        let module = self.graph.module();
        let f = self.function(0);
        let outputs = interface::outputs(module, f.function);
        let is_struct = f.function.result.as_ref().is_some_and(|r| {
            r.binding.is_none() && matches!(module.types[r.ty].inner, TypeInner::Struct { .. })
        });
        let mut found = Vec::new();
        for (id, node) in f.statements.iter() {
            if let Statement::Return { value: Some(value) } = node.statement
                && f.control.is_reachable(id)
            {
                for (m, output) in outputs.iter().enumerate() {
                    let path = is_struct.then_some(m as u32).into_iter().collect();
                    let root = self.get(&self.resolve(0, *value, path));
                    found.extend(root.map(|r| (output.binding.clone(), r)));
                }
            }
        }
        found
    }

    fn find_roots(&mut self) -> Result<(), TooLarge> {
        let module = self.graph.module();
        let f = self.function(0);
        let is_struct = f.function.result.as_ref().is_some_and(|r| {
            r.binding.is_none() && matches!(module.types[r.ty].inner, TypeInner::Struct { .. })
        });
        let outputs = interface::outputs(module, f.function);
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
        self.find_discards()?;
        self.roots.sort_unstable();
        self.roots.dedup();
        Ok(())
    }

    /// Finds the conditions of all discards in all chains of calls.
    fn find_discards(&mut self) -> Result<(), TooLarge> {
        let mut work = vec![0];
        while let Some(context) = work.pop() {
            let f = self.function(context);
            for (id, node) in f.statements.iter() {
                if !f.control.is_reachable(id) {
                    continue;
                }
                match node.statement {
                    Statement::Kill => {
                        let control = self.control(context, id);
                        self.roots.extend(control);
                        self.coverage.extend(control);
                    }
                    Statement::Call { function, .. }
                        if self.graph.may_discard(FunctionId::Function(*function)) =>
                    {
                        work.extend(self.enter(context, id));
                    }
                    _ => {}
                }
            }
            // The number of chains may double with each level of calls.
            if self.contexts.len() > MOST_VALUES {
                return Err(TooLarge);
            }
        }
        Ok(())
    }

    fn intern(&mut self, node: Node) -> ValueId {
        if let Some(known) = self.index.get(&node) {
            return *known;
        }
        let id = self.values.len();
        if let Node::Expression(context, e, path) = &node
            && path.is_empty()
        {
            self.name(*context, *e, id);
        }
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
            depth: self.contexts[context].depth + 1,
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

    /// The value of an expression, if an observed value depends on it.
    pub fn named(&self, context: ContextId, e: Handle<Expression>) -> Option<ValueId> {
        if let Some(known) = self.named.get(context).and_then(|n| n.get(e.index())) {
            // An alias has no value of its own.
            match known {
                Some(id) => return Some(id.get() as usize - 1),
                None if !self.is_name(context, e) => return None,
                None => {}
            }
        }
        self.get(&self.resolve(context, e, Vec::new()))
    }

    /// Records the value of a whole expression.
    fn name(&mut self, context: ContextId, e: Handle<Expression>, id: ValueId) {
        if self.named.len() <= context {
            self.named.resize_with(context + 1, Box::default);
        }
        if self.named[context].is_empty() {
            let expressions = self.function(context).function.expressions.len();
            let Some(room) = self.room.checked_sub(expressions) else {
                return;
            };
            self.room = room;
            self.named[context] = vec![None; expressions].into();
        }
        let id = u32::try_from(id + 1).ok().and_then(NonZeroU32::new);
        self.named[context][e.index()] = id;
    }

    /// Whether an expression may be an alias, which [`Self::resolve`] looks through.
    fn is_name(&self, context: ContextId, e: Handle<Expression>) -> bool {
        matches!(
            self.function(context).function.expressions[e],
            Expression::AccessIndex { .. } | Expression::FunctionArgument(_)
        )
    }

    /// The node of an expression or its part. Aliases resolve to their source.
    fn resolve(&self, context: ContextId, e: Handle<Expression>, path: Vec<u32>) -> Node {
        let f = self.function(context);
        let module = self.graph.module();
        match &f.function.expressions[e] {
            Expression::AccessIndex { base, index }
                if matches!(f.ty(module, *base), TypeInner::Struct { .. }) =>
            {
                // A member of a call's or load's result stays an expression, because it can be
                // replaced. A member of an argument or composition resolves to its source.
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

    /// The input of an entry point's argument or its member; `None` for a whole struct.
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

    /// The value of the condition under which an expression is evaluated; `None` if it always is. It is no operand: code
    /// that computes the value alone decides the condition, too.
    pub fn condition(&self, value: ValueId) -> Option<ValueId> {
        let (context, _, at) = self.expression(value)?;
        self.get(&self.decider(context, at)?)
    }

    /// The condition under which a statement runs; `None` if it always runs.
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

    /// Joins facts with those of operands to a fixed point.
    fn find_facts(&mut self) {
        for (value, own) in self.values.iter_mut().zip(&self.own) {
            value.fact = *own;
        }
        let users = Arc::clone(&self.users);
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

    /// Whether the value itself, not an operand, is pinned to the fragment stage.
    pub fn is_pinned(&self, value: ValueId) -> bool {
        !self.own[value].stages.vertex
    }
}
