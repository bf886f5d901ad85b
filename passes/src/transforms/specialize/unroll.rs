//! Unrolls loops if assumptions decide the number of iterations and it is small.

use naga::{Block, Expression, Function, Handle, Statement};

use super::control::{Breaks, Ending, jumps};
use super::decision::Record;
use super::fold::{FoldFrame, Folder};
use super::known::{AbstractValue, Sources};
use preshade_dataflow::graph::StmtId;

/// Most expressions that unrolling a loop may add.
const MOST_ADDED: usize = 400;

/// The blocks of a loop and the numbers of their first statements.
#[derive(Clone, Copy)]
struct Loop<'p> {
    id: StmtId,
    body: (&'p Block, StmtId),
    continuing: (&'p Block, StmtId),
    break_if: Option<Handle<Expression>>,
}

/// The unrolled iterations.
struct Turns {
    body: Block,
    /// How the last one ends.
    flow: Ending,
}

impl<'p> Folder<'p> {
    pub(super) fn looped(
        &mut self,
        frame: &mut FoldFrame<'p>,
        id: StmtId,
        body: &'p Block,
        continuing: &'p Block,
        break_if: Option<Handle<Expression>>,
        out: &mut Block,
    ) -> Ending {
        let span = frame.span;
        let starts = frame.starts(id, [body, continuing].into_iter());
        let this = Loop {
            id,
            body: (body, starts[0]),
            continuing: (continuing, starts[1]),
            break_if,
        };
        frame.flush(out);
        if let Some(turns) = self.written_out(frame, this) {
            frame.changed = true;
            for (statement, span) in turns.body.span_into_iter() {
                out.push(statement, span);
            }
            return turns.flow;
        }
        // Stored locals are unknown at the start of an iteration and behind the loop.
        frame.forget_stored([body, continuing].into_iter());
        let outside = frame.locals.clone();
        let (mut turn, mut end) = (Block::new(), Block::new());
        frame.enter_loop(body, break_if, false);
        self.block(frame, body, starts[0], &mut turn);
        frame.locals.clone_from(&outside);
        self.block(frame, continuing, starts[1], &mut end);
        self.leave_loop(frame, this, None);
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
        Ending::Next
    }

    /// Unrolls a loop. A speculative run comes first, so that a failure leaves no trace. A failed
    /// loop is not tried again, because nested loops would take exponential time.
    fn written_out(&mut self, frame: &mut FoldFrame<'p>, this: Loop<'p>) -> Option<Turns> {
        if frame.hopeless.contains(&this.id) {
            return None;
        }
        if frame.tried == 0 {
            let inside = this.id..frame.f.statements.get(this.id).end;
            let given_up: Vec<StmtId> = frame.hopeless.range(inside.clone()).copied().collect();
            let before = Snapshot::take(frame, this, Unrolled::Aside);
            let fits = self.turns(frame, this).is_some();
            before.restore(frame);
            if !fits {
                frame.hopeless.insert(this.id);
                return None;
            }
            // The second run gives the same result.
            frame
                .hopeless
                .retain(|id| !inside.contains(id) || given_up.contains(id));
        }
        let before = Snapshot::take(frame, this, Unrolled::Kept);
        let turns = self.turns(frame, this);
        if turns.is_none() {
            before.restore(frame);
            frame.hopeless.insert(this.id);
        }
        turns
    }

    fn turns(&mut self, frame: &mut FoldFrame<'p>, this: Loop<'p>) -> Option<Turns> {
        let made = |frame: &FoldFrame<'_>| frame.function.expressions.len() - frame.wasted;
        let most = made(frame) + MOST_ADDED;
        let mut all = Block::new();
        frame.enter_loop(this.body.0, this.break_if, true);
        frame.turning += 1;
        let mut ended = None;
        for number in 0..=self.turns {
            let mut turn = Block::new();
            let flow = self.block(frame, this.body.0, this.body.1, &mut turn);
            let ends = matches!(turn.last(), Some(Statement::Break | Statement::Continue));
            let kept = turn.len() - usize::from(ends);
            // A front end may drop statements after a discard in the same block.
            let stays = |s: &Statement| jumps(s) || matches!(s, Statement::Kill);
            if flow == Ending::Away || turn[..kept].iter().any(stays) {
                break;
            }
            for (i, (statement, span)) in turn.span_into_iter().enumerate() {
                if i < kept {
                    all.push(statement, span);
                }
            }
            match flow {
                Ending::Break => ended = Some((Ending::Next, number)),
                Ending::Return => ended = Some((Ending::Return, number + 1)),
                _ => {}
            }
            if ended.is_some() || made(frame) > most {
                break;
            }
            self.block(frame, this.continuing.0, this.continuing.1, &mut all);
            if let Some(condition) = this.break_if {
                let known = frame.known[condition.index()].clone();
                let Some((truth, sources)) = known.assumed_truth() else {
                    break;
                };
                frame.folds(sources);
                if truth {
                    ended = Some((Ending::Next, number + 1));
                    break;
                }
            }
        }
        frame.turning -= 1;
        self.leave_loop(frame, this, ended.map(|(_, count)| count));
        ended.map(|(flow, _)| Turns { body: all, flow })
    }

    /// Leaves a loop and records the assumptions that decide its count.
    fn leave_loop(&mut self, frame: &mut FoldFrame<'p>, this: Loop<'p>, turns: Option<u32>) {
        if let Some(Breaks::Loop {
            head: Some(condition),
            sources,
            ..
        }) = frame.breaks.pop()
        {
            self.decide_loop(frame, this.id, condition, sources, turns);
        }
    }
}

impl FoldFrame<'_> {
    fn enter_loop(&mut self, body: &Block, break_if: Option<Handle<Expression>>, written: bool) {
        self.breaks.push(Breaks::Loop {
            tried: written,
            head: head(body).or(break_if),
            sources: Sources::default(),
            depth: self.following.len(),
        });
    }
}

/// The condition of the branch that ends a loop, if the branch does nothing else.
fn head(body: &Block) -> Option<Handle<Expression>> {
    let leaves = |block: &Block| matches!(block[..], [Statement::Break]);
    body.iter().find_map(|s| match s {
        Statement::If {
            condition,
            accept,
            reject,
        } if leaves(accept) && reject.is_empty() || accept.is_empty() && leaves(reject) => {
            Some(*condition)
        }
        _ => None,
    })
}

/// State of a speculative unroll.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Unrolled {
    /// Built in a copy, and discarded.
    Aside,
    /// Built in place.
    Kept,
}

/// A frame before a speculative unroll.
struct Snapshot {
    /// The copies of the loop's expressions, and their abstract values.
    values: Vec<(
        Handle<Expression>,
        Option<Handle<Expression>>,
        AbstractValue,
    )>,
    locals: Vec<AbstractValue>,
    returned: Option<AbstractValue>,
    running: Sources,
    /// For an unroll in a copy: the function so far.
    made: Option<(Function, Record, bool)>,
    /// Number of expressions in the function, and of wasted ones.
    length: usize,
    wasted: usize,
}

impl Snapshot {
    fn take(frame: &mut FoldFrame<'_>, this: Loop<'_>, made: Unrolled) -> Self {
        // Every field of a frame is saved here, restored by leaving the loop, or listed with a
        // reason.
        let FoldFrame {
            id: _,
            original: _,
            f: _,
            arguments: _,
            is_operand: _,
            function,
            map,
            known,
            locals,
            returned,
            // Blocks, loops and decisions around the statement.
            breaks: _,
            within: _,
            following: _,
            turning: _,
            // No `Emit` is open between statements.
            emit: _,
            span: _,
            running,
            changed,
            record,
            tried,
            wasted,
            // Failures are permanent.
            hopeless: _,
        } = frame;
        let mut values = Vec::new();
        for block in [this.body.0, this.continuing.0] {
            naga_operands::evaluated(block, &mut |e| {
                values.push((e, map[e.index()], known[e.index()].clone()));
            });
        }
        let (length, in_vain) = (function.expressions.len(), *wasted);
        let made = (made == Unrolled::Aside).then(|| {
            *tried += 1;
            *wasted = 0;
            (std::mem::take(function), std::mem::take(record), *changed)
        });
        Self {
            values,
            locals: locals.clone(),
            returned: returned.clone(),
            running: Sources::clone(running),
            made,
            length,
            wasted: in_vain,
        }
    }

    fn restore(self, frame: &mut FoldFrame<'_>) {
        for (e, copy, known) in self.values {
            frame.map[e.index()] = copy;
            frame.known[e.index()] = known;
        }
        frame.locals = self.locals;
        frame.returned = self.returned;
        frame.running = self.running;
        match self.made {
            Some((function, record, changed)) => {
                (frame.function, frame.record, frame.changed) = (function, record, changed);
                frame.tried -= 1;
                frame.wasted = self.wasted;
            }
            // Inside an unroll that is itself discarded, the result is not read.
            None => {
                let more = frame.function.expressions.len() - self.length;
                frame.wasted = self.wasted + more;
            }
        }
    }
}
