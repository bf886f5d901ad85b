//! Prints a stage as the GLSL 4.50 that naga reads, with marks for source spans.
//!
//! `declaration` prints globals, `statement` and `expression` function bodies. They use `call`,
//! `overload` for overload resolution, `texture` for texture functions, `check` for type checks,
//! `store` for block layouts, `effect` for the order of evaluation, and `fold` for constants.

mod builtin;
mod call;
mod check;
mod declaration;
mod effect;
mod expression;
mod fold;
mod function;
mod overload;
mod statement;
mod store;
mod texture;

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};

use glsl_lang::ast::NodeSpan;
use naga::{ShaderStage, Span};

use self::fold::Folds;
use super::interface::{Interface, SplitSampler};
use super::placeholders::Placeholders;
use super::source_marks::Marks;
use super::stage::GlslStage;
use super::ty::{MemoryLayout, Ty};
use preshade_text::error::Error;
use preshade_text::options::ClipSpace;

/// Keywords of naga's GLSL that older versions allow as names.
const RESERVED: &[&str] = &[
    "sample",
    "buffer",
    "shared",
    "patch",
    "precise",
    "coherent",
    "readonly",
    "writeonly",
    "restrict",
    "volatile",
    "sampler",
    "samplerShadow",
    "texture1D",
    "texture2D",
    "texture3D",
    "textureCube",
    "texture2DArray",
    "textureCubeArray",
    "image2D",
    "image3D",
    "smooth",
    "noperspective",
    "flat",
    "centroid",
    "subroutine",
    "atomic_uint",
    "double",
    "main_1",
    "resource",
    "half",
    "fixed",
    "common",
    "partition",
    "active",
    "filter",
];

/// Maximum bytes of a stage's statements. Some statements are printed per element.
const WRITTEN: usize = 1 << 26;

/// A variable in scope.
#[derive(Clone, Debug)]
struct Var {
    /// The expression that reads it.
    text: String,
    ty: Ty,
    /// Its layout in a block or a struct.
    lay: MemoryLayout,
    /// Where its samplers are: a path in [`Lower::pairs`].
    path: Option<String>,
    /// Why it cannot be assigned to.
    fixed: Option<&'static str>,
    folds: Folds,
}

impl Var {
    fn fixed(self, what: Option<&'static str>) -> Self {
        Self {
            fixed: what,
            ..self
        }
    }

    fn plain(text: impl Into<String>, ty: Ty) -> Self {
        Self {
            text: text.into(),
            ty,
            lay: MemoryLayout::default(),
            path: None,
            fixed: None,
            folds: Folds::No,
        }
    }
}

/// The state of lowering a stage.
pub(super) struct Lower<'a, 'u> {
    stage: &'a mut GlslStage<'u>,
    interface: &'a mut Interface,
    clip: ClipSpace,
    marks: Marks,
    /// Innermost last.
    scopes: Vec<HashMap<String, Var>>,
    /// The texture and sampler of each combined sampler, by path.
    pairs: HashMap<String, SplitSampler>,
    /// User functions with names of naga's.
    renamed: HashMap<String, String>,
    /// Statements at the start and the end of `main`.
    prologue: Vec<String>,
    epilogue: Vec<String>,
    /// The names that the epilogue reads. Locals of `main` may not hide them.
    last_read: HashSet<String>,
    in_main: bool,
    /// A switch statement follows a jump: its declarations are visible in later cases, without an
    /// initial value.
    unreached: bool,
    /// The number of scopes when the innermost switch began. naga has no scope for a switch, so that
    /// what is declared directly in it needs a name of its own.
    switch_scope: Option<usize>,
    /// User functions that the current function calls: name and index of the signature.
    calls: Vec<(String, usize)>,
    /// The current function's result type.
    result: Ty,
    /// Names of the globals that replace `gl_FragColor`, `gl_PointSize` and others.
    standins: BTreeMap<&'static str, String>,
    /// Elements of `gl_ClipDistance` in use.
    clip_distances: u32,
    /// Elements of `gl_FragData` in use.
    targets: BTreeSet<u32>,
    /// Helper functions that naga's front end lacks, by name.
    helpers: BTreeMap<String, String>,
    /// The names of helpers by purpose.
    helper_names: HashMap<String, String>,
    /// Functions whose bodies are replaced in the module.
    placeholders: Placeholders,
    /// Temporaries of the current function; for globals, of `main`.
    temporaries: Option<Vec<String>>,
    /// Those of `prologue`.
    temporaries_of_globals: Vec<String>,
    /// Expressions held in temporaries, by position.
    held: HashMap<(u32, u32), expression::Ex>,
    /// Their positions, in order.
    held_keys: Vec<(u32, u32)>,
    /// Cached results of [`Self::look`].
    looked: HashMap<(u32, u32), effect::Properties>,
    /// Constants for literal texture offsets.
    offsets: Vec<String>,
    /// Calls of built-in functions, for error messages.
    given: Vec<BuiltinCall>,
    indent: usize,
    /// Bytes of statements so far.
    written: usize,
    /// Names used in the printed text.
    taken: HashSet<String>,
    /// Number of names derived from each name.
    numbered: HashMap<String, usize>,
}

/// A call of a built-in function.
#[derive(Clone, Debug)]
pub(super) struct BuiltinCall {
    pub name: String,
    pub types: Vec<Ty>,
    pub place: Span,
}

/// A lowered stage.
pub(super) struct Lowered {
    /// The rewritten text with marks.
    pub text: String,
    pub marks: Marks,
    pub given: Vec<BuiltinCall>,
    /// Functions whose bodies are replaced in the module.
    pub placeholders: Placeholders,
    /// The array that stands for `gl_ClipDistance`.
    pub clip_distances: Option<String>,
}

/// Lowers a stage.
pub(super) fn lower(
    stage: &mut GlslStage<'_>,
    interface: &mut Interface,
    clip: ClipSpace,
) -> Result<Lowered, Error> {
    let pairs = interface
        .samplers
        .iter()
        .map(|(path, bound)| (path.clone(), bound.pair.clone()))
        .collect();
    let mut lower = Lower {
        stage,
        interface,
        clip,
        marks: Marks::default(),
        scopes: vec![HashMap::new()],
        pairs,
        renamed: HashMap::new(),
        prologue: Vec::new(),
        epilogue: Vec::new(),
        last_read: HashSet::new(),
        in_main: false,
        unreached: false,
        switch_scope: None,
        calls: Vec::new(),
        result: Ty::Void,
        standins: BTreeMap::new(),
        clip_distances: 0,
        targets: BTreeSet::new(),
        helpers: BTreeMap::new(),
        helper_names: HashMap::new(),
        placeholders: HashMap::new(),
        temporaries: None,
        temporaries_of_globals: Vec::new(),
        held: HashMap::new(),
        held_keys: Vec::new(),
        looked: HashMap::new(),
        offsets: Vec::new(),
        given: Vec::new(),
        indent: 0,
        written: 0,
        taken: HashSet::new(),
        numbered: HashMap::new(),
    };
    let text = lower.stage()?;
    Ok(Lowered {
        text,
        marks: lower.marks,
        given: lower.given,
        placeholders: lower.placeholders,
        clip_distances: lower.standins.remove("gl_ClipDistance"),
    })
}

impl Lower<'_, '_> {
    fn place(&self, span: Option<NodeSpan>) -> Option<Span> {
        self.stage.unit.place(span)
    }

    fn mark(&mut self, span: Option<NodeSpan>) -> String {
        let place = self.place(span);
        self.marks.mark(place)
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

    /// The author's name, with an underscore if naga reserves it or takes it for a struct.
    fn safe(&mut self, name: &str) -> String {
        let is_struct = self.stage.structs.get(name).is_some();
        match is_struct || RESERVED.contains(&name) || name.contains("__") {
            true => {
                let wanted = format!("{}_", name.replace("__", "_"));
                self.fresh(&wanted)
            }
            false => name.to_owned(),
        }
    }

    /// A name like `wanted` that this stage does not use. The other stage may.
    fn fresh(&mut self, wanted: &str) -> String {
        let is_free = |this: &mut Self, name: &String| {
            !this.stage.unit.names.contains(name) && this.taken.insert(name.clone())
        };
        let mut name = wanted.to_owned();
        if !self.numbered.contains_key(wanted) && is_free(self, &name) {
            return name;
        }
        let base = wanted.trim_end_matches('_');
        // Count, so that finding the thousandth name is as fast as the first.
        loop {
            let count = self.numbered.entry(wanted.to_owned()).or_default();
            name = match *count {
                0 => format!("{base}_"),
                n => format!("{base}_{}", n + 1),
            };
            *count += 1;
            if is_free(self, &name) {
                return name;
            }
        }
    }

    fn line(&self, text: &str) -> String {
        format!("{}{text}\n", "    ".repeat(self.indent))
    }
}
