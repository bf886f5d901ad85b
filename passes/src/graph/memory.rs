//! Memory SSA over local variables, pointer arguments and writable globals, as an overlay: one structured forward walk that gives every
//! read the versions it sees. The source is not changed.

use std::collections::{BTreeMap, BTreeSet};

use naga::{Block, Expression, Function, Handle, Module, RayQueryFunction, Statement};

use super::cells::{self, Cell, Place, Root, Splitter};
use super::statements::{Statements, StmtId};

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
pub type CellIndex = usize;

/// Where a version of a cell comes from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Origin {
    /// The value at function entry: initialiser or zero, what the caller left there, or what the host did.
    Initial,
    /// A statement that writes it.
    Written {
        /// The statement.
        by: StmtId,
        /// The version before, where the statement may leave it, or part of it, standing.
        over: Option<VersionId>,
    },
    /// A merge of control: the end of an `If` or `Switch`, a loop's header, its `continuing`, its exit, or the function's exit.
    Phi {
        /// The statement whose control merges; `None` for the function's exit.
        at: Option<StmtId>,
        /// The versions that meet.
        operands: Vec<VersionId>,
    },
}

/// A version of a cell.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Version {
    /// The cell.
    pub cell: CellIndex,
    /// Where it comes from.
    pub origin: Origin,
}

/// What a function does to memory its callers can see. Roots are [`Root::Argument`] and [`Root::Global`] only.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Footprint {
    /// Cells it may read as they were at its entry.
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
    /// All versions.
    pub versions: Vec<Version>,
    /// The versions each memory-reading expression sees, one for each cell it touches.
    pub loads: BTreeMap<Handle<Expression>, Vec<VersionId>>,
    /// The versions a statement sees of the cells it reads.
    pub reads: BTreeMap<StmtId, Vec<VersionId>>,
    /// The versions a statement makes.
    pub writes: BTreeMap<StmtId, Vec<VersionId>>,
    /// The version at exit of each cell callers can see.
    pub exit: BTreeMap<CellIndex, VersionId>,
    /// What callers see of all this.
    pub footprint: Footprint,
    roots: BTreeMap<Root, std::ops::Range<CellIndex>>,
}

/// A read or write of memory by a statement or expression.
#[derive(Clone, Debug)]
struct Access {
    place: Place,
    /// Whether a write is of the whole place, with nothing left of what was there.
    certainty: Certainty,
}

impl Memory {
    /// The memory SSA of `function`. `footprint` gives that of every function it may call.
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
        // What each statement may write, for the headers of the loops around it.
        let defined: Vec<(StmtId, Vec<CellIndex>)> = statements
            .iter()
            .map(|(id, node)| {
                let cells = touch
                    .statement(node.statement)
                    .1
                    .iter()
                    .flat_map(|a| memory.overlapping(a.place.root, &a.place.path))
                    .collect::<Vec<_>>();
                (id, cells)
            })
            .filter(|(_, cells)| !cells.is_empty())
            .collect();
        let state = (0..memory.cells.len())
            .map(|cell| memory.add(cell, Origin::Initial))
            .collect();
        let mut walk = Walk {
            touch: &touch,
            statements,
            memory,
            defined,
            state,
            log: Vec::new(),
            live: true,
            next: 0,
            returns: Vec::new(),
        };
        walk.block(&function.body, &mut Jumps::default());
        walk.leave();
        walk.finish()
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

    /// The cell of a version.
    pub fn cell(&self, version: VersionId) -> &Cell {
        &self.cells[self.versions[version.index()].cell]
    }

    /// The origin of a version.
    pub fn origin(&self, version: VersionId) -> &Origin {
        &self.versions[version.index()].origin
    }

    fn add(&mut self, cell: CellIndex, origin: Origin) -> VersionId {
        let id = VersionId(self.versions.len() as u32);
        self.versions.push(Version { cell, origin });
        id
    }
}

/// Where a caller sees a cell of a callee.
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

/// Which memory a statement or an expression touches.
struct Touch<'a, 'f> {
    module: &'a Module,
    function: &'a Function,
    footprint: &'a dyn Fn(Handle<Function>) -> &'f Footprint,
}

impl Touch<'_, '_> {
    fn place(&self, pointer: Handle<Expression>) -> Option<Place> {
        cells::place(self.module, self.function, pointer)
    }

    /// What evaluating an expression reads.
    fn expression(&self, expression: Handle<Expression>) -> Option<Place> {
        match self.function.expressions[expression] {
            Expression::Load { pointer } => self.place(pointer),
            Expression::RayQueryGetIntersection { query, .. }
            | Expression::RayQueryVertexPositions { query, .. } => self.place(query),
            Expression::ImageLoad { image, .. } => self.place(image),
            Expression::CooperativeLoad { ref data, .. } => self.place(data.pointer),
            _ => None,
        }
    }

    /// What a statement reads and writes, its blocks and the expressions it emits apart.
    fn statement(&self, statement: &Statement) -> (Vec<Access>, Vec<Access>) {
        let one = |pointer, certainty| {
            self.place(pointer)
                .map(|place| Access { place, certainty })
                .into_iter()
                .collect::<Vec<_>>()
        };
        let both = |pointer| (one(pointer, Certainty::May), one(pointer, Certainty::May));
        match statement {
            Statement::Store { pointer, .. } => (Vec::new(), one(*pointer, Certainty::Must)),
            Statement::ImageStore { image, .. } => (Vec::new(), one(*image, Certainty::May)),
            Statement::Atomic { pointer, .. } => both(*pointer),
            Statement::ImageAtomic { image, .. } => both(*image),
            Statement::WorkGroupUniformLoad { pointer, .. } => both(*pointer),
            Statement::RayQuery { query, fun } => match fun {
                RayQueryFunction::Initialize { .. } => (Vec::new(), one(*query, Certainty::Must)),
                _ => both(*query),
            },
            Statement::RayPipelineFunction(naga::RayPipelineFunction::TraceRay {
                payload, ..
            }) => both(*payload),
            Statement::CooperativeStore { data, .. } => both(data.pointer),
            Statement::ControlBarrier(_) | Statement::MemoryBarrier(_) => {
                let shared: Vec<Access> = self
                    .module
                    .global_variables
                    .iter()
                    .filter(|(g, v)| {
                        v.space != naga::AddressSpace::Private
                            && cells::is_written_space(self.module, *g)
                    })
                    .map(|(g, _)| Access {
                        place: Place {
                            root: Root::Global(g),
                            path: Vec::new(),
                            dynamic: true,
                        },
                        certainty: Certainty::May,
                    })
                    .collect();
                (shared.clone(), shared)
            }
            Statement::Call {
                function,
                arguments,
                ..
            } => {
                let footprint = (self.footprint)(*function);
                let at = |cell: &Cell| in_caller(self.module, self.function, arguments, cell);
                let reads = footprint
                    .reads
                    .iter()
                    .filter_map(|cell| {
                        Some(Access {
                            place: at(cell)?,
                            certainty: Certainty::May,
                        })
                    })
                    .collect();
                let writes = footprint
                    .writes
                    .iter()
                    .filter_map(|(cell, certainty)| {
                        Some(Access {
                            place: at(cell)?,
                            certainty: *certainty,
                        })
                    })
                    .collect();
                (reads, writes)
            }
            _ => (Vec::new(), Vec::new()),
        }
    }
}

/// How the cells differ from what they were at some earlier point.
type Delta = BTreeMap<CellIndex, VersionId>;

/// The states that leave a loop or switch early, each relative to the point where its target began.
#[derive(Default)]
struct Jumps {
    breaks: Vec<Delta>,
    continues: Vec<Delta>,
    break_mark: usize,
    continue_mark: usize,
}

struct Walk<'a, 'f, 'p> {
    touch: &'a Touch<'a, 'f>,
    statements: &'a Statements<'p>,
    memory: Memory,
    defined: Vec<(StmtId, Vec<CellIndex>)>,
    state: Vec<VersionId>,
    /// Each change of `state` with what stood there: a branch is undone in time proportional to what it did.
    log: Vec<(CellIndex, VersionId)>,
    live: bool,
    next: usize,
    returns: Vec<Delta>,
}

impl Walk<'_, '_, '_> {
    fn define(&mut self, cell: CellIndex, version: VersionId) {
        let before = std::mem::replace(&mut self.state[cell], version);
        self.log.push((cell, before));
    }

    fn delta(&self, mark: usize) -> Delta {
        self.log[mark..]
            .iter()
            .map(|(cell, _)| (*cell, self.state[*cell]))
            .collect()
    }

    fn undo(&mut self, mark: usize) {
        while self.log.len() > mark {
            if let Some((cell, before)) = self.log.pop() {
                self.state[cell] = before;
            }
        }
    }

    /// Lets the paths that `deltas` describe, relative to the present state, meet.
    fn merge(&mut self, at: Option<StmtId>, deltas: &[Delta]) {
        self.live = !deltas.is_empty();
        let changed: BTreeSet<CellIndex> = deltas.iter().flat_map(|d| d.keys().copied()).collect();
        for cell in changed {
            let mut operands: Vec<VersionId> = deltas
                .iter()
                .map(|d| d.get(&cell).copied().unwrap_or(self.state[cell]))
                .collect();
            operands.sort_unstable();
            operands.dedup();
            let version = match operands.as_slice() {
                [one] => *one,
                _ => self.memory.add(cell, Origin::Phi { at, operands }),
            };
            self.define(cell, version);
        }
    }

    fn sees(&self, place: &Place) -> Vec<VersionId> {
        self.memory
            .overlapping(place.root, &place.path)
            .map(|cell| self.state[cell])
            .collect()
    }

    fn block(&mut self, block: &Block, jumps: &mut Jumps) {
        for statement in block {
            let id = StmtId::from(self.next);
            self.next += 1;
            self.statement(id, statement, jumps);
        }
    }

    /// Walks one of several alternative blocks and undoes it: what it changed, if control comes out of its end.
    fn branch(&mut self, block: &Block, jumps: &mut Jumps) -> Option<Delta> {
        let (mark, live) = (self.log.len(), self.live);
        self.block(block, jumps);
        let delta = self.live.then(|| self.delta(mark));
        self.undo(mark);
        self.live = live;
        delta
    }

    fn statement(&mut self, id: StmtId, statement: &Statement, jumps: &mut Jumps) {
        match statement {
            Statement::Emit(range) => {
                for e in range.clone() {
                    if let Some(place) = self.touch.expression(e) {
                        let seen = self.sees(&place);
                        self.memory.loads.insert(e, seen);
                    }
                }
            }
            Statement::Block(block) => self.block(block, jumps),
            Statement::If { accept, reject, .. } => {
                let live = self.live;
                let deltas: Vec<Delta> = [accept, reject]
                    .into_iter()
                    .filter_map(|b| self.branch(b, jumps))
                    .collect();
                self.merge(Some(id), &deltas);
                self.live &= live;
            }
            Statement::Switch { cases, .. } => {
                let live = self.live;
                let mark = self.log.len();
                let mut inner = Jumps {
                    break_mark: mark,
                    continue_mark: jumps.continue_mark,
                    ..Jumps::default()
                };
                let mut exits = Vec::new();
                let mut falling: Option<Delta> = None;
                for case in cases {
                    self.live = live;
                    if let Some(delta) = falling.take() {
                        self.merge(Some(id), &[Delta::new(), delta]);
                    }
                    self.block(&case.body, &mut inner);
                    let delta = self.live.then(|| self.delta(mark));
                    self.undo(mark);
                    if case.fall_through {
                        falling = delta;
                    } else {
                        exits.extend(delta);
                    }
                }
                exits.append(&mut inner.breaks);
                jumps.continues.append(&mut inner.continues);
                self.merge(Some(id), &exits);
                self.live &= live;
            }
            Statement::Loop {
                body,
                continuing,
                break_if,
            } => {
                let live = self.live;
                let end = self.statements.get(id).end;
                let from = self.defined.partition_point(|(s, _)| *s <= id);
                let to = self.defined.partition_point(|(s, _)| *s < end);
                let changed: BTreeSet<CellIndex> = self.defined[from..to]
                    .iter()
                    .flat_map(|(_, cells)| cells.iter().copied())
                    .collect();
                let before = self.log.len();
                let mut headers = Vec::new();
                for cell in changed {
                    let phi = self.memory.add(
                        cell,
                        Origin::Phi {
                            at: Some(id),
                            operands: vec![self.state[cell]],
                        },
                    );
                    self.define(cell, phi);
                    headers.push((cell, phi));
                }
                let mark = self.log.len();
                let mut inner = Jumps {
                    break_mark: before,
                    continue_mark: mark,
                    ..Jumps::default()
                };
                self.block(body, &mut inner);
                if self.live {
                    inner.continues.push(self.delta(mark));
                }
                self.undo(mark);
                let continues = std::mem::take(&mut inner.continues);
                self.merge(Some(id), &continues);
                self.block(continuing, &mut Jumps::default());
                if self.live {
                    for (cell, phi) in headers {
                        let latch = self.state[cell];
                        if let Origin::Phi { operands, .. } =
                            &mut self.memory.versions[phi.index()].origin
                            && !operands.contains(&latch)
                        {
                            operands.push(latch);
                        }
                    }
                    if break_if.is_some() {
                        inner.breaks.push(self.delta(before));
                    }
                }
                self.undo(before);
                self.merge(Some(id), &inner.breaks);
                self.live &= live;
            }
            Statement::Break => {
                if self.live {
                    jumps.breaks.push(self.delta(jumps.break_mark));
                }
                self.live = false;
            }
            Statement::Continue => {
                if self.live {
                    jumps.continues.push(self.delta(jumps.continue_mark));
                }
                self.live = false;
            }
            Statement::Return { .. } => self.leave(),
            other => self.effect(id, other),
        }
    }

    /// A statement without blocks: what it reads, then what it writes.
    fn effect(&mut self, id: StmtId, statement: &Statement) {
        let (reads, writes) = self.touch.statement(statement);
        let mut seen: Vec<VersionId> = reads.iter().flat_map(|a| self.sees(&a.place)).collect();
        seen.sort_unstable();
        seen.dedup();
        if !seen.is_empty() {
            self.memory.reads.insert(id, seen);
        }
        let mut made: BTreeMap<CellIndex, Certainty> = BTreeMap::new();
        for access in &writes {
            let cells: Vec<CellIndex> = self
                .memory
                .overlapping(access.place.root, &access.place.path)
                .collect();
            for cell in cells {
                let whole = !access.place.dynamic
                    && self.memory.cells[cell].path.len() >= access.place.path.len();
                let certainty = if whole {
                    access.certainty
                } else {
                    Certainty::May
                };
                let slot = made.entry(cell).or_insert(certainty);
                *slot = (*slot).max(certainty);
            }
        }
        let mut versions = Vec::new();
        for (cell, certainty) in made {
            let over = (certainty == Certainty::May).then_some(self.state[cell]);
            let version = self.memory.add(cell, Origin::Written { by: id, over });
            self.define(cell, version);
            versions.push(version);
        }
        if !versions.is_empty() {
            self.memory.writes.insert(id, versions);
        }
    }

    fn leave(&mut self) {
        if self.live {
            let visible = self
                .memory
                .roots
                .iter()
                .filter(|(root, _)| !matches!(root, Root::Local(_)))
                .flat_map(|(_, range)| range.clone())
                .map(|cell| (cell, self.state[cell]))
                .collect();
            self.returns.push(visible);
        }
        self.live = false;
    }

    fn finish(mut self) -> Memory {
        let visible: Vec<CellIndex> = (0..self.memory.cells.len())
            .filter(|c| !matches!(self.memory.cells[*c].root, Root::Local(_)))
            .collect();
        for cell in visible {
            let mut operands: Vec<VersionId> = self
                .returns
                .iter()
                .filter_map(|d| d.get(&cell).copied())
                .collect();
            operands.sort_unstable();
            operands.dedup();
            let version = match operands.as_slice() {
                [] => continue,
                [one] => *one,
                _ => self.memory.add(cell, Origin::Phi { at: None, operands }),
            };
            self.memory.exit.insert(cell, version);
        }
        self.memory.footprint = footprint(&self.memory);
        self.memory
    }
}

/// What callers see: a cell is written if its exit version is not simply the initial one, certainly so if no path from the exit leads back to
/// the initial version; it is read if anything reads its initial version.
fn footprint(memory: &Memory) -> Footprint {
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
