//! The dataflow graph over naga IR, as an analysis overlay: the source is never put into SSA, everything is keyed by function and handle.
//!
//! Ferrante, Ottenstein and Warren, "The Program Dependence Graph and Its Use in Optimization" (1987), with the control dependence of
//! Ball and Horwitz (1993) and calls kept as calls and summarised (Horwitz, Reps and Binkley 1990).
//!
//! Assumed, as WGSL demands: two pointer arguments of a call, or a pointer argument and a global the callee uses, do not overlap if
//! either is written through.

use std::collections::BTreeSet;

use naga::valid::FunctionInfo;
use naga::{Expression, Function, Handle, Module, Statement, TypeInner};

use crate::program::Program;

pub mod cells;
pub mod control;
pub mod memory;
pub mod operands;
pub mod statements;

pub use cells::{Cell, Path, Place, Root};
pub use memory::{Memory, Origin, VersionId};
pub use statements::{StatementNode, StmtId};

/// A function or an entry point of a module.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum FunctionId {
    /// A function.
    Function(Handle<Function>),
    /// An entry point, by its index in the module.
    EntryPoint(usize),
}

/// The analyses of one function.
#[derive(Debug)]
pub struct FunctionGraph<'p> {
    /// Which function.
    pub id: FunctionId,
    /// The function.
    pub function: &'p Function,
    /// What naga's validator knows of it: types of expressions above all.
    pub info: &'p FunctionInfo,
    /// Its statements.
    pub statements: statements::Statements<'p>,
    /// What decides whether each runs.
    pub control: control::ControlDependence,
    /// Which versions of memory each reads and writes.
    pub memory: Memory,
}

/// The dataflow graph of a program.
#[derive(Debug)]
pub struct Graph<'p> {
    program: &'p Program,
    functions: Vec<FunctionGraph<'p>>,
    reach: Vec<Reach>,
}

/// What lies below a function, itself included.
#[derive(Clone, Debug, Default)]
struct Reach {
    functions: BTreeSet<FunctionId>,
    discards: bool,
    loops: bool,
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
        // naga's arena has callees before callers, so a callee's footprint is there when a caller needs it.
        for (id, function, info) in ids {
            let statements = statements::Statements::new(function);
            let control = control::ControlDependence::new(&statements, &function.body);
            let memory = Memory::new(module, function, &statements, &|h: Handle<Function>| {
                &functions[h.index()].memory.footprint
            });
            functions.push(FunctionGraph {
                id,
                function,
                info,
                statements,
                control,
                memory,
            });
        }
        let mut reach: Vec<Reach> = Vec::new();
        for f in &functions {
            let mut below = Reach {
                functions: BTreeSet::from([f.id]),
                ..Reach::default()
            };
            for (id, node) in f.statements.iter() {
                if f.control.is_reachable(id) {
                    below.discards |= matches!(node.statement, Statement::Kill);
                    below.loops |= matches!(node.statement, Statement::Loop { .. });
                }
            }
            for (_, callee) in f.calls() {
                let of: &Reach = &reach[callee.index()];
                below.functions.extend(&of.functions);
                below.discards |= of.discards;
                below.loops |= of.loops;
            }
            reach.push(below);
        }
        Self {
            program,
            functions,
            reach,
        }
    }

    /// The program.
    pub fn program(&self) -> &'p Program {
        self.program
    }

    /// The module.
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

    /// Whether `within` is a function or something it calls, directly or not.
    pub fn reaches(&self, function: FunctionId, within: FunctionId) -> bool {
        self.reach[self.index(function)].functions.contains(&within)
    }

    /// Whether a function, or something it calls, can discard the fragment.
    pub fn may_discard(&self, function: FunctionId) -> bool {
        self.reach[self.index(function)].discards
    }

    /// Whether a function, or something it calls, loops.
    pub fn may_loop(&self, function: FunctionId) -> bool {
        self.reach[self.index(function)].loops
    }

    /// All functions, callees before callers, entry points last.
    pub fn functions(&self) -> &[FunctionGraph<'p>] {
        &self.functions
    }
}

impl<'p> FunctionGraph<'p> {
    /// The type of an expression.
    pub fn ty<'a>(&'a self, module: &'a Module, expression: Handle<Expression>) -> &'a TypeInner {
        self.info[expression].ty.inner_with(&module.types)
    }

    /// The calls of the function that control can reach.
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
