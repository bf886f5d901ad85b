//! Converts types and qualifiers of declarations.

use glsl_lang::ast::{
    self, ExprData, InterpolationQualifierData as Interpolation, LayoutQualifierSpecData,
    StorageQualifierData as Storage, TypeQualifierSpecData as Spec,
    TypeSpecifierNonArrayData as Ty,
};
use naga::ShaderStage;

use super::{Result, lacks};

/// Whether it declares a stage output.
pub(super) fn is_output(ty: &ast::FullySpecifiedType) -> bool {
    qualifiers(ty).any(|q| matches!(&**q, Spec::Storage(s) if **s == Storage::Out))
}

pub(super) fn is_constant(ty: &ast::FullySpecifiedType) -> bool {
    qualifiers(ty).any(|q| matches!(&**q, Spec::Storage(s) if **s == Storage::Const))
}

/// The components of a float or a vector of floats.
pub(super) fn components(ty: &ast::TypeSpecifier) -> Option<usize> {
    match *ty.ty {
        Ty::Float => Some(1),
        Ty::Vec2 => Some(2),
        Ty::Vec3 => Some(3),
        Ty::Vec4 => Some(4),
        _ => None,
    }
}

/// The number in `layout(location = ..)`.
pub(super) fn location(ty: &ast::FullySpecifiedType) -> Option<i32> {
    qualifiers(ty).find_map(|q| {
        let Spec::Layout(layout) = &**q else {
            return None;
        };
        layout.ids.iter().find_map(|id| match &**id {
            LayoutQualifierSpecData::Identifier(name, Some(value))
                if name.as_str() == "location" =>
            {
                match ***value {
                    ExprData::IntConst(n) => Some(n),
                    _ => None,
                }
            }
            _ => None,
        })
    })
}

fn qualifiers(ty: &ast::FullySpecifiedType) -> impl Iterator<Item = &ast::TypeQualifierSpec> {
    ty.qualifier.iter().flat_map(|q| &q.qualifiers)
}

/// Converts the qualifiers of a global.
pub(super) fn qualify(
    ty: &mut ast::FullySpecifiedType,
    stage: ShaderStage,
    name: &str,
) -> Result<()> {
    let ty: &mut ast::FullySpecifiedTypeData = ty;
    let Some(qualifier) = &mut ty.qualifier else {
        return Ok(());
    };
    let mut kept = Vec::new();
    for mut spec in std::mem::take(&mut qualifier.qualifiers) {
        match &mut *spec {
            // Locations are bound by name.
            Spec::Layout(_) => continue,
            Spec::Interpolation(how) => match **how {
                Interpolation::Smooth => continue,
                Interpolation::Flat => return lacks(format!("the flat varying `{name}`")),
                Interpolation::NoPerspective => {
                    return lacks(format!("the varying `{name}` without perspective"));
                }
            },
            Spec::Storage(storage) => {
                **storage = match (&**storage, stage) {
                    (Storage::In, ShaderStage::Vertex) => Storage::Attribute,
                    (Storage::In | Storage::Out, _) => Storage::Varying,
                    (Storage::Uniform, _) => Storage::Uniform,
                    (Storage::Const, _) => Storage::Const,
                    (Storage::Centroid, _) => {
                        return lacks(format!("the varying `{name}` at the centroid"));
                    }
                    (_, _) => return lacks(format!("the storage of `{name}`")),
                };
            }
            Spec::Precise => return lacks("precise"),
            Spec::Precision(_) | Spec::Invariant => {}
        }
        kept.push(spec);
    }
    let travels = |q: &ast::TypeQualifierSpec| matches!(&**q, Spec::Storage(s) if matches!(**s, Storage::Attribute | Storage::Varying));
    let is_float = matches!(
        *ty.ty.ty,
        Ty::Float
            | Ty::Vec2
            | Ty::Vec3
            | Ty::Vec4
            | Ty::Mat2
            | Ty::Mat22
            | Ty::Mat3
            | Ty::Mat33
            | Ty::Mat4
            | Ty::Mat44
    );
    if kept.iter().any(travels) && !is_float {
        return lacks(format!("`{name}`, which has no floats"));
    }
    qualifier.qualifiers = kept;
    if qualifier.qualifiers.is_empty() {
        ty.qualifier = None;
    }
    Ok(())
}

/// Converts a type that is no array.
pub(super) fn plain(ty: &mut ast::TypeSpecifier) -> Result<()> {
    if ty.array_specifier.is_some() {
        return lacks("an array as a type");
    }
    non_array(&mut ty.ty)
}

/// The same for a type that may be a constructor.
pub(super) fn non_array(ty: &mut ast::TypeSpecifierNonArray) -> Result<()> {
    let changed = match &**ty {
        Ty::Mat22 => Some(Ty::Mat2),
        Ty::Mat33 => Some(Ty::Mat3),
        Ty::Mat44 => Some(Ty::Mat4),
        Ty::UInt | Ty::UVec2 | Ty::UVec3 | Ty::UVec4 => return lacks("an unsigned integer"),
        Ty::Mat23 | Ty::Mat24 | Ty::Mat32 | Ty::Mat34 | Ty::Mat42 | Ty::Mat43 => {
            return lacks("a matrix that is not square");
        }
        Ty::Void
        | Ty::Bool
        | Ty::Int
        | Ty::Float
        | Ty::Vec2
        | Ty::Vec3
        | Ty::Vec4
        | Ty::BVec2
        | Ty::BVec3
        | Ty::BVec4
        | Ty::IVec2
        | Ty::IVec3
        | Ty::IVec4
        | Ty::Mat2
        | Ty::Mat3
        | Ty::Mat4
        | Ty::Sampler2D
        | Ty::SamplerCube
        | Ty::Struct(_)
        | Ty::TypeName(_) => None,
        other => {
            let words: String = format!("{other:?}")
                .chars()
                .filter(|c| c.is_alphanumeric())
                .collect();
            return lacks(format!("the type {}", words.to_lowercase()));
        }
    };
    if let Some(changed) = changed {
        **ty = changed;
    }
    Ok(())
}

/// The length of a one-dimensional array.
pub(super) fn length(array: Option<&ast::ArraySpecifier>) -> Result<Option<i32>> {
    let Some(array) = array else {
        return Ok(None);
    };
    let [one] = array.dimensions.as_slice() else {
        return lacks("an array of arrays");
    };
    match &**one {
        ast::ArraySpecifierDimensionData::ExplicitlySized(size) => match ***size {
            ExprData::IntConst(n) => Ok(Some(n)),
            _ => lacks("an array whose length is not a number"),
        },
        ast::ArraySpecifierDimensionData::Unsized => lacks("an array without a length"),
    }
}
