//! Operators. The IR's take no matrices, or vectors and scalars, where GLSL's do.

use naga::{
    BinaryOperator as O, Expression, Handle, Literal, RelationalFunction, Scalar, Span, TypeInner,
    UnaryOperator, VectorSize,
};

use super::types::{power, scalar_of};
use super::{Body, refused};
use crate::tree::Node;
use shader_text::error::Error;

/// A matrix.
#[derive(Clone, Copy)]
struct Matrix {
    columns: VectorSize,
    rows: VectorSize,
    scalar: Scalar,
}

/// The shape of an operand.
#[derive(Clone, Copy)]
enum Shape {
    Scalar,
    Vector(VectorSize),
    Matrix(Matrix),
    Other,
}

impl Shape {
    fn of(ty: &TypeInner) -> Self {
        match *ty {
            TypeInner::Scalar(_) => Self::Scalar,
            TypeInner::Vector { size, .. } => Self::Vector(size),
            TypeInner::Matrix {
                columns,
                rows,
                scalar,
            } => Self::Matrix(Matrix {
                columns,
                rows,
                scalar,
            }),
            _ => Self::Other,
        }
    }
}

impl<'s> Body<'_, 's> {
    pub(super) fn unary(
        &mut self,
        op: UnaryOperator,
        expr: Handle<Expression>,
        span: Span,
    ) -> Result<Handle<Expression>, Error> {
        let TypeInner::Matrix { scalar, .. } = *self.ty(expr)? else {
            return self.add(Expression::Unary { op, expr }, span);
        };
        let minus_one = Literal::minus_one(scalar)
            .ok_or_else(|| refused("this operator does not accept values of these types", span))?;
        let left = self.add(Expression::Literal(minus_one), span)?;
        let product = Expression::Binary {
            op: O::Multiply,
            left,
            right: expr,
        };
        self.add(product, span)
    }

    pub(super) fn binary(
        &mut self,
        op: O,
        mut left: Handle<Expression>,
        mut right: Handle<Expression>,
        span: Span,
    ) -> Result<Handle<Expression>, Error> {
        let [from, to] = [left, right].map(|e| self.ty(e).map(scalar_of));
        if let (Some(a), Some(b)) = (from?, to?)
            && let (Some(x), Some(y)) = (power(a), power(b))
        {
            match op {
                O::ShiftLeft | O::ShiftRight if y < 1 => {
                    right = self.cast(right, Scalar::U32, span)?;
                }
                O::ShiftLeft | O::ShiftRight => {}
                _ if x < y => left = self.cast(left, b, span)?,
                _ if x > y => right = self.cast(right, a, span)?,
                _ => {}
            }
        }
        let [a, b] = [left, right].map(|e| self.ty(e).map(Shape::of));
        let splats = matches!(
            op,
            O::Add | O::Subtract | O::Divide | O::And | O::ExclusiveOr | O::InclusiveOr
        );
        let shifts = matches!(op, O::ShiftLeft | O::ShiftRight);
        let by_column = matches!(op, O::Divide | O::Add | O::Subtract);
        match (a?, b?) {
            (Shape::Matrix(a), Shape::Matrix(_)) if op == O::Divide => {
                return self.columns(a, op, (left, true), (right, true), span);
            }
            (Shape::Vector(_), Shape::Vector(_)) if matches!(op, O::Equal | O::NotEqual) => {
                let argument = self.add(Expression::Binary { op, left, right }, span)?;
                let fun = match op {
                    O::Equal => RelationalFunction::All,
                    _ => RelationalFunction::Any,
                };
                return self.add(Expression::Relational { fun, argument }, span);
            }
            (Shape::Vector(size), Shape::Scalar) if splats || shifts => {
                right = self.add(Expression::Splat { size, value: right }, span)?;
            }
            (Shape::Scalar, Shape::Vector(size)) if splats => {
                left = self.add(Expression::Splat { size, value: left }, span)?;
            }
            (Shape::Scalar, Shape::Matrix(of)) if by_column => {
                let size = of.rows;
                let splat = self.add(Expression::Splat { size, value: left }, span)?;
                return self.columns(of, op, (splat, false), (right, true), span);
            }
            (Shape::Matrix(of), Shape::Scalar) if by_column => {
                let size = of.rows;
                let splat = self.add(Expression::Splat { size, value: right }, span)?;
                return self.columns(of, op, (left, true), (splat, false), span);
            }
            _ => {}
        }
        self.add(Expression::Binary { op, left, right }, span)
    }

    /// A matrix of operations by column. An operand is a matrix or a vector that all columns have.
    fn columns(
        &mut self,
        of: Matrix,
        op: O,
        left: (Handle<Expression>, bool),
        right: (Handle<Expression>, bool),
        span: Span,
    ) -> Result<Handle<Expression>, Error> {
        let mut components = Vec::new();
        for index in 0..of.columns as u32 {
            let mut column = |(base, is_matrix)| match is_matrix {
                true => self.add(Expression::AccessIndex { base, index }, span),
                false => Ok(base),
            };
            let (left, right) = (column(left)?, column(right)?);
            components.push(self.add(Expression::Binary { op, left, right }, span)?);
        }
        let ty = self.builder.insert(TypeInner::Matrix {
            columns: of.columns,
            rows: of.rows,
            scalar: of.scalar,
        });
        self.add(Expression::Compose { ty, components }, span)
    }

    /// `x++` and its like.
    pub(super) fn step(
        &mut self,
        op: O,
        postfix: bool,
        of: &'s Node,
        span: Span,
    ) -> Result<Handle<Expression>, Error> {
        let pointer = self.target(of)?;
        let left = match self.expression(pointer) {
            Expression::Swizzle { .. } => pointer,
            _ => self.add(Expression::Load { pointer }, span)?,
        };
        let ty = self.ty(left)?.clone();
        let one = scalar_of(&ty).and_then(Literal::one).ok_or_else(|| {
            let text = "only numbers, vectors and matrices can be incremented or decremented";
            refused(text, span)
        })?;
        let mut right = self.add(Expression::Literal(one), span)?;
        match ty {
            TypeInner::Vector { size, .. } => {
                right = self.add(Expression::Splat { size, value: right }, span)?;
            }
            TypeInner::Matrix { columns, rows, .. } => {
                let size = rows;
                right = self.add(Expression::Splat { size, value: right }, span)?;
                let ty = self.builder.insert(ty);
                let components = vec![right; columns as usize];
                right = self.add(Expression::Compose { ty, components }, span)?;
            }
            _ => {}
        }
        let value = self.add(Expression::Binary { op, left, right }, span)?;
        self.store(pointer, value, span)?;
        Ok(if postfix { left } else { value })
    }
}
