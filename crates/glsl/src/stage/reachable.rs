//! Finds the functions that `main` reaches and the names they use.

use std::collections::{HashMap, HashSet};

use glsl_lang::ast::{
    self, ConditionData, DeclarationData, ExprData, ForInitStatementData, IterationStatementData,
    SelectionRestStatementData, Statement, StatementData,
};
use glsl_lang::visitor::{Host as _, Visit, Visitor};

use super::{GlslStage, Signature, side_effects};
use shader_text::error::{self, Code, Error};

impl<'u> GlslStage<'u> {
    /// Orders reachable functions with callees first, and records the names they use.
    pub(super) fn reach(
        &mut self,
        definitions: &[&'u ast::FunctionDefinition],
    ) -> Result<(), Error> {
        let words = |f: &&ast::FunctionDefinition| Words::of(f, &self.signatures);
        let names: Vec<Words<'_>> = definitions.iter().map(words).collect();
        let mut by_name: HashMap<&str, Vec<usize>> = HashMap::new();
        for (i, f) in definitions.iter().enumerate() {
            by_name
                .entry(f.prototype.name.as_str())
                .or_default()
                .push(i);
        }
        let Some(main) = by_name.get("main").map(|all| all[0]) else {
            return Err(Error::new(Code::NoEntryPoint, error::NO_MAIN));
        };
        let mut done = vec![false; definitions.len()];
        let mut order = Vec::new();
        visit(main, &names, &by_name, &mut done, &mut order);
        let mut used = HashSet::new();
        order.iter().for_each(|i| names[*i].add_to(&mut used));
        // The initialiser of a used global may name other globals and call functions.
        let mut globals: Vec<_> = self.globals.iter().collect();
        loop {
            let is_used = |g: &super::Global<'_>| {
                used.contains(g.name.as_str()) || g.qualifiers.says("constant_id")
            };
            let (found, rest): (Vec<_>, Vec<_>) = globals.into_iter().partition(|g| is_used(g));
            globals = rest;
            if found.is_empty() {
                break;
            }
            for init in found.iter().filter_map(|g| g.init) {
                let mut words = Words::new(&self.signatures);
                init.visit(&mut words);
                words.add_to(&mut used);
                let before = order.len();
                for i in words.callees(&by_name) {
                    visit(i, &names, &by_name, &mut done, &mut order);
                }
                order[before..]
                    .iter()
                    .for_each(|i| names[*i].add_to(&mut used));
            }
        }
        order.retain(|i| *i != main);
        order.push(main);
        let effects = order.iter().map(|i| {
            let name = definitions[*i].prototype.name.as_str();
            (name, names[*i].writes, &names[*i].functions)
        });
        self.writers = side_effects::writers(&effects.collect::<Vec<_>>());
        self.used = used;
        self.functions = order.into_iter().map(|i| definitions[i]).collect();
        Ok(())
    }
}

/// Visits depth first, so that callees come first.
fn visit(
    at: usize,
    names: &[Words<'_>],
    by_name: &HashMap<&str, Vec<usize>>,
    done: &mut [bool],
    order: &mut Vec<usize>,
) {
    if std::mem::replace(&mut done[at], true) {
        return;
    }
    for callee in names[at].callees(by_name) {
        visit(callee, names, by_name, done, order);
    }
    order.push(at);
}

/// A pseudo name in `GlslStage::used`: the fragment coordinate's y is read.
pub(crate) const FRAG_COORD_Y: &str = "gl_FragCoord.y";

/// A pseudo name in `GlslStage::used`: a local variable is `precise`.
pub(crate) const PRECISE: &str = "precise";

/// The global variables and functions that a function refers to.
struct Words<'s> {
    signatures: &'s HashMap<String, Vec<Signature>>,
    /// Includes [`FRAG_COORD_Y`] and [`PRECISE`].
    variables: HashSet<String>,
    functions: HashSet<String>,
    /// Whether it writes a global variable, an image or an atomic counter.
    writes: bool,
    /// The parameters and local variables in scope, innermost last. They hide globals.
    scopes: Vec<HashSet<String>>,
}

impl<'s> Words<'s> {
    fn new(signatures: &'s HashMap<String, Vec<Signature>>) -> Self {
        Self {
            signatures,
            variables: HashSet::new(),
            functions: HashSet::new(),
            writes: false,
            scopes: Vec::new(),
        }
    }

    fn of(
        function: &ast::FunctionDefinition,
        signatures: &'s HashMap<String, Vec<Signature>>,
    ) -> Self {
        let mut words = Self::new(signatures);
        words.scopes.push(HashSet::new());
        for parameter in &function.prototype.parameters {
            if let ast::FunctionParameterDeclarationData::Named(_, d) = &parameter.content {
                words.declare(&d.ident.ident);
            }
        }
        words.block(&function.statement.statement_list);
        words
    }

    fn add_to(&self, used: &mut HashSet<String>) {
        used.extend(self.variables.iter().chain(&self.functions).cloned());
    }

    /// The functions it calls, in a stable order.
    fn callees(&self, by_name: &HashMap<&str, Vec<usize>>) -> Vec<usize> {
        let named = |w: &String| by_name.get(w.as_str());
        let called = self.functions.iter().filter_map(named).flatten();
        let mut callees: Vec<usize> = called.copied().collect();
        callees.sort_unstable();
        callees
    }

    fn declare(&mut self, name: &ast::Identifier) {
        if let Some(scope) = self.scopes.last_mut() {
            scope.insert(name.as_str().to_owned());
        }
    }

    fn is_local(&self, name: &str) -> bool {
        self.scopes.iter().any(|s| s.contains(name))
    }

    fn name(&mut self, name: &str) {
        if !self.is_local(name) {
            self.variables.insert(name.to_owned());
        }
    }

    fn block(&mut self, statements: &[Statement]) {
        self.scopes.push(HashSet::new());
        statements.iter().for_each(|s| self.statement(s));
        self.scopes.pop();
    }

    fn statement(&mut self, statement: &Statement) {
        match &statement.content {
            StatementData::Declaration(d) => self.declaration(d),
            StatementData::Compound(c) => self.block(&c.statement_list),
            StatementData::Selection(s) => {
                s.cond.visit(self);
                match &s.rest.content {
                    SelectionRestStatementData::Statement(then) => self.alone(then),
                    SelectionRestStatementData::Else(then, other) => {
                        self.alone(then);
                        self.alone(other);
                    }
                }
            }
            StatementData::Switch(s) => {
                s.head.visit(self);
                self.block(&s.body);
            }
            StatementData::Iteration(i) => self.iteration(i),
            StatementData::Expression(e) => e.visit(self),
            StatementData::CaseLabel(label) => label.visit(self),
            StatementData::Jump(jump) => jump.visit(self),
        }
    }

    /// The body of an `if` or of a loop.
    fn alone(&mut self, body: &Statement) {
        self.block(std::slice::from_ref(body));
    }

    fn iteration(&mut self, iteration: &ast::IterationStatement) {
        self.scopes.push(HashSet::new());
        match &iteration.content {
            IterationStatementData::While(condition, body) => {
                self.condition(condition);
                self.alone(body);
            }
            IterationStatementData::DoWhile(body, condition) => {
                self.alone(body);
                condition.visit(self);
            }
            IterationStatementData::For(init, rest, body) => {
                match &init.content {
                    ForInitStatementData::Declaration(d) => self.declaration(d),
                    ForInitStatementData::Expression(e) => {
                        if let Some(e) = e {
                            e.visit(self);
                        }
                    }
                }
                if let Some(condition) = &rest.condition {
                    self.condition(condition);
                }
                if let Some(step) = &rest.post_expr {
                    step.visit(self);
                }
                self.alone(body);
            }
        }
        self.scopes.pop();
    }

    fn condition(&mut self, condition: &ast::Condition) {
        match &condition.content {
            ConditionData::Expr(e) => e.visit(self),
            ConditionData::Assignment(ty, name, init) => {
                ty.visit(self);
                init.visit(self);
                self.declare(name);
            }
        }
    }

    /// A variable is in scope after its initialiser.
    fn declaration(&mut self, declaration: &ast::Declaration) {
        let DeclarationData::InitDeclaratorList(list) = &declaration.content else {
            declaration.visit(self);
            return;
        };
        list.head.visit(self);
        if let Some(name) = &list.head.name {
            self.declare(name);
        }
        for other in &list.tail {
            other.visit(self);
            self.declare(&other.ident.ident);
        }
    }
}

impl Visitor for Words<'_> {
    fn visit_type_qualifier_spec(&mut self, spec: &ast::TypeQualifierSpec) -> Visit {
        if matches!(spec.content, ast::TypeQualifierSpecData::Precise) {
            self.variables.insert(PRECISE.to_owned());
        }
        Visit::Children
    }

    fn visit_expr(&mut self, expr: &ast::Expr) -> Visit {
        let targets = side_effects::targets(expr, self.signatures);
        let mut roots = targets.into_iter().filter_map(side_effects::root);
        self.writes |= roots.any(|name| !self.is_local(name));
        let is_coord = |name: &ast::Identifier| name.as_str() == "gl_FragCoord";
        match &expr.content {
            // Only this expression shows which components are read.
            ExprData::Dot(of, components) if matches!(&of.content, ExprData::Variable(name) if is_coord(name)) =>
            {
                self.name("gl_FragCoord");
                if components.as_str().contains(['y', 'g', 't']) {
                    self.name(FRAG_COORD_Y);
                }
                return Visit::Parent;
            }
            ExprData::Variable(name) => {
                if is_coord(name) {
                    self.name(FRAG_COORD_Y);
                }
                self.name(name.as_str());
            }
            ExprData::FunCall(name, _) => {
                if let Some(name) = name.as_ident() {
                    self.writes |= side_effects::writes_images(name.as_str());
                    self.functions.insert(name.as_str().to_owned());
                }
            }
            _ => {}
        }
        Visit::Children
    }
}
