//! Finds functions with side effects, which write globals, outputs or storage. The order of
//! evaluation around their calls matters.

use std::collections::{HashMap, HashSet};

use glsl_lang::ast::{Expr, ExprData, UnaryOpData};
use glsl_lang::visitor::{Host as _, Visit, Visitor};

use super::{Signature, Storage};

/// The names of functions with side effects. `functions`: the name of each, whether it writes by
/// itself, and the functions that it calls.
pub(super) fn writers<'s>(functions: &[(&'s str, bool, &'s HashSet<String>)]) -> HashSet<String> {
    let mut out: HashSet<String> = HashSet::new();
    // GLSL has no recursion, so this ends after at most as many rounds as the call depth.
    loop {
        let before = out.len();
        for (name, writes, calls) in functions {
            if *writes || calls.iter().any(|c| out.contains(c)) {
                out.insert((*name).to_owned());
            }
        }
        if out.len() == before {
            return out;
        }
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

/// The variables that an expression writes, and the functions it calls.
pub(crate) struct Effects<'s> {
    signatures: &'s HashMap<String, Vec<Signature>>,
    /// Variables written in whole or part.
    pub written: HashSet<String>,
    pub calls: HashSet<String>,
    /// Whether it writes images or atomic counters.
    pub images: bool,
    /// All variables that it refers to.
    pub named: HashSet<String>,
}

impl<'s> Effects<'s> {
    pub(crate) fn within(e: &Expr, signatures: &'s HashMap<String, Vec<Signature>>) -> Self {
        let mut found = Self {
            signatures,
            written: HashSet::new(),
            calls: HashSet::new(),
            images: false,
            named: HashSet::new(),
        };
        e.visit(&mut found);
        found
    }
}

/// The targets that an expression writes, without those of its operands.
pub(super) fn targets<'e>(
    e: &'e Expr,
    signatures: &HashMap<String, Vec<Signature>>,
) -> Vec<&'e Expr> {
    match &e.content {
        ExprData::Assignment(to, ..) | ExprData::PostInc(to) | ExprData::PostDec(to) => vec![to],
        ExprData::Unary(op, to) if matches!(op.content, UnaryOpData::Inc | UnaryOpData::Dec) => {
            vec![to]
        }
        ExprData::FunCall(name, arguments) => {
            let name = name.as_ident().map_or("", |n| n.as_str());
            let Some(all) = signatures.get(name) else {
                let first = arguments.len().saturating_sub(written_by_own(name));
                return arguments[first..].iter().collect();
            };
            let is_out = |i: usize| {
                let mut parameters = all.iter().filter_map(|s| s.parameters.get(i));
                parameters.any(|(storage, _)| *storage != Storage::In)
            };
            let arguments = arguments.iter().enumerate();
            arguments
                .filter(|(i, _)| is_out(*i))
                .map(|(_, a)| a)
                .collect()
        }
        _ => Vec::new(),
    }
}

/// Whether a function writes images or atomic counters.
pub(super) fn writes_images(name: &str) -> bool {
    name.starts_with("image") || name.starts_with("atomic")
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
    fn visit_expr(&mut self, e: &Expr) -> Visit {
        let targets = targets(e, self.signatures);
        self.written
            .extend(targets.into_iter().filter_map(root).map(str::to_owned));
        match &e.content {
            ExprData::Variable(name) => {
                self.named.insert(name.as_str().to_owned());
            }
            ExprData::FunCall(name, _) => {
                let name = name.as_ident().map_or("", |n| n.as_str());
                self.images |= writes_images(name);
                if self.signatures.contains_key(name) {
                    self.calls.insert(name.to_owned());
                }
            }
            _ => {}
        }
        Visit::Children
    }
}
