//! Draw-uniform decisions of a stage: branches, switches and loops whose condition is the same for
//! all invocations of a draw.

use std::collections::BTreeSet;

use naga::{Block, Expression, Function, Handle, Statement};

use super::control::{Breaks, taken};
use super::fold::{FoldFrame, Folder};
use super::known::{AbstractValue, Sources};
use preshade_dataflow::graph::counted::Counted;
use preshade_dataflow::graph::{FunctionId, Graph, Rate, StmtId};

/// The statement kind of a decision.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DecisionKind {
    /// `if`, with an arm for true and one for false.
    Branch,
    /// `switch`, with an arm per case.
    Switch,
    /// A loop, with one arm.
    Loop {
        /// Number of iterations, if it is known and the loop was unrolled.
        turns: Option<u32>,
    },
}

/// Statements that run or do not run together.
#[derive(Clone, Debug, PartialEq)]
pub struct Arm {
    /// Ranges of statements, with exclusive ends. If another arm leaves the function or loop, the
    /// statements behind the decision follow.
    pub statements: Vec<(StmtId, StmtId)>,
}

/// A condition that is uniform over a draw.
#[derive(Clone, Debug, PartialEq)]
pub struct Decision {
    /// The function that contains it.
    pub function: FunctionId,
    pub statement: StmtId,
    /// Condition of an `if` or a loop, or selector of a `switch`.
    pub condition: Handle<Expression>,
    pub kind: DecisionKind,
    /// The arm that is taken; `None` if unknown, or for a loop.
    pub taken: Option<usize>,
    pub arms: Vec<Arm>,
    /// Whether an arm leaves the function, so that the decision affects all following statements.
    pub leaves: bool,
    /// The assumptions that decide it.
    pub sources: Sources,
    /// Index in the record of the enclosing decision in the same function.
    pub within: Option<usize>,
}

/// A call that remains after folding.
#[derive(Clone, Debug, PartialEq)]
pub struct Call {
    /// The callee, among the generated functions.
    pub callee: Handle<Function>,
    /// Number of calls in one run of the function, as far as known.
    pub times: f64,
    /// Index in the record of the enclosing decision.
    pub within: Option<usize>,
}

/// An event of folding a function, in the order of its statements.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Noted {
    Decision(Decision),
    Call(Call),
}

/// The result of folding one function, without its callees. A stage therefore depends only on the
/// functions it still calls.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Record {
    /// Assumptions that a fold depends on.
    pub used: BTreeSet<usize>,
    /// Float operations that were removed as neutral additions or multiplications.
    pub roundings: BTreeSet<(FunctionId, Handle<Expression>)>,
    /// In the order of the statements.
    pub notes: Vec<Noted>,
    /// Loops with a known number of iterations.
    pub turns: Vec<(FunctionId, StmtId, u32)>,
}

impl Record {
    /// The merged record of this function and all its callees, without notes.
    pub fn with_callees(
        &self,
        of: &[Record],
    ) -> (BTreeSet<usize>, BTreeSet<(FunctionId, Handle<Expression>)>) {
        let (mut used, mut roundings) = (BTreeSet::new(), BTreeSet::new());
        let mut seen = BTreeSet::new();
        let mut work = vec![self];
        while let Some(record) = work.pop() {
            used.extend(&record.used);
            roundings.extend(&record.roundings);
            for note in &record.notes {
                if let Noted::Call(call) = note
                    && seen.insert(call.callee)
                {
                    work.extend(of.get(call.callee.index()));
                }
            }
        }
        (used, roundings)
    }
}

/// A decision of a stage.
#[derive(Clone, Debug, PartialEq)]
pub struct Placed {
    /// `vertex` or `fragment`.
    pub stage: &'static str,
    pub decision: Decision,
    /// Index in the list of the enclosing decision, across callers.
    pub within: Option<usize>,
    /// Static cost of each arm in one run of the stage, including calls.
    pub costs: Vec<f64>,
}

/// Adds the decisions of a stage and its callees, each once, outer decisions first.
pub(crate) fn of_stage(
    graph: &Graph<'_>,
    name: &'static str,
    stage: &Record,
    records: &[Record],
    out: &mut Vec<Placed>,
) {
    // Number of runs of each function. Callees precede their callers.
    let mut times = vec![0.0; records.len()];
    let add = |times: &mut Vec<f64>, record: &Record, weight: f64| {
        for note in &record.notes {
            if let Noted::Call(call) = note {
                times[call.callee.index()] += weight * call.times;
            }
        }
    };
    add(&mut times, stage, 1.0);
    for (i, record) in records.iter().enumerate().rev() {
        let weight = times[i];
        add(&mut times, record, weight);
    }
    let mut placing = Placing {
        graph,
        name,
        records,
        times,
        seen: BTreeSet::new(),
        out,
    };
    placing.record(stage, 1.0, None);
}

struct Placing<'g, 'p> {
    graph: &'g Graph<'p>,
    name: &'static str,
    records: &'g [Record],
    times: Vec<f64>,
    seen: BTreeSet<Handle<Function>>,
    out: &'g mut Vec<Placed>,
}

impl Placing<'_, '_> {
    fn record(&mut self, record: &Record, weight: f64, around: Option<usize>) {
        let mut places = vec![None; record.notes.len()];
        for (i, note) in record.notes.iter().enumerate() {
            let place = |within: Option<usize>| within.and_then(|w| places[w]).or(around);
            match note {
                Noted::Decision(decision) => {
                    let costs = decision.arms.iter().map(|arm| {
                        let statements = arm.statements.iter();
                        let each =
                            statements.map(|(a, b)| cost(self.graph, decision.function, *a, *b));
                        weight * each.sum::<f64>()
                    });
                    let placed = Placed {
                        stage: self.name,
                        within: place(decision.within),
                        costs: costs.collect(),
                        decision: decision.clone(),
                    };
                    places[i] = Some(self.out.len());
                    self.out.push(placed);
                }
                Noted::Call(call) => {
                    let records = self.records;
                    if let Some(callee) = records.get(call.callee.index())
                        && self.seen.insert(call.callee)
                    {
                        let (weight, within) =
                            (self.times[call.callee.index()], place(call.within));
                        self.record(callee, weight, within);
                    }
                }
            }
        }
    }
}

impl<'p> Folder<'p> {
    /// Records a draw-uniform condition and returns its index.
    pub(super) fn decide(
        &mut self,
        frame: &mut FoldFrame<'p>,
        id: StmtId,
        condition: Handle<Expression>,
        kind: DecisionKind,
        arms: &[(StmtId, StmtId)],
    ) -> Option<usize> {
        let known = &frame.known[condition.index()];
        let sources = match known {
            AbstractValue::Scalar(_, sources) => Sources::clone(sources),
            _ => Sources::default(),
        };
        let known = known.literal().map(|(literal, _)| literal);
        if let Some(Breaks::Loop {
            head: Some(head),
            sources: decides,
            ..
        }) = frame.breaks.last_mut()
            && *head == condition
        {
            // The loop is the decision.
            *decides = super::known::both(decides, &sources);
            return None;
        }
        let is_uniform = self.graph.rate(frame.id, condition) == Rate::Draw;
        if sources.is_empty() && !is_uniform {
            return None;
        }
        let statement = frame.f.statements.get(id).statement;
        let taken = match (statement, known) {
            (Statement::If { .. }, Some(naga::Literal::Bool(truth))) => Some(usize::from(!truth)),
            (Statement::Switch { cases, .. }, Some(literal)) => taken(cases, literal),
            _ => None,
        };
        let leaves: Vec<Option<usize>> = match statement {
            Statement::If { accept, reject, .. } => {
                [accept, reject].map(|b| frame.left_by(b)).to_vec()
            }
            _ => vec![None; arms.len()],
        };
        let arms = arms.iter().enumerate().map(|(i, own)| {
            let mut statements = vec![*own];
            let others = leaves.iter().enumerate().filter(|(j, _)| *j != i);
            if leaves[i].is_none()
                && let Some(depth) = others.filter_map(|(_, depth)| *depth).min()
            {
                statements.extend(&frame.following[depth..]);
            }
            Arm { statements }
        });
        let decision = Decision {
            function: frame.id,
            statement: id,
            condition,
            kind,
            taken,
            arms: arms.collect(),
            leaves: matches!(frame.id, FunctionId::Function(_)) && leaves.contains(&Some(0)),
            sources,
            within: frame.within.last().copied(),
        };
        frame.record.notes.push(Noted::Decision(decision));
        Some(frame.record.notes.len() - 1)
    }

    /// Records a loop in place of the branch that ends it. `turns` is the number of unrolled
    /// iterations.
    pub(super) fn decide_loop(
        &mut self,
        frame: &mut FoldFrame<'p>,
        id: StmtId,
        condition: Handle<Expression>,
        sources: Sources,
        turns: Option<u32>,
    ) {
        let bound = |e: Handle<Expression>| frame.known[e.index()].scalar()?.0.integer();
        let counted = || Counted::turns_by(self.graph.module(), frame.f, id, bound);
        let counted = turns.or_else(counted).map(|turns| (frame.id, id, turns));
        frame.record.turns.extend(counted);
        if turns.is_none() && self.graph.rate(frame.id, condition) != Rate::Draw {
            return;
        }
        let end = frame.f.statements.get(id).end;
        let decision = Decision {
            function: frame.id,
            statement: id,
            condition,
            kind: DecisionKind::Loop { turns },
            taken: None,
            arms: vec![Arm {
                statements: vec![(id, end)],
            }],
            leaves: false,
            sources,
            within: frame.within.last().copied(),
        };
        frame.record.notes.push(Noted::Decision(decision));
    }
}

impl FoldFrame<'_> {
    /// For a block that ends in a jump: how many of the enclosing blocks continue.
    fn left_by(&self, block: &Block) -> Option<usize> {
        let depth = |breaks: &Breaks| match breaks {
            Breaks::Loop { depth, .. } | Breaks::Switch { depth, .. } => *depth,
        };
        match block.last()? {
            Statement::Return { .. } => Some(0),
            Statement::Break => self.breaks.last().map(depth),
            Statement::Continue => {
                let mut loops = self.breaks.iter().rev();
                loops.find(|b| matches!(b, Breaks::Loop { .. })).map(depth)
            }
            _ => None,
        }
    }
}

/// Static cost of the statements from `first` up to `end` in one run of their function, including
/// calls and repetitions.
fn cost(graph: &Graph<'_>, function: FunctionId, first: StmtId, end: StmtId) -> f64 {
    let f = graph.function(function);
    let within = |id: StmtId| first <= id && id < end;
    let own = f.own_cost(graph.module(), within, |_| true);
    let calls: f64 = f
        .calls()
        .filter(|(at, _)| within(*at))
        .map(|(at, callee)| graph.cost(FunctionId::Function(callee)) * f.times[at.index()])
        .sum();
    own + calls
}
