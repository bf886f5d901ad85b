//! Calls of GLSL's functions. `resolve` checks the types of their arguments.

use naga::{
    Barrier, BinaryOperator as O, Expression, GatherMode, Handle, Literal, MathFunction as F,
    RelationalFunction, Scalar, ScalarKind, Span, Statement, TypeInner, UnaryOperator, VectorSize,
};

use super::{Body, refused};
use crate::functions::{self, Meaning};
use crate::operations::Subgroup;
use crate::tree::Node;
use crate::ty::Ty;
use shader_text::error::Error;

type Value = Handle<Expression>;

impl<'s> Body<'_, 's> {
    pub(super) fn built_in_call(
        &mut self,
        name: &str,
        arguments: &'s [Node],
        span: Span,
    ) -> Result<Option<Value>, Error> {
        if ["texture", "texel", "image"]
            .iter()
            .any(|w| name.starts_with(w))
        {
            return self.texture_call(name, arguments, span);
        }
        if name == "barrier" {
            let barrier = Statement::ControlBarrier(Barrier::all());
            self.writer.statement(barrier, span);
            return Ok(None);
        }
        let mut values = Vec::with_capacity(arguments.len());
        for argument in arguments {
            values.push(self.value(argument)?);
        }
        self.built_in(name, values, span).map(Some)
    }

    pub(super) fn math(&mut self, fun: F, values: &[Value], span: Span) -> Result<Value, Error> {
        let at = |i: usize| values.get(i).copied();
        let Some(arg) = at(0) else {
            return Err(refused("an argument is missing", span));
        };
        let math = Expression::Math {
            fun,
            arg,
            arg1: at(1),
            arg2: at(2),
            arg3: at(3),
        };
        self.add(math, span)
    }

    fn built_in(&mut self, name: &str, mut values: Vec<Value>, span: Span) -> Result<Value, Error> {
        let Some(first) = values.first().copied() else {
            return Err(refused("an argument is missing", span));
        };
        let bits = |kind| Expression::As {
            expr: first,
            kind,
            convert: None,
        };
        match name {
            "atan" if values.len() == 2 => self.math(F::Atan2, &values, span),
            "atan" => self.math(F::Atan, &values, span),
            "floatBitsToInt" => self.add(bits(ScalarKind::Sint), span),
            "floatBitsToUint" => self.add(bits(ScalarKind::Uint), span),
            "intBitsToFloat" | "uintBitsToFloat" => self.add(bits(ScalarKind::Float), span),
            "all" | "any" => {
                let fun = match name {
                    "all" => RelationalFunction::All,
                    _ => RelationalFunction::Any,
                };
                let argument = first;
                self.add(Expression::Relational { fun, argument }, span)
            }
            "not" => {
                let op = UnaryOperator::LogicalNot;
                self.add(Expression::Unary { op, expr: first }, span)
            }
            // WGSL counts in unsigned numbers.
            "bitfieldExtract" | "bitfieldInsert" => {
                let (fun, at) = match name {
                    "bitfieldExtract" => (F::ExtractBits, 1),
                    _ => (F::InsertBits, 2),
                };
                for value in values.iter_mut().skip(at) {
                    *value = self.cast(*value, Scalar::U32, span)?;
                }
                self.math(fun, &values, span)
            }
            "mix" if self.is_bool(values.last().copied().unwrap_or(first))? => {
                let [reject, accept, condition] = values[..] else {
                    return Err(refused("an argument is missing", span));
                };
                let select = Expression::Select {
                    condition,
                    accept,
                    reject,
                };
                self.add(select, span)
            }
            "mod" => self.modulo(values, span),
            "min" | "max" | "step" | "mix" | "clamp" | "smoothstep" => {
                self.splatted_math(name, values, span)
            }
            _ => match functions::meaning(name) {
                Some(Meaning::Math(fun)) => {
                    let found = self.math(fun, &values, span)?;
                    let is_uint = self.ty(first)?.scalar_kind() == Some(ScalarKind::Uint);
                    match matches!(fun, F::FirstTrailingBit | F::FirstLeadingBit) && is_uint {
                        true => self.cast(found, Scalar::I32, span),
                        false => Ok(found),
                    }
                }
                Some(Meaning::Derivative(axis, ctrl)) => {
                    let expr = first;
                    self.add(Expression::Derivative { axis, ctrl, expr }, span)
                }
                Some(Meaning::Operator(op)) => {
                    let right = *values.last().unwrap_or(&first);
                    let left = first;
                    self.add(Expression::Binary { op, left, right }, span)
                }
                Some(Meaning::Other) | None => {
                    Err(refused(&format!("no `{name}` takes these arguments"), span))
                }
            },
        }
    }

    fn is_bool(&mut self, value: Value) -> Result<bool, Error> {
        Ok(self.ty(value)?.scalar_kind() == Some(ScalarKind::Bool))
    }

    fn vector_size(&mut self, value: Value) -> Result<Option<VectorSize>, Error> {
        Ok(match *self.ty(value)? {
            TypeInner::Vector { size, .. } => Some(size),
            _ => None,
        })
    }

    /// `x - y * floor(x / y)`.
    fn modulo(&mut self, values: Vec<Value>, span: Span) -> Result<Value, Error> {
        let [x, y] = values[..] else {
            return Err(refused("an argument is missing", span));
        };
        let size = self.vector_size(x)?;
        let y = self.splatted(y, size, span)?;
        let binary = |op, left, right| Expression::Binary { op, left, right };
        let quotient = self.add(binary(O::Divide, x, y), span)?;
        let floor = self.math(F::Floor, &[quotient], span)?;
        let product = self.add(binary(O::Multiply, floor, y), span)?;
        self.add(binary(O::Subtract, x, product), span)
    }

    /// Functions of vectors that take scalars for some arguments.
    fn splatted_math(
        &mut self,
        name: &str,
        mut values: Vec<Value>,
        span: Span,
    ) -> Result<Value, Error> {
        let (fun, of, scalars): (F, usize, &[usize]) = match name {
            "min" => (F::Min, 0, &[1]),
            "max" => (F::Max, 0, &[1]),
            "mix" => (F::Mix, 0, &[2]),
            "clamp" => (F::Clamp, 0, &[1, 2]),
            "step" => (F::Step, 1, &[0]),
            _ => (F::SmoothStep, 2, &[0, 1]),
        };
        let Some(vector) = values.get(of).copied() else {
            return Err(refused("an argument is missing", span));
        };
        let size = self.vector_size(vector)?;
        for at in scalars {
            if let Some(value) = values.get_mut(*at) {
                *value = self.splatted(*value, size, span)?;
            }
        }
        self.math(fun, &values, span)
    }

    /// A function of a subgroup.
    pub(super) fn subgroup(
        &mut self,
        of: Subgroup,
        value: &'s Node,
        lane: Option<&'s Node>,
        result: &Ty,
        span: Span,
    ) -> Result<Value, Error> {
        let argument = self.value(value)?;
        let lane = match (of, lane) {
            (Subgroup::Broadcast(n) | Subgroup::QuadBroadcast(n), _) => {
                Some(self.add(Expression::Literal(Literal::U32(n)), span)?)
            }
            (_, Some(lane)) => Some(self.value(lane)?),
            (_, None) => None,
        };
        let by = |mode: fn(Value) -> GatherMode| {
            lane.map(mode)
                .ok_or_else(|| refused("an argument is missing", span))
        };
        let mode = match of {
            Subgroup::Collective(..) | Subgroup::Ballot => None,
            Subgroup::First => Some(GatherMode::BroadcastFirst),
            Subgroup::Broadcast(_) => Some(by(GatherMode::Broadcast)?),
            Subgroup::QuadBroadcast(_) => Some(by(GatherMode::QuadBroadcast)?),
            Subgroup::Shuffle => Some(by(GatherMode::Shuffle)?),
            Subgroup::ShuffleDown => Some(by(GatherMode::ShuffleDown)?),
            Subgroup::ShuffleUp => Some(by(GatherMode::ShuffleUp)?),
            Subgroup::ShuffleXor => Some(by(GatherMode::ShuffleXor)?),
            Subgroup::QuadSwap(direction) => Some(GatherMode::QuadSwap(direction)),
        };
        let of_result = match of {
            Subgroup::Ballot => Expression::SubgroupBallotResult,
            _ => Expression::SubgroupOperationResult {
                ty: self.builder.ty(result, span)?,
            },
        };
        let result = self.unevaluated(of_result, span);
        let statement = match (of, mode) {
            (_, Some(mode)) => Statement::SubgroupGather {
                mode,
                argument,
                result,
            },
            (Subgroup::Collective(op, collective_op), _) => {
                Statement::SubgroupCollectiveOperation {
                    op,
                    collective_op,
                    argument,
                    result,
                }
            }
            _ => Statement::SubgroupBallot {
                result,
                predicate: Some(argument),
            },
        };
        self.writer.statement(statement, span);
        Ok(result)
    }
}
