//! Control dependence over the augmented flow of Ball and Horwitz, "Slicing Programs with Arbitrary
//! Control-flow" (1993).
//!
//! A jump (`break`, `continue`, `return`) is a pseudo-predicate. In addition to its real edge, it
//! has one to its lexical successor, which would run if the jump were deleted. With these edges,
//! post-dominance makes statements control-dependent on jumps, and a slice keeps the jumps that it
//! needs. `Kill` falls through: WGSL's discard is a demotion, so it affects observation and no
//! value.

use naga::{Block, Expression, Handle, Statement};
use petgraph::algo::dominators;
use petgraph::graph::{DiGraph, NodeIndex};
use petgraph::visit::{EdgeRef, IntoNodeIdentifiers};

use super::statements::{Statements, StmtId};

/// The predicates of each statement: they decide whether, or how often, it runs.
#[derive(Clone, Debug, Default)]
pub struct ControlDependence {
    on: Vec<Vec<StmtId>>,
    reachable: Vec<bool>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum FlowEdge {
    /// Control can go this way.
    Real,
    /// Control would go this way without the jump.
    FallThrough,
}

#[derive(Clone, Copy)]
struct Targets {
    on_break: Option<NodeIndex>,
    on_continue: Option<NodeIndex>,
}

struct Wiring<'s, 'p> {
    statements: &'s Statements<'p>,
    flow: DiGraph<Option<StmtId>, FlowEdge>,
    exit: NodeIndex,
    next: usize,
}

impl ControlDependence {
    /// Computes the control dependence of a function with this `body`.
    pub fn new(statements: &Statements<'_>, body: &Block) -> Self {
        let mut flow = DiGraph::with_capacity(statements.len() + 2, statements.len() * 2);
        for (id, _) in statements.iter() {
            flow.add_node(Some(id));
        }
        let exit = flow.add_node(None);
        let mut wiring = Wiring {
            statements,
            flow,
            exit,
            next: 0,
        };
        let entry = wiring.block(
            body,
            exit,
            Targets {
                on_break: None,
                on_continue: None,
            },
        );
        let Wiring { flow, .. } = wiring;
        let mut reversed = DiGraph::<(), ()>::with_capacity(flow.node_count(), flow.edge_count());
        for _ in flow.node_identifiers() {
            reversed.add_node(());
        }
        for edge in flow.edge_references() {
            reversed.add_edge(edge.target(), edge.source(), ());
        }
        let post = dominators::simple_fast(&reversed, exit);
        let mut on = vec![Vec::new(); statements.len()];
        for node in flow.node_identifiers() {
            let Some(predicate) = flow[node] else {
                continue;
            };
            if flow.neighbors(node).count() < 2 {
                continue;
            }
            let stop = post.immediate_dominator(node);
            for successor in flow.neighbors(node) {
                let mut runner = Some(successor);
                while runner != stop {
                    let Some(at) = runner else { break };
                    // A loop with a `break_if` in its latch is a predicate.
                    if at.index() < statements.len() {
                        on[at.index()].push(predicate);
                    } else if let Some(of) = flow[at]
                        && flow.neighbors(at).count() > 1
                    {
                        on[of.index()].push(predicate);
                    }
                    runner = post.immediate_dominator(at);
                }
            }
        }
        for list in &mut on {
            list.sort_unstable();
            list.dedup();
        }
        let mut reachable = vec![false; statements.len()];
        let mut stack = vec![entry];
        let mut seen = vec![false; flow.node_count()];
        while let Some(node) = stack.pop() {
            if std::mem::replace(&mut seen[node.index()], true) {
                continue;
            }
            if let Some(slot) = reachable.get_mut(node.index()) {
                *slot = true;
            }
            for edge in flow.edges(node) {
                if *edge.weight() == FlowEdge::Real {
                    stack.push(edge.target());
                }
            }
        }
        Self { on, reachable }
    }

    /// The predicates and jumps that a statement directly depends on. A `Loop` represents its
    /// `break_if`.
    pub fn of(&self, id: StmtId) -> &[StmtId] {
        &self.on[id.index()]
    }

    /// Whether control can reach a statement.
    pub fn is_reachable(&self, id: StmtId) -> bool {
        self.reachable[id.index()]
    }
}

impl Wiring<'_, '_> {
    /// Wires a block that continues at `follow`, and returns its first node. Visits statements in
    /// preorder.
    fn block(&mut self, block: &Block, follow: NodeIndex, targets: Targets) -> NodeIndex {
        let first = self.next;
        let mut at = first;
        // Statement numbers are the nodes, so one forward walk is enough.
        for (i, statement) in block.iter().enumerate() {
            let id = StmtId::from(at);
            let end = self.statements.get(id).end;
            let next = if i + 1 == block.len() {
                follow
            } else {
                NodeIndex::new(end.index())
            };
            self.next = at + 1;
            self.statement(id, statement, next, targets);
            at = end.index();
            self.next = at;
        }
        if block.is_empty() {
            follow
        } else {
            NodeIndex::new(first)
        }
    }

    fn edge(&mut self, from: NodeIndex, to: NodeIndex, flow: FlowEdge) {
        self.flow.add_edge(from, to, flow);
    }

    fn statement(&mut self, id: StmtId, statement: &Statement, next: NodeIndex, targets: Targets) {
        let node = NodeIndex::new(id.index());
        match statement {
            Statement::Block(block) => {
                let first = self.block(block, next, targets);
                self.edge(node, first, FlowEdge::Real);
            }
            Statement::If { accept, reject, .. } => {
                for block in [accept, reject] {
                    let first = self.block(block, next, targets);
                    self.edge(node, first, FlowEdge::Real);
                }
            }
            Statement::Switch { cases, .. } => {
                let inner = Targets {
                    on_break: Some(next),
                    ..targets
                };
                // A case starts at its first statement or, if empty, at its successor.
                let mut starts = vec![next; cases.len()];
                let mut at = self.next;
                let mut firsts = Vec::with_capacity(cases.len());
                for case in cases {
                    firsts.push(at);
                    if let Some(last) = case.body.len().checked_sub(1) {
                        for _ in 0..=last {
                            at = self.statements.get(StmtId::from(at)).end.index();
                        }
                    }
                }
                for (i, case) in cases.iter().enumerate().rev() {
                    let follow = match starts.get(i + 1) {
                        Some(start) if case.fall_through => *start,
                        _ => next,
                    };
                    starts[i] = if case.body.is_empty() {
                        follow
                    } else {
                        NodeIndex::new(firsts[i])
                    };
                    self.next = firsts[i];
                    self.block(&case.body, follow, inner);
                }
                for start in starts {
                    self.edge(node, start, FlowEdge::Real);
                }
            }
            Statement::Loop {
                body,
                continuing,
                break_if,
            } => {
                let latch = self.flow.add_node(Some(id));
                let mut continue_at = id.index() + 1;
                for _ in body.iter() {
                    continue_at = self.statements.get(StmtId::from(continue_at)).end.index();
                }
                let continue_to = if continuing.is_empty() {
                    latch
                } else {
                    NodeIndex::new(continue_at)
                };
                let first = self.block(
                    body,
                    continue_to,
                    Targets {
                        on_break: Some(next),
                        on_continue: Some(continue_to),
                    },
                );
                self.edge(node, first, FlowEdge::Real);
                self.next = continue_at;
                self.block(continuing, latch, targets);
                self.edge(latch, node, FlowEdge::Real);
                if break_if.is_some() {
                    self.edge(latch, next, FlowEdge::Real);
                } else if !leaves(body, BreakDepth::Here) {
                    // For an infinite loop, an artificial exit keeps post-dominance defined.
                    self.edge(latch, next, FlowEdge::FallThrough);
                }
            }
            Statement::Break => {
                self.edge(node, targets.on_break.unwrap_or(self.exit), FlowEdge::Real);
                self.edge(node, next, FlowEdge::FallThrough);
            }
            Statement::Continue => {
                self.edge(
                    node,
                    targets.on_continue.unwrap_or(self.exit),
                    FlowEdge::Real,
                );
                self.edge(node, next, FlowEdge::FallThrough);
            }
            Statement::Return { .. } => {
                self.edge(node, self.exit, FlowEdge::Real);
                self.edge(node, next, FlowEdge::FallThrough);
            }
            _ => self.edge(node, next, FlowEdge::Real),
        }
    }
}

/// The conditions that decide whether an iteration of a loop is its last one. Empty for other
/// statements.
pub fn exits(statement: &Statement) -> Vec<Handle<Expression>> {
    fn add(block: &Block, found: &mut Vec<Handle<Expression>>) {
        for statement in block {
            match statement {
                Statement::Block(inner) => add(inner, found),
                Statement::If {
                    condition,
                    accept,
                    reject,
                } => {
                    let blocks = [accept, reject];
                    if blocks.iter().any(|b| leaves(b, BreakDepth::Here)) {
                        found.push(*condition);
                        blocks.into_iter().for_each(|b| add(b, found));
                    }
                }
                _ => {}
            }
        }
    }
    let mut found = Vec::new();
    if let Statement::Loop { body, break_if, .. } = statement {
        add(body, &mut found);
        found.extend(*break_if);
    }
    found
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum BreakDepth {
    /// `break` leaves this loop.
    Here,
    /// `break` leaves an inner statement.
    Inner,
}

/// Whether some statement of a loop's body leaves the loop.
fn leaves(block: &Block, depth: BreakDepth) -> bool {
    block.iter().any(|s| match s {
        Statement::Return { .. } => true,
        Statement::Break => depth == BreakDepth::Here,
        Statement::Block(b) => leaves(b, depth),
        Statement::If { accept, reject, .. } => leaves(accept, depth) || leaves(reject, depth),
        Statement::Switch { cases, .. } => cases.iter().any(|c| leaves(&c.body, BreakDepth::Inner)),
        Statement::Loop {
            body, continuing, ..
        } => leaves(body, BreakDepth::Inner) || leaves(continuing, BreakDepth::Inner),
        _ => false,
    })
}
