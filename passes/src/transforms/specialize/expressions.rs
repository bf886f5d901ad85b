//! Copies expressions and computes their abstract values.

use naga::{
    ArraySize, BinaryOperator, Block, Expression, Function, Handle, Literal, LocalVariable,
    MathFunction, Module, ScalarKind, Type, TypeInner,
};

use super::arithmetic;
use super::fold::{FoldFrame, Folder};
use super::known::{AbstractValue, FINITE, Scalar, Sources};
use super::params::Fold;
use naga_interp::interval::Interval;

/// The variable of a pointer.
enum Root {
    Local(Handle<LocalVariable>),
    Global(Handle<naga::GlobalVariable>),
    Elsewhere,
}

/// A pointer's variable and path; `dynamic` if the path ends at an unknown index.
struct PointerTarget {
    root: Root,
    path: Vec<u32>,
    sources: Sources,
    dynamic: bool,
}

/// The abstract value of a type's zero.
pub(super) fn zero(module: &Module, ty: Handle<Type>) -> AbstractValue {
    let scalar = |s: naga::Scalar| match (s.kind, s.width) {
        (ScalarKind::Bool, _) => AbstractValue::constant(Scalar::Bool(false)),
        (kind, 4) => AbstractValue::constant(Scalar::Number(kind, Interval::exactly(0.0))),
        _ => AbstractValue::Unknown,
    };
    match &module.types[ty].inner {
        TypeInner::Scalar(s) => scalar(*s),
        TypeInner::Vector { size, scalar: s } => {
            AbstractValue::Parts(vec![scalar(*s); *size as usize])
        }
        TypeInner::Matrix {
            columns,
            rows,
            scalar: s,
        } => {
            let column = AbstractValue::Parts(vec![scalar(*s); *rows as usize]);
            AbstractValue::Parts(vec![column; *columns as usize])
        }
        TypeInner::Array {
            base,
            size: ArraySize::Constant(n),
            ..
        } if n.get() <= 64 => AbstractValue::Parts(vec![zero(module, *base); n.get() as usize]),
        TypeInner::Struct { members, .. } => {
            AbstractValue::Parts(members.iter().map(|m| zero(module, m.ty)).collect())
        }
        _ => AbstractValue::Unknown,
    }
}

fn literal(literal: &Literal) -> AbstractValue {
    let number =
        |kind, number| AbstractValue::constant(Scalar::Number(kind, Interval::exactly(number)));
    match literal {
        Literal::Bool(b) => AbstractValue::constant(Scalar::Bool(*b)),
        Literal::I32(v) => number(ScalarKind::Sint, f64::from(*v)),
        Literal::U32(v) => number(ScalarKind::Uint, f64::from(*v)),
        Literal::F32(v) if v.is_finite() => AbstractValue::constant(Scalar::float(f64::from(*v))),
        _ => AbstractValue::Unknown,
    }
}

/// The abstract value of a constant expression.
fn constant(module: &Module, e: Handle<Expression>) -> AbstractValue {
    match &module.global_expressions[e] {
        Expression::Literal(l) => literal(l),
        Expression::Constant(c) => constant(module, module.constants[*c].init),
        Expression::ZeroValue(ty) => zero(module, *ty),
        Expression::Compose { ty, components } => {
            let components = components.iter().map(|c| constant(module, *c)).collect();
            composed(module, *ty, components)
        }
        Expression::Splat { size, value } => {
            AbstractValue::Parts(vec![constant(module, *value); *size as usize])
        }
        _ => AbstractValue::Unknown,
    }
}

/// Flattens vectors that are composed of vectors.
fn composed(module: &Module, ty: Handle<Type>, components: Vec<AbstractValue>) -> AbstractValue {
    let TypeInner::Vector { size, .. } = module.types[ty].inner else {
        return AbstractValue::Parts(components);
    };
    if components.len() == size as usize {
        return AbstractValue::Parts(components);
    }
    let mut parts = Vec::new();
    for component in components {
        match component {
            AbstractValue::Parts(of) => parts.extend(of),
            scalar @ AbstractValue::Scalar(..) => parts.push(scalar),
            // An unknown value does not reveal its number of components.
            AbstractValue::Unknown => return AbstractValue::Unknown,
        }
    }
    match parts.len() == size as usize {
        true => AbstractValue::Parts(parts),
        false => AbstractValue::Unknown,
    }
}

/// Number of elements; `None` if the type does not give it.
fn length(module: &Module, inner: &TypeInner) -> Option<u32> {
    Some(match inner {
        TypeInner::Vector { size, .. } => *size as u32,
        TypeInner::Matrix { columns, .. } => *columns as u32,
        TypeInner::Array {
            size: ArraySize::Constant(n),
            ..
        } => n.get(),
        TypeInner::ValuePointer {
            size: Some(size), ..
        } => *size as u32,
        TypeInner::Pointer { base, .. } => return length(module, &module.types[*base].inner),
        _ => return None,
    })
}

impl<'p> Folder<'p> {
    /// Copies an expression and records its abstract value. `ahead`: it is before all statements,
    /// outside any `Emit`.
    pub(super) fn copy(
        &mut self,
        frame: &mut FoldFrame<'p>,
        e: Handle<Expression>,
        out: &mut Block,
        ahead: bool,
    ) {
        let known = self.evaluate(frame, e);
        frame.known[e.index()] = match self.fold {
            Fold::Exact => known,
            Fold::Rounding => known.undecided_by_finite(),
        };
        if let Some(same) = self.stands_for(frame, e) {
            let copy = match self.held_as(frame, e, same) {
                Some(ty) if !ahead => {
                    frame.flush(out);
                    read_variable(frame, e, same, ty)
                }
                _ => frame.mapped(same),
            };
            frame.map[e.index()] = Some(copy);
            frame.known[e.index()] = frame.known[same.index()].clone();
            return;
        }
        let mut expression = frame.original.expressions[e].clone();
        if let Expression::Access { base, index } = expression
            && let Some(at) = self.static_index(frame, base, index)
        {
            expression = Expression::AccessIndex { base, index: at };
        }
        let original = expression.clone();
        // Decided expressions have no remaining reader, and must not be built from literals only.
        let takes_literals = !ahead && frame.known[e.index()].literal().is_none();
        naga_operands::map_expression(&mut expression, &mut |operand| {
            let literal = frame.known[operand.index()].literal();
            match literal.map(|(value, sources)| (value, Sources::clone(sources))) {
                Some((value, sources))
                    if takes_literals && arithmetic::takes_literal(&original, *operand) =>
                {
                    frame.folds(&sources);
                    *operand = frame.literal(value, out);
                }
                _ => *operand = frame.mapped(*operand),
            }
        });
        let copy = match ahead || expression.needs_pre_emit() {
            true => frame.append(expression, e),
            false => frame.emit(expression, e),
        };
        frame.map[e.index()] = Some(copy);
        frame.name(e, copy);
    }

    /// The operand of a statement: the copy, or a known integer or bool.
    pub(super) fn read(
        &self,
        frame: &mut FoldFrame<'p>,
        e: Handle<Expression>,
        out: &mut Block,
    ) -> Handle<Expression> {
        let Some((literal, sources)) = frame.known[e.index()].literal() else {
            return frame.mapped(e);
        };
        let sources = Sources::clone(sources);
        frame.folds(&sources);
        frame.literal(literal, out)
    }

    /// The index of an access, if assumptions decide it and it is within bounds.
    fn static_index(
        &self,
        frame: &mut FoldFrame<'p>,
        base: Handle<Expression>,
        index: Handle<Expression>,
    ) -> Option<u32> {
        let (at, sources) = frame.known[index.index()].index()?;
        let length = length(self.module, frame.f.ty(self.module, base))?;
        if (sources.is_empty() && frame.turning == 0) || at >= length {
            return None;
        }
        let sources = Sources::clone(sources);
        frame.folds(&sources);
        Some(at)
    }

    /// The operand that an expression is known to equal.
    fn stands_for(
        &self,
        frame: &mut FoldFrame<'p>,
        e: Handle<Expression>,
    ) -> Option<Handle<Expression>> {
        let (same, sources, rounds) = match frame.original.expressions[e] {
            Expression::Select {
                condition,
                accept,
                reject,
            } => {
                let (truth, sources) = all_the_same(&frame.known[condition.index()])?;
                (if truth { accept } else { reject }, sources, false)
            }
            _ if self.fold == Fold::Rounding => {
                let (same, sources) = self.neutral(frame, e)?;
                (same, sources, true)
            }
            _ => return None,
        };
        if rounds {
            frame.record.roundings.insert((frame.id, e));
        }
        frame.folds(&sources);
        Some(same)
    }

    /// The type of the variable that must hold a constant in place of `e`; `None` if no variable is
    /// needed. Front ends fold expressions of literals themselves, with other bits, and refuse
    /// `0 / 0`.
    fn held_as(
        &mut self,
        frame: &FoldFrame<'p>,
        e: Handle<Expression>,
        same: Handle<Expression>,
    ) -> Option<Handle<Type>> {
        let inner = frame.f.ty(self.module, same);
        let is_number = matches!(inner, TypeInner::Scalar(_) | TypeInner::Vector { .. })
            && inner.scalar_kind() != Some(ScalarKind::Bool);
        let is_held = is_number && frame.is_operand[e.index()] && is_constant(frame.original, same);
        is_held.then(|| {
            let ty = Type {
                name: None,
                inner: inner.clone(),
            };
            self.types.insert(ty, naga::Span::UNDEFINED)
        })
    }

    /// The operand that remains after adding 0, multiplying by 1, or mixing by 0 or 1, in real
    /// numbers. `None` also if an operation shows the sign of a remaining zero, or if a dropped
    /// operand may be infinite.
    fn neutral(
        &self,
        frame: &FoldFrame<'p>,
        e: Handle<Expression>,
    ) -> Option<(Handle<Expression>, Sources)> {
        let is = |operand: Handle<Expression>, value: f64| {
            all_numbers(&frame.known[operand.index()], value)
        };
        // A matrix of ones is not the identity.
        let is_matrix =
            |e: Handle<Expression>| matches!(frame.f.ty(self.module, e), TypeInner::Matrix { .. });
        let same_type = |operand: Handle<Expression>| {
            frame.f.ty(self.module, operand) == frame.f.ty(self.module, e)
        };
        let mut dropped = None;
        let found = match frame.original.expressions[e] {
            Expression::Binary { left, right, .. } if is_matrix(left) || is_matrix(right) => None,
            Expression::Binary { op, left, right } => match op {
                BinaryOperator::Add => is(right, 0.0)
                    .map(|s| (left, s))
                    .or_else(|| is(left, 0.0).map(|s| (right, s))),
                BinaryOperator::Subtract => is(right, 0.0).map(|s| (left, s)),
                BinaryOperator::Multiply => is(right, 1.0)
                    .map(|s| (left, s))
                    .or_else(|| is(left, 1.0).map(|s| (right, s))),
                BinaryOperator::Divide => is(right, 1.0).map(|s| (left, s)),
                _ => None,
            },
            Expression::Math {
                fun: MathFunction::Mix,
                arg,
                arg1: Some(arg1),
                arg2: Some(arg2),
                ..
            } => {
                let found = is(arg2, 0.0)
                    .map(|s| (arg, s))
                    .or_else(|| is(arg2, 1.0).map(|s| (arg1, s)));
                dropped = found
                    .as_ref()
                    .map(|(left, _)| if *left == arg { arg1 } else { arg });
                found
            }
            _ => None,
        };
        let is_factor = matches!(
            frame.original.expressions[e],
            Expression::Binary {
                op: BinaryOperator::Multiply | BinaryOperator::Divide,
                ..
            }
        );
        found
            .filter(|(same, sources)| !sources.is_empty() && same_type(*same))
            .filter(|_| is_factor || (self.leaves)(frame.id, e, dropped))
    }

    fn evaluate(&self, frame: &FoldFrame<'p>, e: Handle<Expression>) -> AbstractValue {
        let of = |e: Handle<Expression>| &frame.known[e.index()];
        match &frame.original.expressions[e] {
            Expression::Literal(l) => literal(l),
            Expression::Constant(c) => constant(self.module, self.module.constants[*c].init),
            Expression::Override(o) => self.assumptions.constant(*o),
            Expression::ZeroValue(ty) => zero(self.module, *ty),
            Expression::Compose { ty, components } => {
                let components = components.iter().map(|c| of(*c).clone()).collect();
                composed(self.module, *ty, components)
            }
            Expression::Access { base, index } => match of(*index).index() {
                Some((at, sources)) => of(*base).part(at as usize).resting_on(sources),
                None => AbstractValue::Unknown,
            },
            Expression::AccessIndex { base, index } => of(*base).part(*index as usize),
            Expression::Splat { size, value } => {
                AbstractValue::Parts(vec![of(*value).clone(); *size as usize])
            }
            Expression::Swizzle {
                size,
                vector,
                pattern,
            } => AbstractValue::Parts(
                pattern[..*size as usize]
                    .iter()
                    .map(|c| of(*vector).part(*c as usize))
                    .collect(),
            ),
            Expression::FunctionArgument(i) => frame
                .arguments
                .get(*i as usize)
                .cloned()
                .unwrap_or_default(),
            Expression::Load { pointer } => self.load(frame, *pointer),
            Expression::ImageSample {
                image,
                gather: None,
                depth_ref: None,
                ..
            } => self.texel(frame, e, *image),
            Expression::ImageLoad {
                image,
                coordinate,
                array_index,
                sample,
                level,
            } => {
                let at = [Some(*coordinate), *array_index, *sample, *level];
                let texel = self.texel(frame, e, *image);
                // Every texture has at least this one texel.
                match at.into_iter().flatten().all(|e| is_0(of(e))) {
                    true => texel,
                    false => texel.join(&outside()),
                }
            }
            Expression::Unary { op, expr } => arithmetic::unary(*op, of(*expr)),
            Expression::Binary { op, left, right } => {
                let is_matrix = |e: Handle<Expression>| {
                    matches!(frame.f.ty(self.module, e), TypeInner::Matrix { .. })
                };
                match is_matrix(*left) || is_matrix(*right) {
                    true => AbstractValue::Unknown,
                    false => self.product(frame, e, (*op, *left, *right)),
                }
            }
            Expression::Select {
                condition,
                accept,
                reject,
            } => match of(*condition).truth() {
                Some(true) => of(*accept).clone(),
                Some(false) => of(*reject).clone(),
                None => of(*accept).join(of(*reject)),
            },
            Expression::Relational { fun, argument } => arithmetic::relational(*fun, of(*argument)),
            Expression::Math {
                fun,
                arg,
                arg1,
                arg2,
                arg3,
            } => {
                let arguments: Vec<&AbstractValue> = [Some(*arg), *arg1, *arg2, *arg3]
                    .into_iter()
                    .flatten()
                    .map(of)
                    .collect();
                arithmetic::math(*fun, &arguments)
            }
            Expression::As {
                expr,
                kind,
                convert: Some(width),
            } if matches!((kind, width), (ScalarKind::Bool, _) | (_, 4)) => {
                let is_matrix = matches!(frame.f.ty(self.module, *expr), TypeInner::Matrix { .. });
                match is_matrix {
                    true => AbstractValue::Unknown,
                    false => arithmetic::converted(*kind, of(*expr)),
                }
            }
            _ => AbstractValue::Unknown,
        }
    }

    /// The abstract value of a texture read.
    fn texel(
        &self,
        frame: &FoldFrame<'p>,
        e: Handle<Expression>,
        image: Handle<Expression>,
    ) -> AbstractValue {
        let is_floats = matches!(
            frame.f.ty(self.module, e),
            TypeInner::Vector {
                scalar: naga::Scalar::F32,
                ..
            }
        );
        match frame.original.expressions[image] {
            Expression::GlobalVariable(g) if is_floats => self.assumptions.texel(g),
            _ => AbstractValue::Unknown,
        }
    }

    /// A product. With `fold=rounding` a product with 0 is 0, as if the other factor were known to
    /// be finite.
    fn product(
        &self,
        frame: &FoldFrame<'p>,
        e: Handle<Expression>,
        (op, left, right): (BinaryOperator, Handle<Expression>, Handle<Expression>),
    ) -> AbstractValue {
        let of = |e: Handle<Expression>| &frame.known[e.index()];
        let is_product = op == BinaryOperator::Multiply;
        if self.fold == Fold::Rounding && is_product && (self.leaves)(frame.id, e, None) {
            let zero = [left, right]
                .into_iter()
                .find_map(|e| all_numbers(of(e), 0.0));
            let bounded = arithmetic::binary(op, of(left), of(right));
            if let Some(sources) = zero
                && all_numbers(&bounded, 0.0).is_none()
            {
                let finite = Sources::new([FINITE].into());
                let sources = super::known::both(&sources, &finite);
                let zero = AbstractValue::Scalar(Scalar::float(0.0), sources);
                let width =
                    [left, right]
                        .into_iter()
                        .find_map(|e| match frame.f.ty(self.module, e) {
                            TypeInner::Vector { size, .. } => Some(*size as usize),
                            _ => None,
                        });
                return match width {
                    Some(width) => AbstractValue::Parts(vec![zero; width]),
                    None => zero,
                };
            }
        }
        arithmetic::binary(op, of(left), of(right))
    }

    fn load(&self, frame: &FoldFrame<'p>, pointer: Handle<Expression>) -> AbstractValue {
        let place = frame.place(self.module, pointer);
        if place.dynamic {
            return AbstractValue::Unknown;
        }
        let content = match place.root {
            Root::Local(v) => frame.locals.get(v.index()).cloned().unwrap_or_default(),
            Root::Global(g) => self.assumptions.content(g),
            Root::Elsewhere => return AbstractValue::Unknown,
        };
        content.at(&place.path).resting_on(&place.sources)
    }
}

impl FoldFrame<'_> {
    fn place(&self, module: &Module, pointer: Handle<Expression>) -> PointerTarget {
        match self.original.expressions[pointer] {
            Expression::LocalVariable(v) => PointerTarget::at(Root::Local(v)),
            Expression::GlobalVariable(g) => PointerTarget::at(Root::Global(g)),
            Expression::AccessIndex { base, index } => {
                self.place(module, base).step(Some(index), None)
            }
            Expression::Access { base, index } => {
                let length = length(module, self.f.ty(module, base));
                match self.known[index.index()].index() {
                    Some((at, sources)) if length.is_some_and(|l| at < l) => {
                        self.place(module, base).step(Some(at), Some(sources))
                    }
                    // Out of bounds it may be any element.
                    _ => self.place(module, base).step(None, None),
                }
            }
            _ => PointerTarget::at(Root::Elsewhere),
        }
    }

    /// Records a store through a pointer.
    pub(super) fn store(
        &mut self,
        module: &Module,
        pointer: Handle<Expression>,
        value: AbstractValue,
    ) {
        let place = self.place(module, pointer);
        let Root::Local(v) = place.root else { return };
        let Some(local) = self.locals.get_mut(v.index()) else {
            return;
        };
        match place.dynamic {
            true => local.set(&place.path, AbstractValue::Unknown),
            false => {
                // The address, and so the unchanged rest of the variable, depends on these.
                *local = std::mem::take(local).resting_on(&place.sources);
                local.set(&place.path, value.resting_on(&place.sources));
            }
        }
    }

    /// Forgets the whole variable of a pointer, after a store of unknown extent.
    pub(super) fn forget_all(&mut self, pointer: Handle<Expression>) {
        let expressions = &self.original.expressions;
        if let Expression::LocalVariable(v) = expressions[naga_operands::base(expressions, pointer)]
            && let Some(local) = self.locals.get_mut(v.index())
        {
            *local = AbstractValue::Unknown;
        }
    }
}

impl PointerTarget {
    fn at(root: Root) -> Self {
        Self {
            root,
            path: Vec::new(),
            sources: Sources::default(),
            dynamic: false,
        }
    }

    fn step(mut self, index: Option<u32>, sources: Option<&Sources>) -> Self {
        if let Some(sources) = sources {
            self.sources = super::known::both(&self.sources, sources);
        }
        match index {
            Some(index) if !self.dynamic => self.path.push(index),
            Some(_) => {}
            None => self.dynamic = true,
        }
        self
    }
}

/// Whether an expression consists only of the author's constants.
fn is_constant(function: &Function, e: Handle<Expression>) -> bool {
    match &function.expressions[e] {
        Expression::Literal(_) | Expression::Constant(_) | Expression::ZeroValue(_) => true,
        Expression::Compose { components, .. } => {
            components.iter().all(|c| is_constant(function, *c))
        }
        Expression::Splat { value, .. } => is_constant(function, *value),
        _ => false,
    }
}

/// Reads a constant from a variable in place of `e`.
fn read_variable(
    frame: &mut FoldFrame<'_>,
    e: Handle<Expression>,
    constant: Handle<Expression>,
    ty: Handle<Type>,
) -> Handle<Expression> {
    fn copy(frame: &mut FoldFrame<'_>, e: Handle<Expression>) -> Handle<Expression> {
        let mut expression = frame.original.expressions[e].clone();
        naga_operands::map_expression(&mut expression, &mut |o| *o = copy(frame, *o));
        frame.append(expression, e)
    }
    let init = copy(frame, constant);
    let variable = LocalVariable {
        name: frame.original.named_expressions.get(&e).cloned(),
        ty,
        init: Some(init),
    };
    let variable = frame
        .function
        .local_variables
        .append(variable, naga::Span::UNDEFINED);
    let pointer = frame.append(Expression::LocalVariable(variable), e);
    frame.emit(Expression::Load { pointer }, e)
}

/// The result of a read outside of a texture: 0, or alpha 1 (WGSL, section 17.7.4).
fn outside() -> AbstractValue {
    let zero = AbstractValue::constant(Scalar::float(0.0));
    let alpha = AbstractValue::constant(Scalar::Number(ScalarKind::Float, Interval::UNIT));
    AbstractValue::Parts(vec![zero.clone(), zero.clone(), zero, alpha])
}

/// Whether all components are known to be 0.
fn is_0(known: &AbstractValue) -> bool {
    match known {
        AbstractValue::Parts(parts) => parts.iter().all(is_0),
        scalar => scalar
            .index()
            .is_some_and(|(at, sources)| at == 0 && sources.is_empty()),
    }
}

/// The bool that all components equal, if it depends on an assumption.
fn all_the_same(known: &AbstractValue) -> Option<(bool, Sources)> {
    common(known, &|component| {
        let (truth, sources) = component.assumed_truth()?;
        Some((truth, Sources::clone(sources)))
    })
}

/// The assumptions by which all components equal this number exactly.
fn all_numbers(known: &AbstractValue, value: f64) -> Option<Sources> {
    let equal = common(known, &|component| match component.scalar()? {
        (Scalar::Number(ScalarKind::Float, x), sources) if x.number() == Some(value) => {
            Some(((), Sources::clone(sources)))
        }
        _ => None,
    });
    Some(equal?.1)
}

/// The result of `of` that all components share, and the assumptions of all.
fn common<T: PartialEq>(
    known: &AbstractValue,
    of: &dyn Fn(&AbstractValue) -> Option<(T, Sources)>,
) -> Option<(T, Sources)> {
    let AbstractValue::Parts(parts) = known else {
        return of(known);
    };
    let mut all = parts.iter().map(|part| common(part, of));
    let first = all.next()??;
    all.try_fold(first, |(value, sources), next| {
        let (other, more) = next?;
        (value == other).then(|| (value, super::known::both(&sources, &more)))
    })
}
