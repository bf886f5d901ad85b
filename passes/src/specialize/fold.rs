//! The partial evaluator: a stage with what is known of its inputs becomes the same stage with the branches that are never taken left out.
//!
//! Online partial evaluation (Jones, Gomard and Sestoft, *Partial Evaluation and Automatic Program Generation*, 1993): the author's statements are walked in their order with what is known of
//! each value, and copied into fresh arenas as they are walked. What rests on no assumption is left to the compiler as it stands. A function that is called with different knowledge becomes
//! several; one in which nothing folds stays one.

use std::collections::{BTreeMap, BTreeSet};

use naga::{
    Arena, Block, Expression, Function, Handle, Literal, Module, Span, Statement, SwitchCase,
    SwitchValue,
};

use super::assume::Assumptions;
use super::decision::{Arm, Decision, Kind};
use super::known::{Known, Sources};
use super::params::Fold;
use crate::graph::{FunctionGraph, FunctionId, Graph, Rate, StmtId, operands};
use crate::place;

/// Most versions of one function; further calls get the one that knows nothing of its arguments.
const MOST_VERSIONS: usize = 24;

/// Folds stages of a program.
pub struct Folder<'p> {
    pub(super) graph: &'p Graph<'p>,
    pub(super) module: &'p Module,
    pub(super) assumptions: &'p Assumptions,
    pub(super) fold: Fold,
    /// Turns of a loop that are written out, at most.
    pub(super) turns: u32,
    /// The functions of the module under construction.
    pub(super) functions: Arena<Function>,
    versions: BTreeMap<Handle<Function>, Vec<Version>>,
    /// What was decided, and what was left open though the draw decides it.
    pub decisions: Vec<Decision>,
    /// The stage that is being folded.
    stage: &'static str,
    /// Decisions around the present statement, in callers too.
    within: Vec<usize>,
    /// Decisions numbered so far.
    numbered: usize,
    /// Assumptions that something rests on.
    pub(super) used: BTreeSet<usize>,
    /// Float operations that were left out for what they add or multiply by.
    pub roundings: u32,
}

/// A function with what is known of its arguments.
struct Version {
    arguments: Vec<Known>,
    function: Handle<Function>,
    result: Known,
}

/// A function on its way.
pub(super) struct Frame<'p> {
    pub id: FunctionId,
    pub original: &'p Function,
    pub f: &'p FunctionGraph<'p>,
    pub function: Function,
    /// The copy of each of the author's expressions.
    pub map: Vec<Option<Handle<Expression>>>,
    pub known: Vec<Known>,
    pub arguments: Vec<Known>,
    /// What is known of each local variable.
    pub locals: Vec<Known>,
    /// What is known of what it returned so far; `None`: nothing was returned yet.
    returned: Option<Known>,
    breaks: Vec<Breaks>,
    /// Length of the expression arena where the present `Emit` began.
    emitting: Option<usize>,
    span: Span,
    /// How often it runs for one run of the stage, as far as that can be told.
    weight: f64,
    /// What it rests on that the present statement runs at all: what is known behind it rests on that too.
    pub running: Sources,
    /// Something was folded in it.
    pub changed: bool,
    /// Loops around that are being written out: what is known in them holds for this turn alone, whatever it rests on.
    pub turning: u32,
}

/// Where a `break` goes.
enum Breaks {
    Loop,
    /// With what is known of the locals at each.
    Switch(Vec<Vec<Known>>),
}

/// How a block ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Flow {
    Next,
    Break,
    Continue,
    Return,
    /// In one of several ways that are not the first.
    Away,
}

impl<'p> Folder<'p> {
    /// A folder that has not folded anything.
    pub fn new(graph: &'p Graph<'p>, assumptions: &'p Assumptions, fold: Fold, turns: u32) -> Self {
        Self {
            graph,
            module: graph.module(),
            assumptions,
            fold,
            turns,
            functions: Arena::new(),
            versions: BTreeMap::new(),
            decisions: Vec::new(),
            stage: "",
            within: Vec::new(),
            numbered: 0,
            used: BTreeSet::new(),
            roundings: 0,
        }
    }

    /// The stage, what is known of its result, and whether anything was folded in it.
    pub fn stage(&mut self, entry: usize, arguments: Vec<Known>) -> (Function, Known, bool) {
        self.stage = match self.module.entry_points[entry].stage {
            naga::ShaderStage::Vertex => "vertex",
            _ => "fragment",
        };
        self.run(FunctionId::EntryPoint(entry), arguments, 1.0)
    }

    /// The functions that stages call.
    pub fn into_functions(self) -> Arena<Function> {
        self.functions
    }

    /// The assumptions that anything folded rests on.
    pub fn used(&self) -> &BTreeSet<usize> {
        &self.used
    }

    pub(super) fn rests_on(&mut self, sources: &Sources) {
        self.used.extend(sources.iter().copied());
    }

    fn run(
        &mut self,
        id: FunctionId,
        arguments: Vec<Known>,
        weight: f64,
    ) -> (Function, Known, bool) {
        let f = self.graph.function(id);
        let original = f.function;
        let mut frame = Frame {
            id,
            original,
            f,
            function: Function {
                name: original.name.clone(),
                arguments: original.arguments.clone(),
                result: original.result.clone(),
                local_variables: original.local_variables.clone(),
                diagnostic_filter_leaf: original.diagnostic_filter_leaf,
                ..Function::default()
            },
            map: vec![None; original.expressions.len()],
            known: vec![Known::Unknown; original.expressions.len()],
            arguments,
            locals: Vec::new(),
            returned: None,
            breaks: Vec::new(),
            emitting: None,
            span: Span::UNDEFINED,
            weight,
            running: Sources::default(),
            changed: false,
            turning: 0,
        };
        let mut body = Block::new();
        // Constants, arguments and variables stand ahead of all statements.
        for (e, _) in original.expressions.iter() {
            if f.statements.evaluated_at(e).is_none() {
                self.copy(&mut frame, e, &mut body, true);
            }
        }
        frame.locals = original
            .local_variables
            .iter()
            .map(|(_, v)| match v.init {
                Some(init) => frame.known[init.index()].clone(),
                None => super::expressions::zero(self.module, v.ty),
            })
            .collect();
        let locals = original.local_variables.len();
        place::initialise(original, &mut frame.function, locals);
        self.block(&mut frame, &original.body, StmtId::from(0), &mut body);
        frame.function.body = body;
        (
            frame.function,
            frame.returned.unwrap_or_default(),
            frame.changed,
        )
    }

    /// The version of a function for what is known of the arguments of a call, and what is known of its result.
    fn version(
        &mut self,
        callee: Handle<Function>,
        arguments: Vec<Known>,
        weight: f64,
    ) -> (Handle<Function>, Known) {
        let arguments: Vec<Known> = arguments.into_iter().map(Known::settled).collect();
        let unknown = || vec![Known::Unknown; arguments.len()];
        let find = |versions: &[Version], arguments: &[Known]| {
            let same = versions.iter().find(|v| v.arguments == arguments);
            same.map(|v| (v.function, v.result.clone()))
        };
        let versions = self.versions.entry(callee).or_default();
        if let Some(found) = find(versions, &arguments) {
            return found;
        }
        if versions.len() >= MOST_VERSIONS {
            return match find(versions, &unknown()) {
                Some(found) => found,
                None => self.make(callee, unknown(), weight).0,
            };
        }
        let knows = arguments.iter().any(|a| *a != Known::Unknown);
        if !knows {
            return self.make(callee, arguments, weight).0;
        }
        let (made, changed) = self.make(callee, arguments.clone(), weight);
        if changed {
            return made;
        }
        // Nothing folds that would not fold for any call: one function serves them, though this call's result may be known.
        let versions = self.versions.entry(callee).or_default();
        let generic = match find(versions, &unknown()) {
            Some((function, _)) => function,
            None => {
                // What is decided in it was noted a moment ago.
                let noted = self.decisions.len();
                let made = self.make(callee, unknown(), weight).0.0;
                self.decisions.truncate(noted);
                made
            }
        };
        let versions = self.versions.entry(callee).or_default();
        for version in versions.iter_mut().filter(|v| v.arguments == arguments) {
            version.function = generic;
        }
        (generic, made.1)
    }

    fn make(
        &mut self,
        callee: Handle<Function>,
        arguments: Vec<Known>,
        weight: f64,
    ) -> ((Handle<Function>, Known), bool) {
        let id = FunctionId::Function(callee);
        let (function, result, changed) = self.run(id, arguments.clone(), weight);
        let span = self.module.functions.get_span(callee);
        let function = self.functions.append(function, span);
        self.versions.entry(callee).or_default().push(Version {
            arguments,
            function,
            result: result.clone(),
        });
        ((function, result), changed)
    }

    /// Copies a block whose first statement has the number `first`.
    pub(super) fn block(
        &mut self,
        frame: &mut Frame<'p>,
        block: &'p Block,
        first: StmtId,
        out: &mut Block,
    ) -> Flow {
        let mut id = first;
        for (statement, span) in block.span_iter() {
            frame.span = *span;
            let flow = self.statement(frame, statement, id, out);
            if flow != Flow::Next {
                frame.flush(out);
                return flow;
            }
            id = frame.f.statements.get(id).end;
        }
        frame.flush(out);
        Flow::Next
    }

    fn statement(
        &mut self,
        frame: &mut Frame<'p>,
        statement: &'p Statement,
        id: StmtId,
        out: &mut Block,
    ) -> Flow {
        let inside = StmtId::from(id.index() + 1);
        let span = frame.span;
        match statement {
            Statement::Emit(range) => {
                for e in range.clone() {
                    self.copy(frame, e, out, false);
                }
                return Flow::Next;
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
                if let Some(Breaks::Switch(states)) = frame.breaks.last_mut() {
                    states.push(locals);
                }
                frame.flush(out);
                out.push(Statement::Break, span);
                return Flow::Break;
            }
            Statement::Continue => {
                frame.flush(out);
                out.push(Statement::Continue, span);
                return Flow::Continue;
            }
            Statement::Return { value } => {
                let known = value.map_or(Known::Unknown, |v| frame.known[v.index()].clone());
                let known = known.resting_on(&frame.running);
                let value = value.map(|v| self.read(frame, v, out));
                frame.flush(out);
                out.push(Statement::Return { value }, span);
                frame.returned = Some(match frame.returned.take() {
                    Some(before) => before.join(&known),
                    None => known,
                });
                return Flow::Return;
            }
            Statement::Store { pointer, value } => {
                let known = frame.known[value.index()]
                    .clone()
                    .resting_on(&frame.running);
                frame.store(*pointer, known);
                let value = self.read(frame, *value, out);
                let pointer = frame.mapped(*pointer);
                frame.flush(out);
                out.push(Statement::Store { pointer, value }, span);
            }
            Statement::Call {
                function,
                arguments,
                result,
            } => {
                let known = arguments
                    .iter()
                    .map(|a| frame.known[a.index()].clone())
                    .collect();
                let times = frame.weight * frame.f.times[id.index()];
                let (callee, returned) = self.version(*function, known, times);
                frame.changed |= self.is_folded(*function, callee);
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
            other => {
                frame.flush(out);
                let mut copy = operands::shell(other);
                operands::map_statement(&mut copy, &mut |e| *e = frame.mapped(*e));
                if let Some(result) = operands::result_mut(&mut copy) {
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
        Flow::Next
    }

    /// Whether a version is another function than the one that every call could go to.
    fn is_folded(&self, original: Handle<Function>, version: Handle<Function>) -> bool {
        let versions = self.versions.get(&original).map_or(&[][..], |v| v);
        let generic = versions
            .iter()
            .find(|v| v.arguments.iter().all(|a| *a == Known::Unknown));
        generic.is_none_or(|g| g.function != version)
    }

    fn branch(
        &mut self,
        frame: &mut Frame<'p>,
        id: StmtId,
        condition: Handle<Expression>,
        [accept, reject]: [&'p Block; 2],
        out: &mut Block,
    ) -> Flow {
        let [first, second] = frame.arms(id, accept);
        let arms = [(first, second), (second, frame.f.statements.get(id).end)];
        let depth = self.within.len();
        let decision = self.decide(frame, id, condition, Kind::Branch, &arms);
        self.within.extend(decision);
        let flow = self.arms(frame, condition, [accept, reject], [first, second], out);
        self.within.truncate(depth);
        flow
    }

    /// Both arms of a branch, or the one that is taken.
    fn arms(
        &mut self,
        frame: &mut Frame<'p>,
        condition: Handle<Expression>,
        [accept, reject]: [&'p Block; 2],
        [first, second]: [StmtId; 2],
        out: &mut Block,
    ) -> Flow {
        let span = frame.span;
        let known = frame.known[condition.index()].clone();
        if let Some((truth, sources)) = known.assumed_truth() {
            self.rests_on(sources);
            frame.changed = true;
            let outside = frame.run_on(sources, [accept, reject].into_iter());
            let (block, from) = match truth {
                true => (accept, first),
                false => (reject, second),
            };
            // A front end may drop what stands behind a discard in one block.
            if !block.iter().any(|s| matches!(s, Statement::Kill)) {
                let flow = self.block(frame, block, from, out);
                frame.running = outside;
                return flow;
            }
            let mut taken = Block::new();
            frame.flush(out);
            let flow = self.block(frame, block, from, &mut taken);
            frame.running = outside;
            let condition = frame.literal(Literal::Bool(true), out);
            out.push(
                Statement::If {
                    condition,
                    accept: taken,
                    reject: Block::new(),
                },
                span,
            );
            return flow;
        }
        let condition = frame.mapped(condition);
        frame.flush(out);
        let before = frame.locals.clone();
        let (mut accepted, mut rejected) = (Block::new(), Block::new());
        let yes = self.block(frame, accept, first, &mut accepted);
        let after_yes = std::mem::replace(&mut frame.locals, before);
        let no = self.block(frame, reject, second, &mut rejected);
        match (yes == Flow::Next, no == Flow::Next, known.truth()) {
            (true, false, _) | (true, true, Some(true)) => frame.locals = after_yes,
            (true, true, None) => frame.locals = join(&after_yes, &frame.locals),
            _ => {}
        }
        out.push(
            Statement::If {
                condition,
                accept: accepted,
                reject: rejected,
            },
            span,
        );
        match (yes, no) {
            (Flow::Next, _) | (_, Flow::Next) => Flow::Next,
            (a, b) if a == b => a,
            _ => Flow::Away,
        }
    }

    fn switch(
        &mut self,
        frame: &mut Frame<'p>,
        id: StmtId,
        selector: Handle<Expression>,
        cases: &'p [SwitchCase],
        out: &mut Block,
    ) -> Flow {
        let span = frame.span;
        let starts = frame.starts(id, cases.iter().map(|c| &c.body));
        let end = frame.f.statements.get(id).end;
        let arms: Vec<_> = starts
            .iter()
            .zip(starts.iter().skip(1).chain([&end]))
            .map(|(a, b)| (*a, *b))
            .collect();
        self.decide(frame, id, selector, Kind::Switch, &arms);
        let falls = cases.iter().any(|c| c.fall_through);
        let taken = match frame.known[selector.index()].literal() {
            Some((literal, sources)) if !falls => {
                let sources = Sources::clone(sources);
                taken(cases, literal).map(|case| (case, sources))
            }
            _ => None,
        };
        if let Some((case, sources)) = taken {
            self.rests_on(&sources);
            frame.changed = true;
            let mut body = Block::new();
            frame.flush(out);
            frame.breaks.push(Breaks::Switch(Vec::new()));
            let outside = frame.run_on(&sources, cases.iter().map(|c| &c.body));
            let flow = self.block(frame, &cases[case].body, starts[case], &mut body);
            frame.running = outside;
            let broken = frame.leave();
            let ends = matches!(body.last(), Some(Statement::Break));
            let jumps = body.len() - usize::from(ends);
            let flow = match flow {
                Flow::Break => Flow::Next,
                flow => flow,
            };
            if !body[..jumps].iter().any(|s| has_jump(s, Jump::Break)) {
                for (i, (statement, span)) in body.span_into_iter().enumerate() {
                    if i < jumps {
                        out.push(statement, span);
                    }
                }
                return flow;
            }
            frame.locals = joined(frame.locals.clone(), flow, broken);
            let selector = frame.literal(Literal::U32(0), out);
            let only = SwitchCase {
                value: SwitchValue::Default,
                body,
                fall_through: false,
            };
            let cases = vec![only];
            out.push(Statement::Switch { selector, cases }, span);
            return Flow::Next;
        }
        if falls {
            frame.forget_stored(cases.iter().map(|c| &c.body));
        }
        let selector = frame.mapped(selector);
        frame.flush(out);
        let before = frame.locals.clone();
        let mut ends: Vec<Vec<Known>> = Vec::new();
        let mut flows = Vec::new();
        let mut copies = Vec::new();
        for (case, first) in cases.iter().zip(starts) {
            frame.locals.clone_from(&before);
            frame.breaks.push(Breaks::Switch(Vec::new()));
            let mut body = Block::new();
            let flow = self.block(frame, &case.body, first, &mut body);
            let broken = frame.leave();
            if flow == Flow::Next || !broken.is_empty() {
                flows.push(Flow::Next);
            } else {
                flows.push(flow);
            }
            if flow == Flow::Next {
                ends.push(frame.locals.clone());
            }
            ends.extend(broken);
            copies.push(SwitchCase {
                value: case.value,
                body,
                fall_through: case.fall_through,
            });
        }
        frame.locals = match ends.into_iter().reduce(|a, b| join(&a, &b)) {
            Some(end) if !falls => end,
            _ => {
                frame.locals = before;
                frame.forget_stored(cases.iter().map(|c| &c.body));
                std::mem::take(&mut frame.locals)
            }
        };
        let cases = copies;
        out.push(Statement::Switch { selector, cases }, span);
        match flows.iter().all(|f| *f == Flow::Return) {
            true => Flow::Return,
            false if flows.contains(&Flow::Next) => Flow::Next,
            false => Flow::Away,
        }
    }

    fn looped(
        &mut self,
        frame: &mut Frame<'p>,
        id: StmtId,
        body: &'p Block,
        continuing: &'p Block,
        break_if: Option<Handle<Expression>>,
        out: &mut Block,
    ) -> Flow {
        let span = frame.span;
        let starts = frame.starts(id, [body, continuing].into_iter());
        frame.flush(out);
        let written = self.written_out(frame, &starts, [body, continuing], break_if);
        if let Some((written, flow, turns)) = written {
            self.decide_loop(frame, id, body, Some(turns));
            frame.changed = true;
            for (statement, span) in written.span_into_iter() {
                out.push(statement, span);
            }
            return flow;
        }
        // What is stored in it is not known at the start of a turn, nor behind it.
        frame.forget_stored([body, continuing].into_iter());
        let outside = frame.locals.clone();
        let (mut turn, mut end) = (Block::new(), Block::new());
        frame.breaks.push(Breaks::Loop);
        self.block(frame, body, starts[0], &mut turn);
        frame.locals.clone_from(&outside);
        self.block(frame, continuing, starts[1], &mut end);
        frame.leave();
        self.decide_loop(frame, id, body, None);
        frame.locals = outside;
        let break_if = break_if.map(|e| frame.mapped(e));
        out.push(
            Statement::Loop {
                body: turn,
                continuing: end,
                break_if,
            },
            span,
        );
        Flow::Next
    }

    /// The turns of a loop one after the other, where assumptions decide how many there are, and they are few.
    fn written_out(
        &mut self,
        frame: &mut Frame<'p>,
        starts: &[StmtId],
        [body, continuing]: [&'p Block; 2],
        break_if: Option<Handle<Expression>>,
    ) -> Option<(Block, Flow, u32)> {
        /// Expressions that may be added.
        const MOST_ADDED: usize = 400;
        let function = frame.function.clone();
        let (map, known) = (frame.map.clone(), frame.known.clone());
        let locals = frame.locals.clone();
        let (returned, changed) = (frame.returned.clone(), frame.changed);
        let running = Sources::clone(&frame.running);
        let (used, decisions) = (self.used.clone(), self.decisions.len());
        let roundings = self.roundings;
        let mut all = Block::new();
        frame.breaks.push(Breaks::Loop);
        frame.turning += 1;
        let mut ended = None;
        for number in 0..=self.turns {
            let mut turn = Block::new();
            let flow = self.block(frame, body, starts[0], &mut turn);
            let jumps = matches!(turn.last(), Some(Statement::Break | Statement::Continue));
            let kept = turn.len() - usize::from(jumps);
            let is_plain = !turn[..kept]
                .iter()
                .any(|s| has_jump(s, Jump::Break) || has_jump(s, Jump::Continue));
            if !is_plain {
                break;
            }
            for (i, (statement, span)) in turn.span_into_iter().enumerate() {
                if i < kept {
                    all.push(statement, span);
                }
            }
            match flow {
                Flow::Break => ended = Some((Flow::Next, number)),
                Flow::Return => ended = Some((Flow::Return, number + 1)),
                Flow::Away => break,
                Flow::Next | Flow::Continue => {}
            }
            if ended.is_some()
                || frame.function.expressions.len() > function.expressions.len() + MOST_ADDED
            {
                break;
            }
            self.block(frame, continuing, starts[1], &mut all);
            if let Some(condition) = break_if {
                match frame.known[condition.index()].clone().assumed_truth() {
                    Some((true, sources)) => {
                        self.rests_on(sources);
                        ended = Some((Flow::Next, number + 1));
                        break;
                    }
                    Some((false, sources)) => self.rests_on(sources),
                    None => break,
                }
            }
        }
        frame.leave();
        frame.turning -= 1;
        if let Some((flow, turns)) = ended {
            return Some((all, flow, turns));
        }
        frame.function = function;
        (frame.map, frame.known, frame.locals) = (map, known, locals);
        (frame.returned, frame.changed) = (returned, changed);
        frame.running = running;
        self.used = used;
        self.decisions.truncate(decisions);
        self.roundings = roundings;
        None
    }

    /// Notes a condition that the draw decides, known or not.
    fn decide(
        &mut self,
        frame: &Frame<'p>,
        id: StmtId,
        condition: Handle<Expression>,
        kind: Kind,
        arms: &[(StmtId, StmtId)],
    ) -> Option<usize> {
        let known = &frame.known[condition.index()];
        let sources = match known {
            Known::Scalar(_, sources) => Sources::clone(sources),
            _ => Sources::default(),
        };
        let is_uniform = self.graph.rate(frame.id, condition) == Rate::Draw;
        if sources.is_empty() && !is_uniform {
            return None;
        }
        let taken = match (kind, known.literal()) {
            (Kind::Branch, _) => known.assumed_truth().map(|(t, _)| usize::from(!t)),
            (Kind::Switch, Some((literal, _))) => match frame.f.statements.get(id).statement {
                Statement::Switch { cases, .. } => taken(cases, literal),
                _ => None,
            },
            _ => None,
        };
        let arms = arms.iter().map(|(a, b)| Arm {
            statements: (*a, *b),
            cost: frame.weight * super::decision::cost(self.graph, frame.id, *a, *b),
        });
        let id = self.note(Decision {
            id: 0,
            within: None,
            stage: self.stage,
            function: frame.id,
            statement: id,
            condition,
            kind,
            taken,
            arms: arms.collect(),
            sources,
        });
        Some(id)
    }

    /// Numbers a decision and keeps it.
    fn note(&mut self, decision: Decision) -> usize {
        let id = self.numbered;
        self.numbered += 1;
        self.decisions.push(Decision {
            id,
            within: self.within.last().copied(),
            ..decision
        });
        id
    }

    /// Notes a loop in place of the branch at its head, which is what ends it. `turns`: how many were written out.
    fn decide_loop(&mut self, frame: &Frame<'p>, id: StmtId, body: &Block, turns: Option<u32>) {
        let Some(condition) = first_condition(body) else {
            return;
        };
        let head = |d: &Decision| d.function == frame.id && d.condition == condition;
        let found = self.decisions.iter().rev().find(|d| head(d));
        let sources = found.map(|d| Sources::clone(&d.sources));
        let sources = sources.unwrap_or_default();
        self.decisions.retain(|d| !head(d));
        if turns.is_none() && self.graph.rate(frame.id, condition) != Rate::Draw {
            return;
        }
        let end = frame.f.statements.get(id).end;
        let cost = frame.weight * super::decision::cost(self.graph, frame.id, id, end);
        self.note(Decision {
            id: 0,
            within: None,
            stage: self.stage,
            function: frame.id,
            statement: id,
            condition,
            kind: Kind::Loop { turns },
            taken: None,
            arms: vec![Arm {
                statements: (id, end),
                cost,
            }],
            sources,
        });
    }
}

/// The condition of the first branch of a block: where a counted loop tests its counter.
fn first_condition(body: &Block) -> Option<Handle<Expression>> {
    body.iter().find_map(|s| match s {
        Statement::If { condition, .. } => Some(*condition),
        _ => None,
    })
}

/// The case that a selector takes.
fn taken(cases: &[SwitchCase], selector: Literal) -> Option<usize> {
    let is = |value: &SwitchValue| match (value, selector) {
        (SwitchValue::I32(a), Literal::I32(b)) => *a == b,
        (SwitchValue::U32(a), Literal::U32(b)) => *a == b,
        _ => false,
    };
    cases
        .iter()
        .position(|c| is(&c.value))
        .or_else(|| cases.iter().position(|c| c.value == SwitchValue::Default))
}

fn join(a: &[Known], b: &[Known]) -> Vec<Known> {
    a.iter().zip(b).map(|(a, b)| a.join(b)).collect()
}

fn joined(end: Vec<Known>, flow: Flow, broken: Vec<Vec<Known>>) -> Vec<Known> {
    let through = (flow == Flow::Next).then_some(end.clone());
    through
        .into_iter()
        .chain(broken)
        .reduce(|a, b| join(&a, &b))
        .unwrap_or(end)
}

/// A jump out of a block.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Jump {
    Break,
    Continue,
}

/// Whether a statement jumps out of the loop or switch around it.
fn has_jump(statement: &Statement, jump: Jump) -> bool {
    match statement {
        Statement::Break => jump == Jump::Break,
        Statement::Continue => jump == Jump::Continue,
        Statement::Loop { .. } => false,
        Statement::Switch { .. } if jump == Jump::Break => false,
        other => operands::blocks(other)
            .into_iter()
            .flatten()
            .any(|s| has_jump(s, jump)),
    }
}

/// Whether a statement may go elsewhere than to the next.
fn leaves(statement: &Statement) -> bool {
    match statement {
        Statement::Break | Statement::Continue | Statement::Return { .. } => true,
        other => operands::blocks(other).into_iter().flatten().any(leaves),
    }
}

impl Frame<'_> {
    /// What runs from here on rests on `sources` too. Gives what it rests on behind the statement with these `arms`: the same where one of them may leave it.
    fn run_on<'b>(&mut self, sources: &Sources, arms: impl Iterator<Item = &'b Block>) -> Sources {
        let within = super::known::both(&self.running, sources);
        let outside = std::mem::replace(&mut self.running, Sources::clone(&within));
        match arms.flatten().any(leaves) {
            true => within,
            false => outside,
        }
    }

    /// Ends the present `Emit`.
    pub fn flush(&mut self, out: &mut Block) {
        if let Some(start) = self.emitting.take()
            && self.function.expressions.len() > start
        {
            let range = self.function.expressions.range_from(start);
            out.push(Statement::Emit(range), self.span);
        }
    }

    /// Appends an expression that an `Emit` evaluates.
    pub fn emit(&mut self, expression: Expression, of: Handle<Expression>) -> Handle<Expression> {
        self.emitting.get_or_insert(self.function.expressions.len());
        let span = self.original.expressions.get_span(of);
        self.function.expressions.append(expression, span)
    }

    /// Appends one that none evaluates.
    pub fn append(&mut self, expression: Expression, of: Handle<Expression>) -> Handle<Expression> {
        let span = self.original.expressions.get_span(of);
        self.function.expressions.append(expression, span)
    }

    /// A literal.
    pub fn literal(&mut self, literal: Literal, out: &mut Block) -> Handle<Expression> {
        self.flush(out);
        let literal = Expression::Literal(literal);
        self.function.expressions.append(literal, Span::UNDEFINED)
    }

    /// The copy of an expression that was copied before.
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

    fn arms(&self, id: StmtId, accept: &Block) -> [StmtId; 2] {
        let first = StmtId::from(id.index() + 1);
        [first, self.behind(first, accept)]
    }

    fn behind(&self, first: StmtId, block: &Block) -> StmtId {
        block
            .iter()
            .fold(first, |at, _| self.f.statements.get(at).end)
    }

    fn starts<'b>(&self, id: StmtId, blocks: impl Iterator<Item = &'b Block>) -> Vec<StmtId> {
        let mut at = StmtId::from(id.index() + 1);
        blocks
            .map(|block| {
                let start = at;
                at = self.behind(at, block);
                start
            })
            .collect()
    }

    /// Leaves a loop or a switch: what was known at its breaks.
    fn leave(&mut self) -> Vec<Vec<Known>> {
        match self.breaks.pop() {
            Some(Breaks::Switch(states)) => states,
            _ => Vec::new(),
        }
    }

    /// Nothing is known any more of locals that any of these statements may write.
    fn forget_stored<'b>(&mut self, blocks: impl Iterator<Item = &'b Block>) {
        fn walk(block: &Block, found: &mut Vec<Handle<Expression>>) {
            for statement in block {
                match statement {
                    Statement::Store { pointer, .. } => found.push(*pointer),
                    Statement::Call { arguments, .. } => found.extend(arguments),
                    other => found.extend(operands::of_statement(other)),
                }
                for inner in operands::blocks(statement) {
                    walk(inner, found);
                }
            }
        }
        let mut pointers = Vec::new();
        blocks.for_each(|b| walk(b, &mut pointers));
        for pointer in pointers {
            self.forget_all(pointer);
        }
    }
}
