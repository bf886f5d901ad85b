//! Values of pipeline-overridable constants: assumed ones, and defaults computed from them.

use std::collections::BTreeMap;

use naga::{
    Arena, ArraySize, Expression, Handle, Literal, Module, Override, Span, Type, TypeInner,
};

use crate::core::guard::{Assumed, Bounds, Guard, Place, ScalarType};
use crate::evaluate::{self, Scalar, Value};
use crate::graph::operands;

impl Guard {
    /// The assumptions about overrides, with the data a host needs to set them in `original`, the
    /// author's module. Overrides that it lacks are skipped.
    pub fn constants(&self, original: &Module) -> Vec<Constant<'_>> {
        let assumed = |wanted: &str| {
            let named =
                |a: &&Assumed| matches!(&a.place, Place::Override { name } if name == wanted);
            self.values.iter().find(named)
        };
        let given = |handle: Handle<Override>| {
            let constant = &original.overrides[handle];
            let assumed = assumed(constant.name.as_deref()?)?;
            value(original, constant.ty, assumed.bounds.low)
        };
        let all = original.overrides.iter();
        all.filter_map(|(_, constant)| {
            let name = constant.name.as_deref()?;
            let assumed = assumed(name)?;
            let default = constant.init.and_then(|init| {
                let value = evaluate::constant(original, init, &given).ok()?;
                number(&value)
            });
            Some(Constant {
                assumed,
                key: constant.id.map_or(name.to_owned(), |id| id.to_string()),
                is_default: default.is_some_and(|d| assumed.bounds.contains(d)),
            })
        })
        .collect()
    }
}

/// An assumption about an override.
#[derive(Clone, Debug, PartialEq)]
pub struct Constant<'g> {
    /// The assumption.
    pub assumed: &'g Assumed,
    /// Its key in a pipeline's constants: its `@id`, or else its name.
    pub key: String,
    /// Whether the pipeline uses this value by default, if the other overrides are as assumed.
    pub is_default: bool,
}

/// The guard's type for an override; booleans are 0 and 1. `None` if unsupported.
pub(crate) fn scalar_type(module: &Module, ty: Handle<Type>) -> Option<ScalarType> {
    match module.types[ty].inner.scalar()? {
        naga::Scalar::BOOL => Some(ScalarType::U32),
        scalar => ScalarType::of(scalar),
    }
}

fn literal(module: &Module, ty: Handle<Type>, value: f64) -> Option<Literal> {
    Some(match module.types[ty].inner.scalar()? {
        naga::Scalar::BOOL => Literal::Bool(value != 0.0),
        naga::Scalar::I32 => Literal::I32(value as i32),
        naga::Scalar::U32 => Literal::U32(value as u32),
        naga::Scalar::F32 => Literal::F32(value as f32),
        _ => return None,
    })
}

/// The module with other defaults of its overrides, by `@id` or else by name: the constants that a pipeline sets.
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
pub(crate) fn value(module: &Module, ty: Handle<Type>, number: f64) -> Option<Value> {
    Value::literal(&literal(module, ty, number)?).ok()
}

/// Converts an override's value to a number.
pub(crate) fn number(value: &Value) -> Option<f64> {
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
    let value = evaluate::default_constant::<f32>(module, module.overrides[of].init?).ok()?;
    match value {
        Value::Scalar(Scalar::F32(_)) => None,
        value => number(&value).map(|n| n as i64),
    }
}

/// The overrides that have a default, as assumptions: what a pipeline has that sets none.
pub fn defaults(module: &Module) -> Vec<Assumed> {
    let default = |(_, constant): (Handle<Override>, &Override)| {
        let name = constant.name.clone()?;
        let value = evaluate::default_constant::<f32>(module, constant.init?).ok()?;
        Some(Assumed {
            place: Place::Override { name: name.clone() },
            name,
            ty: scalar_type(module, constant.ty)?,
            bounds: Bounds::one(number(&value)?),
        })
    };
    module.overrides.iter().filter_map(default).collect()
}

/// The defaults of other overrides that depend only on `given` ones.
pub(crate) fn derived(module: &Module, given: &[Assumed]) -> Vec<Assumed> {
    let mut values: BTreeMap<Handle<Override>, Value> = BTreeMap::new();
    let mut out = Vec::new();
    // A default refers to earlier overrides only.
    for (handle, constant) in module.overrides.iter() {
        let name = constant.name.clone().unwrap_or_default();
        let place = Place::Override { name: name.clone() };
        let found = given.iter().find(|a| a.place == place);
        if let Some(assumed) = found {
            let value = value(module, constant.ty, assumed.bounds.low);
            values.extend(value.map(|v| (handle, v)));
            continue;
        }
        let (Some(init), Some(ty)) = (constant.init, scalar_type(module, constant.ty)) else {
            continue;
        };
        let of = overrides_of(module, init);
        if of.is_empty() || name.is_empty() {
            continue;
        }
        let value = |o: Handle<Override>| values.get(&o).cloned();
        let Ok(value) = evaluate::constant(module, init, &value) else {
            continue;
        };
        let Some(number) = number(&value) else {
            continue;
        };
        values.insert(handle, value);
        out.push(Assumed {
            name,
            place,
            ty,
            bounds: Bounds::one(number),
        });
    }
    out
}

/// The overrides that a global expression depends on.
pub fn overrides_of(module: &Module, e: Handle<Expression>) -> Vec<Handle<Override>> {
    match &module.global_expressions[e] {
        Expression::Override(o) => vec![*o],
        other => operands::of_expression(other)
            .into_iter()
            .flat_map(|o| overrides_of(module, o))
            .collect(),
    }
}

/// The module with these values as defaults.
pub(crate) fn resolved(
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
        operands::map_expression(&mut expression, &mut |o| *o = map[o.index()]);
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

/// The module without an override: its uses have the default. `None` if it has no default, or one
/// that depends on other overrides, or if types depend on overrides.
pub fn fixed(module: &Module, of: Handle<Override>) -> Option<Module> {
    let Override { ty, init, .. } = module.overrides[of];
    let none = |_: Handle<Override>| None;
    let value = evaluate::constant::<f32>(module, init?, &none).ok()?;
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
