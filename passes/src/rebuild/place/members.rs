//! Structs with some members removed: passing, returning and decomposing them.

use naga::{Expression, Handle, Span, Statement, TypeInner};

use super::function::SliceCopier;
use super::interface::{Narrowed, Returned};
use naga_edit::copy::CopyFunction;

/// The copy of a struct member.
pub(super) enum MemberCopy {
    Whole(Handle<Expression>),
    Member(Handle<Expression>, u32),
}

impl SliceCopier<'_, '_> {
    /// Removes expressions that only a narrowed `return` reads: a `Compose` becomes its components,
    /// and a load becomes loads of its members if nothing happens between the two.
    pub(super) fn dissolve(&mut self) {
        if !matches!(self.returned, Returned::Member(_) | Returned::Members(..)) {
            return;
        }
        let mut uses = vec![0_usize; self.f.function.expressions.len()];
        let mut returned = Vec::new();
        let mut last_emit = None;
        for (id, node) in self.f.statements.iter() {
            if let Statement::Return { value: Some(value) } = node.statement
                && self.part.kept.statements[id.index()]
            {
                returned.push((*value, last_emit));
            }
            last_emit = matches!(node.statement, Statement::Emit(_)).then_some(id);
            if self.part.kept.statements[id.index()] {
                for e in naga_operands::of_statement(node.statement) {
                    uses[e.index()] += 1;
                }
            }
        }
        for (e, expression) in self.f.function.expressions.iter() {
            if self.part.kept.expressions[e.index()].is_some() {
                for operand in naga_operands::of_expression(expression) {
                    uses[operand.index()] += 1;
                }
            }
        }
        for (value, emit) in returned {
            let alone = uses[value.index()] == 1;
            self.dissolved[value.index()] = match &self.f.function.expressions[value] {
                Expression::Compose { .. } => alone,
                Expression::Load { .. } => {
                    alone && emit.is_some() && self.f.statements.evaluated_at(value) == emit
                }
                _ => false,
            };
        }
    }

    /// The copy of an operand, for a user of the whole value.
    pub(super) fn whole_copy(&self, e: Handle<Expression>) -> Option<Handle<Expression>> {
        self.whole.get(&e).copied().or_else(|| self.copy_of(e))
    }

    fn narrowed_argument(&self, e: Handle<Expression>) -> Option<&Narrowed> {
        match self.f.function.expressions[e] {
            Expression::FunctionArgument(i) => self.narrowed.get(&i),
            _ => None,
        }
    }

    /// The copy of member `index` of the struct value or pointer `base`.
    pub(super) fn member_copy(&self, base: Handle<Expression>, index: u32) -> Option<MemberCopy> {
        let new = self.copy_of(base)?;
        let members = match (self.narrowed_argument(base), self.results.get(&base)) {
            (Some(narrowed), _) => &narrowed.members,
            (None, Some(Returned::Member(m))) if *m == index => {
                return Some(MemberCopy::Whole(new));
            }
            (None, Some(Returned::Members(members, _))) => members,
            _ => return Some(MemberCopy::Member(self.whole_copy(base)?, index)),
        };
        match members.iter().position(|m| *m == index) {
            Some(at) => Some(MemberCopy::Member(new, at as u32)),
            None => Some(MemberCopy::Member(self.whole_copy(base)?, index)),
        }
    }

    /// A member of a struct value. Appends to the arena; the caller emits it.
    fn member(&mut self, e: Handle<Expression>, index: u32, span: Span) -> Handle<Expression> {
        if let Expression::Compose { components, .. } = &self.f.function.expressions[e]
            && let Some(component) = self.whole_copy(components[index as usize])
        {
            return component;
        }
        match self.member_copy(e, index) {
            Some(MemberCopy::Whole(value)) => value,
            Some(MemberCopy::Member(base, index)) => {
                self.append(Expression::AccessIndex { base, index }, span)
            }
            None => e,
        }
    }

    /// Whether a node of the slice uses a struct value as a whole, and not by single members.
    fn is_used_whole(&self, value: Handle<Expression>) -> bool {
        let same = |e: Handle<Expression>| match (
            &self.f.function.expressions[e],
            &self.f.function.expressions[value],
        ) {
            (Expression::FunctionArgument(a), Expression::FunctionArgument(b)) => a == b,
            _ => e == value,
        };
        let by_expression = self.f.function.expressions.iter().any(|(e, expression)| {
            self.part.kept.expressions[e.index()].is_some()
                && !self.dissolved[e.index()]
                && !matches!(expression, Expression::AccessIndex { .. })
                && naga_operands::of_expression(expression)
                    .into_iter()
                    .any(same)
        });
        by_expression
            || self.f.statements.iter().any(|(id, node)| {
                if !self.part.kept.statements[id.index()] {
                    return false;
                }
                match node.statement {
                    Statement::Call { arguments, .. } => {
                        let callee = self
                            .part
                            .calls
                            .get(&id)
                            .and_then(|p| self.placed[*p].as_ref());
                        arguments.iter().enumerate().any(|(i, a)| {
                            same(*a)
                                && callee.is_none_or(|c| !c.arguments.contains_key(&(i as u32)))
                        })
                    }
                    Statement::Return { value: Some(v) } => {
                        same(*v) && matches!(self.returned, Returned::Whole)
                    }
                    other => naga_operands::of_statement(other).into_iter().any(same),
                }
            })
    }

    /// Reassembles narrowed struct arguments for users of the whole value.
    pub(super) fn reassemble_arguments(&mut self) {
        for (e, expression) in self.f.function.expressions.iter() {
            if let Expression::FunctionArgument(i) = expression
                && let Some(narrowed) = self.narrowed.get(i).cloned()
                && self.copy_of(e).is_some()
                && self.is_used_whole(e)
            {
                self.reassemble(e, &narrowed, Span::UNDEFINED);
            }
        }
    }

    /// Records that a call returns only a part, and builds the whole value if it is used.
    pub(super) fn narrow_result(
        &mut self,
        original: Handle<Expression>,
        new: Handle<Expression>,
        returned: &Returned,
        span: Span,
    ) {
        let Some(ty) = self.f.info[original].ty.handle() else {
            return;
        };
        let members = match returned {
            Returned::Nothing | Returned::Whole => return,
            Returned::Member(m) => vec![*m],
            Returned::Members(members, _) => members.clone(),
        };
        self.copying.copies.insert(original, new);
        self.results.insert(original, returned.clone());
        if self.is_used_whole(original) {
            let narrowed = Narrowed {
                whole: ty,
                ty,
                members,
            };
            self.reassemble(original, &narrowed, span);
        }
    }

    fn reassemble(&mut self, e: Handle<Expression>, narrowed: &Narrowed, span: Span) {
        let TypeInner::Struct { members, .. } = &self.module.types[narrowed.whole].inner else {
            return;
        };
        let zeros: Vec<_> = members
            .iter()
            .enumerate()
            .map(|(i, m)| (!narrowed.members.contains(&(i as u32))).then(|| self.zero(m.ty)))
            .collect();
        self.copying.writer.begin();
        let mut components = Vec::new();
        for (i, zero) in zeros.into_iter().enumerate() {
            components.push(match zero {
                Some(zero) => zero,
                None => self.member(e, i as u32, span),
            });
        }
        let ty = narrowed.whole;
        let built = self.append(Expression::Compose { ty, components }, span);
        self.copying.writer.flush(span);
        self.whole.insert(e, built);
    }

    /// An argument for a narrowed parameter.
    pub(super) fn pass_members(
        &mut self,
        e: Handle<Expression>,
        narrowed: &Narrowed,
        span: Span,
    ) -> Handle<Expression> {
        if let Some(own) = self.narrowed_argument(e)
            && own.ty == narrowed.ty
            && let Some(new) = self.copy_of(e)
        {
            return new;
        }
        self.copying.writer.begin();
        let components = narrowed
            .members
            .iter()
            .map(|m| self.member(e, *m, span))
            .collect();
        let ty = narrowed.ty;
        let built = self.append(Expression::Compose { ty, components }, span);
        self.copying.writer.flush(span);
        built
    }

    pub(super) fn returned(&mut self, value: Handle<Expression>) -> Option<Handle<Expression>> {
        let members = match &self.returned {
            Returned::Nothing => return None,
            Returned::Whole => return Some(self.operand(value)),
            Returned::Member(m) => vec![*m],
            Returned::Members(members, _) => members.clone(),
        };
        let span = self.f.function.expressions.get_span(value);
        self.copying.writer.begin();
        let parts: Vec<Handle<Expression>> = match &self.f.function.expressions[value] {
            Expression::Load { pointer } if self.dissolved[value.index()] => {
                let base = self.operand(*pointer);
                members
                    .iter()
                    .map(|m| {
                        let pointer =
                            self.append(Expression::AccessIndex { base, index: *m }, span);
                        self.append(Expression::Load { pointer }, span)
                    })
                    .collect()
            }
            _ => members
                .iter()
                .map(|m| self.member(value, *m, span))
                .collect(),
        };
        let result = match &self.returned {
            Returned::Members(_, ty) => {
                let ty = *ty;
                self.append(
                    Expression::Compose {
                        ty,
                        components: parts,
                    },
                    span,
                )
            }
            _ => *parts.first()?,
        };
        self.copying.writer.flush(span);
        Some(result)
    }
}
