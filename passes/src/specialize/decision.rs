//! What a draw decides in a stage: branches, switches and loops whose condition is the same for all of its invocations.

use naga::{Expression, Handle};

use super::known::Sources;
use crate::graph::{FunctionId, Graph, StmtId};

/// What kind of statement a decision is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// `if`; the arms are the one for true and the one for false.
    Branch,
    /// `switch`; an arm a case.
    Switch,
    /// A loop; the one arm is the loop.
    Loop {
        /// How often it turns, where that is decided and it was written out.
        turns: Option<u32>,
    },
}

/// Statements that run, or do not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arm {
    /// The first, and the one behind the last.
    pub statements: (StmtId, StmtId),
    /// Static cost, calls included, in one run of the stage.
    pub cost: f64,
}

/// A condition that the draw decides.
#[derive(Clone, Debug, PartialEq)]
pub struct Decision {
    /// Its number among all of them.
    pub id: usize,
    /// The number of the one that it stands behind.
    pub within: Option<usize>,
    /// `vertex` or `fragment`.
    pub stage: &'static str,
    /// The function it is in.
    pub function: FunctionId,
    /// The statement.
    pub statement: StmtId,
    /// Its condition or selector.
    pub condition: Handle<Expression>,
    /// What it is.
    pub kind: Kind,
    /// Which arm is taken; `None`: not known, or a loop.
    pub taken: Option<usize>,
    /// Its arms.
    pub arms: Vec<Arm>,
    /// The assumptions that decided it.
    pub sources: Sources,
}

impl Decision {
    /// Whether it was decided.
    pub fn is_decided(&self) -> bool {
        self.taken.is_some() || matches!(self.kind, Kind::Loop { turns: Some(_) })
    }

    /// Static cost of what is never run.
    pub fn removed(&self) -> f64 {
        match (self.kind, self.taken) {
            (Kind::Loop { turns: Some(0) }, _) => self.arms.iter().map(|a| a.cost).sum(),
            (_, Some(taken)) => {
                let others = self.arms.iter().enumerate().filter(|(i, _)| *i != taken);
                others.map(|(_, a)| a.cost).sum()
            }
            _ => 0.0,
        }
    }
}

/// Static cost of the statements from `first` up to `end`, calls included, as often as each runs for one run of their function.
pub fn cost(graph: &Graph<'_>, function: FunctionId, first: StmtId, end: StmtId) -> f64 {
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
