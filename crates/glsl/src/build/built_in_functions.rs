//! Calls of GLSL's functions. `resolve` checks the types of their arguments.

use naga::{
    Barrier, BinaryOperator as O, Expression, GatherMode, Literal, MathFunction as F, Scalar,
    ScalarKind, Statement, TypeInner, UnaryOperator, VectorSize,
};

use super::{Body, Value};
use crate::functions::Meaning;
use crate::operations::Subgroup;
use crate::tree::Node;
use crate::ty::Ty;
use shader_text::error::Error;

impl<'s> Body<'_, 's> {
    pub(super) fn built_in_call(
        &mut self,
        meaning: Meaning,
        arguments: &'s [Node],
    ) -> Result<Option<Value>, Error> {
        let mut values = Vec::with_capacity(arguments.len());
        for argument in arguments {
            values.push(self.value(argument)?);
        }
        if let Meaning::Barrier = meaning {
            self.push(Statement::ControlBarrier(Barrier::all()));
            return Ok(None);
        }
        self.built_in(meaning, values).map(Some)
    }

    pub(super) fn missing(&self) -> Error {
        self.refused("an argument is missing")
    }

    fn built_in(&mut self, meaning: Meaning, values: Vec<Value>) -> Result<Value, Error> {
        let first = *values.first().ok_or_else(|| self.missing())?;
        let last = *values.last().unwrap_or(&first);
        let expression = match meaning {
            Meaning::Math(fun) => return self.math_of(fun, values),
            Meaning::Modulo => return self.modulo(first, last),
            Meaning::Operator(op) => return self.binary_of(op, first, last),
            Meaning::Derivative(axis, ctrl) => Expression::Derivative {
                axis,
                ctrl,
                expr: first,
            },
            Meaning::Bits(kind) => Expression::As {
                expr: first,
                kind,
                convert: None,
            },
            Meaning::Relational(fun) => Expression::Relational {
                fun,
                argument: first,
            },
            Meaning::Not => Expression::Unary {
                op: UnaryOperator::LogicalNot,
                expr: first,
            },
            Meaning::Barrier | Meaning::Image(_) | Meaning::Composed => {
                return Err(self.refused("no function takes these arguments"));
            }
        };
        self.add(expression)
    }

    fn math(&mut self, fun: F, values: &[Value]) -> Result<Value, Error> {
        let at = |i: usize| values.get(i).copied();
        let math = Expression::Math {
            fun,
            arg: at(0).ok_or_else(|| self.missing())?,
            arg1: at(1),
            arg2: at(2),
            arg3: at(3),
        };
        self.add(math)
    }

    /// A function in which GLSL allows scalars in place of vectors.
    fn math_of(&mut self, fun: F, mut values: Vec<Value>) -> Result<Value, Error> {
        // The vector, and the scalars that accompany it.
        let (vector, scalars) = match fun {
            F::Atan if values.len() == 2 => return self.math(F::Atan2, &values),
            // WGSL's counts are unsigned.
            F::ExtractBits | F::InsertBits => {
                let counts = if fun == F::ExtractBits { 1 } else { 2 };
                for value in values.iter_mut().skip(counts) {
                    *value = self.cast(*value, Scalar::U32)?;
                }
                return self.math(fun, &values);
            }
            F::Mix => {
                if let [reject, accept, condition] = values[..]
                    && self.ty(condition)?.scalar_kind() == Some(ScalarKind::Bool)
                {
                    return self.add(Expression::Select {
                        condition,
                        accept,
                        reject,
                    });
                }
                (0, 2..3)
            }
            F::Min | F::Max => (0, 1..2),
            F::Clamp => (0, 1..3),
            F::Step => (1, 0..1),
            F::SmoothStep => (2, 0..2),
            _ => return self.math(fun, &values),
        };
        let vector = *values.get(vector).ok_or_else(|| self.missing())?;
        let size = self.vector_size(vector)?;
        for value in values.get_mut(scalars).unwrap_or_default() {
            *value = self.splatted(*value, size)?;
        }
        self.math(fun, &values)
    }

    fn vector_size(&mut self, value: Value) -> Result<Option<VectorSize>, Error> {
        Ok(match *self.ty(value)? {
            TypeInner::Vector { size, .. } => Some(size),
            _ => None,
        })
    }

    /// `x - y * floor(x / y)`.
    fn modulo(&mut self, x: Value, y: Value) -> Result<Value, Error> {
        let size = self.vector_size(x)?;
        let y = self.splatted(y, size)?;
        let quotient = self.binary_of(O::Divide, x, y)?;
        let floor = self.math(F::Floor, &[quotient])?;
        let product = self.binary_of(O::Multiply, floor, y)?;
        self.binary_of(O::Subtract, x, product)
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
        let by = |mode: fn(Value) -> GatherMode| lane.map(mode).ok_or_else(|| self.missing());
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
