//! Finds values that change between iterations of an enclosing loop, values that depend on a loop
//! that may not end, and the guard under which loops end.

use std::collections::HashMap;

use naga::Statement;

use crate::analysis::reach::with_users;
use crate::analysis::values::{ContextId, Node, ValueId, Values};
use preshade_dataflow::graph::counted::{self, Ends};
use preshade_dataflow::graph::memory::Origin;
use preshade_dataflow::graph::{FunctionId, StmtId};
use preshade_plan::guard::{Assumed, Bounds, Guard};

/// For each value, whether it may differ between iterations of an enclosing loop, including loops
/// around the calls that lead to it.
///
/// Such a value depends on a loop-carried value through values in the same loop, or depends on a
/// loop-carried value of an outer loop. So we follow each loop's merges to their users within the
/// loop, outer loops first. An inner loop need not revisit values that an outer one reached, and
/// each value is visited once.
pub(crate) fn iterated(values: &Values<'_, '_>) -> Vec<bool> {
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

/// Whether the loops end that each value depends on, runs in, or has in the condition under which it runs.
pub(crate) struct LoopEnds {
    of: Vec<Ends>,
}

impl LoopEnds {
    pub fn new(values: &Values<'_, '_>) -> Self {
        let mut known = HashMap::new();
        let own: Vec<Ends> = (0..values.values.len())
            .map(|id| own_ends(values, id, &mut known))
            .collect();
        let mut of = vec![Ends::Always; own.len()];
        for ends in [Ends::Guarded, Ends::Unknown] {
            let from = (0..own.len()).filter(|id| own[*id] >= ends).collect();
            for (of, reached) in of.iter_mut().zip(with_users(values, from)) {
                if reached {
                    *of = ends;
                }
            }
        }
        let conditions = (0..own.len()).map(|id| values.condition(id));
        let conditions: Vec<Ends> = conditions
            .map(|c| c.map_or(Ends::Always, |c| of[c]))
            .collect();
        for (of, condition) in of.iter_mut().zip(conditions) {
            *of = (*of).max(condition);
        }
        Self { of }
    }

    /// Whether the loops of a value end, under a guard if one can bound them.
    pub fn may_end(&self, id: ValueId) -> bool {
        self.of[id] <= Ends::Guarded
    }

    /// The guard under which the loops of some values end, if they need one. It bounds every loop of the stage that it
    /// can: then [`Termination::Guarded`] may drop them.
    ///
    /// [`Termination::Guarded`]: preshade_dataflow::slice::Termination::Guarded
    pub fn guard(&self, values: &Values<'_, '_>, ids: &[ValueId]) -> Option<Guard> {
        if ids.iter().all(|id| self.of[*id] == Ends::Always) {
            return None;
        }
        let module = values.graph.module();
        let entry = FunctionId::EntryPoint(values.entry);
        let functions = values.graph.functions().iter();
        let functions = functions.filter(|f| values.graph.reaches(entry, f.id));
        let loops = functions.flat_map(|f| {
            let all = f.statements.iter();
            all.filter(|(_, node)| matches!(node.statement, Statement::Loop { .. }))
                .map(move |(at, _)| (f, at))
        });
        let bounds = loops
            .filter(|(f, at)| counted::ends(module, f, *at) == Ends::Guarded)
            .filter_map(|(f, at)| counted::uniform_bound(module, f, at));
        let values = bounds.map(|bound| Assumed {
            place: bound.place(),
            ty: bound.ty,
            name: bound.name,
            bounds: Bounds {
                low: 0.0,
                high: f64::from(counted::MOST_GUARDED),
            },
        });
        let each = values.map(|value| Guard {
            values: vec![value],
        });
        Some(each.fold(Guard::default(), Guard::and))
    }
}

/// Whether the loops around a value end, including those around the calls that lead to it. A merge
/// at a loop, and any value that a loop controls, is around that loop.
fn own_ends(
    values: &Values<'_, '_>,
    id: ValueId,
    known: &mut HashMap<(FunctionId, StmtId), Ends>,
) -> Ends {
    let module = values.graph.module();
    let mut place = match &values.values[id].node {
        Node::Version(context, v) => match values.function(*context).memory.origin(*v) {
            Origin::Phi { at: Some(at), .. } => Some((*context, *at)),
            _ => None,
        },
        Node::Control(context, at) => Some((*context, *at)),
        Node::Expression(..) => values.expression(id).map(|(context, _, at)| (context, at)),
        Node::Input(_) => None,
    };
    let mut worst = Ends::Always;
    let mut guarded = 0;
    while let Some((context, at)) = place {
        let f = values.function(context);
        for s in std::iter::once(at).chain(f.statements.ancestors(at)) {
            if matches!(f.statements.get(s).statement, Statement::Loop { .. }) {
                let of = known.entry((f.id, s));
                let of = *of.or_insert_with(|| counted::ends(module, f, s));
                guarded += u32::from(of == Ends::Guarded);
                worst = worst.max(of);
            }
        }
        place = values.contexts[context].call;
    }
    // A guard bounds each loop, and not the product of two.
    match guarded {
        0 | 1 => worst,
        _ => Ends::Unknown,
    }
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
    /// No statement evaluates it, so it may stand anywhere.
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
