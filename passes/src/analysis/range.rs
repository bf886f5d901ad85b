//! Range analysis: the interval of each value of a fragment stage.
//!
//! The ranges of varyings and draw constants come from a scene or from assumptions; the code gives
//! the rest. An interval covers every component of its value. Its bounds are real numbers; users
//! account for rounding beyond them.

use std::collections::HashSet;

use naga::{
    AddressSpace, Arena, BinaryOperator, Binding, Expression, Handle, Literal, MathFunction,
    Module, ScalarKind, TypeInner, UnaryOperator,
};

use crate::analysis::values::cycle::{Merges, UNCOUNTED_ITERATIONS, operands_first};
use crate::analysis::values::{ContextId, Node, ValueId, Values};
use naga_edit::interface;
use naga_interp::Number;
use naga_interp::accuracy::Accuracy;
use naga_interp::interval::{Arithmetic, Interval};
use preshade_dataflow::graph::cells::Root;
use preshade_dataflow::graph::memory::{Origin, VersionId};
use preshade_dataflow::graph::rate::Rate;
use preshade_plan::pass::{Source, SourceRange};

/// Most values times iterations to follow around one loop; beyond that, ranges are assumed
/// unbounded.
const MOST_FOLLOWED: usize = 200_000;
/// Most rounds within an iteration; the rest is treated the same.
const MOST_ROUNDS: usize = 16;

#[derive(Debug)]
pub(crate) struct AllRanges {
    of: Vec<Interval>,
    arithmetic: Arithmetic,
    /// Magnitude of unknown inputs; `None` if they are unbounded.
    assumed: Option<f64>,
}

impl AllRanges {
    /// Ranges of the exact values. `known` are measured inputs. All others are assumed to lie
    /// within `ordinary` of 0, texels too.
    pub fn new(
        values: &Values<'_, '_>,
        cycles: &[Vec<ValueId>],
        known: &[SourceRange],
        ordinary: f64,
    ) -> Self {
        let outside = Outside {
            known,
            ordinary,
            texels: Interval::up_to(ordinary),
        };
        let assumed = known.is_empty().then_some(ordinary);
        Self::found(values, cycles, &outside, assumed, Arithmetic::Real)
    }

    /// Ranges of the finite values that any adapter computes from any inputs.
    pub fn computed(values: &Values<'_, '_>, cycles: &[Vec<ValueId>]) -> Self {
        let outside = Outside {
            known: &[],
            ordinary: f64::INFINITY,
            texels: Interval::ANYTHING,
        };
        Self::found(values, cycles, &outside, None, Arithmetic::Finite)
    }

    /// Ranges of the finite values that any adapter computes from texels of 0 to 1 and from inputs that
    /// are `known`, or else within `ordinary` of 0.
    pub fn of_unit_texels(
        values: &Values<'_, '_>,
        cycles: &[Vec<ValueId>],
        known: &[SourceRange],
        ordinary: f64,
    ) -> Self {
        let outside = Outside {
            known,
            ordinary,
            texels: Interval::UNIT,
        };
        Self::found(values, cycles, &outside, None, Arithmetic::Finite)
    }

    fn found(
        values: &Values<'_, '_>,
        cycles: &[Vec<ValueId>],
        outside: &Outside<'_>,
        assumed: Option<f64>,
        arithmetic: Arithmetic,
    ) -> Self {
        let mut ranges = Self {
            of: vec![Interval::ANYTHING; values.values.len()],
            arithmetic,
            assumed,
        };
        for cycle in cycles.iter().rev() {
            let is_circular =
                cycle.len() > 1 || values.values[cycle[0]].operands.contains(&cycle[0]);
            if !is_circular {
                ranges.of[cycle[0]] = ranges.find(values, cycle[0], outside, &HashSet::new());
            } else if !ranges.iterate(values, cycle, outside) {
                for id in cycle {
                    ranges.of[*id] = Interval::ANYTHING;
                }
            }
        }
        ranges
    }

    /// The ranges of a cycle. If following its iterations doesn't settle them, bounds that still
    /// change are dropped. `false` if the ranges don't settle even so.
    fn iterate(
        &mut self,
        values: &Values<'_, '_>,
        cycle: &[ValueId],
        outside: &Outside<'_>,
    ) -> bool {
        let merges = Merges::of(values, cycle);
        // Without the merges there is hardly a cycle; with operands first, one or two rounds
        // suffice.
        let rest = operands_first(values, cycle, &merges.of);
        let mut unseen: HashSet<ValueId> = cycle.iter().copied().collect();
        if self.follow(values, &rest, &merges, outside, &mut unseen) {
            return true;
        }
        let all = [rest, merges.of].concat();
        let mut rounds = 0..MOST_ROUNDS;
        rounds.any(|_| !self.join(values, &all, outside, &mut unseen, widened)) && unseen.is_empty()
    }

    /// Follows the iterations of a cycle, starting empty: unreached values are ignored in joins.
    /// The loop-carried values change only after the others have settled. `false` if the ranges may
    /// grow further.
    fn follow(
        &mut self,
        values: &Values<'_, '_>,
        rest: &[ValueId],
        merges: &Merges,
        outside: &Outside<'_>,
        unseen: &mut HashSet<ValueId>,
    ) -> bool {
        let iterations = merges.iterations.unwrap_or(UNCOUNTED_ITERATIONS);
        if iterations.saturating_mul(unseen.len()) > MOST_FOLLOWED {
            return false;
        }
        for _ in 0..iterations {
            let mut rounds = 0..MOST_ROUNDS;
            if !rounds.any(|_| !self.join(values, rest, outside, unseen, Interval::or)) {
                return false;
            }
            if !self.join(values, &merges.of, outside, unseen, Interval::or) && unseen.is_empty() {
                return true;
            }
        }
        merges.iterations.is_some() && unseen.is_empty()
    }

    /// Joins new results into the ranges; returns whether any changed.
    fn join(
        &mut self,
        values: &Values<'_, '_>,
        ids: &[ValueId],
        outside: &Outside<'_>,
        unseen: &mut HashSet<ValueId>,
        joined: fn(Interval, Interval) -> Interval,
    ) -> bool {
        let mut changed = false;
        for id in ids {
            let found = self.find(values, *id, outside, unseen);
            let next = match unseen.contains(id) {
                true if joins(values, *id, unseen) => {
                    unseen.remove(id);
                    found
                }
                true => continue,
                false => joined(self.of[*id], found),
            };
            changed |= self.of[*id] != next;
            self.of[*id] = next;
        }
        changed
    }

    pub fn of(&self, id: ValueId) -> Interval {
        self.of[id]
    }

    /// The range of an expression, if an observed value depends on it.
    pub fn operand(
        &self,
        values: &Values<'_, '_>,
        context: ContextId,
        e: Handle<Expression>,
    ) -> Interval {
        match values.named(context, e) {
            Some(id) if has_word(values, context, e) => self.of[id],
            _ => Interval::ANYTHING,
        }
    }

    /// The range of an expression's inverse. If inputs are unknown, a divisor from the draw is
    /// assumed ordinary too: its inverse is as bounded as itself.
    pub fn inverse(
        &self,
        values: &Values<'_, '_>,
        context: ContextId,
        e: Handle<Expression>,
    ) -> Interval {
        let range = self.operand(values, context, e);
        let is_of_draw = values
            .named(context, e)
            .is_some_and(|v| matches!(values.values[v].fact.rate, Rate::Draw | Rate::Instance));
        match self.assumed {
            Some(ordinary) if is_of_draw && range.least() < 1.0 / ordinary => {
                Interval::up_to(ordinary)
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
    ) -> Interval {
        let joined = |is_joined: fn(&Node) -> bool| {
            let operands = values.values[id].operands.iter();
            operands
                .filter(|o| is_joined(&values.values[**o].node) && !unseen.contains(o))
                .map(|o| self.of[*o])
                .reduce(Interval::or)
                .unwrap_or(Interval::ANYTHING)
        };
        let data = || joined(|node| !matches!(node, Node::Control(..)));
        let (context, e, path) = match &values.values[id].node {
            Node::Input(input) => return outside.input(values, *input),
            Node::Control(..) => return Interval::ANYTHING,
            Node::Version(context, version) => {
                return initial(values, *context, *version).unwrap_or_else(data);
            }
            Node::Expression(context, e, path) => (*context, *e, path),
        };
        if !has_word(values, context, e) {
            return Interval::ANYTHING;
        }
        let f = values.function(context);
        match &f.function.expressions[e] {
            Expression::CallResult(_) => data(),
            Expression::Load { pointer } => {
                match f.ty(values.graph.module(), *pointer).pointer_space() {
                    Some(AddressSpace::Function | AddressSpace::Private) => {
                        joined(|node| matches!(node, Node::Version(..)))
                    }
                    _ => outside.memory(values, context, *pointer, path),
                }
            }
            _ if !path.is_empty() => data(),
            expression => self.of_operation(values, context, e, expression, outside),
        }
    }

    fn of_operation(
        &self,
        values: &Values<'_, '_>,
        context: ContextId,
        e: Handle<Expression>,
        expression: &Expression,
        outside: &Outside<'_>,
    ) -> Interval {
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
                .reduce(Interval::or)
                .unwrap_or(Interval::ANYTHING),
            Expression::Splat { value, .. } => of(*value),
            Expression::Swizzle { vector, .. } => of(*vector),
            Expression::AccessIndex { base, .. } | Expression::Access { base, .. } => of(*base),
            Expression::Select { accept, reject, .. } => of(*accept).or(of(*reject)),
            Expression::Unary {
                op: UnaryOperator::Negate,
                expr,
            } => of(*expr).negated(),
            Expression::ImageSample { .. } | Expression::ImageLoad { .. } if is_float(e) => {
                outside.texels
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
            } if has_word(values, context, *expr) => match f.ty(module, *expr).scalar_kind() {
                Some(ScalarKind::Uint) => Interval::new(0.0, f64::from(u32::MAX)),
                Some(ScalarKind::Sint) => Interval::up_to(f64::from(i32::MIN).abs()),
                Some(ScalarKind::Bool) => Interval::UNIT,
                _ => Interval::ANYTHING,
            },
            Expression::Binary { op, left, right } if is_float(e) => {
                let (a, b) = (of(*left), of(*right));
                let terms = terms(f.ty(module, *left), f.ty(module, *right));
                match op {
                    BinaryOperator::Multiply
                        if terms == 1 && values.is_same(context, *left, *right) =>
                    {
                        self.arithmetic
                            .covering(&[a], a.squared(), Accuracy::ROUNDED)
                    }
                    BinaryOperator::Multiply => self.sum(self.product(a, b), terms),
                    BinaryOperator::Divide if self.assumed.is_some() => {
                        self.product(a, self.inverse(values, context, *right))
                    }
                    _ => self
                        .arithmetic
                        .binary(*op, a, b)
                        .unwrap_or(Interval::ANYTHING),
                }
            }
            Expression::Math {
                fun,
                arg,
                arg1,
                arg2,
                ..
            } if is_float(e) => {
                let arguments =
                    [Some(*arg), *arg1, *arg2].map(|a| a.map_or(Interval::ANYTHING, of));
                let dimension = dimension(f.ty(module, *arg));
                let same = arg1.is_some_and(|b| values.is_same(context, *arg, b));
                self.of_function(*fun, arguments, dimension, same)
            }
            _ => Interval::ANYTHING,
        }
    }

    fn product(&self, a: Interval, b: Interval) -> Interval {
        let product = self.arithmetic.binary(BinaryOperator::Multiply, a, b);
        product.unwrap_or(Interval::ANYTHING)
    }

    /// The sum of so many numbers of this range.
    fn sum(&self, term: Interval, terms: u8) -> Interval {
        let exact = term.times(Interval::exactly(f64::from(terms)));
        match terms {
            1 => exact,
            _ => self.arithmetic.covering(&[], exact, VECTOR),
        }
    }

    /// Functions of whole vectors and matrices are here, those of components in [`Arithmetic`].
    fn of_function(
        &self,
        fun: MathFunction,
        [x, y, z]: [Interval; 3],
        dimension: f64,
        same: bool,
    ) -> Interval {
        let (a, b) = (x.magnitude(), y.magnitude());
        let sized = |r: Interval| Interval::new(0.0, dimension.sqrt() * r.magnitude());
        let exact = match fun {
            MathFunction::Normalize => Interval::up_to(1.0),
            MathFunction::Dot if same => Interval::new(0.0, dimension * a * a),
            MathFunction::Dot => self.sum(self.product(x, y), dimension as u8),
            MathFunction::Outer => self.product(x, y),
            MathFunction::Cross => Interval::up_to(2.0 * a * b),
            MathFunction::Length => sized(x),
            MathFunction::Distance => sized(x.plus(y.negated())),
            // As long as the incident vector if the normal has unit length; this bounds the other
            // cases.
            MathFunction::Reflect => Interval::up_to(a * (1.0 + 2.0 * dimension * b * b)),
            MathFunction::Transpose => return x,
            _ => {
                let found = self.arithmetic.call(fun, &[x, y, z]);
                return found.unwrap_or(Interval::ANYTHING);
            }
        };
        self.arithmetic.covering(&[], exact, VECTOR)
    }
}

/// Accuracy of the functions of vectors: sums of at most four products, and a root.
const VECTOR: Accuracy = Accuracy::ulps(16.0);

/// The union with `found`, where a bound that changes is dropped, first to 0.
fn widened(before: Interval, found: Interval) -> Interval {
    let low = match found.low {
        low if low >= before.low => before.low,
        low if low >= 0.0 => 0.0,
        _ => f64::NEG_INFINITY,
    };
    let high = match found.high {
        high if high <= before.high => before.high,
        high if high <= 0.0 => 0.0,
        _ => f64::INFINITY,
    };
    Interval::new(low, high)
}

/// Whether its numbers have 32 bits. Rounding and overflow are those of `f32`; nothing is assumed
/// about another width.
fn has_word(values: &Values<'_, '_>, context: ContextId, e: Handle<Expression>) -> bool {
    let ty = values.function(context).ty(values.graph.module(), e);
    let scalar = ty.scalar();
    scalar.is_none_or(|s| s.width == 4 || s.kind == ScalarKind::Bool)
}

/// Number of products in the sum for a component of a product.
pub(crate) fn terms(left: &TypeInner, right: &TypeInner) -> u8 {
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
pub(crate) fn dimension(ty: &TypeInner) -> f64 {
    match ty {
        TypeInner::Vector { size, .. } => f64::from(*size as u8),
        _ => 1.0,
    }
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
fn initial(values: &Values<'_, '_>, context: ContextId, version: VersionId) -> Option<Interval> {
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
    Some(init.unwrap_or(Interval::exactly(0.0)))
}

fn of_literal(literal: Literal) -> Interval {
    let number = match literal {
        Literal::F32(x) => f64::from(x),
        Literal::I32(x) => f64::from(x),
        Literal::U32(x) => f64::from(x),
        _ => return Interval::ANYTHING,
    };
    Interval::exactly(number)
}

fn of_constant(module: &Module, arena: &Arena<Expression>, e: Handle<Expression>) -> Interval {
    match &arena[e] {
        Expression::Literal(l) => of_literal(*l),
        Expression::Constant(c) => of_constant(
            module,
            &module.global_expressions,
            module.constants[*c].init,
        ),
        Expression::ZeroValue(_) => Interval::exactly(0.0),
        Expression::Compose { components, .. } => components
            .iter()
            .map(|c| of_constant(module, arena, *c))
            .reduce(Interval::or)
            .unwrap_or(Interval::ANYTHING),
        Expression::Splat { value, .. } => of_constant(module, arena, *value),
        _ => Interval::ANYTHING,
    }
}

/// Ranges of the shader's inputs.
struct Outside<'a> {
    known: &'a [SourceRange],
    ordinary: f64,
    texels: Interval,
}

impl Outside<'_> {
    fn input(&self, values: &Values<'_, '_>, input: usize) -> Interval {
        let inputs = interface::inputs(values.graph.module(), values.function(0).function);
        match inputs.get(input).and_then(|io| io.binding.clone()) {
            Some(Binding::Location { location, .. }) => self.of(&Source::Varying { location }),
            _ => Interval::ANYTHING,
        }
    }

    fn memory(
        &self,
        values: &Values<'_, '_>,
        context: ContextId,
        pointer: Handle<Expression>,
        path: &[u32],
    ) -> Interval {
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

    fn of(&self, source: &Source) -> Interval {
        let seen = self.known.iter().find(|k| k.source == *source);
        seen.map_or(self.unknown(), |k| {
            Interval::new(f64::from(k.low), f64::from(k.high))
        })
    }

    /// The range of an unknown input: unbounded with a scene, ordinary without one.
    fn unknown(&self) -> Interval {
        match self.known.is_empty() {
            true => Interval::up_to(self.ordinary),
            false => Interval::ANYTHING,
        }
    }
}
