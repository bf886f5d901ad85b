//! Conditions of discards without the viewer.

use naga::{BinaryOperator, Expression, Handle, Literal, LocalVariable, Statement, UnaryOperator};

use super::without_viewer::{self, Joined, Mode, Rest};
use super::{At, Changes, Instead, Stage, Unclear, ViewerReads};
use preshade_dataflow::graph::{FunctionGraph, StmtId};

/// The rest of a condition.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum RemainingCondition {
    /// A condition of the author's.
    Author {
        reads: ViewerReads,
        /// Whether it was the author's only where something of the viewer's was so, as
        /// `alpha < 0.5` in `near && alpha < 0.5`.
        limited: bool,
    },
    /// Nothing: the viewer alone decides it.
    Viewer,
}

impl RemainingCondition {
    fn author(reads: ViewerReads) -> Self {
        Self::Author {
            reads,
            limited: false,
        }
    }
}

impl Stage<'_, '_> {
    /// The changes that take the viewer out of the conditions of discards.
    ///
    /// # Errors
    /// The first condition whose form without the viewer is unclear.
    pub fn conditions(&self) -> Result<Changes, Unclear> {
        let mut changes = Changes::new();
        let mut limits = Vec::new();
        for context in 0..self.values.contexts.len() {
            for (id, node) in self.f(context).statements.iter() {
                let Statement::If {
                    condition,
                    accept,
                    reject,
                } = node.statement
                else {
                    continue;
                };
                let at = (context, *condition);
                if !self.depends(at) {
                    continue;
                }
                let first = StmtId::from(id.index() + 1);
                let mut second = first;
                for _ in accept {
                    second = self.f(context).statements.get(second).end;
                }
                let [then, other] = [
                    self.kills(context, accept, first),
                    self.kills(context, reject, second),
                ];
                // If both ways discard and the viewer takes one, the pass refuses in the end.
                let (kills, discards_if) = match (then.any(), other.any()) {
                    (true, false) => (then, true),
                    (false, true) => (other, false),
                    _ => continue,
                };
                let kept = match (kills.direct, kills.tested) {
                    (true, true) => return Err(Unclear(at)),
                    // The tests inside it stay.
                    (false, true) => discards_if,
                    // So does a test around it.
                    _ if self.is_in_test((context, id), at)? => discards_if,
                    _ => !discards_if,
                };
                let part = self.neutral(at, kept, &mut changes)?;
                if part == RemainingCondition::Viewer {
                    let before = changes.insert(at, Instead::Bool(kept));
                    // Another branch on the same value.
                    if before.is_some_and(|before| before != Instead::Bool(kept)) {
                        return Err(Unclear(at));
                    }
                }
                if kept == discards_if
                    || matches!(part, RemainingCondition::Author { limited: true, .. })
                {
                    limits.push((at, id));
                }
            }
        }
        self.check_limits(&limits, &changes)?;
        Ok(changes)
    }

    /// Whether nothing remains of a condition without the viewer.
    pub(super) fn is_viewers(&self, at: At) -> bool {
        self.neutral(at, false, &mut Changes::new()) == Ok(RemainingCondition::Viewer)
    }

    /// Takes the viewer out of a condition. If the viewer alone decides a part, that part counts as
    /// `kept`, unless the author's part decides too.
    fn neutral(
        &self,
        at: At,
        kept: bool,
        changes: &mut Changes,
    ) -> Result<RemainingCondition, Unclear> {
        if !self.depends(at) {
            return Ok(RemainingCondition::author(self.reads(at)));
        }
        let (context, e) = at;
        let f = self.f(context);
        match f.function.expressions[e] {
            Expression::Unary {
                op: UnaryOperator::LogicalNot,
                expr,
            } => return self.neutral((context, expr), !kept, changes),
            Expression::Binary { op, left, right } => match op {
                BinaryOperator::LogicalAnd | BinaryOperator::And => {
                    let sides = [((context, left), false), ((context, right), false)];
                    return self.joined(Some(at), sides, kept, kept, changes);
                }
                BinaryOperator::LogicalOr | BinaryOperator::InclusiveOr => {
                    let sides = [((context, left), false), ((context, right), false)];
                    return self.joined(Some(at), sides, kept, !kept, changes);
                }
                _ => return self.comparison(at, left, right, changes),
            },
            Expression::Load { pointer } => {
                if let Expression::LocalVariable(local) = f.function.expressions[pointer]
                    && let Some((condition, value, is_or)) = short_circuit(f, local)
                {
                    // `a || b` branches on `!a`.
                    let sides = [((context, condition), is_or), ((context, value), false)];
                    return self.joined(None, sides, kept, kept != is_or, changes);
                }
            }
            Expression::FunctionArgument(i) => {
                if let Some(outer) = self.argument(context, i) {
                    return self.neutral(outer, kept, changes);
                }
            }
            Expression::CallResult(_) => {
                if let Some(child) = self.callee(at)
                    && let [(_, returned)] = self.returns(child)[..]
                {
                    let part = self.neutral(returned, kept, changes)?;
                    return Ok(part);
                }
            }
            _ => {}
        }
        match without_viewer::of(self, at, Mode::Alpha) {
            Rest::Author(author) => {
                changes.extend(author.changes);
                Ok(RemainingCondition::author(self.reads(at)))
            }
            Rest::Nothing if !self.has_test(at) => Ok(RemainingCondition::Viewer),
            _ => Err(Unclear(at)),
        }
    }

    /// Two conditions, each of which may be negated, that are joined by `&&` or `||`: by the operation
    /// `whole`, or by a branch. `either`: one that is not `kept` suffices to make the whole not `kept`.
    fn joined(
        &self,
        whole: Option<At>,
        sides: [(At, bool); 2],
        kept: bool,
        either: bool,
        changes: &mut Changes,
    ) -> Result<RemainingCondition, Unclear> {
        let mut parts = [RemainingCondition::Viewer; 2];
        for ((side, negated), part) in sides.iter().zip(&mut parts) {
            *part = self.neutral(*side, kept != *negated, changes)?;
        }
        let (viewer, author, reads, limited) = match parts {
            [RemainingCondition::Viewer, RemainingCondition::Viewer] => {
                return Ok(RemainingCondition::Viewer);
            }
            [
                RemainingCondition::Author { reads, limited },
                RemainingCondition::Author {
                    reads: others,
                    limited: other,
                },
            ] => {
                // `alpha < 0.2 || near && alpha < 0.5`: a test of its own next to a limited one.
                if either && (limited || other) {
                    return Err(Unclear(sides[usize::from(other)].0));
                }
                return Ok(RemainingCondition::Author {
                    reads: reads.max(others),
                    limited: limited || other,
                });
            }
            [
                RemainingCondition::Viewer,
                RemainingCondition::Author { reads, limited },
            ] => (sides[0], sides[1], reads, limited),
            [
                RemainingCondition::Author { reads, limited },
                RemainingCondition::Viewer,
            ] => (sides[1], sides[0], reads, limited),
        };
        // `near && alpha < 0.5` is `alpha < 0.5`; of `near && odd_pixel` nothing remains.
        match reads {
            ViewerReads::Nothing if !either => return Ok(RemainingCondition::Viewer),
            ViewerReads::Inputs if !either => return Err(Unclear(author.0)),
            _ => {}
        }
        match (whole, viewer) {
            (Some(whole), _) => changes.insert(whole, Instead::Other(author.0.1)),
            (None, (side, negated)) => {
                changes.insert(side, Instead::Bool((kept == either) != negated))
            }
        };
        Ok(RemainingCondition::Author {
            reads,
            limited: limited || !either,
        })
    }

    fn comparison(
        &self,
        at: At,
        left: Handle<Expression>,
        right: Handle<Expression>,
        changes: &mut Changes,
    ) -> Result<RemainingCondition, Unclear> {
        let sides = [(at.0, left), (at.0, right)];
        let rests = sides.map(|side| match self.depends(side) {
            true => without_viewer::of(self, side, Mode::Alpha),
            false => Rest::Author(without_viewer::Author::default()),
        });
        let unclear = Err(Unclear(at));
        match rests {
            [Rest::Unclear, _] | [_, Rest::Unclear] => unclear,
            [Rest::Nothing, Rest::Nothing] if self.has_test(at) => unclear,
            [Rest::Nothing, Rest::Nothing] => Ok(RemainingCondition::Viewer),
            [Rest::Author(a), Rest::Author(b)] => {
                // A sum's fade may be neutral at another number than 0.
                let is_sum = [&a, &b].iter().any(|side| side.joined == Joined::Sum);
                if is_sum && sides.iter().any(|side| self.is_extreme(*side)) {
                    return unclear;
                }
                changes.extend(a.changes);
                changes.extend(b.changes);
                Ok(RemainingCondition::author(self.reads(at)))
            }
            [Rest::Author(author), Rest::Nothing] => {
                self.with_threshold(at, author, sides, changes)
            }
            [Rest::Nothing, Rest::Author(author)] => {
                self.with_threshold(at, author, [sides[1], sides[0]], changes)
            }
        }
    }

    /// A comparison of an author's value with a value that depends on the viewer and has none of
    /// the author's varying values.
    fn with_threshold(
        &self,
        at: At,
        author: without_viewer::Author,
        [value, threshold]: [At; 2],
        changes: &mut Changes,
    ) -> Result<RemainingCondition, Unclear> {
        if self.reads(value) == ViewerReads::Nothing && !self.has_test(at) {
            return Ok(RemainingCondition::Viewer);
        }
        match without_viewer::of(self, threshold, Mode::Threshold) {
            Rest::Author(other) => {
                changes.extend(author.changes);
                changes.extend(other.changes);
                Ok(RemainingCondition::author(self.reads(at)))
            }
            _ => Err(Unclear(at)),
        }
    }

    /// Whether a value is a literal with which an alpha is not compared.
    fn is_extreme(&self, (context, e): At) -> bool {
        let f = self.f(context).function;
        matches!(f.expressions[e], Expression::Literal(Literal::F32(x)) if x <= 0.0 || x >= 1.0)
    }
}

/// The stores of a function, in order.
fn stores<'f>(
    f: &'f FunctionGraph<'_>,
) -> impl Iterator<Item = (StmtId, Handle<Expression>, Handle<Expression>)> + 'f {
    f.statements
        .iter()
        .filter_map(|(at, node)| match node.statement {
            Statement::Store { pointer, value } => Some((at, *pointer, *value)),
            _ => None,
        })
}

/// The condition and the second side of `a || b` or `a && b`, which naga writes as an `if` that
/// stores `b` or a constant, and whether it is `||`.
fn short_circuit(
    f: &FunctionGraph<'_>,
    local: Handle<LocalVariable>,
) -> Option<(Handle<Expression>, Handle<Expression>, bool)> {
    let is_it = |pointer| f.function.expressions[pointer] == Expression::LocalVariable(local);
    let mut all = stores(f).filter(|(_, pointer, _)| is_it(*pointer));
    let (Some((first, _, value)), Some((second, _, constant)), None) =
        (all.next(), all.next(), all.next())
    else {
        return None;
    };
    let Expression::Literal(Literal::Bool(is_or)) = f.function.expressions[constant] else {
        return None;
    };
    let parent = f.statements.get(first).parent?;
    let Statement::If { condition, .. } = f.statements.get(parent).statement else {
        return None;
    };
    let is_alike = f.statements.get(second).parent == Some(parent);
    is_alike.then_some((*condition, value, is_or))
}
