//! Resolves the types of declarations.

use glsl_lang::ast::{self, ArraySpecifierDimensionData, TypeSpecifierNonArrayData};
use naga::Span;

use super::GlslStage;
use crate::errors::unsupported;
use crate::ty::{GlslMember, Struct, Ty, spelled};
use shader_text::error::{Code, Error};
use shader_text::unsupported;

/// Maximum elements of arrays that are split into variables: varyings and samplers.
pub(super) const APART: u64 = 1 << 10;
/// Maximum members of a struct, nested members included.
const MEMBERS: u64 = 1 << 12;

impl GlslStage<'_> {
    /// The type of `spec` with the array dimensions at the variable's name.
    pub(crate) fn ty(
        &mut self,
        spec: &ast::TypeSpecifier,
        at_name: Option<&ast::ArraySpecifier>,
        place: Option<Span>,
    ) -> Result<Ty, Error> {
        let base = match &spec.ty.content {
            TypeSpecifierNonArrayData::TypeName(name) => {
                let name = name.as_str();
                match self.structs.get(name) {
                    Some(_) => Ty::Struct(name.to_owned()),
                    // The name belongs to an extension or a later version.
                    None => {
                        unsupported::refuse(name, place)?;
                        Ty::named(name)
                    }
                }
            }
            TypeSpecifierNonArrayData::Struct(definition) => self.struct_ty(definition, place)?,
            _ => {
                let name = spelled(&spec.ty);
                unsupported::refuse(&name, place)?;
                Ty::named(&name)
            }
        };
        let inner = self.dimensions(base, spec.array_specifier.as_ref(), place)?;
        self.dimensions(inner, at_name, place)
    }

    fn struct_ty(
        &mut self,
        definition: &ast::StructSpecifier,
        place: Option<Span>,
    ) -> Result<Ty, Error> {
        let mut members = Vec::new();
        for field in &definition.fields {
            members.extend(self.fields(field)?);
        }
        let name = match &definition.name {
            Some(name) => name.as_str().to_owned(),
            None => self.unnamed(&members),
        };
        let count = self.structs.count_of(members.iter().map(|m| &m.ty));
        if count.members > MEMBERS || count.elements > self.unit.array_elements {
            return Err(Error::new(
                Code::TooDeep,
                format!(
                    "`{name}` has {} elements in {} members; the limit is {} in {MEMBERS}",
                    count.elements, count.members, self.unit.array_elements
                ),
            )
            .label_if(place));
        }
        match self.structs.get(&name) {
            Some(old) if !old.has(&members) => {
                let message = format!("two structs are called `{name}`");
                return Err(unsupported(message, place));
            }
            Some(_) => {}
            None => {
                let names = members.iter().map(|m| m.name.clone()).collect();
                self.constants.members.insert(name.clone(), names);
                self.structs.insert(Struct {
                    name: name.clone(),
                    members,
                    in_uniform_block: false,
                    is_hosted: false,
                    tight: false,
                });
                self.structs.mark_small_elements();
            }
        }
        Ok(Ty::Struct(name))
    }

    /// Names an anonymous struct after its members, so that different structs of the two stages get
    /// different names.
    fn unnamed(&self, members: &[GlslMember]) -> String {
        let mut name = "Unnamed".to_owned();
        for member in members {
            let word = member.name.trim_matches('_');
            if name.len() + word.len() < 60 && !word.contains("__") {
                name += "_";
                name += word;
            }
        }
        let taken = |name: &str| self.structs.get(name).is_some_and(|old| !old.has(members));
        let numbered = (2..).map(|i| format!("{name}_{i}"));
        let mut all = std::iter::once(name.clone()).chain(numbered);
        all.find(|n| !taken(n)).unwrap_or(name)
    }

    pub(crate) fn dimensions(
        &self,
        of: Ty,
        array: Option<&ast::ArraySpecifier>,
        place: Option<Span>,
    ) -> Result<Ty, Error> {
        let Some(array) = array else {
            return Ok(of);
        };
        let mut ty = of;
        for dimension in array.dimensions.iter().rev() {
            let length = match &dimension.content {
                ArraySpecifierDimensionData::Unsized => None,
                ArraySpecifierDimensionData::ExplicitlySized(e) => {
                    let length = self.length(e).filter(|length| length.n > 0);
                    let length = length.ok_or_else(|| {
                        unsupported(
                            "the length of this array must be an integer constant above 0",
                            place,
                        )
                    })?;
                    Some(length)
                }
            };
            ty = Ty::Array(Box::new(ty), length);
            // Samplers become separate variables, and other opaque types may.
            let most = match ty.innermost() {
                Ty::Combined(_) | Ty::Opaque(_) => APART,
                _ => self.unit.array_elements,
            };
            self.check_elements(&ty, most, place)?;
        }
        Ok(ty)
    }

    /// Rejects a type with more than `most` elements.
    pub(super) fn check_elements(
        &self,
        ty: &Ty,
        most: u64,
        place: Option<Span>,
    ) -> Result<(), Error> {
        let n = self.structs.count(ty).elements;
        match n > most {
            false => Ok(()),
            true => Err(Error::new(
                Code::TooDeep,
                format!("an array of {n} elements exceeds the limit of {most}"),
            )
            .label_if(place)),
        }
    }
}
