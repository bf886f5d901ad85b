//! Reports comparisons and buffer reads to number types that record them ([`Number::NOTES`]).

use std::hash::{DefaultHasher, Hash, Hasher};
use std::mem::discriminant;

use naga::{BinaryOperator, Expression, Function, Handle, SwitchCase, SwitchValue};

use super::number::Number;
use super::scalar::Scalar;
use super::value::Value;

/// Levels of operands that identify a comparison.
const DEPTH: usize = 6;

/// Reports a comparison of scalars, or of each component of two vectors.
pub(crate) fn comparison<F: Number>(
    function: &Function,
    e: Handle<Expression>,
    op: BinaryOperator,
    [a, b]: [&Value<F>; 2],
) {
    use BinaryOperator as B;
    if !matches!(
        op,
        B::Less | B::LessEqual | B::Greater | B::GreaterEqual | B::Equal | B::NotEqual
    ) {
        return;
    }
    let site = shape(function, e);
    match (a, b) {
        (Value::Scalar(a), Value::Scalar(b)) => F::compared((site, 0), op, [*a, *b]),
        (Value::Composite(a), Value::Composite(b)) => {
            for (i, (a, b)) in a.iter().zip(b).enumerate() {
                if let (Value::Scalar(a), Value::Scalar(b)) = (a, b) {
                    F::compared((site, i), op, [*a, *b]);
                }
            }
        }
        _ => {}
    }
}

/// Reports the comparison of a selector with each case.
pub(crate) fn cases<F: Number>(
    function: &Function,
    e: Handle<Expression>,
    selector: Scalar<F>,
    cases: &[SwitchCase],
) {
    let site = shape(function, e);
    for (i, case) in cases.iter().enumerate() {
        let value = match case.value {
            SwitchValue::I32(n) => Scalar::I32(n),
            SwitchValue::U32(n) => Scalar::U32(n),
            SwitchValue::Default => continue,
        };
        F::compared((site, i), BinaryOperator::Equal, [selector, value]);
    }
}

/// Reports all scalars of a value at the end of a path into a buffer.
pub(crate) fn read<F: Number>(at: (u32, u32), way: &mut Vec<usize>, value: &Value<F>) {
    match value {
        Value::Scalar(scalar) => F::read(at, way, *scalar),
        Value::Composite(parts) => {
            for (i, part) in parts.iter().enumerate() {
                way.push(i);
                read(at, way, part);
                way.pop();
            }
        }
        _ => {}
    }
}

/// A hash of an expression that is equal for equal text in another program.
fn shape(function: &Function, e: Handle<Expression>) -> u64 {
    let mut hasher = DefaultHasher::new();
    shaped(function, e, DEPTH, &mut hasher);
    hasher.finish()
}

fn shaped(function: &Function, e: Handle<Expression>, depth: usize, to: &mut DefaultHasher) {
    let expression = &function.expressions[e];
    discriminant(expression).hash(to);
    match expression {
        Expression::Literal(literal) => format!("{literal:?}").hash(to),
        Expression::AccessIndex { index, .. } | Expression::FunctionArgument(index) => {
            index.hash(to);
        }
        Expression::Binary { op, .. } => (*op as u32).hash(to),
        Expression::Math { fun, .. } => (*fun as u32).hash(to),
        _ => {}
    }
    if depth > 0 {
        for operand in naga_operands::of_expression(expression) {
            shaped(function, operand, depth - 1, to);
        }
    }
}
