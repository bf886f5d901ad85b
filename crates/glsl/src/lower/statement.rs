//! Statements, one per line.

use glsl_lang::ast::{
    self, CaseLabelData, ConditionData, DeclarationData, Expr, ExprData, ForInitStatementData,
    IterationStatementData, JumpStatementData, SelectionRestStatementData, Statement,
    StatementData,
};

use super::super::source_marks::unmarked;
use super::super::stage::{Storage, simple, unsupported};
use super::super::ty::Ty;
use super::super::{constant, placeholders};
use super::expression::{Ex, level};
use super::{Lower, Var, effect};
use preshade_text::error::{Code, Error};

impl Lower<'_, '_> {
    pub(super) fn statement(&mut self, statement: &Statement) -> Result<String, Error> {
        let mark = self.mark(statement.span);
        Ok(match &statement.content {
            StatementData::Declaration(d) => {
                let mut out = String::new();
                for declared in self.declared(d)? {
                    out += &self.line(&format!("{mark}{declared};"));
                }
                out
            }
            StatementData::Expression(e) => match &e.content.0 {
                Some(e) => self.alone(e, &mark)?,
                None => String::new(),
            },
            StatementData::Compound(c) => {
                let body = self.block_of(&c.statement_list)?;
                self.line("{") + &body + &self.line("}")
            }
            StatementData::Selection(s) => {
                let condition = self.asked(&s.cond)?.text;
                let (then, other) = match &s.rest.content {
                    SelectionRestStatementData::Statement(then) => (then, None),
                    SelectionRestStatementData::Else(then, other) => (then, Some(other)),
                };
                let mut out = self.line(&format!("{mark}if ({condition}) {{"));
                out += &self.body(then)?;
                if let Some(other) = other {
                    out += &self.line("} else {");
                    out += &self.body(other)?;
                }
                out + &self.line("}")
            }
            StatementData::Switch(s) => {
                let head = self.expr(&s.head)?;
                let unsigned = head.ty == Ty::UINT;
                let mut out = self.line(&format!("{mark}switch ({}) {{", head.text));
                self.scopes.push(Default::default());
                let constants = self.stage.constants.clone();
                let around_switch = self.switch_scope.replace(self.scopes.len());
                self.indent += 1;
                let mut reached = true;
                for statement in &s.body {
                    let inside = !matches!(statement.content, StatementData::CaseLabel(_));
                    reached |= !inside;
                    self.indent += usize::from(inside);
                    let around = std::mem::replace(&mut self.unreached, !reached);
                    let text = self.case(statement, unsigned)?;
                    self.unreached = around;
                    // Declarations are visible in later cases.
                    if reached || matches!(statement.content, StatementData::Declaration(_)) {
                        out += &text;
                    }
                    self.indent -= usize::from(inside);
                    reached &= !leaves(statement);
                }
                self.indent -= 1;
                self.switch_scope = around_switch;
                self.stage.constants = constants;
                self.scopes.pop();
                out + &self.line("}")
            }
            StatementData::CaseLabel(_) => self.case(statement, false)?,
            StatementData::Iteration(i) => self.iteration(i, &mark)?,
            StatementData::Jump(j) => match &j.content {
                JumpStatementData::Continue => self.line(&format!("{mark}continue;")),
                JumpStatementData::Break => self.line(&format!("{mark}break;")),
                JumpStatementData::Discard => self.line(&format!("{mark}discard;")),
                JumpStatementData::Return(Some(e)) => {
                    let ex = self.expr(e)?;
                    let result = self.result.clone();
                    if result == Ty::Void {
                        return Err(Error::new(Code::Parse, "this function returns nothing")
                            .label_if(self.place(e.span)));
                    }
                    self.check_given(&ex.ty, &result, self.place(e.span))?;
                    let text = self.coerce(ex, &result).text;
                    self.line(&format!("{mark}return {text};"))
                }
                JumpStatementData::Return(None) => {
                    let mut out = String::new();
                    if self.in_main {
                        for last in self.epilogue.clone() {
                            out += &self.line(&last);
                        }
                    }
                    out + &self.line(&format!("{mark}return;"))
                }
            },
        })
    }

    /// An expression statement. Comma operators become separate statements.
    fn alone(&mut self, e: &Expr, mark: &str) -> Result<String, Error> {
        match &e.content {
            ExprData::Comma(a, b) => Ok(self.alone(a, mark)? + &self.alone(b, mark)?),
            // Keywords of extensions, which the grammar reads as variables.
            ExprData::Variable(name)
                if matches!(name.as_str(), "demote" | "terminateInvocation")
                    && self.lookup(name.as_str()).is_none() =>
            {
                if name.as_str() == "demote" {
                    self.stage.demotes.set(true);
                }
                Ok(self.line(&format!("{mark}discard;")))
            }
            ExprData::FunCall(name, arguments)
                if name
                    .as_ident()
                    .is_some_and(|n| n.as_str() == "debugPrintfEXT") =>
            {
                let mut out = String::new();
                for argument in arguments {
                    if self.writes(argument) {
                        out += &self.alone(argument, mark)?;
                    }
                }
                Ok(out)
            }
            ExprData::FunCall(name, arguments) => {
                let name = name.as_ident().map_or("", |n| n.as_str());
                let text = match (placeholders::image_atomic(name), arguments.as_slice()) {
                    (Some(of), [image, at @ .., value]) => {
                        self.image_atomic((name, of), (image, at, value), self.place(e.span))?
                    }
                    _ => self.expr(e)?.text,
                };
                Ok(self.line(&format!("{mark}{text};")))
            }
            _ => {
                let text = self.expr(e)?.text;
                Ok(self.line(&format!("{mark}{text};")))
            }
        }
    }

    /// A condition.
    fn asked(&mut self, e: &Expr) -> Result<Ex, Error> {
        let ex = self.expr(e)?;
        self.check_condition(&ex, self.place(e.span))?;
        Ok(ex)
    }

    /// Whether it prints as a single expression. Calls without a result may become several
    /// statements.
    fn is_expression(&mut self, e: &Expr) -> Result<bool, Error> {
        Ok(match &e.content {
            ExprData::Comma(a, b) => self.is_expression(a)? && self.is_expression(b)?,
            ExprData::FunCall(..) => self.look(e)?.ty != Ty::Void,
            _ => true,
        })
    }

    fn case(&mut self, statement: &Statement, unsigned: bool) -> Result<String, Error> {
        let StatementData::CaseLabel(label) = &statement.content else {
            return self.statement(statement);
        };
        match &label.content {
            CaseLabelData::Def => Ok(self.line("default:")),
            CaseLabelData::Case(e) => {
                let value = self.stage.fixed_integer(e).ok_or_else(|| {
                    unsupported("a case must be an integer constant", self.place(e.span))
                })?;
                let value = match value {
                    // naga reads the sign apart.
                    _ if unsigned => format!("{value}u"),
                    -2_147_483_648 => "-2147483647 - 1".to_owned(),
                    _ => value.to_string(),
                };
                Ok(self.line(&format!("case {value}:")))
            }
        }
    }

    /// The statements of a block in a new scope. Unreachable statements are checked and dropped:
    /// naga drops them but keeps their calls as values, which makes the module invalid.
    pub(super) fn block_of(&mut self, statements: &[Statement]) -> Result<String, Error> {
        self.scopes.push(Default::default());
        let constants = self.stage.constants.clone();
        self.indent += 1;
        let mut out = String::new();
        let mut reached = true;
        for statement in statements {
            let text = self.statement(statement)?;
            self.written += text.len();
            if self.written > super::WRITTEN {
                let message = "the expanded statements exceed 64 MiB";
                return Err(Error::new(Code::TooDeep, message).label_if(self.place(statement.span)));
            }
            if reached {
                out += &text;
            }
            reached &= !leaves(statement);
        }
        self.indent -= 1;
        self.stage.constants = constants;
        self.scopes.pop();
        Ok(out)
    }

    /// The body of an `if` or a loop.
    fn body(&mut self, statement: &Statement) -> Result<String, Error> {
        match &statement.content {
            StatementData::Compound(c) => self.block_of(&c.statement_list),
            _ => self.block_of(std::slice::from_ref(statement)),
        }
    }

    fn iteration(&mut self, i: &ast::IterationStatement, mark: &str) -> Result<String, Error> {
        Ok(match &i.content {
            IterationStatementData::While(condition, body) => {
                self.scopes.push(Default::default());
                let constants = self.stage.constants.clone();
                let condition = self.condition(condition)?;
                let out = self.line(&format!("{mark}while ({condition}) {{"))
                    + &self.body(body)?
                    + &self.line("}");
                self.stage.constants = constants;
                self.scopes.pop();
                out
            }
            // naga tests the condition at the end of the body, which `continue` skips.
            IterationStatementData::DoWhile(body, condition) if effect::continues(body) => {
                let condition = self.asked(condition)?;
                let first = self.fresh("first");
                let condition = condition.at(level::TERNARY + 1);
                self.line(&format!(
                    "{mark}for (bool {first} = true; ({first} ? true : {condition}); \
                     {first} = false) {{"
                )) + &self.body(body)?
                    + &self.line("}")
            }
            IterationStatementData::DoWhile(body, condition) => {
                let condition = self.asked(condition)?.text;
                self.line(&format!("{mark}do {{"))
                    + &self.body(body)?
                    + &self.line(&format!("}} while ({condition});"))
            }
            IterationStatementData::For(init, rest, body) => {
                self.scopes.push(Default::default());
                let constants = self.stage.constants.clone();
                let mut lead = String::new();
                // naga only accepts one variable here. Print several before the loop, in a block.
                let (before, init) = match &init.content {
                    ForInitStatementData::Expression(None) => (Vec::new(), String::new()),
                    ForInitStatementData::Expression(Some(e)) if !self.is_expression(e)? => {
                        lead = self.alone(e, mark)?;
                        (Vec::new(), String::new())
                    }
                    ForInitStatementData::Expression(Some(e)) => (Vec::new(), self.expr(e)?.text),
                    ForInitStatementData::Declaration(d) => {
                        let mut all = self.declared(d)?;
                        match all.len() {
                            1 => (Vec::new(), all.remove(0)),
                            _ => (all, String::new()),
                        }
                    }
                };
                let condition = match &rest.condition {
                    Some(condition) => self.condition(condition)?,
                    None => String::new(),
                };
                let mut step = None;
                let post = match &rest.post_expr {
                    Some(e) if !self.is_expression(e)? => {
                        step = Some(e);
                        String::new()
                    }
                    Some(e) => self.expr(e)?.text,
                    None => String::new(),
                };
                let mut out = lead;
                if !before.is_empty() {
                    out += &self.line("{");
                    self.indent += 1;
                    for each in &before {
                        out += &self.line(&format!("{mark}{each};"));
                    }
                }
                match step {
                    // These statements precede the body from the second iteration on.
                    Some(e) => {
                        let first = self.fresh("first");
                        out += &self.line("{");
                        out += &self.line(&format!("bool {first} = true;"));
                        if !init.is_empty() {
                            out += &self.line(&format!("{mark}{init};"));
                        }
                        out += &self.line("while (true) {");
                        out += &self.line(&format!("if ({first}) {{ {first} = false; }} else {{"));
                        out += &self.alone(e, mark)?;
                        out += &self.line("}");
                        if !condition.is_empty() {
                            out += &self.line(&format!("if (!({condition})) {{ break; }}"));
                        }
                        out += &self.body(body)?;
                        out += &self.line("}");
                        out += &self.line("}");
                    }
                    None => {
                        out += &self.line(&format!("{mark}for ({init}; {condition}; {post}) {{"));
                        out += &self.body(body)?;
                        out += &self.line("}");
                    }
                }
                if !before.is_empty() {
                    self.indent -= 1;
                    out += &self.line("}");
                }
                self.stage.constants = constants;
                self.scopes.pop();
                out
            }
        })
    }

    fn condition(&mut self, condition: &ast::Condition) -> Result<String, Error> {
        match &condition.content {
            ConditionData::Expr(e) => {
                let text = self.asked(e)?.text;
                // naga parses anything that begins with a type as a declaration.
                let bare = unmarked(&text);
                let word = bare
                    .split(|c: char| !c.is_alphanumeric())
                    .next()
                    .unwrap_or("");
                Ok(match Ty::named(word) {
                    Ty::Opaque(_) => text,
                    _ => format!("({text})"),
                })
            }
            // Declared with the temporaries, and assigned each time.
            ConditionData::Assignment(of, name, init) => {
                let place = self.place(condition.span);
                let ty = self.stage.ty(&of.ty, None, place)?;
                let value = self.initial(init, &ty)?;
                let held = Ex::primary(self.needed(&ty, place)?, ty.clone());
                self.check_condition(&held, place)?;
                constant::declare(&mut self.stage.constants, name.as_str(), &ty, None, None);
                self.bind(name.as_str(), Var::plain(held.text.clone(), ty));
                Ok(format!("({} = {value}, {})", held.text, held.text))
            }
        }
    }

    /// Local variables, one declaration each.
    pub(super) fn declared(
        &mut self,
        declaration: &ast::Declaration,
    ) -> Result<Vec<String>, Error> {
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
        place: Option<naga::Span>,
    ) -> Result<String, Error> {
        if let (Ty::Array(of, None), Some(init)) = (&ty, init) {
            ty = Ty::Array(of.clone(), super::super::stage::initial_length(init));
        }
        if constant && init.is_none() {
            let message = format!("the constant `{author}` has no value");
            return Err(Error::new(Code::Parse, message).label_if(place));
        }
        // Unreachable initialisers never run; constants need theirs.
        let given = init.filter(|_| constant || !self.unreached);
        let value = match given {
            Some(init) => Some(self.initial(init, &ty)?),
            None => None,
        };
        let known = init.filter(|_| constant).and_then(simple);
        constant::declare(&mut self.stage.constants, author, &ty, known, None);
        let is_of_switch = self.switch_scope == Some(self.scopes.len());
        let name = match is_of_switch || self.in_main && self.last_read.contains(author) {
            true => self.fresh(author),
            false => self.safe(author),
        };
        let declared = ty.declare(&name);
        let fixed = constant.then_some("a constant");
        if self.scopes.last().is_some_and(|s| s.contains_key(author)) {
            let message = format!("`{author}` is declared twice");
            return Err(Error::new(Code::Parse, message).label_if(place));
        }
        self.bind(author, Var::plain(name, ty).fixed(fixed));
        Ok(match value {
            Some(value) => format!("{declared} = {value}"),
            None => declared,
        })
    }
}

/// Whether the statements after it are unreachable.
fn leaves(statement: &Statement) -> bool {
    match &statement.content {
        StatementData::Jump(_) => true,
        StatementData::Compound(c) => c.statement_list.iter().any(leaves),
        _ => false,
    }
}
