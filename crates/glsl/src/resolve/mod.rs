//! Resolves a stage: names, types, overloads, layouts of blocks and the order of evaluation. The
//! result is a [`Stage`] of trees, which `build` converts to IR.
//!
//! `declaration` resolves globals, `statement` and `expression` function bodies. They use `access`
//! for parts of values, `call` with `overload`, `constructor`, `built_in_functions` and `texture`,
//! `check` for type checks, `store` for block layouts, `effect` for the order of evaluation, and
//! `fold` for constants.

mod access;
mod built_in_functions;
mod call;
mod check;
mod constructor;
mod declaration;
mod effect;
mod expression;
mod fold;
mod function;
mod helpers;
mod inputs_outputs;
mod overload;
mod statement;
mod store;
mod texture;

use std::collections::{BTreeMap, HashMap, HashSet};

use glsl_lang::ast::NodeSpan;
use naga::{ShaderStage, Span};

use self::expression::Ex;
use super::interface::Interface;
use super::stage::GlslStage;
use super::tree::{
    FunctionId, Global, GlobalId, GlobalKind, Kind, Local, LocalId, Node, Stage, Statement,
};
use super::ty::Ty;
use shader_text::error::Error;
use shader_text::options::ClipSpace;

/// Limit on nodes in a stage's statements. Some statements are repeated for each element.
const NODES: usize = 1 << 22;

/// A combined sampler, split into a texture and a sampler.
#[derive(Clone, Debug)]
pub(super) struct Pair {
    /// The author's type, such as `sampler2D`.
    pub combined: String,
    pub texture: Node,
    pub sampler: Node,
}

impl Pair {
    fn node(&self) -> Node {
        Node::new(Kind::Combine {
            texture: self.texture.clone(),
            sampler: self.sampler.clone(),
            compares: self.combined.ends_with("Shadow"),
        })
    }
}

#[derive(Clone, Debug)]
struct Var {
    /// The expression that reads it.
    ex: Ex,
    /// Why it cannot be assigned to, if so.
    fixed: Option<&'static str>,
}

impl Var {
    fn plain(node: Node, ty: Ty) -> Self {
        Self {
            ex: Ex::new(node, ty),
            fixed: None,
        }
    }

    fn fixed(self, what: Option<&'static str>) -> Self {
        Self {
            fixed: what,
            ..self
        }
    }
}

/// The state of resolving a stage.
pub(super) struct Resolver<'a, 'u> {
    stage: &'a mut GlslStage<'u>,
    interface: &'a mut Interface,
    clip: ClipSpace,
    /// The stage resolved so far.
    out: Stage,
    /// Innermost last.
    scopes: Vec<HashMap<String, Var>>,
    /// The texture and sampler of each combined sampler, by path.
    pairs: HashMap<String, Pair>,
    /// Functions by name and index of the signature.
    functions: HashMap<(String, usize), FunctionId>,
    /// Functions whose calls change variables, images or atomic counters.
    writing: HashSet<FunctionId>,
    /// Statements at the start and the end of `main`.
    prologue: Vec<Statement>,
    epilogue: Vec<Statement>,
    in_main: bool,
    /// Number of enclosing loops and switches.
    loops: usize,
    switches: usize,
    /// Whether a switch statement is unreachable after a jump. Its declarations are still visible
    /// in later cases, without an initial value.
    unreached: bool,
    /// User functions that the current function calls: name and index of the signature.
    calls: Vec<(String, usize)>,
    /// The current function's result type.
    result: Ty,
    /// The globals that replace `gl_FragColor`, `gl_PointSize` and others.
    standins: BTreeMap<&'static str, (GlobalId, Ty)>,
    /// Number of elements of `gl_ClipDistance` in use.
    clip_distances: u32,
    /// The outputs of `gl_FragData` in use.
    targets: BTreeMap<u32, GlobalId>,
    /// Helper functions that GLSL lacks, by name.
    helpers: BTreeMap<String, FunctionId>,
    /// The names of helpers by purpose.
    helper_names: HashMap<String, String>,
    /// Temporaries of the current function. For globals, those of `main`.
    temporaries: Option<Vec<LocalId>>,
    /// Temporaries that `prologue` uses.
    temporaries_of_globals: Vec<LocalId>,
    /// Expressions held in temporaries, by position.
    held: HashMap<(u32, u32), Ex>,
    /// Keys of `held`, in order of insertion.
    held_keys: Vec<(u32, u32)>,
    /// Cached results of [`Self::look`].
    looked: HashMap<(u32, u32), effect::Properties>,
    /// Constants for literal texture offsets.
    offsets: Vec<(Vec<i32>, GlobalId)>,
    /// Number of nodes in statements so far.
    written: usize,
    taken: HashSet<String>,
}

pub(super) fn resolve(
    stage: &mut GlslStage<'_>,
    interface: &mut Interface,
    clip: ClipSpace,
) -> Result<Stage, Error> {
    let mut resolver = Resolver {
        stage,
        interface,
        clip,
        out: Stage::default(),
        scopes: vec![HashMap::new()],
        pairs: HashMap::new(),
        functions: HashMap::new(),
        writing: HashSet::new(),
        prologue: Vec::new(),
        epilogue: Vec::new(),
        in_main: false,
        loops: 0,
        switches: 0,
        unreached: false,
        calls: Vec::new(),
        result: Ty::Void,
        standins: BTreeMap::new(),
        clip_distances: 0,
        targets: BTreeMap::new(),
        helpers: BTreeMap::new(),
        helper_names: HashMap::new(),
        temporaries: None,
        temporaries_of_globals: Vec::new(),
        held: HashMap::new(),
        held_keys: Vec::new(),
        looked: HashMap::new(),
        offsets: Vec::new(),
        written: 0,
        taken: HashSet::new(),
    };
    resolver.stage()?;
    Ok(resolver.out)
}

impl Resolver<'_, '_> {
    fn place(&self, span: Option<NodeSpan>) -> Option<Span> {
        self.stage.unit.place(span)
    }

    fn is_vertex(&self) -> bool {
        self.stage.kind == ShaderStage::Vertex
    }

    fn lookup(&self, name: &str) -> Option<&Var> {
        self.scopes.iter().rev().find_map(|s| s.get(name))
    }

    fn bind(&mut self, name: &str, var: Var) {
        if let Some(scope) = self.scopes.last_mut() {
            scope.insert(name.to_owned(), var);
        }
    }

    /// A name like `wanted` that this stage does not use. The other stage may.
    fn fresh(&mut self, wanted: &str) -> String {
        let mut name = wanted.to_owned();
        while self.stage.unit.names.contains(&name) || !self.taken.insert(name.clone()) {
            name.push('_');
        }
        name
    }

    /// Adds a global, which [`Stage::declared`] must list to be declared.
    fn global_node(
        &mut self,
        name: Option<String>,
        kind: GlobalKind,
        place: Option<Span>,
    ) -> (GlobalId, Node) {
        let id = GlobalId(self.out.globals.len());
        let span = place.unwrap_or_default();
        self.out.globals.push(Global { name, kind, span });
        (id, Node::new(Kind::Global(id)))
    }

    fn add_local(&mut self, name: impl Into<String>, ty: Ty) -> LocalId {
        let name = name.into();
        self.out.locals.push(Local { name, ty });
        LocalId(self.out.locals.len() - 1)
    }
}
