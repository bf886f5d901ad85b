//! Types Vulkan's samplers by their use.
//!
//! Vulkan's GLSL lets `sampler2DShadow(t, s)` take a plain `sampler`. A sampler of WebGPU compares
//! or it does not, so this makes those a `samplerShadow`, through the parameters of functions too.

use std::collections::{BTreeMap, BTreeSet};

use glsl_lang::ast::{
    self, DeclarationData, Expr, ExprData, ExternalDeclarationData,
    FunctionParameterDeclarationData, TranslationUnit, TypeSpecifierNonArrayData,
};
use glsl_lang::visitor::{Host as _, Visit, Visitor};

use super::stage::side_effects::root;
use super::stage::spelled;

/// A sampler: a global, or a parameter of the functions of a name. Overloads are taken together.
type Named = (Option<String>, String);

/// A function's name and its parameters' names.
struct Function<'a> {
    name: &'a str,
    parameters: Vec<&'a str>,
}

/// The uses of samplers in one function.
struct Uses<'a> {
    of: Function<'a>,
    /// Those that compare.
    comparing: BTreeSet<Named>,
    /// Calls: the function, and what it is given.
    calls: Vec<(String, Vec<Option<Named>>)>,
}

impl Uses<'_> {
    fn named(&self, e: &Expr) -> Option<Named> {
        let name = root(e)?;
        let is_own = self.of.parameters.contains(&name);
        Some((is_own.then(|| self.of.name.to_owned()), name.to_owned()))
    }
}

impl Visitor for Uses<'_> {
    fn visit_expr(&mut self, e: &Expr) -> Visit {
        let ExprData::FunCall(callee, arguments) = &e.content else {
            return Visit::Children;
        };
        match &callee.content {
            ast::FunIdentifierData::TypeSpecifier(ty) => {
                let name = spelled(&ty.ty);
                if let ([_, sampler], true) = (&arguments[..], name.ends_with("Shadow")) {
                    let named = self.named(sampler);
                    self.comparing.extend(named);
                }
            }
            ast::FunIdentifierData::Expr(callee) => {
                if let ExprData::Variable(name) = &callee.content {
                    let given = arguments.iter().map(|a| self.named(a)).collect();
                    self.calls.push((name.as_str().to_owned(), given));
                }
            }
        }
        Visit::Children
    }
}

fn parameters(prototype: &ast::FunctionPrototype) -> Vec<&str> {
    let all = prototype.parameters.iter();
    all.map(|p| match &p.content {
        FunctionParameterDeclarationData::Named(_, d) => d.ident.ident.as_str(),
        FunctionParameterDeclarationData::Unnamed(..) => "",
    })
    .collect()
}

/// Makes each `sampler` that compares a `samplerShadow`.
pub(super) fn settle(tree: &mut TranslationUnit) {
    let comparing = comparing(tree);
    if comparing.is_empty() {
        return;
    }
    let compares = |function: Option<&str>, name: &str| {
        comparing.contains(&(function.map(str::to_owned), name.to_owned()))
    };
    let in_prototype = |prototype: &mut ast::FunctionPrototype| {
        let function = prototype.name.as_str().to_owned();
        for parameter in &mut prototype.parameters {
            if let FunctionParameterDeclarationData::Named(_, d) = &mut parameter.content
                && compares(Some(&function), d.ident.ident.as_str())
            {
                settle_type(&mut d.ty);
            }
        }
    };
    for item in &mut tree.0 {
        match &mut item.content {
            ExternalDeclarationData::FunctionDefinition(f) => in_prototype(&mut f.prototype),
            ExternalDeclarationData::Declaration(d) => match &mut d.content {
                DeclarationData::FunctionPrototype(p) => in_prototype(p),
                DeclarationData::InitDeclaratorList(list) => {
                    let head = &mut list.content.head;
                    let name = head.content.name.as_ref().map(|n| n.as_str().to_owned());
                    if name.is_some_and(|n| compares(None, &n)) {
                        settle_type(&mut head.content.ty.content.ty);
                    }
                }
                _ => {}
            },
            ExternalDeclarationData::Preprocessor(_) => {}
        }
    }
}

fn settle_type(ty: &mut ast::TypeSpecifier) {
    if ty.ty.content == TypeSpecifierNonArrayData::Sampler {
        ty.content.ty.content = TypeSpecifierNonArrayData::SamplerShadow;
    }
}

fn comparing(tree: &TranslationUnit) -> BTreeSet<Named> {
    let mut all = Vec::new();
    let mut given: BTreeMap<&str, Vec<Vec<&str>>> = BTreeMap::new();
    for item in &tree.0 {
        if let ExternalDeclarationData::FunctionDefinition(f) = &item.content {
            let (name, parameters) = (f.prototype.name.as_str(), parameters(&f.prototype));
            given.entry(name).or_default().push(parameters.clone());
            let mut uses = Uses {
                of: Function { name, parameters },
                comparing: BTreeSet::new(),
                calls: Vec::new(),
            };
            f.statement.visit(&mut uses);
            all.push(uses);
        }
    }
    let mut out: BTreeSet<Named> = BTreeSet::new();
    out.extend(all.iter().flat_map(|u| u.comparing.iter().cloned()));
    // GLSL has no recursion, so this ends after at most as many rounds as the call depth.
    loop {
        let before = out.len();
        for (callee, arguments) in all.iter().flat_map(|u| &u.calls) {
            for parameters in given.get(callee.as_str()).into_iter().flatten() {
                for (parameter, argument) in parameters.iter().zip(arguments) {
                    let to = (Some(callee.clone()), (*parameter).to_owned());
                    if let (Some(argument), true) = (argument, out.contains(&to)) {
                        out.insert(argument.clone());
                    }
                }
            }
        }
        if out.len() == before {
            return out;
        }
    }
}
