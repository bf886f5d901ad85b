//! The backward slicer: finds the statements and expressions that an output, a discard or a value
//! depends on.
//!
//! This is Weiser's static slice, interprocedural and context-sensitive by demand. A callee is
//! sliced once for each distinct demand (results, pointees and effects), so calls with different
//! demands stay separate. A slice refers to statements and expressions of the original;
//! `preshade_passes::rebuild::place` builds a function from it.

use std::collections::{BTreeMap, BTreeSet};

use naga::{Binding, Expression, GlobalVariable, Handle, ShaderStage, Span, Statement};

use crate::graph::counted::{self, Ends};
use crate::graph::{Cell, FunctionId, Graph, StmtId};
use naga_edit::interface;
use preshade_plan::guard::Guard;

pub mod components;
pub mod fault;
mod function;
mod hash;
mod need;

pub use function::FunctionSlice;
pub use need::Need;

/// A target of a slice.
#[derive(Clone, Debug, PartialEq)]
pub enum Criterion {
    /// The outputs of the entry point with these bindings.
    Output(OutputFilter),
    /// One component, 0 to 3, of the outputs with these bindings. The others may have any value. A
    /// scalar output is its component 0.
    Component(OutputFilter, u32),
    /// Whether a fragment is discarded: every reachable `discard`, callees included.
    Discard,
    /// A value, on every path of calls from the entry point to its function.
    Value {
        function: FunctionId,
        expression: Handle<Expression>,
    },
}

/// Chooses outputs of an entry point.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum OutputFilter {
    All,
    Position,
    /// The depth a fragment stage writes.
    FragDepth,
    /// The outputs that rasterisation uses: position, point size, clip and cull distances, view
    /// index.
    Rasterization,
    Location(u32),
    /// The n-th output, in the order of [`naga_edit::interface::outputs`].
    Index(usize),
    /// The output with exactly this binding.
    Binding(Binding),
}

impl OutputFilter {
    fn accepts(&self, index: usize, binding: Option<&Binding>) -> bool {
        use naga::BuiltIn as B;
        match (self, binding) {
            (Self::All, _) => true,
            (Self::Index(i), _) => *i == index,
            (_, None) => false,
            (Self::Position, Some(b)) => matches!(b, Binding::BuiltIn(B::Position { .. })),
            (Self::FragDepth, Some(b)) => matches!(b, Binding::BuiltIn(B::FragDepth)),
            (Self::Rasterization, Some(b)) => matches!(
                b,
                Binding::BuiltIn(
                    B::Position { .. }
                        | B::PointSize
                        | B::ClipDistances
                        | B::CullDistance
                        | B::ViewIndex
                )
            ),
            (Self::Location(l), Some(b)) => {
                matches!(b, Binding::Location { location, .. } if location == l)
            }
            (Self::Binding(want), Some(b)) => want == b,
        }
    }
}

/// Whether a slice may drop a loop that affects none of its targets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Termination {
    /// Loops are assumed to end: correct if the original still runs too, as in the main pass after
    /// a pre-pass.
    #[default]
    Assumed,
    /// A loop that may not end is preserved, with all its control dependences, unless a guard can
    /// bound it. The plan then has that guard
    /// (`preshade_passes::analysis::loops::LoopEnds::guard`).
    Guarded,
    /// A loop that may not end is preserved, with all its control dependences.
    Preserved,
}

impl Termination {
    /// The setting for a stage whose plan has this guard.
    pub fn under(guard: Option<&Guard>) -> Self {
        match guard {
            Some(_) => Self::Guarded,
            None => Self::Preserved,
        }
    }

    /// Whether it keeps a loop.
    pub(crate) fn keeps(self, ends: Ends) -> bool {
        match self {
            Self::Assumed => false,
            Self::Guarded => ends > Ends::Guarded,
            Self::Preserved => ends > Ends::Always,
        }
    }
}

/// The part of a function that a caller needs.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Demand {
    /// The needed part of its result.
    pub result: Option<Need>,
    /// The cells whose exit values are needed: pointees of arguments, and globals.
    pub cells: BTreeSet<Cell>,
    /// Whether its discards are needed.
    pub discards: bool,
    /// Values that are needed, in it or its callees.
    pub values: BTreeSet<(FunctionId, Handle<Expression>)>,
}

/// The part of a function that one demand needs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Part {
    pub function: FunctionId,
    pub demand: Demand,
    pub kept: FunctionSlice,
    /// The part that each kept call uses, by index into [`Slice::parts`].
    pub calls: BTreeMap<StmtId, usize>,
    /// Whether it preserves everything, so that the function can be used unchanged.
    pub coverage: Coverage,
}

/// How much of a function a part keeps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Coverage {
    /// Everything with an effect.
    Whole,
    Partial,
}

/// A backward slice of an entry point.
#[derive(Clone, Debug, PartialEq)]
pub struct Slice {
    /// Index of the entry point.
    pub entry: usize,
    pub stage: ShaderStage,
    pub criteria: Vec<Criterion>,
    /// The functions, callees before callers; the entry point is the last.
    pub parts: Vec<Part>,
    /// Entry inputs needed, by index in the order of [`naga_edit::interface::inputs`].
    pub inputs: Vec<usize>,
    /// Entry outputs it computes, by index in the order of [`naga_edit::interface::outputs`].
    pub outputs: Vec<usize>,
    /// Global variables it reads or writes.
    pub globals: Vec<Handle<GlobalVariable>>,
    /// Static cost, in the units of [`crate::graph::cost`].
    pub cost: f64,
}

impl Slice {
    /// The entry point's part.
    pub fn root(&self) -> &Part {
        &self.parts[self.parts.len() - 1]
    }

    /// Hash of the canonical form, 16 hex digits. Equal computations have equal hashes, regardless
    /// of handles and names.
    pub fn hash(&self, graph: &Graph<'_>) -> String {
        hash::canonical(graph, self)
    }

    /// The first kept statement or expression in the source.
    pub fn first_span(&self, graph: &Graph<'_>) -> Option<Span> {
        let spans = self.parts.iter().flat_map(|part| {
            let f = graph.function(part.function);
            let statements = f.statements.iter().filter(|(id, n)| {
                part.kept.statements[id.index()] && naga_operands::blocks(n.statement).is_empty()
            });
            let expressions = f.function.expressions.iter().filter(|(e, _)| {
                part.kept.expressions[e.index()].is_some()
                    && f.statements.evaluated_at(*e).is_some()
            });
            let expressions = expressions.map(|(e, _)| f.function.expressions.get_span(e));
            statements.map(|(_, n)| n.span).chain(expressions)
        });
        let ranges = spans.filter_map(|span| Some((span, span.to_range()?)));
        let first = ranges.min_by_key(|(_, range)| (range.start, range.end));
        first.map(|(span, _)| span)
    }

    /// Whether it keeps all of the entry point.
    pub fn is_whole(&self) -> bool {
        self.root().coverage == Coverage::Whole
    }

    /// A kept loop that may not end, in any function. The slice drops discards, so the loop may run
    /// where the original has already left the shader.
    pub fn endless_loop(&self, graph: &Graph<'_>) -> Option<Span> {
        self.parts.iter().find_map(|part| {
            let f = graph.function(part.function);
            let found = f.statements.iter().find(|(id, n)| {
                part.kept.statements[id.index()]
                    && matches!(n.statement, Statement::Loop { .. })
                    && counted::ends(graph.module(), f, *id) > Ends::Always
            });
            found.map(|(_, n)| n.span)
        })
    }

    /// Number of kept statements over all functions, without `Emit`s.
    pub fn statement_count(&self, graph: &Graph<'_>) -> usize {
        self.parts
            .iter()
            .map(|part| {
                let f = graph.function(part.function);
                f.statements
                    .iter()
                    .filter(|(id, n)| {
                        part.kept.statements[id.index()]
                            && !matches!(n.statement, Statement::Emit(_))
                    })
                    .count()
            })
            .sum()
    }
}

/// The slice for `criteria` of an entry point, with [`Termination::Assumed`].
pub fn backward(graph: &Graph<'_>, entry: usize, criteria: &[Criterion]) -> Slice {
    backward_with(graph, entry, criteria, Termination::Assumed)
}

/// The slice for `criteria` of an entry point.
pub fn backward_with(
    graph: &Graph<'_>,
    entry: usize,
    criteria: &[Criterion],
    termination: Termination,
) -> Slice {
    let module = graph.module();
    let point = &module.entry_points[entry];
    let bindings = interface::outputs(module, &point.function);
    let mut demand = Demand::default();
    let mut outputs: BTreeMap<usize, Need> = BTreeMap::new();
    let mut decide = |filter: &OutputFilter, component: Option<u32>| {
        for (i, io) in bindings.iter().enumerate() {
            if filter.accepts(i, io.binding.as_ref()) {
                let need = match (component, &module.types[io.ty].inner) {
                    (Some(c), naga::TypeInner::Vector { .. }) => Need::member(c, Need::All),
                    _ => Need::All,
                };
                outputs
                    .entry(i)
                    .and_modify(|have| {
                        have.add(&need);
                    })
                    .or_insert(need);
            }
        }
    };
    for criterion in criteria {
        match criterion {
            Criterion::Output(filter) => decide(filter, None),
            Criterion::Component(filter, component) => decide(filter, Some(*component)),
            Criterion::Discard => demand.discards = true,
            Criterion::Value {
                function,
                expression,
            } => {
                demand.values.insert((*function, *expression));
            }
        }
    }
    let result_is_struct = point.function.result.as_ref().is_some_and(|r| {
        r.binding.is_none() && matches!(module.types[r.ty].inner, naga::TypeInner::Struct { .. })
    });
    for (output, need) in &outputs {
        let need = if result_is_struct {
            Need::member(*output as u32, need.clone())
        } else {
            need.clone()
        };
        Need::add_to(&mut demand.result, &need);
    }
    let mut slicer = function::Slicer::new(graph, termination);
    let mut parts = Vec::new();
    collect(
        graph,
        &mut slicer,
        FunctionId::EntryPoint(entry),
        &demand,
        &mut parts,
        &mut BTreeMap::new(),
    );
    let mut slice = Slice {
        entry,
        stage: point.stage,
        criteria: criteria.to_vec(),
        inputs: Vec::new(),
        outputs: outputs.into_keys().collect(),
        globals: Vec::new(),
        cost: 0.0,
        parts,
    };
    slice.inputs = inputs(graph, slice.root());
    slice.globals = globals(graph, &slice.parts);
    slice.cost = cost(graph, &slice.parts);
    slice
}

/// Adds the part for a demand after its callees' parts, unless it exists. Returns its index.
fn collect(
    graph: &Graph<'_>,
    slicer: &mut function::Slicer<'_, '_>,
    id: FunctionId,
    demand: &Demand,
    parts: &mut Vec<Part>,
    done: &mut BTreeMap<(FunctionId, Demand), usize>,
) -> usize {
    if let Some(index) = done.get(&(id, demand.clone())) {
        return *index;
    }
    let kept = (*slicer.slice(id, demand)).clone();
    let f = graph.function(id);
    let calls: BTreeMap<StmtId, usize> = kept
        .calls
        .iter()
        .filter_map(|(at, asked)| match f.statements.get(*at).statement {
            Statement::Call { function, .. } => Some((
                *at,
                collect(
                    graph,
                    slicer,
                    FunctionId::Function(*function),
                    asked,
                    parts,
                    done,
                ),
            )),
            _ => None,
        })
        .collect();
    let coverage = coverage(graph, id, demand, &kept, &calls, parts);
    // Different demands may keep the same statements, and then share a part.
    let same = parts.iter().position(|p| {
        p.function == id
            && p.calls == calls
            && p.demand.result == demand.result
            && p.kept.statements == kept.statements
            && p.kept.expressions == kept.expressions
    });
    let index = same.unwrap_or_else(|| {
        parts.push(Part {
            function: id,
            demand: demand.clone(),
            kept,
            calls,
            coverage,
        });
        parts.len() - 1
    });
    done.insert((id, demand.clone()), index);
    index
}

/// A part is whole if it keeps every statement with an effect, all their operands, and whole
/// callees.
fn coverage(
    graph: &Graph<'_>,
    id: FunctionId,
    demand: &Demand,
    kept: &FunctionSlice,
    calls: &BTreeMap<StmtId, usize>,
    parts: &[Part],
) -> Coverage {
    let f = graph.function(id);
    if f.function.result.is_some() && demand.result.is_none() {
        return Coverage::Partial;
    }
    let mut used = vec![false; kept.expressions.len()];
    for (at, node) in f.statements.iter() {
        match node.statement {
            Statement::Emit(_) | Statement::Block(_) => continue,
            // naga's `return` at the end of a function without result has no effect.
            Statement::Return { value: None }
                if node.parent.is_none() && node.end.index() == f.statements.len() =>
            {
                continue;
            }
            _ => {}
        }
        if !kept.statements[at.index()] {
            return Coverage::Partial;
        }
        if calls
            .get(&at)
            .is_some_and(|part| parts[*part].coverage == Coverage::Partial)
        {
            return Coverage::Partial;
        }
        for operand in naga_operands::of_statement(node.statement) {
            used[operand.index()] = true;
        }
    }
    let mut handles: Vec<_> = f.function.expressions.iter().collect();
    while let Some((e, expression)) = handles.pop() {
        if used[e.index()] {
            if kept.expressions[e.index()].is_none() {
                return Coverage::Partial;
            }
            for operand in naga_operands::of_expression(expression) {
                used[operand.index()] = true;
            }
        } else if matches!(expression, Expression::GlobalVariable(_))
            && f.statements.evaluated_at(e).is_none()
            && is_named_or_used(f.function, e)
        {
            // A dead `let` that reads a resource would keep its binding alive.
            return Coverage::Partial;
        }
    }
    if kept.arguments.iter().any(Option::is_none) {
        return Coverage::Partial;
    }
    Coverage::Whole
}

fn is_named_or_used(function: &naga::Function, global: Handle<Expression>) -> bool {
    function
        .expressions
        .iter()
        .any(|(_, e)| naga_operands::of_expression(e).contains(&global))
}

fn inputs(graph: &Graph<'_>, root: &Part) -> Vec<usize> {
    let module = graph.module();
    let function = graph.function(root.function).function;
    let mut inputs = Vec::new();
    let mut at = 0;
    for (argument, need) in function.arguments.iter().zip(&root.kept.arguments) {
        match &module.types[argument.ty].inner {
            naga::TypeInner::Struct { members, .. } if argument.binding.is_none() => {
                for i in 0..members.len() {
                    if need.as_ref().is_some_and(|n| n.of(i as u32).is_some()) {
                        inputs.push(at + i);
                    }
                }
                at += members.len();
            }
            _ => {
                if need.is_some() {
                    inputs.push(at);
                }
                at += 1;
            }
        }
    }
    inputs
}

fn cost(graph: &Graph<'_>, parts: &[Part]) -> f64 {
    let mut costs: Vec<f64> = Vec::new();
    for part in parts {
        let f = graph.function(part.function);
        let own = f.own_cost(
            graph.module(),
            |id| part.kept.statements[id.index()],
            |e| part.kept.expressions[e.index()].is_some(),
        );
        let calls: f64 = part
            .calls
            .iter()
            .map(|(at, callee)| costs[*callee] * f.times[at.index()])
            .sum();
        costs.push(own + calls);
    }
    costs.last().copied().unwrap_or_default()
}

fn globals(graph: &Graph<'_>, parts: &[Part]) -> Vec<Handle<GlobalVariable>> {
    let mut globals = BTreeSet::new();
    for part in parts {
        let function = graph.function(part.function).function;
        for (e, expression) in function.expressions.iter() {
            if let Expression::GlobalVariable(g) = expression
                && part.kept.expressions[e.index()].is_some()
            {
                globals.insert(*g);
            }
        }
    }
    globals.into_iter().collect()
}
