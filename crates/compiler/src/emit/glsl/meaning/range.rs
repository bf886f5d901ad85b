//! The range of each expression of a function, whatever its inputs are. Each expression is examined
//! once. A counter's range follows from its loop's condition.

use std::collections::BTreeMap;

use naga::valid::FunctionInfo;
use naga::{
    Arena, BinaryOperator, Block, Expression, Function, Handle, ImageQuery, Literal, LocalVariable,
    MathFunction, Module, Scalar, ScalarKind, Statement, TypeInner, UnaryOperator,
};
use naga_interp::Number as _;
use naga_interp::interval::{Arithmetic, Interval};

const I32: Interval = Interval::new(i32::MIN as f64, i32::MAX as f64);
const U32: Interval = Interval::new(0.0, u32::MAX as f64);

/// More than any adapter's largest texture.
const MOST_TEXELS: f64 = (1 << 24) as f64;

/// The ranges by index. NaN and infinities are left out: no conversion of them is defined.
pub(super) fn of(module: &Module, function: &Function, info: &FunctionInfo) -> Vec<Interval> {
    let mut ranges = Ranges {
        module,
        info,
        counters: BTreeMap::new(),
        of: Vec::new(),
    };
    ranges.find(function);
    let counters = counters(function, &ranges);
    if !counters.is_empty() {
        ranges.counters = counters;
        ranges.of.clear();
        ranges.find(function);
    }
    ranges.of
}

struct Ranges<'a> {
    module: &'a Module,
    info: &'a FunctionInfo,
    /// The range of each local variable that counts.
    counters: BTreeMap<Handle<LocalVariable>, Interval>,
    of: Vec<Interval>,
}

/// All values of a type.
fn whole(scalar: Option<Scalar>) -> Interval {
    match scalar {
        Some(Scalar::I32) => I32,
        Some(Scalar::U32) => U32,
        Some(Scalar::BOOL) => Interval::UNIT,
        _ => Interval::ANYTHING,
    }
}

/// Integers as floats, which may be rounded either way.
fn as_float(range: Interval) -> Interval {
    let is_exact = range.magnitude() <= f64::from(1 << 24);
    let [low, high] = [range.low as f32, range.high as f32];
    match is_exact {
        true => range,
        false => Interval::new(f64::from(low.next_down()), f64::from(high.next_up())),
    }
}

/// The results of exact arithmetic, or all values where some wrap.
fn wrapped(exact: Interval, scalar: Scalar) -> Interval {
    let whole = whole(Some(scalar));
    match whole.low <= exact.low && exact.high <= whole.high {
        true => exact,
        false => whole,
    }
}

impl Ranges<'_> {
    fn find(&mut self, function: &Function) {
        for (e, expression) in function.expressions.iter() {
            let inner = self.info[e].ty.inner_with(&self.module.types);
            let whole = whole(inner.scalar());
            let found = self.expression(function, expression, inner.scalar());
            self.of.push(found.unwrap_or(whole));
        }
    }

    fn at(&self, e: Handle<Expression>) -> Interval {
        self.of
            .get(e.index())
            .copied()
            .unwrap_or(Interval::ANYTHING)
    }

    fn scalar(&self, e: Handle<Expression>) -> Option<Scalar> {
        self.info[e].ty.inner_with(&self.module.types).scalar()
    }

    /// `None`: all values of its type.
    fn expression(
        &self,
        function: &Function,
        expression: &Expression,
        scalar: Option<Scalar>,
    ) -> Option<Interval> {
        match *expression {
            Expression::Literal(_) | Expression::Constant(_) | Expression::ZeroValue(_) => {
                constant(self.module, expression)
            }
            Expression::Compose { ref components, .. } => {
                let parts = components.iter().map(|c| self.at(*c));
                parts.reduce(Interval::or)
            }
            Expression::Splat { value, .. } => Some(self.at(value)),
            Expression::Swizzle { vector, .. } => Some(self.at(vector)),
            Expression::Access { base, .. } | Expression::AccessIndex { base, .. } => {
                let inner = self.info[base].ty.inner_with(&self.module.types);
                matches!(inner, TypeInner::Vector { .. }).then(|| self.at(base))
            }
            Expression::Select { accept, reject, .. } => Some(self.at(accept).or(self.at(reject))),
            Expression::Load { pointer } => match function.expressions[pointer] {
                Expression::LocalVariable(local) => self.counters.get(&local).copied(),
                _ => None,
            },
            Expression::ImageQuery { query, .. } => match query {
                ImageQuery::Size { .. }
                | ImageQuery::NumLevels
                | ImageQuery::NumLayers
                | ImageQuery::NumSamples => Some(Interval::new(1.0, MOST_TEXELS)),
            },
            Expression::ArrayLength(_) => Some(Interval::new(1.0, f64::from(u32::MAX))),
            Expression::Unary {
                op: UnaryOperator::Negate,
                expr,
            } => Some(wrapped(self.at(expr).negated(), scalar?)),
            Expression::As { expr, kind, .. } => self.conversion(expression, expr, kind),
            Expression::Binary { op, left, right } => {
                self.operation(op, self.at(left), self.at(right), scalar?)
            }
            Expression::Math {
                fun,
                arg,
                arg1,
                arg2,
                ..
            } => {
                let arguments = [Some(arg), arg1, arg2].into_iter().flatten();
                let arguments: Vec<Interval> = arguments.map(|a| self.at(a)).collect();
                function_of(fun, &arguments, scalar?)
            }
            _ => None,
        }
    }

    fn conversion(
        &self,
        expression: &Expression,
        from: Handle<Expression>,
        kind: ScalarKind,
    ) -> Option<Interval> {
        let range = self.at(from);
        let from = self.scalar(from)?.kind;
        let is_bits = matches!(expression, Expression::As { convert: None, .. });
        let target = match kind {
            ScalarKind::Sint => I32,
            ScalarKind::Uint => U32,
            ScalarKind::Float if !is_bits && from != ScalarKind::Float => {
                return Some(as_float(range));
            }
            ScalarKind::Float if from == ScalarKind::Float => return Some(range),
            _ => return None,
        };
        match from {
            ScalarKind::Float if is_bits => None,
            // The conversion clamps to the range of the integers.
            ScalarKind::Float => Some(range.rising(|x| x.trunc().clamp(target.low, target.high))),
            _ if target.low <= range.low && range.high <= target.high => Some(range),
            _ => None,
        }
    }

    fn operation(
        &self,
        op: BinaryOperator,
        a: Interval,
        b: Interval,
        scalar: Scalar,
    ) -> Option<Interval> {
        use BinaryOperator as B;
        if scalar.kind == ScalarKind::Float {
            return Arithmetic::Finite.binary(op, a, b);
        }
        let are_positive = a.low >= 0.0 && b.low >= 0.0;
        match op {
            B::Add => Some(wrapped(a.plus(b), scalar)),
            B::Subtract => Some(wrapped(a.plus(b.negated()), scalar)),
            B::Multiply => Some(wrapped(a.times(b), scalar)),
            B::Divide if are_positive => Some(Interval::new(0.0, a.high)),
            // The result for a divisor of 0 is 0.
            B::Modulo if are_positive => {
                Some(Interval::new(0.0, a.high.min((b.high - 1.0).max(0.0))))
            }
            B::Modulo => {
                let most = (b.magnitude() - 1.0).max(0.0);
                let low = if a.low >= 0.0 { 0.0 } else { -most };
                Some(Interval::new(low, most))
            }
            B::And if b.low >= 0.0 || a.low >= 0.0 => {
                let positive = [a, b].into_iter().filter(|x| x.low >= 0.0);
                let most = positive.map(|x| x.high).reduce(f64::min)?;
                Some(Interval::new(0.0, most))
            }
            B::InclusiveOr | B::ExclusiveOr if are_positive => {
                // All bits up to the highest one of both.
                let bits = (a.high.max(b.high) as u64 + 1).next_power_of_two() - 1;
                let low = match op {
                    B::InclusiveOr => a.low.max(b.low),
                    _ => 0.0,
                };
                Some(Interval::new(low, bits as f64))
            }
            B::ShiftRight if a.low >= 0.0 => Some(Interval::new(0.0, a.high)),
            _ => None,
        }
    }
}

fn function_of(fun: MathFunction, arguments: &[Interval], scalar: Scalar) -> Option<Interval> {
    use MathFunction as M;
    match (fun, arguments) {
        _ if scalar.kind == ScalarKind::Float => Arithmetic::Finite.call(fun, arguments),
        (M::Min, [x, y]) => Some(Interval::new(x.low.min(y.low), x.high.min(y.high))),
        (M::Max, [x, y]) => Some(Interval::new(x.low.max(y.low), x.high.max(y.high))),
        // The upper bound counts if it is below the lower one.
        (M::Clamp, [x, low, high]) => {
            let least = x.low.max(low.low).min(high.low);
            Some(Interval::new(least, x.high.max(low.high).min(high.high)))
        }
        // The least `i32` stays as it is.
        (M::Abs, [x]) if x.low > I32.low => Some(Interval::new(x.least(), x.magnitude())),
        (M::Sign, [_]) => Some(Interval::up_to(1.0)),
        (M::CountOneBits | M::CountLeadingZeros | M::CountTrailingZeros, [_]) => {
            Some(Interval::new(0.0, 32.0))
        }
        _ => None,
    }
}

fn constant(module: &Module, expression: &Expression) -> Option<Interval> {
    let of = |e: Handle<Expression>, arena: &Arena<Expression>| constant(module, &arena[e]);
    let globals = &module.global_expressions;
    match expression {
        Expression::Literal(Literal::F32(x)) => Some(Interval::exactly(f64::from(*x))),
        Expression::Literal(Literal::I32(x)) => Some(Interval::exactly(f64::from(*x))),
        Expression::Literal(Literal::U32(x)) => Some(Interval::exactly(f64::from(*x))),
        Expression::ZeroValue(ty) => module.types[*ty]
            .inner
            .scalar()
            .map(|_| Interval::exactly(0.0)),
        Expression::Constant(c) => of(module.constants[*c].init, globals),
        Expression::Splat { value, .. } => of(*value, globals),
        Expression::Compose { components, .. } => {
            let parts: Option<Vec<Interval>> = components.iter().map(|c| of(*c, globals)).collect();
            parts?.into_iter().reduce(Interval::or)
        }
        _ => None,
    }
}

/// The local variables that count up and never fall below their start: each is below a bound when
/// an iteration begins, and the `continuing` block adds 1.
fn counters(function: &Function, ranges: &Ranges<'_>) -> BTreeMap<Handle<LocalVariable>, Interval> {
    let mut steps = Vec::new();
    naga_operands::visit(&function.body, &mut |statement| {
        if let Statement::Loop {
            body, continuing, ..
        } = statement
        {
            steps.extend(step(function, body, continuing));
        }
    });
    let mut found = BTreeMap::new();
    for (local, _) in &steps {
        let least = least(function, ranges, *local, &steps);
        if let Some(least) = least {
            found.insert(*local, Interval::new(least, I32.high));
        }
    }
    found
}

/// A variable that a loop compares first and steps last, and the step.
type Step = (Handle<LocalVariable>, Handle<Expression>);

fn step(function: &Function, body: &Block, continuing: &Block) -> Option<Step> {
    let mut first = body.iter().filter(|s| !matches!(s, Statement::Emit(_)));
    let Statement::If {
        condition,
        accept,
        reject,
    } = first.next()?
    else {
        return None;
    };
    let stays = match (accept.as_ref(), reject.as_ref()) {
        ([], [Statement::Break]) => true,
        ([Statement::Break], []) => false,
        _ => return None,
    };
    let (condition, stays) = match function.expressions[*condition] {
        Expression::Unary {
            op: UnaryOperator::LogicalNot,
            expr,
        } => (expr, !stays),
        _ => (*condition, stays),
    };
    let Expression::Binary { op, left, .. } = function.expressions[condition] else {
        return None;
    };
    let is_below = match stays {
        true => BinaryOperator::Less,
        false => BinaryOperator::GreaterEqual,
    };
    let variable = |e: Handle<Expression>| match function.expressions[e] {
        Expression::Load { pointer } => local(function, pointer),
        _ => None,
    };
    let counter = variable(left).filter(|_| op == is_below)?;
    let stores = continuing.iter().filter_map(|s| match s {
        Statement::Store { pointer, value } => Some((local(function, *pointer), *value)),
        _ => None,
    });
    let mut values = stores.filter(|(of, _)| *of == Some(counter));
    let (_, value) = values.next()?;
    let Expression::Binary {
        op: BinaryOperator::Add,
        left,
        right,
    } = function.expressions[value]
    else {
        return None;
    };
    let is_one = matches!(
        function.expressions[right],
        Expression::Literal(Literal::I32(1))
    );
    (is_one && variable(left) == Some(counter) && values.next().is_none())
        .then_some((counter, value))
}

fn local(function: &Function, pointer: Handle<Expression>) -> Option<Handle<LocalVariable>> {
    match function.expressions[pointer] {
        Expression::LocalVariable(local) => Some(local),
        _ => None,
    }
}

/// The least value that a counter is set to, if nothing else changes it.
fn least(
    function: &Function,
    ranges: &Ranges<'_>,
    counter: Handle<LocalVariable>,
    steps: &[Step],
) -> Option<f64> {
    let variable = &function.local_variables[counter];
    let mut least = match variable.init {
        Some(init) => ranges.at(init).low,
        None => 0.0,
    };
    let mut is_known = steps.iter().filter(|(of, _)| *of == counter).count() == 1;
    let is_it = |e: Handle<Expression>| local(function, e) == Some(counter);
    for (_, expression) in function.expressions.iter() {
        let is_load = matches!(expression, Expression::Load { .. });
        let mut read = naga_operands::of_expression(expression).into_iter();
        is_known &= is_load || !read.any(is_it);
    }
    naga_operands::visit(&function.body, &mut |statement| match statement {
        Statement::Store { pointer, value } if is_it(*pointer) => {
            if !steps.contains(&(counter, *value)) {
                least = least.min(ranges.at(*value).low);
            }
        }
        _ => {
            is_known &= !naga_operands::of_statement(statement)
                .into_iter()
                .any(is_it)
        }
    });
    is_known.then_some(least)
}
