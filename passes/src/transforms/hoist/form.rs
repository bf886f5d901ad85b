//! How each value depends on the varyings. This decides the effect of interpolation.

use naga::{BinaryOperator, Expression, Handle, MathFunction};

use crate::analysis::values::{ContextId, Node, ValueId, Values};
use preshade_dataflow::graph::rate::{Interpolated, Rate};

/// How a value depends on varyings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Form {
    /// It does not depend on them.
    Uniform,
    /// Components of varyings, the same ones in the whole draw: interpolation gives the same bits.
    Part,
    /// An affine function with draw-uniform coefficients.
    Affine,
    /// Anything else.
    Other,
}

impl Form {
    /// The form of a draw-uniform selection between both.
    ///
    /// A value that may be a constant or a varying is interpolated, and interpolating three equal
    /// values does not return that value exactly. So only parts join to a part.
    fn or(self, other: Self) -> Self {
        match (self, other) {
            (a, b) if a == b => a,
            (Self::Other, _) | (_, Self::Other) => Self::Other,
            _ => Self::Affine,
        }
    }

    /// The form of a sum.
    fn plus(self, other: Self) -> Self {
        self.or(other).computed()
    }

    /// The form of a product.
    fn times(self, other: Self) -> Self {
        match (self, other) {
            (Self::Uniform, x) | (x, Self::Uniform) => x.computed(),
            _ => Self::Other,
        }
    }

    /// The result of computing with a part is not a part.
    fn computed(self) -> Self {
        match self {
            Self::Part => Self::Affine,
            other => other,
        }
    }
}

pub(crate) fn forms(values: &Values<'_, '_>) -> Vec<Form> {
    // Fixed point from the bottom: a cycle first ignores itself.
    let mut forms: Vec<Option<Form>> = vec![None; values.values.len()];
    let users = values.users();
    let mut work: Vec<ValueId> = (0..values.values.len()).collect();
    while let Some(id) = work.pop() {
        let form = match values.values[id].fact.rate {
            Rate::Const | Rate::Draw | Rate::Instance => Some(Form::Uniform),
            Rate::Varying(Interpolated::Perspective | Interpolated::Linear, _) => {
                form(values, id, &forms)
            }
            _ => Some(Form::Other),
        };
        let joined = either(forms[id], form);
        if joined != forms[id] {
            forms[id] = joined;
            work.extend(&users[id]);
        }
    }
    let settled = forms.into_iter().map(|form| form.unwrap_or(Form::Other));
    settled.collect()
}

fn either(a: Option<Form>, b: Option<Form>) -> Option<Form> {
    match (a, b) {
        (Some(a), Some(b)) => Some(a.or(b)),
        (a, b) => a.or(b),
    }
}

/// A selection between values by `choosers`.
fn one_of(
    forms: &[Option<Form>],
    values: impl Iterator<Item = ValueId>,
    choosers: impl Iterator<Item = ValueId>,
) -> Option<Form> {
    let chosen_by_draw = choosers
        .filter_map(|c| forms[c])
        .all(|form| form == Form::Uniform);
    match chosen_by_draw {
        true => values.map(|v| forms[v]).fold(None, either),
        false => Some(Form::Other),
    }
}

fn form(values: &Values<'_, '_>, id: ValueId, forms: &[Option<Form>]) -> Option<Form> {
    let operands = || values.values[id].operands.iter().copied();
    let is_control = |o: &ValueId| matches!(values.values[*o].node, Node::Control(..));
    let is_version = |o: &ValueId| matches!(values.values[*o].node, Node::Version(..));
    let (context, e, path) = match &values.values[id].node {
        Node::Input(_) => return Some(Form::Part),
        Node::Control(..) => return Some(Form::Other),
        Node::Version(..) => {
            return one_of(
                forms,
                operands().filter(|o| !is_control(o)),
                operands().filter(is_control),
            );
        }
        Node::Expression(context, e, path) => (*context, *e, path),
    };
    let f = values.function(context);
    match &f.function.expressions[e] {
        // The memory versions that it may read; the other operands are indices.
        Expression::Load { .. } => one_of(
            forms,
            operands().filter(is_version),
            operands().filter(|o| !is_version(o)),
        ),
        // The callee's possible results.
        Expression::CallResult(_) => one_of(
            forms,
            operands().filter(|o| !is_control(o)),
            operands().filter(is_control),
        ),
        Expression::Swizzle { .. } | Expression::AccessIndex { .. } => {
            operands().map(|o| forms[o]).fold(None, either)
        }
        _ if !path.is_empty() => operands().map(|o| forms[o]).fold(None, either),
        expression => of_operation(values, context, expression, forms),
    }
}

/// The form of an operation, by its own operands. `None` if an operand's form is not known yet.
fn of_operation(
    values: &Values<'_, '_>,
    context: ContextId,
    expression: &Expression,
    forms: &[Option<Form>],
) -> Option<Form> {
    let of = |o: Handle<Expression>| match values.named(context, o) {
        Some(v) => forms[v],
        None => Some(Form::Other),
    };
    Some(match expression {
        Expression::Compose { components, .. } => {
            // A vector of a varying and a constant is affine, component by component.
            let parts = components.iter().map(|c| of(*c));
            parts.fold(None, either)?.computed()
        }
        Expression::Splat { value, .. } => of(*value)?.computed(),
        Expression::Unary {
            op: naga::UnaryOperator::Negate,
            expr,
        } => of(*expr)?.computed(),
        Expression::Access { base, index } => match of(*index)? {
            Form::Uniform => of(*base)?.computed(),
            _ => Form::Other,
        },
        Expression::Binary { op, left, right } => {
            let (left, right) = (of(*left)?, of(*right)?);
            match op {
                BinaryOperator::Add | BinaryOperator::Subtract => left.plus(right),
                BinaryOperator::Multiply => left.times(right),
                BinaryOperator::Divide if right == Form::Uniform => left.computed(),
                _ => Form::Other,
            }
        }
        Expression::Select {
            condition,
            accept,
            reject,
        } => match of(*condition)? {
            Form::Uniform => of(*accept)?.or(of(*reject)?).computed(),
            _ => Form::Other,
        },
        Expression::Math {
            fun,
            arg,
            arg1,
            arg2,
            ..
        } => {
            let first = of(*arg)?;
            let second = arg1.map_or(Some(Form::Uniform), of)?;
            let third = arg2.map_or(Some(Form::Uniform), of)?;
            match fun {
                MathFunction::Dot | MathFunction::Cross => first.times(second),
                MathFunction::Fma => first.times(second).plus(third),
                MathFunction::Mix => first.plus(second).times(third),
                _ => Form::Other,
            }
        }
        _ => Form::Other,
    })
}
