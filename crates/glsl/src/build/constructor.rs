//! Constructors.

use naga::{
    Expression, Handle, Literal, Scalar, ScalarKind, SwizzleComponent, Type, TypeInner, VectorSize,
};

use super::types::scalar_of;
use super::{Body, Value};
use crate::tree::Node;
use crate::ty::{Length, Ty};
use shader_text::error::Error;

impl<'s> Body<'_, 's> {
    pub(super) fn construct(&mut self, ty: &Ty, parts: &'s [Node]) -> Result<Value, Error> {
        let mut values = Vec::with_capacity(parts.len());
        for part in parts {
            values.push(self.value(part)?);
        }
        let ty = match ty {
            Ty::Array(of, None) => {
                let length = Length::from(values.len() as u32);
                self.glsl_ty(&Ty::Array(of.clone(), Some(length)))?
            }
            ty => self.glsl_ty(ty)?,
        };
        match values[..] {
            [value] => self.of_one(ty, value),
            _ => self.of_many(ty, values),
        }
    }

    /// Converts a value's scalars, unless they have this type already.
    fn forced(&mut self, value: Value, to: Scalar) -> Result<Value, Error> {
        match scalar_of(self.ty(value)?) {
            Some(from) if from != to => self.cast(value, to),
            _ => Ok(value),
        }
    }

    fn of_one(&mut self, ty: Handle<Type>, value: Value) -> Result<Value, Error> {
        let given = self.ty(value)?.clone();
        let to = self.builder.module.types[ty].inner.clone();
        let given_size = match given {
            TypeInner::Vector { size, .. } => Some(size),
            _ => None,
        };
        let is_bool = |scalar: Option<Scalar>| scalar.is_some_and(|s| s.kind == ScalarKind::Bool);
        if let Some(scalar) = to.scalar()
            && is_bool(given.scalar())
            && scalar.kind != ScalarKind::Bool
        {
            return self.of_bools(scalar, given_size, value);
        }
        match to {
            TypeInner::Vector { size, scalar } if given_size.is_none() => {
                let value = self.forced(value, scalar)?;
                match self.ty(value)? {
                    TypeInner::Scalar(_) => self.splat(size, value),
                    _ => self.vector(ty, (size, scalar), &[value]),
                }
            }
            TypeInner::Scalar(scalar) => {
                let mut value = value;
                if matches!(given, TypeInner::Vector { .. } | TypeInner::Matrix { .. }) {
                    value = self.part(value, 0)?;
                }
                if matches!(given, TypeInner::Matrix { .. }) {
                    value = self.part(value, 0)?;
                }
                self.cast(value, scalar)
            }
            TypeInner::Vector { size, scalar } => {
                let value = match given_size == Some(size) {
                    true => value,
                    false => self.resized(size, value)?,
                };
                self.cast(value, scalar)
            }
            TypeInner::Matrix {
                columns,
                rows,
                scalar,
            } => self.matrix(ty, (columns, rows, scalar), value),
            TypeInner::Struct { .. } | TypeInner::Array { .. } => self.of_many(ty, vec![value]),
            _ => Err(self.refused("this type cannot be constructed from that")),
        }
    }

    /// Converts bools to numbers. 16- and 64-bit types count as 32 bits here.
    fn of_bools(
        &mut self,
        scalar: Scalar,
        size: Option<VectorSize>,
        condition: Value,
    ) -> Result<Value, Error> {
        let scalar = Scalar { width: 4, ..scalar };
        let (Some(zero), Some(one)) = (Literal::zero(scalar), Literal::one(scalar)) else {
            return Err(self.refused("this type cannot be constructed from that"));
        };
        let mut reject = self.literal(zero)?;
        let mut accept = self.literal(one)?;
        reject = self.splatted(reject, size)?;
        accept = self.splatted(accept, size)?;
        let select = Expression::Select {
            condition,
            accept,
            reject,
        };
        self.add(select)
    }

    /// A vector with a scalar in all components. Vectors stay unchanged.
    pub(super) fn splatted(
        &mut self,
        value: Value,
        size: Option<VectorSize>,
    ) -> Result<Value, Error> {
        match (self.ty(value)?, size) {
            (TypeInner::Scalar(_), Some(size)) => self.splat(size, value),
            _ => Ok(value),
        }
    }

    /// The first components of a vector.
    pub(super) fn resized(&mut self, size: VectorSize, vector: Value) -> Result<Value, Error> {
        let swizzle = Expression::Swizzle {
            size,
            vector,
            pattern: SwizzleComponent::XYZW,
        };
        self.add(swizzle)
    }

    /// A matrix with a scalar on the diagonal, or a resized matrix filled up with the identity.
    fn matrix(
        &mut self,
        ty: Handle<Type>,
        (columns, rows, scalar): (VectorSize, VectorSize, Scalar),
        value: Value,
    ) -> Result<Value, Error> {
        let value = self.forced(value, scalar)?;
        let given = self.ty(value)?.clone();
        let wrong = || self.refused("this type cannot be constructed from that");
        let zero = Literal::zero(scalar).ok_or_else(wrong)?;
        let one = Literal::one(scalar).ok_or_else(wrong)?;
        let mut components = Vec::new();
        match given {
            TypeInner::Scalar(_) => {
                let column_ty = self.vector_ty(rows, scalar);
                let zero = self.literal(zero)?;
                for c in 0..columns as u32 {
                    let part = |r| if r == c { value } else { zero };
                    let column = (0..rows as u32).map(part).collect();
                    components.push(self.compose(column_ty, column)?);
                }
            }
            TypeInner::Matrix {
                columns: given_columns,
                rows: given_rows,
                ..
            } => {
                let zero = self.literal(zero)?;
                let one = self.literal(one)?;
                let column_ty = self.vector_ty(rows, scalar);
                for c in 0..columns as u32 {
                    let identity = |r| if r == c { one } else { zero };
                    if c >= given_columns as u32 {
                        let column = (0..rows as u32).map(identity).collect();
                        components.push(self.compose(column_ty, column)?);
                        continue;
                    }
                    let vector = self.part(value, c)?;
                    if given_rows as u32 == rows as u32 {
                        components.push(vector);
                        continue;
                    }
                    if given_rows as u32 > rows as u32 {
                        components.push(self.resized(rows, vector)?);
                        continue;
                    }
                    let mut column = Vec::new();
                    for r in 0..rows as u32 {
                        column.push(match r < given_rows as u32 {
                            true => self.part(vector, r)?,
                            false => identity(r),
                        });
                    }
                    components.push(self.compose(column_ty, column)?);
                }
            }
            _ => components = vec![value; columns as usize],
        }
        self.compose(ty, components)
    }

    /// A vector of all components of the values.
    fn vector(
        &mut self,
        ty: Handle<Type>,
        (size, scalar): (VectorSize, Scalar),
        values: &[Value],
    ) -> Result<Value, Error> {
        let components = self.scalars(values, scalar, size as usize)?;
        self.compose(ty, components)
    }

    /// The first components of all values, as scalars of a type.
    fn scalars(
        &mut self,
        values: &[Value],
        scalar: Scalar,
        most: usize,
    ) -> Result<Vec<Value>, Error> {
        let mut components = Vec::new();
        for value in values {
            let value = self.forced(*value, scalar)?;
            if components.len() >= most {
                break;
            }
            match *self.ty(value)? {
                TypeInner::Vector { size, .. } => {
                    components.extend(self.parts(value, size as u32)?);
                }
                TypeInner::Matrix { rows, columns, .. } => {
                    for column in self.parts(value, columns as u32)? {
                        components.extend(self.parts(column, rows as u32)?);
                    }
                }
                _ => components.push(value),
            }
        }
        components.truncate(most);
        Ok(components)
    }

    fn of_many(&mut self, ty: Handle<Type>, values: Vec<Value>) -> Result<Value, Error> {
        match self.builder.module.types[ty].inner {
            TypeInner::Vector { size, scalar } => self.vector(ty, (size, scalar), &values),
            // By columns.
            TypeInner::Matrix { rows, scalar, .. } => {
                let flat = self.scalars(&values, scalar, usize::MAX)?;
                let column_ty = self.vector_ty(rows, scalar);
                let columns = flat.chunks(rows as usize);
                let columns = columns.map(|column| self.compose(column_ty, column.to_vec()));
                let columns = columns.collect::<Result<_, _>>()?;
                self.compose(ty, columns)
            }
            TypeInner::Array { .. } | TypeInner::Struct { .. } => self.compose(ty, values),
            _ => Err(self.refused("too many values for this constructor")),
        }
    }
}
