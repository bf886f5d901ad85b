//! Converts statements, and arrays that are constructed or copied whole.

use glsl_lang::ast::{
    self, AssignmentOpData, BinaryOpData, ConditionData, DeclarationData, ExprData,
    FunIdentifierData, InitializerData, IterationStatementData, JumpStatementData,
    SelectionRestStatementData, StatementData,
};

use super::loop_bounds::{self, Entered};
use super::{Es100, Result, lacks, types};

impl Es100 {
    /// Converts a list of statements. `loop_bounds` analyses the whole list for loop counters.
    pub(super) fn statements(&mut self, list: Vec<ast::Statement>) -> Result<Vec<ast::Statement>> {
        let known = loop_bounds::VariableUses::of(&list, &self.functions, &self.constants);
        self.indices.clear();
        self.block(list, &known)
    }

    fn block(
        &mut self,
        list: Vec<ast::Statement>,
        known: &loop_bounds::VariableUses,
    ) -> Result<Vec<ast::Statement>> {
        let mut out = Vec::with_capacity(list.len());
        for statement in list {
            self.statement(statement, known, &mut out)?;
        }
        Ok(out)
    }

    fn one(
        &mut self,
        statement: ast::Statement,
        known: &loop_bounds::VariableUses,
    ) -> Result<ast::Statement> {
        let mut list = self.block(vec![statement], known)?;
        Ok(match (list.pop(), list.is_empty()) {
            (Some(one), true) => one,
            (last, _) => {
                list.extend(last);
                compound(list)
            }
        })
    }

    fn statement(
        &mut self,
        mut statement: ast::Statement,
        known: &loop_bounds::VariableUses,
        out: &mut Vec<ast::Statement>,
    ) -> Result<()> {
        match &mut *statement {
            StatementData::Declaration(declaration) => match &mut **declaration {
                DeclarationData::InitDeclaratorList(list) if list.tail.is_empty() => {
                    self.note_index(&list.head, known);
                    let more = self.local(&mut list.head)?;
                    out.push(statement);
                    out.extend(more);
                    return Ok(());
                }
                _ => return lacks("a declaration of several variables"),
            },
            StatementData::Expression(expression) => {
                if let Some(expression) = &mut expression.0 {
                    if let Some(elements) = self.copied(expression)? {
                        out.extend(elements);
                        return Ok(());
                    }
                    self.expression(expression)?;
                }
            }
            StatementData::Selection(selection) => {
                self.expression(&mut selection.cond)?;
                let take =
                    |s: &mut Box<ast::Statement>| std::mem::replace(&mut **s, compound(Vec::new()));
                match &mut *selection.rest {
                    SelectionRestStatementData::Statement(accept) => {
                        **accept = self.one(take(accept), known)?;
                    }
                    SelectionRestStatementData::Else(accept, reject) => {
                        **accept = self.one(take(accept), known)?;
                        **reject = self.one(take(reject), known)?;
                    }
                }
            }
            StatementData::Iteration(iteration) => {
                let body = match &mut **iteration {
                    IterationStatementData::While(condition, body)
                        if matches!(&**condition, ConditionData::Expr(e)
                            if matches!(**e, ExprData::BoolConst(true))) =>
                    {
                        std::mem::replace(&mut **body, compound(Vec::new()))
                    }
                    _ => return lacks("a loop other than a plain `while`"),
                };
                out.push(self.turned(body, known, out)?);
                return Ok(());
            }
            StatementData::Compound(inner) => {
                let list = std::mem::take(&mut inner.statement_list);
                inner.statement_list = self.block(list, known)?;
            }
            StatementData::Jump(jump) => {
                if let JumpStatementData::Return(Some(value)) = &mut **jump {
                    self.expression(value)?;
                }
            }
            StatementData::Switch(_) | StatementData::CaseLabel(_) => return lacks("`switch`"),
        }
        out.push(statement);
        Ok(())
    }

    /// Converts a `while (true)` after the statements `ahead` to a `for`.
    fn turned(
        &mut self,
        mut body: ast::Statement,
        known: &loop_bounds::VariableUses,
        ahead: &[ast::Statement],
    ) -> Result<ast::Statement> {
        let Some(counted) = known.loop_of(&body, ahead, self.entered) else {
            return lacks("a loop without a constant bound on its iterations");
        };
        self.loops += 1;
        let mut turn = format!("turn_{}", self.loops);
        while self.names.contains(&turn) {
            turn.push('_');
        }
        let list = match &mut *body {
            StatementData::Compound(inner) => std::mem::take(&mut inner.statement_list),
            _ => Vec::new(),
        };
        let outside = (self.indices.clone(), self.entered);
        self.entered = Entered::Often;
        let mut inner = Vec::with_capacity(list.len());
        for (i, statement) in list.into_iter().enumerate() {
            self.statement(statement, known, &mut inner)?;
            if i == 0 {
                self.indices.extend(counted.index(&turn));
            }
        }
        (self.indices, self.entered) = outside;
        Ok(loop_bounds::bounded(&turn, counted.turns, compound(inner)))
    }

    /// Records whether a temporary only uses constants and loop counters.
    fn note_index(&mut self, head: &ast::SingleDeclaration, known: &loop_bounds::VariableUses) {
        let Some(name) = &head.name else { return };
        let index = match head.initializer.as_deref() {
            Some(InitializerData::Simple(value)) if known.is_temporary(name.as_str()) => {
                self.index(value)
            }
            _ => None,
        };
        match index {
            Some(index) => self.indices.insert(name.as_str().to_owned(), index),
            None => self.indices.remove(name.as_str()),
        };
    }

    /// The expression in terms of constants and loop variables; `None` if that is impossible.
    pub(super) fn index(&self, e: &ast::Expr) -> Option<ast::Expr> {
        match &**e {
            ExprData::IntConst(_) => Some(e.clone()),
            ExprData::Variable(name) => match self.indices.get(name.as_str()) {
                Some(index) => Some(index.clone()),
                None => self
                    .constants
                    .contains_key(name.as_str())
                    .then(|| e.clone()),
            },
            ExprData::Binary(op, a, b)
                if matches!(
                    **op,
                    BinaryOpData::Add | BinaryOpData::Sub | BinaryOpData::Mult
                ) =>
            {
                let (a, b) = (Box::new(self.index(a)?), Box::new(self.index(b)?));
                Some(ExprData::Binary(op.clone(), a, b).into())
            }
            _ => None,
        }
    }

    /// Converts a local variable. Returns the statements that set its elements.
    fn local(&mut self, head: &mut ast::SingleDeclaration) -> Result<Vec<ast::Statement>> {
        let name = head.name.as_ref().map(|n| n.as_str().to_owned());
        let name = name.unwrap_or_default();
        // Convert its initialiser before declaring it: the variable may hide a name in it.
        let elements = match (&head.initializer, &head.array_specifier) {
            (Some(initial), Some(array)) => {
                let length = types::length(Some(array))?.unwrap_or_default();
                let elements = match &**initial {
                    InitializerData::Simple(e) => self.elements(e, length)?,
                    InitializerData::List(_) => return lacks("a list of initial values"),
                };
                head.initializer = None;
                elements
            }
            (Some(_), None) => {
                if let ast::TypeSpecifierNonArrayData::TypeName(of) = &*head.ty.ty.ty
                    && self.holds_arrays.contains(of.as_str())
                {
                    return lacks("a constructor of a struct with an array");
                }
                if let Some(initial) = &mut head.initializer {
                    self.initializer(initial, &name)?;
                }
                Vec::new()
            }
            (None, _) => Vec::new(),
        };
        let head: &mut ast::SingleDeclarationData = head;
        self.declare(&mut head.ty, &name, head.array_specifier.as_ref())?;
        Ok(assigned(&name, elements))
    }

    pub(super) fn initializer(&mut self, initial: &mut ast::Initializer, name: &str) -> Result<()> {
        match &mut **initial {
            InitializerData::Simple(e) => self.expression(e),
            InitializerData::List(_) => lacks(format!("the list of initial values of `{name}`")),
        }
    }

    /// Converts a whole-array assignment to assignments of its elements.
    fn copied(&mut self, expression: &ast::Expr) -> Result<Option<Vec<ast::Statement>>> {
        let ExprData::Assignment(to, op, from) = &**expression else {
            return Ok(None);
        };
        let ExprData::Variable(to) = &***to else {
            return Ok(None);
        };
        let Some(length) = self.arrays.get(to.as_str()).copied() else {
            return Ok(None);
        };
        if **op != AssignmentOpData::Equal {
            return lacks("an operation on an array");
        }
        let elements = self.elements(from, length)?;
        Ok(Some(assigned(to.as_str(), elements)))
    }

    /// The elements of an array constructor or variable.
    fn elements(&mut self, of: &ast::Expr, length: i32) -> Result<Vec<ast::Expr>> {
        match &**of {
            ExprData::FunCall(function, arguments) if matches!(&**function, FunIdentifierData::TypeSpecifier(ty) if ty.array_specifier.is_some()) =>
            {
                let mut elements = arguments.clone();
                for element in &mut elements {
                    self.expression(element)?;
                }
                Ok(elements)
            }
            ExprData::Variable(from) if self.arrays.contains_key(from.as_str()) => {
                let element = |i| element(from.as_str(), i).into();
                Ok((0..length).map(element).collect())
            }
            _ => lacks("an array that is neither a variable nor a constructor"),
        }
    }
}

fn element(name: &str, i: i32) -> ExprData {
    let array = Box::new(ExprData::variable(name).into());
    ExprData::Bracket(array, Box::new(ExprData::IntConst(i).into()))
}

fn assigned(name: &str, elements: Vec<ast::Expr>) -> Vec<ast::Statement> {
    let assign = |(i, value): (usize, ast::Expr)| {
        let to = Box::new(element(name, i as i32).into());
        let assign = ExprData::Assignment(to, AssignmentOpData::Equal.into(), Box::new(value));
        let statement = ast::ExprStatementData(Some(assign.into()));
        StatementData::Expression(statement.into()).into()
    };
    elements.into_iter().enumerate().map(assign).collect()
}

pub(super) fn compound(statement_list: Vec<ast::Statement>) -> ast::Statement {
    StatementData::Compound(ast::CompoundStatementData { statement_list }.into()).into()
}
