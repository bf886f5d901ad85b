//! Values of pipeline-overridable constants: assumed ones, and defaults computed from them.

use std::collections::BTreeMap;

use naga::{
    Arena, ArraySize, Expression, Handle, Literal, Module, Override, Span, Type, TypeInner,
};

use crate::{Scalar, Value};

fn literal(module: &Module, ty: Handle<Type>, value: f64) -> Option<Literal> {
    Some(match module.types[ty].inner.scalar()? {
        naga::Scalar::BOOL => Literal::Bool(value != 0.0),
        naga::Scalar::I32 => Literal::I32(value as i32),
        naga::Scalar::U32 => Literal::U32(value as u32),
        naga::Scalar::F32 => Literal::F32(value as f32),
        _ => return None,
    })
}

/// The module with other defaults for its overrides, by `@id` or else by name: the constants that a
/// pipeline sets.
pub fn with_defaults(module: &Module, values: &BTreeMap<String, f64>) -> Module {
    let mut out = module.clone();
    for (handle, of) in module.overrides.iter() {
        let key = of.id.map(|id| id.to_string()).or(of.name.clone());
        let number = key.and_then(|key| values.get(&key));
        let Some(literal) = number.and_then(|n| literal(module, of.ty, *n)) else {
            continue;
        };
        let init = out
            .global_expressions
            .append(Expression::Literal(literal), Span::UNDEFINED);
        out.overrides[handle].init = Some(init);
    }
    out
}

/// Converts a number to an override's type.
pub fn value(module: &Module, ty: Handle<Type>, number: f64) -> Option<Value> {
    Value::literal(&literal(module, ty, number)?).ok()
}

/// Converts an override's value to a number.
pub fn number(value: &Value) -> Option<f64> {
    match value {
        Value::Scalar(Scalar::Bool(b)) => Some(f64::from(u8::from(*b))),
        Value::Scalar(Scalar::I32(i)) => Some(f64::from(*i)),
        Value::Scalar(Scalar::U32(u)) => Some(f64::from(*u)),
        Value::Scalar(Scalar::F32(f)) if f.is_finite() => Some(f64::from(*f)),
        _ => None,
    }
}

/// The default of an override, if it is an integer or a boolean.
pub fn integer_default(module: &Module, of: Handle<Override>) -> Option<i64> {
    let value = crate::default_constant::<f32>(module, module.overrides[of].init?).ok()?;
    match value {
        Value::Scalar(Scalar::F32(_)) => None,
        value => number(&value).map(|n| n as i64),
    }
}

/// The overrides that a global expression depends on.
pub fn overrides_of(module: &Module, e: Handle<Expression>) -> Vec<Handle<Override>> {
    match &module.global_expressions[e] {
        Expression::Override(o) => vec![*o],
        other => naga_operands::of_expression(other)
            .into_iter()
            .flat_map(|o| overrides_of(module, o))
            .collect(),
    }
}

/// The module with these values as defaults.
pub fn resolved(
    mut module: Module,
    values: impl Iterator<Item = (Handle<Override>, f64)>,
) -> Module {
    let mut literals = Vec::new();
    for (handle, value) in values {
        let ty = module.overrides[handle].ty;
        literals.extend(literal(&module, ty, value).map(|l| (handle, l)));
    }
    if literals.is_empty() {
        return module;
    }
    // The operands of overrides must come before all their uses.
    let mut expressions = Arena::new();
    let mut defaults = Vec::new();
    for (handle, literal) in literals {
        let init = expressions.append(Expression::Literal(literal), Span::UNDEFINED);
        defaults.push((handle, init));
    }
    let mut map = Vec::with_capacity(module.global_expressions.len());
    for (_, mut expression, span) in module.global_expressions.drain() {
        naga_operands::map_expression(&mut expression, &mut |o| *o = map[o.index()]);
        map.push(expressions.append(expression, span));
    }
    module.global_expressions = expressions;
    let moved = |e: &mut Handle<Expression>| *e = map[e.index()];
    for (_, constant) in module.constants.iter_mut() {
        moved(&mut constant.init);
    }
    for (_, constant) in module.overrides.iter_mut() {
        constant.init.iter_mut().for_each(moved);
    }
    for (_, global) in module.global_variables.iter_mut() {
        global.init.iter_mut().for_each(moved);
    }
    for entry in &mut module.entry_points {
        let sizes = entry.workgroup_size_overrides.iter_mut();
        sizes.flatten().flatten().for_each(moved);
    }
    for (handle, init) in defaults {
        module.overrides.get_mut(handle).init = Some(init);
    }
    module
}

/// The module without an override: its uses get the default. `None` if it has no default, if the
/// default depends on other overrides, or if types depend on overrides.
pub fn fixed(module: &Module, of: Handle<Override>) -> Option<Module> {
    let Override { ty, init, .. } = module.overrides[of];
    let none = |_: Handle<Override>| None;
    let value = crate::constant::<f32>(module, init?, &none).ok()?;
    let literal = Expression::Literal(literal(module, ty, number(&value)?)?);
    let is_pending = |ty: &Type| match ty.inner {
        TypeInner::Array { size, .. } | TypeInner::BindingArray { size, .. } => {
            matches!(size, ArraySize::Pending(_))
        }
        _ => false,
    };
    if module.types.iter().any(|(_, ty)| is_pending(ty)) {
        return None;
    }
    let mut fixed = module.clone();
    let mut others = Arena::new();
    let mut moved = BTreeMap::new();
    for (handle, other, span) in fixed.overrides.drain() {
        if handle != of {
            moved.insert(handle, others.append(other, span));
        }
    }
    fixed.overrides = others;
    let functions = fixed.functions.iter_mut().map(|(_, f)| f);
    let entries = fixed.entry_points.iter_mut().map(|e| &mut e.function);
    let arenas = functions.chain(entries).map(|f| &mut f.expressions);
    for arena in arenas.chain([&mut fixed.global_expressions]) {
        for (_, expression) in arena.iter_mut() {
            if let Expression::Override(other) = expression {
                *expression = match moved.get(other) {
                    Some(moved) => Expression::Override(*moved),
                    None => literal.clone(),
                };
            }
        }
    }
    Some(fixed)
}
