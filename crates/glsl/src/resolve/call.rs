//! Calls of constructors, user functions and built-in functions.

use glsl_lang::ast::{self, Expr, ExprData, FunIdentifierData};
use naga::{AtomicFunction, BinaryOperator, MathFunction, ScalarKind, Span, UnaryOperator};

use super::effect::{Argument, after};
use super::expression::Ex;
use super::fold::Folds;
use super::overload::{OverloadChoice, choose};
use super::{Pair, Resolver, helpers, texture};
use crate::constant;
use crate::errors::{unsupported, wrong};
use crate::functions::{self, Meaning};
use crate::operations::{self, Subgroup};
use crate::stage::{Signature, Storage};
use crate::tree::{FunctionId, Kind, Node};
use crate::ty::{BlockEntry, Component, Length, MemoryLayout, Ty, spelled};
use shader_text::error::Error;
use shader_text::unsupported;

impl Resolver<'_, '_> {
    /// The value of `length()`: the specialisation constant, if it is one.
    fn known_length(&self, length: Length) -> Ex {
        let lengths = self.stage.lengths.borrow();
        let mut constants = lengths.iter().map(|(constant, _)| constant);
        let constant = constants.find(|constant| Some(constant.id) == length.constant);
        let Some(constant) = constant else {
            return Ex::new(Node::int(length.n as i32), Ty::INT);
        };
        let global = self.scopes.first().and_then(|s| s.get(&constant.own));
        match global.filter(|_| !self.is_local(&constant.own)) {
            Some(global) if constant.is_signed => Ex::new(global.ex.node.clone(), Ty::INT),
            Some(global) => Ex::new(Node::convert(&Ty::INT, global.ex.node.clone()), Ty::INT),
            // A local variable hides it.
            None => {
                let fixed = (constant.id, constant.own.clone());
                self.stage.assumed.borrow_mut().insert(fixed);
                Ex::new(Node::int(length.n as i32), Ty::INT)
            }
        }
    }

    pub(super) fn call(
        &mut self,
        name: &ast::FunIdentifier,
        arguments: &[Expr],
        whole: &Expr,
    ) -> Result<Ex, Error> {
        match &name.content {
            FunIdentifierData::TypeSpecifier(spec) => {
                let function = spelled(&spec.ty);
                // With Vulkan's types, `texture2D` parses as a constructor.
                if spec.array_specifier.is_none() && function.contains("texture") {
                    return self.named(&function, arguments, whole);
                }
                let ty = self.stage.ty(spec, None, self.place(whole.span))?;
                self.constructor(ty, arguments, whole)
            }
            FunIdentifierData::Expr(callee) => match &callee.content {
                ExprData::Variable(function) => self.named(function.as_str(), arguments, whole),
                ExprData::Dot(of, method) if method.as_str() == "length" => {
                    let of = self.raw(of)?;
                    let length = match &of.ty {
                        Ty::Array(_, n) => *n,
                        Ty::Vector(_, n) => Some(u32::from(*n).into()),
                        Ty::Matrix(_, columns, _) => Some(u32::from(*columns).into()),
                        _ => None,
                    };
                    Ok(match length {
                        Some(length) => self.known_length(length),
                        None => {
                            let length = Node::new(Kind::Length(of.node));
                            Ex::new(Node::convert(&Ty::INT, length), Ty::INT)
                        }
                    })
                }
                _ => Err(unsupported("this cannot be called", self.place(whole.span))),
            },
        }
    }

    fn values(&mut self, arguments: &[Expr]) -> Result<Vec<Ex>, Error> {
        arguments.iter().map(|a| self.expr(a)).collect()
    }

    /// A constructor's call.
    fn constructor(&mut self, ty: Ty, arguments: &[Expr], whole: &Expr) -> Result<Ex, Error> {
        let place = self.place(whole.span);
        let values = self.values(arguments)?;
        let types: Vec<Ty> = values.iter().map(|v| v.ty.clone()).collect();
        self.check_constructor(&ty, &types, place)?;
        let folds = Folds::of(&values, |values| constant::construct(&ty, values));
        let ex = match (&ty, &values[..]) {
            (Ty::Combined(name), [texture, sampler]) => {
                let pair = Pair {
                    combined: name.clone(),
                    texture: texture.node.clone(),
                    sampler: sampler.node.clone(),
                };
                let mut ex = Ex::new(pair.node(), ty.clone());
                ex.pair = Some(pair);
                ex
            }
            (Ty::Combined(name), _) => {
                let message = format!("`{name}` takes a texture and a sampler");
                return Err(unsupported(message, place));
            }
            (Ty::Struct(name), _) => self.struct_constructor(name, values, place)?,
            (Ty::Array(of, n), _) => {
                // `float[][](..)`: the elements have the inner length.
                let of = match (&**of, types.first()) {
                    (Ty::Array(_, None), Some(first @ Ty::Array(..))) => first,
                    _ => of,
                };
                let ty = Ty::Array(
                    Box::new(of.clone()),
                    Some(n.unwrap_or((values.len() as u32).into())),
                );
                let values: Vec<Ex> = values.into_iter().map(|v| self.coerce(v, of)).collect();
                constructed(&values, ty)
            }
            (Ty::Void | Ty::Opaque(_), _) => constructed(&values, ty),
            (_, [value]) if value.ty == ty => value.clone(),
            // The first component of a vector or matrix.
            (Ty::Scalar(_), [value]) => {
                let node = value.node.clone();
                let first = match &value.ty {
                    Ty::Vector(..) => node.component(0),
                    Ty::Matrix(..) => node.nth(0).component(0),
                    _ => node,
                };
                Ex::new(Node::convert(&ty, first), ty)
            }
            // A longer vector is truncated.
            (Ty::Vector(kind, n), [value]) if value.ty.components().is_some_and(|m| m > *n) => {
                let cut = value.node.swizzle(0..u32::from(*n));
                match value.ty.kind() == Some(*kind) {
                    true => Ex::new(cut, ty),
                    false => Ex::new(Node::convert(&ty, cut), ty),
                }
            }
            (Ty::Vector(kind, n), _) => self.components(&ty, *kind, usize::from(*n), values),
            (Ty::Matrix(kind, columns, rows), _) => {
                let all = usize::from(*columns) * usize::from(*rows);
                match &values[..] {
                    [value] if matches!(value.ty, Ty::Matrix(..)) => resized(value, &ty),
                    [value] if matches!(value.ty, Ty::Vector(..)) => {
                        let (first, value) = self.once(value);
                        let parts = (0..all.min(4) as u32).map(|c| value.node.component(c));
                        after(first, Ex::new(Node::construct(&ty, parts.collect()), ty))
                    }
                    _ => self.components(&ty, *kind, all, values),
                }
            }
            _ => constructed(&values, ty),
        };
        Ok(ex.folding(folds))
    }

    fn struct_constructor(
        &mut self,
        name: &str,
        values: Vec<Ex>,
        place: Option<Span>,
    ) -> Result<Ex, Error> {
        let of = self.stage.structs.get(name).cloned();
        let entries = of.as_ref().map(|of| self.stage.structs.entries(of));
        let (mut first, mut parts) = (Vec::new(), Vec::new());
        let mut values = values.into_iter();
        for entry in entries.unwrap_or_default() {
            let BlockEntry::Member(member) = entry else {
                parts.push(Node::float(0.0));
                continue;
            };
            let Some(value) = values.next() else {
                break;
            };
            let mut value = self.coerce(value, &member.ty);
            let lay = self.stage.structs.member_lay(name, MemoryLayout::default());
            if self.stage.structs.is_converted(&member.ty, lay) {
                let (before, held) = self.once(&value);
                first.extend(before);
                value = held;
            }
            parts.push(self.packed(&value, &member.ty, lay).ok_or_else(|| {
                unsupported("a struct of this shape cannot be constructed", place)
            })?);
        }
        let ty = Ty::Struct(name.to_owned());
        Ok(after(first, Ex::new(Node::construct(&ty, parts), ty)))
    }

    /// A vector or matrix constructor from components: converts each and drops extra ones.
    fn components(&self, ty: &Ty, kind: Component, wanted: usize, mut values: Vec<Ex>) -> Ex {
        let alone = values.len() == 1;
        // A single scalar for all components is converted first.
        if let [value] = &mut values[..]
            && matches!(value.ty, Ty::Scalar(from) if from != kind)
        {
            *value = value.converted(&Ty::Scalar(kind));
        }
        let mut have = 0;
        let parts: Vec<Node> = values
            .into_iter()
            .map(|mut value| {
                let n = usize::from(value.ty.components().unwrap_or(1));
                // The last argument may have extra components.
                if let Ty::Vector(k, _) = value.ty
                    && have + n > wanted
                    && have < wanted
                {
                    let rest = wanted - have;
                    let node = value.node.swizzle(0..rest as u32);
                    value = Ex::new(node, Ty::vector(k, rest as u8));
                }
                have += n;
                match (value.ty.kind(), kind) {
                    (Some(from), _) if from == kind || alone => value.node,
                    (None, _) => value.node,
                    // Keep a literal a literal.
                    (Some(Component::Int), Component::Float) => {
                        self.coerce_kind(value, Some(kind)).node
                    }
                    _ => value.converted(&value.ty.with_kind(kind)).node,
                }
            })
            .collect();
        Ex::new(Node::construct(ty, parts), ty.clone())
    }

    fn named(&mut self, name: &str, arguments: &[Expr], whole: &Expr) -> Result<Ex, Error> {
        if let Some(signatures) = self.stage.signatures.get(name).cloned()
            && !self.is_own_after_all(name, &signatures, arguments)?
        {
            return self.authors(name, &signatures, arguments, whole);
        }
        if let Some(ex) = self.textured(name, arguments, whole)? {
            return Ok(ex);
        }
        self.own(name, arguments, whole)
    }

    /// Whether a built-in overload is meant although the author has a function of that name. GLSL
    /// ES 1.00 allows both. GLSL 4.60 (6.1) hides the built-in function, but compilers accept it if
    /// no user function fits.
    fn is_own_after_all(
        &mut self,
        name: &str,
        signatures: &[Signature],
        arguments: &[Expr],
    ) -> Result<bool, Error> {
        let own = functions::named(name).is_some() || texture::function(name).is_some();
        if !own {
            return Ok(false);
        }
        let mut values = Vec::new();
        for argument in arguments {
            values.push(self.look(argument)?.ty);
        }
        let given: Vec<&Ty> = values.iter().collect();
        Ok(choose(signatures, &given, self.is_implicit()) == OverloadChoice::None)
    }

    /// A call of a user function.
    fn authors(
        &mut self,
        name: &str,
        signatures: &[Signature],
        arguments: &[Expr],
        whole: &Expr,
    ) -> Result<Ex, Error> {
        let (mut types, mut values) = (Vec::new(), Vec::new());
        for argument in arguments {
            let (ty, value) = self.argument(argument)?;
            types.push(ty);
            values.push(value);
        }
        let place = self.place(whole.span);
        let overload = self.overload(name, signatures, &types, place)?;
        let signature = &signatures[overload];
        self.calls.push((name.to_owned(), overload));
        let id = self.function_id(name, overload);
        self.passed(id, signature, arguments, values, place)
    }

    /// A call of a function of that signature. `values`: see [`Self::argument`].
    fn passed(
        &mut self,
        id: FunctionId,
        signature: &Signature,
        arguments: &[Expr],
        mut values: Vec<Option<Ex>>,
        place: Option<Span>,
    ) -> Result<Ex, Error> {
        let structs = &self.stage.structs;
        let copies = |(storage, to): &(Storage, Ty)| {
            *storage != Storage::In && structs.has_data(to) && !structs.has_samplers(to)
        };
        let outs: Vec<bool> = signature.parameters.iter().map(copies).collect();
        let call_effects = self.call_effects(arguments, outs.clone());
        let mut direct = Vec::new();
        for (i, (_, to)) in signature.parameters.iter().enumerate() {
            direct.push(!outs[i] || self.is_direct(&call_effects, i, to)?);
        }
        // If an argument is copied before the call, all later side effects must keep their order.
        let in_order = direct.contains(&false) && call_effects.has_effects();
        let mut parts = Vec::new();
        for (i, (storage, to)) in signature.parameters.iter().enumerate() {
            if !direct[i] {
                parts.push(self.copied(&call_effects, i, to, *storage)?);
                continue;
            }
            let value = match values[i].take() {
                None => self.raw(&arguments[i])?,
                Some(value) => value,
            };
            let path = value.path.clone();
            let pair = value.pair.clone();
            if value.choice.is_some() {
                return Err(unsupported(
                    "a sampler selected by a dynamic index cannot be an argument",
                    place,
                ));
            }
            if self.stage.structs.has_data(to) {
                let value = match storage {
                    Storage::In => {
                        let value = self.value(value);
                        self.coerce(value, to)
                    }
                    _ => value,
                };
                let samplers = self.stage.structs.has_samplers(to);
                parts.push(match in_order && *storage == Storage::In && !samplers {
                    true => self.in_order(&arguments[i], value)?,
                    false => Argument::of(value.node),
                });
            }
            if !self.stage.structs.has_samplers(to) {
                continue;
            }
            if let Some(pair) = pair {
                parts.push(Argument::of(pair.texture));
                parts.push(Argument::of(pair.sampler));
                continue;
            }
            let path = path.unwrap_or_default();
            let mut found = Vec::new();
            self.stage.structs.samplers(to, &path, &mut found);
            for (path, _) in found {
                let pair = self.pairs.get(&path).cloned();
                let pair =
                    pair.ok_or_else(|| unsupported("these samplers cannot be resolved", place))?;
                parts.push(Argument::of(pair.texture));
                parts.push(Argument::of(pair.sampler));
            }
        }
        let call = |parts| Node::new(Kind::Call(id, parts));
        self.called(call, signature.result.clone(), parts, place)
    }

    /// The function of a name and the index of a signature.
    pub(super) fn function_id(&mut self, name: &str, overload: usize) -> FunctionId {
        let next = FunctionId(self.out.functions.len());
        let key = (name.to_owned(), overload);
        let id = *self.functions.entry(key).or_insert(next);
        if id == next {
            self.out.functions.push(None);
        }
        id
    }

    /// A call of a built-in function without textures.
    fn own(&mut self, name: &str, arguments: &[Expr], whole: &Expr) -> Result<Ex, Error> {
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
        // The functions of 16-bit floats compute in 32 bits.
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
            for value in &mut values {
                // The products of a constant would be folded.
                let (before, held) = match value.folds {
                    Folds::No => self.once(value),
                    _ => self.hidden(value.clone()),
                };
                first.extend(before);
                *value = held;
            }
        }
        let nodes: Vec<Node> = values.into_iter().map(|v| v.node).collect();
        let node = match (
            function.meaning,
            composed(name, &nodes, types.first(), &result),
        ) {
            (_, Some(composed)) => composed,
            (Meaning::Image, None) => Node::texture(name, nodes),
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

    /// An atomic function.
    fn atomic(
        &mut self,
        name: &str,
        of: AtomicFunction,
        arguments: &[Expr],
        place: Option<Span>,
    ) -> Result<Ex, Error> {
        // The others order memory, which WebGPU does not.
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

    /// Built-in functions with out parameters, written as expressions.
    fn with_out(
        &mut self,
        name: &str,
        arguments: &[Expr],
        place: Option<naga::Span>,
    ) -> Result<Ex, Error> {
        let (mut types, mut values) = (Vec::new(), Vec::new());
        for argument in arguments {
            let (ty, value) = self.argument(argument)?;
            types.push(ty);
            values.push(value);
        }
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
        // The last argument is written; for products, the last two.
        let outs = 1 + usize::from(name == "umulExtended");
        let first = arguments.len().saturating_sub(outs);
        let storage = |i| if i < first { Storage::In } else { Storage::Out };
        let parameters = types.into_iter().enumerate();
        let signature = Signature {
            parameters: parameters.map(|(i, ty)| (storage(i), ty)).collect(),
            result: helper.result().clone(),
        };
        let id = self.add_helper(helper);
        self.passed(id, &signature, arguments, values, place)
    }

    /// The name of a helper function or constant, the same for each purpose.
    pub(super) fn helper_name(&mut self, wanted: &str) -> String {
        if let Some(name) = self.helper_names.get(wanted) {
            return name.clone();
        }
        let name = self.fresh(wanted);
        self.helper_names.insert(wanted.to_owned(), name.clone());
        name
    }

    /// A call of a texture function; `None` for any other.
    fn textured(
        &mut self,
        name: &str,
        arguments: &[Expr],
        whole: &Expr,
    ) -> Result<Option<Ex>, Error> {
        let Some(function) = texture::function(name) else {
            return Ok(None);
        };
        let Some(first) = arguments.first() else {
            return Ok(None);
        };
        let sampler = self.raw(first)?;
        let rest = self.values(&arguments[1..])?;
        self.sample(name, &function, sampler, rest, arguments, whole)
            .map(Some)
    }
}

/// Converts a matrix to another size, filled up with the identity.
fn resized(value: &Ex, to: &Ty) -> Ex {
    let (Ty::Matrix(_, columns, rows), Ty::Matrix(_, have_columns, have_rows)) = (to, &value.ty)
    else {
        return value.clone();
    };
    let node = &value.node;
    if have_columns >= columns && have_rows >= rows || !node.is_path() {
        return value.converted(to);
    }
    let mut parts = Vec::new();
    for c in 0..*columns {
        for r in 0..*rows {
            parts.push(match c < *have_columns && r < *have_rows {
                true => node.nth(u32::from(c)).nth(u32::from(r)),
                false => Node::float(if c == r { 1.0 } else { 0.0 }),
            });
        }
    }
    Ex::new(Node::construct(to, parts), to.clone())
}

fn constructed(values: &[Ex], ty: Ty) -> Ex {
    let parts = values.iter().map(|v| v.node.clone()).collect();
    Ex::new(Node::construct(&ty, parts), ty)
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
        // The IR's only take vectors.
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
        // Both as vectors of one component that matters.
        ("refract", Ty::Scalar(_)) => {
            let ty = Ty::Vector(Component::Float, 2);
            let vector = |x: Node| Node::construct(&ty, vec![x, Node::float(0.0)]);
            let all = vec![vector(at(0)?), vector(at(1)?), at(2)?];
            Node::math(MathFunction::Refract, all).component(0)
        }
        // The IR's functions count in the type of their argument.
        ("bitCount" | "findLSB" | "findMSB", of) if of.kind() == Some(Component::Uint) => {
            let count = functions::named(name)?.meaning;
            Node::convert(result, Node::built_in(count, vec![at(0)?]))
        }
        // A choice of one evaluates the other not.
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
