//! Sums and products of any number type of the interpreter.

use naga_interp::Number;

/// Every number type supports addition.
pub(super) fn plus<F: Number>(a: F, b: F) -> F {
    F::binary(naga::BinaryOperator::Add, a, b).unwrap_or(a)
}

pub(super) fn product<F: Number>(a: F, b: F) -> F {
    F::binary(naga::BinaryOperator::Multiply, a, b).unwrap_or(a)
}

pub(super) fn times<F: Number>(a: F, b: f32) -> F {
    product(a, F::of(b))
}

pub(super) fn exp2<F: Number>(a: F) -> F {
    F::call(naga::MathFunction::Exp2, &[a]).unwrap_or(a)
}
