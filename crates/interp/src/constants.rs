//! Evaluates constant expressions of a module.

use naga::{Expression, Handle, Module};

use super::number::Number;
use super::value::{Scalar, Value, compose};
use super::{Stuck, math};

/// Returns an override's value, if it has one.
pub type OverrideValue<'a, F> = dyn Fn(Handle<naga::Override>) -> Option<Value<F>> + 'a;

/// Evaluates a constant expression in the module's own arena, with the values of `overrides`.
///
/// # Errors
///
/// The expression is not supported, or an override has no value.
pub fn constant<F: Number>(
    module: &Module,
    e: Handle<Expression>,
    overrides: &OverrideValue<'_, F>,
) -> Result<Value<F>, Stuck> {
    let of = |e: &Handle<Expression>| constant(module, *e, overrides);
    match &module.global_expressions[e] {
        Expression::Literal(l) => Value::literal(l),
        Expression::Constant(c) => of(&module.constants[*c].init),
        Expression::Override(o) => overrides(*o)
            .ok_or_else(|| Stuck::Unsupported("an override without a value".to_owned())),
        Expression::ZeroValue(ty) => Value::zero(module, *ty),
        Expression::Splat { size, value } => Ok(Value::Composite(vec![of(value)?; *size as usize])),
        Expression::Compose { ty, components } => {
            let parts = components.iter().map(of).collect::<Result<Vec<_>, _>>()?;
            Ok(compose(module, *ty, parts))
        }
        Expression::Unary { op, expr } => math::unary(*op, &of(expr)?),
        Expression::Binary { op, left, right } => math::binary(*op, &of(left)?, &of(right)?),
        Expression::Select {
            condition,
            accept,
            reject,
        } => match of(condition)? {
            Value::Scalar(Scalar::Bool(true)) => of(accept),
            Value::Scalar(Scalar::Bool(false)) => of(reject),
            _ => Err(Stuck::Unsupported(
                "a constant selection by components".to_owned(),
            )),
        },
        Expression::As {
            expr,
            kind,
            convert,
        } => math::cast(*kind, *convert, &of(expr)?),
        other => Err(Stuck::Unsupported(format!("the constant {other:?}"))),
    }
}

/// Evaluates a constant expression, with the overrides' defaults.
///
/// # Errors
///
/// Those of [`constant`].
pub fn default_constant<F: Number>(
    module: &Module,
    e: Handle<Expression>,
) -> Result<Value<F>, Stuck> {
    let default = |o: Handle<naga::Override>| {
        let init = module.overrides[o].init?;
        default_constant(module, init).ok()
    };
    constant(module, e, &default)
}
