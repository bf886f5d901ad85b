//! Calls of constructors, user functions and built-in functions.

use std::iter;

use glsl_lang::ast::{self, Expr, ExprData, FunIdentifierData};
use naga::Span;

use super::super::interface::SplitSampler;
use super::super::placeholders::{self, Atomic, Placeholder, Subgroup};
use super::super::source_marks::unmarked;
use super::super::stage::{Signature, Storage, spelled, unsupported};
use super::super::ty::{BlockEntry, Component, Length, MemoryLayout, Ty};
use super::effect::{Argument, after};
use super::expression::{Ex, level};
use super::fold::Folds;
use super::overload::{OverloadChoice, choose};
use super::{BuiltinCall, Lower, builtin, texture};
use preshade_text::error::{Code, Error};
use preshade_text::unsupported;

impl Lower<'_, '_> {
    /// The value of `length()`: the specialisation constant, if it is one.
    fn known_length(&self, length: Length) -> Ex {
        let lengths = self.stage.lengths.borrow();
        let mut constants = lengths.iter().map(|(constant, _)| constant);
        let constant = constants.find(|constant| Some(constant.id) == length.constant);
        let Some(constant) = constant else {
            return Ex::primary(length.n.to_string(), Ty::INT);
        };
        let global = self.scopes.first().and_then(|s| s.get(&constant.own));
        match global.filter(|_| !self.is_local(&constant.own)) {
            Some(global) if constant.is_signed => Ex::primary(global.text.clone(), Ty::INT),
            Some(global) => Ex::primary(format!("int({})", global.text), Ty::INT),
            // A local variable hides it.
            None => {
                let fixed = (constant.id, constant.own.clone());
                self.stage.assumed.borrow_mut().insert(fixed);
                Ex::primary(length.n.to_string(), Ty::INT)
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
                        None => Ex::new(
                            format!("int({}.length())", of.at(level::POSTFIX)),
                            Ty::INT,
                            level::POSTFIX,
                        ),
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
        let folds = Folds::of_call(&ty.name(), &values);
        let ex = match (&ty, &values[..]) {
            (Ty::Combined(name), [texture, sampler]) => {
                let (texture, sampler) = (texture.text.clone(), sampler.text.clone());
                let mut ex = Ex::primary(format!("{name}({texture}, {sampler})"), ty.clone());
                ex.pair = Some(SplitSampler {
                    combined: name.clone(),
                    texture,
                    sampler,
                });
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
            (Ty::Void | Ty::Opaque(_) | Ty::Unknown, _) => constructed(&values, ty),
            (_, [value]) if value.ty == ty => value.clone(),
            // The first component of a vector or matrix.
            (Ty::Scalar(_), [value]) => {
                let text = match &value.ty {
                    Ty::Vector(..) => format!("{}.x", value.at(level::POSTFIX)),
                    Ty::Matrix(..) => format!("{}[0].x", value.at(level::POSTFIX)),
                    _ => value.text.clone(),
                };
                Ex::primary(format!("{}({text})", ty.name()), ty)
            }
            // A longer vector is truncated.
            (Ty::Vector(kind, n), [value]) if value.ty.components().is_some_and(|m| m > *n) => {
                let swizzle = &"xyzw"[..usize::from(*n)];
                let cut = format!("{}.{swizzle}", value.at(level::POSTFIX));
                match value.ty.kind() == Some(*kind) {
                    true => Ex::new(cut, ty, level::POSTFIX),
                    false => Ex::primary(format!("{}({cut})", ty.name()), ty),
                }
            }
            (Ty::Vector(kind, n), _) => self.components(&ty, *kind, usize::from(*n), values),
            (Ty::Matrix(kind, columns, rows), _) => {
                let all = usize::from(*columns) * usize::from(*rows);
                match &values[..] {
                    [value] if matches!(value.ty, Ty::Matrix(..)) => resized(value, &ty),
                    [value] if matches!(value.ty, Ty::Vector(..)) => {
                        let (first, value) = self.once(value);
                        let text = value.at(level::POSTFIX);
                        let parts = "xyzw".chars().take(all).map(|c| format!("{text}.{c}"));
                        after(first, called(&ty.name(), parts, ty))
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
        let (in_uniform_block, members) =
            of.map_or_else(Default::default, |s| (s.in_uniform_block, s.members));
        let entries = match in_uniform_block {
            true => self.stage.structs.laid_out(&members, true),
            false => members.iter().map(BlockEntry::Member).collect(),
        };
        let (mut first, mut parts) = (Vec::new(), Vec::new());
        let mut values = values.into_iter();
        for entry in entries {
            let BlockEntry::Member(member) = entry else {
                parts.push("0.0".to_owned());
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
        Ok(after(
            first,
            called(name, parts, Ty::Struct(name.to_owned())),
        ))
    }

    /// A vector or matrix constructor from components: converts each and drops extra ones.
    fn components(&self, ty: &Ty, kind: Component, wanted: usize, mut values: Vec<Ex>) -> Ex {
        let alone = values.len() == 1;
        // A single scalar for all components is converted first.
        if let [value] = &mut values[..]
            && matches!(value.ty, Ty::Scalar(from) if from != kind)
        {
            let to = Ty::Scalar(kind);
            *value = Ex::primary(format!("{}({})", to.name(), value.text), to);
        }
        let mut have = 0;
        let parts: Vec<String> = values
            .into_iter()
            .map(|mut value| {
                let n = usize::from(value.ty.components().unwrap_or(1));
                // The last argument may have extra components.
                if let Ty::Vector(k, _) = value.ty
                    && have + n > wanted
                    && have < wanted
                {
                    let rest = wanted - have;
                    let text = format!("{}.{}", value.at(level::POSTFIX), &"xyzw"[..rest]);
                    value = Ex::new(text, Ty::vector(k, rest as u8), level::POSTFIX);
                }
                have += n;
                match (value.ty.kind(), kind) {
                    (Some(from), _) if from == kind || alone => value.at(level::ASSIGNMENT),
                    (None, _) => value.at(level::ASSIGNMENT),
                    // Keep a literal a literal.
                    (Some(Component::Int), Component::Float) => {
                        self.coerce_kind(value, Some(kind)).text
                    }
                    _ => format!("{}({})", value.ty.with_kind(kind).name(), value.text),
                }
            })
            .collect();
        called(&ty.name(), parts, ty.clone())
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
        let own = builtin::is_known(name) || texture::function(name).is_some();
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
        let mut values = Vec::new();
        for argument in arguments {
            values.push(self.argument(argument)?);
        }
        let place = self.place(whole.span);
        let overload = self.overload(name, signatures, &values, place)?;
        let signature = &signatures[overload];
        self.calls.push((name.to_owned(), overload));
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
            let value = match values[i].text.is_empty() {
                true => self.raw(&arguments[i])?,
                false => values[i].clone(),
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
                    false => Argument::of(value.at(level::ASSIGNMENT)),
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
        let emitted = self
            .renamed
            .get(name)
            .map_or(name, String::as_str)
            .to_owned();
        let call = |parts: &[String]| format!("{emitted}({})", parts.join(", "));
        self.called(call, signature.result.clone(), parts, place)
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
            if let Some(of) = placeholders::subgroup(name, lane) {
                return self.subgroup(name, of, arguments, place);
            }
        }
        if let Some(of) = placeholders::atomic(name) {
            return self.atomic(name, of, arguments, place);
        }
        let mut values = self.values(arguments)?;
        let types: Vec<Ty> = values.iter().map(|v| v.ty.clone()).collect();
        if let Some(place) = place {
            let (name, types) = (name.to_owned(), types.clone());
            self.given.push(BuiltinCall { name, types, place });
        }
        // naga's front end has no functions of 16-bit floats.
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
            Some(Component::Float) if half => {
                let ty = ex.ty.with_kind(Component::Half);
                Ex::primary(format!("{}({})", ty.name(), ex.text), ty)
            }
            _ => ex,
        };
        let result = builtin::result(name, &types);
        // Implicit conversions.
        let kind = match name {
            _ if builtin::is_of_floats(name) => None,
            "min" | "max" | "clamp" | "mix" => {
                Some(types.iter().filter_map(Ty::kind).max_by_key(|k| k.power()))
            }
            _ => Some(None),
        };
        values = values
            .into_iter()
            .map(|v| match (kind, v.ty.kind()) {
                (Some(kind), _) => self.coerce_kind(v, kind),
                (None, Some(Component::Int | Component::Uint)) => {
                    self.coerce_kind(v, Some(Component::Float))
                }
                _ => v,
            })
            .collect();
        let (mut first, folds) = self.arguments_to_fold(name, &mut values);
        // Evaluate values that are printed several times only once.
        let is_repeated = match name {
            "mix" => result.kind() == Some(Component::Bool),
            "matrixCompMult" | "outerProduct" | "isnan" | "isinf" => true,
            "reflect" | "faceforward" => matches!(types.first(), Some(Ty::Scalar(_))),
            _ => false,
        };
        if is_repeated {
            for value in &mut values {
                // naga would fold the products of a constant.
                let (before, held) = match value.folds {
                    Folds::No => self.once(value),
                    _ => self.hidden(value.clone()),
                };
                first.extend(before);
                *value = held;
            }
        }
        if let Some(text) = replacement(name, &values, types.first(), &result) {
            let ex = Ex::primary(text, result).folding(folds);
            return Ok(narrowed(after(first, ex)));
        }
        check_supported(name, place)?;
        let all = values.iter().map(|v| v.at(level::ASSIGNMENT));
        let ex = called(name, all, result).folding(folds);
        Ok(narrowed(after(first, ex)))
    }

    /// A subgroup function: calls a placeholder for each type of value.
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
        let ty = value.ty.name();
        let (result, body) = match of {
            Subgroup::Ballot => (Ty::Vector(Component::Uint, 4), "uvec4(0u)"),
            _ => (value.ty.clone(), "value"),
        };
        let (lane, second) = match of {
            Subgroup::Broadcast(n) | Subgroup::QuadBroadcast(n) => (format!("_{n}"), None),
            _ => (String::new(), values.get(1)),
        };
        let helper = self.helper_name(&format!("{name}_{ty}{lane}"));
        let parameter = second.map_or("", |_| ", uint lane");
        let text = format!(
            "{} {helper}({ty} value{parameter}) {{\n    return {body};\n}}\n",
            result.name()
        );
        self.helpers.insert(helper.clone(), text);
        self.placeholders
            .insert(helper.clone(), Placeholder::Subgroup(of));
        let second = second.map(|v| format!("uint({})", v.text));
        let all = iter::once(value.at(level::ASSIGNMENT)).chain(second);
        Ok(called(&helper, all, result))
    }

    /// An atomic function: calls a placeholder for each type of value.
    fn atomic(
        &mut self,
        name: &str,
        of: Atomic,
        arguments: &[Expr],
        place: Option<Span>,
    ) -> Result<Ex, Error> {
        // The others order memory, which WebGPU does not.
        let [target, value, ..] = arguments else {
            let message = format!("`{name}` takes a member and a value");
            return Err(Error::new(Code::Parse, message).label_if(place));
        };
        let target = self.raw(target)?;
        let Ty::Scalar(Component::Int | Component::Uint) = target.ty else {
            let message = format!("`{name}` of {} is not supported", target.ty.name());
            return Err(unsupported(message, place)
                .note("WebGPU's atomic functions take members of type `int` and `uint`"));
        };
        let value = self.expr(value)?;
        let value = self.coerce(value, &target.ty);
        let ty = target.ty.name();
        let helper = self.helper_name(&format!("{name}_{ty}"));
        let text = format!("{ty} {helper}({ty} at, {ty} value) {{\n    return at;\n}}\n");
        self.helpers.insert(helper.clone(), text);
        self.placeholders
            .insert(helper.clone(), Placeholder::Atomic(of));
        let all = [&target, &value].map(|v| v.at(level::ASSIGNMENT));
        Ok(called(&helper, all, target.ty))
    }

    /// An atomic function of an image whose result is not used: stores what a placeholder returns.
    pub(super) fn image_atomic(
        &mut self,
        (name, of): (&str, Atomic),
        (image, at, value): (&Expr, &[Expr], &Expr),
        place: Option<Span>,
    ) -> Result<String, Error> {
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
        let (ty, texel) = (
            Ty::Scalar(component).name(),
            Ty::Vector(component, 4).name(),
        );
        let helper = self.helper_name(&format!("{name}_{ty}"));
        let text = format!("{texel} {helper}({ty} value) {{\n    return {texel}(value);\n}}\n");
        self.helpers.insert(helper.clone(), text);
        self.placeholders
            .insert(helper.clone(), Placeholder::ImageAtomic(of));
        let [image, at, value] = [image, at, value].map(|v| v.at(level::ASSIGNMENT));
        Ok(format!("imageStore({image}, {at}, {helper}({value}))"))
    }

    /// Built-in functions with out parameters, written as expressions.
    fn with_out(
        &mut self,
        name: &str,
        arguments: &[Expr],
        place: Option<naga::Span>,
    ) -> Result<Ex, Error> {
        let mut values = Vec::new();
        for argument in arguments {
            values.push(self.argument(argument)?);
        }
        let Some(ty) = values.first().map(|v| v.ty.clone()) else {
            return Err(unsupported(format!("`{name}` takes arguments"), place));
        };
        let t = ty.name();
        let helper = self.helper_name(&format!("{name}_{t}"));
        // A sum that wraps is less than its operand; a difference borrows if it subtracts from
        // less.
        let less = |a: &str, b: &str| match ty.components() {
            Some(1) => format!("{a} < {b} ? 1u : 0u"),
            _ => format!("{t}(lessThan({a}, {b}))"),
        };
        let (result, text) = match (name, &ty) {
            ("modf", of) if of.kind() != Some(Component::Half) => (
                ty.clone(),
                format!(
                    "{t} {helper}({t} x, out {t} whole) {{\n    whole = trunc(x);\n    return x - \
                     whole;\n}}\n"
                ),
            ),
            ("uaddCarry", _) => (
                ty.clone(),
                format!(
                    "{t} {helper}({t} x, {t} y, out {t} carry) {{\n    {t} sum = x + y;\n    \
                     carry = {};\n    return sum;\n}}\n",
                    less("sum", "x")
                ),
            ),
            ("usubBorrow", _) => (
                ty.clone(),
                format!(
                    "{t} {helper}({t} x, {t} y, out {t} borrow) {{\n    borrow = {};\n    return x \
                     - y;\n}}\n",
                    less("x", "y")
                ),
            ),
            ("umulExtended", Ty::Scalar(_)) => (Ty::Void, multiplied(&helper)),
            _ => {
                return Err(
                    unsupported(format!("`{name}` of {t} is not supported"), place)
                        .note("naga has no such function: write it yourself"),
                );
            }
        };
        self.helpers.insert(helper.clone(), text);
        // The last argument is written; for products, the last two.
        let outs = 1 + usize::from(name == "umulExtended");
        let first = arguments.len().saturating_sub(outs);
        let is_out: Vec<bool> = (0..arguments.len()).map(|i| i >= first).collect();
        let call_effects = self.call_effects(arguments, is_out);
        let mut direct = Vec::new();
        for (i, value) in values.iter().enumerate() {
            direct.push(i < first || self.is_direct(&call_effects, i, &value.ty)?);
        }
        let in_order = direct.contains(&false) && call_effects.has_effects();
        let mut parts = Vec::new();
        for (i, value) in values.into_iter().enumerate() {
            let value = match direct[i] && value.text.is_empty() {
                true => self.raw(&arguments[i])?,
                false => value,
            };
            parts.push(match direct[i] {
                false => self.copied(&call_effects, i, &value.ty, Storage::Out)?,
                true if i < first && in_order => {
                    let value = self.value(value);
                    self.in_order(&arguments[i], value)?
                }
                true => Argument::of(self.value(value).at(level::ASSIGNMENT)),
            });
        }
        let call = |parts: &[String]| format!("{helper}({})", parts.join(", "));
        self.called(call, result, parts, place)
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

/// The 64-bit product of two integers, from 16-bit halves.
fn multiplied(name: &str) -> String {
    [
        &format!("void {name}(uint x, uint y, out uint high, out uint low) {{"),
        "    uint a = (x & 0xFFFFu) * (y & 0xFFFFu);",
        "    uint b = (x >> 16u) * (y & 0xFFFFu);",
        "    uint c = (x & 0xFFFFu) * (y >> 16u);",
        "    uint middle = (a >> 16u) + (b & 0xFFFFu) + (c & 0xFFFFu);",
        "    low = x * y;",
        "    high = (x >> 16u) * (y >> 16u) + (b >> 16u) + (c >> 16u) + (middle >> 16u);",
        "}\n",
    ]
    .join("\n")
}

/// Converts a matrix to another size, filled up with the identity.
fn resized(value: &Ex, to: &Ty) -> Ex {
    let (Ty::Matrix(_, columns, rows), Ty::Matrix(_, have_columns, have_rows)) = (to, &value.ty)
    else {
        return value.clone();
    };
    let text = value.at(level::POSTFIX);
    // naga converts to smaller sizes itself.
    let simple = unmarked(&text)
        .chars()
        .all(|c| c.is_alphanumeric() || matches!(c, '_' | '.' | '[' | ']'));
    if have_columns >= columns && have_rows >= rows || !simple {
        return Ex::primary(format!("{}({})", to.name(), value.text), to.clone());
    }
    let mut parts = Vec::new();
    for c in 0..*columns {
        for r in 0..*rows {
            parts.push(match c < *have_columns && r < *have_rows {
                true => format!("{text}[{c}][{r}]"),
                false => if c == r { "1.0" } else { "0.0" }.to_owned(),
            });
        }
    }
    Ex::primary(format!("{}({})", to.name(), parts.join(", ")), to.clone())
}

/// A call of `function`.
fn called(function: &str, arguments: impl IntoIterator<Item = String>, ty: Ty) -> Ex {
    let arguments: Vec<String> = arguments.into_iter().collect();
    Ex::primary(format!("{function}({})", arguments.join(", ")), ty)
}

fn constructed(values: &[Ex], ty: Ty) -> Ex {
    let parts = values.iter().map(|v| v.at(level::ASSIGNMENT));
    called(&ty.name(), parts, ty)
}

/// An expression for built-in functions that naga lacks or restricts.
fn replacement(name: &str, values: &[Ex], first: Option<&Ty>, result: &Ty) -> Option<String> {
    let at = |i: usize, level: u8| values.get(i).map(|v| v.at(level)).unwrap_or_default();
    let text = || at(0, level::ASSIGNMENT);
    let post = |i: usize| at(i, level::POSTFIX);
    Some(match (name, first?) {
        ("matrixCompMult", ty @ Ty::Matrix(_, columns, _)) => {
            let columns: Vec<String> = (0..*columns)
                .map(|c| format!("{}[{c}] * {}[{c}]", post(0), post(1)))
                .collect();
            format!("{}({})", ty.name(), columns.join(", "))
        }
        ("outerProduct", Ty::Vector(..)) => {
            let Ty::Matrix(_, columns, _) = result else {
                return None;
            };
            let column = |c: char| format!("{} * {}.{c}", at(0, 14), post(1));
            let columns = "xyzw".chars().take(usize::from(*columns));
            let columns: Vec<String> = columns.map(column).collect();
            format!("{}({})", result.name(), columns.join(", "))
        }
        // naga only accepts vectors here.
        ("dot", Ty::Scalar(_)) => format!("({} * {})", at(0, 14), at(1, 15)),
        ("length", Ty::Scalar(_)) => format!("abs({})", text()),
        ("distance", Ty::Scalar(_)) => format!("abs({} - {})", at(0, 13), at(1, 14)),
        ("normalize", Ty::Scalar(_)) => format!("sign({})", text()),
        ("reflect", Ty::Scalar(_)) => {
            let [i, n] = [at(0, 14), at(1, 14)];
            format!("({i} - 2.0 * {n} * {n} * {i})")
        }
        ("faceforward", Ty::Scalar(_)) => {
            let [n, i, reference] = [at(0, level::UNARY), at(1, 14), at(2, 15)];
            format!("({i} * {reference} < 0.0 ? {n} : -{n})")
        }
        // Both as vectors of one component that matters.
        ("refract", Ty::Scalar(_)) => {
            let [i, n, eta] = [0, 1, 2].map(|i| at(i, level::ASSIGNMENT));
            format!("refract(vec2({i}, 0.0), vec2({n}, 0.0), {eta}).x")
        }
        // naga's functions count in the type of their argument.
        ("bitCount" | "findLSB" | "findMSB", of) if of.kind() == Some(Component::Uint) => {
            format!("{}({name}({}))", result.name(), text())
        }
        // naga has no such `mix`.
        ("mix", Ty::Scalar(Component::Bool)) => {
            format!("({} ? {} : {})", at(2, 4), at(1, 4), at(0, 4))
        }
        ("mix", Ty::Vector(Component::Bool, n)) => {
            let part = |c: char| format!("{}.{c} ? {}.{c} : {}.{c}", post(2), post(1), post(0));
            let parts: Vec<String> = "xyzw".chars().take(usize::from(*n)).map(part).collect();
            format!("{}({})", result.name(), parts.join(", "))
        }
        // WGSL lacks both. Test the bits, which no compiler treats as a constant.
        ("isnan" | "isinf", of) => {
            let bits = format!("floatBitsToUint({})", text());
            let (function, operator) = match name {
                "isnan" => ("greaterThan", ">"),
                _ => ("equal", "=="),
            };
            match of {
                Ty::Vector(_, n) => {
                    format!("{function}({bits} & uvec{n}(0x7FFFFFFFu), uvec{n}(0x7F800000u))")
                }
                _ => format!("(({bits} & 0x7FFFFFFFu) {operator} 0x7F800000u)"),
            }
        }
        _ => return None,
    })
}

/// Rejects built-in functions that WebGPU or naga lacks.
fn check_supported(name: &str, place: Option<Span>) -> Result<(), Error> {
    unsupported::refuse(name, place)?;
    match builtin::is_known(name) || name.starts_with("image") {
        true => Ok(()),
        false => Err(unsupported(format!("there is no function `{name}`"), place)),
    }
}
