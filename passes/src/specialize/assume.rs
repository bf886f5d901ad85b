//! What may be assumed: numbers of uniforms, attributes, textures and overrides, by the variable they are read from.

use std::collections::{BTreeMap, BTreeSet};
use std::rc::Rc;

use naga::{
    AddressSpace, ArraySize, GlobalVariable, Handle, Module, Override, ScalarKind, Type, TypeInner,
};

use super::known::{Known, Scalar, Sources};
use crate::guard::{Assumed, Bounds, Guard, Place, ScalarType};
use crate::pass::Facts;

/// Longest array whose elements are looked at one by one.
const MOST_ELEMENTS: u32 = 64;

/// A scalar of a uniform buffer.
#[derive(Clone, Debug, PartialEq)]
pub struct UniformScalar {
    /// The author's name for it: `hall.lights[1].color.x`.
    pub name: String,
    /// `@group`.
    pub group: u32,
    /// `@binding`.
    pub binding: u32,
    /// Where it begins in the binding, in bytes.
    pub offset: u32,
    /// Its type.
    pub ty: ScalarType,
    /// It is an element of a matrix.
    pub is_of_matrix: bool,
}

impl UniformScalar {
    /// Where an assumption about it says that it comes from.
    pub fn place(&self) -> Place {
        Place::Uniform {
            group: self.group,
            binding: self.binding,
            offset: self.offset,
        }
    }
}

/// Every scalar of every uniform buffer of a module, but for those of arrays of more than 64 elements.
pub fn uniform_scalars(module: &Module) -> Vec<UniformScalar> {
    let mut out = Vec::new();
    for (_, global) in module.global_variables.iter() {
        let (AddressSpace::Uniform, Some(at)) = (global.space, global.binding) else {
            continue;
        };
        let name = global.name.clone().unwrap_or_default();
        leaves(
            module,
            global.ty,
            name,
            0,
            &mut |name, offset, ty, is_of_matrix| {
                out.push(UniformScalar {
                    name,
                    group: at.group,
                    binding: at.binding,
                    offset,
                    ty,
                    is_of_matrix,
                });
            },
        );
    }
    out
}

fn leaves(
    module: &Module,
    ty: Handle<Type>,
    name: String,
    offset: u32,
    leaf: &mut dyn FnMut(String, u32, ScalarType, bool),
) {
    let component = |i: usize| ["x", "y", "z", "w"][i.min(3)];
    match &module.types[ty].inner {
        TypeInner::Scalar(s) => {
            if let Some(ty) = scalar_type(*s) {
                leaf(name, offset, ty, false);
            }
        }
        TypeInner::Vector { size, scalar } => {
            if let Some(ty) = scalar_type(*scalar) {
                for i in 0..*size as usize {
                    leaf(
                        format!("{name}.{}", component(i)),
                        offset + 4 * i as u32,
                        ty,
                        false,
                    );
                }
            }
        }
        TypeInner::Matrix {
            columns,
            rows,
            scalar,
        } => {
            let stride = if *rows as u32 == 2 { 8 } else { 16 };
            if let Some(ty) = scalar_type(*scalar) {
                for c in 0..*columns as u32 {
                    for r in 0..*rows as usize {
                        let at = offset + c * stride + 4 * r as u32;
                        leaf(format!("{name}[{c}].{}", component(r)), at, ty, true);
                    }
                }
            }
        }
        TypeInner::Array {
            base,
            size: ArraySize::Constant(count),
            stride,
        } if count.get() <= MOST_ELEMENTS => {
            for i in 0..count.get() {
                let at = offset + i * stride;
                leaves(module, *base, format!("{name}[{i}]"), at, leaf);
            }
        }
        TypeInner::Struct { members, .. } => {
            for member in members {
                let own = member.name.as_deref().unwrap_or("?");
                // A GLSL block without an instance has no name of its own.
                let path = match name.is_empty() {
                    true => own.to_owned(),
                    false => format!("{name}.{own}"),
                };
                leaves(module, member.ty, path, offset + member.offset, leaf);
            }
        }
        _ => {}
    }
}

fn scalar_type(scalar: naga::Scalar) -> Option<ScalarType> {
    match (scalar.kind, scalar.width) {
        (ScalarKind::Float, 4) => Some(ScalarType::F32),
        (ScalarKind::Sint, 4) => Some(ScalarType::I32),
        (ScalarKind::Uint, 4) => Some(ScalarType::U32),
        _ => None,
    }
}

/// A setting that fits nothing.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unfit {
    /// Not of the form `name=value+name=value`.
    #[error("`{0}` is not `name=number`")]
    Syntax(String),
    /// Nothing is named so.
    #[error("no scalar of a uniform and no override is named `{0}`")]
    Unknown(String),
    /// Several are named so.
    #[error("`{0}` may be {1}: say which, in full")]
    Ambiguous(String, String),
    /// Not a number of the type.
    #[error("`{0}` cannot be {1}")]
    Value(String, String),
    /// Two numbers for one.
    #[error("`{0}` is given twice")]
    Twice(String),
}

/// All assumptions, and what they make known.
#[derive(Debug, Default)]
pub struct Assumptions {
    /// Known things point into these.
    pub values: Vec<Assumed>,
    globals: BTreeMap<Handle<GlobalVariable>, Known>,
    textures: BTreeMap<Handle<GlobalVariable>, Known>,
    attributes: BTreeMap<u32, BTreeMap<u32, Known>>,
    overrides: BTreeMap<Handle<Override>, Known>,
}

impl Assumptions {
    /// What `facts` say of a material's constants, and what `settings` (`name=value+name=value`) say, which goes before.
    ///
    /// # Errors
    /// A setting that fits nothing.
    pub fn new(
        module: &Module,
        material: &str,
        facts: &Facts,
        settings: Option<&str>,
    ) -> Result<Self, Unfit> {
        let mut values: Vec<Assumed> = match settings {
            Some(settings) => set(module, settings)?,
            None => Vec::new(),
        };
        for constant in facts.constants.iter().filter(|c| c.material == material) {
            if !values.iter().any(|v| v.place == constant.value.place) {
                values.push(constant.value.clone());
            }
        }
        let mut this = Self {
            values,
            ..Self::default()
        };
        let leaves: BTreeMap<Place, Known> = this
            .values
            .iter()
            .enumerate()
            .map(|(i, assumed)| (assumed.place.clone(), known(i, assumed)))
            .collect();
        for (place, known) in &leaves {
            if let Place::Attribute {
                location,
                component,
            } = place
            {
                let components = this.attributes.entry(*location).or_default();
                components.insert(*component, known.clone());
            }
        }
        for (handle, global) in module.global_variables.iter() {
            let Some(at) = global.binding else { continue };
            if global.space == AddressSpace::Uniform {
                let leaf = |offset| {
                    let (group, binding) = (at.group, at.binding);
                    let place = Place::Uniform {
                        group,
                        binding,
                        offset,
                    };
                    leaves.get(&place).cloned().unwrap_or_default()
                };
                let content = tree(module, global.ty, 0, &leaf);
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
                leaves.get(&place).cloned().unwrap_or_default()
            };
            let texel = Known::Parts((0..4).map(channel).collect());
            if texel.is_assumed() {
                this.textures.insert(handle, texel);
            }
        }
        for (handle, constant) in module.overrides.iter() {
            let name = constant.name.clone().unwrap_or_default();
            if let Some(known) = leaves.get(&Place::Override { name }) {
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

    /// What is known of the content of a variable.
    pub fn content(&self, global: Handle<GlobalVariable>) -> Known {
        self.globals.get(&global).cloned().unwrap_or_default()
    }

    /// What is known of every texel of a texture.
    pub fn texel(&self, global: Handle<GlobalVariable>) -> Known {
        self.textures.get(&global).cloned().unwrap_or_default()
    }

    /// What is known of an override.
    pub fn constant(&self, handle: Handle<Override>) -> Known {
        self.overrides.get(&handle).cloned().unwrap_or_default()
    }

    /// What is known of a vertex attribute of so many components; of one alone where it is a scalar.
    pub fn attribute(&self, location: u32, components: Option<u32>) -> Known {
        let Some(of) = self.attributes.get(&location) else {
            return Known::Unknown;
        };
        let component = |i: u32| of.get(&i).cloned().unwrap_or_default();
        match components {
            None => component(0),
            Some(count) => Known::Parts((0..count).map(component).collect()),
        }
    }

    /// The overrides with a value, and the value.
    pub fn set_overrides(&self) -> impl Iterator<Item = (Handle<Override>, f64)> + '_ {
        self.overrides.iter().filter_map(|(handle, known)| {
            let (_, sources) = known.scalar()?;
            let value = self.values.get(*sources.first()?)?;
            Some((*handle, value.bounds.low))
        })
    }

    /// The guard of what rests on these.
    pub fn guard(&self, used: &BTreeSet<usize>) -> Guard {
        let values = used.iter().filter_map(|i| self.values.get(*i)).cloned();
        Guard {
            values: values.collect(),
        }
        .and(Guard::default())
    }
}

fn known(index: usize, assumed: &Assumed) -> Known {
    let Bounds { low, high } = assumed.bounds;
    let scalar = match assumed.ty {
        ScalarType::F32 if low == high => Scalar::float(low),
        ScalarType::F32 => {
            // Either end may be flushed to 0.
            let (a, b) = (Scalar::float(low), Scalar::float(high));
            match (a, b) {
                (Scalar::Float(a, _), Scalar::Float(_, b)) => Scalar::Float(a, b),
                _ => return Known::Unknown,
            }
        }
        ScalarType::I32 => Scalar::Sint(low as i64, high as i64),
        ScalarType::U32 => Scalar::Uint(low as i64, high as i64),
    };
    let is_finite = low.is_finite() && high.is_finite() && low <= high;
    match is_finite {
        true => Known::Scalar(scalar, Rc::new(BTreeSet::from([index])) as Sources),
        false => Known::Unknown,
    }
}

/// What is known of a value of a type in memory, scalar by scalar.
fn tree(module: &Module, ty: Handle<Type>, offset: u32, leaf: &dyn Fn(u32) -> Known) -> Known {
    let vector =
        |count: u32, offset: u32| Known::Parts((0..count).map(|i| leaf(offset + 4 * i)).collect());
    match &module.types[ty].inner {
        TypeInner::Scalar(_) => leaf(offset),
        TypeInner::Vector { size, .. } => vector(*size as u32, offset),
        TypeInner::Matrix { columns, rows, .. } => {
            let stride = if *rows as u32 == 2 { 8 } else { 16 };
            let column = |c| vector(*rows as u32, offset + c * stride);
            Known::Parts((0..*columns as u32).map(column).collect())
        }
        TypeInner::Array {
            base,
            size: ArraySize::Constant(count),
            stride,
        } if count.get() <= MOST_ELEMENTS => {
            let element = |i| tree(module, *base, offset + i * stride, leaf);
            Known::Parts((0..count.get()).map(element).collect())
        }
        TypeInner::Struct { members, .. } => {
            let member = |m: &naga::StructMember| tree(module, m.ty, offset + m.offset, leaf);
            Known::Parts(members.iter().map(member).collect())
        }
        _ => Known::Unknown,
    }
}

/// The assumptions that `name=value+name=value` spells. A name is a whole path, or the end of one that is the only such.
fn set(module: &Module, settings: &str) -> Result<Vec<Assumed>, Unfit> {
    let scalars = uniform_scalars(module);
    let mut out = Vec::new();
    for setting in settings.split('+').filter(|s| !s.trim().is_empty()) {
        let Some((name, value)) = setting.split_once('=') else {
            return Err(Unfit::Syntax(setting.to_owned()));
        };
        let (name, text) = (name.trim(), value.trim());
        let Ok(value) = text.parse::<f64>() else {
            return Err(Unfit::Syntax(setting.to_owned()));
        };
        let ends_so = |path: &str| {
            path.strip_suffix(name)
                .is_some_and(|rest| rest.ends_with('.'))
        };
        let whole: Vec<&UniformScalar> = scalars.iter().filter(|s| s.name == name).collect();
        let found = match whole.is_empty() {
            true => scalars.iter().filter(|s| ends_so(&s.name)).collect(),
            false => whole,
        };
        let constant = module
            .overrides
            .iter()
            .find(|(_, o)| o.name.as_deref() == Some(name));
        let (place, ty, full) = match (found.as_slice(), constant) {
            ([one], _) => (one.place(), one.ty, one.name.clone()),
            ([], Some((_, o))) => {
                let ty = match module.types[o.ty].inner.scalar_kind() {
                    Some(ScalarKind::Float) => ScalarType::F32,
                    Some(ScalarKind::Sint) => ScalarType::I32,
                    _ => ScalarType::U32,
                };
                let place = Place::Override {
                    name: name.to_owned(),
                };
                (place, ty, name.to_owned())
            }
            ([], None) => return Err(Unfit::Unknown(name.to_owned())),
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
        let number = match ty {
            ScalarType::F32 => f64::from(value as f32),
            _ => value,
        };
        if out.iter().any(|a: &Assumed| a.place == place) {
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
