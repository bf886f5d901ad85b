//! Values of pipeline-overridable constants as assumptions of a guard.

use std::collections::BTreeMap;

use naga::{Handle, Module, Override, Type};

use crate::guard::{Assumed, Bounds, Guard, Place, ScalarType};
use naga_interp::Value;
use naga_interp::overrides::{number, overrides_of, value};

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
                let value = naga_interp::constant(original, init, &given).ok()?;
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
    pub assumed: &'g Assumed,
    /// Its key in a pipeline's constants: its `@id`, or else its name.
    pub key: String,
    /// Whether the pipeline uses this value by default, if the other overrides are as assumed.
    pub is_default: bool,
}

/// The guard's type for an override; booleans are 0 and 1. `None` if unsupported.
pub fn scalar_type(module: &Module, ty: Handle<Type>) -> Option<ScalarType> {
    match module.types[ty].inner.scalar()? {
        naga::Scalar::BOOL => Some(ScalarType::U32),
        scalar => ScalarType::of(scalar),
    }
}

/// The overrides that have a default, as assumptions: the values of a pipeline that sets none.
pub fn defaults(module: &Module) -> Vec<Assumed> {
    let default = |(_, constant): (Handle<Override>, &Override)| {
        let name = constant.name.clone()?;
        let value = naga_interp::default_constant::<f32>(module, constant.init?).ok()?;
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
pub fn derived(module: &Module, given: &[Assumed]) -> Vec<Assumed> {
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
        let Ok(value) = naga_interp::constant(module, init, &value) else {
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
