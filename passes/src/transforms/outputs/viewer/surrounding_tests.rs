//! The material's tests around a condition, inside it and next to it.

use std::collections::BTreeSet;

use naga::{Scalar, Statement, TypeInner};

use super::{At, Changes, Instead, Stage, Unclear, ViewerReads};
use crate::analysis::reach::with_operands;
use crate::analysis::values::{ContextId, Node, ValueId};
use preshade_dataflow::graph::StmtId;

/// A condition that decides whether a statement runs.
#[derive(Clone, Copy, Debug)]
struct Decider {
    condition: At,
    statement: StmtId,
    /// Whether the statement is in a branch of it. Otherwise, a jump is.
    is_around: bool,
}

impl Stage<'_, '_> {
    /// The conditions that decide whether a statement runs, up to the entry point.
    fn deciders(&self, (mut context, mut statement): (ContextId, StmtId)) -> Vec<Decider> {
        let mut found = Vec::new();
        loop {
            let f = self.f(context);
            let around: BTreeSet<StmtId> = f.statements.ancestors(statement).collect();
            let (mut work, mut known) = (vec![statement], BTreeSet::from([statement]));
            while let Some(at) = work.pop() {
                for predicate in f.control.of(at) {
                    if !known.insert(*predicate) {
                        continue;
                    }
                    work.push(*predicate);
                    let of = f.statements.get(*predicate).statement;
                    if matches!(of, Statement::Return { .. }) {
                        continue;
                    }
                    let is_branch = matches!(of, Statement::If { .. });
                    let conditions = naga_operands::of_statement(of).into_iter();
                    found.extend(conditions.map(|e| Decider {
                        condition: (context, e),
                        statement: *predicate,
                        is_around: is_branch && around.contains(predicate),
                    }));
                }
            }
            match self.values.contexts[context].call {
                Some(call) => (context, statement) = call,
                None => return found,
            }
        }
    }

    /// Whether a statement with the condition `at` runs only after a test of a texture.
    ///
    /// # Errors
    /// An input decides it, or a test leads past it by a jump.
    pub(super) fn is_in_test(
        &self,
        statement: (ContextId, StmtId),
        at: At,
    ) -> Result<bool, Unclear> {
        let mut is_in = false;
        for decider in self.deciders(statement) {
            if self.is_viewers(decider.condition) {
                continue;
            }
            match self.reads(decider.condition) {
                ViewerReads::Nothing => {}
                ViewerReads::Textures if decider.is_around => is_in = true,
                _ => return Err(Unclear(at)),
            }
        }
        Ok(is_in)
    }

    /// Fails if a test that the viewer limited would hold everywhere, and the material has another.
    /// `near && noise < 0.5` next to `alpha < 0.5` thins near surfaces, and the shadow would be
    /// thin everywhere. `limits` are the conditions of the viewer, and their branches.
    pub(super) fn check_limits(
        &self,
        limits: &[(At, StmtId)],
        changes: &Changes,
    ) -> Result<(), Unclear> {
        if limits.is_empty() {
            return Ok(());
        }
        let is_limit = |decider: &Decider, (at, id): &(At, StmtId)| {
            decider.condition.0 == at.0 && decider.statement == *id
        };
        for context in 0..self.values.contexts.len() {
            let f = self.f(context);
            let kills = f.statements.iter().filter(|(id, node)| {
                matches!(node.statement, Statement::Kill) && f.control.is_reachable(*id)
            });
            for (kill, _) in kills {
                let deciders = self.deciders((context, kill));
                let is_constant = |d: &&Decider| {
                    let change = changes.get(&d.condition);
                    let is_kept = limits.iter().any(|limit| is_limit(d, limit));
                    matches!(change, Some(Instead::Bool(_))) && !is_kept
                };
                // A condition that disappears is no test, and neither is one that no surface
                // decides.
                if deciders.iter().any(|d| is_constant(&d))
                    || deciders
                        .iter()
                        .all(|d| self.reads(d.condition) == ViewerReads::Nothing)
                {
                    continue;
                }
                let beside = limits
                    .iter()
                    .find(|limit| !deciders.iter().any(|d| is_limit(d, limit)));
                if let Some((at, _)) = beside {
                    return Err(Unclear(*at));
                }
            }
        }
        Ok(())
    }

    /// Whether a value is computed from a test of the material's: it reads a texture, or a condition
    /// of the author's that differs on the surface.
    pub(super) fn has_test(&self, at: At) -> bool {
        let Some(value) = self.values.named(at.0, at.1) else {
            return false;
        };
        let held = with_operands(&self.values, vec![value]);
        let is_condition = |value: ValueId| {
            let is_author = self.interpolated[value] && !self.dependent[value];
            is_author && super::varies(&self.values, value) && self.is_truth(value)
        };
        self.is_textured(at)
            || self.reads_screen(at)
            || (0..held.len()).any(|value| held[value] && is_condition(value))
    }

    /// Whether a value is a truth value.
    fn is_truth(&self, value: ValueId) -> bool {
        let Node::Expression(context, e, _) = &self.values.values[value].node else {
            return false;
        };
        let module = self.values.graph.module();
        *self.f(*context).ty(module, *e) == TypeInner::Scalar(Scalar::BOOL)
    }
}
