//! Keeps naga from folding results that GLSL leaves undefined. naga evaluates constants by WGSL's
//! rules, where an infinite or undefined constant is an error. In GLSL it is a value (4.60, 4.7.1
//! and 5.9).
//!
//! If the result of an operation on constants is not known to be finite, one operand is read from a
//! variable: `sqrt(-1.0)` becomes `(held = -1.0, sqrt(held))`.

use glsl_lang::ast::BinaryOpData as B;

use super::Resolver;
use super::expression::Ex;
use crate::constant::{self, ConstantValue};
use crate::tree::Node;
use crate::ty::{Component, Ty};

/// Whether naga folds an expression.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) enum Folds {
    #[default]
    No,
    /// To a value that only naga can compute.
    Unknown,
    To(ConstantValue),
}

impl Folds {
    /// Applies `of` to a constant.
    pub(super) fn map(&self, of: impl FnOnce(ConstantValue) -> Option<ConstantValue>) -> Self {
        match self {
            Self::To(value) => of(value.clone()).map_or(Self::Unknown, Self::To),
            other => other.clone(),
        }
    }

    /// Applies `of` to constants together.
    pub(super) fn of(
        arguments: &[Ex],
        of: impl FnOnce(&[ConstantValue]) -> Option<ConstantValue>,
    ) -> Self {
        let mut values = Vec::new();
        for argument in arguments {
            match &argument.folds {
                Self::To(value) => values.push(value.clone()),
                Self::Unknown => {}
                Self::No => return Self::No,
            }
        }
        match values.len() == arguments.len() && !arguments.is_empty() {
            true => of(&values).map_or(Self::Unknown, Self::To),
            false => Self::Unknown,
        }
    }

    fn is_constant(&self) -> bool {
        *self != Self::No
    }

    fn finite(&self) -> Option<&ConstantValue> {
        match self {
            Self::To(value) if constant::is_finite(value) => Some(value),
            _ => None,
        }
    }
}

/// Whether `fits` holds for each scalar of a constant. False if the constant is unknown.
fn all(value: &Folds, fits: impl Fn(i64) -> bool + Copy) -> bool {
    fn scalars(value: &ConstantValue, fits: impl Fn(i64) -> bool + Copy) -> bool {
        match value {
            ConstantValue::Vector(parts) => parts.iter().all(|p| scalars(p, fits)),
            scalar => constant::integer(scalar).is_some_and(fits),
        }
    }
    matches!(value, Folds::To(value) if scalars(value, fits))
}

impl Resolver<'_, '_> {
    /// The right operand of a binary operation, with the assignment to evaluate before it, and
    /// whether naga folds the result.
    pub(super) fn operand_to_fold(&mut self, op: &B, a: &Ex, b: Ex) -> (Option<Node>, Ex, Folds) {
        let both = a.folds.is_constant() && b.folds.is_constant();
        let value = match (&a.folds, &b.folds) {
            (Folds::To(a), Folds::To(b)) => constant::binary(op, a.clone(), b.clone()),
            _ => None,
        };
        let folds = match (both, value) {
            (false, _) => Folds::No,
            (true, value) => value.map_or(Folds::Unknown, Folds::To),
        };
        let is_integer = matches!(b.ty.kind(), Some(Component::Int | Component::Uint));
        let is_open = b.folds.is_constant()
            && match op {
                // WGSL refuses these for any left operand.
                B::Div | B::Mod if is_integer && !all(&b.folds, |n| n != 0) => true,
                B::RShift => !all(&b.folds, |n| (0..32).contains(&n)),
                // Shifting out a bit is an overflow in WGSL.
                B::LShift => both || !all(&b.folds, |n| (0..32).contains(&n)),
                B::Add | B::Sub | B::Mult | B::Div | B::Mod => both && folds.finite().is_none(),
                _ => false,
            };
        match is_open {
            true => {
                let (first, b) = self.hidden(b);
                (first, b, Folds::No)
            }
            false => (None, b, folds),
        }
    }

    /// As [`Self::operand_to_fold`], for the arguments of a built-in function.
    pub(super) fn arguments_to_fold(
        &mut self,
        name: &str,
        values: &mut [Ex],
    ) -> (Vec<Node>, Folds) {
        let folds = Folds::of(values, |values| constant::call(name, values));
        if !folds.is_constant() || folds.finite().is_some() {
            return (Vec::new(), folds);
        }
        let mut first = Vec::new();
        for value in values {
            let (before, held) = self.hidden(value.clone());
            first.extend(before);
            *value = held;
        }
        (first, Folds::No)
    }

    /// The value, read from a variable if one can be declared here.
    pub(super) fn hidden(&mut self, ex: Ex) -> (Option<Node>, Ex) {
        let held = match &ex.ty {
            Ty::Opaque(_) => None,
            ty => self.temporary(ty),
        };
        match held {
            Some(held) => (Some(Node::assign(&held, ex.node)), Ex::new(held, ex.ty)),
            None => (None, ex),
        }
    }
}
