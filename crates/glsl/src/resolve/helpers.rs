//! Helper functions for GLSL functions that the IR lacks.

use naga::{BinaryOperator as O, MathFunction, Span};

use super::Resolver;
use crate::tree::{
    Case, Function, FunctionId, HandleTy, Kind, LocalId, Node, Parameter, ParameterTy, Statement,
    StatementKind,
};
use crate::ty::{Component, Ty};

/// A helper function under construction.
pub(super) struct Helper {
    function: Function,
}

impl Helper {
    pub(super) fn result(&self) -> &Ty {
        &self.function.result
    }

    pub(super) fn parameter(&mut self, name: &str, ty: &Ty) -> Node {
        self.add(name, ParameterTy::Data(ty.clone()), false)
    }

    pub(super) fn handle(&mut self, name: &str, ty: HandleTy) -> Node {
        self.add(name, ParameterTy::Handle(ty), false)
    }

    fn out(&mut self, name: &str, ty: &Ty) -> Node {
        self.add(name, ParameterTy::Data(ty.clone()), true)
    }

    fn add(&mut self, name: &str, ty: ParameterTy, is_out: bool) -> Node {
        self.function.parameters.push(Parameter {
            name: name.to_owned(),
            ty,
            is_out,
            is_in: !is_out,
            span: Span::UNDEFINED,
        });
        Node::new(Kind::Parameter(self.function.parameters.len() - 1))
    }

    /// Marks its parameters as read-only.
    pub(super) fn plain(mut self) -> Self {
        self.function.is_plain = true;
        self
    }

    pub(super) fn declare(&mut self, local: LocalId, init: Option<Node>) -> Node {
        self.push(StatementKind::Declare(local, init));
        Node::local(local)
    }

    fn assign(&mut self, to: &Node, value: Node) {
        self.push(StatementKind::Evaluate(Node::assign(to, value)));
    }

    pub(super) fn switch(&mut self, selector: Node, cases: Vec<Case>) {
        self.push(StatementKind::Switch { selector, cases });
    }

    pub(super) fn returns(&mut self, value: Node) {
        self.push(StatementKind::Return(Some(value)));
    }

    fn push(&mut self, kind: StatementKind) {
        self.function.body.push(Statement::new(kind));
    }
}

impl Resolver<'_, '_> {
    /// Starts a helper function. Equal purposes get the same name.
    pub(super) fn helper(&mut self, wanted: &str, result: &Ty) -> Helper {
        let name = self.helper_name(wanted);
        Helper {
            function: Function {
                name,
                parameters: Vec::new(),
                result: result.clone(),
                body: Vec::new(),
                is_plain: false,
                span: Span::UNDEFINED,
            },
        }
    }

    /// Adds a helper function, unless one with its name exists.
    pub(super) fn add_helper(&mut self, helper: Helper) -> FunctionId {
        let next = FunctionId(self.out.functions.len());
        let id = *self
            .helpers
            .entry(helper.function.name.clone())
            .or_insert(next);
        if id == next {
            self.out.functions.push(Some(helper.function));
        }
        id
    }
}

/// `modf`: returns the fraction, and writes the whole part.
pub(super) fn modf(mut helper: Helper, ty: &Ty) -> Helper {
    let x = helper.parameter("x", ty);
    let whole = helper.out("whole", ty);
    helper.assign(&whole, Node::math(MathFunction::Trunc, vec![x.clone()]));
    helper.returns(Node::binary(O::Subtract, x, whole));
    helper
}

/// `a < b` as a number of this type.
fn less(ty: &Ty, a: Node, b: Node) -> Node {
    match ty.components() {
        Some(1) => {
            let is_less = Node::binary(O::Less, a, b);
            Node::choose(is_less, Node::uint(1), Node::uint(0))
        }
        _ => Node::convert(ty, Node::binary(O::Less, a, b)),
    }
}

/// `uaddCarry`: a sum that wraps is smaller than its operands.
pub(super) fn add_carry(resolver: &mut Resolver<'_, '_>, mut helper: Helper, ty: &Ty) -> Helper {
    let (x, y) = (helper.parameter("x", ty), helper.parameter("y", ty));
    let carry = helper.out("carry", ty);
    let sum = resolver.add_local("sum", ty.clone());
    let sum = helper.declare(sum, Some(Node::binary(O::Add, x.clone(), y)));
    helper.assign(&carry, less(ty, sum.clone(), x));
    helper.returns(sum);
    helper
}

/// `usubBorrow`: a difference borrows if the minuend is smaller.
pub(super) fn sub_borrow(mut helper: Helper, ty: &Ty) -> Helper {
    let (x, y) = (helper.parameter("x", ty), helper.parameter("y", ty));
    let borrow = helper.out("borrow", ty);
    helper.assign(&borrow, less(ty, x.clone(), y.clone()));
    helper.returns(Node::binary(O::Subtract, x, y));
    helper
}

/// `umulExtended`: the 64-bit product of two integers, from 16-bit halves.
pub(super) fn mul_extended(resolver: &mut Resolver<'_, '_>, mut helper: Helper) -> Helper {
    helper.function.result = Ty::Void;
    let (x, y) = (
        helper.parameter("x", &Ty::UINT),
        helper.parameter("y", &Ty::UINT),
    );
    let (high, low) = (helper.out("high", &Ty::UINT), helper.out("low", &Ty::UINT));
    let low_half = |of: &Node| Node::binary(O::And, of.clone(), Node::uint(0xFFFF));
    let high_half = |of: &Node| Node::binary(O::ShiftRight, of.clone(), Node::uint(16));
    let product = |a: Node, b: Node| Node::binary(O::Multiply, a, b);
    let sum = |all: Vec<Node>| {
        let mut all = all.into_iter();
        let first = all.next().unwrap_or_else(|| Node::uint(0));
        all.fold(first, |all, part| Node::binary(O::Add, all, part))
    };
    let mut local = |helper: &mut Helper, name: &str, init: Node| {
        let local = resolver.add_local(name, Ty::Scalar(Component::Uint));
        helper.declare(local, Some(init))
    };
    let a = local(&mut helper, "a", product(low_half(&x), low_half(&y)));
    let b = local(&mut helper, "b", product(high_half(&x), low_half(&y)));
    let c = local(&mut helper, "c", product(low_half(&x), high_half(&y)));
    let middle = sum(vec![high_half(&a), low_half(&b), low_half(&c)]);
    let middle = local(&mut helper, "middle", middle);
    helper.assign(&low, product(x.clone(), y.clone()));
    let halves = vec![
        product(high_half(&x), high_half(&y)),
        high_half(&b),
        high_half(&c),
        high_half(&middle),
    ];
    helper.assign(&high, sum(halves));
    helper
}
