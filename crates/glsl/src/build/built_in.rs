//! Calls of GLSL's functions. `resolve` checks the types of their arguments.

use naga::{
    Barrier, BinaryOperator as O, Expression, GatherMode, Literal, MathFunction as F,
    RelationalFunction, Scalar, ScalarKind, Statement, TypeInner, UnaryOperator, VectorSize,
};

use super::{Body, Value};
use crate::functions::{self, Meaning};
use crate::operations::Subgroup;
use crate::tree::Node;
use crate::ty::Ty;
use shader_text::error::Error;

impl<'s> Body<'_, 's> {
    pub(super) fn built_in_call(
        &mut self,
        name: &str,
        arguments: &'s [Node],
    ) -> Result<Option<Value>, Error> {
        if ["texture", "texel", "image"]
            .iter()
            .any(|w| name.starts_with(w))
        {
            return self.texture_call(name, arguments);
        }
        if name == "barrier" {
            let barrier = Statement::ControlBarrier(Barrier::all());
            self.push(barrier);
            return Ok(None);
        }
        let mut values = Vec::with_capacity(arguments.len());
        for argument in arguments {
            values.push(self.value(argument)?);
        }
        self.built_in(name, values).map(Some)
    }

    pub(super) fn math(&mut self, fun: F, values: &[Value]) -> Result<Value, Error> {
        let at = |i: usize| values.get(i).copied();
        let Some(arg) = at(0) else {
            return Err(self.refused("an argument is missing"));
        };
        let math = Expression::Math {
            fun,
            arg,
            arg1: at(1),
            arg2: at(2),
            arg3: at(3),
        };
        self.add(math)
    }

    fn built_in(&mut self, name: &str, mut values: Vec<Value>) -> Result<Value, Error> {
        let Some(first) = values.first().copied() else {
            return Err(self.refused("an argument is missing"));
        };
        let bits = |kind| Expression::As {
            expr: first,
            kind,
            convert: None,
        };
        match name {
            "atan" if values.len() == 2 => self.math(F::Atan2, &values),
            "atan" => self.math(F::Atan, &values),
            "floatBitsToInt" => self.add(bits(ScalarKind::Sint)),
            "floatBitsToUint" => self.add(bits(ScalarKind::Uint)),
            "intBitsToFloat" | "uintBitsToFloat" => self.add(bits(ScalarKind::Float)),
            "all" | "any" => {
                let fun = match name {
                    "all" => RelationalFunction::All,
                    _ => RelationalFunction::Any,
                };
                let argument = first;
                self.add(Expression::Relational { fun, argument })
            }
            "not" => {
                let op = UnaryOperator::LogicalNot;
                self.add(Expression::Unary { op, expr: first })
            }
            // WGSL counts in unsigned numbers.
            "bitfieldExtract" | "bitfieldInsert" => {
                let (fun, at) = match name {
                    "bitfieldExtract" => (F::ExtractBits, 1),
                    _ => (F::InsertBits, 2),
                };
                for value in values.iter_mut().skip(at) {
                    *value = self.cast(*value, Scalar::U32)?;
                }
                self.math(fun, &values)
            }
            "mix" if self.is_bool(values.last().copied().unwrap_or(first))? => {
                let [reject, accept, condition] = values[..] else {
                    return Err(self.refused("an argument is missing"));
                };
                let select = Expression::Select {
                    condition,
                    accept,
                    reject,
                };
                self.add(select)
            }
            "mod" => self.modulo(values),
            "min" | "max" | "step" | "mix" | "clamp" | "smoothstep" => {
                self.splatted_math(name, values)
            }
            _ => match functions::meaning(name) {
                Some(Meaning::Math(fun)) => {
                    let found = self.math(fun, &values)?;
                    let is_uint = self.ty(first)?.scalar_kind() == Some(ScalarKind::Uint);
                    match matches!(fun, F::FirstTrailingBit | F::FirstLeadingBit) && is_uint {
                        true => self.cast(found, Scalar::I32),
                        false => Ok(found),
                    }
                }
                Some(Meaning::Derivative(axis, ctrl)) => {
                    let expr = first;
                    self.add(Expression::Derivative { axis, ctrl, expr })
                }
                Some(Meaning::Operator(op)) => {
                    let right = *values.last().unwrap_or(&first);
                    let left = first;
                    self.binary_of(op, left, right)
                }
                Some(Meaning::Other) | None => {
                    Err(self.refused(&format!("no `{name}` takes these arguments")))
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
    fn modulo(&mut self, values: Vec<Value>) -> Result<Value, Error> {
        let [x, y] = values[..] else {
            return Err(self.refused("an argument is missing"));
        };
        let size = self.vector_size(x)?;
        let y = self.splatted(y, size)?;
        let binary = |op, left, right| Expression::Binary { op, left, right };
        let quotient = self.add(binary(O::Divide, x, y))?;
        let floor = self.math(F::Floor, &[quotient])?;
        let product = self.add(binary(O::Multiply, floor, y))?;
        self.add(binary(O::Subtract, x, product))
    }

    /// Functions of vectors that take scalars for some arguments.
    fn splatted_math(&mut self, name: &str, mut values: Vec<Value>) -> Result<Value, Error> {
        let (fun, of, scalars): (F, usize, &[usize]) = match name {
            "min" => (F::Min, 0, &[1]),
            "max" => (F::Max, 0, &[1]),
            "mix" => (F::Mix, 0, &[2]),
            "clamp" => (F::Clamp, 0, &[1, 2]),
            "step" => (F::Step, 1, &[0]),
            _ => (F::SmoothStep, 2, &[0, 1]),
        };
        let Some(vector) = values.get(of).copied() else {
            return Err(self.refused("an argument is missing"));
        };
        let size = self.vector_size(vector)?;
        for at in scalars {
            if let Some(value) = values.get_mut(*at) {
                *value = self.splatted(*value, size)?;
            }
        }
        self.math(fun, &values)
    }

    /// A function of a subgroup.
    pub(super) fn subgroup(
        &mut self,
        of: Subgroup,
        value: &'s Node,
        lane: Option<&'s Node>,
        result: &Ty,
    ) -> Result<Value, Error> {
        let argument = self.value(value)?;
        let lane = match (of, lane) {
            (Subgroup::Broadcast(n) | Subgroup::QuadBroadcast(n), _) => {
                Some(self.literal(Literal::U32(n))?)
            }
            (_, Some(lane)) => Some(self.value(lane)?),
            (_, None) => None,
        };
        let by = |mode: fn(Value) -> GatherMode| {
            lane.map(mode)
                .ok_or_else(|| self.refused("an argument is missing"))
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
                ty: self.glsl_ty(result)?,
            },
        };
        let result = self.unevaluated(of_result);
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
        self.push(statement);
        Ok(result)
    }
}
