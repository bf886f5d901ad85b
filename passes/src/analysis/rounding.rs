//! Bounds the effect at the outputs of rounding differences in interpolated values.
//!
//! An affine value that moves is computed at the vertices and then interpolated, instead of being
//! computed from interpolated varyings. It is the same real number with other rounding. First we
//! follow the difference forward to the value: each operation adds its own rounding and passes on
//! its operands' errors by its slope. From there the slopes of all dependents lead to the outputs,
//! to first order, multiplied along each path and added over all paths. Dependents are rounded
//! again too, and with large numbers that matters: a small value that is added to a large one and
//! subtracted again has steps. This is the running error analysis of Wilkinson (1963; Higham,
//! Accuracy and Stability of Numerical Algorithms, section 3.3), over intervals of the operands.
//!
//! At a discontinuity, or where the slope is unbounded (a division by a possible 0, `normalize` of
//! a possibly short vector), any error may result from the last bit. The bound then is infinite.

use std::sync::Arc;

use naga::{BinaryOperator, Expression, Handle, ScalarKind, UnaryOperator};

use crate::analysis::operations::{self, Operation, OwnError};
use crate::analysis::range::{AllRanges, dimension, terms};
use crate::analysis::users::Users;
use crate::analysis::values::{ContextId, Node, ValueId, Values};
use naga_interp::bound::Accuracy;
use naga_interp::interval::Interval;
use preshade_dataflow::graph::rate::Rate;
use preshade_plan::pass::SourceRange;
use preshade_plan::plan::GpuPass;
use preshade_plan::state::ColorTarget;

/// Assumed magnitude of varyings, textures and draw constants without a scene.
pub(crate) const ORDINARY: u32 = 4;

/// Half the distance of adjacent numbers around 1: the relative error of one operation.
const UNIT_ROUNDOFF: f64 = 1.0 / (1 << 24) as f64;

/// Error of interpolation in units of roundoff of the largest interpolated number: the weights do
/// not sum to exactly 1, and there is a perspective division. No language specifies it. A software
/// rasteriser was off by some tens on slivers and on very large planes.
const INTERPOLATION: f64 = 64.0;

/// Largest error of an output for all moved values together. Numbers less than an 8-bit step apart
/// are stored as the same or adjacent steps.
pub const MOST: f64 = 1.0 / 255.0;

/// Slope of the sRGB transfer function at 0, its maximum (IEC 61966-2-1).
pub const STEEPEST_SRGB: f64 = 12.92;

/// Largest change of an output by rounding that the targets of a pass hide; negative where any change
/// shows.
pub(crate) fn most(pass: &GpuPass) -> f64 {
    let is_srgb = |t: &ColorTarget| t.format.ends_with("-srgb");
    let targets = || pass.targets.iter().flatten();
    let multisample = &pass.multisample;
    // Layers add up, and coverage decisions are discontinuous. With multisampling a pixel's centre
    // may be outside of the triangle, where a varying exceeds the corners' range.
    let is_step = targets().all(|t| t.blend.is_none())
        && multisample.count == 1
        && !multisample.alpha_to_coverage;
    match targets().any(is_srgb) {
        _ if !is_step => -1.0,
        true => MOST / STEEPEST_SRGB,
        false => MOST,
    }
}

/// Most values to follow to the outputs for all moved values together; beyond that there is no
/// bound.
const MOST_FOLLOWED: usize = 10_000_000;

/// Bounds of the change of an output.
#[derive(Clone, Debug)]
pub struct Roundings {
    /// For each value alone; infinite without a bound.
    each: Vec<f64>,
    /// The effect of the value's own difference.
    carried: Vec<f64>,
    /// The effect of rounding dependents again.
    anew: Vec<f64>,
    users: Arc<Users>,
}

impl Roundings {
    /// The bounds for each value that `may` move as an affine one. `unsteady` are the values that a
    /// compiler may round differently in another stage ([`crate::analysis::contraction`]).
    pub fn new(
        values: &Values<'_, '_>,
        known: &[SourceRange],
        unsteady: &[bool],
        may: impl Fn(ValueId) -> bool,
    ) -> Self {
        let cycles = values.cycles();
        let ranges = AllRanges::new(values, cycles, known, f64::from(ORDINARY));
        let slopes = Slopes::new(values, &ranges, unsteady);
        let errors = slopes.errors(cycles);
        let gains = slopes.gains(cycles);
        // A value without gain has no dependents.
        let through = |id: ValueId, error: f64| match gains[id] {
            0.0 => 0.0,
            gain => gain * error,
        };
        let all = || 0..values.values.len();
        let interpolated = |id| match is_of_draw(values, id) {
            true => 0.0,
            false => INTERPOLATION * UNIT_ROUNDOFF * ranges.of(id).magnitude(),
        };
        let mut this = Self {
            each: vec![f64::INFINITY; values.values.len()],
            carried: all()
                .map(|id| through(id, errors[id] + interpolated(id)))
                .collect(),
            anew: all().map(|id| through(id, slopes.own(id))).collect(),
            users: Arc::clone(values.users()),
        };
        let mut above = Above::new(values.values.len());
        let mut followed = 0;
        for id in all().filter(|id| may(*id)) {
            let own = this.carried[id];
            if own > MOST {
                this.each[id] = own;
            } else if !own.is_nan() && followed <= MOST_FOLLOWED {
                let above = above.of(&this.users, &[id]);
                followed += above.len();
                this.each[id] = this.sum(&[id], above);
            }
        }
        this
    }

    /// The bound for one value.
    pub fn of(&self, id: ValueId) -> f64 {
        self.each[id]
    }

    /// The bound for several values together, and for operations that stay where they are but round
    /// `anew`.
    pub fn together(&self, ids: &[ValueId], anew: &[ValueId]) -> f64 {
        let all = [ids, anew].concat();
        let mut above = Above::new(self.each.len()).of(&self.users, &all).to_vec();
        let depends = |id: &ValueId| above.binary_search(id).is_ok();
        let first = anew.iter().filter(|id| !ids.contains(id) && !depends(id));
        let first: Vec<ValueId> = first.copied().collect();
        above.extend(first);
        self.sum(ids, &above)
    }

    fn sum(&self, ids: &[ValueId], above: &[ValueId]) -> f64 {
        let carried: f64 = ids.iter().map(|id| self.carried[*id]).sum();
        let total = carried + above.iter().map(|id| self.anew[*id]).sum::<f64>();
        if total.is_nan() { f64::INFINITY } else { total }
    }
}

/// Repeated walks from values to their dependents.
struct Above {
    /// The last walk that visited each value.
    seen: Vec<usize>,
    walks: usize,
    found: Vec<ValueId>,
}

impl Above {
    fn new(values: usize) -> Self {
        Self {
            seen: vec![0; values],
            walks: 0,
            found: Vec::new(),
        }
    }

    /// All dependents of some values in ascending order, without the values themselves unless they
    /// depend on each other.
    fn of(&mut self, users: &Users, ids: &[ValueId]) -> &[ValueId] {
        self.walks += 1;
        self.found.clear();
        let mut next = 0;
        self.reach(ids.iter().flat_map(|id| &users[*id]));
        while let Some(at) = self.found.get(next).copied() {
            next += 1;
            self.reach(users[at].iter());
        }
        // A float sum depends on its order too.
        self.found.sort_unstable();
        &self.found
    }

    fn reach<'a>(&mut self, ids: impl Iterator<Item = &'a ValueId>) {
        for id in ids {
            if std::mem::replace(&mut self.seen[*id], self.walks) != self.walks {
                self.found.push(*id);
            }
        }
    }
}

struct Slopes<'v, 'g, 'p> {
    values: &'v Values<'g, 'p>,
    ranges: &'v AllRanges,
    unsteady: &'v [bool],
    /// Slopes of each value in its operands, value by value.
    steep: Vec<f64>,
    /// Start of each value's slopes in `steep`.
    start: Vec<usize>,
}

impl<'v, 'g, 'p> Slopes<'v, 'g, 'p> {
    fn new(values: &'v Values<'g, 'p>, ranges: &'v AllRanges, unsteady: &'v [bool]) -> Self {
        let mut this = Self {
            values,
            ranges,
            unsteady,
            steep: Vec::new(),
            start: Vec::with_capacity(values.values.len()),
        };
        for id in 0..values.values.len() {
            this.start.push(this.steep.len());
            this.find(id);
        }
        this
    }

    /// A value's operands with their slopes.
    fn operands(&self, id: ValueId) -> impl Iterator<Item = (ValueId, f64)> {
        let operands = self.values.values[id].operands.iter().copied();
        operands.zip(self.steep[self.start[id]..].iter().copied())
    }

    /// For each value, the difference between computing it from interpolated varyings and computing
    /// it at the vertices, without its own interpolation.
    fn errors(&self, cycles: &[Vec<ValueId>]) -> Vec<f64> {
        let values = &self.values.values;
        let mut errors = vec![f64::INFINITY; values.len()];
        for cycle in cycles.iter().rev() {
            let id = cycle[0];
            if self.is_same(id) {
                errors[id] = 0.0;
                continue;
            }
            if cycle.len() > 1 || values[id].operands.contains(&id) {
                continue;
            }
            let magnitude = self.ranges.of(id).magnitude();
            errors[id] = match values[id].node {
                Node::Input(_) => INTERPOLATION * UNIT_ROUNDOFF * magnitude,
                _ => {
                    self.operands(id)
                        .filter(|(o, _)| errors[*o] != 0.0)
                        .map(|(o, slope)| errors[o] * slope)
                        .sum::<f64>()
                        + self.own(id)
                }
            };
        }
        for cycle in cycles.iter().filter(|c| c.len() > 1) {
            for id in cycle.iter().filter(|id| self.is_same(**id)) {
                errors[*id] = 0.0;
            }
        }
        errors
    }

    /// Change of an output per unit of change of a value.
    fn gains(&self, cycles: &[Vec<ValueId>]) -> Vec<f64> {
        let values = &self.values.values;
        let mut gains = vec![0.0; values.len()];
        for root in &self.values.roots {
            gains[*root] = 1.0;
        }
        for root in &self.values.coverage {
            gains[*root] = f64::INFINITY;
        }
        for cycle in cycles {
            let id = cycle[0];
            if cycle.len() > 1 || values[id].operands.contains(&id) {
                // We do not follow how errors accumulate over iterations.
                if cycle.iter().any(|id| gains[*id] != 0.0) {
                    for id in cycle {
                        gains[*id] = f64::INFINITY;
                    }
                }
                for id in cycle {
                    for operand in &values[*id].operands {
                        if gains[*id] != 0.0 {
                            gains[*operand] = f64::INFINITY;
                        }
                    }
                }
                continue;
            }
            if gains[id] == 0.0 {
                continue;
            }
            for (operand, slope) in self.operands(id) {
                // A value that is equal in both stages passes nothing on.
                if !self.is_same(operand) {
                    gains[operand] += gains[id] * slope;
                }
            }
        }
        gains
    }

    /// Whether a value has the same bits in both stages, and in its readers.
    fn is_same(&self, id: ValueId) -> bool {
        is_of_draw(self.values, id) && !self.unsteady[id]
    }

    /// The effect of an operation's own rounding.
    fn own(&self, id: ValueId) -> f64 {
        let Node::Expression(context, e, path) = &self.values.values[id].node else {
            return 0.0;
        };
        let magnitude = self.ranges.of(id).magnitude();
        let expression = &self.values.function(*context).function.expressions[*e];
        let operation = self.operation(*context, expression, magnitude);
        match operation.map(|o| o.error) {
            Some(OwnError::Roundings(count, term)) => count * UNIT_ROUNDOFF * magnitude.max(term),
            // The inaccuracy of a function in either stage. A part of an infinite number is none.
            Some(OwnError::Within(accuracy)) if path.is_empty() && accuracy != Accuracy::EXACT => {
                2.0 * accuracy.of(magnitude)
            }
            _ => 0.0,
        }
    }

    /// The table's entry for an operation whose result is at most `magnitude`.
    fn operation(
        &self,
        context: ContextId,
        expression: &Expression,
        magnitude: f64,
    ) -> Option<Operation> {
        let module = self.values.graph.module();
        let f = self.values.function(context);
        let range = |o: Handle<Expression>| self.ranges.operand(self.values, context, o);
        match expression {
            Expression::Binary { op, left, right } => {
                let inverse = match op {
                    BinaryOperator::Divide => self.ranges.inverse(self.values, context, *right),
                    _ => Interval::ANYTHING,
                };
                let terms = f64::from(terms(f.ty(module, *left), f.ty(module, *right)));
                let operands = [*left, *right].map(range);
                Some(operations::binary(*op, operands, inverse, terms))
            }
            Expression::Math {
                fun,
                arg,
                arg1,
                arg2,
                ..
            } => {
                let operands = [Some(*arg), *arg1, *arg2];
                let operands = operands.map(|o| o.map_or(Interval::ANYTHING, range));
                let dimension = dimension(f.ty(module, *arg));
                Some(operations::math(*fun, operands, dimension, magnitude))
            }
            _ => None,
        }
    }

    /// Computes the slopes of a value in its operands, over all components.
    fn find(&mut self, id: ValueId) {
        let values = self.values;
        let operands = &values.values[id].operands;
        let first = self.steep.len();
        let own = match &values.values[id].node {
            Node::Expression(context, e, path) if path.is_empty() => {
                let expressions = &values.function(*context).function.expressions;
                Some((*context, &expressions[*e]))
            }
            _ => None,
        };
        let own =
            own.filter(|(_, e)| !matches!(e, Expression::Load { .. } | Expression::CallResult(_)));
        if is_of_draw(values, id) {
            // Unused: its operands are equal in both stages too.
            self.steep.resize(first + operands.len(), 0.0);
        } else if let Node::Control(..) = values.values[id].node {
            self.steep.resize(first + operands.len(), f64::INFINITY);
        } else if let Some((context, expression)) = own {
            self.steep.resize(first + operands.len(), 0.0);
            // An operand may occur several times.
            for (e, slope) in self.places(context, expression) {
                let named = values.named(context, e);
                if let Some(place) = operands.iter().position(|o| named == Some(*o)) {
                    self.steep[first + place] += slope;
                }
            }
        } else {
            for operand in operands {
                self.steep.push(self.chooses(*operand));
            }
        }
    }

    /// The slope of a selection: a control or an index decides.
    fn chooses(&self, operand: ValueId) -> f64 {
        let integer = match &self.values.values[operand].node {
            Node::Control(..) => true,
            Node::Expression(context, e, path) if path.is_empty() => {
                let f = self.values.function(*context);
                let kind = f.ty(self.values.graph.module(), *e).scalar_kind();
                kind.is_some_and(|k| k != ScalarKind::Float)
            }
            _ => false,
        };
        if integer { f64::INFINITY } else { 1.0 }
    }

    /// The operands of an operation with their slopes.
    fn places(
        &self,
        context: ContextId,
        expression: &Expression,
    ) -> Vec<(Handle<Expression>, f64)> {
        let operands = || naga_operands::of_expression(expression).into_iter();
        let all = |slope: f64| operands().map(|o| (o, slope)).collect();
        match expression {
            Expression::Compose { .. }
            | Expression::Splat { .. }
            | Expression::Swizzle { .. }
            | Expression::AccessIndex { .. }
            | Expression::Unary {
                op: UnaryOperator::Negate,
                ..
            } => all(1.0),
            Expression::Access { base, index } => vec![(*base, 1.0), (*index, f64::INFINITY)],
            Expression::Select {
                condition,
                accept,
                reject,
            } => vec![(*condition, f64::INFINITY), (*accept, 1.0), (*reject, 1.0)],
            _ => {
                let operation = self.operation(context, expression, f64::INFINITY);
                match operation.and_then(|o| o.slopes) {
                    Some(slopes) => operands().zip(slopes).collect(),
                    None => all(f64::INFINITY),
                }
            }
        }
    }
}

fn is_of_draw(values: &Values<'_, '_>, id: ValueId) -> bool {
    matches!(
        values.values[id].fact.rate,
        Rate::Const | Rate::Draw | Rate::Instance
    )
}
