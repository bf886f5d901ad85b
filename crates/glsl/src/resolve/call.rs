//! Calls of constructors, user functions and built-in functions.

use glsl_lang::ast;
use glsl_lang::ast::{Expr, ExprData, FunIdentifierData};
use naga::Span;

use super::Resolver;
use super::effect::Argument;
use super::expression::Ex;
use super::overload::{OverloadChoice, choose};
use crate::errors::{unsupported, wrong};
use crate::functions;
use crate::stage::side_effects::written_by_own;
use crate::stage::{Signature, Storage, start};
use crate::textures;
use crate::tree::{FunctionId, Kind, Node};
use crate::ty::{Component, Length, Ty, spelled};
use shader_text::error::Error;

impl Resolver<'_, '_> {
    /// The value of `length()`: the specialisation constant itself, if the length is one.
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
            // A local variable hides the constant.
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

    pub(super) fn values(&mut self, arguments: &[Expr]) -> Result<Vec<Ex>, Error> {
        arguments.iter().map(|a| self.expr(a)).collect()
    }

    fn named(&mut self, name: &str, arguments: &[Expr], whole: &Expr) -> Result<Ex, Error> {
        let all = self.stage.signatures.get(name).cloned().unwrap_or_default();
        // A call sees the functions that the text declares before it.
        let at = start(whole.span);
        let seen = &all[..all.partition_point(|s| s.declared <= at)];
        if !seen.is_empty() && !self.is_own_after_all(name, seen, arguments)? {
            return self.authors(name, seen, arguments, whole);
        }
        if !all.is_empty() && !is_own(name) {
            let message = format!("`{name}` is called before it is declared");
            return Err(wrong(message, self.place(whole.span))
                .note("move the function up, or declare it before the call"));
        }
        if let Some(ex) = self.textured(name, arguments, whole)? {
            return Ok(ex);
        }
        self.own(name, arguments, whole)
    }

    /// Whether a call means a built-in overload although the author declares a function of this
    /// name. GLSL ES 1.00 allows both. GLSL 4.60 (6.1) hides the built-in function, but compilers
    /// accept it if no user function fits.
    fn is_own_after_all(
        &mut self,
        name: &str,
        signatures: &[Signature],
        arguments: &[Expr],
    ) -> Result<bool, Error> {
        if !is_own(name) {
            return Ok(false);
        }
        let mut values = Vec::new();
        for argument in arguments {
            values.push(self.look(argument)?.ty);
        }
        let given: Vec<&Ty> = values.iter().collect();
        Ok(choose(signatures, &given, self.is_implicit()) == OverloadChoice::None)
    }

    /// A call of a user-defined function.
    fn authors(
        &mut self,
        name: &str,
        signatures: &[Signature],
        arguments: &[Expr],
        whole: &Expr,
    ) -> Result<Ex, Error> {
        let (types, values) = self.arguments(arguments)?;
        let place = self.place(whole.span);
        let overload = self.overload(name, signatures, &types, place)?;
        let signature = &signatures[overload];
        self.calls.push((name.to_owned(), overload));
        let id = self.function_id(name, overload);
        if self.stage.writers.contains(name) {
            self.writing.insert(id);
        }
        self.passed(id, signature, arguments, values, place)
    }

    /// A call of the function with this signature. `values`: see [`Self::argument`].
    pub(super) fn passed(
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
        if outs.contains(&true) {
            self.writing.insert(id);
        }
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

    /// The name of a helper function or constant. Equal purposes share one.
    pub(super) fn helper_name(&mut self, wanted: &str) -> String {
        if let Some(name) = self.helper_names.get(wanted) {
            return name.clone();
        }
        let name = self.fresh(wanted);
        self.helper_names.insert(wanted.to_owned(), name.clone());
        name
    }

    /// A call of a texture function. `None` for other functions.
    fn textured(
        &mut self,
        name: &str,
        arguments: &[Expr],
        whole: &Expr,
    ) -> Result<Option<Ex>, Error> {
        let Some((function, is_vector)) = textures::named(name) else {
            return Ok(None);
        };
        let Some(first) = arguments.first() else {
            return Ok(None);
        };
        let sampler = self.raw(first)?;
        let rest = self.values(&arguments[1..])?;
        let ex = self.sample(name, function, sampler, rest, arguments, whole)?;
        Ok(Some(match is_vector {
            true => ex.converted(&Ty::Vector(Component::Float, 4)),
            false => ex,
        }))
    }
}

/// Whether GLSL has a function of this name.
fn is_own(name: &str) -> bool {
    functions::named(name).is_some() || textures::named(name).is_some() || written_by_own(name) > 0
}
