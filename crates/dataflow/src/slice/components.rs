//! Propagates a need from an expression to its operands, by vector component for componentwise
//! operations.

use naga::{Expression, Handle, MathFunction, Module, RelationalFunction, TypeInner};

use super::need::Need;
use crate::graph::FunctionGraph;

/// The operands of `e` that `need` requires, with the needed part of each. Other operands may have
/// any value.
pub(crate) fn of_operands(
    module: &Module,
    f: &FunctionGraph<'_>,
    e: Handle<Expression>,
    need: &Need,
) -> Vec<(Handle<Expression>, Need)> {
    let expression = &f.function.expressions[e];
    match expression {
        Expression::Compose { ty, components } => match &module.types[*ty].inner {
            TypeInner::Struct { .. } => (0..)
                .zip(components)
                .filter_map(|(i, c)| Some((*c, need.of(i)?)))
                .collect(),
            TypeInner::Vector { .. } => of_composed(module, f, components, need),
            _ => all(expression),
        },
        Expression::AccessIndex { base, index } => match f.ty(module, *base) {
            TypeInner::Struct { .. } => vec![(*base, Need::member(*index, need.clone()))],
            TypeInner::Vector { .. } => vec![(*base, Need::member(*index, Need::All))],
            _ => all(expression),
        },
        Expression::Swizzle {
            size,
            vector,
            pattern,
        } => {
            let mut of_vector = None;
            let read = (0..*size as u32).filter(|i| need.of(*i).is_some());
            for component in read.filter_map(|i| pattern.get(i as usize)) {
                let component = Need::member(*component as u32, Need::All);
                Need::add_to(&mut of_vector, &component);
            }
            of_vector.map(|n| (*vector, n)).into_iter().collect()
        }
        _ if is_componentwise(module, f, expression) => naga_operands::of_expression(expression)
            .into_iter()
            .map(|o| (o, like(module, f, e, o, need)))
            .collect(),
        _ => all(expression),
    }
}

fn all(expression: &Expression) -> Vec<(Handle<Expression>, Need)> {
    naga_operands::of_expression(expression)
        .into_iter()
        .map(|o| (o, Need::All))
        .collect()
}

/// Number of components of a scalar or vector. `None` for other types.
pub fn width(ty: &TypeInner) -> Option<u32> {
    match ty {
        TypeInner::Scalar(_) => Some(1),
        TypeInner::Vector { size, .. } => Some(*size as u32),
        _ => None,
    }
}

/// A vector is composed of scalars and shorter vectors in order.
fn of_composed(
    module: &Module,
    f: &FunctionGraph<'_>,
    components: &[Handle<Expression>],
    need: &Need,
) -> Vec<(Handle<Expression>, Need)> {
    let mut first = 0;
    let mut needed = Vec::new();
    for component in components {
        let ty = f.ty(module, *component);
        let width = width(ty).unwrap_or(1);
        let mut inner = None;
        for i in (0..width).filter(|i| need.of(first + i).is_some()) {
            let part = match ty {
                TypeInner::Vector { .. } => Need::member(i, Need::All),
                _ => Need::All,
            };
            Need::add_to(&mut inner, &part);
        }
        needed.extend(inner.map(|n| (*component, n)));
        first += width;
    }
    needed
}

/// The need of a componentwise operation's operand: the same components of a vector of equal
/// length, else all.
fn like(
    module: &Module,
    f: &FunctionGraph<'_>,
    value: Handle<Expression>,
    operand: Handle<Expression>,
    need: &Need,
) -> Need {
    match (f.ty(module, value), f.ty(module, operand)) {
        (TypeInner::Vector { size: a, .. }, TypeInner::Vector { size: b, .. }) if a == b => {
            need.clone()
        }
        _ => Need::All,
    }
}

/// Whether component `i` of a vector value depends only on components `i` of its vector operands,
/// and on its scalar operands.
fn is_componentwise(module: &Module, f: &FunctionGraph<'_>, expression: &Expression) -> bool {
    let is_matrix = |e: &Handle<Expression>| matches!(f.ty(module, *e), TypeInner::Matrix { .. });
    match expression {
        Expression::Splat { .. }
        | Expression::Unary { .. }
        | Expression::Select { .. }
        | Expression::Derivative { .. }
        | Expression::As { .. } => true,
        // A product with a matrix mixes components.
        Expression::Binary { left, right, .. } => !is_matrix(left) && !is_matrix(right),
        Expression::Relational { fun, .. } => {
            matches!(fun, RelationalFunction::IsNan | RelationalFunction::IsInf)
        }
        Expression::Math { fun, .. } => is_componentwise_function(*fun),
        _ => false,
    }
}

fn is_componentwise_function(fun: MathFunction) -> bool {
    use MathFunction as M;
    matches!(
        fun,
        M::Abs
            | M::Min
            | M::Max
            | M::Clamp
            | M::Saturate
            | M::Cos
            | M::Cosh
            | M::Sin
            | M::Sinh
            | M::Tan
            | M::Tanh
            | M::Acos
            | M::Asin
            | M::Atan
            | M::Atan2
            | M::Asinh
            | M::Acosh
            | M::Atanh
            | M::Radians
            | M::Degrees
            | M::Ceil
            | M::Floor
            | M::Round
            | M::Fract
            | M::Trunc
            | M::Ldexp
            | M::Exp
            | M::Exp2
            | M::Log
            | M::Log2
            | M::Pow
            | M::Sign
            | M::Fma
            | M::Mix
            | M::Step
            | M::SmoothStep
            | M::Sqrt
            | M::InverseSqrt
            | M::QuantizeToF16
    )
}
