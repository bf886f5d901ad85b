//! What must be evaluated once, or not at all: naga evaluates both sides of `&&` and `||`, the target of a compound assignment twice, and an out argument in place.

use glsl_lang::ast::{
    Expr, ExprData, IterationStatementData, JumpStatementData, NodeSpan,
    SelectionRestStatementData, Statement, StatementData, UnaryOpData,
};

use super::super::marks::unmarked;
use super::super::stage::Storage;
use super::super::ty::Ty;
use super::Lower;
use super::expression::{Ex, level};
use crate::front::error::Error;

/// An argument that a function writes: what stands before the call, what is handed over, and what stands after it.
pub(super) struct Written {
    pub before: Option<String>,
    pub argument: String,
    pub after: Option<String>,
}

/// Where a node is, for remembering what it became.
fn key(span: Option<NodeSpan>) -> Option<(u32, u32)> {
    let range = span?.range();
    Some((u32::from(range.start()), u32::from(range.end())))
}

impl Lower<'_, '_> {
    /// Whether evaluating it does something, or costs what an author may want to be spared: a call of the author's own, `++`, an assignment.
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
                    || name.starts_with("image")
                    || name.starts_with("atomic")
                    || arguments.iter().any(|a| self.has_effect(a))
            }
            _ => false,
        }
    }

    /// A variable of the function that is printed; `None` outside of functions.
    pub(super) fn temporary(&mut self, ty: &Ty) -> Option<String> {
        self.temporaries.as_ref()?;
        let name = self.fresh("held");
        let declared = format!("    {};\n", ty.declare(&name));
        self.temporaries.as_mut()?.push(declared);
        Some(name)
    }

    /// A value that may be written several times, with what is to be evaluated first if it is no name.
    pub(super) fn once(&mut self, value: &Ex) -> (Option<String>, Ex) {
        let simple = |c: char| c.is_alphanumeric() || matches!(c, '_' | '.' | '[' | ']');
        if unmarked(&value.text).chars().all(simple) || matches!(value.ty, Ty::Unknown) {
            return (None, value.clone());
        }
        match self.temporary(&value.ty) {
            Some(name) => (
                Some(format!("{name} = {}", value.at(level::ASSIGNMENT))),
                Ex::primary(name, value.ty.clone()),
            ),
            None => (None, value.clone()),
        }
    }

    /// What an expression became ahead of where it stands.
    pub(super) fn held(&self, e: &Expr) -> Option<Ex> {
        self.held.get(&key(e.span)?).cloned()
    }

    /// Evaluates the indices of a target that do something, so that the target itself may be written twice; what is to be evaluated first.
    pub(super) fn settle(&mut self, target: &Expr) -> Result<Vec<String>, Error> {
        let mut first = Vec::new();
        match &target.content {
            ExprData::Dot(of, _) => first.extend(self.settle(of)?),
            ExprData::Bracket(of, index) => {
                first.extend(self.settle(of)?);
                if self.has_effect(index) {
                    let value = self.expr(index)?;
                    let (before, value) = self.once(&value);
                    if let (Some(before), Some(key)) = (before, key(index.span)) {
                        first.push(before);
                        self.held.insert(key, value);
                    }
                }
            }
            _ => {}
        }
        Ok(first)
    }

    /// An argument for a parameter of type `to` that is written. What is not a variable by itself, or is one that another argument writes too, is copied in and out, as GLSL
    /// has it: WGSL has no pointer to a component, nor two to one variable.
    pub(super) fn written(
        &mut self,
        argument: &Expr,
        to: &Ty,
        storage: Storage,
        others: &[&str],
    ) -> Result<Written, Error> {
        let whole = match &argument.content {
            ExprData::Variable(name) => others.iter().filter(|o| **o == name.as_str()).count() < 2,
            _ => false,
        };
        let settled = match whole {
            true => Vec::new(),
            false => self.settle(argument)?,
        };
        let target = self.raw(argument)?;
        let name = match whole || self.is_otherwise(&target) || target.ty != *to {
            true => None,
            false => self.temporary(to),
        };
        let Some(name) = name else {
            return Ok(Written {
                before: None,
                argument: target.at(level::ASSIGNMENT),
                after: None,
            });
        };
        let mut before = settled;
        if storage == Storage::InOut {
            before.push(format!("{name} = {}", target.at(level::ASSIGNMENT)));
        }
        Ok(Written {
            before: (!before.is_empty()).then(|| before.join(", ")),
            after: Some(format!("{} = {name}", target.at(level::UNARY))),
            argument: name,
        })
    }

    /// A call between what its written arguments ask for.
    pub(super) fn called(&mut self, call: String, result: Ty, written: Vec<Written>) -> Ex {
        let (mut before, mut after) = (Vec::new(), Vec::new());
        for each in written {
            before.extend(each.before);
            after.extend(each.after);
        }
        if before.is_empty() && after.is_empty() {
            return Ex::primary(call, result);
        }
        if result == Ty::Void {
            // A statement: it stands in no expression.
            before.push(call);
            before.extend(after);
            return Ex::new(before.join("; "), result, 0);
        }
        match self.temporary(&result) {
            Some(name) => {
                before.push(format!("{name} = {call}"));
                before.extend(after);
                Ex::primary(format!("({}, {name})", before.join(", ")), result)
            }
            None => Ex::primary(call, result),
        }
    }
}

/// An expression after what is to be evaluated first.
pub(super) fn after(first: impl IntoIterator<Item = String>, ex: Ex) -> Ex {
    let mut all: Vec<String> = first.into_iter().collect();
    if all.is_empty() {
        return ex;
    }
    all.push(ex.at(level::ASSIGNMENT));
    Ex::primary(format!("({})", all.join(", ")), ex.ty)
}

/// Whether a loop with this body has a `continue` of its own.
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
            // Its own loop's.
            IterationStatementData::While(..)
            | IterationStatementData::DoWhile(..)
            | IterationStatementData::For(..) => false,
        },
        _ => false,
    }
}
