//! The numbers in buffers: their names, types and byte offsets (WGSL section 14.4, memory layout).

use naga::{
    AddressSpace, ArraySize, GlobalVariable, Handle, Module, Scalar, Type, TypeInner, VectorSize,
};

use crate::guard::{Place, ScalarType};
use naga_edit::declared::LengthConstant;

/// Length of the longest array whose elements are listed.
const MOST_ELEMENTS: u32 = 64;

/// A part of a value in memory: a member, an element, a column or a component.
#[derive(Clone, Debug)]
pub struct UniformPart<'m> {
    /// Path in the author's words: `hall.lights[1].color.x`.
    pub name: String,
    /// Offset from the start of the buffer, in bytes.
    pub offset: u32,
    /// Whether it is an element of a matrix.
    pub is_of_matrix: bool,
    module: &'m Module,
    kind: Kind<'m>,
}

#[derive(Clone, Debug)]
enum Kind<'m> {
    Type(&'m Type),
    /// A column of a matrix.
    Column(VectorSize, Scalar),
    Scalar(Scalar),
}

impl<'m> UniformPart<'m> {
    pub fn whole(module: &'m Module, global: &GlobalVariable) -> Self {
        Self {
            name: global.name.clone().unwrap_or_default(),
            offset: 0,
            is_of_matrix: false,
            module,
            kind: Kind::Type(&module.types[global.ty]),
        }
    }

    /// Its type, if it is a 32-bit number.
    pub fn scalar(&self) -> Option<ScalarType> {
        match self.kind {
            Kind::Scalar(scalar) => ScalarType::of(scalar),
            Kind::Type(ty) => match ty.inner {
                TypeInner::Scalar(scalar) => ScalarType::of(scalar),
                _ => None,
            },
            Kind::Column(..) => None,
        }
    }

    /// Number of its parts: 0 for a scalar, and for an array whose length is a pipeline's or a draw's.
    pub fn len(&self) -> u32 {
        match &self.kind {
            Kind::Scalar(_) => 0,
            Kind::Column(size, _) => *size as u32,
            Kind::Type(ty) => match &ty.inner {
                TypeInner::Vector { size, .. } => *size as u32,
                TypeInner::Matrix { columns, .. } => *columns as u32,
                TypeInner::Struct { members, .. } => members.len() as u32,
                TypeInner::Array {
                    size: ArraySize::Constant(count),
                    ..
                } if !LengthConstant::is_of(ty) => count.get(),
                _ => 0,
            },
        }
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    pub fn part(&self, index: u32) -> Option<Self> {
        if index >= self.len() {
            return None;
        }
        let component = || ["x", "y", "z", "w"].get(index as usize);
        let sub = |name: String, offset: u32, kind| Self {
            name,
            offset: self.offset + offset,
            is_of_matrix: self.is_of_matrix,
            module: self.module,
            kind,
        };
        let name = &self.name;
        let of_vector = |scalar| {
            let name = format!("{name}.{}", component()?);
            Some(sub(name, 4 * index, Kind::Scalar(scalar)))
        };
        let of_type = |ty: Handle<Type>| Kind::Type(&self.module.types[ty]);
        match self.kind {
            Kind::Scalar(_) => None,
            Kind::Column(_, scalar) => of_vector(scalar),
            Kind::Type(ty) => match &ty.inner {
                TypeInner::Vector { scalar, .. } => of_vector(*scalar),
                TypeInner::Matrix { rows, scalar, .. } => {
                    // A column of three is padded to four.
                    let stride = if *rows as u32 == 2 { 8 } else { 16 };
                    let name = format!("{name}[{index}]");
                    Some(Self {
                        is_of_matrix: true,
                        ..sub(name, index * stride, Kind::Column(*rows, *scalar))
                    })
                }
                TypeInner::Array { base, stride, .. } => {
                    let name = format!("{name}[{index}]");
                    Some(sub(name, index * stride, of_type(*base)))
                }
                TypeInner::Struct { members, .. } => {
                    let member = members.get(index as usize)?;
                    let own = member.name.as_deref().unwrap_or("?");
                    // An unnamed GLSL block has no prefix.
                    let name = match name.is_empty() {
                        true => own.to_owned(),
                        false => format!("{name}.{own}"),
                    };
                    Some(sub(name, member.offset, of_type(member.ty)))
                }
                _ => None,
            },
        }
    }

    /// Its parts, unless it is an array of more than 64 elements.
    pub fn parts(&self) -> impl Iterator<Item = Self> + '_ {
        let is_array = |ty: &Type| matches!(ty.inner, TypeInner::Array { .. });
        let is_long =
            self.len() > MOST_ELEMENTS && matches!(self.kind, Kind::Type(ty) if is_array(ty));
        let count = if is_long { 0 } else { self.len() };
        (0..count).filter_map(|i| self.part(i))
    }
}

/// A scalar of a uniform buffer.
#[derive(Clone, Debug, PartialEq)]
pub struct UniformScalar {
    /// Path in the author's words: `hall.lights[1].color.x`.
    pub name: String,
    pub group: u32,
    pub binding: u32,
    /// Byte offset in the binding.
    pub offset: u32,
    pub ty: ScalarType,
    /// Whether it is an element of a matrix.
    pub is_of_matrix: bool,
}

impl UniformScalar {
    /// The place that assumptions about it name.
    pub fn place(&self) -> Place {
        Place::Uniform {
            group: self.group,
            binding: self.binding,
            offset: self.offset,
        }
    }

    /// The scalar of a uniform buffer at a path of constant indices; `None` if there is none.
    pub fn at(module: &Module, global: Handle<GlobalVariable>, path: &[u32]) -> Option<Self> {
        let global = &module.global_variables[global];
        let whole = UniformPart::whole(module, global);
        let part = path.iter().try_fold(whole, |part, i| part.part(*i))?;
        Self::of(global, &part)
    }

    fn of(global: &GlobalVariable, part: &UniformPart<'_>) -> Option<Self> {
        let (AddressSpace::Uniform, Some(at)) = (global.space, global.binding) else {
            return None;
        };
        Some(Self {
            name: part.name.clone(),
            group: at.group,
            binding: at.binding,
            offset: part.offset,
            ty: part.scalar()?,
            is_of_matrix: part.is_of_matrix,
        })
    }
}

/// Every scalar of every uniform buffer, except in arrays of more than 64 elements.
pub fn uniform_scalars(module: &Module) -> Vec<UniformScalar> {
    let mut out = Vec::new();
    for (_, global) in module.global_variables.iter() {
        list(&UniformPart::whole(module, global), &mut |part| {
            out.extend(UniformScalar::of(global, part));
        });
    }
    out
}

/// Visits the scalars of a part.
pub fn list(part: &UniformPart<'_>, leaf: &mut dyn FnMut(&UniformPart<'_>)) {
    if part.scalar().is_some() {
        leaf(part);
    }
    for inner in part.parts() {
        list(&inner, leaf);
    }
}
