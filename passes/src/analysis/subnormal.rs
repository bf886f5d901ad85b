//! Finds values of the draw that a subnormal number may change.
//!
//! A language lets each stage flush a subnormal number (below 2^-126, and not 0) to 0, or keep it.
//! On llvmpipe the fragment stage flushes it; the vertex and the compute stage keep it, and so does
//! a host. After a comparison, a conversion or a large factor the difference is as large as any. So
//! a value that moves to another stage must not depend on an operation with a subnormal operand,
//! result or term.
//!
//! For each value we keep the range of each component, and a magnitude below which the only number
//! is 0. A difference has such a magnitude, too: numbers of `f32` that are no smaller than `m` are
//! multiples of about `m` 2^-24, and so is a sum of them, however many there are. The numbers of
//! the draw come from a scene. Other inputs are unknown, and so are values computed from them:
//! there the contract assumes it (`stages-agree`).

use std::f64::consts::LOG2_E;

use naga::{
    AddressSpace, Arena, BinaryOperator, Expression, Handle, Literal, MathFunction, Module,
    ScalarKind, TypeInner, UnaryOperator,
};

use crate::analysis::named::span;
use crate::analysis::range::terms;
use crate::analysis::reach::with_users;
use crate::analysis::refusals;
use crate::analysis::values::{ContextId, Node, ValueId, Values};
use naga_interp::interval::{Arithmetic, Interval};
use preshade_dataflow::graph::Graph;
use preshade_dataflow::graph::cells::Root;
use preshade_dataflow::graph::memory::{Origin, VersionId};
use preshade_dataflow::graph::rate::Rate;
use preshade_plan::pass::{self, Facts, Refusal, Source, SourceRange};
use preshade_plan::plan::Plan;

/// Least normal number.
const NORMAL: f64 = f32::MIN_POSITIVE as f64;
/// A product below this is rounded to 0 by every stage: half of the least subnormal number.
const NOTHING: f64 = NORMAL * f32::EPSILON as f64 / 2.0;
/// A subnormal term of a sum that is at least this large does not change it.
const LARGE: f64 = NORMAL * (1 << 26) as f64;
/// The least part of a number to which adding and subtracting may reduce it.
const STEP: f64 = 1.0 / (1 << 24) as f64;
/// A wave of a number that is none of its zeros is at least this large.
const OFF_ZERO: f64 = 1e-12;
/// Rounds through the values of a loop.
const MOST_ROUNDS: usize = 16;

/// Values that another stage may compute differently, because they depend on a subnormal number.
/// `known` are the numbers of the material.
pub(crate) fn changed(values: &Values<'_, '_>, known: &[SourceRange]) -> Vec<bool> {
    with_users(values, met(values, known))
}

/// A refusal to run these entry points in another stage if they compute with a subnormal number of the
/// draw.
///
/// # Errors
/// They do.
pub fn check(
    pass: &str,
    plan: &Plan,
    graph: &Graph<'_>,
    entries: &[usize],
    facts: &Facts,
) -> Result<(), Box<Refusal>> {
    let known = facts.ranges.iter().filter(|r| r.material == plan.material);
    let known: Vec<SourceRange> = known.cloned().collect();
    for entry in entries {
        // A stage that is too large is refused elsewhere.
        let Ok(values) = Values::new(graph, *entry) else {
            continue;
        };
        if let Some(id) = met(&values, &known).first() {
            let refusal = Refusal::new(
                pass,
                &refusals::SUBNORMAL,
                "it would compute in another stage with a number of the draw that is subnormal (below \
                 2^-126, and not 0), which some stages of a driver take for 0",
                "set that number to 0, or leave the material as it is",
            );
            let span = span(&values, *id);
            let sources = graph.program().sources();
            return Err(Box::new(match span {
                Some(span) => refusal.at(sources, span),
                None => refusal,
            }));
        }
    }
    Ok(())
}

/// Operations with a subnormal operand, term or result: on numbers of the draw, or on numbers of the
/// draw and others.
fn met(values: &Values<'_, '_>, known: &[SourceRange]) -> Vec<ValueId> {
    let mut search = Search {
        values,
        known,
        of: vec![None; values.values.len()],
        met: false,
    };
    for cycle in values.cycles().iter().rev() {
        let is_circular = cycle.len() > 1 || values.values[cycle[0]].operands.contains(&cycle[0]);
        let rounds = if is_circular { MOST_ROUNDS } else { 1 };
        for _ in 0..rounds {
            let before: Vec<_> = cycle.iter().map(|id| search.of[*id].clone()).collect();
            for id in cycle.iter().rev() {
                let found = search.find(*id);
                search.of[*id] = match (is_circular, &search.of[*id], found) {
                    (true, Some(a), Some(b)) if a.len() == b.len() => {
                        Some(a.iter().zip(b).map(|(a, b)| a.or(b)).collect())
                    }
                    (_, _, found) => found,
                };
            }
            if before.iter().zip(cycle).all(|(b, id)| *b == search.of[*id]) {
                break;
            }
        }
    }
    let mut meets = |id: &ValueId| {
        search.met = false;
        search.find(*id);
        search.met
    };
    (0..values.values.len()).filter(|id| meets(id)).collect()
}

/// Numbers that are 0, or in a range and of a least magnitude.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Numbers {
    range: Interval,
    /// The least magnitude of a number that is not 0. Infinite: all are 0.
    least: f64,
    /// All are multiples of a number that is at least this large, and so are their sums.
    grain: f64,
}

impl Numbers {
    const ZERO: Self = Self {
        range: Interval::new(0.0, 0.0),
        least: f64::INFINITY,
        grain: f64::INFINITY,
    };

    /// Numbers of unknown bits.
    const ANY: Self = Self {
        range: Interval::ANYTHING,
        least: f32::from_bits(1) as f64,
        grain: f32::from_bits(1) as f64,
    };

    fn new(range: Interval, least: f64) -> Self {
        let least = least.max(range.least());
        Self {
            range,
            least,
            grain: least * STEP,
        }
    }

    fn exactly(number: f64) -> Self {
        match number == 0.0 {
            true => Self::ZERO,
            false => Self::new(Interval::exactly(number), number.abs()),
        }
    }

    fn of_scene(numbers: &pass::Numbers) -> Self {
        let [low, high, least] = [numbers.low, numbers.high, numbers.least].map(f64::from);
        let least = if least == 0.0 { f64::INFINITY } else { least };
        Self::new(Interval::new(low, high), least)
    }

    fn or(self, other: Self) -> Self {
        Self {
            range: self.range.or(other.range),
            least: self.least.min(other.least),
            grain: self.grain.min(other.grain),
        }
    }

    fn is_zero(self) -> bool {
        self.least.is_infinite()
    }

    /// Whether one of them may be subnormal.
    fn may_be_subnormal(self) -> bool {
        self.least < NORMAL && self.range.magnitude() > NOTHING
    }

    fn negated(self) -> Self {
        Self {
            range: Interval::new(-self.range.high, -self.range.low),
            ..self
        }
    }

    fn times(self, other: Self) -> Self {
        let least = match self.is_zero() || other.is_zero() {
            true => f64::INFINITY,
            false => self.least * other.least,
        };
        Self::new(self.range.times(other.range), least)
    }

    fn plus(self, other: Self) -> Self {
        if self.is_zero() {
            return other;
        }
        if other.is_zero() {
            return self;
        }
        let grain = self.grain.min(other.grain);
        let (a, b) = (self.range, other.range);
        let is_one_sided = (a.low >= 0.0 && b.low >= 0.0) || (a.high <= 0.0 && b.high <= 0.0);
        let least = match is_one_sided {
            true => self.least.min(other.least),
            false => grain,
        };
        Self {
            grain,
            ..Self::new(a.plus(b), least)
        }
    }

    fn over(self, divisor: Self) -> Self {
        let least = match self.is_zero() {
            true => f64::INFINITY,
            false => self.least / divisor.range.magnitude(),
        };
        Self::new(self.range.over(divisor.range), least)
    }

    fn root(self) -> Self {
        let root = |x: f64| x.max(0.0).sqrt();
        Self::new(self.range.rising(root), self.least.sqrt())
    }
}

/// The numbers of each component; of all together if the type is neither a scalar nor a vector.
/// `None`: nothing is known.
type Known = Option<Vec<Numbers>>;

fn together(known: &[Numbers]) -> Option<Numbers> {
    known.iter().copied().reduce(Numbers::or)
}

struct Search<'a, 'g, 'p> {
    values: &'a Values<'g, 'p>,
    known: &'a [SourceRange],
    of: Vec<Known>,
    /// Whether the operation that was last looked at has a subnormal operand, term or result.
    met: bool,
}

impl Search<'_, '_, '_> {
    fn find(&mut self, id: ValueId) -> Known {
        let values = self.values;
        let joined = |is_joined: fn(&Node) -> bool| {
            let operands = values.values[id].operands.iter();
            let mut operands = operands.filter(|o| is_joined(&values.values[**o].node));
            // A cycle begins with the known values outside of it.
            let known = operands.by_ref().filter_map(|o| self.of[*o].clone());
            known.reduce(|a, b| match a.len() == b.len() {
                true => a.iter().zip(&b).map(|(a, b)| a.or(*b)).collect(),
                false => Vec::from_iter(together(&[a, b].concat())),
            })
        };
        let (context, e, path) = match &values.values[id].node {
            Node::Version(context, version) => {
                let start = self.initial(*context, *version);
                return start.or_else(|| joined(|node| !matches!(node, Node::Control(..))));
            }
            Node::Input(_) | Node::Control(..) => return None,
            Node::Expression(context, e, path) => (*context, *e, path),
        };
        let f = values.function(context);
        let ty = f.ty(values.graph.module(), e);
        match &f.function.expressions[e] {
            Expression::CallResult(_) => joined(|node| !matches!(node, Node::Control(..))),
            Expression::Load { pointer } => {
                match f.ty(values.graph.module(), *pointer).pointer_space() {
                    Some(AddressSpace::Function | AddressSpace::Private) => {
                        joined(|node| matches!(node, Node::Version(..)))
                    }
                    _ => self.memory(context, *pointer, path),
                }
            }
            _ if !path.is_empty() => joined(|node| !matches!(node, Node::Control(..))),
            Expression::ImageSample { .. } | Expression::ImageLoad { .. } => None,
            // A reinterpretation keeps the bits, and an integer may have those of any number.
            Expression::As {
                kind: ScalarKind::Float,
                expr,
                convert: None,
            } => match f.ty(values.graph.module(), *expr).scalar_kind() {
                Some(ScalarKind::Float) => self.operand(context, *expr),
                _ => {
                    let is_of_draw = values.values[id].fact.rate <= Rate::Draw;
                    is_of_draw.then(|| vec![Numbers::ANY; width(ty)])
                }
            },
            expression => {
                let found = self.operation(context, expression, ty);
                let is_of_draw = values.values[id].fact.rate <= Rate::Draw;
                let computes = matches!(
                    expression,
                    Expression::Binary { .. } | Expression::Math { .. } | Expression::As { .. }
                );
                if computes && found.iter().flatten().any(|n| n.may_be_subnormal()) {
                    self.met |= is_of_draw;
                }
                found
            }
        }
    }

    /// The numbers that a local variable starts with.
    fn initial(&self, context: ContextId, version: VersionId) -> Known {
        let f = self.values.function(context);
        let module = self.values.graph.module();
        let Root::Local(local) = f.memory.cell(version).root else {
            return None;
        };
        let local = &f.function.local_variables[local];
        match (f.memory.origin(version), local.init) {
            (Origin::Initial, Some(init)) => constant(module, &f.function.expressions, init),
            (Origin::Initial, None) => {
                Some(vec![Numbers::ZERO; width(&module.types[local.ty].inner)])
            }
            _ => None,
        }
    }

    /// The numbers of an operand, if it holds floats.
    fn operand(&self, context: ContextId, e: Handle<Expression>) -> Known {
        let id = self.values.named(context, e);
        id.and_then(|id| self.of[id].clone())
    }

    fn operation(&mut self, context: ContextId, expression: &Expression, ty: &TypeInner) -> Known {
        let f = self.values.function(context);
        let module = self.values.graph.module();
        let is_float =
            |e: &Handle<Expression>| f.ty(module, *e).scalar_kind() == Some(ScalarKind::Float);
        match expression {
            Expression::Literal(Literal::F32(x)) => {
                return Some(vec![Numbers::exactly(f64::from(*x))]);
            }
            Expression::Constant(c) => {
                return constant(
                    module,
                    &module.global_expressions,
                    module.constants[*c].init,
                );
            }
            Expression::ZeroValue(_) => {
                return Some(vec![Numbers::ZERO; width(ty)]);
            }
            Expression::Splat { value, .. } => {
                let value = self.operand(context, *value)?;
                return Some(vec![*value.first()?; width(ty)]);
            }
            Expression::Compose { components, .. } => {
                let parts = components.iter().map(|c| self.operand(context, *c));
                let parts = parts.collect::<Option<Vec<_>>>()?.concat();
                return match parts.len() == width(ty) {
                    true => Some(parts),
                    false => Some(vec![together(&parts)?]),
                };
            }
            Expression::AccessIndex { base, index } => {
                let base = self.operand(context, *base)?;
                let at = base.get(*index as usize).filter(|_| base.len() > 1);
                return Some(vec![at.copied().or_else(|| together(&base))?; width(ty)]);
            }
            Expression::Access { base, .. } => {
                let base = together(&self.operand(context, *base)?)?;
                return Some(vec![base; width(ty)]);
            }
            Expression::Swizzle {
                vector, pattern, ..
            } => {
                let vector = self.operand(context, *vector)?;
                let taken = pattern.iter().take(width(ty));
                return taken.map(|c| vector.get(*c as usize).copied()).collect();
            }
            Expression::Select { accept, reject, .. } => {
                let (a, b) = (
                    self.operand(context, *accept)?,
                    self.operand(context, *reject)?,
                );
                return Some(a.iter().zip(b).map(|(a, b)| a.or(b)).collect());
            }
            Expression::Unary {
                op: UnaryOperator::Negate,
                expr,
            } if is_float(expr) => {
                let of = self.operand(context, *expr)?;
                return Some(of.into_iter().map(Numbers::negated).collect());
            }
            // The bits as an integer.
            Expression::As { convert: None, .. } => return None,
            _ => {}
        }
        let read = naga_operands::of_expression(expression);
        let floats = read.iter().filter(|e| is_float(e));
        let floats = floats.filter_map(|e| self.operand(context, *e)).flatten();
        self.met |= floats.fold(false, |met, n| met | n.may_be_subnormal());
        if ty.scalar_kind() != Some(ScalarKind::Float) {
            return None;
        }
        match expression {
            Expression::Binary { op, left, right } => {
                let (a, b) = (
                    self.operand(context, *left)?,
                    self.operand(context, *right)?,
                );
                let terms = terms(f.ty(module, *left), f.ty(module, *right));
                if terms > 1 {
                    let products = together(&a)?.times(together(&b)?);
                    let sum = self.sum(&vec![products; usize::from(terms)]);
                    return Some(vec![sum; width(ty)]);
                }
                componentwise(&[a, b], width(ty), |n| binary(*op, n[0], n[1]))
            }
            Expression::Math {
                fun,
                arg,
                arg1,
                arg2,
                ..
            } => {
                let given = [Some(*arg), *arg1, *arg2].into_iter().flatten();
                let given: Option<Vec<_>> = given.map(|e| self.operand(context, e)).collect();
                self.math(*fun, &given?, width(ty))
            }
            _ => None,
        }
    }

    /// The sum of terms that may be fused into it: a subnormal one changes no large sum.
    fn sum(&mut self, terms: &[Numbers]) -> Numbers {
        let sum = terms.iter().copied().reduce(Numbers::plus);
        let sum = sum.unwrap_or(Numbers::ZERO);
        self.met |= sum.range.least() < LARGE && terms.iter().any(|t| t.may_be_subnormal());
        sum
    }

    fn dot(&mut self, a: &[Numbers], b: &[Numbers]) -> Numbers {
        let products = a.iter().zip(b).map(|(a, b)| match a == b {
            true => Numbers::new(a.range.squared(), a.least * a.least),
            false => a.times(*b),
        });
        let products: Vec<Numbers> = products.collect();
        self.sum(&products)
    }

    fn math(&mut self, fun: MathFunction, given: &[Vec<Numbers>], width: usize) -> Known {
        use MathFunction as M;
        let minus = |a: &[Numbers], b: &[Numbers]| -> Vec<Numbers> {
            a.iter().zip(b).map(|(a, b)| a.plus(b.negated())).collect()
        };
        match (fun, given) {
            (M::Dot, [a, b]) => Some(vec![self.dot(a, b)]),
            (M::Length, [a]) => Some(vec![self.dot(a, a).root()]),
            (M::Distance, [a, b]) => {
                let apart = minus(a, b);
                Some(vec![self.dot(&apart, &apart).root()])
            }
            (M::Normalize, [a]) => {
                let length = self.dot(a, a).root();
                let unit = |n: &Numbers| Numbers {
                    range: n.over(length).range.and(Interval::up_to(1.0)),
                    ..n.over(length)
                };
                Some(a.iter().map(unit).collect())
            }
            (M::Cross, [a, b]) if a.len() == 3 && b.len() == 3 => {
                let of = |i: usize, j: usize| [a[i].times(b[j]), a[j].times(b[i]).negated()];
                let each = [of(1, 2), of(2, 0), of(0, 1)];
                Some(each.iter().map(|terms| self.sum(terms)).collect())
            }
            (M::Reflect, [a, n]) => {
                let twice = Numbers::exactly(2.0).times(self.dot(n, a));
                let each = a.iter().zip(n);
                let each = each.map(|(a, n)| self.sum(&[*a, twice.times(*n).negated()]));
                Some(each.collect())
            }
            (M::Fma, [..]) => {
                componentwise(given, width, |n| Some(self.sum(&[n[0].times(n[1]), n[2]])))
            }
            (M::Mix, [..]) => componentwise(given, width, |n| {
                let rest = Numbers::exactly(1.0).plus(n[2].negated());
                Some(self.sum(&[n[0].times(rest), n[1].times(n[2])]))
            }),
            (M::SmoothStep, [..]) => componentwise(given, width, |n| {
                let t = n[2].plus(n[0].negated()).over(n[1].plus(n[0].negated()));
                let square = t.times(t);
                self.met |= t.may_be_subnormal() || square.may_be_subnormal();
                // Beyond the edge it is 1.
                Some(Numbers::new(Interval::UNIT, square.least.min(1.0)))
            }),
            (M::Transpose, [a]) => Some(a.clone()),
            (M::Outer, [a, b]) => Some(vec![together(a)?.times(together(b)?)]),
            (M::Abs | M::Sign | M::Saturate | M::Min | M::Max | M::Clamp, _)
            | (M::Floor | M::Ceil | M::Round | M::Trunc | M::Step | M::Fract, _)
            | (M::Sin | M::Cos | M::Tan | M::Sinh | M::Cosh | M::Tanh | M::Asinh, _)
            | (M::Asin | M::Acos | M::Atan | M::Exp | M::Exp2 | M::Log | M::Log2, _)
            | (M::Sqrt | M::InverseSqrt | M::Pow | M::Radians | M::Degrees, _) => {
                componentwise(given, width, |n| function(fun, n))
            }
            _ => None,
        }
    }

    /// The scene's bounds for a number or vector in a buffer.
    fn memory(&self, context: ContextId, pointer: Handle<Expression>, path: &[u32]) -> Known {
        let module = self.values.graph.module();
        let f = self.values.function(context);
        let mut steps: Vec<Option<u32>> = path.iter().rev().map(|i| Some(*i)).collect();
        let mut at = pointer;
        let global = loop {
            match f.function.expressions[at] {
                Expression::AccessIndex { base, index } => {
                    steps.push(Some(index));
                    at = base;
                }
                Expression::Access { base, .. } => {
                    steps.push(None);
                    at = base;
                }
                Expression::GlobalVariable(g) => break &module.global_variables[g],
                _ => return None,
            }
        };
        let binding = global.binding?;
        let member = match &module.types[global.ty].inner {
            TypeInner::Struct { members, .. } => members.get(steps.pop()?? as usize)?.name.clone(),
            _ => None,
        };
        let source = Source::Buffer {
            group: binding.group,
            binding: binding.binding,
            member,
        };
        let range = self.known.iter().find(|k| k.source == source)?;
        let all: Vec<Numbers> = match range.components.as_slice() {
            // Made before components were looked at.
            [] if range.low == range.high => vec![Numbers::exactly(f64::from(range.low))],
            [] => return None,
            components => components.iter().map(Numbers::of_scene).collect(),
        };
        match (steps.as_slice(), all.as_slice()) {
            ([], [_, _, ..]) => Some(all),
            ([Some(index)], [_, _, ..]) => Some(vec![*all.get(*index as usize)?]),
            _ => {
                let pointed = f.ty(module, pointer);
                let inner = match pointed {
                    TypeInner::Pointer { base, .. } => width(&module.types[*base].inner),
                    TypeInner::ValuePointer { size, .. } => size.map_or(1, |s| s as usize),
                    _ => 1,
                };
                let width = if path.is_empty() { inner } else { 1 };
                Some(vec![together(&all)?; width])
            }
        }
    }
}

/// Number of components with bounds of their own.
fn width(ty: &TypeInner) -> usize {
    match ty {
        TypeInner::Vector { size, .. } => *size as usize,
        _ => 1,
    }
}

fn constant(module: &Module, arena: &Arena<Expression>, e: Handle<Expression>) -> Known {
    match &arena[e] {
        Expression::Literal(Literal::F32(x)) => Some(vec![Numbers::exactly(f64::from(*x))]),
        Expression::Constant(c) => constant(
            module,
            &module.global_expressions,
            module.constants[*c].init,
        ),
        Expression::ZeroValue(ty) => Some(vec![Numbers::ZERO; width(&module.types[*ty].inner)]),
        Expression::Splat { size, value } => Some(vec![
            *constant(module, arena, *value)?.first()?;
            *size as usize
        ]),
        Expression::Compose { ty, components } => {
            let parts = components.iter().map(|c| constant(module, arena, *c));
            let parts = parts.collect::<Option<Vec<_>>>()?.concat();
            match parts.len() == width(&module.types[*ty].inner) {
                true => Some(parts),
                false => Some(vec![together(&parts)?]),
            }
        }
        _ => None,
    }
}

/// The results for each component. An operand of one component is one for all.
fn componentwise(
    given: &[Vec<Numbers>],
    width: usize,
    mut of: impl FnMut(&[Numbers]) -> Option<Numbers>,
) -> Known {
    (0..width)
        .map(|i| {
            let at = |known: &Vec<Numbers>| known.get(i).or(known.first()).copied();
            let each: Option<Vec<Numbers>> = given.iter().map(at).collect();
            of(&each?)
        })
        .collect()
}

fn binary(op: BinaryOperator, a: Numbers, b: Numbers) -> Option<Numbers> {
    Some(match op {
        BinaryOperator::Add => a.plus(b),
        BinaryOperator::Subtract => a.plus(b.negated()),
        BinaryOperator::Multiply => a.times(b),
        BinaryOperator::Divide => a.over(b),
        BinaryOperator::Modulo => {
            let range = Arithmetic::Real.binary(op, a.range, b.range)?;
            Numbers::new(range, a.least.min(b.least) * STEP)
        }
        _ => return None,
    })
}

/// Bounds of a function's result, by component.
fn function(fun: MathFunction, given: &[Numbers]) -> Option<Numbers> {
    use MathFunction as M;
    let ranges: Vec<Interval> = given.iter().map(|n| n.range).collect();
    let range = Arithmetic::Real.call(fun, &ranges)?;
    let x = given.first()?;
    let least = given.iter().map(|n| n.least).fold(f64::INFINITY, f64::min);
    let least = match fun {
        M::Abs | M::Min | M::Max | M::Clamp => least,
        // A larger number becomes 1.
        M::Saturate => least.min(1.0),
        M::Sign | M::Step | M::Floor | M::Ceil | M::Round | M::Trunc => 1.0,
        M::Fract => least * STEP,
        M::Radians => least.to_radians(),
        M::Degrees => least,
        M::Sqrt => least.sqrt(),
        M::InverseSqrt => 1.0 / x.range.magnitude().sqrt(),
        M::Sin | M::Tan | M::Sinh | M::Tanh | M::Asin | M::Atan | M::Asinh => {
            (0.5 * least).min(OFF_ZERO)
        }
        M::Cos | M::Cosh | M::Acos | M::Log | M::Log2 => OFF_ZERO,
        // Unknown exponents may give anything.
        M::Exp | M::Exp2 if !x.range.is_known() => return None,
        M::Exp => (x.range.low * LOG2_E).exp2(),
        M::Exp2 => x.range.low.exp2(),
        M::Pow => {
            let y = given.get(1)?.range;
            if !(x.range.is_known() && y.is_known()) {
                return None;
            }
            let bases = [x.least, x.range.magnitude()];
            let powers = bases.map(|x| [y.low, y.high].map(|y| x.powf(y)));
            powers
                .as_flattened()
                .iter()
                .copied()
                .fold(f64::INFINITY, f64::min)
        }
        _ => return None,
    };
    Some(Numbers::new(range, least))
}
