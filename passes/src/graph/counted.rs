//! Counted loops: a local starts at a constant, is stepped by a constant once per iteration, and is
//! compared with a constant first.

use naga::{
    BinaryOperator, Expression, Handle, Literal, LocalVariable, Module, Statement, TypeInner,
};

use super::cells::Root;
use super::memory::{Origin, VersionId};
use super::{FunctionGraph, StmtId};

/// Longest loop that we simulate to find its trip count.
const MOST_TRIPS: u32 = 4096;

/// A loop with a known trip count.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Counted {
    /// The trip count.
    pub turns: u32,
    /// The counter.
    pub counter: Handle<LocalVariable>,
    /// The bound that the counter is compared with.
    pub bound: Handle<Expression>,
    /// Whether the counter is an `i32`; else it is a `u32`.
    pub signed: bool,
    start: i64,
    step: (BinaryOperator, i64),
    /// The loop continues while the comparison has this result.
    condition: (BinaryOperator, bool),
}

impl Counted {
    /// Analyses the loop `id`. `None` for any other loop, and if the counter would overflow: there
    /// it wraps, and the loop may never end.
    pub fn of(module: &Module, f: &FunctionGraph<'_>, id: StmtId) -> Option<Self> {
        let Statement::Loop { body, .. } = f.statements.get(id).statement else {
            return None;
        };
        let (condition, while_true) = body.iter().find_map(|s| match s {
            Statement::Emit(_) => None,
            Statement::If {
                condition,
                accept,
                reject,
            } => match (accept.as_ref(), reject.as_ref()) {
                ([], [Statement::Break]) => Some(Some((*condition, true))),
                ([Statement::Break], []) => Some(Some((*condition, false))),
                _ => Some(None),
            },
            _ => Some(None),
        })??;
        let (condition, while_true) = match f.function.expressions[condition] {
            Expression::Unary {
                op: naga::UnaryOperator::LogicalNot,
                expr,
            } => (expr, !while_true),
            _ => (condition, while_true),
        };
        let Expression::Binary { op, left, right } = f.function.expressions[condition] else {
            return None;
        };
        let (counter, seen) = counter_version(f, left)?;
        let bound = integer(module, f, right)?;
        let Origin::Phi {
            at: Some(at),
            operands,
        } = f.memory.origin(seen)
        else {
            return None;
        };
        let [start, latch] = operands.as_slice() else {
            return None;
        };
        if *at != id {
            return None;
        }
        let start = match f.memory.origin(*start) {
            Origin::Initial => match f.function.local_variables[counter].init {
                Some(init) => integer(module, f, init)?,
                None => 0,
            },
            Origin::Written { by, over: None } => match f.statements.get(*by).statement {
                Statement::Store { value, .. } => integer(module, f, *value)?,
                _ => return None,
            },
            _ => return None,
        };
        let Origin::Written { by, over: None } = f.memory.origin(*latch) else {
            return None;
        };
        let Statement::Store { value, .. } = f.statements.get(*by).statement else {
            return None;
        };
        let Expression::Binary {
            op: step_op,
            left: stepped,
            right: step,
        } = f.function.expressions[*value]
        else {
            return None;
        };
        if counter_version(f, stepped)? != (counter, seen) {
            return None;
        }
        let step = integer(module, f, step)?;
        let signed = match module.types[f.function.local_variables[counter].ty].inner {
            TypeInner::Scalar(naga::Scalar::I32) => true,
            TypeInner::Scalar(naga::Scalar::U32) => false,
            _ => return None,
        };
        let mut counted = Self {
            turns: 0,
            counter,
            bound: right,
            signed,
            start,
            step: (step_op, step),
            condition: (op, while_true),
        };
        counted.turns = counted.until(bound)?;
        Some(counted)
    }

    /// Values of the counter by iteration, up to an overflow of its type.
    fn values(&self) -> impl Iterator<Item = i64> {
        let range = match self.signed {
            true => i64::from(i32::MIN)..=i64::from(i32::MAX),
            false => 0..=i64::from(u32::MAX),
        };
        let (op, step) = self.step;
        let next = move |value: &i64| match op {
            BinaryOperator::Add => value.checked_add(step),
            BinaryOperator::Subtract => value.checked_sub(step),
            BinaryOperator::Multiply => value.checked_mul(step),
            _ => None,
        };
        let in_range = move |value: &i64| range.contains(value);
        std::iter::successors(Some(self.start), move |v| next(v).filter(&in_range))
    }

    /// Iterations until the counter, compared with `bound`, ends the loop.
    fn until(&self, bound: i64) -> Option<u32> {
        let (op, while_true) = self.condition;
        let holds = |value: i64| {
            Some(match op {
                BinaryOperator::Less => value < bound,
                BinaryOperator::LessEqual => value <= bound,
                BinaryOperator::Greater => value > bound,
                BinaryOperator::GreaterEqual => value >= bound,
                BinaryOperator::NotEqual => value != bound,
                BinaryOperator::Equal => value == bound,
                _ => return None,
            })
        };
        for (turn, value) in (0..MOST_TRIPS).zip(self.values()) {
            if holds(value)? != while_true {
                return Some(turn);
            }
        }
        None
    }

    /// A bound that gives the loop this trip count; `None` if there is none.
    pub fn bound_for(&self, turns: u32) -> Option<i64> {
        let at = |turn: u32| self.values().nth(turn as usize);
        // The counter's own values: at the end of the last iteration, or during it.
        let candidates = [at(turns), turns.checked_sub(1).and_then(at)];
        let mut candidates = candidates.into_iter().flatten();
        candidates.find(|bound| self.until(*bound) == Some(turns))
    }
}

/// The trip count of a counted loop; `None` for any other.
pub fn trips(module: &Module, f: &FunctionGraph<'_>, id: StmtId) -> Option<u32> {
    Counted::of(module, f, id).map(|c| c.turns)
}

/// The local that an expression loads whole, and the loaded version.
fn counter_version(
    f: &FunctionGraph<'_>,
    e: Handle<Expression>,
) -> Option<(Handle<LocalVariable>, VersionId)> {
    let [seen] = f.memory.loads.get(&e)?.as_slice() else {
        return None;
    };
    match f.memory.cell(*seen).root {
        Root::Local(v) if f.memory.cell(*seen).path.is_empty() => Some((v, *seen)),
        _ => None,
    }
}

fn integer(module: &Module, f: &FunctionGraph<'_>, e: Handle<Expression>) -> Option<i64> {
    let literal = |e: &Expression| match e {
        Expression::Literal(Literal::I32(v)) => Some(i64::from(*v)),
        Expression::Literal(Literal::U32(v)) => Some(i64::from(*v)),
        Expression::ZeroValue(_) => Some(0),
        _ => None,
    };
    match &f.function.expressions[e] {
        Expression::Constant(c) => literal(&module.global_expressions[module.constants[*c].init]),
        e => literal(e),
    }
}
