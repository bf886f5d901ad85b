//! Pairs of resources of two programs: `light.view_proj=camera.view_proj`.
//!
//! A program that draws the same material from another view has other bindings. A mapping states
//! that its variable, member or attribute `theirs` has the value that `ours` has in the program of
//! reference.

use std::fmt;
use std::str::FromStr;

use naga::{ArraySize, GlobalVariable, Handle, Module, Type, TypeInner};

/// The text `theirs=ours`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mapping {
    /// The variable, member or attribute of the other program.
    pub theirs: Path,
    /// The same of the program of reference.
    pub ours: Path,
}

/// A variable, or a member of one: `camera`, `camera.view_proj`, `lights[2].colour`. `GROUP:BINDING`
/// names a variable too, for modules without names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Path {
    /// The variable's name, or its group and binding.
    pub variable: String,
    /// Members by name, elements by number.
    pub members: Vec<String>,
}

/// A text that is no mapping or path.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{text}`: expected {expected}")]
pub struct Malformed {
    pub text: String,
    /// The form it should have.
    pub expected: &'static str,
}

impl FromStr for Mapping {
    type Err = Malformed;

    fn from_str(text: &str) -> Result<Self, Malformed> {
        let (theirs, ours) = text.split_once('=').ok_or_else(|| Malformed {
            text: text.to_owned(),
            expected: "THEIRS=OURS, `light.view_proj=camera.view_proj` say",
        })?;
        Ok(Self {
            theirs: theirs.parse()?,
            ours: ours.parse()?,
        })
    }
}

/// A mapping that may have a product of matrices on one side:
/// `light.space=camera.proj*camera.view`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Equation {
    /// The part of the other program, or factors from left to right.
    pub theirs: Vec<Path>,
    /// The same of the program of reference.
    pub ours: Vec<Path>,
}

impl Equation {
    /// The mapping, if neither side is a product.
    pub fn plain(&self) -> Option<Mapping> {
        match (&self.theirs[..], &self.ours[..]) {
            ([theirs], [ours]) => Some(Mapping {
                theirs: theirs.clone(),
                ours: ours.clone(),
            }),
            _ => None,
        }
    }
}

impl FromStr for Equation {
    type Err = Malformed;

    fn from_str(text: &str) -> Result<Self, Malformed> {
        let malformed = |expected| Malformed {
            text: text.to_owned(),
            expected,
        };
        let sides = text.split_once('=');
        let (theirs, ours) = sides.ok_or_else(|| {
            malformed("THEIRS=OURS, `light.view_proj=camera.view_proj` say, or A*B for one of them")
        })?;
        let factors = |side: &str| side.split('*').map(Path::from_str).collect();
        let (theirs, ours): (Result<Vec<_>, _>, Result<Vec<_>, _>) =
            (factors(theirs), factors(ours));
        let (theirs, ours) = (theirs?, ours?);
        match theirs.len() > 1 && ours.len() > 1 {
            true => Err(malformed(
                "a product on one side, and one matrix on the other",
            )),
            false => Ok(Self { theirs, ours }),
        }
    }
}

impl fmt::Display for Equation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let side = |paths: &[Path]| {
            let paths: Vec<String> = paths.iter().map(Path::to_string).collect();
            paths.join("*")
        };
        write!(f, "{}={}", side(&self.theirs), side(&self.ours))
    }
}

impl FromStr for Path {
    type Err = Malformed;

    fn from_str(text: &str) -> Result<Self, Malformed> {
        // `a[2].b` is `a.2.b`.
        let plain = text.trim().replace('[', ".").replace(']', "");
        let mut words = plain.split('.').map(str::trim).map(str::to_owned);
        let is_word = |word: &String| {
            !word.is_empty()
                && word
                    .chars()
                    .all(|c| c.is_alphanumeric() || matches!(c, '_' | ':' | '$'))
        };
        let variable = words.next().unwrap_or_default();
        let members: Vec<String> = words.collect();
        match is_word(&variable) && members.iter().all(is_word) {
            true => Ok(Self { variable, members }),
            false => Err(Malformed {
                text: text.to_owned(),
                expected: "a name or VARIABLE.MEMBER",
            }),
        }
    }
}

impl fmt::Display for Path {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.variable)?;
        for member in &self.members {
            match member.starts_with(|c: char| c.is_ascii_digit()) {
                true => write!(f, "[{member}]")?,
                false => write!(f, ".{member}")?,
            }
        }
        Ok(())
    }
}

impl fmt::Display for Mapping {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}={}", self.theirs, self.ours)
    }
}

/// A part of a module's variable.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MappedPlace {
    pub global: Handle<GlobalVariable>,
    /// Indices of members and elements, outermost first.
    pub steps: Vec<usize>,
    pub ty: Handle<Type>,
}

/// A name that a module lacks.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("there is no `{name}`; there are: {}", known.join(", "))]
pub struct Unknown {
    pub name: String,
    /// The names in its place.
    pub known: Vec<String>,
}

impl Path {
    /// The part of a module that it names.
    ///
    /// # Errors
    ///
    /// The module has no such variable or member.
    pub fn resolve(&self, module: &Module) -> Result<MappedPlace, Unknown> {
        if let Some(whole) = self.loose(module) {
            return whole.resolve(module);
        }
        let global = self.global(module).ok_or_else(|| Unknown {
            name: self.variable.clone(),
            known: module
                .global_variables
                .iter()
                .filter(|(_, g)| g.binding.is_some())
                .map(|(_, g)| g.name.clone().unwrap_or_default())
                .collect(),
        })?;
        let mut place = MappedPlace {
            global,
            steps: Vec::new(),
            ty: module.global_variables[global].ty,
        };
        for (i, name) in self.members.iter().enumerate() {
            let (step, ty) = step(module, place.ty, name).ok_or_else(|| {
                let until = Self {
                    variable: self.variable.clone(),
                    members: self.members[..=i].to_vec(),
                };
                Unknown {
                    name: until.to_string(),
                    known: members(module, place.ty)
                        .iter()
                        .map(|m| m.0.clone())
                        .collect(),
                }
            })?;
            place.steps.push(step);
            place.ty = ty;
        }
        Ok(place)
    }

    /// The path with its variable, if it begins with a member that one variable alone has: GLSL's
    /// uniforms outside of blocks are members of one variable.
    fn loose(&self, module: &Module) -> Option<Self> {
        if self.global(module).is_some() {
            return None;
        }
        let mut found = module.global_variables.iter().filter(|(_, g)| {
            let is_bound = g.binding.is_some() && g.name.is_some();
            is_bound && members(module, g.ty).iter().any(|m| m.0 == self.variable)
        });
        let (_, variable) = found.next()?;
        found.next().is_none().then(|| Self {
            variable: variable.name.clone().unwrap_or_default(),
            members: [std::slice::from_ref(&self.variable), &self.members[..]].concat(),
        })
    }

    fn global(&self, module: &Module) -> Option<Handle<GlobalVariable>> {
        let mut globals = module.global_variables.iter();
        if let Some((group, binding)) = self.variable.split_once(':') {
            let at = (group.parse().ok()?, binding.parse().ok()?);
            let is_it = |g: &GlobalVariable| g.binding.is_some_and(|b| (b.group, b.binding) == at);
            return globals.find(|(_, g)| is_it(g)).map(|(handle, _)| handle);
        }
        let is_it = |g: &GlobalVariable| g.name.as_deref() == Some(&self.variable);
        globals.find(|(_, g)| is_it(g)).map(|(handle, _)| handle)
    }
}

/// A member or element by name or number, and its type.
fn step(module: &Module, ty: Handle<Type>, name: &str) -> Option<(usize, Handle<Type>)> {
    match &module.types[ty].inner {
        TypeInner::Array { base, size, .. } => {
            let index: usize = name.parse().ok()?;
            let is_within = match size {
                ArraySize::Constant(count) => index < count.get() as usize,
                _ => true,
            };
            is_within.then_some((index, *base))
        }
        _ => {
            let members = members(module, ty);
            let index = members.iter().position(|m| m.0 == name);
            let index = index.or_else(|| name.parse().ok().filter(|i| *i < members.len()))?;
            Some((index, members[index].1))
        }
    }
}

/// The members of a struct: names, a number for one without a name, and types. Empty for other types.
pub fn members(module: &Module, ty: Handle<Type>) -> Vec<(String, Handle<Type>)> {
    let TypeInner::Struct { members, .. } = &module.types[ty].inner else {
        return Vec::new();
    };
    let name = |i: usize, name: &Option<String>| name.clone().unwrap_or_else(|| i.to_string());
    let members = members.iter().enumerate();
    members.map(|(i, m)| (name(i, &m.name), m.ty)).collect()
}

/// The name of a part of a variable.
pub fn name_of(module: &Module, global: Handle<GlobalVariable>, steps: &[usize]) -> Path {
    let variable = &module.global_variables[global];
    let mut path = Path {
        variable: match (&variable.name, &variable.binding) {
            (Some(name), _) => name.clone(),
            (None, Some(at)) => format!("{}:{}", at.group, at.binding),
            (None, None) => "?".to_owned(),
        },
        members: Vec::new(),
    };
    let mut ty = variable.ty;
    for index in steps {
        let of = members(module, ty);
        match (&module.types[ty].inner, of.get(*index)) {
            (_, Some((name, member))) => {
                path.members.push(name.clone());
                ty = *member;
            }
            (TypeInner::Array { base, .. }, _) => {
                path.members.push(index.to_string());
                ty = *base;
            }
            _ => break,
        }
    }
    path
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    const TEXT: &str = "struct Light { view: mat4x4<f32>, at: array<vec4<f32>, 2> }
        @group(1) @binding(2) var<uniform> light: Light;";

    #[test]
    fn names_lead_to_parts_and_back() {
        let module = naga::front::wgsl::parse_str(TEXT).unwrap();
        for text in ["light", "light.view", "light.at[1]"] {
            let path: Path = text.parse().unwrap();
            let place = path.resolve(&module).unwrap();
            assert_eq!(
                name_of(&module, place.global, &place.steps).to_string(),
                text
            );
        }
        let numbered: Path = "1:2.at.0".parse().unwrap();
        assert_eq!(numbered.resolve(&module).unwrap().steps, [1, 0]);
        let member: Path = "view".parse().unwrap();
        assert_eq!(member.resolve(&module).unwrap().steps, [0]);
    }

    #[test]
    fn what_is_not_there_is_told() {
        let module = naga::front::wgsl::parse_str(TEXT).unwrap();
        let told = |text: &str| text.parse::<Path>().unwrap().resolve(&module).unwrap_err();
        assert_eq!(
            told("lamp").to_string(),
            "there is no `lamp`; there are: light"
        );
        let member = "there is no `light.eye`; there are: view, at";
        assert_eq!(told("light.eye").to_string(), member);
        assert_eq!(told("light.at[2]").known, Vec::<String>::new());
    }

    #[test]
    fn a_mapping_has_two_sides() {
        let mapping: Mapping = "light.view = camera.view".parse().unwrap();
        assert_eq!(mapping.to_string(), "light.view=camera.view");
        assert!("light.view".parse::<Mapping>().is_err());
        assert!("light..view=a".parse::<Mapping>().is_err());
        assert!("=a".parse::<Mapping>().is_err());
    }

    #[test]
    fn one_side_of_an_equation_is_a_product() {
        for text in ["light.space=proj*camera.view", "p*v*m=mvp", "a=b"] {
            let equation: Equation = text.parse().unwrap();
            assert_eq!(equation.to_string(), text);
            assert_eq!(equation.plain().is_some(), text == "a=b");
        }
        for text in ["a*b=c*d", "a=b*", "*b=c", "a*b"] {
            assert!(text.parse::<Equation>().is_err(), "{text}");
        }
    }
}
