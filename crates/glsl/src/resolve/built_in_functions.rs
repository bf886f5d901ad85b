//! Calls of GLSL's functions, except those of textures.

use glsl_lang::ast;
use glsl_lang::ast::{Expr, ExprData};
use naga::{AtomicFunction, BinaryOperator, MathFunction, ScalarKind, Span, UnaryOperator};

use super::effect::after;
use super::expression::Ex;
use super::fold::Folds;
use super::{Resolver, helpers};
use crate::errors::{unsupported, wrong};
use crate::functions::Meaning;
use crate::operations::Subgroup;
use crate::stage::{Signature, Storage};
use crate::tree::{Kind, Node};
use crate::ty::{Component, Ty};
use crate::{functions, operations};
use shader_text::error::Error;
use shader_text::unsupported;

impl Resolver<'_, '_> {
    /// A call of a built-in function without textures.
    pub(super) fn own(
        &mut self,
        name: &str,
        arguments: &[Expr],
        whole: &Expr,
    ) -> Result<Ex, Error> {
        let place = self.place(whole.span);
        if matches!(
            name,
            "modf" | "frexp" | "uaddCarry" | "usubBorrow" | "umulExtended" | "imulExtended"
        ) {
            return self.with_out(name, arguments, place);
        }
        if name.starts_with("subgroup") {
            let lane = arguments.get(1).and_then(|e| self.stage.fixed_integer(e));
            let lane = lane.and_then(|n| u32::try_from(n).ok());
            if let Some(of) = operations::subgroup(name, lane) {
                return self.subgroup(name, of, arguments, place);
            }
        }
        if let Some(of) = operations::atomic(name) {
            return self.atomic(name, of, arguments, place);
        }
        let mut values = self.values(arguments)?;
        let types: Vec<Ty> = values.iter().map(|v| v.ty.clone()).collect();
        // Functions of 16-bit floats are computed in 32 bits.
        let kinds = || types.iter().filter_map(Ty::kind);
        let half = kinds().any(|k| k == Component::Half)
            && kinds().all(|k| k.power() <= Component::Half.power());
        let widened = |ty: &Ty| match ty.kind() {
            Some(Component::Half) => ty.with_kind(Component::Float),
            _ => ty.clone(),
        };
        let types: Vec<Ty> = types.iter().map(widened).collect();
        values = values
            .into_iter()
            .zip(&types)
            .map(|(v, ty)| self.coerce(v, ty))
            .collect();
        let narrowed = |ex: Ex| match ex.ty.kind() {
            Some(Component::Float) if half => ex.converted(&ex.ty.with_kind(Component::Half)),
            _ => ex,
        };
        unsupported::refuse(name, place)?;
        let Some(function) = functions::named(name) else {
            let message = "a texture function does not accept these arguments";
            return Err(match name.starts_with("image") {
                true => wrong(message, place),
                false => unsupported(format!("there is no function `{name}`"), place),
            });
        };
        let kind = function.converts_to(&types);
        values = values
            .into_iter()
            .map(|v| self.coerce_kind(v, kind))
            .collect();
        let given: Vec<Ty> = values.iter().map(|v| v.ty.clone()).collect();
        let Some(result) = function.result(&given) else {
            let spelled: Vec<String> = types.iter().map(Ty::name).collect();
            let message = format!("no `{name}` takes ({})", spelled.join(", "));
            return Err(wrong(message, place));
        };
        let (mut first, folds) = self.arguments_to_fold(name, &mut values);
        // Evaluate values that are used several times only once.
        let is_repeated = match name {
            "mix" => result.kind() == Some(Component::Bool),
            "matrixCompMult" | "outerProduct" | "isnan" | "isinf" => true,
            "reflect" | "faceforward" => matches!(types.first(), Some(Ty::Scalar(_))),
            _ => false,
        };
        if is_repeated {
            // naga would fold products of a constant.
            let is_moving = |_, v: &Ex| v.folds != Folds::No || !v.node.is_path();
            first.extend(self.hold_in_order(&mut values, is_moving));
        }
        let nodes: Vec<Node> = values.into_iter().map(|v| v.node).collect();
        let node = match (
            function.meaning,
            composed(name, &nodes, types.first(), &result),
        ) {
            (_, Some(composed)) => composed,
            (Meaning::Image(function), None) => Node::texture(function, nodes),
            (meaning, None) => Node::built_in(meaning, nodes),
        };
        let node = node.at(place);
        Ok(narrowed(after(first, Ex::new(node, result).folding(folds))))
    }

    /// A subgroup function: calls a helper for each type of value.
    fn subgroup(
        &mut self,
        name: &str,
        of: Subgroup,
        arguments: &[Expr],
        place: Option<Span>,
    ) -> Result<Ex, Error> {
        let values = self.values(arguments)?;
        let Some(value) = values.first().filter(|v| v.ty.components().is_some()) else {
            let message = format!("`{name}` takes a scalar or a vector");
            return Err(unsupported(message, place));
        };
        let result = match of {
            Subgroup::Ballot => Ty::Vector(Component::Uint, 4),
            _ => value.ty.clone(),
        };
        let (lane, second) = match of {
            Subgroup::Broadcast(n) | Subgroup::QuadBroadcast(n) => (format!("_{n}"), None),
            _ => (String::new(), values.get(1)),
        };
        let wanted = format!("{name}_{}{lane}", value.ty.name());
        let mut helper = self.helper(&wanted, &result);
        let argument = helper.parameter("value", &value.ty);
        let lane = second.map(|_| helper.parameter("lane", &Ty::UINT));
        helper.returns(Node::new(Kind::Subgroup {
            of,
            value: argument,
            lane,
            result: result.clone(),
        }));
        let id = self.add_helper(helper.plain());
        let second = second.map(|v| Node::convert(&Ty::UINT, v.node.clone()));
        let all = [value.node.clone()].into_iter().chain(second).collect();
        Ok(Ex::new(Node::new(Kind::Call(id, all)), result))
    }

    /// An atomic function of storage blocks.
    fn atomic(
        &mut self,
        name: &str,
        of: AtomicFunction,
        arguments: &[Expr],
        place: Option<Span>,
    ) -> Result<Ex, Error> {
        // The other forms order memory, which WebGPU does not support.
        let [target, value, ..] = arguments else {
            let message = format!("`{name}` takes a member and a value");
            return Err(wrong(message, place));
        };
        let target = self.raw(target)?;
        let Ty::Scalar(Component::Int | Component::Uint) = target.ty else {
            let message = format!("`{name}` of {} is not supported", target.ty.name());
            return Err(unsupported(message, place)
                .note("WebGPU's atomic functions take members of type `int` and `uint`"));
        };
        let value = self.expr(value)?;
        let value = self.coerce(value, &target.ty).node;
        let target_node = target.node;
        let atomic = Kind::Atomic {
            of,
            target: target_node,
            value,
        };
        Ok(Ex::new(Node::new(atomic), target.ty))
    }

    /// An atomic function of an image whose result is not used.
    pub(super) fn image_atomic(
        &mut self,
        (name, of): (&str, AtomicFunction),
        (image, at, value): (&Expr, &[Expr], &Expr),
        place: Option<Span>,
    ) -> Result<Node, Error> {
        let is_uniform = |name: &ast::Identifier| {
            let mut all = self.stage.opaque.iter();
            all.any(|v| v.name == name.as_str())
        };
        if !matches!(&image.content, ExprData::Variable(name) if is_uniform(name)) {
            let message = format!("`{name}` takes an image by the name of its uniform");
            return Err(unsupported(message, place)
                .note("write the image's name in place of the parameter or the element"));
        }
        let image = self.expr(image)?;
        let component = match &image.ty {
            Ty::Opaque(ty) if ty.starts_with("uimage") => Component::Uint,
            Ty::Opaque(ty) if ty.starts_with("iimage") => Component::Int,
            _ => {
                return Err(unsupported(
                    format!("`{name}` of {} is not supported", image.ty.name()),
                    place,
                )
                .note("declare an `iimage2D` or `uimage2D` of `r32i` or `r32ui`"));
            }
        };
        let [at] = at else {
            let message = format!("`{name}` takes an image of one sample, coordinates and a value");
            return Err(unsupported(message, place));
        };
        let at = self.expr(at)?;
        let value = self.expr(value)?;
        let value = self.coerce(value, &Ty::Scalar(component));
        let atomic = Kind::ImageAtomic {
            of,
            image: image.node,
            at: at.node,
            value: value.node,
        };
        Ok(Node::new(atomic).at(place))
    }

    /// Built-in functions with out parameters, as expressions.
    fn with_out(
        &mut self,
        name: &str,
        arguments: &[Expr],
        place: Option<naga::Span>,
    ) -> Result<Ex, Error> {
        let (types, values) = self.arguments(arguments)?;
        let Some(ty) = types.first().cloned() else {
            return Err(unsupported(format!("`{name}` takes arguments"), place));
        };
        let helper = self.helper(&format!("{name}_{}", ty.name()), &ty);
        let helper = match (name, &ty) {
            ("modf", of) if of.kind() != Some(Component::Half) => helpers::modf(helper, of),
            ("uaddCarry", of) => helpers::add_carry(self, helper, of),
            ("usubBorrow", of) => helpers::sub_borrow(helper, of),
            ("umulExtended", Ty::Scalar(_)) => helpers::mul_extended(self, helper),
            _ => {
                let message = format!("`{name}` of {} is not supported", ty.name());
                return Err(unsupported(message, place)
                    .note("naga has no such function: write it yourself"));
            }
        };
        // The last argument is written, or for products the last two.
        let outs = 1 + usize::from(name == "umulExtended");
        let first = arguments.len().saturating_sub(outs);
        let storage = |i| if i < first { Storage::In } else { Storage::Out };
        let parameters = types.into_iter().enumerate();
        let signature = Signature {
            parameters: parameters.map(|(i, ty)| (storage(i), ty)).collect(),
            result: helper.result().clone(),
            declared: 0,
            has_body: true,
        };
        let id = self.add_helper(helper);
        self.passed(id, &signature, arguments, values, place)
    }
}

/// An expression for built-in functions that the IR lacks or restricts.
fn composed(name: &str, values: &[Node], first: Option<&Ty>, result: &Ty) -> Option<Node> {
    use BinaryOperator as O;
    let first = first?;
    let at = |i: usize| values.get(i).cloned();
    let binary = Node::binary;
    let number = |x: f32| match first.kind() {
        Some(kind @ Component::Double) => Node::convert(&Ty::Scalar(kind), Node::float(x)),
        _ => Node::float(x),
    };
    let abs = |of: Node| Node::math(MathFunction::Abs, vec![of]);
    Some(match (name, first) {
        ("matrixCompMult", ty @ Ty::Matrix(_, columns, _)) => {
            let (a, b) = (at(0)?, at(1)?);
            let column = |c: u32| binary(O::Multiply, a.nth(c), b.nth(c));
            Node::construct(ty, (0..u32::from(*columns)).map(column).collect())
        }
        ("outerProduct", Ty::Vector(..)) => {
            let Ty::Matrix(_, columns, _) = result else {
                return None;
            };
            let (a, b) = (at(0)?, at(1)?);
            let column = |c: u32| binary(O::Multiply, a.clone(), b.component(c));
            Node::construct(result, (0..u32::from(*columns)).map(column).collect())
        }
        // The IR's functions only take vectors.
        ("dot", Ty::Scalar(_)) => binary(O::Multiply, at(0)?, at(1)?),
        ("length", Ty::Scalar(_)) => abs(at(0)?),
        ("distance", Ty::Scalar(_)) => abs(binary(O::Subtract, at(0)?, at(1)?)),
        ("normalize", Ty::Scalar(_)) => Node::math(MathFunction::Sign, vec![at(0)?]),
        ("reflect", Ty::Scalar(_)) => {
            let (i, n) = (at(0)?, at(1)?);
            let twice = binary(O::Multiply, number(2.0), n.clone());
            let of = binary(O::Multiply, binary(O::Multiply, twice, n), i.clone());
            binary(O::Subtract, i, of)
        }
        ("faceforward", Ty::Scalar(_)) => {
            let n = at(0)?;
            let product = binary(O::Multiply, at(1)?, at(2)?);
            let is_less = binary(O::Less, product, number(0.0));
            Node::choose(is_less, n.clone(), Node::unary(UnaryOperator::Negate, n))
        }
        // Both as vectors in which only one component matters.
        ("refract", Ty::Scalar(_)) => {
            let ty = Ty::Vector(Component::Float, 2);
            let vector = |x: Node| Node::construct(&ty, vec![x, Node::float(0.0)]);
            let all = vec![vector(at(0)?), vector(at(1)?), at(2)?];
            Node::math(MathFunction::Refract, all).component(0)
        }
        // The IR's functions return the type of their argument.
        ("bitCount" | "findLSB" | "findMSB", of) if of.kind() == Some(Component::Uint) => {
            let count = functions::named(name)?.meaning;
            Node::convert(result, Node::built_in(count, vec![at(0)?]))
        }
        // A selection evaluates only one operand.
        ("mix", Ty::Scalar(Component::Bool)) => Node::choose(at(2)?, at(1)?, at(0)?),
        ("mix", Ty::Vector(Component::Bool, n)) => {
            let (a, b, which) = (at(0)?, at(1)?, at(2)?);
            let part = |c: u32| Node::choose(which.component(c), b.component(c), a.component(c));
            Node::construct(result, (0..u32::from(*n)).map(part).collect())
        }
        // WGSL lacks both. Test the bits, which no compiler treats as a constant.
        ("isnan" | "isinf", of) => {
            let bits = Node::built_in(Meaning::Bits(ScalarKind::Uint), vec![at(0)?]);
            let operator = match name {
                "isnan" => O::Greater,
                _ => O::Equal,
            };
            let of_each = |n: u32| match of {
                Ty::Vector(_, size) => {
                    Node::convert(&Ty::Vector(Component::Uint, *size), Node::uint(n))
                }
                _ => Node::uint(n),
            };
            let magnitude = binary(O::And, bits, of_each(0x7FFF_FFFF));
            let both = vec![magnitude, of_each(0x7F80_0000)];
            Node::built_in(Meaning::Operator(operator), both)
        }
        _ => return None,
    })
}
