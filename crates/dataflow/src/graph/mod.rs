//! The dataflow graph over naga IR, as an analysis overlay: the source is not converted to SSA, and
//! facts are keyed by function and handle.
//!
//! Ferrante, Ottenstein and Warren, "The Program Dependence Graph and Its Use in Optimization"
//! (1987), with the control dependence of Ball and Horwitz (1993), and summaries of calls (Horwitz,
//! Reps and Binkley 1990).
//!
//! Assumption, guaranteed by WGSL: two pointer arguments of a call, or a pointer argument and a
//! global the callee uses, do not overlap if either is written through.

use std::collections::BTreeSet;
use std::sync::OnceLock;

use naga::valid::FunctionInfo;
use naga::{Expression, Function, Handle, Module, Statement, TypeInner};

use self::counted::Ends;
use preshade_plan::program::Program;

pub mod cells;
pub mod control;
pub mod cost;
pub mod counted;
mod dot;
pub mod effect;
pub mod export;
pub mod memory;
pub mod rate;
pub mod rates;
pub mod statements;
pub mod text;

pub use cells::{Cell, Path, Place, Root};
pub use effect::{Effect, Effects};
pub use export::{EdgeKind, GraphData, NodeKind};
pub use memory::{Memory, Origin, VersionId};
pub use rate::{Fact, Rate, Stages};
pub use statements::{StatementNode, StmtId};

/// A function or an entry point of a module.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum FunctionId {
    Function(Handle<Function>),
    /// An entry point, by its index in the module.
    EntryPoint(usize),
}

/// The analyses of one function.
#[derive(Debug)]
pub struct FunctionGraph<'p> {
    pub id: FunctionId,
    pub function: &'p Function,
    /// The validator's results, mainly the types of expressions.
    pub info: &'p FunctionInfo,
    pub statements: statements::Statements<'p>,
    pub control: control::ControlDependence,
    pub memory: Memory,
    /// Estimate of how often each statement runs per run of the function.
    pub times: Vec<f64>,
}

/// The dataflow graph of a program.
#[derive(Debug)]
pub struct Graph<'p> {
    program: &'p Program,
    functions: Vec<FunctionGraph<'p>>,
    reach: Vec<Reach>,
    /// Computed on first use, because few depth passes need it.
    rates: OnceLock<rates::Rates>,
}

/// Facts about a function and all it calls.
#[derive(Clone, Debug, Default)]
struct Reach {
    functions: BTreeSet<FunctionId>,
    effects: Effects,
    ends: Ends,
    cost: f64,
}

impl<'p> Graph<'p> {
    /// Analyses every function and entry point of a program.
    pub fn build(program: &'p Program) -> Self {
        let (module, info) = (program.module(), program.info());
        let mut functions: Vec<FunctionGraph<'p>> = Vec::new();
        let ids = module
            .functions
            .iter()
            .map(|(h, f)| (FunctionId::Function(h), f, &info[h]))
            .chain(module.entry_points.iter().enumerate().map(|(i, e)| {
                (
                    FunctionId::EntryPoint(i),
                    &e.function,
                    info.get_entry_point(i),
                )
            }));
        // naga's arena has callees before callers.
        for (id, function, info) in ids {
            let statements = statements::Statements::new(function);
            let control = control::ControlDependence::new(&statements, &function.body);
            let memory = Memory::new(module, function, &statements, &|h: Handle<Function>| {
                &functions[h.index()].memory.footprint
            });
            let mut f = FunctionGraph {
                id,
                function,
                info,
                statements,
                control,
                memory,
                times: Vec::new(),
            };
            f.times = cost::multiplicity(module, &f);
            functions.push(f);
        }
        let mut reach: Vec<Reach> = Vec::new();
        for f in &functions {
            let mut below = Reach {
                functions: BTreeSet::from([f.id]),
                ..Reach::default()
            };
            for (id, node) in f.statements.iter() {
                if f.control.is_reachable(id) && matches!(node.statement, Statement::Loop { .. }) {
                    below.ends = below.ends.max(counted::ends(module, f, id));
                }
            }
            below.effects = effect::own(module, f);
            for (_, callee) in f.calls() {
                let of: &Reach = &reach[callee.index()];
                below.functions.extend(&of.functions);
                below.effects.extend(&of.effects);
                below.ends = below.ends.max(of.ends);
            }
            reach.push(below);
        }
        let mut graph = Self {
            program,
            functions,
            reach,
            rates: OnceLock::new(),
        };
        graph.count();
        graph
    }

    /// The same graph, with the frequency of each statement multiplied by a weight.
    #[must_use]
    pub fn weighed(mut self, weight: impl Fn(FunctionId, StmtId) -> f64) -> Self {
        for f in &mut self.functions {
            let id = f.id;
            let all: Vec<StmtId> = f.statements.iter().map(|(at, _)| at).collect();
            for at in all {
                f.times[at.index()] *= weight(id, at);
            }
        }
        self.count();
        self
    }

    /// Computes the cost of each function.
    fn count(&mut self) {
        // Callees come before callers.
        for i in 0..self.functions.len() {
            let f = &self.functions[i];
            let calls = f.calls();
            let calls = calls.map(|(at, c)| self.reach[c.index()].cost * f.times[at.index()]);
            self.reach[i].cost = calls.sum::<f64>() + f.own_cost(self.module(), |_| true, |_| true);
        }
    }

    fn rates(&self) -> &rates::Rates {
        self.rates
            .get_or_init(|| rates::Rates::new(self.module(), &self.functions))
    }

    pub fn program(&self) -> &'p Program {
        self.program
    }

    pub fn module(&self) -> &'p Module {
        self.program.module()
    }

    /// The analyses of a function.
    pub fn function(&self, id: FunctionId) -> &FunctionGraph<'p> {
        &self.functions[self.index(id)]
    }

    fn index(&self, id: FunctionId) -> usize {
        match id {
            FunctionId::Function(h) => h.index(),
            FunctionId::EntryPoint(i) => self.module().functions.len() + i,
        }
    }

    /// The name of a function or entry point. Empty for an unnamed one.
    pub fn name(&self, id: FunctionId) -> String {
        match id {
            FunctionId::Function(h) => self.module().functions[h].name.clone().unwrap_or_default(),
            FunctionId::EntryPoint(i) => self.module().entry_points[i].name.clone(),
        }
    }

    /// Rate and stages of an expression's value, from its operands and its control dependence.
    /// Joined over all calls of its function.
    pub fn fact(&self, function: FunctionId, expression: Handle<Expression>) -> Fact {
        self.rates().expression(self.index(function), expression)
    }

    /// The rate of an expression's value: see [`Graph::fact`].
    pub fn rate(&self, function: FunctionId, expression: Handle<Expression>) -> Rate {
        self.fact(function, expression).rate
    }

    /// Rate and stages of a statement's control dependence.
    pub fn statement_fact(&self, function: FunctionId, statement: StmtId) -> Fact {
        self.rates().statement(self.index(function), statement)
    }

    /// Rate and stages of an argument, or a member of a struct argument, of the n-th function.
    fn input_fact(&self, function: usize, argument: u32, member: Option<u32>) -> Fact {
        self.rates().argument(function, argument, member)
    }

    /// Rate and stages of a version of a cell of the n-th function.
    fn version_fact(&self, function: usize, version: VersionId) -> Fact {
        self.rates().version(function, version)
    }

    /// Rate and stages of each member of a function's struct result, or of its result: for an entry
    /// point in the order of [`naga_edit::interface::outputs`].
    pub fn result_facts(&self, function: FunctionId) -> &[Fact] {
        self.rates().outputs(self.index(function))
    }

    /// Whether `function` is `within`, or calls it directly or indirectly.
    pub fn reaches(&self, function: FunctionId, within: FunctionId) -> bool {
        self.reach[self.index(function)].functions.contains(&within)
    }

    /// Whether a function, or one that it calls, can discard the fragment.
    pub fn may_discard(&self, function: FunctionId) -> bool {
        self.effects(function).contains(&Effect::Discard)
    }

    /// The effects of a function and those it calls.
    pub fn effects(&self, function: FunctionId) -> &Effects {
        &self.reach[self.index(function)].effects
    }

    /// Whether a function, or one that it calls, writes memory.
    pub fn writes_memory(&self, function: FunctionId) -> bool {
        let effects = self.effects(function);
        Effect::WRITES.iter().any(|effect| effects.contains(effect))
    }

    /// The static cost of running a function once, calls included, by the model of [`cost`].
    pub fn cost(&self, function: FunctionId) -> f64 {
        self.reach[self.index(function)].cost
    }

    /// The static cost of an entry point.
    pub fn entry_cost(&self, entry: usize) -> f64 {
        self.cost(FunctionId::EntryPoint(entry))
    }

    /// The names of an entry point's effects, in the order of [`Effect`].
    pub fn entry_effects(&self, entry: usize) -> Vec<String> {
        self.effects(FunctionId::EntryPoint(entry))
            .iter()
            .map(|e| e.name().to_owned())
            .collect()
    }

    /// Whether all loops end in a function and those that it calls.
    pub fn ends(&self, function: FunctionId) -> Ends {
        self.reach[self.index(function)].ends
    }

    /// All functions, callees before callers, entry points last.
    pub fn functions(&self) -> &[FunctionGraph<'p>] {
        &self.functions
    }
}

impl<'p> FunctionGraph<'p> {
    pub fn ty<'a>(&'a self, module: &'a Module, expression: Handle<Expression>) -> &'a TypeInner {
        self.info[expression].ty.inner_with(&module.types)
    }

    /// The static cost of the chosen nodes, weighted by frequency, without callees.
    pub fn own_cost(
        &self,
        module: &Module,
        statement: impl Fn(StmtId) -> bool,
        expression: impl Fn(Handle<Expression>) -> bool,
    ) -> f64 {
        let mut sum = 0.0;
        for (id, node) in self.statements.iter() {
            if !self.control.is_reachable(id) || !statement(id) {
                continue;
            }
            let mut each = cost::of_statement(module, self, id);
            if let Statement::Emit(range) = node.statement {
                each += range
                    .clone()
                    .filter(|e| expression(*e))
                    .map(|e| cost::of_expression(module, self, e))
                    .sum::<f64>();
            }
            sum += each * self.times[id.index()];
        }
        sum
    }

    /// The reachable calls of the function.
    pub fn calls(&self) -> impl Iterator<Item = (StmtId, Handle<Function>)> + '_ {
        self.statements
            .iter()
            .filter(|(id, _)| self.control.is_reachable(*id))
            .filter_map(|(id, node)| match node.statement {
                Statement::Call { function, .. } => Some((id, *function)),
                _ => None,
            })
    }
}
