//! Type qualifiers: storage, layout, interpolation.

use glsl_lang::ast::{
    self, InterpolationQualifierData, LayoutQualifierSpecData, PrecisionQualifierData,
    StorageQualifierData, TypeQualifierSpecData,
};
use naga::{ConservativeDepth, ShaderStage};
use naga_edit::declared::Precision;

use super::GlslStage;
use crate::errors::unsupported;
use shader_text::error::Error;
use shader_text::unsupported;

/// A variable's storage class.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Storage {
    Const,
    In,
    Out,
    InOut,
    Uniform,
    Buffer,
}

/// The qualifiers of a declaration.
#[derive(Clone, Debug, Default)]
pub(crate) struct Qualifiers {
    pub storage: Option<Storage>,
    /// Whether `const` is among them.
    pub is_const: bool,
    pub layout: Vec<(String, Option<i64>)>,
    /// `flat` or `noperspective`.
    pub interpolation: Option<&'static str>,
    /// `centroid` or `sample`.
    pub sampling: Option<&'static str>,
    pub invariant: bool,
    pub precise: bool,
    /// `readonly` and other memory qualifiers.
    pub memory: Vec<&'static str>,
}

impl Qualifiers {
    /// The value of `key` in the layout qualifier.
    pub(crate) fn number(&self, key: &str) -> Option<u32> {
        let found = self.layout.iter().find(|(k, _)| k == key)?;
        found.1.and_then(|n| u32::try_from(n).ok())
    }

    pub(crate) fn says(&self, key: &str) -> bool {
        self.layout.iter().any(|(k, _)| k == key)
    }

    /// The bound on the written depth. `depth_any`, the default, gives none.
    pub(crate) fn conservative_depth(&self) -> Option<ConservativeDepth> {
        let bounds = [
            ("depth_greater", ConservativeDepth::GreaterEqual),
            ("depth_less", ConservativeDepth::LessEqual),
            ("depth_unchanged", ConservativeDepth::Unchanged),
        ];
        let found = bounds.into_iter().find(|(word, _)| self.says(word));
        found.map(|(_, bound)| bound)
    }
}

impl GlslStage<'_> {
    pub(crate) fn qualifiers(
        &self,
        qualifier: Option<&ast::TypeQualifier>,
    ) -> Result<Qualifiers, Error> {
        use StorageQualifierData as S;
        let mut out = Qualifiers::default();
        let vertex = self.kind == ShaderStage::Vertex;
        for spec in qualifier.iter().flat_map(|q| &q.qualifiers) {
            let place = self.place(spec.span);
            match &spec.content {
                TypeQualifierSpecData::Storage(s) => match &s.content {
                    S::Const => {
                        out.is_const = true;
                        out.storage = out.storage.or(Some(Storage::Const));
                    }
                    S::InOut => out.storage = Some(Storage::InOut),
                    S::In | S::Attribute => out.storage = Some(Storage::In),
                    S::Out => out.storage = Some(Storage::Out),
                    S::Varying if vertex => out.storage = Some(Storage::Out),
                    S::Varying => out.storage = Some(Storage::In),
                    S::Uniform => out.storage = Some(Storage::Uniform),
                    S::Buffer => out.storage = Some(Storage::Buffer),
                    S::Centroid => out.sampling = Some("centroid"),
                    S::Sample => out.sampling = Some("sample"),
                    S::ReadOnly => out.memory.push("readonly"),
                    S::WriteOnly => out.memory.push("writeonly"),
                    // WebGPU has no such hints, and they do not change values.
                    S::Coherent | S::Volatile | S::Restrict => {}
                    S::Shared => {
                        return Err(unsupported(
                            "`shared` variables belong to compute shaders",
                            place,
                        ));
                    }
                    S::Patch => {
                        return Err(unsupported(
                            "`patch` variables belong to tessellation shaders",
                            place,
                        ));
                    }
                    S::Subroutine(_) => unsupported::refuse("subroutine", place)?,
                },
                TypeQualifierSpecData::Layout(layout) => {
                    for id in &layout.ids {
                        if let LayoutQualifierSpecData::Identifier(name, value) = &id.content {
                            unsupported::refuse(name.as_str(), place)?;
                            let value = match value {
                                Some(e) => {
                                    let n = self.fixed_integer(e);
                                    if n.is_none() {
                                        return Err(unsupported(
                                            "a layout's number must be an integer constant",
                                            place,
                                        ));
                                    }
                                    n
                                }
                                None => None,
                            };
                            if name.as_str() == "component" && value != Some(0) {
                                return Err(unsupported(
                                    "`component` packs two variables into one location, which \
                                     WebGPU cannot",
                                    place,
                                ));
                            }
                            out.layout.push((name.as_str().to_owned(), value));
                        }
                    }
                }
                TypeQualifierSpecData::Interpolation(i) => match i.content {
                    InterpolationQualifierData::Smooth => {}
                    InterpolationQualifierData::Flat => out.interpolation = Some("flat"),
                    InterpolationQualifierData::NoPerspective => {
                        out.interpolation = Some("noperspective");
                    }
                },
                TypeQualifierSpecData::Invariant => out.invariant = true,
                TypeQualifierSpecData::Precise => out.precise = true,
                TypeQualifierSpecData::Precision(named) => {
                    self.qualified.borrow_mut().insert(precision(named));
                }
            }
        }
        Ok(out)
    }
}

pub(super) fn precision(named: &ast::PrecisionQualifier) -> Precision {
    match named.content {
        PrecisionQualifierData::High => Precision::High,
        PrecisionQualifierData::Medium => Precision::Medium,
        PrecisionQualifierData::Low => Precision::Low,
    }
}
