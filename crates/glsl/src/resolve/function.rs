//! Functions and their parameters, with combined samplers split, and the start and end of `main`.

use std::mem;

use glsl_lang::ast::{self, FunctionParameterDeclarationData as P};

use super::{Pair, Resolver, Var};
use crate::constant;
use crate::errors::unsupported;
use crate::interface::{flat, handles};
use crate::layout::{BlockEntry, Rules, stored};
use crate::stage::{Signature, Storage};
use crate::tree::{
    Function, FunctionId, HandleTy, Kind, Node, Parameter, ParameterTy, Statement,
    StatementKind as S,
};
use crate::ty::{Component, Ty};
use shader_text::error::Error;

/// Orders functions after those that they call.
fn order(
    at: usize,
    all: &[(FunctionId, Vec<FunctionId>)],
    done: &mut [bool],
    out: &mut Vec<FunctionId>,
) {
    if mem::replace(&mut done[at], true) {
        return;
    }
    let (id, calls) = &all[at];
    for callee in calls {
        if let Some(callee) = all.iter().position(|(id, _)| id == callee) {
            order(callee, all, done, out);
        }
    }
    out.push(*id);
}

impl<'u> Resolver<'_, 'u> {
    pub(super) fn functions(&mut self) -> Result<(), Error> {
        let functions = mem::take(&mut self.stage.functions);
        let mut all = Vec::new();
        for function in functions {
            let signature = self.stage.signature(&function.prototype)?;
            let name = function.prototype.name.as_str();
            let known = self.stage.signatures.get(name).map(Vec::as_slice);
            let alike = |s: &Signature| s.parameters == signature.parameters;
            let overload = known
                .and_then(|all| all.iter().position(alike))
                .unwrap_or(0);
            self.calls.clear();
            let resolved = self.function(function)?;
            let id = self.function_id(name, overload);
            if name == "main" && resolved.parameters.is_empty() {
                self.out.main = Some(id);
            }
            self.out.functions[id.0] = Some(resolved);
            let calls = mem::take(&mut self.calls).into_iter();
            let calls = calls.map(|(name, overload)| self.function_id(&name, overload));
            all.push((id, calls.collect()));
        }
        let mut done = vec![false; all.len()];
        for at in 0..all.len() {
            order(at, &all, &mut done, &mut self.out.order);
        }
        Ok(())
    }

    fn function(&mut self, function: &'u ast::FunctionDefinition) -> Result<Function, Error> {
        let prototype = &function.prototype;
        let author = prototype.name.as_str();
        let main = author == "main";
        let signature = self.stage.signature(prototype)?;
        let constants = self.stage.constants.clone();
        self.scopes.push(Default::default());
        let pairs = self.pairs.clone();
        let mut parameters = Vec::new();
        for parameter in &prototype.parameters {
            self.parameter(parameter, &mut parameters)?;
        }
        let name = author.to_owned();
        let place = self.place(prototype.span);
        if !self.stage.structs.has_data(&signature.result) {
            return Err(unsupported("a function cannot return samplers", place));
        }
        self.result = signature.result.clone();
        self.in_main = main;
        let statements = &function.statement.statement_list;
        self.temporaries = Some(Vec::new());
        // The body is in the scope of the parameters (GLSL 4.60, 4.2.2).
        let mut inner = self.statements_of(statements)?;
        let mut temporaries = self.temporaries.take().unwrap_or_default();
        if main {
            temporaries.append(&mut self.temporaries_of_globals);
        }
        let declared = temporaries.into_iter().map(|held| S::Declare(held, None));
        let mut body: Vec<Statement> = declared.map(Statement::new).collect();
        if main {
            body.extend(self.prologue.iter().cloned());
        }
        body.append(&mut inner);
        let returned = statements.last().is_some_and(|s| {
            matches!(&s.content, ast::StatementData::Jump(j) if matches!(j.content, ast::JumpStatementData::Return(_)))
        });
        if main && !returned {
            body.extend(self.epilogue.iter().cloned());
        }
        // The end may be reached without a result. GLSL leaves that value undefined.
        if !returned && self.result != Ty::Void {
            let zero = self.zero(&self.result);
            body.push(Statement::new(S::Return(Some(zero))));
        }
        self.scopes.pop();
        self.pairs = pairs;
        self.stage.constants = constants;
        Ok(Function {
            name,
            parameters,
            result: signature.result,
            body,
            is_plain: false,
            span: place.unwrap_or_default(),
        })
    }

    /// Zero, in the stored type.
    fn zero(&self, ty: &Ty) -> Node {
        let parts = match ty {
            Ty::Scalar(Component::Bool) => return Node::bool(false),
            Ty::Array(of, n) => vec![self.zero(of); n.map_or(1, |length| length.n as usize)],
            Ty::Struct(name) => {
                let Some(of) = self.stage.structs.get(name) else {
                    return Node::construct(ty, Vec::new());
                };
                let entries = self.stage.structs.entries(of);
                let part = |entry: &BlockEntry<'_>| match entry {
                    BlockEntry::Member(m) if of.in_uniform_block => {
                        self.zero(&stored(&m.ty, Rules::Std140))
                    }
                    BlockEntry::Member(m) => self.zero(&m.ty),
                    BlockEntry::Padding => Node::float(0.0),
                };
                entries.iter().map(part).collect()
            }
            _ => vec![Node::int(0)],
        };
        Node::construct(ty, parts)
    }

    fn parameter(
        &mut self,
        parameter: &'u ast::FunctionParameterDeclaration,
        out: &mut Vec<Parameter>,
    ) -> Result<(), Error> {
        let place = self.place(parameter.span);
        let (qualifier, ty, author) = match &parameter.content {
            P::Named(q, d) => {
                let ty = self.stage.ty(&d.ty, d.ident.array_spec.as_ref(), place)?;
                (q, ty, d.ident.ident.as_str().to_owned())
            }
            P::Unnamed(q, ty) => (q, self.stage.ty(ty, None, place)?, String::new()),
        };
        if ty == Ty::Void {
            return Ok(());
        }
        let author = match author.is_empty() {
            true => self.fresh("unnamed"),
            false => author,
        };
        let qualifiers = self.stage.qualifiers(qualifier.as_ref())?;
        let storage = qualifiers.storage;
        constant::declare(&mut self.stage.constants, &author, &ty, None, None);
        let name = author.clone();
        let mut add = |name: &str, ty, storage| {
            out.push(Parameter {
                name: name.to_owned(),
                ty,
                is_out: matches!(storage, Some(Storage::Out | Storage::InOut)),
                is_in: storage != Some(Storage::Out),
                span: place.unwrap_or_default(),
            });
            Node::new(Kind::Parameter(out.len() - 1)).at(place)
        };
        let structs = &self.stage.structs;
        let is_split = structs.has_samplers(&ty);
        let node = match (structs.has_data(&ty), &ty) {
            (true, Ty::Opaque(of)) => add(&name, ParameterTy::Handle(HandleTy::plain(of)), storage),
            (true, _) => add(&name, ParameterTy::Data(ty.clone()), storage),
            // The function only uses the parameter's samplers.
            (false, _) => Node::int(0),
        };
        let mut found = Vec::new();
        if is_split {
            // The path is unique, because the parameter may hide a uniform.
            structs.samplers(&ty, &format!("${author}"), &mut found);
        }
        for (path, combined) in found {
            let texture = flat(&path.replacen('$', "", 1));
            let texture = match texture == author {
                true => name.clone(),
                false => self.fresh(&texture),
            };
            let sampler = self.fresh(&format!("{texture}_sampler"));
            let [texture_ty, sampler_ty] = handles(&combined).map(ParameterTy::Handle);
            let pair = Pair {
                combined,
                texture: add(&texture, texture_ty, None),
                sampler: add(&sampler, sampler_ty, None),
            };
            self.pairs.insert(path, pair);
        }
        let fixed = qualifiers.is_const.then_some("a constant");
        let mut var = Var::plain(node, ty).fixed(fixed);
        var.ex.path = is_split.then(|| format!("${author}"));
        self.bind(&author, var);
        Ok(())
    }
}
