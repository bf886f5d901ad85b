//! One stage's tree printed as the GLSL 4.50 that naga reads, with a mark before whatever comes from a place of the author's.
//!
//! Outside of functions: `declaration`. Inside: `statement` and `expression`, with `call` for calls, `overload` for which function is meant, `texture` for those of textures, `check` for types that do not go together, `store` for what lies in a block otherwise, and `effect` for what is
//! evaluated when.

mod builtin;
mod call;
mod check;
mod declaration;
mod effect;
mod expression;
mod function;
mod overload;
mod statement;
mod store;
mod texture;

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};

use glsl_lang::ast::NodeSpan;
use naga::{ShaderStage, Span};

use super::interface::{Interface, Pair};
use super::marks::Marks;
use super::stage::Stage;
use super::ty::{Lay, Ty};
use crate::front::ClipSpace;
use crate::front::error::Error;

/// Words that naga's GLSL keeps for itself and older dialects allow as names.
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

/// Most bytes of a stage's statements: some are written element by element.
const WRITTEN: usize = 1 << 26;

/// What a name stands for.
#[derive(Clone, Debug)]
struct Var {
    /// How it is read.
    text: String,
    ty: Ty,
    /// How it lies in a block, or in a struct that does.
    lay: Lay,
    /// Where the samplers in it are found: a path of [`Lower::pairs`].
    path: Option<String>,
    /// What it is, if it cannot be written to.
    fixed: Option<&'static str>,
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
            lay: Lay::default(),
            path: None,
            fixed: None,
        }
    }
}

/// A stage on its way into text.
pub(super) struct Lower<'a, 'u> {
    stage: &'a mut Stage<'u>,
    interface: &'a mut Interface,
    clip: ClipSpace,
    marks: Marks,
    /// Innermost last.
    scopes: Vec<HashMap<String, Var>>,
    /// The texture and sampler of each combined sampler, by path.
    pairs: HashMap<String, Pair>,
    /// Authors' functions whose names naga has.
    renamed: HashMap<String, String>,
    /// What `main` does first, and last.
    prologue: Vec<String>,
    epilogue: Vec<String>,
    /// What it reads there, by the names that are printed: no local of `main` may hide one.
    last_read: HashSet<String>,
    in_main: bool,
    /// A switch's statement is printed behind a jump: what it declares is there in the cases below, without a first value. Only [`Self::local`] asks.
    unreached: bool,
    /// The author's functions that the function calls which is printed, each by its name and the place of its signature.
    calls: Vec<(String, usize)>,
    /// What the function returns that is printed.
    result: Ty,
    /// Names for what stands for GLSL's own variables: `gl_FragColor`, `gl_PointSize`.
    standins: BTreeMap<&'static str, String>,
    /// Elements of `gl_FragData` in use.
    targets: BTreeSet<u32>,
    /// Functions that stand for what naga's front end lacks, by name.
    helpers: BTreeMap<String, String>,
    /// Their names, by those that were wanted.
    helper_names: HashMap<String, String>,
    /// Those of them that stand for a gather, with their components.
    gathers: HashMap<String, u32>,
    /// Declarations of ours at the head of the function that is printed; `None` outside of functions.
    temporaries: Option<Vec<String>>,
    /// What expressions became ahead of where they stand, by their places.
    held: HashMap<(u32, u32), expression::Ex>,
    /// Their places, in the order in which they came.
    held_keys: Vec<(u32, u32)>,
    /// What expressions were found to be before they were printed.
    looked: HashMap<(u32, u32), effect::Looked>,
    /// Literal offsets of samples, each a constant of ours.
    offsets: Vec<String>,
    /// What GLSL's functions are given, where they are called: for errors.
    given: Vec<Given>,
    indent: usize,
    /// Bytes of the statements so far.
    written: usize,
    /// Names that this stage's text has got.
    taken: HashSet<String>,
    /// How many were made like one that was taken.
    numbered: HashMap<String, usize>,
}

/// A call of one of GLSL's functions.
#[derive(Clone, Debug)]
pub(super) struct Given {
    pub name: String,
    pub types: Vec<Ty>,
    pub place: Span,
}

/// What a stage came to.
pub(super) struct Lowered {
    /// The rewritten text, its marks still in.
    pub text: String,
    pub marks: Marks,
    pub given: Vec<Given>,
    /// The functions in it that stand for a gather, with their components.
    pub gathers: HashMap<String, u32>,
}

/// Rewrites a stage.
pub(super) fn lower(
    stage: &mut Stage<'_>,
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
        calls: Vec::new(),
        result: Ty::Void,
        standins: BTreeMap::new(),
        targets: BTreeSet::new(),
        helpers: BTreeMap::new(),
        helper_names: HashMap::new(),
        gathers: HashMap::new(),
        temporaries: None,
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
        gathers: lower.gathers,
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

    /// The author's name, or, where naga could not read it as one, the name with an underscore.
    fn safe(&mut self, name: &str) -> String {
        match RESERVED.contains(&name) || name.contains("__") {
            true => {
                let wanted = format!("{}_", name.replace("__", "_"));
                self.fresh(&wanted)
            }
            false => name.to_owned(),
        }
    }

    /// A name like `wanted` that this stage has not: the other may have it.
    fn fresh(&mut self, wanted: &str) -> String {
        let is_free = |this: &mut Self, name: &String| {
            !this.stage.unit.names.contains(name) && this.taken.insert(name.clone())
        };
        let mut name = wanted.to_owned();
        if !self.numbered.contains_key(wanted) && is_free(self, &name) {
            return name;
        }
        let base = wanted.trim_end_matches('_');
        // Counted, so that the thousandth is found as soon as the first.
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
