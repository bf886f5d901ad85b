//! The rest of a value without the viewer: the author's value, with the innermost operation that
//! joins it with the viewer's replaced.

use std::collections::BTreeSet;

use naga::{BinaryOperator, Expression, Handle, Literal, MathFunction, TypeInner};

use super::{At, Changes, Instead, Stage, ViewerReads};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// It is a coordinate of a texture.
    Coordinates,
    /// To be compared with a threshold.
    Alpha,
    /// To be a threshold. A constant may be the author's.
    Threshold,
}

/// How the viewer took part.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Joined {
    #[default]
    Choice,
    /// The viewer's value is a factor.
    Product,
    /// The viewer's value is a summand.
    Sum,
}

/// The rest of a value without the viewer.
#[derive(Clone, Debug)]
pub(super) enum Rest {
    /// A value of the author's.
    Author(Author),
    /// Nothing: the value is the viewer's alone.
    Nothing,
    /// The rest is unclear.
    Unclear,
}

/// A value of the author's, after these changes.
#[derive(Clone, Debug, Default)]
pub(super) struct Author {
    pub changes: Changes,
    /// The value that it is without any operation, if it is one.
    pub root: Option<At>,
    pub joined: Joined,
}

/// Operations that are looked at for one value.
const MOST: u32 = 2_000;

/// The changes that take the viewer out of a texture coordinate; none if they are unclear.
pub(super) fn of_coordinate(stage: &Stage<'_, '_>, at: At) -> Changes {
    match of(stage, at, Mode::Coordinates) {
        Rest::Author(author) => author.changes,
        _ => Changes::new(),
    }
}

/// Takes the viewer out of a value.
pub(super) fn of(stage: &Stage<'_, '_>, at: At, mode: Mode) -> Rest {
    let mut search = Search {
        stage,
        mode,
        open: BTreeSet::new(),
        looked_at: 0,
    };
    search.remainder(at)
}

pub(super) struct Search<'s, 'g, 'p> {
    pub(super) stage: &'s Stage<'g, 'p>,
    pub(super) mode: Mode,
    /// Values that are being looked at: those of loops lead back to themselves.
    open: BTreeSet<At>,
    looked_at: u32,
}

impl Search<'_, '_, '_> {
    pub(super) fn remainder(&mut self, at: At) -> Rest {
        if !self.stage.depends(at) {
            return Rest::Author(Author {
                root: Some(self.stage.origin(at)),
                ..Author::default()
            });
        }
        self.looked_at += 1;
        if self.looked_at > MOST {
            return Rest::Unclear;
        }
        if !self.open.insert(at) {
            return Rest::Author(Author::default());
        }
        let rest = self.of_expression(at);
        self.open.remove(&at);
        rest
    }

    fn of_expression(&mut self, at: At) -> Rest {
        let (context, e) = at;
        let f = self.stage.f(context);
        let module = self.stage.values.graph.module();
        let here = |e| (context, e);
        match &f.function.expressions[e] {
            expression @ (Expression::Unary { .. }
            | Expression::As { .. }
            | Expression::Splat { .. }
            | Expression::Derivative { .. }
            | Expression::Compose { .. }) => {
                let all = naga_operands::of_expression(expression)
                    .into_iter()
                    .map(here);
                self.in_place(at, &all.collect::<Vec<_>>())
            }
            Expression::Swizzle {
                size,
                vector,
                pattern,
            } => {
                let of = pattern[..*size as usize].iter().map(|c| *c as u32);
                self.part(at, here(*vector), &of.collect::<Vec<_>>())
            }
            Expression::AccessIndex { base, index } => match f.ty(module, *base) {
                TypeInner::Vector { .. } | TypeInner::Struct { .. } => {
                    self.part(at, here(*base), &[*index])
                }
                _ => self.wall(at),
            },
            Expression::Binary { op, left, right } => {
                let (left, right) = (here(*left), here(*right));
                let of_matrix = [left, right].iter().any(|side| {
                    let inner = f.ty(module, side.1);
                    matches!(inner, TypeInner::Matrix { .. })
                });
                match op {
                    _ if of_matrix => self.wall(at),
                    BinaryOperator::Add => self.sum(at, [left, right], false),
                    BinaryOperator::Subtract => self.sum(at, [left, right], true),
                    BinaryOperator::Multiply => self.product(at, [left, right]),
                    BinaryOperator::Divide | BinaryOperator::Modulo => {
                        self.quotient(at, left, right)
                    }
                    _ => self.wall(at),
                }
            }
            Expression::Math {
                fun,
                arg,
                arg1,
                arg2,
                ..
            } => {
                let all: Vec<At> = [Some(*arg), *arg1, *arg2]
                    .into_iter()
                    .flatten()
                    .map(here)
                    .collect();
                self.math(at, *fun, &all)
            }
            Expression::Select {
                condition,
                accept,
                reject,
            } => self.choice(at, here(*condition), [here(*accept), here(*reject)]),
            Expression::Load { pointer } => self.loaded(at, *pointer, &[], e),
            Expression::CallResult(_) => {
                let rest = self.called(at, None);
                self.lifted(at, rest)
            }
            Expression::FunctionArgument(i) => match self.stage.argument(context, *i) {
                Some(outer) => self.remainder(outer),
                None => self.wall(at),
            },
            _ => self.wall(at),
        }
    }

    /// The rest of an operation that we do not look behind: lengths and directions, results of
    /// comparisons, other texels.
    pub(super) fn wall(&self, at: At) -> Rest {
        let is_read = self.stage.is_textured(at) || self.stage.reads_screen(at);
        match self.mode != Mode::Coordinates && is_read {
            true => Rest::Unclear,
            false => Rest::Nothing,
        }
    }

    /// Like [`Self::wall`], if an author's value takes part that may be an alpha.
    fn wall_beside(&self, at: At, free: At) -> Rest {
        match self.mode == Mode::Alpha && self.stage.reads(free) != ViewerReads::Nothing {
            true => Rest::Unclear,
            false => self.wall(at),
        }
    }

    /// Whether a value that does not depend on the viewer is the author's own.
    fn is_base(&self, at: At) -> bool {
        !self.stage.depends(at) && (self.mode == Mode::Threshold || self.stage.is_varying(at))
    }

    pub(super) fn is_alike(&self, a: At, b: At) -> bool {
        let module = self.stage.values.graph.module();
        let ty = |at: At| self.stage.f(at.0).ty(module, at.1);
        ty(a) == ty(b)
    }

    /// The rest of an operand. In coordinates, a factor of another type is a weight.
    fn operand(&mut self, of: At, operand: At) -> Rest {
        match self.mode == Mode::Coordinates && !self.is_alike(of, operand) {
            true => Rest::Nothing,
            false => self.remainder(operand),
        }
    }

    /// `value` takes the place of an operation on it.
    pub(super) fn take(&mut self, at: At, value: At, joined: Joined) -> Rest {
        if at.0 != value.0 || !self.is_alike(at, value) {
            return self.wall(at);
        }
        match self.remainder(value) {
            Rest::Author(mut author) => {
                author.changes.insert(at, Instead::Other(value.1));
                author.joined = author.joined.max(joined);
                Rest::Author(author)
            }
            other => other,
        }
    }

    /// An operation stays, and its operands lose the viewer.
    pub(super) fn in_place(&mut self, at: At, operands: &[At]) -> Rest {
        let (mut all, mut nothing, mut base) = (Author::default(), false, false);
        for operand in operands {
            if !self.stage.depends(*operand) {
                base |= self.stage.is_varying(*operand);
                continue;
            }
            match self.remainder(*operand) {
                Rest::Author(author) => {
                    base = true;
                    all.joined = all.joined.max(author.joined);
                    all.changes.extend(author.changes);
                }
                Rest::Nothing => nothing = true,
                Rest::Unclear => return Rest::Unclear,
            }
        }
        match (nothing, base) {
            (false, _) => Rest::Author(all),
            (true, false) => Rest::Nothing,
            (true, true) if self.mode == Mode::Coordinates => Rest::Unclear,
            (true, true) => self.wall(at),
        }
    }

    fn sum(&mut self, at: At, sides: [At; 2], minus: bool) -> Rest {
        let [left, right] = sides;
        let depends = sides.map(|side| self.stage.depends(side));
        let coordinates = self.mode == Mode::Coordinates;
        let (free, other) = match depends {
            [false, _] => (left, right),
            [_, false] => (right, left),
            _ => return self.sum_of_two(at, sides, minus),
        };
        let is_author = self.is_base(free) && self.is_alike(at, free);
        let rest = self.operand(at, other);
        match rest {
            // `uv + offset * depth`: whatever the viewer adds to a coordinate is an offset.
            _ if coordinates && is_author => match minus && free == right {
                true => self.wall(at),
                false => self.take(at, free, Joined::Sum),
            },
            Rest::Author(author) => {
                let has_two = self.mode == Mode::Alpha && self.is_base(free);
                if has_two || (!coordinates && author.joined == Joined::Sum) {
                    return self.wall(at);
                }
                Rest::Author(Author {
                    root: None,
                    ..author
                })
            }
            Rest::Nothing => {
                let is_said = self.mode == Mode::Alpha
                    && is_author
                    && self.stage.is_textured(free)
                    && !(minus && free == right)
                    && !self.has_constant(free);
                match is_said {
                    true => self.take(at, free, Joined::Sum),
                    false => self.wall_beside(at, free),
                }
            }
            Rest::Unclear => Rest::Unclear,
        }
    }

    /// A sum with two sides that depend on the viewer.
    fn sum_of_two(&mut self, at: At, [left, right]: [At; 2], minus: bool) -> Rest {
        let coordinates = self.mode == Mode::Coordinates;
        match (self.operand(at, left), self.operand(at, right)) {
            (Rest::Author(a), Rest::Author(b)) => {
                let is_one = a.root.is_some() && self.origin(a.root) == self.origin(b.root);
                let products = [&a, &b].map(|side| side.joined == Joined::Product);
                match (products, coordinates) {
                    // A weighted mean of one value.
                    ([true, true], _) if is_one && !minus => match a.root {
                        Some(root) => self.take(at, root, Joined::Choice),
                        None => self.wall(at),
                    },
                    _ if is_one && minus => Rest::Nothing,
                    ([false, true], true) => self.take(at, left, Joined::Sum),
                    ([true, false], true) if !minus => self.take(at, right, Joined::Sum),
                    (_, true) => Rest::Unclear,
                    (_, false) => self.wall(at),
                }
            }
            (Rest::Author(_), Rest::Nothing) if coordinates || !self.has_constant(left) => {
                self.take(at, left, Joined::Sum)
            }
            (Rest::Nothing, Rest::Author(_))
                if !minus && (coordinates || !self.has_constant(right)) =>
            {
                self.take(at, right, Joined::Sum)
            }
            (Rest::Nothing, Rest::Nothing) => Rest::Nothing,
            (Rest::Unclear, _) | (_, Rest::Unclear) => Rest::Unclear,
            _ => self.wall(at),
        }
    }

    fn origin(&self, root: Option<At>) -> Option<At> {
        root.map(|root| self.stage.origin(root))
    }

    fn product(&mut self, at: At, sides: [At; 2]) -> Rest {
        let [left, right] = sides;
        let depends = sides.map(|side| self.stage.depends(side));
        let (free, other) = match depends {
            [false, _] => (left, right),
            [_, false] => (right, left),
            _ => {
                return match (self.operand(at, left), self.operand(at, right)) {
                    (Rest::Author(a), Rest::Author(mut b)) => {
                        if self.mode == Mode::Coordinates {
                            return Rest::Unclear;
                        }
                        b.changes.extend(a.changes);
                        Rest::Author(Author {
                            changes: b.changes,
                            root: None,
                            joined: a.joined.max(b.joined),
                        })
                    }
                    (Rest::Author(_), Rest::Nothing) => self.take(at, left, Joined::Product),
                    (Rest::Nothing, Rest::Author(_)) => self.take(at, right, Joined::Product),
                    (Rest::Nothing, Rest::Nothing) => Rest::Nothing,
                    _ => Rest::Unclear,
                };
            }
        };
        let is_author = self.is_base(free) && self.is_alike(at, free);
        match self.operand(at, other) {
            Rest::Author(author) => Rest::Author(Author {
                root: None,
                ..author
            }),
            Rest::Nothing if is_author => {
                // A fade is a factor from 0 to 1; a distance is none.
                let is_said = match self.mode {
                    Mode::Coordinates => true,
                    Mode::Alpha => self.stage.is_textured(free) || self.is_part(other, 8),
                    Mode::Threshold => self.is_part(other, 8),
                };
                match is_said {
                    true => self.take(at, free, Joined::Product),
                    false => self.wall_beside(at, free),
                }
            }
            Rest::Nothing => self.wall(at),
            Rest::Unclear => Rest::Unclear,
        }
    }

    /// A quotient whose divisor is the viewer's is unclear.
    fn quotient(&mut self, at: At, left: At, right: At) -> Rest {
        match (self.stage.depends(right), self.operand(at, left)) {
            (false, Rest::Author(author)) => Rest::Author(Author {
                root: None,
                ..author
            }),
            (true, Rest::Author(_)) if self.mode == Mode::Coordinates && self.is_base(left) => {
                Rest::Unclear
            }
            (_, Rest::Unclear) => Rest::Unclear,
            _ => self.wall(at),
        }
    }

    fn math(&mut self, at: At, fun: MathFunction, all: &[At]) -> Rest {
        match (fun, all) {
            (
                MathFunction::Length
                | MathFunction::Distance
                | MathFunction::Normalize
                | MathFunction::Dot
                | MathFunction::Cross
                | MathFunction::Reflect
                | MathFunction::Refract
                | MathFunction::FaceForward
                | MathFunction::Transpose
                | MathFunction::Inverse
                | MathFunction::Determinant
                | MathFunction::Outer,
                _,
            ) => self.wall(at),
            (MathFunction::Mix, [x, y, weight]) => self.choice(at, *weight, [*x, *y]),
            (MathFunction::Min | MathFunction::Max, [left, right]) => {
                self.extremum(at, [*left, *right])
            }
            (MathFunction::Fma, [a, b, c]) => {
                let product = self.stage.depends(*a) || self.stage.depends(*b);
                match self.mode == Mode::Coordinates && product && self.is_base(*c) {
                    true => self.take(at, *c, Joined::Sum),
                    false => self.in_place(at, all),
                }
            }
            _ => self.in_place(at, all),
        }
    }

    /// One of two values, or a value between them.
    fn choice(&mut self, at: At, by: At, values: [At; 2]) -> Rest {
        if !self.stage.depends(by) {
            return self.in_place(at, &values);
        }
        let mut found: Vec<(At, Option<At>)> = Vec::new();
        for value in values {
            let is_free = !self.stage.depends(value);
            if is_free && !self.is_base(value) {
                continue;
            }
            match self.remainder(value) {
                Rest::Author(author) => found.push((value, author.root)),
                Rest::Nothing => {}
                Rest::Unclear => return Rest::Unclear,
            }
        }
        match found[..] {
            [(one, _)] if self.mode != Mode::Threshold => self.take(at, one, Joined::Product),
            [(one, Some(a)), (_, Some(b))] if self.stage.origin(a) == self.stage.origin(b) => {
                self.take(at, one, Joined::Choice)
            }
            [] => self.wall(at),
            _ if self.mode == Mode::Coordinates => Rest::Unclear,
            _ => self.wall(at),
        }
    }

    fn extremum(&mut self, at: At, sides: [At; 2]) -> Rest {
        let [left, right] = sides;
        let (free, other) = match sides.map(|side| self.stage.depends(side)) {
            [false, _] => (left, right),
            [_, false] => (right, left),
            _ => return self.in_place(at, &sides),
        };
        match self.operand(at, other) {
            Rest::Nothing if self.mode != Mode::Threshold && self.is_base(free) => {
                self.take(at, free, Joined::Product)
            }
            Rest::Author(_) if self.is_base(free) => self.wall(at),
            _ => self.in_place(at, &sides),
        }
    }

    /// Whether a value is a sum with a constant.
    fn has_constant(&self, (context, e): At) -> bool {
        let f = self.stage.f(context);
        match f.function.expressions[e] {
            Expression::Binary {
                op: BinaryOperator::Add | BinaryOperator::Subtract,
                left,
                right,
            } => [left, right].iter().any(|side| {
                let side = (context, *side);
                !self.stage.is_varying(side) || self.has_constant(side)
            }),
            _ => self
                .only_store(self.stage.origin((context, e)))
                .is_some_and(|value| self.has_constant(value)),
        }
    }

    /// Whether a value is certainly from 0 to 1.
    fn is_part(&self, at: At, depth: u32) -> bool {
        let Some(depth) = depth.checked_sub(1) else {
            return false;
        };
        let (context, e) = self.stage.origin(at);
        let is = |e: &Handle<Expression>| self.is_part((context, *e), depth);
        let expressions = &self.stage.f(context).function.expressions;
        let is_literal = |e: Handle<Expression>, value: f32| matches!(expressions[e], Expression::Literal(Literal::F32(x)) if x == value);
        match &expressions[e] {
            Expression::Literal(Literal::F32(x)) => (0.0..=1.0).contains(x),
            Expression::Math {
                fun,
                arg,
                arg1,
                arg2,
                ..
            } => match (fun, arg1, arg2) {
                (MathFunction::Saturate | MathFunction::SmoothStep | MathFunction::Step, ..) => {
                    true
                }
                (MathFunction::Clamp, Some(low), Some(high)) => {
                    is_literal(*low, 0.0) && is_literal(*high, 1.0)
                }
                (MathFunction::Min | MathFunction::Max, Some(other), _) => is(arg) && is(other),
                (MathFunction::Mix, Some(other), Some(weight)) => {
                    is(arg) && is(other) && is(weight)
                }
                _ => false,
            },
            Expression::Binary { op, left, right } => match op {
                BinaryOperator::Multiply => is(left) && is(right),
                BinaryOperator::Subtract => is_literal(*left, 1.0) && is(right),
                _ => false,
            },
            Expression::Select { accept, reject, .. } => is(accept) && is(reject),
            Expression::CallResult(_) => match self.stage.callee((context, e)) {
                Some(child) => {
                    let returns = self.stage.returns(child);
                    !returns.is_empty() && returns.iter().all(|(_, v)| self.is_part(*v, depth))
                }
                None => false,
            },
            Expression::Load { .. } => self
                .only_store((context, e))
                .is_some_and(|value| self.is_part(value, depth)),
            _ => false,
        }
    }
}
