//! Finds functions with side effects, which write globals, outputs or storage. The order of
//! evaluation around their calls matters.

use std::collections::{HashMap, HashSet};

use glsl_lang::ast::{self, Expr, ExprData, UnaryOpData};
use glsl_lang::visitor::{Host as _, Visit, Visitor};

use super::{Signature, Storage};

/// The names of functions with side effects, directly or through calls.
pub(crate) fn writers(
    functions: &[&ast::FunctionDefinition],
    signatures: &HashMap<String, Vec<Signature>>,
) -> HashSet<String> {
    let found: Vec<(String, Effects<'_>)> = functions
        .iter()
        .map(|f| {
            let mut found = Effects::of(signatures);
            for parameter in &f.prototype.parameters {
                if let ast::FunctionParameterDeclarationData::Named(_, d) = &parameter.content {
                    found.own.insert(d.ident.ident.as_str().to_owned());
                }
            }
            f.statement.visit(&mut found);
            (f.prototype.name.as_str().to_owned(), found)
        })
        .collect();
    let mut out: HashSet<String> = found
        .iter()
        .filter(|(_, f)| f.images || f.written.iter().any(|w| !f.own.contains(w)))
        .map(|(name, _)| name.clone())
        .collect();
    // GLSL has no recursion, so this ends after at most as many rounds as the call depth.
    loop {
        let calls = |f: &Effects<'_>| f.calls.iter().any(|c| out.contains(c));
        let more: Vec<String> = found
            .iter()
            .filter(|(name, f)| !out.contains(name) && calls(f))
            .map(|(name, _)| name.clone())
            .collect();
        if more.is_empty() {
            return out;
        }
        out.extend(more);
    }
}

/// The base variable of an assignment target.
pub(crate) fn root(e: &Expr) -> Option<&str> {
    match &e.content {
        ExprData::Variable(name) => Some(name.as_str()),
        ExprData::Dot(of, _) | ExprData::Bracket(of, _) => root(of),
        _ => None,
    }
}

/// The variables that an expression or body writes, and the functions it calls.
pub(crate) struct Effects<'s> {
    signatures: &'s HashMap<String, Vec<Signature>>,
    /// Variables written in whole or part.
    pub written: HashSet<String>,
    pub calls: HashSet<String>,
    /// Whether it writes images or atomic counters.
    pub images: bool,
    /// Variables that it declares.
    own: HashSet<String>,
    /// All variables that it refers to.
    pub named: HashSet<String>,
}

impl<'s> Effects<'s> {
    fn of(signatures: &'s HashMap<String, Vec<Signature>>) -> Self {
        Self {
            signatures,
            written: HashSet::new(),
            calls: HashSet::new(),
            images: false,
            own: HashSet::new(),
            named: HashSet::new(),
        }
    }

    pub(crate) fn within(e: &Expr, signatures: &'s HashMap<String, Vec<Signature>>) -> Self {
        let mut found = Self::of(signatures);
        e.visit(&mut found);
        found
    }

    fn write(&mut self, target: &Expr) {
        self.written.extend(root(target).map(str::to_owned));
    }
}

/// The number of trailing out arguments of a built-in function.
pub(crate) fn written_by_own(name: &str) -> usize {
    match name {
        "modf" | "frexp" | "uaddCarry" | "usubBorrow" => 1,
        "umulExtended" | "imulExtended" => 2,
        _ => 0,
    }
}

impl Visitor for Effects<'_> {
    fn visit_single_declaration(&mut self, declaration: &ast::SingleDeclaration) -> Visit {
        let name = declaration.name.as_ref();
        self.own.extend(name.map(|n| n.as_str().to_owned()));
        Visit::Children
    }

    fn visit_single_declaration_no_type(
        &mut self,
        declaration: &ast::SingleDeclarationNoType,
    ) -> Visit {
        self.own.insert(declaration.ident.ident.as_str().to_owned());
        Visit::Children
    }

    fn visit_expr(&mut self, e: &Expr) -> Visit {
        match &e.content {
            ExprData::Variable(name) => {
                self.named.insert(name.as_str().to_owned());
            }
            ExprData::Assignment(to, ..) | ExprData::PostInc(to) | ExprData::PostDec(to) => {
                self.write(to);
            }
            ExprData::Unary(op, to)
                if matches!(op.content, UnaryOpData::Inc | UnaryOpData::Dec) =>
            {
                self.write(to);
            }
            ExprData::FunCall(name, arguments) => {
                let name = name.as_ident().map_or("", |n| n.as_str());
                self.images |= name.starts_with("image") || name.starts_with("atomic");
                let signatures = self.signatures;
                match signatures.get(name) {
                    Some(all) => {
                        self.calls.insert(name.to_owned());
                        for (i, argument) in arguments.iter().enumerate() {
                            let is_out = |s: &Signature| {
                                s.parameters
                                    .get(i)
                                    .is_some_and(|(storage, _)| *storage != Storage::In)
                            };
                            if all.iter().any(is_out) {
                                self.write(argument);
                            }
                        }
                    }
                    None => {
                        let first = arguments.len().saturating_sub(written_by_own(name));
                        arguments[first..].iter().for_each(|a| self.write(a));
                    }
                }
            }
            _ => {}
        }
        Visit::Children
    }
}
