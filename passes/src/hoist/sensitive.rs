//! Where the last bit of a value may become any difference.
//!
//! A value carried under `Rounding` differs in its last bits from what the fragment stage would have computed. That stays a rounding through operations
//! that are locally Lipschitz: sums, products, sine, length. It does not where an operation jumps, nor where its slope has no bound near some finite
//! argument: after a cancellation, `normalize` or a division makes a direction or a number of nothing but last bits.

use naga::{BinaryOperator, Expression, Handle, Literal, MathFunction, ScalarKind};

use super::travel;
use super::values::{ContextId, Node, Value, ValueId, Values};
use crate::graph::rate::Rate;

/// Largest literal factor that is not taken for an amplifier: 2^8 of the 2^15 that lie between the last bit of a number and half a step of 8 bits.
const LARGEST_FACTOR: f64 = 256.0;
/// Largest literal exponent, and steepest ramp, as [`LARGEST_FACTOR`]: a power has its exponent for a slope where the base is 1.
const LARGEST_EXPONENT: f64 = 64.0;

/// Values whose last bit counts: an operation that may make any error of one is reached from them, or lies between them and the varyings.
pub fn sensitive(values: &Values<'_, '_>) -> Vec<bool> {
    let mut above: Vec<ValueId> = Vec::new();
    let mut at: Vec<ValueId> = Vec::new();
    for (id, value) in values.values.iter().enumerate() {
        match &value.node {
            Node::Control(..) => above.extend(&value.operands),
            Node::Expression(context, e, _) if amplifies(values, *context, *e) => {
                above.extend(&value.operands);
                // What does not vary is the same in both stages.
                at.extend(Some(id).filter(|_| !is_of_draw(value)));
            }
            _ => {}
        }
    }
    let reaching = with_operands(values, above);
    let made_of = with_users(values, at);
    reaching.iter().zip(made_of).map(|(a, b)| *a || b).collect()
}

/// Values, and all that rests on them.
pub fn with_users(values: &Values<'_, '_>, mut work: Vec<ValueId>) -> Vec<bool> {
    let users = values.users();
    let mut held = vec![false; values.values.len()];
    while let Some(id) = work.pop() {
        if !std::mem::replace(&mut held[id], true) {
            work.extend(&users[id]);
        }
    }
    held
}

/// Values, and all they rest on.
pub fn with_operands(values: &Values<'_, '_>, mut work: Vec<ValueId>) -> Vec<bool> {
    let mut held = vec![false; values.values.len()];
    while let Some(id) = work.pop() {
        if !std::mem::replace(&mut held[id], true) {
            work.extend(&values.values[id].operands);
        }
    }
    held
}

/// Whether an operation has no bounded slope, or none that is seen. What is not known to have one has none.
fn amplifies(values: &Values<'_, '_>, context: ContextId, e: Handle<Expression>) -> bool {
    let expressions = &values.function(context).function.expressions;
    let expression = &expressions[e];
    let number = |e: Handle<Expression>| literal(values, context, e);
    let is_large = |e: Handle<Expression>| number(e).is_some_and(|x| x.abs() > LARGEST_FACTOR);
    match expression {
        _ if travel::jump(expression).is_some() => true,
        Expression::Literal(_)
        | Expression::Constant(_)
        | Expression::Override(_)
        | Expression::ZeroValue(_)
        | Expression::Compose { .. }
        | Expression::Splat { .. }
        | Expression::Swizzle { .. }
        | Expression::AccessIndex { .. }
        | Expression::FunctionArgument(_)
        | Expression::GlobalVariable(_)
        | Expression::LocalVariable(_)
        | Expression::CallResult(_)
        | Expression::Unary { .. }
        // Its condition is a comparison's.
        | Expression::Select { .. }
        | Expression::As { kind: ScalarKind::Float, .. } => false,
        // An index in an operand is an integer, whose conversion is a jump.
        Expression::Load { .. } => false,
        Expression::Binary { op, left, right } => match op {
            BinaryOperator::Add | BinaryOperator::Subtract => false,
            BinaryOperator::Multiply => is_large(*left) || is_large(*right),
            // By a number that is not near 0. A divisor of the draw is taken to be an ordinary one, as any coefficient is.
            BinaryOperator::Divide => match number(*right) {
                Some(x) => x.abs() < 1.0 / LARGEST_FACTOR,
                None => !values
                    .named(context, *right)
                    .is_some_and(|v| is_of_draw(&values.values[v])),
            },
            _ => true,
        },
        Expression::Math {
            fun, arg, arg1, ..
        } => match fun {
            MathFunction::Abs
            | MathFunction::Min
            | MathFunction::Max
            | MathFunction::Clamp
            | MathFunction::Saturate
            | MathFunction::Sin
            | MathFunction::Cos
            | MathFunction::Tanh
            | MathFunction::Sinh
            | MathFunction::Cosh
            | MathFunction::Asinh
            | MathFunction::Atan
            | MathFunction::Exp
            | MathFunction::Exp2
            | MathFunction::Radians
            | MathFunction::Degrees
            | MathFunction::Dot
            | MathFunction::Outer
            | MathFunction::Cross
            | MathFunction::Distance
            | MathFunction::Length
            | MathFunction::Reflect
            | MathFunction::Fma
            | MathFunction::Mix
            | MathFunction::Transpose
            | MathFunction::Determinant => false,
            MathFunction::Pow => !arg1
                .and_then(number)
                .is_some_and(|y| (1.0..=LARGEST_EXPONENT).contains(&y)),
            // Its slope is three halves of the ramp's.
            MathFunction::SmoothStep => match (number(*arg), arg1.and_then(number)) {
                (Some(low), Some(high)) => 1.5 / (high - low).abs() > LARGEST_EXPONENT,
                _ => true,
            },
            _ => true,
        },
        _ => true,
    }
}

fn is_of_draw(value: &Value) -> bool {
    matches!(value.fact.rate, Rate::Const | Rate::Draw | Rate::Instance)
}

/// The number that an expression is, or all of its components.
fn literal(values: &Values<'_, '_>, context: ContextId, e: Handle<Expression>) -> Option<f64> {
    let module = values.graph.module();
    let number = |literal: &Literal| match literal {
        Literal::F32(x) => Some(f64::from(*x)),
        Literal::F64(x) | Literal::AbstractFloat(x) => Some(*x),
        _ => None,
    };
    match &values.function(context).function.expressions[e] {
        Expression::Literal(l) => number(l),
        Expression::Constant(c) => match &module.global_expressions[module.constants[*c].init] {
            Expression::Literal(l) => number(l),
            _ => None,
        },
        Expression::Splat { value, .. } => literal(values, context, *value),
        _ => None,
    }
}
