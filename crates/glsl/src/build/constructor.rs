//! Constructors.

use naga::{
    Expression, Handle, Literal, Scalar, ScalarKind, Span, SwizzleComponent, Type, TypeInner,
    VectorSize,
};

use super::types::scalar_of;
use super::{Body, refused};
use crate::tree::Node;
use crate::ty::{Length, Ty};
use shader_text::error::Error;

type Value = Handle<Expression>;

impl<'s> Body<'_, 's> {
    pub(super) fn construct(
        &mut self,
        ty: &Ty,
        parts: &'s [Node],
        span: Span,
    ) -> Result<Value, Error> {
        let mut values = Vec::with_capacity(parts.len());
        for part in parts {
            values.push(self.value(part)?);
        }
        let ty = match ty {
            Ty::Array(of, None) => {
                let length = Length::from(values.len() as u32);
                self.builder
                    .ty(&Ty::Array(of.clone(), Some(length)), span)?
            }
            ty => self.builder.ty(ty, span)?,
        };
        match values[..] {
            [value] => self.of_one(ty, value, span),
            _ => self.of_many(ty, values, span),
        }
    }

    fn compose(
        &mut self,
        ty: Handle<Type>,
        components: Vec<Value>,
        span: Span,
    ) -> Result<Value, Error> {
        self.add(Expression::Compose { ty, components }, span)
    }

    fn part(&mut self, base: Value, index: u32, span: Span) -> Result<Value, Error> {
        self.add(Expression::AccessIndex { base, index }, span)
    }

    fn vector_ty(&mut self, size: VectorSize, scalar: Scalar) -> Handle<Type> {
        self.builder.insert(TypeInner::Vector { size, scalar })
    }

    /// Converts a value's scalars, unless they are of that type.
    fn forced(&mut self, value: Value, to: Scalar, span: Span) -> Result<Value, Error> {
        match scalar_of(self.ty(value)?) {
            Some(from) if from != to => self.cast(value, to, span),
            _ => Ok(value),
        }
    }

    fn of_one(&mut self, ty: Handle<Type>, value: Value, span: Span) -> Result<Value, Error> {
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
            return self.of_bools(scalar, given_size, value, span);
        }
        match to {
            TypeInner::Vector { size, scalar } if given_size.is_none() => {
                let value = self.forced(value, scalar, span)?;
                match self.ty(value)? {
                    TypeInner::Scalar(_) => self.add(Expression::Splat { size, value }, span),
                    _ => self.vector(ty, size, scalar, &[value], span),
                }
            }
            TypeInner::Scalar(scalar) => {
                let mut value = value;
                if matches!(given, TypeInner::Vector { .. } | TypeInner::Matrix { .. }) {
                    value = self.part(value, 0, span)?;
                }
                if matches!(given, TypeInner::Matrix { .. }) {
                    value = self.part(value, 0, span)?;
                }
                self.cast(value, scalar, span)
            }
            TypeInner::Vector { size, scalar } => {
                let value = match given_size == Some(size) {
                    true => value,
                    false => self.resized(size, value, span)?,
                };
                self.cast(value, scalar, span)
            }
            TypeInner::Matrix {
                columns,
                rows,
                scalar,
            } => self.matrix(ty, (columns, rows, scalar), value, span),
            TypeInner::Struct { .. } | TypeInner::Array { .. } => {
                self.of_many(ty, vec![value], span)
            }
            _ => Err(refused("this type cannot be constructed from that", span)),
        }
    }

    /// Numbers of bools. Those of 16 and 64 bits count as 32 bits here.
    fn of_bools(
        &mut self,
        scalar: Scalar,
        size: Option<VectorSize>,
        condition: Value,
        span: Span,
    ) -> Result<Value, Error> {
        let scalar = Scalar { width: 4, ..scalar };
        let (Some(zero), Some(one)) = (Literal::zero(scalar), Literal::one(scalar)) else {
            return Err(refused("this type cannot be constructed from that", span));
        };
        let mut reject = self.add(Expression::Literal(zero), span)?;
        let mut accept = self.add(Expression::Literal(one), span)?;
        reject = self.splatted(reject, size, span)?;
        accept = self.splatted(accept, size, span)?;
        let select = Expression::Select {
            condition,
            accept,
            reject,
        };
        self.add(select, span)
    }

    /// A vector of a scalar. Vectors stay.
    pub(super) fn splatted(
        &mut self,
        value: Value,
        size: Option<VectorSize>,
        span: Span,
    ) -> Result<Value, Error> {
        match (self.ty(value)?, size) {
            (TypeInner::Scalar(_), Some(size)) => self.add(Expression::Splat { size, value }, span),
            _ => Ok(value),
        }
    }

    /// The first components of a vector.
    pub(super) fn resized(
        &mut self,
        size: VectorSize,
        vector: Value,
        span: Span,
    ) -> Result<Value, Error> {
        let swizzle = Expression::Swizzle {
            size,
            vector,
            pattern: SwizzleComponent::XYZW,
        };
        self.add(swizzle, span)
    }

    /// A matrix of a scalar on the diagonal, or of another matrix, filled up with the identity.
    fn matrix(
        &mut self,
        ty: Handle<Type>,
        (columns, rows, scalar): (VectorSize, VectorSize, Scalar),
        value: Value,
        span: Span,
    ) -> Result<Value, Error> {
        let value = self.forced(value, scalar, span)?;
        let given = self.ty(value)?.clone();
        let wrong = || refused("this type cannot be constructed from that", span);
        let zero = Literal::zero(scalar).ok_or_else(wrong)?;
        let one = Literal::one(scalar).ok_or_else(wrong)?;
        let mut components = Vec::new();
        match given {
            TypeInner::Scalar(_) => {
                let column_ty = self.vector_ty(rows, scalar);
                let zero = self.add(Expression::Literal(zero), span)?;
                for c in 0..columns as u32 {
                    let part = |r| if r == c { value } else { zero };
                    let column = (0..rows as u32).map(part).collect();
                    components.push(self.compose(column_ty, column, span)?);
                }
            }
            TypeInner::Matrix {
                columns: given_columns,
                rows: given_rows,
                ..
            } => {
                let zero = self.add(Expression::Literal(zero), span)?;
                let one = self.add(Expression::Literal(one), span)?;
                let column_ty = self.vector_ty(rows, scalar);
                for c in 0..columns as u32 {
                    let identity = |r| if r == c { one } else { zero };
                    if c >= given_columns as u32 {
                        let column = (0..rows as u32).map(identity).collect();
                        components.push(self.compose(column_ty, column, span)?);
                        continue;
                    }
                    let vector = self.part(value, c, span)?;
                    if given_rows as u32 == rows as u32 {
                        components.push(vector);
                        continue;
                    }
                    if given_rows as u32 > rows as u32 {
                        components.push(self.resized(rows, vector, span)?);
                        continue;
                    }
                    let mut column = Vec::new();
                    for r in 0..rows as u32 {
                        column.push(match r < given_rows as u32 {
                            true => self.part(vector, r, span)?,
                            false => identity(r),
                        });
                    }
                    components.push(self.compose(column_ty, column, span)?);
                }
            }
            _ => components = vec![value; columns as usize],
        }
        self.compose(ty, components, span)
    }

    /// A vector of the components of values.
    fn vector(
        &mut self,
        ty: Handle<Type>,
        size: VectorSize,
        scalar: Scalar,
        values: &[Value],
        span: Span,
    ) -> Result<Value, Error> {
        let mut components = Vec::new();
        for value in values {
            let value = self.forced(*value, scalar, span)?;
            if components.len() >= size as usize {
                break;
            }
            match *self.ty(value)? {
                TypeInner::Vector { size, .. } => {
                    for index in 0..size as u32 {
                        components.push(self.part(value, index, span)?);
                    }
                }
                TypeInner::Matrix { rows, columns, .. } => {
                    for c in 0..columns as u32 {
                        let column = self.part(value, c, span)?;
                        for r in 0..rows as u32 {
                            components.push(self.part(column, r, span)?);
                        }
                    }
                }
                _ => components.push(value),
            }
        }
        components.truncate(size as usize);
        self.compose(ty, components, span)
    }

    fn of_many(
        &mut self,
        ty: Handle<Type>,
        values: Vec<Value>,
        span: Span,
    ) -> Result<Value, Error> {
        let types = &self.builder.module.types;
        let wanted: Vec<Option<Scalar>> = match types[ty].inner {
            TypeInner::Vector { size, scalar } => {
                return self.vector(ty, size, scalar, &values, span);
            }
            TypeInner::Matrix { rows, scalar, .. } => {
                return self.matrix_of(ty, rows, scalar, &values, span);
            }
            TypeInner::Array { base, .. } => {
                vec![scalar_of(&types[base].inner); values.len()]
            }
            TypeInner::Struct { ref members, .. } => {
                let members = members.iter();
                members.map(|m| scalar_of(&types[m.ty].inner)).collect()
            }
            _ => return Err(refused("too many values for this constructor", span)),
        };
        let mut components = Vec::new();
        for (value, wanted) in values.into_iter().zip(wanted) {
            components.push(self.widened(value, wanted, span)?);
        }
        self.compose(ty, components, span)
    }

    /// A matrix of components in the order of columns.
    fn matrix_of(
        &mut self,
        ty: Handle<Type>,
        rows: VectorSize,
        scalar: Scalar,
        values: &[Value],
        span: Span,
    ) -> Result<Value, Error> {
        let mut flat = Vec::new();
        for value in values {
            let value = self.forced(*value, scalar, span)?;
            match *self.ty(value)? {
                TypeInner::Vector { size, .. } => {
                    for index in 0..size as u32 {
                        flat.push(self.part(value, index, span)?);
                    }
                }
                _ => flat.push(value),
            }
        }
        let column_ty = self.vector_ty(rows, scalar);
        let mut components = Vec::new();
        for column in flat.chunks(rows as usize) {
            components.push(self.compose(column_ty, column.to_vec(), span)?);
        }
        self.compose(ty, components, span)
    }
}
