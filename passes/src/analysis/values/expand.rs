//! The operands of each value.

use naga::{AddressSpace, Expression, Handle, ShaderStage, Statement, TypeInner};

use super::{ContextId, Node, ValueId, Values};
use preshade_dataflow::graph::cells::{self, Root};
use preshade_dataflow::graph::memory::{self, Origin, VersionId};
use preshade_dataflow::graph::rate::{self, Fact, Rate, Stages};
use preshade_dataflow::graph::{FunctionId, cost, effect};

impl Values<'_, '_> {
    /// Finds a value's operands, cost and fact.
    pub(super) fn expand(&mut self, id: ValueId) {
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
                        for e in naga_operands::of_statement(p) {
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
        let Some(io) = self.inputs.get(input) else {
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
                for operand in naga_operands::of_expression(expression) {
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

    /// The dynamic indices of a pointer.
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
                    // Continue in the caller.
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
                        for operand in naga_operands::of_statement(statement) {
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

    /// The leading steps of a path that select struct members.
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
}

const DRAW: Fact = Fact::new(Rate::Draw, Stages::ANY);
const PINNED: Fact = Fact::new(Rate::Fragment, Stages::FRAGMENT);

/// An expression's contribution to the rate of its operands.
fn own_fact(expression: &Expression) -> Fact {
    // A derivative or an implicit level of detail reads neighbours in the quad.
    if effect::of_expression(expression).is_some() {
        return PINNED;
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
