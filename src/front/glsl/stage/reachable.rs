//! Finds the functions that `main` reaches and the names they use.

use std::collections::{HashMap, HashSet};

use glsl_lang::ast::{self, ExprData};
use glsl_lang::visitor::{Host as _, Visit, Visitor};

use super::GlslStage;
use super::side_effects;
use crate::front::error::{Code, Error};

impl<'u> GlslStage<'u> {
    /// Orders reachable functions with callees first, and records the names they use.
    pub(super) fn reach(
        &mut self,
        definitions: &[&'u ast::FunctionDefinition],
    ) -> Result<(), Error> {
        let names: Vec<HashSet<String>> = definitions.iter().map(|f| words(f)).collect();
        let mut by_name: HashMap<&str, Vec<usize>> = HashMap::new();
        for (i, f) in definitions.iter().enumerate() {
            by_name
                .entry(f.prototype.name.as_str())
                .or_default()
                .push(i);
        }
        let Some(main) = by_name.get("main").map(|all| all[0]) else {
            return Err(Error::new(
                Code::NoEntryPoint,
                "there is no function `main`",
            ));
        };
        let mut done = vec![false; definitions.len()];
        let mut order = Vec::new();
        visit(main, &names, &by_name, &mut done, &mut order);
        // A global's initialiser may call functions too.
        for global in &self.globals {
            let mut found = Words::default();
            if let Some(init) = global.init {
                init.visit(&mut found);
            }
            for i in found
                .0
                .iter()
                .flat_map(|w| by_name.get(w.as_str()).into_iter().flatten())
            {
                visit(*i, &names, &by_name, &mut done, &mut order);
            }
            self.used.extend(found.0);
        }
        order.retain(|i| *i != main);
        order.push(main);
        for i in &order {
            self.used.extend(names[*i].iter().cloned());
        }
        self.functions = order.into_iter().map(|i| definitions[i]).collect();
        self.writers = side_effects::writers(&self.functions, &self.signatures);
        Ok(())
    }
}

/// Depth first, callees first.
fn visit(
    at: usize,
    names: &[HashSet<String>],
    by_name: &HashMap<&str, Vec<usize>>,
    done: &mut [bool],
    order: &mut Vec<usize>,
) {
    if std::mem::replace(&mut done[at], true) {
        return;
    }
    // Sort: a set has no stable order.
    let mut callees: Vec<usize> = names[at]
        .iter()
        .flat_map(|w| by_name.get(w.as_str()).into_iter().flatten().copied())
        .collect();
    callees.sort_unstable();
    for callee in callees {
        visit(callee, names, by_name, done, order);
    }
    order.push(at);
}

/// A pseudo name in `GlslStage::used`: the fragment coordinate's y is read.
pub(in crate::front::glsl) const FRAG_COORD_Y: &str = "gl_FragCoord.y";

/// A use that lowering finds: no name in GLSL has a space.
pub(in crate::front::glsl) const DIVIDED_BY_ZERO: &str = "/ 0.0";

/// A pseudo name in `GlslStage::used`: a local variable is `precise`.
pub(in crate::front::glsl) const PRECISE: &str = "precise";

/// The variables and functions that a function names, [`FRAG_COORD_Y`] and [`PRECISE`].
fn words(function: &ast::FunctionDefinition) -> HashSet<String> {
    let mut found = Words::default();
    function.statement.visit(&mut found);
    found.0
}

#[derive(Default)]
struct Words(HashSet<String>);

impl Visitor for Words {
    fn visit_type_qualifier_spec(&mut self, spec: &ast::TypeQualifierSpec) -> Visit {
        if matches!(spec.content, ast::TypeQualifierSpecData::Precise) {
            self.0.insert(PRECISE.to_owned());
        }
        Visit::Children
    }

    fn visit_expr(&mut self, expr: &ast::Expr) -> Visit {
        let is_coord = |name: &ast::Identifier| name.as_str() == "gl_FragCoord";
        match &expr.content {
            // Only here is it known which components are read.
            ExprData::Dot(of, components) if matches!(&of.content, ExprData::Variable(name) if is_coord(name)) =>
            {
                self.0.insert("gl_FragCoord".to_owned());
                if components.as_str().contains(['y', 'g', 't']) {
                    self.0.insert(FRAG_COORD_Y.to_owned());
                }
                return Visit::Parent;
            }
            ExprData::Variable(name) => {
                if is_coord(name) {
                    self.0.insert(FRAG_COORD_Y.to_owned());
                }
                self.0.insert(name.as_str().to_owned());
            }
            ExprData::FunCall(name, _) => {
                if let Some(name) = name.as_ident() {
                    self.0.insert(name.as_str().to_owned());
                }
            }
            _ => {}
        }
        Visit::Children
    }
}
