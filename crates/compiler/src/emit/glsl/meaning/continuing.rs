//! Values that the loop's body computes, and that `continuing` and `break_if` read. naga writes
//! `continuing` at the start of the next iteration, where the body's temporaries are no longer in
//! scope. A local variable holds such a value; a pointer is formed again, with its former indices.

use std::collections::BTreeSet;

use naga::proc::TypeResolution;
use naga::{Block, Expression, Handle, LocalVariable, Span, Statement, Type, TypeInner};
use naga_edit::copy::CopyFunction as _;

use super::Keep;

impl<'a> Keep<'a> {
    /// Copies a loop, and stores the values that its end reads.
    pub(super) fn looped(
        &mut self,
        body: &'a Block,
        continuing: &'a Block,
        break_if: Option<Handle<Expression>>,
        span: Span,
    ) {
        let read = self.read_late(body, continuing, break_if);
        self.copying.writer.flush(span);
        for e in &read {
            if let Some(ty) = self.storable(*e) {
                let variable = self.variable(ty);
                self.kept.insert(*e, variable);
                self.is_changed = true;
            }
        }
        let enclosing = self.copying.writer.open(span);
        self.block(body);
        let copy = self.copying.writer.close(enclosing, span);
        let enclosing = self.copying.writer.open(span);
        for e in read {
            let expression = match self.kept.remove(&e) {
                Some(pointer) => Expression::Load { pointer },
                None => self.copied_expression(e),
            };
            self.copying.writer.begin();
            self.copying.append(e, expression);
        }
        self.block(continuing);
        let continuing = self.copying.writer.close(enclosing, span);
        let copy = Statement::Loop {
            body: copy,
            continuing,
            break_if: break_if.map(|e| self.operand(e)),
        };
        self.copying.writer.statement(copy, span);
    }

    /// Stores a value that a `continuing` block reads, where it is computed.
    pub(super) fn keep(&mut self, e: Handle<Expression>, span: Span) {
        if let Some(pointer) = self.kept.get(&e).copied() {
            let value = self.copy_of(e);
            let store = Statement::Store { pointer, value };
            self.copying.writer.statement(store, span);
        }
    }

    /// Values of the body that `continuing` and `break_if` read, operands first.
    fn read_late(
        &self,
        body: &Block,
        continuing: &Block,
        break_if: Option<Handle<Expression>>,
    ) -> BTreeSet<Handle<Expression>> {
        let function = self.copying.original;
        let mut of_body = BTreeSet::new();
        naga_operands::evaluated(body, &mut |e| {
            of_body.insert(e);
        });
        let mut open: Vec<Handle<Expression>> = break_if.into_iter().collect();
        naga_operands::evaluated(continuing, &mut |e| {
            open.extend(naga_operands::of_expression(&function.expressions[e]));
        });
        naga_operands::visit(continuing, &mut |s| {
            open.extend(naga_operands::of_statement(s))
        });
        let mut read = BTreeSet::new();
        while let Some(e) = open.pop() {
            if of_body.contains(&e) && read.insert(e) && self.storable(e).is_none() {
                open.extend(naga_operands::of_expression(&function.expressions[e]));
            }
        }
        read
    }

    /// The type of a value that a variable may hold.
    fn storable(&self, e: Handle<Expression>) -> Option<&'a TypeResolution> {
        let inner = self.inner(e);
        let is_value = matches!(
            inner,
            TypeInner::Scalar(_)
                | TypeInner::Vector { .. }
                | TypeInner::Matrix { .. }
                | TypeInner::Array { .. }
                | TypeInner::Struct { .. }
        );
        is_value.then(|| &self.info[e].ty)
    }

    /// A pointer to a new variable of this type.
    fn variable(&mut self, ty: &TypeResolution) -> Handle<Expression> {
        let ty = match ty {
            TypeResolution::Handle(ty) => *ty,
            TypeResolution::Value(inner) => {
                let (name, inner) = (None, inner.clone());
                self.types.insert(Type { name, inner }, Span::UNDEFINED)
            }
        };
        let variable = LocalVariable {
            name: Some("kept".to_owned()),
            ty,
            init: None,
        };
        let writer = &mut self.copying.writer;
        let locals = &mut writer.function.local_variables;
        let variable = locals.append(variable, Span::UNDEFINED);
        writer.expression(Expression::LocalVariable(variable))
    }
}
