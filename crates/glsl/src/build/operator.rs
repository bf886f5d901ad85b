//! Operators. GLSL's accept matrices, and vectors with scalars, where those of the IR do not.

use naga::{
    BinaryOperator as O, Expression, Literal, RelationalFunction, Scalar, ScalarKind, TypeInner,
    UnaryOperator, VectorSize,
};

use super::types::scalar_of;
use super::{Body, Value};
use crate::tree::Node;
use shader_text::error::Error;

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
    pub(super) fn unary(&mut self, op: UnaryOperator, expr: Value) -> Result<Value, Error> {
        let TypeInner::Matrix { scalar, .. } = *self.ty(expr)? else {
            return self.add(Expression::Unary { op, expr });
        };
        let minus_one = Literal::minus_one(scalar)
            .ok_or_else(|| self.refused("this operator does not accept values of these types"))?;
        let left = self.literal(minus_one)?;
        let product = Expression::Binary {
            op: O::Multiply,
            left,
            right: expr,
        };
        self.add(product)
    }

    pub(super) fn binary(
        &mut self,
        op: O,
        mut left: Value,
        mut right: Value,
    ) -> Result<Value, Error> {
        let shifts = matches!(op, O::ShiftLeft | O::ShiftRight);
        if shifts && self.ty(right)?.scalar_kind() == Some(ScalarKind::Sint) {
            right = self.cast(right, Scalar::U32)?;
        }
        let [a, b] = [left, right].map(|e| self.ty(e).map(Shape::of));
        let splats = matches!(
            op,
            O::Add | O::Subtract | O::Divide | O::And | O::ExclusiveOr | O::InclusiveOr
        );
        let by_column = matches!(op, O::Divide | O::Add | O::Subtract);
        match (a?, b?) {
            (Shape::Matrix(a), Shape::Matrix(_)) if op == O::Divide => {
                return self.columns(a, op, (left, true), (right, true));
            }
            (Shape::Vector(_), Shape::Vector(_)) if matches!(op, O::Equal | O::NotEqual) => {
                let argument = self.binary_of(op, left, right)?;
                let fun = match op {
                    O::Equal => RelationalFunction::All,
                    _ => RelationalFunction::Any,
                };
                return self.add(Expression::Relational { fun, argument });
            }
            (Shape::Vector(size), Shape::Scalar) if splats || shifts => {
                right = self.splat(size, right)?;
            }
            (Shape::Scalar, Shape::Vector(size)) if splats => {
                left = self.splat(size, left)?;
            }
            (Shape::Scalar, Shape::Matrix(of)) if by_column => {
                let size = of.rows;
                let splat = self.splat(size, left)?;
                return self.columns(of, op, (splat, false), (right, true));
            }
            (Shape::Matrix(of), Shape::Scalar) if by_column => {
                let size = of.rows;
                let splat = self.splat(size, right)?;
                return self.columns(of, op, (left, true), (splat, false));
            }
            _ => {}
        }
        self.binary_of(op, left, right)
    }

    /// Applies an operation column by column. An operand is a matrix, or a vector that is used for
    /// all columns.
    fn columns(
        &mut self,
        of: Matrix,
        op: O,
        left: (Value, bool),
        right: (Value, bool),
    ) -> Result<Value, Error> {
        let mut components = Vec::new();
        for index in 0..of.columns as u32 {
            let mut column = |(base, is_matrix)| match is_matrix {
                true => self.part(base, index),
                false => Ok(base),
            };
            let (left, right) = (column(left)?, column(right)?);
            components.push(self.binary_of(op, left, right)?);
        }
        let ty = self.builder.insert(TypeInner::Matrix {
            columns: of.columns,
            rows: of.rows,
            scalar: of.scalar,
        });
        self.compose(ty, components)
    }

    /// `x++` and its like.
    pub(super) fn step(&mut self, op: O, postfix: bool, of: &'s Node) -> Result<Value, Error> {
        let pointer = self.target(of)?;
        let left = match self.expression(pointer) {
            Expression::Swizzle { .. } => pointer,
            _ => self.load(pointer)?,
        };
        let ty = self.ty(left)?.clone();
        let one = scalar_of(&ty).and_then(Literal::one).ok_or_else(|| {
            let text = "only numbers, vectors and matrices can be incremented or decremented";
            self.refused(text)
        })?;
        let mut right = self.literal(one)?;
        match ty {
            TypeInner::Vector { size, .. } => {
                right = self.splat(size, right)?;
            }
            TypeInner::Matrix { columns, rows, .. } => {
                let size = rows;
                right = self.splat(size, right)?;
                let ty = self.builder.insert(ty);
                let components = vec![right; columns as usize];
                right = self.compose(ty, components)?;
            }
            _ => {}
        }
        let value = self.binary_of(op, left, right)?;
        self.store(pointer, value)?;
        Ok(if postfix { left } else { value })
    }
}
