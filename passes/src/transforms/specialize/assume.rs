//! Assumptions: known numbers in uniforms, attributes, textures and overrides, by variable.

use std::collections::{BTreeMap, BTreeSet};
use std::rc::Rc;

use naga::{AddressSpace, GlobalVariable, Handle, Module, Override, ScalarKind, TypeInner};

use super::known::{AbstractValue, Scalar, Sources};
use naga_edit::declared::{FinalConstant, LengthConstant};
use naga_interp::interval::Interval;
use naga_interp::overrides;
use preshade_plan::guard::{Assumed, Bounds, Guard, Place, ScalarType};
use preshade_plan::pass::{Facts, Misnamed};
use preshade_plan::program::Program;
use preshade_plan::uniforms::{self, UniformPart, UniformScalar, uniform_scalars};

/// The abstract value of a part of a buffer, from those that `leaf` gives its 32-bit scalars.
fn content(
    part: &UniformPart<'_>,
    leaf: &mut dyn FnMut(&UniformPart<'_>, ScalarType) -> AbstractValue,
) -> AbstractValue {
    if let Some(ty) = part.scalar() {
        return leaf(part, ty);
    }
    let parts = part.parts().map(|inner| content(&inner, leaf));
    match parts.collect::<Vec<_>>() {
        parts if parts.is_empty() => AbstractValue::Unknown,
        parts => AbstractValue::Parts(parts),
    }
}

/// A setting that does not fit the material.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum Unfit {
    /// Not of the form `name=value+name=value`.
    #[error("`{0}` is not `name=number`")]
    Syntax(String),
    #[error("no scalar of a uniform and no override is named `{0}`")]
    Unknown(String),
    /// Several scalars have the name.
    #[error("`{0}` may be {1}: say which, in full")]
    Ambiguous(String, String),
    /// Not a number of the type.
    #[error("`{0}` cannot be {1}")]
    Value(String, String),
    /// A constant that gives the length of an array, and its default.
    #[error("`{0}` gives the length of an array, which stays as long as its default says: {1}")]
    Length(String, String),
    /// A constant whose value the reader of the text had to know, and its default.
    #[error(
        "`{0}` has its default as its value, {1}, because it gives a length or another number that \
         must be known when the text is read: change the default in the text"
    )]
    Final(String, String),
    #[error(
        "`{0}` is a push constant (immediate data), which `specialize` cannot take for known: read \
         it from a uniform buffer or a specialisation constant"
    )]
    Immediate(String),
    #[error("`{0}` is given twice")]
    Twice(String),
}

/// All assumptions, and the abstract values that follow from them.
#[derive(Debug, Default)]
pub(crate) struct Assumptions {
    /// Abstract values refer to these by index.
    pub values: Vec<Assumed>,
    globals: BTreeMap<Handle<GlobalVariable>, AbstractValue>,
    textures: BTreeMap<Handle<GlobalVariable>, AbstractValue>,
    /// Attributes by location, type and component.
    attributes: BTreeMap<(u32, ScalarType, u32), AbstractValue>,
    overrides: BTreeMap<Handle<Override>, AbstractValue>,
}

impl Assumptions {
    /// Combines the constants in `facts` with `settings` (`name=value+name=value`). Settings take
    /// precedence.
    ///
    /// # Errors
    /// A setting does not fit the material.
    pub fn new(
        program: &Program,
        material: &str,
        facts: &Facts,
        settings: Option<&str>,
    ) -> Result<Self, Unfit> {
        let module = program.module();
        let mut values: Vec<Assumed> = match settings {
            Some(settings) => set(program, settings)?,
            None => Vec::new(),
        };
        for constant in facts.constants.iter().filter(|c| c.material == material) {
            let same = |v: &Assumed| (&v.place, v.ty) == (&constant.value.place, constant.value.ty);
            if !values.iter().any(same) {
                values.push(constant.value.clone());
            }
        }
        let derived = preshade_plan::overrides::derived(module, &values);
        values.extend(derived);
        let mut this = Self {
            values,
            ..Self::default()
        };
        // Two variables at one binding may read a word as two types.
        let leaves: BTreeMap<(Place, ScalarType), AbstractValue> = this
            .values
            .iter()
            .enumerate()
            .map(|(i, assumed)| ((assumed.place.clone(), assumed.ty), known(i, assumed)))
            .collect();
        for ((place, ty), known) in &leaves {
            if let Place::Attribute {
                location,
                component,
            } = place
            {
                let at = (*location, *ty, *component);
                this.attributes.insert(at, known.clone());
            }
        }
        for (handle, global) in module.global_variables.iter() {
            let Some(at) = global.binding else { continue };
            if global.space == AddressSpace::Uniform {
                let content = content(&UniformPart::whole(module, global), &mut |part, ty| {
                    let place = Place::Uniform {
                        group: at.group,
                        binding: at.binding,
                        offset: part.offset,
                    };
                    leaves.get(&(place, ty)).cloned().unwrap_or_default()
                });
                if content.is_assumed() {
                    this.globals.insert(handle, content);
                }
            }
            let channel = |channel| {
                let (group, binding) = (at.group, at.binding);
                let place = Place::Texture {
                    group,
                    binding,
                    channel,
                };
                let texel = leaves.get(&(place, ScalarType::F32));
                texel.cloned().unwrap_or_default()
            };
            let texel = AbstractValue::Parts((0..4).map(channel).collect());
            if texel.is_assumed() {
                this.textures.insert(handle, texel);
            }
        }
        for (handle, constant) in module.overrides.iter() {
            let name = constant.name.clone().unwrap_or_default();
            let ty = preshade_plan::overrides::scalar_type(module, constant.ty);
            let known = ty.and_then(|ty| leaves.get(&(Place::Override { name }, ty)));
            if let Some(known) = known {
                let is_bool =
                    module.types[constant.ty].inner.scalar_kind() == Some(ScalarKind::Bool);
                let known = match is_bool {
                    true => super::arithmetic::converted(ScalarKind::Bool, known),
                    false => known.clone(),
                };
                this.overrides.insert(handle, known);
            }
        }
        Ok(this)
    }

    /// The abstract value of a variable's content.
    pub fn content(&self, global: Handle<GlobalVariable>) -> AbstractValue {
        self.globals.get(&global).cloned().unwrap_or_default()
    }

    /// The abstract value of every texel of a texture.
    pub fn texel(&self, global: Handle<GlobalVariable>) -> AbstractValue {
        self.textures.get(&global).cloned().unwrap_or_default()
    }

    /// The abstract value of an override.
    pub fn constant(&self, handle: Handle<Override>) -> AbstractValue {
        self.overrides.get(&handle).cloned().unwrap_or_default()
    }

    /// The abstract value of a scalar or vector attribute.
    pub fn attribute(&self, location: u32, inner: &TypeInner) -> AbstractValue {
        let Some(ty) = inner.scalar().and_then(ScalarType::of) else {
            return AbstractValue::Unknown;
        };
        let component = |i: u32| {
            let known = self.attributes.get(&(location, ty, i));
            known.cloned().unwrap_or_default()
        };
        match inner {
            TypeInner::Scalar(_) => component(0),
            TypeInner::Vector { size, .. } => {
                AbstractValue::Parts((0..*size as u32).map(component).collect()).settled()
            }
            _ => AbstractValue::Unknown,
        }
    }

    /// The overrides with a value, the value, and the index of the assumption.
    pub fn set_overrides(&self) -> impl Iterator<Item = (Handle<Override>, f64, usize)> + '_ {
        self.overrides.iter().filter_map(|(handle, known)| {
            let (_, sources) = known.scalar()?;
            let at = *sources.first()?;
            Some((*handle, self.values.get(at)?.bounds.low, at))
        })
    }

    pub fn guard(&self, used: &BTreeSet<usize>) -> Guard {
        let values = used.iter().filter_map(|i| self.values.get(*i)).cloned();
        Guard {
            values: values.collect(),
        }
        .and(Guard::default())
    }
}

fn known(index: usize, assumed: &Assumed) -> AbstractValue {
    let Bounds { low, high } = assumed.bounds;
    let scalar = match assumed.ty {
        // Either bound may be flushed to 0.
        ScalarType::F32 => {
            let interval = Interval::input(low).or(Interval::input(high));
            Scalar::number(ScalarKind::Float, interval)
        }
        ScalarType::I32 => Scalar::number(ScalarKind::Sint, Interval::new(low, high)),
        ScalarType::U32 => Scalar::number(ScalarKind::Uint, Interval::new(low, high)),
    };
    match scalar {
        Some(scalar) if low <= high => {
            AbstractValue::Scalar(scalar, Rc::new(BTreeSet::from([index])) as Sources)
        }
        _ => AbstractValue::Unknown,
    }
}

/// Splits `name=value+name=value`. A plus without a following `name=` belongs to the number, as in
/// `1e+3`.
fn separate(settings: &str) -> Vec<String> {
    let mut all: Vec<String> = Vec::new();
    for part in settings.split('+') {
        match all.last_mut() {
            Some(last) if !part.contains('=') => *last = format!("{last}+{part}"),
            _ => all.push(part.to_owned()),
        }
    }
    all.retain(|setting| !setting.trim().is_empty());
    all
}

/// The first error in the names and numbers of `settings`.
pub(super) fn misnamed(program: &Program, settings: &str) -> Option<Misnamed> {
    let module = program.module();
    let unfit = set(program, settings).err()?;
    let message = unfit.to_string();
    let (name, known) = match unfit {
        Unfit::Unknown(name) => {
            let scalars = uniform_scalars(module).into_iter().map(|s| s.name);
            let overrides = module.overrides.iter().filter_map(|(_, o)| o.name.clone());
            (name, scalars.chain(overrides).collect())
        }
        Unfit::Syntax(text) => (text, Vec::new()),
        Unfit::Ambiguous(name, _)
        | Unfit::Value(name, _)
        | Unfit::Length(name, _)
        | Unfit::Final(name, _)
        | Unfit::Immediate(name)
        | Unfit::Twice(name) => (name, Vec::new()),
    };
    Some(Misnamed {
        message,
        name,
        known,
    })
}

/// The default of a constant that gives the length of an array.
fn fixed_length(module: &Module, constant: &Override) -> Option<f64> {
    let name = LengthConstant::type_name_of(u32::from(constant.id?));
    let mut types = module.types.iter();
    types.find(|(_, ty)| ty.name.as_ref() == Some(&name))?;
    overrides::number(&naga_interp::default_constant(module, constant.init?).ok()?)
}

/// Whether a path ends in the name of a member, or in several.
fn ends_so(path: &str, name: &str) -> bool {
    path.strip_suffix(name)
        .is_some_and(|rest| rest.ends_with('.'))
}

/// Why nothing can be set that no uniform and no override is named; `None` if it is a constant that
/// has this value anyway.
fn unknown(program: &Program, name: &str, value: f64) -> Option<Unfit> {
    let named = |constant: &&FinalConstant| constant.own == name;
    if let Some(constant) = program.declared().finals.iter().find(named) {
        let default = constant.default;
        return match default.is_some_and(|default| default as f64 == value) {
            true => None,
            false => {
                let default = default.map_or("a number".to_owned(), |n| n.to_string());
                Some(Unfit::Final(name.to_owned(), default))
            }
        };
    }
    let module = program.module();
    let mut is_immediate = false;
    for (_, global) in module.global_variables.iter() {
        if global.space == AddressSpace::Immediate {
            uniforms::list(&UniformPart::whole(module, global), &mut |part| {
                is_immediate |= part.name == name || ends_so(&part.name, name);
            });
        }
    }
    Some(match is_immediate {
        true => Unfit::Immediate(name.to_owned()),
        false => Unfit::Unknown(name.to_owned()),
    })
}

/// The assumptions in `name=value+name=value`. A name is a full path, or a suffix that only one
/// path has.
fn set(program: &Program, settings: &str) -> Result<Vec<Assumed>, Unfit> {
    let module = program.module();
    let scalars = uniform_scalars(module);
    let mut out = Vec::new();
    for setting in separate(settings) {
        let Some((name, value)) = setting.split_once('=') else {
            return Err(Unfit::Syntax(setting));
        };
        let (name, text) = (name.trim(), value.trim());
        let value = match text {
            "true" => 1.0,
            "false" => 0.0,
            text => match text.parse::<f64>() {
                Ok(value) => value,
                Err(_) => return Err(Unfit::Syntax(setting)),
            },
        };
        let whole: Vec<&UniformScalar> = scalars.iter().filter(|s| s.name == name).collect();
        let found = match whole.is_empty() {
            true => scalars.iter().filter(|s| ends_so(&s.name, name)).collect(),
            false => whole,
        };
        let constant = module
            .overrides
            .iter()
            .find(|(_, o)| o.name.as_deref() == Some(name));
        let (place, ty, full) = match (found.as_slice(), constant) {
            ([one], _) => (one.place(), one.ty, one.name.clone()),
            ([], Some((_, o))) => {
                let Some(ty) = preshade_plan::overrides::scalar_type(module, o.ty) else {
                    return Err(Unfit::Value(name.to_owned(), text.to_owned()));
                };
                let is_bool = module.types[o.ty].inner.scalar_kind() == Some(ScalarKind::Bool);
                if is_bool && value != 0.0 && value != 1.0 {
                    return Err(Unfit::Value(name.to_owned(), text.to_owned()));
                }
                let place = Place::Override {
                    name: name.to_owned(),
                };
                (place, ty, name.to_owned())
            }
            ([], None) => match unknown(program, name, value) {
                Some(unfit) => return Err(unfit),
                None => continue,
            },
            (several, _) => {
                let names: Vec<&str> = several.iter().map(|s| s.name.as_str()).collect();
                return Err(Unfit::Ambiguous(name.to_owned(), names.join(" or ")));
            }
        };
        let fits = match ty {
            ScalarType::F32 => (value as f32).is_finite(),
            ScalarType::I32 => value == f64::from(value as i32),
            ScalarType::U32 => value == f64::from(value as u32),
        };
        if !fits {
            return Err(Unfit::Value(full, text.to_owned()));
        }
        if let (Place::Override { .. }, Some((_, constant))) = (&place, constant)
            && let Some(default) = fixed_length(module, constant).filter(|d| *d != value)
        {
            return Err(Unfit::Length(full, default.to_string()));
        }
        let number = match ty {
            ScalarType::F32 => f64::from(value as f32),
            _ => value,
        };
        if out
            .iter()
            .any(|a: &Assumed| (&a.place, a.ty) == (&place, ty))
        {
            return Err(Unfit::Twice(full));
        }
        out.push(Assumed {
            name: full,
            place,
            ty,
            bounds: Bounds::one(number),
        });
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::separate;

    #[test]
    fn a_plus_of_a_number_separates_nothing() {
        let cases: [(&str, &[&str]); 5] = [
            ("a=1e+3", &["a=1e+3"]),
            ("a=1e+3+b.c=+2+d=0", &["a=1e+3", "b.c=+2", "d=0"]),
            ("a=1 + b=2", &["a=1 ", " b=2"]),
            ("a+b=1", &["a", "b=1"]),
            ("", &[]),
        ];
        for (text, expected) in cases {
            assert_eq!(separate(text), expected, "{text}");
        }
    }
}
