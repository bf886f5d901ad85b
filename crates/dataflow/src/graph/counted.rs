//! Counted loops: a local starts at a constant, is stepped by a constant once per iteration, and is
//! compared with a bound first. The bound is a constant, or a number in a uniform buffer.

use naga::{
    BinaryOperator, Expression, Handle, Literal, LocalVariable, MathFunction, Module, Statement,
    TypeInner,
};

use super::cells::Root;
use super::memory::{Origin, VersionId};
use super::{FunctionGraph, StmtId};
use preshade_plan::uniforms::UniformScalar;

/// Longest loop that we simulate to find its trip count.
const MOST_TRIPS: u32 = 4096;

/// Largest bound in a uniform buffer that a guard allows. A buffer of 64 KiB, the size that WebGPU
/// guarantees, holds this many lights of 64 bytes.
pub const MOST_GUARDED: u32 = 1024;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Ends {
    #[default]
    Always,
    /// It ends if [`uniform_bound`] is from 0 to [`MOST_GUARDED`].
    Guarded,
    Unknown,
}

/// A loop with a known trip count.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Counted {
    pub turns: u32,
    pub counter: Handle<LocalVariable>,
    /// The bound that the counter is compared with.
    pub bound: Handle<Expression>,
    /// Whether the counter is an `i32`. Otherwise it is a `u32`.
    pub signed: bool,
    start: i64,
    step: (BinaryOperator, i64),
    /// The loop continues while the comparison has this result.
    condition: (BinaryOperator, bool),
}

impl Counted {
    /// Analyses the loop `id`. `None` for any other loop, and if the counter would overflow: it
    /// would then wrap, and the loop might never end.
    pub fn of(module: &Module, f: &FunctionGraph<'_>, id: StmtId) -> Option<Self> {
        let mut counted = Self::of_any_bound(module, f, id)?;
        counted.turns = counted.until(integer(module, f, counted.bound)?)?;
        Some(counted)
    }

    /// The trip count of a loop if its bound is `known`.
    pub fn turns_by(
        module: &Module,
        f: &FunctionGraph<'_>,
        id: StmtId,
        known: impl Fn(Handle<Expression>) -> Option<i64>,
    ) -> Option<u32> {
        let counted = Self::of_any_bound(module, f, id)?;
        counted.until(known(counted.bound)?)
    }

    /// Analyses the loop for any bound, without a trip count.
    fn of_any_bound(module: &Module, f: &FunctionGraph<'_>, id: StmtId) -> Option<Self> {
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
        Some(Self {
            turns: 0,
            counter,
            bound: right,
            signed,
            start,
            step: (step_op, step),
            condition: (op, while_true),
        })
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

    /// The smallest and the largest value of the counter during an iteration. `None` without
    /// iterations.
    pub fn range(&self) -> Option<[i64; 2]> {
        let values = || self.values().take(self.turns as usize);
        Some([values().min()?, values().max()?])
    }

    /// Number of iterations until the comparison of the counter with `bound` ends the loop.
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
        for (turn, value) in (0..=MOST_TRIPS).zip(self.values()) {
            if holds(value)? != while_true {
                return Some(turn);
            }
        }
        None
    }

    /// Whether the counter rises to the bound, so that a larger bound gives no fewer iterations.
    fn grows_with_bound(&self) -> bool {
        use BinaryOperator::{Add, Greater, GreaterEqual, Less, LessEqual};
        let rises = self.step.0 == Add && self.step.1 > 0;
        let is_below = matches!(
            self.condition,
            (Less | LessEqual, true) | (Greater | GreaterEqual, false)
        );
        rises && is_below
    }

    /// A bound that gives the loop this trip count. `None` if there is none.
    pub fn bound_for(&self, turns: u32) -> Option<i64> {
        let at = |turn: u32| self.values().nth(turn as usize);
        // The counter's own values: at the end of the last iteration, or during it.
        let candidates = [at(turns), turns.checked_sub(1).and_then(at)];
        let mut candidates = candidates.into_iter().flatten();
        candidates.find(|bound| self.until(*bound) == Some(turns))
    }
}

/// The trip count of a counted loop. `None` for any other.
pub fn trips(module: &Module, f: &FunctionGraph<'_>, id: StmtId) -> Option<u32> {
    Counted::of(module, f, id).map(|c| c.turns)
}

/// Whether the loop `id` ends.
pub fn ends(module: &Module, f: &FunctionGraph<'_>, id: StmtId) -> Ends {
    let Some(counted) = Counted::of_any_bound(module, f, id) else {
        return Ends::Unknown;
    };
    let known = |e: Handle<Expression>| integer(module, f, e);
    let most = match f.function.expressions[counted.bound] {
        // The minimum of two bounds is no larger than either of them.
        Expression::Math {
            fun: MathFunction::Min,
            arg,
            arg1: Some(other),
            ..
        } if counted.grows_with_bound() => known(arg).or_else(|| known(other)),
        _ => known(counted.bound),
    };
    match most.is_some_and(|most| counted.until(most).is_some()) {
        true => Ends::Always,
        false if uniform_bound(module, f, id).is_some() => Ends::Guarded,
        false => Ends::Unknown,
    }
}

/// The number in a uniform buffer that bounds a counted loop, which ends if it is from 0 to [`MOST_GUARDED`].
pub fn uniform_bound(module: &Module, f: &FunctionGraph<'_>, id: StmtId) -> Option<UniformScalar> {
    let counted = Counted::of_any_bound(module, f, id)?;
    let is_bounded = || counted.until(i64::from(MOST_GUARDED)).is_some();
    if !counted.grows_with_bound() || !is_bounded() {
        return None;
    }
    let mut at = counted.bound;
    let mut path = Vec::new();
    loop {
        at = match f.function.expressions[at] {
            // A number from 0 to [`MOST_GUARDED`] has the same value in each type.
            Expression::As {
                expr,
                convert: Some(4),
                ..
            } if path.is_empty() => expr,
            Expression::Load { pointer } => pointer,
            Expression::AccessIndex { base, index } => {
                path.push(index);
                base
            }
            Expression::Access { base, index } => {
                path.push(naga_operands::constant_index(module, f.function, index)?);
                base
            }
            Expression::GlobalVariable(global) => {
                path.reverse();
                return UniformScalar::at(module, global, &path);
            }
            _ => return None,
        }
    }
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

/// The value of a 32-bit integer constant.
pub fn integer(module: &Module, f: &FunctionGraph<'_>, e: Handle<Expression>) -> Option<i64> {
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
