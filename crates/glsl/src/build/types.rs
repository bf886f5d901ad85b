//! Types of the IR, and their layout in blocks.

use std::num::NonZeroU32;

use naga::proc::{Alignment, TypeLayout};
use naga::{
    ArraySize, Handle, ImageClass, ImageDimension, Scalar, ScalarKind, Span, StorageAccess,
    StorageFormat, StructMember, Type, TypeInner, VectorSize,
};

use super::{Builder, WRONG_TYPE, refused};
use crate::errors::wrong;
use crate::layout::Rules;
use crate::tree::{HandleTy, Member};
use crate::ty::{Component, Ty};
use shader_text::error::Error;

pub(super) fn size(n: u8) -> VectorSize {
    match n {
        2 => VectorSize::Bi,
        3 => VectorSize::Tri,
        _ => VectorSize::Quad,
    }
}

pub(super) fn scalar(component: Component) -> Scalar {
    match component {
        Component::Bool => Scalar::BOOL,
        Component::Int => Scalar::I32,
        Component::Uint => Scalar::U32,
        Component::Half => Scalar::F16,
        Component::Float => Scalar::F32,
        Component::Double => Scalar::F64,
    }
}

/// The scalar type of a number's components.
pub(super) fn scalar_of(ty: &TypeInner) -> Option<Scalar> {
    match *ty {
        TypeInner::Scalar(scalar)
        | TypeInner::Vector { scalar, .. }
        | TypeInner::ValuePointer { scalar, .. }
        | TypeInner::Matrix { scalar, .. } => Some(scalar),
        _ => None,
    }
}

/// A type with its alignment and size in a block.
struct Placed {
    ty: Handle<Type>,
    align: Alignment,
    size: u32,
}

impl<'s> Builder<'s> {
    pub(super) fn insert(&mut self, inner: TypeInner) -> Handle<Type> {
        let ty = Type { name: None, inner };
        self.module.types.insert(ty, Span::UNDEFINED)
    }

    pub(super) fn ty(&mut self, ty: &Ty, span: Span) -> Result<Handle<Type>, Error> {
        let inner = match ty {
            Ty::Scalar(kind) => TypeInner::Scalar(scalar(*kind)),
            Ty::Vector(kind, n) => TypeInner::Vector {
                size: size(*n),
                scalar: scalar(*kind),
            },
            Ty::Matrix(kind, columns, rows) => TypeInner::Matrix {
                columns: size(*columns),
                rows: size(*rows),
                scalar: scalar(*kind),
            },
            Ty::Array(of, length) => {
                let base = self.ty(of, span)?;
                let size = match length {
                    None => ArraySize::Dynamic,
                    Some(length) => array_size(length.n, span)?,
                };
                return self.array(base, size, span);
            }
            Ty::Struct(name) => {
                let known = self.structs.get(name.as_str()).copied();
                return known.ok_or_else(|| {
                    wrong(
                        format!("there is no type `{name}`"),
                        span.is_defined().then_some(span),
                    )
                });
            }
            Ty::Opaque(name) | Ty::Combined(name) => {
                return self.handle(&HandleTy::plain(name), None, StorageAccess::empty(), span);
            }
            Ty::Void => return Err(refused(WRONG_TYPE, span)),
        };
        Ok(self.insert(inner))
    }

    /// An array of unpadded elements.
    fn array(
        &mut self,
        base: Handle<Type>,
        size: ArraySize,
        span: Span,
    ) -> Result<Handle<Type>, Error> {
        let laid_out = self.layouter.update(self.module.to_ctx());
        laid_out.map_err(|_| refused(WRONG_TYPE, span))?;
        let stride = self.layouter[base].to_stride();
        Ok(self.insert(TypeInner::Array { base, size, stride }))
    }

    /// A texture, sampler or image.
    pub(super) fn handle(
        &mut self,
        ty: &HandleTy,
        format: Option<StorageFormat>,
        access: StorageAccess,
        span: Span,
    ) -> Result<Handle<Type>, Error> {
        let name = ty.name.as_str();
        if name == "sampler" || name == "samplerShadow" {
            let comparison = name == "samplerShadow" || ty.compares;
            return Ok(self.insert(TypeInner::Sampler { comparison }));
        }
        let unknown = || {
            wrong(
                format!("there is no type `{name}`"),
                span.is_defined().then_some(span),
            )
        };
        let (kind, rest) = match name.as_bytes().first() {
            Some(b'u') => (ScalarKind::Uint, &name[1..]),
            Some(b'i') if !name.starts_with("image") => (ScalarKind::Sint, &name[1..]),
            _ => (ScalarKind::Float, name),
        };
        let image = rest.strip_prefix("image");
        let shape = image.or_else(|| rest.strip_prefix("texture"));
        let (dim, arrayed, multi) = match shape.ok_or_else(unknown)? {
            "1D" => (ImageDimension::D1, false, false),
            "1DArray" => (ImageDimension::D1, true, false),
            "2D" => (ImageDimension::D2, false, false),
            "2DArray" => (ImageDimension::D2, true, false),
            "3D" => (ImageDimension::D3, false, false),
            "2DMS" if image.is_none() => (ImageDimension::D2, false, true),
            "2DMSArray" if image.is_none() => (ImageDimension::D2, true, true),
            "Cube" if image.is_none() => (ImageDimension::Cube, false, false),
            "CubeArray" if image.is_none() => (ImageDimension::Cube, true, false),
            _ => return Err(unknown()),
        };
        let class = match image {
            Some(_) => ImageClass::Storage {
                format: format.unwrap_or(StorageFormat::R8Uint),
                access,
            },
            None if ty.compares => ImageClass::Depth { multi },
            None => ImageClass::Sampled { kind, multi },
        };
        Ok(self.insert(TypeInner::Image {
            dim,
            arrayed,
            class,
        }))
    }

    /// Creates the structs of the stage.
    pub(super) fn structs(&mut self) -> Result<(), Error> {
        for of in &self.stage.structs {
            let handle = self.struct_ty(&of.name, &of.members, of.rules)?;
            self.structs.insert(&of.name, handle);
        }
        Ok(())
    }

    /// A struct or block with the offsets of its members. `rules`: `None` for a struct that no block
    /// contains.
    pub(super) fn struct_ty(
        &mut self,
        name: &str,
        members: &[Member],
        rules: Option<Rules>,
    ) -> Result<Handle<Type>, Error> {
        let mut all = Vec::new();
        for member in members {
            let ty = self.ty(&member.ty, member.span)?;
            all.push((Some(member.name.clone()), ty, member.span));
        }
        Ok(self.placed_struct(Some(name.to_owned()), all, rules)?.ty)
    }

    fn placed_struct(
        &mut self,
        name: Option<String>,
        members: Vec<(Option<String>, Handle<Type>, Span)>,
        rules: Option<Rules>,
    ) -> Result<Placed, Error> {
        let mut out = Vec::new();
        let (mut end, mut align) = (0, Alignment::ONE);
        for (name, ty, span) in members {
            let placed = self.placed(ty, rules, span)?;
            end = placed.align.round_up(end);
            align = align.max(placed.align);
            out.push(StructMember {
                name,
                ty: placed.ty,
                binding: None,
                offset: end,
            });
            end = end.saturating_add(placed.size);
        }
        let size = align.round_up(end);
        let inner = TypeInner::Struct {
            members: out,
            span: size,
        };
        let ty = Type { name, inner };
        let ty = self.module.types.insert(ty, Span::UNDEFINED);
        Ok(Placed { ty, align, size })
    }

    /// A type with its layout in a block (OpenGL 4.6, 7.6.2.2), except that structs are not aligned
    /// to 16 bytes.
    fn placed(
        &mut self,
        ty: Handle<Type>,
        rules: Option<Rules>,
        span: Span,
    ) -> Result<Placed, Error> {
        let Some(by) = rules else {
            let laid_out = self.layouter.update(self.module.to_ctx());
            laid_out.map_err(|_| refused(WRONG_TYPE, span))?;
            let TypeLayout { size, alignment } = self.layouter[ty];
            return Ok(Placed {
                ty,
                align: alignment,
                size,
            });
        };
        let is_tight = by == Rules::Std430;
        let (align, size) = match self.module.types[ty].inner {
            TypeInner::Scalar(scalar) => {
                (Alignment::from_width(scalar.width), u32::from(scalar.width))
            }
            TypeInner::Vector { size, scalar } => (
                Alignment::from(size) * Alignment::from_width(scalar.width),
                size as u32 * u32::from(scalar.width),
            ),
            TypeInner::Matrix {
                columns,
                rows,
                scalar,
            } => {
                let mut align = Alignment::from(rows) * Alignment::from_width(scalar.width);
                if !is_tight {
                    align = align.max(Alignment::MIN_UNIFORM);
                    if rows == VectorSize::Bi && scalar.width < 8 {
                        let columns = columns as u8;
                        let message = format!("a mat{columns}x2 is not supported in this block");
                        return Err(refused(&message, span));
                    }
                }
                (align, align * columns as u32)
            }
            TypeInner::Array { base, size, .. } => {
                let of = self.placed(base, rules, span)?;
                let least = if is_tight {
                    Alignment::ONE
                } else {
                    Alignment::MIN_UNIFORM
                };
                let align = of.align.max(least);
                let stride = align.round_up(of.size);
                let length = match size {
                    ArraySize::Constant(n) => n.get(),
                    _ => 1,
                };
                let ty = self.insert(TypeInner::Array {
                    base: of.ty,
                    size,
                    stride,
                });
                let size = length.saturating_mul(stride);
                return Ok(Placed { ty, align, size });
            }
            TypeInner::Struct { ref members, .. } => {
                let members = members.iter();
                let members = members.map(|m| (m.name.clone(), m.ty, span)).collect();
                let name = self.module.types[ty].name.clone();
                return self.placed_struct(name, members, rules);
            }
            _ => return Err(refused("this type cannot be in a block", span)),
        };
        Ok(Placed { ty, align, size })
    }
}

pub(super) fn array_size(n: u32, span: Span) -> Result<ArraySize, Error> {
    match NonZeroU32::new(n) {
        Some(n) => Ok(ArraySize::Constant(n)),
        None => Err(refused("an array needs at least one element", span)),
    }
}
