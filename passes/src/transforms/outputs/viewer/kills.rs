//! Where a stage discards, and under which conditions of its own.

use naga::{Block, Span, Statement};

use super::{Stage, ViewerReads};
use crate::analysis::values::ContextId;
use preshade_dataflow::graph::{FunctionId, StmtId};

/// How the discards of a block depend on conditions inside it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Kills {
    /// Some run whatever the material holds, or may do so.
    pub direct: bool,
    /// Some run only if a condition on the material holds.
    pub tested: bool,
}

impl Kills {
    pub(super) fn any(self) -> bool {
        self.direct || self.tested
    }

    fn and(self, other: Self) -> Self {
        Self {
            direct: self.direct || other.direct,
            tested: self.tested || other.tested,
        }
    }
}

impl Stage<'_, '_> {
    /// The discards of the statements from `first` on, which is the number of the block's first.
    pub(super) fn kills(&self, context: ContextId, block: &Block, first: StmtId) -> Kills {
        let mut found = Kills::default();
        let mut at = first;
        for statement in block {
            found = found.and(self.kills_of(context, statement, at));
            at = self.f(context).statements.get(at).end;
        }
        found
    }

    fn kills_of(&self, context: ContextId, statement: &Statement, at: StmtId) -> Kills {
        match statement {
            Statement::Kill => Kills {
                direct: true,
                tested: false,
            },
            Statement::Call { function, .. }
                if self
                    .values
                    .graph
                    .may_discard(FunctionId::Function(*function)) =>
            {
                match self.values.child(context, at) {
                    Some(child) => {
                        let body = &self.f(child).function.body;
                        self.kills(child, body, StmtId::from(0))
                    }
                    None => Kills {
                        direct: true,
                        tested: false,
                    },
                }
            }
            _ => {
                let mut inner = StmtId::from(at.index() + 1);
                let mut found = Kills::default();
                for block in naga_operands::blocks(statement) {
                    found = found.and(self.kills(context, block, inner));
                    for _ in block {
                        inner = self.f(context).statements.get(inner).end;
                    }
                }
                let Statement::If { condition, .. } = statement else {
                    return found;
                };
                let at = (context, *condition);
                if !found.any() || self.is_viewers(at) {
                    return found;
                }
                match self.reads(at) {
                    ViewerReads::Nothing => found,
                    // A pattern on the surface, or an alpha that the shader computes.
                    ViewerReads::Inputs => Kills {
                        direct: true,
                        tested: true,
                    },
                    ViewerReads::Textures => Kills {
                        direct: false,
                        tested: true,
                    },
                }
            }
        }
    }

    /// The discard that still depends on the viewer.
    pub fn remaining(&self) -> Option<(ContextId, Span)> {
        (0..self.values.contexts.len()).find_map(|context| {
            let mut all = self.f(context).statements.iter();
            let (_, kill) = all.find(|(at, node)| {
                matches!(node.statement, Statement::Kill)
                    && self.f(context).control.is_reachable(*at)
                    && self.is_controlled(context, *at)
            })?;
            Some((context, kill.span))
        })
    }
}
