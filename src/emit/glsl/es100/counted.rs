//! How often a loop turns at most. GLSL ES 1.00 has `for` with a constant bound (appendix A.4); naga writes
//!
//! ```glsl
//! bool loop_init = true;
//! while (true) {
//!     if (!loop_init) { int _e9 = i; i = (_e9 + 1); }
//!     loop_init = false;
//!     int _e4 = i;
//!     if (!((_e4 < 3))) { break; }
//!     ..
//! }
//! ```
//!
//! A counter that is nowhere set but to constants and grows by a constant each turn turns the loop no more often than from the least of those constants. The
//! loop keeps its own `break`: the bound is never what ends it.

use std::collections::{HashMap, HashSet};

use glsl_lang::ast::{
    self, BinaryOpData, ConditionData, DeclarationData, ExprData, ForInitStatementData,
    InitializerData, IterationStatementData, JumpStatementData, SelectionRestStatementData,
    StatementData, UnaryOpData,
};

use super::statement::compound;

/// Most turns that are written.
const MOST: i64 = 65_536;

/// What a function does with its variables, by their names.
#[derive(Default)]
pub(super) struct Known {
    /// What each temporary stands for, if it is never assigned.
    temporaries: HashMap<String, ast::Expr>,
    /// What each variable is set to.
    set: HashMap<String, Vec<ast::Expr>>,
    /// Variables that a function may write.
    handed: HashSet<String>,
}

impl Known {
    pub(super) fn of(list: &[ast::Statement], functions: &HashMap<String, HashSet<usize>>) -> Self {
        let mut known = Self::default();
        for statement in list {
            known.statement(statement, functions);
        }
        known
    }

    /// A bound of the turns of a `while (true)` with this body.
    pub(super) fn turns(&self, body: &ast::Statement) -> Option<i64> {
        let list = match &**body {
            StatementData::Compound(inner) => inner.statement_list.as_slice(),
            _ => return None,
        };
        // The first thing that may leave, on the way of every turn.
        let (counter, end) = list.iter().find_map(|s| self.leaves(s))?;
        if self.handed.contains(&counter) {
            return None;
        }
        let inside = Self::of(list, &HashMap::new());
        let own = inside.set.get(&counter)?;
        let step = self.step(&counter, own.as_slice())?;
        // Every turn but the first takes the step, ahead of the test, where no `continue` passes it over.
        let mut ahead = list.iter().take_while(|s| self.leaves(s).is_none());
        if !ahead.any(|s| steps(s, &counter)) {
            return None;
        }
        let mut least = i64::MAX;
        for value in self.set.get(&counter)? {
            match &**value {
                ExprData::IntConst(n) => least = least.min(i64::from(*n)),
                _ if own.contains(value) => {}
                _ => return None,
            }
        }
        if least == i64::MAX {
            return None;
        }
        let turns = (end - least).max(0) / step + 2;
        (turns <= MOST).then_some(turns)
    }

    /// Of `if (!(counter < end)) break;` the counter, and the first number at which it leaves.
    fn leaves(&self, statement: &ast::Statement) -> Option<(String, i64)> {
        let StatementData::Selection(selection) = &**statement else {
            return None;
        };
        let accept = match &*selection.rest {
            SelectionRestStatementData::Statement(accept)
            | SelectionRestStatementData::Else(accept, _) => accept,
        };
        let is_break = |s: &ast::Statement| matches!(&**s, StatementData::Jump(j) if matches!(**j, JumpStatementData::Break));
        let breaks = match &***accept {
            StatementData::Compound(inner) => inner.statement_list.last().is_some_and(is_break),
            _ => is_break(accept),
        };
        let ExprData::Unary(op, condition) = &**selection.cond else {
            return None;
        };
        if !breaks || **op != UnaryOpData::Not {
            return None;
        }
        let ExprData::Binary(op, left, right) = &**self.resolved(condition) else {
            return None;
        };
        let ExprData::Variable(counter) = &**self.resolved(left) else {
            return None;
        };
        let n = self.number(right)?;
        let end = match **op {
            BinaryOpData::Lt => i64::from(n),
            BinaryOpData::Lte => i64::from(n) + 1,
            _ => return None,
        };
        Some((counter.as_str().to_owned(), end))
    }

    /// The one step that a loop takes.
    fn step(&self, counter: &str, sets: &[ast::Expr]) -> Option<i64> {
        let [one] = sets else {
            return None;
        };
        let ExprData::Binary(op, left, right) = &**one else {
            return None;
        };
        let is_counter =
            matches!(&**self.resolved(left), ExprData::Variable(n) if n.as_str() == counter);
        match **self.resolved(right) {
            ExprData::IntConst(n) if **op == BinaryOpData::Add && is_counter && n > 0 => {
                Some(i64::from(n))
            }
            _ => None,
        }
    }

    /// A constant, or a variable that is never anything else.
    fn number(&self, e: &ast::Expr) -> Option<i32> {
        match &**self.resolved(e) {
            ExprData::IntConst(n) => Some(*n),
            ExprData::Variable(name) if !self.handed.contains(name.as_str()) => {
                match self.set.get(name.as_str())?.as_slice() {
                    [only] if self.temporaries.contains_key(name.as_str()) => match **only {
                        ExprData::IntConst(n) => Some(n),
                        _ => None,
                    },
                    _ => None,
                }
            }
            _ => None,
        }
    }

    /// What a temporary stands for.
    fn resolved<'a>(&'a self, mut e: &'a ast::Expr) -> &'a ast::Expr {
        // Each is made of those before it.
        while let ExprData::Variable(name) = &**e
            && let Some(of) = self.temporaries.get(name.as_str())
            && self.set.get(name.as_str()).is_none_or(|all| all.len() == 1)
            && name.as_str().starts_with("_e")
        {
            e = of;
        }
        e
    }

    fn statement(
        &mut self,
        statement: &ast::Statement,
        functions: &HashMap<String, HashSet<usize>>,
    ) {
        match &**statement {
            StatementData::Declaration(declaration) => self.declaration(declaration, functions),
            StatementData::Expression(e) => {
                if let Some(e) = &e.0 {
                    self.expression(e, functions);
                }
            }
            StatementData::Selection(selection) => {
                self.expression(&selection.cond, functions);
                match &*selection.rest {
                    SelectionRestStatementData::Statement(accept) => {
                        self.statement(accept, functions);
                    }
                    SelectionRestStatementData::Else(accept, reject) => {
                        self.statement(accept, functions);
                        self.statement(reject, functions);
                    }
                }
            }
            StatementData::Switch(switch) => {
                for inner in &switch.body {
                    self.statement(inner, functions);
                }
            }
            StatementData::Iteration(iteration) => match &**iteration {
                IterationStatementData::While(_, body)
                | IterationStatementData::DoWhile(body, _)
                | IterationStatementData::For(_, _, body) => self.statement(body, functions),
            },
            StatementData::Compound(inner) => {
                for inner in &inner.statement_list {
                    self.statement(inner, functions);
                }
            }
            StatementData::Jump(jump) => {
                if let JumpStatementData::Return(Some(e)) = &**jump {
                    self.expression(e, functions);
                }
            }
            StatementData::CaseLabel(_) => {}
        }
    }

    fn declaration(
        &mut self,
        declaration: &ast::Declaration,
        functions: &HashMap<String, HashSet<usize>>,
    ) {
        let DeclarationData::InitDeclaratorList(list) = &**declaration else {
            return;
        };
        let Some(name) = &list.head.name else {
            return;
        };
        if let Some(initial) = &list.head.initializer
            && let InitializerData::Simple(value) = &**initial
        {
            self.expression(value, functions);
            let name = name.as_str().to_owned();
            self.temporaries.insert(name.clone(), (**value).clone());
            self.set.entry(name).or_default().push((**value).clone());
        }
    }

    fn expression(&mut self, e: &ast::Expr, functions: &HashMap<String, HashSet<usize>>) {
        match &**e {
            ExprData::Assignment(to, _, from) => {
                if let ExprData::Variable(name) = &***to {
                    let all = self.set.entry(name.as_str().to_owned()).or_default();
                    all.push((**from).clone());
                }
                self.expression(from, functions);
            }
            ExprData::FunCall(function, arguments) => {
                let name = function.as_ident().map_or("", |n| n.as_str());
                let written = functions.get(name);
                for (i, argument) in arguments.iter().enumerate() {
                    if let ExprData::Variable(of) = &**argument
                        && written.is_some_and(|w| w.contains(&i))
                    {
                        self.handed.insert(of.as_str().to_owned());
                    }
                    self.expression(argument, functions);
                }
            }
            ExprData::Unary(_, a)
            | ExprData::Dot(a, _)
            | ExprData::PostInc(a)
            | ExprData::PostDec(a) => self.expression(a, functions),
            ExprData::Binary(_, a, b) | ExprData::Bracket(a, b) | ExprData::Comma(a, b) => {
                self.expression(a, functions);
                self.expression(b, functions);
            }
            ExprData::Ternary(a, b, c) => {
                for each in [a, b, c] {
                    self.expression(each, functions);
                }
            }
            _ => {}
        }
    }
}

/// Whether a statement is naga's `if (!loop_init) { .. counter = ..; }`.
fn steps(statement: &ast::Statement, counter: &str) -> bool {
    let StatementData::Selection(selection) = &**statement else {
        return false;
    };
    let SelectionRestStatementData::Statement(accept) = &*selection.rest else {
        return false;
    };
    let first = match &**selection.cond {
        ExprData::Unary(op, of) if **op == UnaryOpData::Not => {
            matches!(&***of, ExprData::Variable(n) if n.as_str().starts_with("loop_init"))
        }
        _ => false,
    };
    let StatementData::Compound(inner) = &***accept else {
        return false;
    };
    let sets = |s: &ast::Statement| match &**s {
        StatementData::Expression(e) => {
            matches!(e.0.as_deref(), Some(ExprData::Assignment(to, _, _))
            if matches!(&***to, ExprData::Variable(n) if n.as_str() == counter))
        }
        _ => false,
    };
    first && inner.statement_list.iter().any(sets)
}

/// `for (int name = 0; name < turns; name++) body`.
pub(super) fn bounded(name: &str, turns: i64, body: ast::Statement) -> ast::Statement {
    let variable = || -> ast::Expr { ExprData::variable(name).into() };
    let number = |n: i64| -> ast::Expr { ExprData::IntConst(n as i32).into() };
    let initial: ast::Initializer = InitializerData::Simple(Box::new(number(0))).into();
    let StatementData::Declaration(declaration) = StatementData::declare_var(
        ast::TypeSpecifierNonArrayData::Int,
        name,
        None,
        Some(initial),
    ) else {
        return compound(vec![body]);
    };
    let less = ExprData::Binary(
        BinaryOpData::Lt.into(),
        Box::new(variable()),
        Box::new(number(turns)),
    );
    let rest = ast::ForRestStatementData {
        condition: Some(ConditionData::Expr(less.into()).into()),
        post_expr: Some(Box::new(ExprData::PostInc(Box::new(variable())).into())),
    };
    let init = ForInitStatementData::Declaration(Box::new(declaration));
    let iteration = IterationStatementData::For(init.into(), rest.into(), Box::new(body));
    StatementData::Iteration(iteration.into()).into()
}
