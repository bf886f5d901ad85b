//! WGSL's uniformity analysis (section 15.2), which naga disables in fragment stages: finds
//! operations that need uniform control flow but may run without it.
//!
//! Each function becomes a graph whose edges are dependences of values and control flow. An
//! operation's uniformity requirement must not reach the node for non-uniform sources. Requirements
//! that reach the function's own inputs apply to every call.
//!
//! As in WGSL, variables are tracked as a whole, `private` variables count as non-uniform, and
//! control flow is uniform again after a statement without jumps. A `discard` demotes lanes to
//! helpers, so control flow stays uniform. `diagnostic` filters are ignored.

use naga::{
    AddressSpace, Binding, Block, BuiltIn, Expression, Function, GatherMode, Handle, ImageClass,
    Module, SampleLevel, ShaderStage, Span, Statement, StorageAccess, SwitchCase, TypeInner,
};

use preshade_dataflow::graph::FunctionId;

/// Why uniform control flow is needed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Need {
    Derivative,
    /// A sample with an implicit level of detail.
    ImplicitLod,
    Barrier,
    UniformLoad,
    /// A subgroup or cooperative operation.
    Subgroup,
}

/// An operation in possibly non-uniform control flow, or with a possibly non-uniform operand that
/// must be uniform.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NonUniform {
    /// The function that contains it, or that calls the one with the requirement.
    pub function: FunctionId,
    pub need: Need,
    /// The operation or the call.
    pub span: Span,
}

/// All violations in a valid module, callees first.
pub fn non_uniform(module: &Module) -> Vec<NonUniform> {
    let mut summaries: Vec<Summary> = Vec::new();
    let mut found = Vec::new();
    let functions = module
        .functions
        .iter()
        .map(|(h, f)| (FunctionId::Function(h), f));
    let points = module.entry_points.iter().enumerate();
    let points = points.map(|(i, e)| (FunctionId::EntryPoint(i), &e.function));
    for (id, function) in functions.chain(points) {
        let mut walk = FunctionWalk::new(module, function, id, &summaries);
        let (end, _) = walk.block(&function.body, walk.start());
        if let Some(end) = end {
            walk.leave(&end, None);
        }
        let needs = walk.needs.iter();
        found.extend(needs.filter_map(|(node, need, span)| {
            walk.reached(*node)[MAYBE].then_some(NonUniform {
                function: id,
                need: *need,
                span: *span,
            })
        }));
        summaries.push(walk.summary());
    }
    found
}

type NodeId = usize;

/// Sources that may be non-uniform.
const MAYBE: NodeId = 0;
/// Control flow at the call of the function.
const CALLED: NodeId = 1;
const RETURNED: NodeId = 2;
/// The source of values without dependences.
const UNIFORM: NodeId = 3;
const FIXED: usize = 4;

/// Nodes for the n-th argument: itself, the memory it points to at the call, and the same on
/// return.
fn argument(n: usize) -> [NodeId; 3] {
    [0, 1, 2].map(|k| FIXED + 3 * n + k)
}

/// Dependences of a value on a function's inputs.
#[derive(Clone, Debug)]
struct Rests {
    maybe: bool,
    values: Vec<bool>,
    contents: Vec<bool>,
}

/// The summary that callers need.
#[derive(Clone, Debug)]
struct Summary {
    called: Option<Need>,
    values: Vec<Option<Need>>,
    contents: Vec<Option<Need>>,
    returned: Rests,
    left: Vec<Rests>,
}

/// A point of control flow, with the content of each variable: locals, then pointer arguments.
#[derive(Clone, Debug)]
struct FlowState {
    control: NodeId,
    variables: Vec<NodeId>,
}

/// How control may leave a statement (WGSL section 9.6).
type Behaviour = u8;
const NEXT: Behaviour = 1;
const BREAK: Behaviour = 2;
const CONTINUE: Behaviour = 4;
const RETURN: Behaviour = 8;

struct FunctionWalk<'a> {
    module: &'a Module,
    function: &'a Function,
    id: FunctionId,
    summaries: &'a [Summary],
    edges: Vec<Vec<NodeId>>,
    values: Vec<NodeId>,
    needs: Vec<(NodeId, Need, Span)>,
    breaks: Vec<Vec<FlowState>>,
    continues: Vec<Vec<FlowState>>,
}

/// The variable of a pointer.
enum Root {
    Variable(usize),
    Uniform,
    Maybe,
}

impl<'a> FunctionWalk<'a> {
    fn new(
        module: &'a Module,
        function: &'a Function,
        id: FunctionId,
        summaries: &'a [Summary],
    ) -> Self {
        let count = function.arguments.len();
        let mut walk = Self {
            module,
            function,
            id,
            summaries,
            edges: vec![Vec::new(); FIXED + 3 * count],
            values: vec![UNIFORM; function.expressions.len()],
            needs: Vec::new(),
            breaks: Vec::new(),
            continues: Vec::new(),
        };
        for (e, expression) in function.expressions.iter() {
            if let Expression::FunctionArgument(n) = expression {
                walk.values[e.index()] = argument(*n as usize)[0];
            }
        }
        if let FunctionId::EntryPoint(point) = id {
            for (n, input) in function.arguments.iter().enumerate() {
                if !is_uniform_input(module, input, module.entry_points[point].stage) {
                    walk.edges[argument(n)[0]].push(MAYBE);
                }
            }
        }
        walk
    }

    fn start(&self) -> FlowState {
        let contents = (0..self.function.arguments.len()).map(|n| argument(n)[1]);
        let locals = self.function.local_variables.iter().map(|_| UNIFORM);
        FlowState {
            control: CALLED,
            variables: locals.chain(contents).collect(),
        }
    }

    fn node(&mut self, rests_on: impl IntoIterator<Item = NodeId>) -> NodeId {
        self.edges.push(rests_on.into_iter().collect());
        self.edges.len() - 1
    }

    fn need(&mut self, node: NodeId, need: Need, span: Span) {
        self.needs.push((node, need, span));
    }

    fn value(&self, e: Handle<Expression>) -> NodeId {
        self.values[e.index()]
    }

    /// The variable of a pointer, and whether the pointer covers it wholly.
    fn root(&self, pointer: Handle<Expression>) -> (Root, bool) {
        let base = naga_operands::base(&self.function.expressions, pointer);
        let root = match self.function.expressions[base] {
            Expression::LocalVariable(local) => Root::Variable(local.index()),
            Expression::FunctionArgument(n) => {
                let n = n as usize;
                match self.module.types[self.function.arguments[n].ty].inner {
                    TypeInner::Pointer { space, .. } | TypeInner::ValuePointer { space, .. } => {
                        match space {
                            AddressSpace::Function => {
                                Root::Variable(self.function.local_variables.len() + n)
                            }
                            space => in_space(space),
                        }
                    }
                    _ => Root::Uniform,
                }
            }
            Expression::GlobalVariable(global) => {
                in_space(self.module.global_variables[global].space)
            }
            _ => Root::Maybe,
        };
        (root, base == pointer)
    }

    /// The content of a pointer's variable.
    fn content(&self, pointer: Handle<Expression>, flow: &FlowState) -> NodeId {
        match self.root(pointer).0 {
            Root::Variable(v) => flow.variables[v],
            Root::Uniform => UNIFORM,
            Root::Maybe => MAYBE,
        }
    }

    /// Records a store of `value` through a pointer.
    fn write(&mut self, pointer: Handle<Expression>, value: NodeId, flow: &mut FlowState) {
        let (Root::Variable(v), whole) = self.root(pointer) else {
            return;
        };
        let mut rests_on = vec![flow.control, value, self.value(pointer)];
        if !whole {
            rests_on.push(flow.variables[v]);
        }
        flow.variables[v] = self.node(rests_on);
    }

    fn emit(&mut self, e: Handle<Expression>, flow: &FlowState) {
        let expression = &self.function.expressions[e];
        let span = self.function.expressions.get_span(e);
        let mut rests_on = vec![flow.control];
        rests_on.extend(
            naga_operands::of_expression(expression)
                .into_iter()
                .map(|o| self.value(o)),
        );
        match expression {
            Expression::Load { pointer } => rests_on.push(self.content(*pointer, flow)),
            Expression::Derivative { .. } => {
                self.need(flow.control, Need::Derivative, span);
                rests_on.push(MAYBE);
            }
            Expression::ImageSample {
                level: SampleLevel::Auto | SampleLevel::Bias(_),
                gather: None,
                ..
            } => {
                self.need(flow.control, Need::ImplicitLod, span);
                rests_on.push(MAYBE);
            }
            Expression::ImageLoad { image, .. } if self.is_written(*image) => rests_on.push(MAYBE),
            Expression::CooperativeLoad { .. } | Expression::CooperativeMultiplyAdd { .. } => {
                self.need(flow.control, Need::Subgroup, span);
                rests_on.push(MAYBE);
            }
            Expression::RayQueryVertexPositions { .. }
            | Expression::RayQueryGetIntersection { .. } => rests_on.push(MAYBE),
            _ => {}
        }
        self.values[e.index()] = self.node(rests_on);
    }

    /// Whether a texture may also be written.
    fn is_written(&self, image: Handle<Expression>) -> bool {
        let ty = match self.function.expressions[image] {
            Expression::GlobalVariable(global) => self.module.global_variables[global].ty,
            Expression::FunctionArgument(n) => self.function.arguments[n as usize].ty,
            _ => return true,
        };
        match self.module.types[ty].inner {
            TypeInner::Image {
                class: ImageClass::Storage { access, .. },
                ..
            } => access.contains(StorageAccess::STORE),
            _ => false,
        }
    }

    /// The flow behind a block, if control reaches it, and the ways in which control may leave.
    fn block(&mut self, block: &Block, mut flow: FlowState) -> (Option<FlowState>, Behaviour) {
        let mut left = NEXT;
        for (statement, span) in block.span_iter() {
            let (next, behaviour) = self.statement(statement, *span, flow);
            left = (left & !NEXT) | behaviour;
            match next {
                Some(next) => flow = next,
                // The rest is unreachable and not analysed.
                None => return (None, left & !NEXT),
            }
        }
        (Some(flow), left)
    }

    fn statement(
        &mut self,
        statement: &Statement,
        span: Span,
        mut flow: FlowState,
    ) -> (Option<FlowState>, Behaviour) {
        match statement {
            Statement::Emit(range) => {
                for e in range.clone() {
                    self.emit(e, &flow);
                }
            }
            Statement::Block(block) => return self.block(block, flow),
            Statement::If {
                condition,
                accept,
                reject,
            } => {
                let chosen = self.value(*condition);
                let control = self.node([flow.control, chosen]);
                let branch = |walk: &mut Self, block| {
                    let flow = FlowState {
                        control,
                        variables: flow.variables.clone(),
                    };
                    walk.block(block, flow)
                };
                let (a, of_a) = branch(self, accept);
                let (b, of_b) = branch(self, reject);
                let ends = a.into_iter().chain(b).collect();
                return self.joined(flow.control, control, ends, of_a | of_b);
            }
            Statement::Switch { selector, cases } => return self.switch(*selector, cases, &flow),
            Statement::Loop {
                body,
                continuing,
                break_if,
            } => return self.turns(body, continuing, *break_if, &flow),
            Statement::Break => {
                if let Some(breaks) = self.breaks.last_mut() {
                    breaks.push(flow);
                }
                return (None, BREAK);
            }
            Statement::Continue => {
                if let Some(continues) = self.continues.last_mut() {
                    continues.push(flow);
                }
                return (None, CONTINUE);
            }
            Statement::Return { value } => {
                let value = value.map(|v| self.value(v));
                self.leave(&flow, value);
                return (None, RETURN);
            }
            Statement::Store { pointer, value } => {
                let value = self.value(*value);
                self.write(*pointer, value, &mut flow);
            }
            Statement::Call {
                function,
                arguments,
                result,
            } => self.call(*function, arguments, *result, span, &mut flow),
            Statement::ControlBarrier(_) => self.need(flow.control, Need::Barrier, span),
            Statement::WorkGroupUniformLoad { pointer, result } => {
                let pointer = self.value(*pointer);
                self.need(flow.control, Need::UniformLoad, span);
                self.need(pointer, Need::UniformLoad, span);
                self.values[result.index()] = self.node([flow.control, pointer]);
            }
            Statement::SubgroupGather { mode, .. } => {
                self.need(flow.control, Need::Subgroup, span);
                if let GatherMode::ShuffleDown(by)
                | GatherMode::ShuffleUp(by)
                | GatherMode::ShuffleXor(by) = mode
                {
                    let by = self.value(*by);
                    self.need(by, Need::Subgroup, span);
                }
                self.unknown(statement);
            }
            Statement::SubgroupBallot { .. }
            | Statement::SubgroupCollectiveOperation { .. }
            | Statement::CooperativeStore { .. } => {
                self.need(flow.control, Need::Subgroup, span);
                self.unknown(statement);
            }
            // WGSL's discard is a demotion.
            Statement::Kill | Statement::MemoryBarrier(_) => {}
            Statement::ImageStore { .. }
            | Statement::Atomic { .. }
            | Statement::ImageAtomic { .. }
            | Statement::RayQuery { .. }
            | Statement::RayPipelineFunction(_) => self.unknown(statement),
        }
        (Some(flow), NEXT)
    }

    fn switch(
        &mut self,
        selector: Handle<Expression>,
        cases: &[SwitchCase],
        flow: &FlowState,
    ) -> (Option<FlowState>, Behaviour) {
        let chosen = self.value(selector);
        let control = self.node([flow.control, chosen]);
        self.breaks.push(Vec::new());
        let mut ends = Vec::new();
        let mut left = 0;
        let mut fallen: Option<FlowState> = None;
        for case in cases {
            let mut starts = vec![FlowState {
                control,
                variables: flow.variables.clone(),
            }];
            starts.extend(fallen.take());
            let start = self.merged(starts);
            let (end, behaviour) = self.block(&case.body, start);
            match case.fall_through {
                true => {
                    fallen = end;
                    left |= behaviour & !NEXT;
                }
                false => {
                    ends.extend(end);
                    left |= behaviour;
                }
            }
        }
        ends.extend(self.breaks.pop().unwrap_or_default());
        if left & BREAK != 0 {
            left = (left & !BREAK) | NEXT;
        }
        self.joined(flow.control, control, ends, left)
    }

    /// A statement's result, if any, may be non-uniform.
    fn unknown(&mut self, statement: &Statement) {
        if let Some(result) = naga_operands::result(statement) {
            self.values[result.index()] = MAYBE;
        }
    }

    /// Behind branches entered in `within` and ending in `ends`: control flow is as before unless a
    /// jump leaves them.
    fn joined(
        &mut self,
        ahead: NodeId,
        within: NodeId,
        ends: Vec<FlowState>,
        left: Behaviour,
    ) -> (Option<FlowState>, Behaviour) {
        if ends.is_empty() {
            return (None, left & !NEXT);
        }
        let mut flow = self.merged(ends);
        flow.control = match left {
            NEXT => ahead,
            _ => self.node([within, flow.control]),
        };
        (Some(flow), left)
    }

    /// The merge of at least one flow.
    fn merged(&mut self, mut flows: Vec<FlowState>) -> FlowState {
        let Some(last) = flows.pop() else {
            return self.start();
        };
        flows.into_iter().fold(last, |a, b| {
            let mut both = |a, b| match a == b {
                true => a,
                false => self.node([a, b]),
            };
            FlowState {
                control: both(a.control, b.control),
                variables: a
                    .variables
                    .iter()
                    .zip(&b.variables)
                    .map(|(a, b)| both(*a, *b))
                    .collect(),
            }
        })
    }

    fn turns(
        &mut self,
        body: &Block,
        continuing: &Block,
        break_if: Option<Handle<Expression>>,
        ahead: &FlowState,
    ) -> (Option<FlowState>, Behaviour) {
        let head = FlowState {
            control: self.node([ahead.control]),
            variables: ahead.variables.iter().map(|v| self.node([*v])).collect(),
        };
        self.breaks.push(Vec::new());
        self.continues.push(Vec::new());
        let (end, mut left) = self.block(body, head.clone());
        let mut ends = self.continues.pop().unwrap_or_default();
        ends.extend(end);
        if !ends.is_empty() {
            let start = self.merged(ends);
            let (end, behaviour) = self.block(continuing, start);
            left |= behaviour;
            if let Some(mut end) = end {
                if let Some(condition) = break_if {
                    let condition = self.value(condition);
                    end.control = self.node([end.control, condition]);
                    if let Some(breaks) = self.breaks.last_mut() {
                        breaks.push(end.clone());
                    }
                    left |= BREAK;
                }
                self.edges[head.control].push(end.control);
                for (header, last) in head.variables.iter().zip(end.variables) {
                    self.edges[*header].push(last);
                }
            }
        }
        let breaks = self.breaks.pop().unwrap_or_default();
        left &= !(NEXT | CONTINUE);
        if left & BREAK != 0 {
            left = (left & !BREAK) | NEXT;
        }
        if breaks.is_empty() {
            return (None, left & !NEXT);
        }
        let mut flow = self.merged(breaks);
        flow.control = match left {
            NEXT => ahead.control,
            _ => head.control,
        };
        (Some(flow), left)
    }

    fn call(
        &mut self,
        function: Handle<Function>,
        arguments: &[Handle<Expression>],
        result: Option<Handle<Expression>>,
        span: Span,
        flow: &mut FlowState,
    ) {
        let summary = &self.summaries[function.index()];
        if let Some(need) = summary.called {
            self.need(flow.control, need, span);
        }
        let values: Vec<NodeId> = arguments.iter().map(|a| self.value(*a)).collect();
        let contents: Vec<NodeId> = arguments.iter().map(|a| self.content(*a, flow)).collect();
        for (needs, nodes) in [(&summary.values, &values), (&summary.contents, &contents)] {
            for (need, node) in needs.iter().zip(nodes) {
                if let Some(need) = need {
                    self.need(*node, *need, span);
                }
            }
        }
        let control = flow.control;
        let made = |walk: &mut Self, rests: &Rests| {
            let chosen = |of: &[bool], nodes: &[NodeId]| -> Vec<NodeId> {
                let chosen = of.iter().zip(nodes).filter(|(of, _)| **of);
                chosen.map(|(_, node)| *node).collect()
            };
            let mut rests_on = vec![control];
            rests_on.extend(rests.maybe.then_some(MAYBE));
            rests_on.extend(chosen(&rests.values, &values));
            rests_on.extend(chosen(&rests.contents, &contents));
            walk.node(rests_on)
        };
        if let Some(result) = result {
            self.values[result.index()] = made(self, &summary.returned);
        }
        let callee = &self.module.functions[function];
        for ((pointer, left), parameter) in
            arguments.iter().zip(&summary.left).zip(&callee.arguments)
        {
            let inner = &self.module.types[parameter.ty].inner;
            if matches!(
                inner,
                TypeInner::Pointer { .. } | TypeInner::ValuePointer { .. }
            ) {
                let left = made(self, left);
                self.write(*pointer, left, flow);
            }
        }
    }

    /// A return, or the end of the body.
    fn leave(&mut self, flow: &FlowState, value: Option<NodeId>) {
        self.edges[RETURNED].push(flow.control);
        self.edges[RETURNED].extend(value);
        let locals = self.function.local_variables.len();
        for n in 0..self.function.arguments.len() {
            self.edges[argument(n)[2]].push(flow.variables[locals + n]);
        }
    }

    /// All nodes that a node depends on, including itself.
    fn reached(&self, from: NodeId) -> Vec<bool> {
        let mut reached = vec![false; self.edges.len()];
        let mut stack = vec![from];
        while let Some(node) = stack.pop() {
            if !std::mem::replace(&mut reached[node], true) {
                stack.extend(&self.edges[node]);
            }
        }
        reached
    }

    fn rests(&self, node: NodeId) -> Rests {
        let reached = self.reached(node);
        let of = |kind: usize| {
            let arguments = 0..self.function.arguments.len();
            arguments.map(|n| reached[argument(n)[kind]]).collect()
        };
        Rests {
            maybe: reached[MAYBE],
            values: of(0),
            contents: of(1),
        }
    }

    fn summary(&self) -> Summary {
        let count = self.function.arguments.len();
        let mut summary = Summary {
            called: None,
            values: vec![None; count],
            contents: vec![None; count],
            returned: self.rests(RETURNED),
            left: (0..count).map(|n| self.rests(argument(n)[2])).collect(),
        };
        // Entry points have no callers.
        if let FunctionId::EntryPoint(_) = self.id {
            return summary;
        }
        for (node, need, _) in &self.needs {
            let reached = self.reached(*node);
            let ask = |of: &mut Option<Need>, is_reached: bool| {
                if is_reached {
                    of.get_or_insert(*need);
                }
            };
            ask(&mut summary.called, reached[CALLED]);
            for n in 0..count {
                let [value, content, _] = argument(n);
                ask(&mut summary.values[n], reached[value]);
                ask(&mut summary.contents[n], reached[content]);
            }
        }
        summary
    }
}

/// The result of a load from an address space other than the function's own.
fn in_space(space: AddressSpace) -> Root {
    match space {
        AddressSpace::Uniform | AddressSpace::Handle | AddressSpace::Immediate => Root::Uniform,
        AddressSpace::Storage { access } if !access.contains(StorageAccess::STORE) => Root::Uniform,
        _ => Root::Maybe,
    }
}

/// Whether an input of an entry point is uniform. A struct is as uniform as all its members
/// together.
fn is_uniform_input(module: &Module, input: &naga::FunctionArgument, stage: ShaderStage) -> bool {
    let is_uniform = |binding: Option<&Binding>| match binding {
        Some(Binding::BuiltIn(builtin)) => match builtin {
            BuiltIn::WorkGroupId | BuiltIn::NumWorkGroups | BuiltIn::WorkGroupSize => true,
            BuiltIn::NumSubgroups | BuiltIn::SubgroupSize => stage == ShaderStage::Compute,
            _ => false,
        },
        _ => false,
    };
    match (&input.binding, &module.types[input.ty].inner) {
        (None, TypeInner::Struct { members, .. }) => {
            members.iter().all(|m| is_uniform(m.binding.as_ref()))
        }
        (binding, _) => is_uniform(binding.as_ref()),
    }
}
