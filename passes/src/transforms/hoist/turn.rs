//! Which values are another in each turn of a loop around them.

use std::collections::HashMap;

use naga::Statement;

use crate::analysis::values::{ContextId, Node, ValueId, Values};
use crate::graph::StmtId;
use crate::graph::memory::Origin;

/// For each value, whether it may differ from turn to turn of a loop it stands in, one around the calls that lead to it included: it rests on what the loop
/// carries from one turn to the next.
///
/// A value in a loop rests on what that loop carries by way of values in the loop, or it rests on what a loop around it carries, because nothing behind a
/// loop is seen in it but by another turn of one around. So each loop's merges are followed to their users no farther than the loop, outer loops first: what one
/// of them has reached, no loop in it has to look at again, and each value is passed once.
pub fn turning(values: &Values<'_, '_>) -> Vec<bool> {
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
    let mut turning = vec![false; values.values.len()];
    // The last loop that passed a value without a place of its own, which may be passed again for another.
    let mut passed: Vec<Option<LoopId>> = vec![None; values.values.len()];
    let mut outer_first: Vec<LoopId> = (0..places.loops.len()).collect();
    outer_first.sort_by_key(|l| places.loops[*l].depth);
    for this in outer_first {
        let mut work: Vec<ValueId> = Vec::new();
        for merge in std::mem::take(&mut merges[this]) {
            if !std::mem::replace(&mut turning[merge], true) {
                work.extend(&users[merge]);
            }
        }
        while let Some(id) = work.pop() {
            let is_new = match places.of[id] {
                Place::In(innermost) if places.is_in(innermost, this) => {
                    !std::mem::replace(&mut turning[id], true)
                }
                Place::In(_) => false,
                Place::Anywhere => passed[id]
                    .replace(this)
                    .is_none_or(|last: LoopId| last != this),
            };
            if is_new {
                work.extend(&users[id]);
            }
        }
    }
    turning
}

type LoopId = usize;

/// A loop as one chain of calls reaches it.
struct Loop {
    /// The loop around it, or around the call.
    outer: Option<LoopId>,
    /// How many there are around it.
    depth: usize,
}

#[derive(Clone, Copy)]
enum Place {
    /// The innermost loop around a value; `None` outside of all.
    In(Option<LoopId>),
    /// No statement evaluates it.
    Anywhere,
}

/// Where values stand among the loops.
struct Places {
    loops: Vec<Loop>,
    index: HashMap<(ContextId, StmtId), LoopId>,
    /// The innermost loop around each chain of calls.
    around: Vec<Option<LoopId>>,
    of: Vec<Place>,
}

impl Places {
    fn new(values: &Values<'_, '_>) -> Self {
        let mut this = Self {
            loops: Vec::new(),
            index: HashMap::new(),
            around: Vec::with_capacity(values.contexts.len()),
            of: Vec::with_capacity(values.values.len()),
        };
        // A context is made after the one it is called from.
        for context in &values.contexts {
            let around = context
                .call
                .and_then(|(caller, call)| this.innermost(values, caller, call));
            this.around.push(around);
        }
        for value in &values.values {
            let place = match &value.node {
                Node::Input(_) => Place::In(None),
                Node::Control(context, at) => Place::In(this.innermost(values, *context, *at)),
                Node::Expression(context, e, _) => {
                    match values.function(*context).statements.evaluated_at(*e) {
                        Some(at) => Place::In(this.innermost(values, *context, at)),
                        None => Place::Anywhere,
                    }
                }
                Node::Version(context, version) => {
                    match values.function(*context).memory.origin(*version) {
                        // A merge of a loop stands in what is around it: of its own turns it is a beginning, wherever it stands.
                        Origin::Written { by: at, .. } | Origin::Phi { at: Some(at), .. } => {
                            Place::In(this.innermost(values, *context, *at))
                        }
                        Origin::Initial | Origin::Phi { at: None, .. } => {
                            Place::In(this.around[*context])
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

    /// Whether a loop is another, or is in it.
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
