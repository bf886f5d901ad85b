//! Instructions that a compiler rewrites together with their readers.
//!
//! An exponential ends in an instruction of its own, so no multiply-add takes it in. But a compiler
//! multiplies two of them by adding their exponents, divides by one by negating its exponent, and
//! takes a logarithm or a root of one by dropping both (Mesa's `nir_opt_algebraic`). A product with
//! 0 or 1 becomes a selection, and `x - floor(x)` one instruction. If the two are compiled
//! separately, none of this happens. On llvmpipe, `exp2(u.a) * exp2(uv.x)` has other bits where the
//! first factor comes from another stage.

use naga::{BinaryOperator, Expression, Handle, MathFunction, ScalarKind};

use super::{OUTPUT, Operations};
use crate::analysis::values::{ContextId, Node, ValueId};

/// An instruction that a compiler may rewrite with its reader.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Own {
    /// A power: an exponential, or a root.
    Power,
    /// 0 or 1, or one of two values.
    Choice,
    Other,
}

impl Operations<'_, '_, '_> {
    /// Whether a compiler may rewrite a value with a reader.
    pub(super) fn is_rewritten(&self, id: ValueId) -> bool {
        let owns = self.owns(id);
        !owns.is_empty()
            && self.any_reader(id, |reader, _| {
                reader != OUTPUT && owns.iter().any(|own| self.rewrites(*own, reader))
            })
    }

    /// The operands of an operation, behind all copies, with which a compiler may rewrite it.
    pub(super) fn rewritten_with(&self, reader: ValueId) -> Vec<ValueId> {
        let operands = self.values.values[reader].operands.iter();
        let mut found: Vec<ValueId> = operands
            .flat_map(|operand| self.owns(*operand))
            .filter(|own| self.rewrites(*own, reader))
            .map(|(of, _)| of)
            .collect();
        found.sort_unstable();
        found.dedup();
        found
    }

    /// The instructions that an operand is a copy of, behind modifiers or one of them.
    fn owns(&self, operand: ValueId) -> Vec<(ValueId, Own)> {
        let plain = Self {
            sees_modifiers: false,
            ..*self
        };
        let mut all = plain.sources(operand);
        all.extend(self.sources(operand));
        all.sort_unstable();
        all.dedup();
        let own = |id: ValueId| Some((id, self.own(id)?));
        all.into_iter().filter_map(own).collect()
    }

    fn own(&self, id: ValueId) -> Option<Own> {
        use MathFunction as F;
        let (context, expression) = self.whole(id)?;
        let module = self.values.graph.module();
        let kind = |e: Handle<Expression>| self.function(context).ty(module, e).scalar_kind();
        match expression {
            Expression::Math { fun, arg, .. } if kind(*arg) == Some(ScalarKind::Float) => match fun
            {
                F::Exp | F::Exp2 | F::Pow | F::Sqrt | F::InverseSqrt => Some(Own::Power),
                F::Step | F::Sign => Some(Own::Choice),
                _ => Some(Own::Other),
            },
            Expression::Select { accept, .. } if kind(*accept) == Some(ScalarKind::Float) => {
                Some(Own::Choice)
            }
            Expression::As {
                expr,
                kind: ScalarKind::Float,
                ..
            } if kind(*expr) == Some(ScalarKind::Bool) => Some(Own::Choice),
            _ => None,
        }
    }

    fn rewrites(&self, (id, own): (ValueId, Own), reader: ValueId) -> bool {
        if !self.is_arithmetic(reader) {
            return false;
        }
        self.joins_argument(id, reader)
            || match own {
                Own::Choice => true,
                Own::Power => self.joins_powers(reader),
                Own::Other => false,
            }
    }

    /// Whether an operation has powers that a compiler may write as one.
    fn joins_powers(&self, reader: ValueId) -> bool {
        use BinaryOperator as B;
        use MathFunction as F;
        let Some((context, expression)) = self.whole(reader) else {
            return false;
        };
        let is_power = |e: Handle<Expression>| {
            self.operand(context, e)
                .is_some_and(|operand| self.is_power(operand, true))
        };
        match expression {
            Expression::Binary { op, left, right } => match op {
                B::Multiply => is_power(*left) && is_power(*right),
                B::Divide | B::Modulo => is_power(*right),
                _ => false,
            },
            Expression::Math {
                fun,
                arg,
                arg1,
                arg2,
                ..
            } => match fun {
                F::Log
                | F::Log2
                | F::Sqrt
                | F::InverseSqrt
                | F::Pow
                | F::Normalize
                | F::Length
                | F::Inverse
                | F::Determinant
                | F::Refract => is_power(*arg),
                F::Atan2 => arg1.is_some_and(is_power),
                F::Fma | F::Mix | F::Dot | F::Cross | F::Outer | F::Reflect => {
                    let all = [Some(*arg), *arg1, *arg2].into_iter().flatten();
                    all.filter(|e| is_power(*e)).count() > 1
                }
                _ => false,
            },
            _ => false,
        }
    }

    /// Whether an operand is a power, or a quotient by one.
    fn is_power(&self, operand: ValueId, sees_quotients: bool) -> bool {
        let is_quotient = |id: ValueId| match self.whole(id) {
            Some((
                context,
                Expression::Binary {
                    op: BinaryOperator::Divide,
                    right,
                    ..
                },
            )) => self
                .operand(context, *right)
                .is_some_and(|divisor| self.is_power(divisor, false)),
            _ => false,
        };
        let is_own = self.owns(operand).iter().any(|(_, own)| *own == Own::Power);
        is_own || (sees_quotients && self.sources(operand).into_iter().any(is_quotient))
    }

    /// Whether an operation reads an instruction and that instruction's own argument.
    fn joins_argument(&self, id: ValueId, reader: ValueId) -> bool {
        let value = &self.values.values;
        let sources = |id: ValueId| {
            let operands = value[id].operands.iter();
            operands.flat_map(|o| self.sources(*o)).collect::<Vec<_>>()
        };
        // A buffer is no value.
        let is_value = |id: &ValueId| match value[*id].node {
            Node::Control(..) => false,
            _ => !matches!(self.whole(*id), Some((_, Expression::GlobalVariable(_)))),
        };
        let arguments = sources(id);
        // The argument of a modifier is no second operand.
        let plain = Self {
            sees_modifiers: false,
            ..*self
        };
        let beside = value[reader].operands.iter().flat_map(|operand| {
            let mut found = plain.sources(*operand);
            if !found.contains(&id) {
                found.extend(self.sources(*operand));
            }
            found
        });
        beside
            .filter(is_value)
            .any(|source| arguments.contains(&source))
    }

    fn operand(&self, context: ContextId, e: Handle<Expression>) -> Option<ValueId> {
        self.values.named(context, e)
    }
}
