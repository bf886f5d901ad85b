//! Functions and their parameters, with combined samplers split, and the start and end of `main`.

use std::mem;

use glsl_lang::ast::{self, FunctionParameterDeclarationData as P};

use super::super::constant;
use super::super::interface::{SplitSampler, flat, split_type};
use super::super::stage::{Signature, Storage, unsupported};
use super::super::ty::{BlockEntry, Component, Rules, Ty, stored};
use super::{Lower, Var, builtin};
use preshade_text::error::Error;

/// A printed function and its callees.
struct Printed {
    key: (String, usize),
    calls: Vec<(String, usize)>,
    text: String,
}

fn print(at: usize, all: &[Printed], done: &mut [bool], out: &mut String) {
    if std::mem::replace(&mut done[at], true) {
        return;
    }
    for callee in &all[at].calls {
        if let Some(callee) = all.iter().position(|p| p.key == *callee) {
            print(callee, all, done, out);
        }
    }
    out.push('\n');
    out.push_str(&all[at].text);
}

impl<'u> Lower<'_, 'u> {
    pub(super) fn functions(&mut self) -> Result<String, Error> {
        let functions = mem::take(&mut self.stage.functions);
        for function in &functions {
            let name = function.prototype.name.as_str();
            if (builtin::is_known(name) || super::RESERVED.contains(&name))
                && !self.renamed.contains_key(name)
            {
                let new = self.fresh(&format!("{name}_"));
                self.renamed.insert(name.to_owned(), new);
            }
        }
        // naga needs callees first. Only types decide which overload a call means.
        let mut printed = Vec::new();
        for function in functions {
            let signature = self.stage.signature(&function.prototype)?;
            let name = function.prototype.name.as_str();
            let all = self.stage.signatures.get(name).map(Vec::as_slice);
            let alike = |s: &Signature| s.parameters == signature.parameters;
            let overload = all.and_then(|all| all.iter().position(alike)).unwrap_or(0);
            self.calls.clear();
            let text = self.function(function)?;
            printed.push(Printed {
                key: (name.to_owned(), overload),
                calls: std::mem::take(&mut self.calls),
                text,
            });
        }
        let mut done = vec![false; printed.len()];
        let mut out = String::new();
        for at in 0..printed.len() {
            print(at, &printed, &mut done, &mut out);
        }
        Ok(out)
    }

    fn function(&mut self, function: &'u ast::FunctionDefinition) -> Result<String, Error> {
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
        let name = self
            .renamed
            .get(author)
            .cloned()
            .unwrap_or_else(|| author.to_owned());
        let mark = self.mark(prototype.span);
        let result = match self.stage.structs.has_data(&signature.result) {
            true => signature.result.name(),
            false => {
                return Err(unsupported(
                    "a function cannot return samplers",
                    self.place(prototype.span),
                ));
            }
        };
        let mut out = format!("{mark}{result} {name}({}) {{\n", parameters.join(", "));
        self.result = signature.result;
        self.in_main = main;
        let statements = &function.statement.statement_list;
        self.temporaries = Some(Vec::new());
        let body = self.block_of(statements)?;
        let mut temporaries = self.temporaries.take().unwrap_or_default();
        if main {
            temporaries.append(&mut self.temporaries_of_globals);
        }
        for held in temporaries {
            out += &held;
        }
        if main {
            self.indent = 1;
            for first in self.prologue.clone() {
                out += &self.line(&first);
            }
            self.indent = 0;
        }
        out += &body;
        let returned = statements.last().is_some_and(|s| {
            matches!(&s.content, ast::StatementData::Jump(j) if matches!(j.content, ast::JumpStatementData::Return(_)))
        });
        if main && !returned {
            self.indent = 1;
            for last in self.epilogue.clone() {
                out += &self.line(&last);
            }
            self.indent = 0;
        }
        // GLSL leaves the value undefined at the end.
        if !returned && self.result != Ty::Void {
            let zero = self.zero(&self.result);
            out += &format!("    return {zero};\n");
        }
        self.scopes.pop();
        self.pairs = pairs;
        self.stage.constants = constants;
        Ok(out + "}\n")
    }

    /// A zero of the stored type.
    fn zero(&self, ty: &Ty) -> String {
        match ty {
            Ty::Scalar(Component::Bool) => "false".to_owned(),
            Ty::Array(of, n) => {
                let parts = vec![self.zero(of); n.map_or(1, |length| length.n as usize)];
                format!("{}({})", ty.name(), parts.join(", "))
            }
            Ty::Struct(name) => {
                let Some(of) = self.stage.structs.get(name) else {
                    return format!("{name}()");
                };
                let entries = match of.in_uniform_block {
                    true => self.stage.structs.laid_out(&of.members, true),
                    false => of.members.iter().map(BlockEntry::Member).collect(),
                };
                let parts: Vec<String> = entries
                    .iter()
                    .map(|e| match e {
                        BlockEntry::Member(m) if of.in_uniform_block => {
                            self.zero(&stored(&m.ty, Rules::Std140))
                        }
                        BlockEntry::Member(m) => self.zero(&m.ty),
                        BlockEntry::Padding => "0.0".to_owned(),
                    })
                    .collect();
                format!("{name}({})", parts.join(", "))
            }
            other => format!("{}(0)", other.name()),
        }
    }

    fn parameter(
        &mut self,
        parameter: &'u ast::FunctionParameterDeclaration,
        out: &mut Vec<String>,
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
        let word = match self.stage.qualifiers(qualifier.as_ref())?.storage {
            Some(Storage::Out) => "out ",
            Some(Storage::InOut) => "inout ",
            _ => "",
        };
        constant::declare(&mut self.stage.constants, &author, &ty, None, None);
        let name = self.safe(&author);
        let mut var = Var::plain(name.clone(), ty.clone());
        if self.stage.structs.has_data(&ty) {
            out.push(format!("{word}{}", ty.declare(&name)));
        }
        if self.stage.structs.has_samplers(&ty) {
            // The path is unique, because the parameter may hide a uniform.
            let path = format!("${author}");
            let mut found = Vec::new();
            self.stage.structs.samplers(&ty, &path, &mut found);
            for (path, combined) in found {
                let texture = flat(&path.replacen('$', "", 1));
                let texture = match texture == author {
                    true => name.clone(),
                    false => self.fresh(&texture),
                };
                let sampler = self.fresh(&format!("{texture}_sampler"));
                let [texture_type, sampler_type] = split_type(&combined);
                out.push(format!("{texture_type} {texture}"));
                out.push(format!("{sampler_type} {sampler}"));
                self.pairs.insert(
                    path,
                    SplitSampler {
                        combined,
                        texture,
                        sampler,
                    },
                );
            }
            var.path = Some(path);
        }
        self.bind(&author, var);
        Ok(())
    }
}
