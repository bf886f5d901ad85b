//! Resolves statements.

use std::mem;

use glsl_lang::ast::{
    self, CaseLabelData, ConditionData, DeclarationData, Expr, ExprData, ForInitStatementData,
    IterationStatementData, JumpStatementData, SelectionRestStatementData,
    Statement as AstStatement, StatementData,
};
use naga::Span;

use super::expression::Ex;
use super::{Resolver, Var, check, effect};
use crate::errors::{unsupported, wrong};
use crate::stage::{Storage, simple};
use crate::tree::{Case, Node, Statement, StatementKind as S};
use crate::ty::Ty;
use crate::{constant, operations};
use shader_text::error::{Code, Error};

impl Resolver<'_, '_> {
    /// Resolves a statement, which may become several or none.
    pub(super) fn statement(
        &mut self,
        statement: &AstStatement,
        out: &mut Vec<Statement>,
    ) -> Result<(), Error> {
        let place = self.place(statement.span);
        let kind = match &statement.content {
            StatementData::Declaration(d) => {
                let declared = self.declared(d)?.into_iter();
                out.extend(declared.map(|declared| declared.at(place)));
                return Ok(());
            }
            StatementData::Expression(e) => match &e.content.0 {
                Some(e) => return self.alone(e, place, out),
                None => return Ok(()),
            },
            StatementData::Compound(c) => S::Block(self.block_of(&c.statement_list)?),
            StatementData::Selection(s) => {
                let condition = self.asked(&s.cond)?.node;
                let (then, other) = match &s.rest.content {
                    SelectionRestStatementData::Statement(then) => (then, None),
                    SelectionRestStatementData::Else(then, other) => (then, Some(other)),
                };
                let accept = self.body(then)?;
                let reject = match other {
                    Some(other) => Some(self.body(other)?),
                    None => None,
                };
                S::If {
                    condition,
                    accept,
                    reject,
                }
            }
            StatementData::Switch(s) => self.switch(s)?,
            StatementData::CaseLabel(_) => {
                return Err(unsupported("a case must be in a `switch`", place));
            }
            StatementData::Iteration(i) => return self.iteration(i, place, out),
            StatementData::Jump(j) => match &j.content {
                JumpStatementData::Continue if self.loops == 0 => {
                    return Err(wrong("`continue` must be in a loop", place));
                }
                JumpStatementData::Break if self.loops + self.switches == 0 => {
                    return Err(wrong("`break` must be in a loop or a `switch`", place));
                }
                JumpStatementData::Continue => S::Continue,
                JumpStatementData::Break => S::Break,
                JumpStatementData::Discard => S::Discard,
                JumpStatementData::Return(Some(e)) => {
                    let ex = self.expr(e)?;
                    let result = self.result.clone();
                    if result == Ty::Void {
                        return Err(wrong("this function returns nothing", self.place(e.span)));
                    }
                    self.check_given(&ex.ty, &result, self.place(e.span))?;
                    S::Return(Some(self.coerce(ex, &result).node))
                }
                JumpStatementData::Return(None) => {
                    let result = &self.result;
                    if *result != Ty::Void {
                        let message = format!("this function returns {}", check::a(result));
                        return Err(wrong(message, place));
                    }
                    if self.in_main {
                        out.extend(self.epilogue.iter().cloned());
                    }
                    S::Return(None)
                }
            },
        };
        out.push(Statement::new(kind).at(place));
        Ok(())
    }

    fn switch(&mut self, s: &ast::SwitchStatement) -> Result<S, Error> {
        let selector = self.expr(&s.head)?;
        let of = self.place(s.head.span);
        if !matches!(selector.ty, Ty::INT | Ty::UINT) {
            let message = format!(
                "`switch` takes an int or a uint, not {}",
                check::a(&selector.ty)
            );
            return Err(wrong(message, of));
        }
        let selector = selector.node;
        self.switches += 1;
        let mut cases: Vec<Case> = Vec::new();
        self.scopes.push(Default::default());
        let constants = self.stage.constants.clone();
        let mut reached = true;
        for statement in &s.body {
            if let StatementData::CaseLabel(label) = &statement.content {
                reached = true;
                let value = self.case(label)?;
                if cases.iter().any(|case| case.value == value) {
                    let place = self.place(statement.span);
                    return Err(wrong("this case occurs twice", place));
                }
                let body = Vec::new();
                cases.push(Case { value, body });
                continue;
            }
            let around = mem::replace(&mut self.unreached, !reached);
            let mut resolved = Vec::new();
            self.statement(statement, &mut resolved)?;
            self.unreached = around;
            let left = resolved.iter().any(Statement::leaves);
            // Declarations are visible in later cases.
            if reached || matches!(statement.content, StatementData::Declaration(_)) {
                match cases.last_mut() {
                    Some(case) => case.body.extend(resolved),
                    None => {
                        let place = self.place(statement.span);
                        return Err(unsupported("a statement precedes the first case", place));
                    }
                }
            }
            reached &= !left;
        }
        self.switches -= 1;
        self.stage.constants = constants;
        self.scopes.pop();
        Ok(S::Switch { selector, cases })
    }

    /// The value of a label. `None` for `default`.
    fn case(&mut self, label: &ast::CaseLabel) -> Result<Option<i64>, Error> {
        match &label.content {
            CaseLabelData::Def => Ok(None),
            CaseLabelData::Case(e) => self.stage.fixed_integer(e).map(Some).ok_or_else(|| {
                unsupported("a case must be an integer constant", self.place(e.span))
            }),
        }
    }

    /// An expression statement. Comma operators become separate statements.
    fn alone(
        &mut self,
        e: &Expr,
        place: Option<Span>,
        out: &mut Vec<Statement>,
    ) -> Result<(), Error> {
        let kind = match &e.content {
            ExprData::Comma(a, b) => {
                self.alone(a, place, out)?;
                return self.alone(b, place, out);
            }
            // Keywords of extensions that the grammar parses as variables.
            ExprData::Variable(name)
                if matches!(name.as_str(), "demote" | "terminateInvocation")
                    && self.lookup(name.as_str()).is_none() =>
            {
                if name.as_str() == "demote" {
                    self.stage.demotes.set(true);
                }
                S::Discard
            }
            ExprData::FunCall(name, arguments)
                if name
                    .as_ident()
                    .is_some_and(|n| n.as_str() == "debugPrintfEXT") =>
            {
                for argument in arguments {
                    if self.writes(argument) {
                        self.alone(argument, place, out)?;
                    }
                }
                return Ok(());
            }
            ExprData::FunCall(name, arguments) => {
                let name = name.as_ident().map_or("", |n| n.as_str());
                match (operations::image_atomic(name), arguments.as_slice()) {
                    (Some(of), [image, at @ .., value]) => {
                        let place = self.place(e.span);
                        S::Evaluate(self.image_atomic((name, of), (image, at, value), place)?)
                    }
                    _ => S::Evaluate(self.expr(e)?.node),
                }
            }
            _ => S::Evaluate(self.expr(e)?.node),
        };
        out.push(Statement::new(kind).at(place));
        Ok(())
    }

    /// Resolves a condition, which must be a bool.
    fn asked(&mut self, e: &Expr) -> Result<Ex, Error> {
        let ex = self.expr(e)?;
        self.check_condition(&ex, self.place(e.span))?;
        Ok(ex)
    }

    /// An expression that may have no value.
    fn effect(&mut self, e: &Expr) -> Result<Node, Error> {
        match &e.content {
            ExprData::Comma(a, b) => Ok(Node::after(vec![self.effect(a)?], self.effect(b)?)),
            _ => Ok(self.expr(e)?.node),
        }
    }

    /// The statements of a block in a new scope. Unreachable statements are checked and dropped.
    pub(super) fn block_of(
        &mut self,
        statements: &[AstStatement],
    ) -> Result<Vec<Statement>, Error> {
        self.scopes.push(Default::default());
        let constants = self.stage.constants.clone();
        let out = self.statements_of(statements)?;
        self.stage.constants = constants;
        self.scopes.pop();
        Ok(out)
    }

    /// The statements of a block in the current scope.
    pub(super) fn statements_of(
        &mut self,
        statements: &[AstStatement],
    ) -> Result<Vec<Statement>, Error> {
        let mut out = Vec::new();
        let mut reached = true;
        for statement in statements {
            let mut resolved = Vec::new();
            self.statement(statement, &mut resolved)?;
            let size = resolved.iter().map(Statement::size);
            self.written = size.fold(self.written, usize::saturating_add);
            if self.written > super::NODES {
                let message = "the expanded statements exceed four million operations";
                return Err(Error::new(Code::TooDeep, message).label_if(self.place(statement.span)));
            }
            let left = resolved.iter().any(Statement::leaves);
            if reached {
                out.append(&mut resolved);
            }
            reached &= !left;
        }
        Ok(out)
    }

    /// The body of a loop, in the scope of its head (GLSL 4.60, 6.3).
    fn looped(&mut self, statement: &AstStatement) -> Result<Vec<Statement>, Error> {
        self.loops += 1;
        let body = match &statement.content {
            StatementData::Compound(c) => self.statements_of(&c.statement_list),
            _ => self.statements_of(std::slice::from_ref(statement)),
        };
        self.loops -= 1;
        body
    }

    /// The body of a loop without a head.
    fn scoped(&mut self, statement: &AstStatement) -> Result<Vec<Statement>, Error> {
        self.scopes.push(Default::default());
        let constants = self.stage.constants.clone();
        let body = self.looped(statement)?;
        self.stage.constants = constants;
        self.scopes.pop();
        Ok(body)
    }

    /// The body of an `if`.
    fn body(&mut self, statement: &AstStatement) -> Result<Vec<Statement>, Error> {
        match &statement.content {
            StatementData::Compound(c) => self.block_of(&c.statement_list),
            _ => self.block_of(std::slice::from_ref(statement)),
        }
    }

    fn iteration(
        &mut self,
        i: &ast::IterationStatement,
        place: Option<Span>,
        out: &mut Vec<Statement>,
    ) -> Result<(), Error> {
        let kind = match &i.content {
            IterationStatementData::While(condition, body) => {
                self.scopes.push(Default::default());
                let constants = self.stage.constants.clone();
                let condition = self.condition(condition)?;
                let body = self.looped(body)?;
                self.stage.constants = constants;
                self.scopes.pop();
                S::While { condition, body }
            }
            // `continue` also tests the condition.
            IterationStatementData::DoWhile(body, condition) if effect::continues(body) => {
                let condition = self.asked(condition)?.node;
                let first = self.add_local("first", Ty::BOOL);
                let is_first = Node::local(first);
                let init = Statement::new(S::Declare(first, Some(Node::bool(true)))).at(place);
                S::For {
                    init: Some(Box::new(init)),
                    condition: Some(Node::choose(is_first.clone(), Node::bool(true), condition)),
                    step: Some(Node::assign(&is_first, Node::bool(false))),
                    body: self.scoped(body)?,
                }
            }
            IterationStatementData::DoWhile(body, condition) => {
                let condition = self.asked(condition)?.node;
                let body = self.scoped(body)?;
                S::DoWhile { body, condition }
            }
            IterationStatementData::For(init, rest, body) => {
                return self.for_loop(init, rest, body, place, out);
            }
        };
        out.push(Statement::new(kind).at(place));
        Ok(())
    }

    fn for_loop(
        &mut self,
        init: &ast::ForInitStatement,
        rest: &ast::ForRestStatement,
        body: &AstStatement,
        place: Option<Span>,
        out: &mut Vec<Statement>,
    ) -> Result<(), Error> {
        self.scopes.push(Default::default());
        let constants = self.stage.constants.clone();
        // Several declarations come before the loop, in a block.
        let (mut before, mut single) = (Vec::new(), None);
        match &init.content {
            ForInitStatementData::Expression(None) => {}
            ForInitStatementData::Expression(Some(e)) => {
                single = Some(Statement::evaluate(self.effect(e)?).at(place));
            }
            ForInitStatementData::Declaration(d) => {
                let all = self.declared(d)?.into_iter();
                before = all.map(|declared| declared.at(place)).collect();
                if before.len() == 1 {
                    single = before.pop();
                }
            }
        }
        let condition = match &rest.condition {
            Some(condition) => Some(self.condition(condition)?),
            None => None,
        };
        let step = match &rest.post_expr {
            Some(e) => Some(self.effect(e)?),
            None => None,
        };
        let is_block = !before.is_empty();
        let kind = S::For {
            init: single.map(Box::new),
            condition,
            step,
            body: self.looped(body)?,
        };
        before.push(Statement::new(kind).at(place));
        match is_block {
            true => out.push(Statement::new(S::Block(before)).at(place)),
            false => out.append(&mut before),
        }
        self.stage.constants = constants;
        self.scopes.pop();
        Ok(())
    }

    fn condition(&mut self, condition: &ast::Condition) -> Result<Node, Error> {
        match &condition.content {
            ConditionData::Expr(e) => Ok(self.asked(e)?.node),
            // Declared among the temporaries, and assigned in each iteration.
            ConditionData::Assignment(of, name, init) => {
                let place = self.place(condition.span);
                let mut ty = self.stage.ty(&of.ty, None, place)?;
                let value = self.initial(init, &mut ty)?;
                let held = Ex::new(self.needed(&ty, place)?, ty.clone());
                self.check_condition(&held, place)?;
                constant::declare(&mut self.stage.constants, name.as_str(), &ty, None, None);
                self.bind(name.as_str(), Var::plain(held.node.clone(), ty));
                let assigned = Node::assign(&held.node, value);
                Ok(Node::after(vec![assigned], held.node).at(place))
            }
        }
    }

    /// Local variables, one declaration each.
    pub(super) fn declared(
        &mut self,
        declaration: &ast::Declaration,
    ) -> Result<Vec<Statement>, Error> {
        let place = self.place(declaration.span);
        let list = match &declaration.content {
            DeclarationData::InitDeclaratorList(list) => list,
            DeclarationData::Precision(..)
            | DeclarationData::FunctionPrototype(_)
            | DeclarationData::Invariant(_) => return Ok(Vec::new()),
            _ => {
                return Err(unsupported(
                    "this declaration cannot be in a function",
                    place,
                ));
            }
        };
        let head = &list.head;
        let qualifiers = self.stage.qualifiers(head.ty.qualifier.as_ref())?;
        let constant = qualifiers.storage == Some(Storage::Const);
        let base = self.stage.ty(&head.ty.ty, None, place)?;
        let mut out = Vec::new();
        if let Some(name) = &head.name {
            let ty = self
                .stage
                .dimensions(base.clone(), head.array_specifier.as_ref(), place)?;
            let init = head.initializer.as_ref();
            out.push(self.local(name.as_str(), ty, init, constant, place)?);
        }
        for other in &list.tail {
            let ty = self
                .stage
                .dimensions(base.clone(), other.ident.array_spec.as_ref(), place)?;
            out.push(self.local(
                other.ident.ident.as_str(),
                ty,
                other.initializer.as_ref(),
                constant,
                place,
            )?);
        }
        Ok(out)
    }

    fn local(
        &mut self,
        author: &str,
        mut ty: Ty,
        init: Option<&ast::Initializer>,
        constant: bool,
        place: Option<Span>,
    ) -> Result<Statement, Error> {
        if let (Ty::Array(of, None), Some(init)) = (&ty, init) {
            ty = Ty::Array(of.clone(), crate::stage::initial_length(init));
        }
        if constant && init.is_none() {
            let message = format!("the constant `{author}` has no value");
            return Err(wrong(message, place));
        }
        // Unreachable initialisers never run. Constants still need theirs.
        let given = init.filter(|_| constant || !self.unreached);
        let value = match given {
            Some(init) => Some(self.initial(init, &mut ty)?),
            None => None,
        };
        let known = init.filter(|_| constant).and_then(simple);
        constant::declare(&mut self.stage.constants, author, &ty, known, None);
        let fixed = constant.then_some("a constant");
        if self.scopes.last().is_some_and(|s| s.contains_key(author)) {
            let message = format!("`{author}` is declared twice");
            return Err(wrong(message, place));
        }
        let local = self.add_local(author, ty.clone());
        self.bind(author, Var::plain(Node::local(local), ty).fixed(fixed));
        Ok(Statement::new(S::Declare(local, value)))
    }
}
