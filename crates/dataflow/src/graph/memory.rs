//! Memory SSA over local variables, pointer arguments and writable globals, as an overlay that
//! leaves the source unchanged. One structured forward walk finds the versions that each read sees.

use std::collections::{BTreeMap, BTreeSet};

use naga::{Expression, Function, Handle, Module, Statement};

use super::cells::{self, Cell, Place, Root, Splitter};
use super::statements::{Statements, StmtId};

mod touch;
mod versions;

use touch::Touch;

/// A version of one cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct VersionId(pub(crate) u32);

impl VersionId {
    /// Index into [`Memory::versions`].
    pub const fn index(self) -> usize {
        self.0 as usize
    }
}

/// A cell's index in [`Memory::cells`].
pub(crate) type CellIndex = usize;

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Origin {
    /// The value at function entry: initialiser or zero, or the caller's or host's value.
    Initial,
    Written {
        by: StmtId,
        /// The previous version, if the statement may preserve it in part or whole.
        over: Option<VersionId>,
    },
    /// A merge of control: the end of an `If` or `Switch`, a loop's header, its `continuing`, its
    /// exit, or the function's exit.
    Phi {
        /// The statement at whose end or header control merges. `None` for the function's exit.
        at: Option<StmtId>,
        /// The merged versions.
        operands: Vec<VersionId>,
    },
}

/// A version of a cell.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Version {
    pub cell: CellIndex,
    pub origin: Origin,
}

/// A function's effect on its callers' memory. Roots are [`Root::Argument`] and [`Root::Global`]
/// only.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Footprint {
    /// Cells whose entry values it may read.
    pub reads: BTreeSet<Cell>,
    /// Cells it may write, and whether it always does.
    pub writes: BTreeMap<Cell, Certainty>,
}

/// Whether a write always happens.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Certainty {
    /// On some paths, or to some part.
    May,
    /// On every path, all of the cell.
    Must,
}

/// Memory SSA of one function.
#[derive(Clone, Debug, Default)]
pub struct Memory {
    /// The cells, those of one root together.
    pub cells: Vec<Cell>,
    pub versions: Vec<Version>,
    /// The versions that each memory-reading expression sees, one per cell.
    pub loads: BTreeMap<Handle<Expression>, Vec<VersionId>>,
    /// The versions that a statement sees in the cells that it reads.
    pub reads: BTreeMap<StmtId, Vec<VersionId>>,
    /// The versions a statement makes.
    pub writes: BTreeMap<StmtId, Vec<VersionId>>,
    /// The version at exit of each cell that callers can see.
    pub exit: BTreeMap<CellIndex, VersionId>,
    pub footprint: Footprint,
    pub(super) roots: BTreeMap<Root, std::ops::Range<CellIndex>>,
}

impl Memory {
    /// Builds the memory SSA of `function`. `footprint` returns that of every callee.
    pub fn new<'f>(
        module: &Module,
        function: &Function,
        statements: &Statements<'_>,
        footprint: &dyn Fn(Handle<Function>) -> &'f Footprint,
    ) -> Self {
        let mut splitter = Splitter::default();
        let touch = Touch {
            module,
            function,
            footprint,
        };
        for (_, node) in statements.iter() {
            if let Statement::Emit(range) = node.statement {
                for e in range.clone() {
                    if let Some(place) = touch.expression(e) {
                        splitter.access(&place);
                    }
                }
            }
            let (reads, writes) = touch.statement(node.statement);
            for access in reads.iter().chain(&writes) {
                splitter.access(&access.place);
            }
        }
        let mut memory = Self {
            cells: splitter.cells(module, function),
            ..Self::default()
        };
        for (i, cell) in memory.cells.iter().enumerate() {
            let range = memory.roots.entry(cell.root).or_insert(i..i);
            range.end = i + 1;
        }
        versions::number(&touch, statements, memory)
    }

    /// The cells that a path into a variable touches.
    pub fn overlapping<'a>(
        &'a self,
        root: Root,
        path: &'a [u32],
    ) -> impl Iterator<Item = CellIndex> + 'a {
        self.roots
            .get(&root)
            .cloned()
            .unwrap_or(0..0)
            .filter(move |i| self.cells[*i].overlaps(root, path))
    }

    pub fn cell(&self, version: VersionId) -> &Cell {
        &self.cells[self.versions[version.index()].cell]
    }

    pub fn origin(&self, version: VersionId) -> &Origin {
        &self.versions[version.index()].origin
    }

    pub(super) fn add(&mut self, cell: CellIndex, origin: Origin) -> VersionId {
        let id = VersionId(self.versions.len() as u32);
        self.versions.push(Version { cell, origin });
        id
    }
}

/// The caller's cells for a cell of a callee.
pub fn in_caller(
    module: &Module,
    caller: &Function,
    arguments: &[Handle<Expression>],
    cell: &Cell,
) -> Option<Place> {
    match cell.root {
        Root::Argument(i) => {
            let mut place = cells::place(module, caller, arguments[i as usize])?;
            if !place.dynamic {
                place.path.extend_from_slice(&cell.path);
            }
            Some(place)
        }
        Root::Global(_) => Some(Place {
            root: cell.root,
            path: cell.path.clone(),
            dynamic: false,
        }),
        Root::Local(_) => None,
    }
}

/// The summary for callers. A cell is written if its exit version is not the initial one, and
/// certainly written if no path from the exit leads back to the initial version. It is read if
/// anything reads its initial version.
pub(super) fn footprint(memory: &Memory) -> Footprint {
    let mut out = Footprint::default();
    let initial = |v: VersionId| matches!(memory.versions[v.index()].origin, Origin::Initial);
    for (&cell, &exit) in &memory.exit {
        if initial(exit) {
            continue;
        }
        let mut seen = BTreeSet::new();
        let mut stack = vec![exit];
        let mut certainty = Certainty::Must;
        while let Some(v) = stack.pop() {
            if !seen.insert(v) {
                continue;
            }
            match memory.origin(v) {
                Origin::Initial => certainty = Certainty::May,
                Origin::Written { over, .. } => stack.extend(over),
                Origin::Phi { operands, .. } => stack.extend(operands),
            }
        }
        out.writes.insert(memory.cells[cell].clone(), certainty);
    }
    let mut stack: Vec<VersionId> = memory
        .loads
        .values()
        .chain(memory.reads.values())
        .flatten()
        .copied()
        .collect();
    let mut seen = BTreeSet::new();
    while let Some(v) = stack.pop() {
        if !seen.insert(v) {
            continue;
        }
        match memory.origin(v) {
            Origin::Initial => {
                let cell = memory.cell(v);
                if !matches!(cell.root, Root::Local(_)) {
                    out.reads.insert(cell.clone());
                }
            }
            Origin::Written { over, .. } => stack.extend(over),
            Origin::Phi { operands, .. } => stack.extend(operands),
        }
    }
    out
}
