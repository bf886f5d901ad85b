//! Range analysis: intervals of the values of a fragment stage.
//!
//! The ranges of varyings and draw constants come from a scene or from assumptions; the code gives
//! the rest. An interval covers every component of its value. Its bounds are real numbers; users
//! account for rounding beyond them.

use std::collections::HashSet;

use naga::{
    AddressSpace, Arena, BinaryOperator, Binding, Expression, Handle, Literal, MathFunction,
    Module, ScalarKind, TypeInner, UnaryOperator,
};

use crate::analysis::circle::{Merges, UNCOUNTED_TURNS, operands_first};
use crate::analysis::values::{ContextId, Node, ValueId, Values};
use crate::core::pass::{Source, SourceRange};
use crate::core::reflect;
use crate::graph::cells::Root;
use crate::graph::memory::{Origin, VersionId};
use crate::graph::rate::Rate;

/// An interval of real numbers; either end may be infinite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Lower bound.
    pub low: f64,
    /// Upper bound.
    pub high: f64,
}

impl Range {
    /// Unbounded.
    pub const ANYTHING: Self = Self::new(f64::NEG_INFINITY, f64::INFINITY);
    const UNIT: Self = Self::new(0.0, 1.0);

    /// From `low` to `high`.
    pub const fn new(low: f64, high: f64) -> Self {
        Self { low, high }
    }

    /// From `-magnitude` to `magnitude`.
    pub const fn within(magnitude: f64) -> Self {
        Self::new(-magnitude, magnitude)
    }

    /// Largest absolute value.
    pub fn magnitude(self) -> f64 {
        self.low.abs().max(self.high.abs())
    }

    /// Smallest absolute value.
    pub fn least(self) -> f64 {
        match self.low > 0.0 || self.high < 0.0 {
            true => self.low.abs().min(self.high.abs()),
            false => 0.0,
        }
    }

    /// The smallest interval that contains both.
    #[must_use]
    pub fn or(self, other: Self) -> Self {
        Self::new(self.low.min(other.low), self.high.max(other.high))
    }

    /// `min(max(x, low), high)`, bound by bound.
    fn clamped(self, low: Self, high: Self) -> Self {
        Self::ordered(
            self.low.max(low.low).min(high.low),
            self.high.max(low.high).min(high.high),
        )
    }

    /// The remainder of a division: it has the dividend's sign, is no larger than the dividend, and
    /// smaller than the divisor.
    fn remainder(self, divisor: Self) -> Self {
        if self.magnitude() < divisor.least() {
            return self;
        }
        let most = self.magnitude().min(divisor.magnitude());
        let low = if self.low >= 0.0 { 0.0 } else { -most };
        let high = if self.high <= 0.0 { 0.0 } else { most };
        Self::new(low, high)
    }

    fn plus(self, other: Self) -> Self {
        Self::ordered(self.low + other.low, self.high + other.high)
    }

    fn negated(self) -> Self {
        Self::new(-self.high, -self.low)
    }

    fn scaled(self, by: f64) -> Self {
        self.times(Self::new(by, by))
    }

    fn times(self, other: Self) -> Self {
        let ends = [self.low, self.high].map(|a| [other.low, other.high].map(|b| product(a, b)));
        let ends = ends.as_flattened();
        let low = ends.iter().copied().fold(f64::INFINITY, f64::min);
        let high = ends.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        Self::ordered(low, high)
    }

    fn squared(self) -> Self {
        let (least, most) = (self.least(), self.magnitude());
        Self::new(least * least, most * most)
    }

    fn inverse(self) -> Self {
        match self.least() > 0.0 {
            true => Self::ordered(1.0 / self.high, 1.0 / self.low),
            false => Self::ANYTHING,
        }
    }

    /// The possible quotients by `divisor`.
    pub(crate) fn over(self, divisor: Self) -> Self {
        self.times(divisor.inverse())
    }

    /// The image under a monotonically increasing function.
    fn rising(self, function: impl Fn(f64) -> f64) -> Self {
        Self::ordered(function(self.low), function(self.high))
    }

    /// An interval from bounds that may be NaN.
    fn ordered(low: f64, high: f64) -> Self {
        match low <= high {
            true => Self::new(low, high),
            false => Self::ANYTHING,
        }
    }
}

/// A product of bounds in which 0 times infinity is 0: an infinite bound only means unbounded.
fn product(a: f64, b: f64) -> f64 {
    if a == 0.0 || b == 0.0 { 0.0 } else { a * b }
}

/// Most values times iterations to follow around one loop; beyond that, ranges are assumed
/// unbounded.
const MOST_FOLLOWED: usize = 200_000;
/// Most rounds within an iteration; the rest is treated the same.
const MOST_ROUNDS: usize = 16;

/// The range of every value.
#[derive(Debug)]
pub struct AllRanges {
    of: Vec<Range>,
    /// Magnitude of unknown inputs; `None` if they are unbounded.
    assumed: Option<f64>,
}

impl AllRanges {
    /// `known` are measured inputs. All others are assumed to lie within `ordinary` of 0.
    pub fn new(
        values: &Values<'_, '_>,
        circles: &[Vec<ValueId>],
        known: &[SourceRange],
        ordinary: f64,
    ) -> Self {
        let outside = Outside { known, ordinary };
        let mut ranges = Self {
            of: vec![Range::ANYTHING; values.values.len()],
            assumed: known.is_empty().then_some(ordinary),
        };
        for circle in circles.iter().rev() {
            let is_circular =
                circle.len() > 1 || values.values[circle[0]].operands.contains(&circle[0]);
            if !is_circular {
                ranges.of[circle[0]] = ranges.find(values, circle[0], &outside, &HashSet::new());
                continue;
            }
            let merges = Merges::of(values, circle);
            if !ranges.turn(values, circle, &merges, &outside) {
                for id in circle {
                    ranges.of[*id] = Range::ANYTHING;
                }
            }
        }
        ranges
    }

    /// The ranges of a cycle, starting empty: unreached values are ignored in joins. The
    /// loop-carried values change only after the others have settled. `false` if they may grow
    /// further.
    fn turn(
        &mut self,
        values: &Values<'_, '_>,
        circle: &[ValueId],
        merges: &Merges,
        outside: &Outside<'_>,
    ) -> bool {
        let mut unseen: HashSet<ValueId> = circle.iter().copied().collect();
        let turns = merges.turns.unwrap_or(UNCOUNTED_TURNS);
        if turns.saturating_mul(circle.len()) > MOST_FOLLOWED {
            return false;
        }
        // Without the merges there is hardly a cycle; with operands first, one or two rounds
        // suffice.
        let rest = operands_first(values, circle, &merges.of);
        for _ in 0..turns {
            for round in 0.. {
                if !self.join(values, rest.iter(), outside, &mut unseen) {
                    break;
                }
                if round == MOST_ROUNDS {
                    return false;
                }
            }
            let carried = merges.of.iter();
            if !self.join(values, carried, outside, &mut unseen) && unseen.is_empty() {
                return true;
            }
        }
        merges.turns.is_some() && unseen.is_empty()
    }

    /// Joins new results into the ranges; returns whether any changed.
    fn join<'v>(
        &mut self,
        values: &Values<'_, '_>,
        ids: impl Iterator<Item = &'v ValueId>,
        outside: &Outside<'_>,
        unseen: &mut HashSet<ValueId>,
    ) -> bool {
        let mut changed = false;
        for id in ids {
            let found = self.find(values, *id, outside, unseen);
            let joined = match unseen.contains(id) {
                true if joins(values, *id, unseen) => {
                    unseen.remove(id);
                    found
                }
                true => continue,
                false => self.of[*id].or(found),
            };
            changed |= self.of[*id] != joined;
            self.of[*id] = joined;
        }
        changed
    }

    /// The range of a value.
    pub fn of(&self, id: ValueId) -> Range {
        self.of[id]
    }

    /// The range of an expression, if an observed value depends on it.
    pub fn operand(
        &self,
        values: &Values<'_, '_>,
        context: ContextId,
        e: Handle<Expression>,
    ) -> Range {
        values
            .named(context, e)
            .map_or(Range::ANYTHING, |id| self.of[id])
    }

    /// The range of an expression's inverse. If inputs are unknown, a divisor from the draw is
    /// assumed ordinary too: its inverse is as bounded as itself.
    pub fn inverse(
        &self,
        values: &Values<'_, '_>,
        context: ContextId,
        e: Handle<Expression>,
    ) -> Range {
        let range = self.operand(values, context, e);
        let is_of_draw = values
            .named(context, e)
            .is_some_and(|v| matches!(values.values[v].fact.rate, Rate::Draw | Rate::Instance));
        match self.assumed {
            Some(ordinary) if is_of_draw && range.least() < 1.0 / ordinary => {
                Range::within(ordinary)
            }
            _ => range.inverse(),
        }
    }

    fn find(
        &self,
        values: &Values<'_, '_>,
        id: ValueId,
        outside: &Outside<'_>,
        unseen: &HashSet<ValueId>,
    ) -> Range {
        let joined = || {
            let operands = values.values[id].operands.iter();
            operands
                .filter(|o| {
                    !matches!(values.values[**o].node, Node::Control(..)) && !unseen.contains(o)
                })
                .map(|o| self.of[*o])
                .reduce(Range::or)
        };
        match &values.values[id].node {
            Node::Input(input) => outside.input(values, *input),
            Node::Control(..) => Range::ANYTHING,
            Node::Version(context, version) => initial(values, *context, *version)
                .unwrap_or_else(|| joined().unwrap_or(Range::ANYTHING)),
            Node::Expression(context, e, path) => {
                let f = values.function(*context);
                match &f.function.expressions[*e] {
                    Expression::CallResult(_) => joined().unwrap_or(Range::ANYTHING),
                    Expression::Load { pointer } => {
                        match f.ty(values.graph.module(), *pointer).pointer_space() {
                            Some(AddressSpace::Function | AddressSpace::Private)
                                if f.memory.loads.get(e).is_some_and(|l| !l.is_empty()) =>
                            {
                                let versions = values.values[id].operands.iter();
                                versions
                                    .filter(|o| {
                                        matches!(values.values[**o].node, Node::Version(..))
                                            && !unseen.contains(o)
                                    })
                                    .map(|o| self.of[*o])
                                    .reduce(Range::or)
                                    .unwrap_or(Range::ANYTHING)
                            }
                            Some(AddressSpace::Function | AddressSpace::Private) => Range::ANYTHING,
                            _ => outside.memory(values, *context, *pointer, path),
                        }
                    }
                    _ if !path.is_empty() => joined().unwrap_or(Range::ANYTHING),
                    expression => self.of_operation(values, *context, *e, expression, outside),
                }
            }
        }
    }

    fn of_operation(
        &self,
        values: &Values<'_, '_>,
        context: ContextId,
        e: Handle<Expression>,
        expression: &Expression,
        outside: &Outside<'_>,
    ) -> Range {
        let module = values.graph.module();
        let f = values.function(context);
        let of = |o: Handle<Expression>| self.operand(values, context, o);
        let is_float = |e| f.ty(module, e).scalar_kind() == Some(ScalarKind::Float);
        match expression {
            Expression::Literal(_) | Expression::Constant(_) | Expression::ZeroValue(_) => {
                of_constant(module, &f.function.expressions, e)
            }
            // A pipeline may set it to anything.
            Expression::Override(_) => outside.unknown(),
            Expression::Compose { components, .. } => components
                .iter()
                .map(|c| of(*c))
                .reduce(Range::or)
                .unwrap_or(Range::ANYTHING),
            Expression::Splat { value, .. } => of(*value),
            Expression::Swizzle { vector, .. } => of(*vector),
            Expression::AccessIndex { base, .. } | Expression::Access { base, .. } => of(*base),
            Expression::Select { accept, reject, .. } => of(*accept).or(of(*reject)),
            Expression::Unary {
                op: UnaryOperator::Negate,
                expr,
            } => of(*expr).negated(),
            // Texels are assumed to be in the range of varyings.
            Expression::ImageSample { .. } | Expression::ImageLoad { .. } if is_float(e) => {
                Range::within(outside.ordinary)
            }
            Expression::As {
                kind: ScalarKind::Float,
                expr,
                convert: Some(_),
            } if is_float(*expr) => of(*expr),
            // A whole number of 32 bits.
            Expression::As {
                kind: ScalarKind::Float,
                expr,
                convert: Some(_),
            } => match f.ty(module, *expr).scalar_kind() {
                Some(ScalarKind::Uint) => Range::new(0.0, f64::from(u32::MAX)),
                Some(ScalarKind::Sint) => Range::within(f64::from(i32::MIN).abs()),
                Some(ScalarKind::Bool) => Range::UNIT,
                _ => Range::ANYTHING,
            },
            Expression::Binary { op, left, right } if is_float(e) => {
                let (a, b) = (of(*left), of(*right));
                match op {
                    BinaryOperator::Add => a.plus(b),
                    BinaryOperator::Subtract => a.plus(b.negated()),
                    BinaryOperator::Multiply => {
                        let terms = terms(f.ty(module, *left), f.ty(module, *right));
                        match terms == 1 && is_same(values, context, *left, *right) {
                            true => a.squared(),
                            false => sum(a.times(b), terms),
                        }
                    }
                    BinaryOperator::Divide => a.times(self.inverse(values, context, *right)),
                    BinaryOperator::Modulo => a.remainder(b),
                    _ => Range::ANYTHING,
                }
            }
            Expression::Math {
                fun,
                arg,
                arg1,
                arg2,
                ..
            } if is_float(e) => {
                let second = arg1.map_or(Range::ANYTHING, of);
                let third = arg2.map_or(Range::ANYTHING, of);
                let dimension = dimension(f.ty(module, *arg));
                let same = arg1.is_some_and(|b| is_same(values, context, *arg, b));
                of_function(*fun, [of(*arg), second, third], dimension, same)
            }
            _ => Range::ANYTHING,
        }
    }
}

fn of_function(fun: MathFunction, [x, y, z]: [Range; 3], dimension: f64, same: bool) -> Range {
    let sized = |r: Range| Range::new(0.0, dimension.sqrt() * r.magnitude());
    match fun {
        MathFunction::Abs => Range::new(x.least(), x.magnitude()),
        MathFunction::Min => Range::new(x.low.min(y.low), x.high.min(y.high)),
        MathFunction::Max => Range::new(x.low.max(y.low), x.high.max(y.high)),
        MathFunction::Clamp => x.clamped(y, z),
        MathFunction::Saturate => x.clamped(Range::new(0.0, 0.0), Range::new(1.0, 1.0)),
        MathFunction::Fract | MathFunction::Step | MathFunction::SmoothStep => Range::UNIT,
        MathFunction::Sign
        | MathFunction::Sin
        | MathFunction::Cos
        | MathFunction::Tanh
        | MathFunction::Normalize => Range::within(1.0),
        MathFunction::Atan | MathFunction::Asin => Range::within(std::f64::consts::FRAC_PI_2),
        MathFunction::Atan2 => Range::within(std::f64::consts::PI),
        MathFunction::Acos => Range::new(0.0, std::f64::consts::PI),
        MathFunction::Sinh => x.rising(f64::sinh),
        MathFunction::Cosh => Range::new(x.least(), x.magnitude()).rising(f64::cosh),
        MathFunction::Asinh => x.rising(f64::asinh),
        MathFunction::Exp => x.rising(f64::exp),
        MathFunction::Exp2 => x.rising(f64::exp2),
        MathFunction::Log if x.low > 0.0 => x.rising(f64::ln),
        MathFunction::Log2 if x.low > 0.0 => x.rising(f64::log2),
        MathFunction::Sqrt if x.low >= 0.0 => x.rising(f64::sqrt),
        MathFunction::InverseSqrt if x.low > 0.0 => Range::new(x.high.powf(-0.5), x.low.powf(-0.5)),
        MathFunction::Radians => x.scaled(1_f64.to_radians()),
        MathFunction::Degrees => x.scaled(1_f64.to_degrees()),
        MathFunction::Floor => x.rising(f64::floor),
        MathFunction::Ceil => x.rising(f64::ceil),
        MathFunction::Round => x.rising(f64::round_ties_even),
        MathFunction::Trunc => x.rising(f64::trunc),
        MathFunction::Dot if same => Range::new(0.0, dimension * x.magnitude() * x.magnitude()),
        MathFunction::Dot => sum(x.times(y), dimension as u8),
        MathFunction::Outer => x.times(y),
        MathFunction::Cross => Range::within(2.0 * x.magnitude() * y.magnitude()),
        MathFunction::Length => sized(x),
        MathFunction::Distance => sized(x.plus(y.negated())),
        // As long as the incident vector if the normal has unit length; this bounds the other
        // cases.
        MathFunction::Reflect => {
            let normal = y.magnitude();
            Range::within(x.magnitude() * (1.0 + 2.0 * dimension * normal * normal))
        }
        MathFunction::Fma => x.times(y).plus(z),
        MathFunction::Mix if z.low >= 0.0 && z.high <= 1.0 => x.or(y),
        MathFunction::Mix => x.plus(y.plus(x.negated()).times(z)),
        MathFunction::Transpose => x,
        MathFunction::Pow if x.low >= 0.0 && y.low >= 0.0 => {
            let ends = [x.low, x.high].map(|a| [a.powf(y.low), a.powf(y.high)]);
            let [[a, b], [c, d]] = ends;
            Range::ordered(a.min(b), c.max(d))
        }
        _ => Range::ANYTHING,
    }
}

fn sum(term: Range, terms: u8) -> Range {
    term.scaled(f64::from(terms))
}

/// Number of products in the sum for a component of a product.
pub fn terms(left: &TypeInner, right: &TypeInner) -> u8 {
    match (left, right) {
        (
            TypeInner::Matrix { columns, .. },
            TypeInner::Vector { .. } | TypeInner::Matrix { .. },
        ) => *columns as u8,
        (TypeInner::Vector { size, .. }, TypeInner::Matrix { .. }) => *size as u8,
        _ => 1,
    }
}

/// Number of components of a scalar or vector.
pub fn dimension(ty: &TypeInner) -> f64 {
    match ty {
        TypeInner::Vector { size, .. } => f64::from(*size as u8),
        _ => 1.0,
    }
}

/// Whether two expressions are one value.
pub fn is_same(
    values: &Values<'_, '_>,
    context: ContextId,
    a: Handle<Expression>,
    b: Handle<Expression>,
) -> bool {
    crate::analysis::sign::same_value(values, context, a, b)
}

/// Whether any operand outside of `unseen` adds information. For an operation, all operands must be
/// known.
fn joins(values: &Values<'_, '_>, id: ValueId, unseen: &HashSet<ValueId>) -> bool {
    let operands = &values.values[id].operands;
    let is_joined = match &values.values[id].node {
        Node::Version(..) => true,
        Node::Expression(context, e, path) => {
            !path.is_empty()
                || matches!(
                    values.function(*context).function.expressions[*e],
                    Expression::Load { .. } | Expression::CallResult(_)
                )
        }
        Node::Input(_) | Node::Control(..) => false,
    };
    let is_control = |o: &ValueId| matches!(values.values[*o].node, Node::Control(..));
    match is_joined {
        true => operands
            .iter()
            .any(|o| !is_control(o) && !unseen.contains(o)),
        false => !operands.iter().any(|o| unseen.contains(o)),
    }
}

/// The initial value of a local or private variable.
fn initial(values: &Values<'_, '_>, context: ContextId, version: VersionId) -> Option<Range> {
    let f = values.function(context);
    let module = values.graph.module();
    if !matches!(f.memory.origin(version), Origin::Initial) {
        return None;
    }
    let init = match f.memory.cell(version).root {
        Root::Local(v) => f.function.local_variables[v]
            .init
            .map(|e| of_constant(module, &f.function.expressions, e)),
        Root::Global(g) if values.contexts[context].call.is_none() => module.global_variables[g]
            .init
            .map(|e| of_constant(module, &module.global_expressions, e)),
        _ => return None,
    };
    // Otherwise it is zero-initialised.
    Some(init.unwrap_or(Range::new(0.0, 0.0)))
}

fn of_literal(literal: Literal) -> Range {
    let number = match literal {
        Literal::F32(x) => f64::from(x),
        Literal::F64(x) | Literal::AbstractFloat(x) => x,
        Literal::F16(x) => f64::from(x),
        Literal::I32(x) => f64::from(x),
        Literal::U32(x) => f64::from(x),
        _ => return Range::ANYTHING,
    };
    Range::new(number, number)
}

fn of_constant(module: &Module, arena: &Arena<Expression>, e: Handle<Expression>) -> Range {
    match &arena[e] {
        Expression::Literal(l) => of_literal(*l),
        Expression::Constant(c) => of_constant(
            module,
            &module.global_expressions,
            module.constants[*c].init,
        ),
        Expression::ZeroValue(_) => Range::new(0.0, 0.0),
        Expression::Compose { components, .. } => components
            .iter()
            .map(|c| of_constant(module, arena, *c))
            .reduce(Range::or)
            .unwrap_or(Range::ANYTHING),
        Expression::Splat { value, .. } => of_constant(module, arena, *value),
        _ => Range::ANYTHING,
    }
}

/// The shader's inputs.
struct Outside<'a> {
    known: &'a [SourceRange],
    ordinary: f64,
}

impl Outside<'_> {
    fn input(&self, values: &Values<'_, '_>, input: usize) -> Range {
        let inputs = reflect::inputs(values.graph.module(), values.function(0).function);
        match inputs.get(input).and_then(|io| io.binding.clone()) {
            Some(Binding::Location { location, .. }) => self.of(&Source::Varying { location }),
            _ => Range::ANYTHING,
        }
    }

    fn memory(
        &self,
        values: &Values<'_, '_>,
        context: ContextId,
        pointer: Handle<Expression>,
        path: &[u32],
    ) -> Range {
        let module = values.graph.module();
        let expressions = &values.function(context).function.expressions;
        // The outermost step selects the variable's own member.
        let (mut at, mut member) = (pointer, path.first().copied());
        let global = loop {
            match expressions[at] {
                Expression::AccessIndex { base, index } => (at, member) = (base, Some(index)),
                Expression::Access { base, .. } => (at, member) = (base, None),
                Expression::GlobalVariable(g) => break Some(&module.global_variables[g]),
                _ => break None,
            }
        };
        let Some((global, binding)) = global.and_then(|g| Some((g, g.binding?))) else {
            return self.unknown();
        };
        let member = match &module.types[global.ty].inner {
            TypeInner::Struct { members, .. } => {
                member.and_then(|m| members.get(m as usize)?.name.clone())
            }
            _ => None,
        };
        self.of(&Source::Buffer {
            group: binding.group,
            binding: binding.binding,
            member,
        })
    }

    fn of(&self, source: &Source) -> Range {
        let seen = self.known.iter().find(|k| k.source == *source);
        seen.map_or(self.unknown(), |k| {
            Range::ordered(f64::from(k.low), f64::from(k.high))
        })
    }

    /// The range of an unknown input: unbounded with a scene, ordinary without one.
    fn unknown(&self) -> Range {
        match self.known.is_empty() {
            true => Range::within(self.ordinary),
            false => Range::ANYTHING,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Range;

    /// For every pair of numbers in two ranges, the result is in the computed range.
    fn holds(of: impl Fn(Range, Range) -> Range, by: impl Fn(f64, f64) -> f64) {
        let ends: [f64; 10] = [-9.0, -5.0, -3.0, -0.5, 0.0, 0.5, 2.0, 3.0, 5.0, 10.0];
        let all = || {
            ends.iter().flat_map(|a| {
                ends.iter()
                    .filter(move |b| a <= *b)
                    .map(move |b| Range::new(*a, *b))
            })
        };
        let inside = |r: Range| (0..=8).map(move |i| r.low + (r.high - r.low) * f64::from(i) / 8.0);
        for x in all() {
            for y in all() {
                let range = of(x, y);
                for a in inside(x) {
                    for b in inside(y) {
                        let number = by(a, b);
                        let is_in = number >= range.low - 1e-9 && number <= range.high + 1e-9;
                        assert!(is_in || number.is_nan(), "{a} {b}: {number} in {range:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn ranges_hold_what_they_say() {
        holds(Range::remainder, |a, b| a % b);
        holds(Range::plus, |a, b| a + b);
        holds(Range::times, |a, b| a * b);
        holds(|x, y| x.times(y.inverse()), |a, b| a / b);
        holds(
            |x, y| x.clamped(y, Range::new(3.0, 7.0)),
            |a, b| a.max(b).min(5.0),
        );
        holds(
            |x, y| x.clamped(Range::new(-4.0, 1.0), y),
            |a, b| a.max(0.0).min(b),
        );
    }
}
