//! Finds the maximum iteration count of a loop. GLSL ES 1.00 only has `for` with a constant bound
//! (appendix A.4), and naga writes
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
//! The counter, an `int` or a `float`, must change by a constant in each iteration, be compared with a
//! constant by any comparison, and be set to constants only, right before the loop or elsewhere. We
//! count the iterations from each of these constants; the most give the bound. The loop keeps
//! its own `break`, so the bound never ends it. Every iteration must reach the test: no `continue`
//! may precede it.
//!
//! An index may only use constants and the variable of the `for` (appendix A.5). If the counter
//! always begins at the same constant, we express it by that variable.

use std::cmp::Ordering;
use std::collections::{HashMap, HashSet};

use glsl_lang::ast::{
    self, AssignmentOpData, BinaryOpData, ConditionData, DeclarationData, ExprData,
    ForInitStatementData, InitializerData, IterationStatementData, JumpStatementData,
    SelectionRestStatementData, StatementData, UnaryOpData,
};

use super::statement::compound;

/// The largest bound that we write.
const MOST: i64 = 65_536;

/// A constant, or the value of a counter.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub(super) enum Number {
    Int(i32),
    Float(f32),
}

impl Number {
    /// A number, or one with a minus sign.
    pub(super) fn of(e: &ast::Expr) -> Option<Self> {
        match &**e {
            ExprData::IntConst(n) => Some(Self::Int(*n)),
            ExprData::FloatConst(x) => Some(Self::Float(*x)),
            ExprData::Unary(op, of) if **op == UnaryOpData::Minus => match Self::of(of)? {
                Self::Int(n) => Some(Self::Int(n.checked_neg()?)),
                Self::Float(x) => Some(Self::Float(-x)),
            },
            _ => None,
        }
    }

    /// The sum, unless it overflows.
    fn plus(self, other: Self) -> Option<Self> {
        match (self, other) {
            (Self::Int(a), Self::Int(b)) => a.checked_add(b).map(Self::Int),
            (Self::Float(a), Self::Float(b)) => Some(Self::Float(a + b)),
            _ => None,
        }
    }

    fn negated(self) -> Option<Self> {
        match self {
            Self::Int(n) => n.checked_neg().map(Self::Int),
            Self::Float(x) => Some(Self::Float(-x)),
        }
    }
}

/// The comparison of a counter with a constant, by which a loop goes on.
#[derive(Clone, Debug)]
struct Test {
    op: BinaryOpData,
    bound: Number,
}

impl Test {
    fn holds(&self, counter: Number) -> bool {
        let order = counter.partial_cmp(&self.bound);
        match self.op {
            BinaryOpData::Lt => order.is_some_and(Ordering::is_lt),
            BinaryOpData::Lte => order.is_some_and(Ordering::is_le),
            BinaryOpData::Gt => order.is_some_and(Ordering::is_gt),
            BinaryOpData::Gte => order.is_some_and(Ordering::is_ge),
            BinaryOpData::Equal => order == Some(Ordering::Equal),
            BinaryOpData::NonEqual => order != Some(Ordering::Equal),
            _ => false,
        }
    }

    /// The iterations from this value on; the last one only leaves the loop.
    fn turns(&self, begins: Number, step: Number) -> Option<i64> {
        let mut counter = begins;
        let mut turns = 1;
        while self.holds(counter) {
            counter = counter.plus(step)?;
            turns += 1;
            if turns > MOST {
                return None;
            }
        }
        match counter {
            Number::Int(_) => Some(turns),
            // An adapter may round its sums differently.
            Number::Float(_) => Some(turns + turns / 8 + 1),
        }
    }
}

/// How a function uses its variables, by name.
#[derive(Default)]
pub(super) struct VariableUses {
    /// Global constants that are numbers.
    constants: HashMap<String, Number>,
    /// The definition of each variable that is never assigned again.
    temporaries: HashMap<String, ast::Expr>,
    /// All assignments of each variable.
    set: HashMap<String, Vec<ast::Expr>>,
    /// Variables that a call may write.
    handed: HashSet<String>,
}

/// How often a loop can start during one call of its function.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Entered {
    /// It is not nested in a loop.
    Once,
    /// It is nested in a loop.
    Often,
}

/// A loop with a bounded iteration count.
pub(super) struct Loop {
    pub(super) turns: i64,
    counter: String,
    /// The counter's first value, if it is an `int` and always the same.
    begins: Option<i32>,
    /// Its change in each iteration.
    step: Number,
}

impl Loop {
    /// The counter as an expression of the loop variable, valid after the first statement of the
    /// body, which increments it.
    pub(super) fn index(&self, turn: &str) -> Option<(String, ast::Expr)> {
        let (begins, Number::Int(step)) = (self.begins?, self.step) else {
            return None;
        };
        let number = |n: i32| -> Box<ast::Expr> { Box::new(ExprData::IntConst(n).into()) };
        let binary = |op: BinaryOpData, a: Box<ast::Expr>, b: Box<ast::Expr>| -> Box<ast::Expr> {
            Box::new(ExprData::Binary(op.into(), a, b).into())
        };
        let mut index: Box<ast::Expr> = Box::new(ExprData::variable(turn).into());
        if step.checked_abs()? != 1 {
            index = binary(BinaryOpData::Mult, index, number(step.abs()));
        }
        index = match (step > 0, begins) {
            (true, 0) => index,
            (true, 1..) => binary(BinaryOpData::Add, index, number(begins)),
            (true, _) => binary(BinaryOpData::Sub, index, number(begins.checked_abs()?)),
            (false, 0..) => binary(BinaryOpData::Sub, number(begins), index),
            (false, _) => return None,
        };
        let index = *index;
        Some((self.counter.clone(), index))
    }
}

impl VariableUses {
    pub(super) fn of(
        list: &[ast::Statement],
        functions: &HashMap<String, HashSet<usize>>,
        constants: &HashMap<String, Number>,
    ) -> Self {
        let mut known = Self {
            constants: constants.clone(),
            ..Self::default()
        };
        for statement in list {
            known.statement(statement, functions);
        }
        known
    }

    /// The bound of a `while (true)` with this body after the statements `ahead`.
    pub(super) fn loop_of(
        &self,
        body: &ast::Statement,
        ahead: &[ast::Statement],
        entered: Entered,
    ) -> Option<Loop> {
        let StatementData::Compound(list) = &**body else {
            return None;
        };
        let list = list.statement_list.as_slice();
        // Every iteration but the first begins with the increment.
        let (gate, is_true) = set(ahead.last()?)?;
        let [stepping, closing, ..] = list else {
            return None;
        };
        let closes =
            matches!(set(closing), Some((name, value)) if name == gate && is_bool(value, false));
        if !is_bool(is_true, true) || !closes || self.set.get(gate)?.len() != 2 {
            return None;
        }
        let inside = Self::of(list, &HashMap::new(), &self.constants);
        let (at, (counter, test)) = list
            .iter()
            .enumerate()
            .find_map(|(at, s)| Some((at, inside.leaves(s, self)?)))?;
        // A `continue` before the test would skip it.
        if list[..=at].iter().any(continues) {
            return None;
        }
        // A local that no call writes.
        if self.handed.contains(&counter) || !self.temporaries.contains_key(&counter) {
            return None;
        }
        let own = inside.set.get(&counter)?;
        let step = inside.step(&counter, own.as_slice(), self)?;
        if !steps(stepping, gate, &counter) {
            return None;
        }
        // Set before the loop, with only assignments of other variables between.
        let mut before = ahead.iter().rev().map_while(set);
        let again = before.find(|(name, _)| *name == counter);
        let (values, is_one) = match again {
            Some((_, value)) => (vec![self.number(value)?], true),
            None => {
                let others = self.set.get(&counter)?.iter();
                let others = others.filter(|value| !own.contains(value));
                let values: Vec<Number> = others
                    .map(|value| self.number(value))
                    .collect::<Option<_>>()?;
                let is_one = values.windows(2).all(|two| two[0] == two[1]);
                (values, is_one && entered == Entered::Once)
            }
        };
        let begins = match values.first()? {
            Number::Int(n) => is_one.then_some(*n),
            Number::Float(_) => None,
        };
        let turns: Option<Vec<i64>> = values.iter().map(|v| test.turns(*v, step)).collect();
        Some(Loop {
            turns: turns?.into_iter().max()?,
            counter,
            begins,
            step,
        })
    }

    /// Whether a variable keeps one value.
    pub(super) fn is_temporary(&self, name: &str) -> bool {
        self.temporaries.contains_key(name)
            && self.set.get(name).is_some_and(|all| all.len() == 1)
            && !self.handed.contains(name)
    }

    /// The counter and its test, for `if (!(counter < end)) break;` or
    /// `if (counter < end) {} else break;`. `self` describes the loop, `around` the function.
    fn leaves(&self, statement: &ast::Statement, around: &Self) -> Option<(String, Test)> {
        let StatementData::Selection(selection) = &**statement else {
            return None;
        };
        let is_break = |s: &ast::Statement| matches!(&**s, StatementData::Jump(j) if matches!(**j, JumpStatementData::Break));
        let breaks = |s: &ast::Statement| match &**s {
            StatementData::Compound(inner) => inner.statement_list.last().is_some_and(is_break),
            _ => is_break(s),
        };
        let stays = match (&*selection.rest, &**selection.cond) {
            (SelectionRestStatementData::Statement(leaving), ExprData::Unary(op, stays))
                if breaks(leaving) && **op == UnaryOpData::Not =>
            {
                stays
            }
            (SelectionRestStatementData::Else(_, leaving), _) if breaks(leaving) => &selection.cond,
            _ => return None,
        };
        let ExprData::Binary(op, left, right) = &**self.resolved(stays) else {
            return None;
        };
        let name = |e: &ast::Expr| match &**self.resolved(e) {
            ExprData::Variable(name) => Some(name.as_str().to_owned()),
            _ => None,
        };
        let op = (**op).clone();
        let (counter, op, bound) = match (around.number(right), around.number(left)) {
            (Some(bound), None) => (name(left)?, op, bound),
            (None, Some(bound)) => (name(right)?, mirrored(op), bound),
            _ => return None,
        };
        Some((counter, Test { op, bound }))
    }

    /// The constant by which the loop's only assignment changes the counter. `around` describes the
    /// function.
    fn step(&self, counter: &str, sets: &[ast::Expr], around: &Self) -> Option<Number> {
        let [one] = sets else {
            return None;
        };
        let ExprData::Binary(op, left, right) = &**one else {
            return None;
        };
        let is_counter = |e: &ast::Expr| matches!(&**self.resolved(e), ExprData::Variable(n) if n.as_str() == counter);
        match **op {
            BinaryOpData::Add if is_counter(left) => around.number(right),
            BinaryOpData::Add if is_counter(right) => around.number(left),
            BinaryOpData::Sub if is_counter(left) => around.number(right)?.negated(),
            _ => None,
        }
    }

    /// The value of a constant expression.
    fn number(&self, e: &ast::Expr) -> Option<Number> {
        let ExprData::Variable(name) = &**self.resolved(e) else {
            return Number::of(self.resolved(e));
        };
        let name = name.as_str();
        if self.handed.contains(name) {
            return None;
        }
        match self.set.get(name) {
            None => self.constants.get(name).copied(),
            Some(all) => match all.as_slice() {
                [only] if self.temporaries.contains_key(name) => Number::of(only),
                _ => None,
            },
        }
    }

    /// The definition of a temporary.
    fn resolved<'a>(&'a self, mut e: &'a ast::Expr) -> &'a ast::Expr {
        // Each one only uses earlier ones.
        while let ExprData::Variable(name) = &**e
            && let Some(of) = self.temporaries.get(name.as_str())
            && self.set.get(name.as_str()).is_none_or(|all| all.len() == 1)
            && is_baked(name.as_str())
        {
            e = of;
        }
        e
    }

    /// Records a write other than by `=`.
    fn hand(&mut self, to: &ast::Expr) {
        if let ExprData::Variable(name) = &**to {
            self.handed.insert(name.as_str().to_owned());
        }
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
            ExprData::Assignment(to, op, from) => {
                match (&***to, &**op) {
                    (ExprData::Variable(name), AssignmentOpData::Equal) => {
                        let all = self.set.entry(name.as_str().to_owned()).or_default();
                        all.push((**from).clone());
                    }
                    _ => self.hand(to),
                }
                self.expression(from, functions);
            }
            ExprData::FunCall(function, arguments) => {
                let name = function.as_ident().map_or("", |n| n.as_str());
                let written = functions.get(name);
                for (i, argument) in arguments.iter().enumerate() {
                    if written.is_some_and(|w| w.contains(&i)) {
                        self.hand(argument);
                    }
                    self.expression(argument, functions);
                }
            }
            ExprData::PostInc(a) | ExprData::PostDec(a) => self.hand(a),
            ExprData::Unary(op, a) => {
                if matches!(**op, UnaryOpData::Inc | UnaryOpData::Dec) {
                    self.hand(a);
                }
                self.expression(a, functions);
            }
            ExprData::Dot(a, _) => self.expression(a, functions),
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

/// The variable and value of an assignment statement.
fn set(statement: &ast::Statement) -> Option<(&str, &ast::Expr)> {
    let (name, value) = match &**statement {
        StatementData::Expression(e) => match &**e.0.as_ref()? {
            ExprData::Assignment(to, op, value) if **op == AssignmentOpData::Equal => {
                match &***to {
                    ExprData::Variable(name) => (name.as_str(), &**value),
                    _ => return None,
                }
            }
            _ => return None,
        },
        StatementData::Declaration(declaration) => match &**declaration {
            DeclarationData::InitDeclaratorList(list) => {
                let InitializerData::Simple(value) = &**list.head.initializer.as_ref()? else {
                    return None;
                };
                (list.head.name.as_ref()?.as_str(), &**value)
            }
            _ => return None,
        },
        _ => return None,
    };
    let plain = |e: &ast::Expr| {
        use ExprData::{BoolConst, FloatConst, IntConst, Variable};
        matches!(
            **e,
            IntConst(_) | FloatConst(_) | BoolConst(_) | Variable(_)
        )
    };
    let is_plain = plain(value) || Number::of(value).is_some();
    is_plain.then_some((name, value))
}

fn is_bool(e: &ast::Expr, wanted: bool) -> bool {
    matches!(**e, ExprData::BoolConst(b) if b == wanted)
}

/// The comparison with its sides exchanged.
fn mirrored(op: BinaryOpData) -> BinaryOpData {
    match op {
        BinaryOpData::Lt => BinaryOpData::Gt,
        BinaryOpData::Lte => BinaryOpData::Gte,
        BinaryOpData::Gt => BinaryOpData::Lt,
        BinaryOpData::Gte => BinaryOpData::Lte,
        other => other,
    }
}

/// Whether naga generated the name (`_e9`) for an expression. No author's name keeps a trailing
/// digit.
fn is_baked(name: &str) -> bool {
    let number = name.strip_prefix("_e");
    number.is_some_and(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()))
}

/// Whether the statement may `continue` the loop.
fn continues(statement: &ast::Statement) -> bool {
    match &**statement {
        StatementData::Jump(jump) => matches!(**jump, JumpStatementData::Continue),
        StatementData::Compound(inner) => inner.statement_list.iter().any(continues),
        StatementData::Selection(selection) => match &*selection.rest {
            SelectionRestStatementData::Statement(accept) => continues(accept),
            SelectionRestStatementData::Else(accept, reject) => {
                continues(accept) || continues(reject)
            }
        },
        StatementData::Switch(switch) => switch.body.iter().any(continues),
        // A nested loop's.
        StatementData::Iteration(_) => false,
        StatementData::Declaration(_)
        | StatementData::Expression(_)
        | StatementData::CaseLabel(_) => false,
    }
}

/// Whether a statement is naga's `if (!gate) { .. counter = ..; }`.
fn steps(statement: &ast::Statement, gate: &str, counter: &str) -> bool {
    let StatementData::Selection(selection) = &**statement else {
        return false;
    };
    let SelectionRestStatementData::Statement(accept) = &*selection.rest else {
        return false;
    };
    let is_gate = match &**selection.cond {
        ExprData::Unary(op, of) if **op == UnaryOpData::Not => {
            matches!(&***of, ExprData::Variable(n) if n.as_str() == gate)
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
    is_gate && inner.statement_list.iter().any(sets)
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
