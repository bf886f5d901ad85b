//! Finds values that change between iterations of an enclosing loop, and those that depend on a loop
//! that may not end.

use std::collections::HashMap;

use naga::Statement;

use crate::analysis::reach::with_users;
use crate::analysis::values::{ContextId, Node, ValueId, Values};
use crate::graph::memory::Origin;
use crate::graph::{FunctionId, StmtId, counted};

/// For each value, whether it may differ between iterations of an enclosing loop, including loops
/// around the calls that lead to it.
///
/// Such a value depends on a loop-carried value through values in the same loop, or depends on a
/// loop-carried value of an outer loop. So we follow each loop's merges to their users within the
/// loop, outer loops first. An inner loop need not revisit values that an outer one reached, and
/// each value is visited once.
pub fn iterated(values: &Values<'_, '_>) -> Vec<bool> {
    let places = Places::new(values);
    let mut merges: Vec<Vec<ValueId>> = vec![Vec::new(); places.loops.len()];
    for (id, value) in values.values.iter().enumerate() {
        if let Node::Version(context, version) = value.node
            && let Origin::Phi { at: Some(at), .. } =
                values.function(context).memory.origin(version)
            && let Some(merged) = places.index.get(&(context, *at))
        {
            merges[*merged].push(id);
        }
    }
    let users = values.users();
    let mut iterated = vec![false; values.values.len()];
    // The last loop that visited a value without a fixed place; another loop may visit it again.
    let mut passed: Vec<Option<LoopId>> = vec![None; values.values.len()];
    let mut outer_first: Vec<LoopId> = (0..places.loops.len()).collect();
    outer_first.sort_by_key(|l| places.loops[*l].depth);
    for this in outer_first {
        let mut work: Vec<ValueId> = Vec::new();
        for merge in std::mem::take(&mut merges[this]) {
            if !std::mem::replace(&mut iterated[merge], true) {
                work.extend(&users[merge]);
            }
        }
        while let Some(id) = work.pop() {
            let is_new = match places.of[id] {
                LoopPlace::In(innermost) if places.is_in(innermost, this) => {
                    !std::mem::replace(&mut iterated[id], true)
                }
                LoopPlace::In(_) => false,
                LoopPlace::Anywhere => passed[id]
                    .replace(this)
                    .is_none_or(|last: LoopId| last != this),
            };
            if is_new {
                work.extend(&users[id]);
            }
        }
    }
    iterated
}

/// Whether a statement runs in a loop without a known bound, or is called from one.
pub fn is_in_endless(values: &Values<'_, '_>, context: ContextId, at: StmtId) -> bool {
    let module = values.graph.module();
    let mut place = Some((context, at));
    while let Some((context, at)) = place {
        let f = values.function(context);
        let is_endless = |s: StmtId| {
            matches!(f.statements.get(s).statement, Statement::Loop { .. })
                && counted::trips(module, f, s).is_none()
        };
        if f.statements.ancestors(at).any(is_endless) {
            return true;
        }
        place = values.contexts[context].call;
    }
    false
}

/// Values that depend on a loop without a known bound.
pub fn endless(values: &Values<'_, '_>) -> Vec<bool> {
    let module = values.graph.module();
    let mut seen: HashMap<(FunctionId, StmtId), bool> = HashMap::new();
    let mut ends_unseen = |id: ValueId| {
        let (context, at) = match values.values[id].node {
            Node::Version(context, v) => match values.function(context).memory.origin(v) {
                Origin::Phi { at: Some(at), .. } => (context, *at),
                _ => return false,
            },
            Node::Control(context, at) => (context, at),
            _ => return false,
        };
        let f = values.function(context);
        std::iter::once(at)
            .chain(f.statements.ancestors(at))
            .any(|s| {
                matches!(f.statements.get(s).statement, Statement::Loop { .. })
                    && *seen
                        .entry((f.id, s))
                        .or_insert_with(|| counted::trips(module, f, s).is_none())
            })
    };
    let all = 0..values.values.len();
    let loops: Vec<ValueId> = all.filter(|id| ends_unseen(*id)).collect();
    with_users(values, loops)
}

type LoopId = usize;

/// A loop in one chain of calls.
struct Loop {
    /// The enclosing loop, possibly around the call.
    outer: Option<LoopId>,
    /// Number of enclosing loops.
    depth: usize,
}

#[derive(Clone, Copy)]
enum LoopPlace {
    /// The innermost enclosing loop; `None` outside of all loops.
    In(Option<LoopId>),
    /// No statement evaluates it.
    Anywhere,
}

/// The loops around each value.
struct Places {
    loops: Vec<Loop>,
    index: HashMap<(ContextId, StmtId), LoopId>,
    /// The innermost loop around each chain of calls.
    around: Vec<Option<LoopId>>,
    of: Vec<LoopPlace>,
}

impl Places {
    fn new(values: &Values<'_, '_>) -> Self {
        let mut this = Self {
            loops: Vec::new(),
            index: HashMap::new(),
            around: Vec::with_capacity(values.contexts.len()),
            of: Vec::with_capacity(values.values.len()),
        };
        // Contexts follow their callers.
        for context in &values.contexts {
            let around = context
                .call
                .and_then(|(caller, call)| this.innermost(values, caller, call));
            this.around.push(around);
        }
        for value in &values.values {
            let place = match &value.node {
                Node::Input(_) => LoopPlace::In(None),
                Node::Control(context, at) => LoopPlace::In(this.innermost(values, *context, *at)),
                Node::Expression(context, e, _) => {
                    match values.function(*context).statements.evaluated_at(*e) {
                        Some(at) => LoopPlace::In(this.innermost(values, *context, at)),
                        None => LoopPlace::Anywhere,
                    }
                }
                Node::Version(context, version) => {
                    match values.function(*context).memory.origin(*version) {
                        // A loop's merge belongs to the enclosing loop: it is where the iterations
                        // start.
                        Origin::Written { by: at, .. } | Origin::Phi { at: Some(at), .. } => {
                            LoopPlace::In(this.innermost(values, *context, *at))
                        }
                        Origin::Initial | Origin::Phi { at: None, .. } => {
                            LoopPlace::In(this.around[*context])
                        }
                    }
                }
            };
            this.of.push(place);
        }
        this
    }

    /// The innermost loop around a statement.
    fn innermost(
        &mut self,
        values: &Values<'_, '_>,
        context: ContextId,
        at: StmtId,
    ) -> Option<LoopId> {
        let statements = &values.function(context).statements;
        let mut loops = statements
            .ancestors(at)
            .filter(|a| matches!(statements.get(*a).statement, Statement::Loop { .. }));
        let Some(found) = loops.next() else {
            return self.around[context];
        };
        if let Some(known) = self.index.get(&(context, found)) {
            return Some(*known);
        }
        let outer = self.innermost(values, context, found);
        let depth = outer.map_or(0, |l| self.loops[l].depth + 1);
        let new = self.loops.len();
        self.loops.push(Loop { outer, depth });
        self.index.insert((context, found), new);
        Some(new)
    }

    /// Whether a loop equals or is inside another.
    fn is_in(&self, inner: Option<LoopId>, outer: LoopId) -> bool {
        let mut at = inner;
        while let Some(id) = at
            && self.loops[id].depth > self.loops[outer].depth
        {
            at = self.loops[id].outer;
        }
        at == Some(outer)
    }
}
