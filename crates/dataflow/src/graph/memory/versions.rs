//! The structured forward walk that numbers versions at writes and finds the versions that reads
//! see.

use std::collections::{BTreeMap, BTreeSet};

use naga::{Block, Expression, Handle, Statement, SwitchCase};

use super::touch::Touch;
use crate::graph::cells::{Place, Root};
use crate::graph::memory::{self, CellIndex, Certainty, Memory, Origin, VersionId};
use crate::graph::statements::{Statements, StmtId};

/// Numbers the versions of all cells of `memory`. Before, only the cells are filled in.
pub(super) fn number(
    touch: &Touch<'_, '_>,
    statements: &Statements<'_>,
    mut memory: Memory,
) -> Memory {
    // The cells each statement may write, for the headers of enclosing loops.
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
    let mut walk = VersionWalk {
        touch,
        statements,
        memory,
        defined,
        state,
        log: Vec::new(),
        live: true,
        next: 0,
        returns: Vec::new(),
    };
    walk.block(&touch.function.body, &mut Jumps::default());
    walk.leave();
    walk.finish()
}

/// The cells that changed since some earlier point.
type Delta = BTreeMap<CellIndex, VersionId>;

/// The states that leave a loop or switch early, each relative to its target's start.
#[derive(Default)]
struct Jumps {
    breaks: Vec<Delta>,
    continues: Vec<Delta>,
    break_mark: usize,
    continue_mark: usize,
}

struct VersionWalk<'a, 'f, 'p> {
    touch: &'a Touch<'a, 'f>,
    statements: &'a Statements<'p>,
    memory: Memory,
    defined: Vec<(StmtId, Vec<CellIndex>)>,
    state: Vec<VersionId>,
    /// The old value of each change to `state`, so that undoing a branch takes time proportional to
    /// its changes.
    log: Vec<(CellIndex, VersionId)>,
    live: bool,
    next: usize,
    returns: Vec<Delta>,
}

impl VersionWalk<'_, '_, '_> {
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

    /// Merges the paths of `deltas`, relative to the present state.
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

    /// Walks one of several alternative blocks, and undoes its changes. Returns them if control
    /// reaches the block's end.
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
            Statement::Switch { cases, .. } => self.switch(id, cases, jumps),
            Statement::Loop {
                body,
                continuing,
                break_if,
            } => self.merge_loop(id, body, continuing, *break_if),
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

    /// Each case starts from the state before the switch, or falls through from the case before.
    fn switch(&mut self, id: StmtId, cases: &[SwitchCase], jumps: &mut Jumps) {
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

    /// Every cell that the loop writes gets a merge at its header.
    fn merge_loop(
        &mut self,
        id: StmtId,
        body: &Block,
        continuing: &Block,
        break_if: Option<Handle<Expression>>,
    ) {
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
                if let Origin::Phi { operands, .. } = &mut self.memory.versions[phi.index()].origin
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

    /// A statement without blocks: its reads, then its writes.
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
        self.memory.footprint = memory::footprint(&self.memory);
        self.memory
    }
}
