//! Branches and switches: folds to the arm that is taken, or joins the abstract values of all arms.

use naga::{Block, Expression, Handle, Literal, Statement, SwitchCase, SwitchValue};

use super::decision::DecisionKind;
use super::fold::{FoldFrame, Folder};
use super::known::{AbstractValue, Sources};
use preshade_dataflow::graph::StmtId;

/// The target of a `break`.
pub(super) enum Breaks {
    Loop {
        /// Whether this is a speculative unroll. It fails at the first undecided branch that may
        /// leave an iteration.
        tried: bool,
        /// The condition of the branch at the loop's head that ends it. The loop then is the
        /// decision.
        head: Option<Handle<Expression>>,
        /// The assumptions that decide the branch.
        sources: Sources,
        /// Number of blocks around the body.
        depth: usize,
    },
    Switch {
        /// The locals' abstract values at each break.
        locals: Vec<Vec<AbstractValue>>,
        /// Number of blocks around the cases.
        depth: usize,
    },
}

/// How a block ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ending {
    Next,
    Break,
    Continue,
    Return,
    /// By a jump, in one of several ways.
    Away,
}

impl<'p> Folder<'p> {
    pub(super) fn branch(
        &mut self,
        frame: &mut FoldFrame<'p>,
        id: StmtId,
        condition: Handle<Expression>,
        [accept, reject]: [&'p Block; 2],
        out: &mut Block,
    ) -> Ending {
        let [first, second] = frame.arms(id, accept);
        let arms = [(first, second), (second, frame.f.statements.get(id).end)];
        let depth = frame.within.len();
        let decision = self.decide(frame, id, condition, DecisionKind::Branch, &arms);
        frame.within.extend(decision);
        let flow = self.arms(frame, condition, [accept, reject], [first, second], out);
        frame.within.truncate(depth);
        flow
    }

    /// Both arms of a branch, or the one that is taken.
    fn arms(
        &mut self,
        frame: &mut FoldFrame<'p>,
        condition: Handle<Expression>,
        [accept, reject]: [&'p Block; 2],
        [first, second]: [StmtId; 2],
        out: &mut Block,
    ) -> Ending {
        let span = frame.span;
        let known = frame.known[condition.index()].clone();
        if let Some((truth, sources)) = known.assumed_truth() {
            frame.folds(sources);
            let outside = frame.run_on(sources, [accept, reject].into_iter());
            let (block, from) = match truth {
                true => (accept, first),
                false => (reject, second),
            };
            // A front end may drop statements after a discard in the same block.
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
        if matches!(frame.breaks.last(), Some(Breaks::Loop { tried: true, .. }))
            && [accept, reject].into_iter().flatten().any(jumps)
        {
            return Ending::Away;
        }
        let condition = frame.mapped(condition);
        frame.flush(out);
        let before = frame.locals.clone();
        let (mut accepted, mut rejected) = (Block::new(), Block::new());
        let yes = self.block(frame, accept, first, &mut accepted);
        let after_yes = std::mem::replace(&mut frame.locals, before);
        let no = self.block(frame, reject, second, &mut rejected);
        match (yes == Ending::Next, no == Ending::Next, known.truth()) {
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
            (Ending::Next, _) | (_, Ending::Next) => Ending::Next,
            (a, b) if a == b => a,
            _ => Ending::Away,
        }
    }

    pub(super) fn switch(
        &mut self,
        frame: &mut FoldFrame<'p>,
        id: StmtId,
        selector: Handle<Expression>,
        cases: &'p [SwitchCase],
        out: &mut Block,
    ) -> Ending {
        let span = frame.span;
        let starts = frame.starts(id, cases.iter().map(|c| &c.body));
        let end = frame.f.statements.get(id).end;
        let arms: Vec<_> = starts
            .iter()
            .zip(starts.iter().skip(1).chain([&end]))
            .map(|(a, b)| (*a, *b))
            .collect();
        self.decide(frame, id, selector, DecisionKind::Switch, &arms);
        let falls = cases.iter().any(|c| c.fall_through);
        let taken = match frame.known[selector.index()].literal() {
            Some((literal, sources)) if !falls => {
                let sources = Sources::clone(sources);
                taken(cases, literal).map(|case| (case, sources))
            }
            _ => None,
        };
        if let Some((case, sources)) = taken {
            frame.folds(&sources);
            let mut body = Block::new();
            frame.flush(out);
            frame.enter_switch();
            let outside = frame.run_on(&sources, cases.iter().map(|c| &c.body));
            let flow = self.block(frame, &cases[case].body, starts[case], &mut body);
            frame.running = outside;
            let broken = frame.leave();
            let ends = matches!(body.last(), Some(Statement::Break));
            let kept = body.len() - usize::from(ends);
            let flow = match flow {
                Ending::Break => Ending::Next,
                flow => flow,
            };
            // A front end may drop statements after a discard in the same block.
            let stays = |s: &Statement| has_jump(s, Jump::Break) || matches!(s, Statement::Kill);
            if !body[..kept].iter().any(stays) {
                for (i, (statement, span)) in body.span_into_iter().enumerate() {
                    if i < kept {
                        out.push(statement, span);
                    }
                }
                return flow;
            }
            frame.locals = joined(frame.locals.clone(), flow, &broken);
            let selector = frame.literal(Literal::U32(0), out);
            let only = SwitchCase {
                value: SwitchValue::Default,
                body,
                fall_through: false,
            };
            let cases = vec![only];
            out.push(Statement::Switch { selector, cases }, span);
            return match broken.is_empty() {
                true => flow,
                false => Ending::Next,
            };
        }
        if falls {
            frame.forget_stored(cases.iter().map(|c| &c.body));
        }
        let selector = frame.mapped(selector);
        frame.flush(out);
        let before = frame.locals.clone();
        let mut ends: Vec<Vec<AbstractValue>> = Vec::new();
        let mut flows = Vec::new();
        let mut copies = Vec::new();
        for (case, first) in cases.iter().zip(starts) {
            frame.locals.clone_from(&before);
            frame.enter_switch();
            let mut body = Block::new();
            let flow = self.block(frame, &case.body, first, &mut body);
            let broken = frame.leave();
            if flow == Ending::Next || !broken.is_empty() {
                flows.push(Ending::Next);
            } else {
                flows.push(flow);
            }
            if flow == Ending::Next {
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
        match flows.iter().all(|f| *f == Ending::Return) {
            true => Ending::Return,
            false if flows.contains(&Ending::Next) => Ending::Next,
            false => Ending::Away,
        }
    }
}

pub(super) fn taken(cases: &[SwitchCase], selector: Literal) -> Option<usize> {
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

fn join(a: &[AbstractValue], b: &[AbstractValue]) -> Vec<AbstractValue> {
    a.iter().zip(b).map(|(a, b)| a.join(b)).collect()
}

fn joined(
    end: Vec<AbstractValue>,
    flow: Ending,
    broken: &[Vec<AbstractValue>],
) -> Vec<AbstractValue> {
    let through = (flow == Ending::Next).then_some(end.clone());
    through
        .into_iter()
        .chain(broken.iter().cloned())
        .reduce(|a, b| join(&a, &b))
        .unwrap_or(end)
}

/// A jump out of a block.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Jump {
    Break,
    Continue,
}

/// Whether a statement jumps out of the enclosing loop or switch.
pub(super) fn has_jump(statement: &Statement, jump: Jump) -> bool {
    match statement {
        Statement::Break => jump == Jump::Break,
        Statement::Continue => jump == Jump::Continue,
        Statement::Loop { .. } => false,
        Statement::Switch { .. } if jump == Jump::Break => false,
        other => naga_operands::blocks(other)
            .into_iter()
            .flatten()
            .any(|s| has_jump(s, jump)),
    }
}

/// Whether a statement leaves the iteration of the enclosing loop.
pub(super) fn jumps(statement: &Statement) -> bool {
    has_jump(statement, Jump::Break) || has_jump(statement, Jump::Continue)
}

/// Whether a statement may continue somewhere else than at the next one.
fn leaves(statement: &Statement) -> bool {
    match statement {
        Statement::Break | Statement::Continue | Statement::Return { .. } => true,
        other => naga_operands::blocks(other)
            .into_iter()
            .flatten()
            .any(leaves),
    }
}

impl FoldFrame<'_> {
    /// Adds `sources` to the dependences of the following statements. Returns the dependences
    /// behind the statement with these `arms`; if an arm may leave it, they stay in force there.
    fn run_on<'b>(&mut self, sources: &Sources, arms: impl Iterator<Item = &'b Block>) -> Sources {
        let within = super::known::both(&self.running, sources);
        let outside = std::mem::replace(&mut self.running, Sources::clone(&within));
        match arms.flatten().any(leaves) {
            true => within,
            false => outside,
        }
    }

    fn arms(&self, id: StmtId, accept: &Block) -> [StmtId; 2] {
        let first = StmtId::from(id.index() + 1);
        [first, self.behind(first, accept)]
    }

    fn enter_switch(&mut self) {
        self.breaks.push(Breaks::Switch {
            locals: Vec::new(),
            depth: self.following.len(),
        });
    }

    /// Leaves a switch and returns the abstract values at its breaks.
    fn leave(&mut self) -> Vec<Vec<AbstractValue>> {
        match self.breaks.pop() {
            Some(Breaks::Switch { locals, .. }) => locals,
            _ => Vec::new(),
        }
    }
}
