//! Preserves GLSL's order of evaluation for the indices of a target that is read and written, and
//! for the arguments of a call that writes some of them.

use glsl_lang::ast::{
    Expr, ExprData, IterationStatementData, JumpStatementData, NodeSpan,
    SelectionRestStatementData, Statement, StatementData, UnaryOpData,
};

use std::collections::HashSet;

use naga::Span;

use super::Resolver;
use super::expression::Ex;
use crate::stage::Storage;
use crate::stage::side_effects::{Effects, root, written_by_own};
use crate::tree::{Kind, Node};
use crate::ty::Ty;
use shader_text::error::Error;

/// A call's argument, with statements before and after the call.
pub(super) struct Argument {
    pub before: Vec<Node>,
    pub node: Node,
    pub after: Vec<Node>,
}

impl Argument {
    pub(super) fn of(node: Node) -> Self {
        Self {
            before: Vec::new(),
            node,
            after: Vec::new(),
        }
    }
}

/// Properties of an expression, determined before it is resolved.
#[derive(Clone, Debug)]
pub(super) struct Properties {
    pub ty: Ty,
    /// Whether it can be assigned to directly.
    pub is_plain: bool,
    /// Whether its stored type differs from its computed type.
    pub is_converted: bool,
}

/// Side effects of a call's arguments, and of the call.
pub(super) struct CallEffects<'e> {
    arguments: &'e [Expr],
    /// Whether the call writes each argument.
    outs: Vec<bool>,
    /// For each argument: the variables it writes, and whether it calls functions with side
    /// effects.
    effects: Vec<(HashSet<String>, bool)>,
}

impl CallEffects<'_> {
    /// Whether any argument has side effects.
    pub(super) fn has_effects(&self) -> bool {
        self.effects
            .iter()
            .any(|(w, calls)| *calls || !w.is_empty())
    }

    /// Whether evaluating the arguments or the call may write a variable other than through the
    /// argument `own`.
    fn may_change(&self, name: &str, is_local: bool, own: Option<usize>) -> bool {
        let by_call = self.arguments.iter().zip(&self.outs).enumerate();
        let mut by_call = by_call.filter(|(i, (_, out))| **out && Some(*i) != own);
        let mut by_others = self.effects.iter().enumerate();
        by_call.any(|(_, (argument, _))| root(argument) == Some(name))
            || by_others.any(|(i, (written, calls))| {
                Some(i) != own && (written.contains(name) || *calls && !is_local)
            })
    }
}

/// An expression's position, which identifies it.
fn key(span: Option<NodeSpan>) -> Option<(u32, u32)> {
    let range = span?.range();
    Some((u32::from(range.start()), u32::from(range.end())))
}

impl Resolver<'_, '_> {
    /// Whether an expression has side effects, or calls a user function, which may be expensive.
    pub(super) fn has_effect(&self, e: &Expr) -> bool {
        match &e.content {
            ExprData::Assignment(..) | ExprData::PostInc(_) | ExprData::PostDec(_) => true,
            ExprData::Unary(op, of) => {
                matches!(op.content, UnaryOpData::Inc | UnaryOpData::Dec) || self.has_effect(of)
            }
            ExprData::Binary(_, a, b) | ExprData::Bracket(a, b) | ExprData::Comma(a, b) => {
                self.has_effect(a) || self.has_effect(b)
            }
            ExprData::Ternary(a, b, c) => [a, b, c].iter().any(|e| self.has_effect(e)),
            ExprData::Dot(of, _) => self.has_effect(of),
            ExprData::FunCall(name, arguments) => {
                let name = name.as_ident().map_or("", |n| n.as_str());
                self.stage.signatures.contains_key(name)
                    || ["image", "atomic", "subgroup"]
                        .iter()
                        .any(|w| name.starts_with(w))
                    || written_by_own(name) > 0
                    || arguments.iter().any(|a| self.has_effect(a))
            }
            _ => false,
        }
    }

    /// Declares a temporary in the current function. `None` outside of functions.
    pub(super) fn temporary(&mut self, ty: &Ty) -> Option<Node> {
        self.temporaries.as_ref()?;
        let local = self.add_local("held", ty.clone());
        self.temporaries.as_mut()?.push(local);
        Some(Node::local(local))
    }

    /// A copy of a value that may be evaluated several times, and the assignment to evaluate first.
    pub(super) fn once(&mut self, value: &Ex) -> (Option<Node>, Ex) {
        if value.node.is_path() {
            return (None, value.clone());
        }
        match self.temporary(&value.ty) {
            Some(held) => (
                Some(Node::assign(&held, value.node.clone())),
                Ex::new(held, value.ty.clone()),
            ),
            None => (None, value.clone()),
        }
    }

    /// Holds the values that `is_moving` selects. Keeps the order of effects: if one of these, or a
    /// value before it, changes a variable, holds all values before it too. Returns the
    /// assignments.
    pub(super) fn hold_in_order(
        &mut self,
        values: &mut [Ex],
        is_moving: impl Fn(usize, &Ex) -> bool,
    ) -> Vec<Node> {
        let held: Vec<bool> = (0..).zip(&*values).map(|(i, v)| is_moving(i, v)).collect();
        let last = held.iter().rposition(|held| *held).unwrap_or(0);
        let changes = values
            .iter()
            .take(last + 1)
            .any(|v| v.node.writes(&|id| self.writing.contains(&id)));
        let mut first = Vec::new();
        for (i, value) in values.iter_mut().enumerate() {
            let is_before = changes && i < last && !matches!(*value.node.kind, Kind::Literal(_));
            if held[i] || is_before {
                let (before, held) = self.hidden(value.clone());
                first.extend(before);
                *value = held;
            }
        }
        first
    }

    /// Determines an expression's properties: resolves it, then undoes all effects. Caches the
    /// results, because nesting would take exponential time.
    pub(super) fn look(&mut self, e: &Expr) -> Result<Properties, Error> {
        let known = key(e.span).filter(|k| !self.held.contains_key(k));
        if let Some(looked) = known.and_then(|k| self.looked.get(&k)) {
            return Ok(looked.clone());
        }
        let held = self.held_keys.len();
        let temporaries = self.temporaries.as_ref().map_or(0, Vec::len);
        let calls = self.calls.len();
        let ex = self.raw(e);
        for key in self.held_keys.split_off(held) {
            self.held.remove(&key);
        }
        if let Some(all) = &mut self.temporaries {
            all.truncate(temporaries);
        }
        self.calls.truncate(calls);
        let ex = ex?;
        let looked = Properties {
            is_plain: self.is_plain(&ex),
            is_converted: self.stage.structs.is_converted(&ex.ty, ex.lay),
            ty: ex.ty,
        };
        if let Some(key) = known {
            self.looked.insert(key, looked.clone());
        }
        Ok(looked)
    }

    /// The type of an argument, and its value unless it has side effects and may be copied.
    pub(super) fn argument(&mut self, e: &Expr) -> Result<(Ty, Option<Ex>), Error> {
        let is_place = matches!(e.content, ExprData::Dot(..) | ExprData::Bracket(..));
        match is_place && self.has_effect(e) {
            true => Ok((self.look(e)?.ty, None)),
            false => self.raw(e).map(|ex| (ex.ty.clone(), Some(ex))),
        }
    }

    /// The types of arguments, and their values as from [`Self::argument`].
    pub(super) fn arguments(&mut self, all: &[Expr]) -> Result<(Vec<Ty>, Vec<Option<Ex>>), Error> {
        let arguments = all.iter().map(|e| self.argument(e));
        Ok(arguments
            .collect::<Result<Vec<_>, _>>()?
            .into_iter()
            .unzip())
    }

    /// The temporary that holds an expression's value, if there is one.
    pub(super) fn held(&self, e: &Expr) -> Option<Ex> {
        self.held.get(&key(e.span)?).cloned()
    }

    /// Holds the indices of a target that have side effects, so that the target may be evaluated
    /// twice. Returns the statements to evaluate first.
    pub(super) fn settle(&mut self, target: &Expr) -> Result<Vec<Node>, Error> {
        self.settle_where(target, &|this, index| this.has_effect(index))
    }

    /// As [`Self::settle`], for the indices that `is_moving` selects.
    pub(super) fn settle_where(
        &mut self,
        target: &Expr,
        is_moving: &dyn Fn(&Self, &Expr) -> bool,
    ) -> Result<Vec<Node>, Error> {
        let mut first = Vec::new();
        match &target.content {
            ExprData::Dot(of, _) => first.extend(self.settle_where(of, is_moving)?),
            ExprData::Bracket(of, index) => {
                first.extend(self.settle_where(of, is_moving)?);
                if is_moving(self, index) {
                    first.push(self.hold_ahead(index)?);
                }
            }
            ExprData::Variable(_) => {}
            _ if is_moving(self, target) => first.push(self.hold_ahead(target)?),
            _ => {}
        }
        Ok(first)
    }

    /// Assigns an expression to a temporary, which replaces it from now on. Returns the assignment.
    fn hold_ahead(&mut self, e: &Expr) -> Result<Node, Error> {
        let value = self.expr(e)?;
        let held = self.needed(&value.ty, self.place(e.span))?;
        let first = Node::assign(&held, value.node);
        if let Some(key) = key(e.span) {
            let before = self.held.insert(key, Ex::new(held, value.ty));
            debug_assert!(before.is_none(), "evaluated ahead twice");
            self.held_keys.push(key);
        }
        Ok(first)
    }

    /// Whether an expression writes a variable.
    pub(super) fn writes(&self, e: &Expr) -> bool {
        let (written, calls) = self.effects(e);
        calls || !written.is_empty()
    }

    fn effects(&self, e: &Expr) -> (HashSet<String>, bool) {
        let found = Effects::within(e, &self.stage.signatures);
        let calls = found.images || found.calls.iter().any(|c| self.stage.writers.contains(c));
        (found.written, calls)
    }

    /// Whether evaluating `e` may change the target, or variables that its indices read.
    pub(super) fn may_change(&self, e: &Expr, target: &Expr) -> bool {
        let (written, calls) = self.effects(e);
        let named = Effects::within(target, &self.stage.signatures).named;
        named
            .iter()
            .any(|name| written.contains(name) || calls && !self.is_local(name))
    }

    /// The side effects of a call that writes the arguments in `outs`.
    pub(super) fn call_effects<'e>(
        &self,
        arguments: &'e [Expr],
        outs: Vec<bool>,
    ) -> CallEffects<'e> {
        let effects = arguments.iter().map(|a| self.effects(a)).collect();
        CallEffects {
            arguments,
            outs,
            effects,
        }
    }

    pub(super) fn is_local(&self, name: &str) -> bool {
        self.scopes.iter().skip(1).any(|s| s.contains_key(name))
    }

    /// Whether the call may write the argument in place: it is a plain variable of the parameter's
    /// type, and nothing else in the call uses it.
    pub(super) fn is_direct(
        &mut self,
        call_effects: &CallEffects<'_>,
        i: usize,
        to: &Ty,
    ) -> Result<bool, Error> {
        let argument = &call_effects.arguments[i];
        self.check_written(argument)?;
        let ExprData::Variable(name) = &argument.content else {
            return Ok(false);
        };
        let name = name.as_str();
        if call_effects.may_change(name, self.is_local(name), Some(i)) {
            return Ok(false);
        }
        let target = self.raw(argument)?;
        Ok(target.ty == *to && self.is_plain(&target))
    }

    /// A by-value argument, held in a temporary if later arguments have side effects.
    pub(super) fn in_order(&mut self, of: &Expr, value: Ex) -> Result<Argument, Error> {
        if is_literal(of) {
            return Ok(Argument::of(value.node));
        }
        let held = self.needed(&value.ty, self.place(of.span))?;
        Ok(Argument {
            before: vec![Node::assign(&held, value.node)],
            node: held,
            after: Vec::new(),
        })
    }

    /// An out argument of type `to`, copied through a temporary: copied in at its place in the
    /// order, copied out after the call (GLSL 4.60, 6.1.1). Its indices are evaluated once, at its
    /// place in the order.
    pub(super) fn copied(
        &mut self,
        call_effects: &CallEffects<'_>,
        i: usize,
        to: &Ty,
        storage: Storage,
    ) -> Result<Argument, Error> {
        let argument = &call_effects.arguments[i];
        let place = self.place(argument.span);
        let mut before = self.settle_where(argument, &|this, index| {
            let found = Effects::within(index, &this.stage.signatures);
            let moves = |name: &String| {
                let known = this.stage.constants.is_known(name);
                !known && call_effects.may_change(name, this.is_local(name), None)
            };
            let global =
                |name: &String| !this.is_local(name) && !this.stage.constants.is_known(name);
            !found.calls.is_empty()
                || !found.written.is_empty()
                || found.named.iter().any(|n| moves(n) || global(n))
        })?;
        let target = self.raw(argument)?;
        self.check_swizzle(&target, place)?;
        let held = Ex::new(self.needed(to, place)?, to.clone());
        let node = held.node.clone();
        if storage == Storage::InOut {
            let value = self.value(target.clone());
            before.push(Node::assign(&node, value.node));
        }
        let value = self.coerce(held, &target.ty);
        Ok(Argument {
            before,
            node,
            after: self.stores(&target, &value, place)?,
        })
    }

    /// Combines a call with the statements before and after it for its arguments.
    pub(super) fn called(
        &mut self,
        call: impl FnOnce(Vec<Node>) -> Node,
        result: Ty,
        arguments: Vec<Argument>,
        place: Option<Span>,
    ) -> Result<Ex, Error> {
        let (mut before, mut after) = (Vec::new(), Vec::new());
        let mut nodes = Vec::new();
        for each in arguments {
            before.extend(each.before);
            nodes.push(each.node);
            after.extend(each.after);
        }
        let call = call(nodes).at(place);
        if before.is_empty() && after.is_empty() {
            return Ok(Ex::new(call, result));
        }
        if result == Ty::Void {
            before.push(call);
            before.extend(after);
            return Ok(Ex::new(Node::new(Kind::Sequence(before)), result));
        }
        let held = self.needed(&result, place)?;
        before.push(Node::assign(&held, call));
        before.extend(after);
        Ok(Ex::new(Node::after(before, held), result))
    }
}

/// Whether an expression is a literal with an optional sign.
pub(super) fn is_literal(e: &Expr) -> bool {
    match &e.content {
        ExprData::IntConst(_)
        | ExprData::UIntConst(_)
        | ExprData::BoolConst(_)
        | ExprData::FloatConst(_)
        | ExprData::DoubleConst(_) => true,
        ExprData::Unary(op, of) => matches!(op.content, UnaryOpData::Minus) && is_literal(of),
        _ => false,
    }
}

/// Evaluates assignments before an expression.
pub(super) fn after(first: impl IntoIterator<Item = Node>, ex: Ex) -> Ex {
    let first: Vec<Node> = first.into_iter().collect();
    if first.is_empty() {
        return ex;
    }
    Ex::new(Node::after(first, ex.node), ex.ty).folding(ex.folds)
}

/// Whether a loop's body has its own `continue`.
pub(super) fn continues(body: &Statement) -> bool {
    match &body.content {
        StatementData::Jump(jump) => matches!(jump.content, JumpStatementData::Continue),
        StatementData::Compound(inner) => inner.statement_list.iter().any(continues),
        StatementData::Selection(selection) => match &selection.rest.content {
            SelectionRestStatementData::Statement(then) => continues(then),
            SelectionRestStatementData::Else(then, other) => continues(then) || continues(other),
        },
        StatementData::Switch(switch) => switch.body.iter().any(continues),
        StatementData::Iteration(inner) => match &inner.content {
            // This `continue` belongs to a nested loop.
            IterationStatementData::While(..)
            | IterationStatementData::DoWhile(..)
            | IterationStatementData::For(..) => false,
        },
        _ => false,
    }
}
