//! The effects of leaving out an addend of 0.
//!
//! A term `w * x` with a weight of 0 adds nothing, so a pass may leave it out or put 0 in its
//! place. Two things differ then:
//!
//! - the term may have been -0, and a sum of zeros then has the other sign. `1 / x`, `atan2` or a
//!   reinterpretation of the bits shows the sign. A comparison does not, and a sum with a number
//!   other than 0 has no such zero. Adding a literal 0 is no help: WGSL lets a compiler drop it;
//! - `x` may be infinite or NaN, and 0 times that is NaN.
//!
//! Every pass that skips zeros uses [`Zeros`].

use naga::{BinaryOperator, Expression, Handle, MathFunction, ScalarKind, Statement};

use crate::analysis::hazard;
use crate::analysis::range::AllRanges;
use crate::analysis::values::{ContextId, Node, ValueId, Values};
use preshade_dataflow::graph::FunctionId;
use preshade_plan::pass::{Facts, MaterialTexture};

/// Why a term with a weight of 0 must stay.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Kept {
    /// This operation distinguishes -0 from 0.
    Sign(&'static str),
    /// The weighted number may be infinite or NaN, by this operation.
    Infinite(&'static str),
    /// The number is sampled from a texture that holds an infinite number or NaN.
    Texture,
}

impl std::fmt::Display for Kept {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Sign(operation) => write!(
                f,
                "without it a sum of zeros has another sign, and {operation} tells -0 from 0"
            ),
            Self::Infinite(operation) => write!(
                f,
                "`{operation}` may make it infinite or NaN, and 0 times that is NaN"
            ),
            Self::Texture => {
                f.write_str("its texture holds an infinite number or NaN, and 0 times that is NaN")
            }
        }
    }
}

/// The remaining effect of leaving a term out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum ZeroEffect {
    #[default]
    Nothing,
    /// The sign of a zero in an output or in memory.
    SignOfZero,
}

/// Answers for the terms of one fragment stage.
#[derive(Debug)]
pub(crate) struct Zeros<'v, 'g, 'p> {
    values: &'v Values<'g, 'p>,
    /// Ranges on any adapter, for any inputs.
    computed: AllRanges,
    /// Ranges for texels from 0 to 1.
    ordinary: AllRanges,
    infinite: Vec<&'v MaterialTexture>,
}

impl<'v, 'g, 'p> Zeros<'v, 'g, 'p> {
    pub fn new(values: &'v Values<'g, 'p>, facts: &'v Facts, material: &str) -> Self {
        let known = facts.ranges.iter().filter(|r| r.material == material);
        let known: Vec<_> = known.cloned().collect();
        let infinite = facts.infinite_textures.iter();
        Self {
            values,
            computed: AllRanges::computed(values, values.cycles()),
            ordinary: AllRanges::of_unit_texels(
                values,
                values.cycles(),
                &known,
                hazard::LARGEST_INPUT,
            ),
            infinite: infinite.filter(|t| t.material == material).collect(),
        }
    }

    /// Whether a term that is 0 may be left out of the value `product` of a function, a product or
    /// a sum, and the remaining effect. `of` is a factor that only its weight of 0 excludes.
    ///
    /// # Errors
    /// Why it must stay.
    pub fn left_out(
        &self,
        function: FunctionId,
        product: Handle<Expression>,
        of: Option<Handle<Expression>>,
    ) -> Result<ZeroEffect, Kept> {
        let contexts = self.values.contexts.iter().enumerate();
        let contexts = contexts.filter(|(_, c)| c.function == function);
        let mut seen = ZeroEffect::Nothing;
        for (context, _) in contexts {
            if let Some(factor) = of.and_then(|of| self.values.named(context, of)) {
                self.is_finite(factor)?;
            }
            if self.is_other_than_zero(context, product) {
                continue;
            }
            if let Some(product) = self.values.named(context, product) {
                seen = seen.max(self.sign(product)?);
            }
        }
        Ok(seen)
    }

    /// Whether a value is finite if all texels are. A texel is one wherever it lies.
    fn is_finite(&self, id: ValueId) -> Result<(), Kept> {
        let values = self.values;
        let mut seen = vec![false; values.values.len()];
        let mut work = vec![id];
        while let Some(id) = work.pop() {
            if std::mem::replace(&mut seen[id], true) {
                continue;
            }
            match values.values[id].node {
                Node::Expression(context, e, _) => {
                    let expressions = &values.function(context).function.expressions;
                    if let Expression::ImageSample { image, .. }
                    | Expression::ImageLoad { image, .. } = expressions[e]
                    {
                        if self.is_infinite(context, image) {
                            return Err(Kept::Texture);
                        }
                        continue;
                    }
                    let found = hazard::undefined(values, &self.ordinary, context, e)
                        .or_else(|| hazard::overflow(values, &self.ordinary, id));
                    if let Some(operation) = found {
                        return Err(Kept::Infinite(operation));
                    }
                }
                // A condition only chooses.
                Node::Control(..) => continue,
                Node::Input(_) | Node::Version(..) => {}
            }
            work.extend(&values.values[id].operands);
        }
        Ok(())
    }

    /// Whether a sum has an addend that is not 0, so that it is no zero of either sign.
    fn is_other_than_zero(&self, context: ContextId, sum: Handle<Expression>) -> bool {
        match self.values.function(context).function.expressions[sum] {
            Expression::Binary { op, left, right } => {
                matches!(
                    self.of_binary(context, op, left, right, |_| false),
                    Tells::Never
                )
            }
            _ => false,
        }
    }

    /// Whether a texture may hold an infinite number or NaN.
    fn is_infinite(&self, mut context: ContextId, mut image: Handle<Expression>) -> bool {
        let values = self.values;
        let at = loop {
            let f = values.function(context);
            match f.function.expressions[image] {
                Expression::GlobalVariable(global) => {
                    break values.graph.module().global_variables[global].binding;
                }
                Expression::FunctionArgument(index) => {
                    let Some((caller, at)) = values.contexts[context].call else {
                        break None;
                    };
                    let call = values.function(caller).statements.get(at).statement;
                    let Statement::Call { arguments, .. } = call else {
                        break None;
                    };
                    (context, image) = (caller, arguments[index as usize]);
                }
                // An element of an array of textures.
                _ => break None,
            }
        };
        let mut infinite = self.infinite.iter();
        infinite.any(|t| at.is_none_or(|at| (t.group, t.binding) == (at.group, at.binding)))
    }

    /// Checks every input of the stage like [`Self::sign`].
    fn inputs(&self) -> Result<(), Kept> {
        let inputs = self.values.values.iter().enumerate();
        let mut inputs = inputs.filter(|(_, v)| matches!(v.node, Node::Input(_)));
        inputs.try_for_each(|(id, _)| self.sign(id).map(|_| ()))
    }

    /// Follows a zero of either sign to the operations that distinguish the signs.
    fn sign(&self, id: ValueId) -> Result<ZeroEffect, Kept> {
        let (values, users) = (self.values, self.values.users());
        let mut followed = vec![false; values.values.len()];
        let mut work = vec![id];
        let mut seen = ZeroEffect::Nothing;
        while let Some(id) = work.pop() {
            if std::mem::replace(&mut followed[id], true) {
                continue;
            }
            if values.roots.contains(&id) {
                seen = ZeroEffect::SignOfZero;
            }
            for user in &users[id] {
                match self.tells(*user, id) {
                    Tells::Never => {}
                    Tells::Result => work.push(*user),
                    Tells::Itself(operation) => return Err(Kept::Sign(operation)),
                }
            }
        }
        Ok(seen)
    }

    /// How `user` depends on the sign of a zero of `id`.
    fn tells(&self, user: ValueId, id: ValueId) -> Tells {
        let values = self.values;
        let Node::Expression(context, e, path) = &values.values[user].node else {
            return Tells::Result;
        };
        let (context, f) = (*context, values.function(*context));
        let is = |e: Handle<Expression>| values.named(context, e) == Some(id);
        let kind = |e| f.ty(values.graph.module(), e).scalar_kind();
        match &f.function.expressions[*e] {
            _ if !path.is_empty() => Tells::Result,
            Expression::Binary { op, left, right } => {
                self.of_binary(context, *op, *left, *right, is)
            }
            Expression::Math {
                fun,
                arg,
                arg1,
                arg2,
                ..
            } => {
                let is_raised = |y| self.computed.operand(values, context, y).low > 0.0;
                match (fun, arg1) {
                    (MathFunction::Pow, Some(y)) if is_raised(*y) => Tells::Result,
                    _ => of_function(*fun, [Some(*arg), *arg1, *arg2].map(|a| a.is_some_and(is))),
                }
            }
            Expression::As { convert: None, .. } => Tells::Itself("a reinterpretation of its bits"),
            Expression::As { kind: to, .. } if *to != ScalarKind::Float => Tells::Never,
            // Texels at 0 and -0 are the same.
            Expression::ImageSample { .. } | Expression::ImageLoad { .. } => Tells::Never,
            Expression::Relational { .. } => Tells::Never,
            Expression::SubgroupOperationResult { .. } => Tells::Itself("a subgroup operation"),
            _ if kind(*e).is_some_and(|k| k != ScalarKind::Float) => Tells::Never,
            _ => Tells::Result,
        }
    }

    fn of_binary(
        &self,
        context: ContextId,
        op: BinaryOperator,
        left: Handle<Expression>,
        right: Handle<Expression>,
        is: impl Fn(Handle<Expression>) -> bool,
    ) -> Tells {
        use BinaryOperator as B;
        let nonzero = |e| self.computed.operand(self.values, context, e).least() > 0.0;
        match op {
            // Only a sum of zeros is a zero of either sign.
            B::Add | B::Subtract if nonzero(left) || nonzero(right) => Tells::Never,
            B::Add | B::Subtract | B::Multiply => Tells::Result,
            B::Divide if is(right) => Tells::Itself("a division by it"),
            B::Modulo if is(right) => Tells::Itself("`%`"),
            B::Divide | B::Modulo => Tells::Result,
            _ => Tells::Never,
        }
    }
}

/// The same for all stages of a pass, in their order.
///
/// # Errors
/// Why it must stay.
pub(crate) fn left_out(
    stages: &[Zeros<'_, '_, '_>],
    function: FunctionId,
    product: Handle<Expression>,
    of: Option<Handle<Expression>>,
) -> Result<ZeroEffect, Kept> {
    let mut seen = ZeroEffect::Nothing;
    for (i, stage) in stages.iter().enumerate() {
        let more = stage.left_out(function, product, of)?;
        if let (ZeroEffect::SignOfZero, Some(next)) = (more, stages.get(i + 1)) {
            next.inputs()?;
        }
        seen = seen.max(more);
    }
    Ok(seen)
}

/// How an operation depends on the sign of a zero.
enum Tells {
    /// It does not: the result is the same.
    Never,
    /// Perhaps whoever reads the result, which may be a zero of either sign.
    Result,
    /// The operation distinguishes the signs.
    Itself(&'static str),
}

fn of_function(fun: MathFunction, is: [bool; 3]) -> Tells {
    use MathFunction as M;
    match fun {
        M::Atan2 => Tells::Itself("`atan2`"),
        M::InverseSqrt => Tells::Itself("`inverseSqrt`"),
        M::Inverse => Tells::Itself("`inverse`"),
        M::Pack2x16float => Tells::Itself("`pack2x16float`"),
        M::Pow if is[0] => Tells::Itself("`pow`"),
        M::SmoothStep if is[0] || is[1] => Tells::Itself("`smoothstep`"),
        // The same number for both zeros, up to a sign that the exponent, the cosine or the square
        // loses.
        M::Abs | M::Cos | M::Cosh | M::Acos | M::Exp | M::Exp2 | M::Log | M::Log2 | M::Pow => {
            Tells::Never
        }
        M::Length | M::Distance | M::Step | M::Acosh => Tells::Never,
        M::Pack4x8snorm | M::Pack4x8unorm | M::Pack2x16snorm | M::Pack2x16unorm => Tells::Never,
        _ => Tells::Result,
    }
}
