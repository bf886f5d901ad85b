//! Sign and magnitude of values, as far as the code shows them: enough to tell operations that are
//! safe at any vertex from those that may return NaN or infinity.

use naga::{BinaryOperator, Expression, Handle, Literal, MathFunction, ScalarKind, TypeInner};

use crate::analysis::range::AllRanges;
use crate::analysis::values::{Node, ValueId, Values};

/// The sign of every component of a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Sign {
    /// Above zero by more than rounding.
    Positive,
    /// Zero or above.
    NonNegative,
    /// Unknown.
    Unknown,
}

use Sign::{NonNegative, Positive, Unknown};

/// The signs of all values.
#[derive(Debug)]
pub struct Signs(Vec<Sign>);

impl Signs {
    /// Greatest fixed point: a cycle keeps the sign that it preserves.
    pub fn new(values: &Values<'_, '_>) -> Self {
        let users = values.users();
        let mut signs = Self(vec![Positive; values.values.len()]);
        let mut work: Vec<ValueId> = (0..values.values.len()).collect();
        while let Some(id) = work.pop() {
            let sign = signs.of(values, id);
            if sign > signs.0[id] {
                signs.0[id] = sign;
                work.extend(&users[id]);
            }
        }
        signs
    }

    fn operand(&self, values: &Values<'_, '_>, context: usize, e: Handle<Expression>) -> Sign {
        values.named(context, e).map_or(Unknown, |v| self.0[v])
    }

    fn of(&self, values: &Values<'_, '_>, id: ValueId) -> Sign {
        let (context, e) = match &values.values[id].node {
            Node::Expression(context, e, _) => (*context, *e),
            Node::Version(..) => {
                let operands = values.values[id].operands.iter();
                let versions = operands
                    .filter(|o| !matches!(values.values[**o].node, Node::Control(..)))
                    .map(|o| self.0[*o]);
                return versions.max().unwrap_or(Unknown);
            }
            Node::Input(_) | Node::Control(..) => return Unknown,
        };
        let of = |o: Handle<Expression>| self.operand(values, context, o);
        let joined = || {
            let operands = values.values[id].operands.iter();
            operands.map(|o| self.0[*o]).max().unwrap_or(Unknown)
        };
        let f = values.function(context);
        let module = values.graph.module();
        if f.ty(module, e).scalar_kind() != Some(ScalarKind::Float) {
            return Unknown;
        }
        match &f.function.expressions[e] {
            Expression::Literal(Literal::F32(x)) => of_number(f64::from(*x)),
            Expression::Literal(Literal::F64(x) | Literal::AbstractFloat(x)) => of_number(*x),
            Expression::Constant(c) => of_constant(module, module.constants[*c].init),
            Expression::Compose { components, .. } => {
                components.iter().map(|c| of(*c)).max().unwrap_or(Unknown)
            }
            Expression::Splat { value, .. } => of(*value),
            Expression::Swizzle { vector, .. } => of(*vector),
            Expression::AccessIndex { base, .. }
                if matches!(f.ty(module, *base), TypeInner::Vector { .. }) =>
            {
                of(*base)
            }
            Expression::CallResult(_) => {
                let operands = values.values[id].operands.iter();
                let returned =
                    operands.filter(|o| !matches!(values.values[**o].node, Node::Control(..)));
                returned.map(|o| self.0[*o]).max().unwrap_or(Unknown)
            }
            Expression::Load { pointer } => match f.ty(module, *pointer).pointer_space() {
                Some(naga::AddressSpace::Function | naga::AddressSpace::Private)
                    if f.memory.loads.get(&e).is_some_and(|l| !l.is_empty()) =>
                {
                    joined()
                }
                _ => Unknown,
            },
            Expression::Binary { op, left, right } => {
                let same = same_value(values, context, *left, *right);
                match (op, of(*left), of(*right)) {
                    (BinaryOperator::Add, a, b) if a.max(b) <= NonNegative => a.min(b),
                    (BinaryOperator::Multiply, _, _) if same => NonNegative,
                    // A product of two positive numbers may underflow.
                    (BinaryOperator::Multiply, a, b) if a.max(b) <= NonNegative => NonNegative,
                    (BinaryOperator::Divide, a, Positive) if a <= NonNegative => NonNegative,
                    _ => Unknown,
                }
            }
            Expression::Select { accept, reject, .. } => of(*accept).max(of(*reject)),
            Expression::Math {
                fun,
                arg,
                arg1,
                arg2,
                ..
            } => {
                let second = arg1.map_or(Unknown, of);
                match fun {
                    MathFunction::Abs | MathFunction::Length | MathFunction::Distance => {
                        if of(*arg) == Positive && *fun == MathFunction::Abs {
                            Positive
                        } else {
                            NonNegative
                        }
                    }
                    MathFunction::Saturate
                    | MathFunction::Fract
                    | MathFunction::SmoothStep
                    | MathFunction::Step
                    | MathFunction::Acos => NonNegative,
                    MathFunction::Exp | MathFunction::Exp2 | MathFunction::Cosh => NonNegative,
                    MathFunction::Dot
                        if arg1.is_some_and(|b| same_value(values, context, *arg, b)) =>
                    {
                        NonNegative
                    }
                    MathFunction::Max => of(*arg).min(second),
                    MathFunction::Min => of(*arg).max(second),
                    // At least the lower bound.
                    MathFunction::Clamp => second,
                    MathFunction::Sqrt => of(*arg).max(if of(*arg) == Positive {
                        Positive
                    } else {
                        NonNegative
                    }),
                    MathFunction::InverseSqrt if of(*arg) == Positive => NonNegative,
                    MathFunction::Pow if of(*arg) <= NonNegative => NonNegative,
                    MathFunction::Floor if of(*arg) <= NonNegative => NonNegative,
                    MathFunction::Mix
                        if of(*arg).max(second) <= NonNegative
                            && arg2.is_some_and(|t| is_unit(values, context, t)) =>
                    {
                        NonNegative
                    }
                    _ => Unknown,
                }
            }
            _ => Unknown,
        }
    }

    /// Name of the operation, if it may return NaN or infinity for finite operands.
    pub fn hazard(
        &self,
        values: &Values<'_, '_>,
        context: usize,
        e: Handle<Expression>,
    ) -> Option<&'static str> {
        let f = values.function(context);
        let of = |o: Handle<Expression>| self.operand(values, context, o);
        match &f.function.expressions[e] {
            Expression::Binary { op, right, .. }
                if f.ty(values.graph.module(), e).scalar_kind() == Some(ScalarKind::Float) =>
            {
                match op {
                    BinaryOperator::Divide
                        if of(*right) != Positive && !is_nonzero(values, context, *right) =>
                    {
                        Some("/")
                    }
                    BinaryOperator::Modulo if of(*right) != Positive => Some("%"),
                    _ => None,
                }
            }
            Expression::Math { fun, arg, arg1, .. } => match fun {
                MathFunction::Sqrt if of(*arg) == Unknown => Some("sqrt"),
                MathFunction::InverseSqrt if of(*arg) != Positive => Some("inverseSqrt"),
                MathFunction::Log | MathFunction::Log2 if of(*arg) != Positive => Some("log"),
                // 0 to the power of 0 or less is NaN or infinite.
                MathFunction::Pow
                    if of(*arg) == Unknown
                        || (of(*arg) != Positive && arg1.is_none_or(|y| of(y) != Positive)) =>
                {
                    Some("pow")
                }
                MathFunction::Normalize => Some("normalize"),
                MathFunction::Acos => Some("acos"),
                MathFunction::Asin => Some("asin"),
                MathFunction::Acosh => Some("acosh"),
                MathFunction::Atanh => Some("atanh"),
                MathFunction::Tan => Some("tan"),
                MathFunction::Inverse => Some("inverse"),
                MathFunction::Refract => Some("refract"),
                _ => None,
            },
            _ => None,
        }
    }
}

/// Assumed magnitude of unknown varyings, draw constants and texels: 2^20, a million scene units. A
/// varying of a real scene is finite; this assumes that it is not extremely large.
pub const LARGEST_INPUT: f64 = (1 << 20) as f64;

/// Name of the operation, if it may overflow `f32` for smaller operands. Infinity is one step from
/// NaN: `inf * 0`, `inf - inf`.
pub fn overflow(values: &Values<'_, '_>, ranges: &AllRanges, id: ValueId) -> Option<&'static str> {
    // Ranges are real numbers; leave room for rounding.
    let fits = |id: ValueId| ranges.of(id).magnitude() < 0.99 * f64::from(f32::MAX);
    let (context, e, _) = values.expression(id)?;
    let f = values.function(context);
    let expression = &f.function.expressions[e];
    let is_float = f.ty(values.graph.module(), e).scalar_kind() == Some(ScalarKind::Float);
    // Some functions square their arguments.
    let squares = match expression {
        Expression::Math {
            fun: MathFunction::Length | MathFunction::Asinh,
            arg,
            ..
        } => Some(ranges.operand(values, context, *arg).magnitude()),
        Expression::Math {
            fun: MathFunction::Distance,
            arg,
            arg1: Some(other),
            ..
        } => {
            let of = |e| ranges.operand(values, context, e).magnitude();
            Some(of(*arg) + of(*other))
        }
        _ => None,
    };
    let squares_fit = squares.is_none_or(|m| 4.0 * m * m < f64::from(f32::MAX));
    if !is_float || (fits(id) && squares_fit) {
        return None;
    }
    Some(match expression {
        Expression::Binary { op, .. } => match op {
            BinaryOperator::Add => "+",
            BinaryOperator::Subtract => "-",
            BinaryOperator::Multiply => "*",
            BinaryOperator::Divide => "/",
            _ => return None,
        },
        Expression::Math { fun, .. } => match fun {
            MathFunction::Exp => "exp",
            MathFunction::Exp2 => "exp2",
            MathFunction::Pow => "pow",
            MathFunction::Sinh => "sinh",
            MathFunction::Cosh => "cosh",
            MathFunction::Ldexp => "ldexp",
            MathFunction::Dot => "dot",
            MathFunction::Cross => "cross",
            MathFunction::Asinh => "asinh",
            MathFunction::Length => "length",
            MathFunction::Distance => "distance",
            MathFunction::Fma => "fma",
            MathFunction::Mix => "mix",
            MathFunction::Reflect => "reflect",
            MathFunction::Determinant => "determinant",
            MathFunction::Outer => "outer product",
            MathFunction::Degrees => "degrees",
            MathFunction::InverseSqrt => "inverseSqrt",
            _ => return None,
        },
        _ => return None,
    })
}

/// Smallest safe divisor: its inverse is far from overflow.
const SMALLEST: f64 = 1e-30;

fn of_number(x: f64) -> Sign {
    match x {
        _ if x >= SMALLEST => Positive,
        _ if x >= 0.0 => NonNegative,
        _ => Unknown,
    }
}

fn of_constant(module: &naga::Module, e: Handle<Expression>) -> Sign {
    match &module.global_expressions[e] {
        Expression::Literal(Literal::F32(x)) => of_number(f64::from(*x)),
        Expression::Constant(c) => of_constant(module, module.constants[*c].init),
        Expression::Compose { components, .. } => components
            .iter()
            .map(|c| of_constant(module, *c))
            .max()
            .unwrap_or(Unknown),
        Expression::Splat { value, .. } => of_constant(module, *value),
        _ => Unknown,
    }
}

/// Whether two operands are one value.
pub(crate) fn same_value(
    values: &Values<'_, '_>,
    context: usize,
    a: Handle<Expression>,
    b: Handle<Expression>,
) -> bool {
    if a == b {
        return true;
    }
    let (Some(x), Some(y)) = (values.named(context, a), values.named(context, b)) else {
        return false;
    };
    // Two reads of a variable in the same memory versions.
    let pointer = |e: Handle<Expression>| match values.function(context).function.expressions[e] {
        Expression::Load { pointer } => Some(pointer),
        _ => None,
    };
    x == y
        || (same_pointer(values, context, pointer(a), pointer(b))
            && values.values[x].operands == values.values[y].operands)
}

fn same_pointer(
    values: &Values<'_, '_>,
    context: usize,
    a: Option<Handle<Expression>>,
    b: Option<Handle<Expression>>,
) -> bool {
    use crate::graph::cells;
    let (Some(a), Some(b)) = (a, b) else {
        return false;
    };
    let function = values.function(context).function;
    let place = |p| cells::place(values.graph.module(), function, p).filter(|p| !p.dynamic);
    a == b || (place(a).is_some() && place(a) == place(b))
}

/// Whether a value is a literal other than 0.
fn is_nonzero(values: &Values<'_, '_>, context: usize, e: Handle<Expression>) -> bool {
    match &values.function(context).function.expressions[e] {
        Expression::Literal(Literal::F32(x)) => f64::from(x.abs()) >= SMALLEST,
        Expression::Splat { value, .. } => is_nonzero(values, context, *value),
        Expression::Compose { components, .. } => {
            components.iter().all(|c| is_nonzero(values, context, *c))
        }
        _ => false,
    }
}

/// Whether a value provably is in 0..1.
fn is_unit(values: &Values<'_, '_>, context: usize, e: Handle<Expression>) -> bool {
    matches!(
        values.function(context).function.expressions[e],
        Expression::Math {
            fun: MathFunction::Saturate | MathFunction::SmoothStep | MathFunction::Step,
            ..
        }
    )
}
