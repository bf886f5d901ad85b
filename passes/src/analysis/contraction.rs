//! Finds float operations that a compiler may round differently after branches and their
//! dependences are removed.
//!
//! No shading language fixes rounding. Without `NoContraction` (which naga never writes, and which
//! would change the original too) a driver may fuse `a * b + c`, reassociate, or turn a division by
//! a constant into a product. Its decision depends on the code around an operation:
//!
//! - the operand: `x + c` cannot be fused while `x` is a selection, but can after the branch is
//!   gone;
//! - other readers: some compilers fuse a product only into its single reader, and another reader
//!   may now be dead;
//! - the basic block: some compilers fuse only within a block, and removing a branch merges two
//!   blocks;
//! - constants: a known number may be multiplied out, or a factor of 1 dropped;
//! - iterations: if constants decide how many there are, a compiler may write them out one after
//!   the other, and fuse across them.
//!
//! So we compare pairs of an operation and the float operation that provides its operand, each with
//! everything it is computed from, by structure. If the original has the same pair with as many
//! other readers, and both programs have it in one block or neither has, a compiler that looks that
//! far sees no difference. For any other pair the bits are open: it is *exposed*. No text can do
//! better. Anything that separates two operations for one compiler also separates them for a
//! compiler that would have fused them in the original.

use std::collections::hash_map::DefaultHasher;
use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::hash::{Hash, Hasher};

use naga::{
    Binding, BuiltIn, Expression, Handle, Literal, MathFunction, ScalarKind, ShaderStage, Span,
    Statement,
};

use crate::analysis::operations::discontinuity;
use crate::analysis::reach::{with_operands, with_users};
use crate::analysis::values::{ContextId, Node, TooLarge, ValueId, Values};
use preshade_dataflow::graph::memory::Origin;
use preshade_dataflow::graph::rate::Rate;
use preshade_dataflow::graph::{FunctionGraph, FunctionId, Graph, control};
use preshade_dataflow::slice::{Need, Slice};
use preshade_plan::contract::Surface;
use preshade_plan::plan::GpuPass;
use preshade_plan::program::Program;

mod rewritten;

/// Depth to which we compare an operation's computation. Compilers do not see differences further
/// down.
const DEPTH: usize = 16;

/// Most copies to follow from an operand.
const MOST_COPIES: usize = 64;

/// Operations that may round differently.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Exposed {
    /// Number of operations in both stages.
    pub roundings: u32,
    /// The affected surface, if a decision depends on them.
    pub decides: Option<Surface>,
}

/// Compares the stages of a pass before and after. `folded` are operations of the original that
/// were removed as neutral; their dependents may round differently too.
pub(crate) fn exposed(
    before: &Program,
    after: &Program,
    pass: &GpuPass,
    folded: &BTreeSet<(FunctionId, Handle<Expression>)>,
) -> Exposed {
    let mut total = Exposed::default();
    let mut surface = Surface::Kept;
    let mut varyings = BTreeSet::new();
    let mut decides = false;
    let vertex = stages(before, after, ShaderStage::Vertex, Some(&pass.vertex));
    if let Some([(before, entry), (after, other)]) = vertex {
        let [a, b] = [Graph::build(before), Graph::build(after)];
        let Ok([a, b]) = looked([(&a, entry), (&b, other)]) else {
            return anything(&b, other);
        };
        let found = b.new_to(&a);
        let folded = a.of(folded);
        total.roundings += (found.len() + folded.len()) as u32;
        for output in a.outputs_of(folded).into_iter().chain(b.outputs_of(found)) {
            match output {
                Some(Binding::BuiltIn(BuiltIn::Position { .. })) => surface = Surface::Rounded,
                Some(Binding::Location { location, .. }) => {
                    varyings.insert(location);
                }
                // A clip distance decides.
                _ => decides = true,
            }
        }
    }
    let fragment = stages(
        before,
        after,
        ShaderStage::Fragment,
        pass.fragment.as_deref(),
    );
    if let Some([(before, entry), (after, other)]) = fragment {
        let [a, b] = [Graph::build(before), Graph::build(after)];
        let Ok([a, b]) = looked([(&a, entry), (&b, other)]) else {
            return anything(&b, other);
        };
        let mut found = b.new_to(&a);
        let folded = a.of(folded);
        total.roundings += (found.len() + folded.len()) as u32;
        decides |= a.decides(&a.reached(folded));
        // The vertex stage's outputs may round differently too; if the surface moves, so do all
        // interpolated values.
        found.extend(b.inputs(&|binding| match binding {
            Binding::Location { location, .. } => {
                surface == Surface::Rounded || varyings.contains(location)
            }
            Binding::BuiltIn(BuiltIn::Position { .. }) => surface == Surface::Rounded,
            Binding::BuiltIn(_) => false,
        }));
        let reached = b.reached(found);
        decides |= b.decides(&reached);
    }
    if decides || surface == Surface::Rounded {
        total.decides = Some(surface);
    }
    total
}

/// The result for a stage that is too large: every operation may round differently and decide
/// anything.
fn anything(graph: &Graph<'_>, entry: usize) -> Exposed {
    Exposed {
        roundings: graph.entry_cost(entry).ceil() as u32,
        decides: Some(Surface::Rounded),
    }
}

type EntryStage<'p> = (&'p Program, usize);

fn stages<'p>(
    before: &'p Program,
    after: &'p Program,
    stage: ShaderStage,
    name: Option<&str>,
) -> Option<[EntryStage<'p>; 2]> {
    let find = |program: &'p Program| Some((program, program.entry_point(stage, name?)?.0));
    Some([find(before)?, find(after)?])
}

fn looked<'g, 'p>([a, b]: [(&'g Graph<'p>, usize); 2]) -> Result<[Looked<'g, 'p>; 2], TooLarge> {
    Ok([Looked::new(a.0, a.1)?, Looked::new(b.0, b.1)?])
}

/// The reader that represents the stage's outputs.
const OUTPUT: ValueId = usize::MAX;

/// The values of a stage as operations. Copies count as the value that they copy.
#[derive(Clone, Copy)]
struct Operations<'v, 'g, 'p> {
    values: &'v Values<'g, 'p>,
    /// Whether operations that a compiler sees through count as copies.
    sees_modifiers: bool,
}

impl<'g, 'p> Operations<'_, 'g, 'p> {
    fn function(&self, context: ContextId) -> &'g FunctionGraph<'p> {
        self.values.function(context)
    }

    fn whole(&self, id: ValueId) -> Option<(ContextId, &'g Expression)> {
        match &self.values.values[id].node {
            Node::Expression(context, e, _) => {
                Some((*context, &self.function(*context).function.expressions[*e]))
            }
            _ => None,
        }
    }

    /// Whether it rounds, or is part of an operation that does.
    fn is_arithmetic(&self, id: ValueId) -> bool {
        let Some((context, expression)) = self.whole(id) else {
            return false;
        };
        let f = self.function(context);
        let module = self.values.graph.module();
        let is_float = |e: Handle<Expression>| {
            let scalar = f.ty(module, e).scalar();
            scalar.is_some_and(|s| s.kind == ScalarKind::Float)
        };
        match expression {
            Expression::Binary { left, op, .. } => {
                use naga::BinaryOperator as B;
                is_float(*left)
                    && matches!(
                        op,
                        B::Add | B::Subtract | B::Multiply | B::Divide | B::Modulo
                    )
            }
            Expression::Unary { expr, .. } => is_float(*expr),
            // These end in a product with a constant.
            Expression::Math {
                fun:
                    MathFunction::Unpack4x8unorm
                    | MathFunction::Unpack4x8snorm
                    | MathFunction::Unpack2x16unorm
                    | MathFunction::Unpack2x16snorm,
                ..
            } => true,
            Expression::Math { arg, .. } => is_float(*arg),
            _ => false,
        }
    }

    /// The values that this one is a copy of, wholly or in part; none if it is not a copy or is a
    /// selection.
    fn copied(&self, id: ValueId) -> impl Iterator<Item = ValueId> + Clone {
        let value = &self.values.values[id];
        let is_data = |o: &ValueId| !matches!(self.values.values[*o].node, Node::Control(..));
        let data = value.operands.iter().copied().filter(is_data);
        let is_copy = match &value.node {
            Node::Input(_) | Node::Control(..) => false,
            Node::Version(..) => data.clone().count() == 1,
            Node::Expression(..) if self.sees_modifiers && self.is_modifier(id) => true,
            Node::Expression(..) => match self.whole(id).map(|(_, e)| e) {
                Some(Expression::CallResult(_)) => data.clone().count() == 1,
                Some(
                    Expression::Load { .. }
                    | Expression::Compose { .. }
                    | Expression::Access { .. }
                    | Expression::AccessIndex { .. }
                    | Expression::Swizzle { .. }
                    | Expression::Splat { .. },
                ) => true,
                _ => false,
            },
        };
        data.take(if is_copy { usize::MAX } else { 0 })
    }

    /// The operand behind all copies.
    fn sources(&self, operand: ValueId) -> Vec<ValueId> {
        let (mut found, mut seen) = (Vec::new(), Vec::new());
        let mut work = vec![operand];
        while let Some(id) = work.pop() {
            if seen.contains(&id) || seen.len() == MOST_COPIES {
                continue;
            }
            seen.push(id);
            let before = work.len();
            work.extend(self.copied(id));
            if work.len() == before {
                found.push(id);
            }
        }
        found
    }

    /// Whether a reader behind all copies is such a one: an operation, a merge, a decision, or
    /// [`OUTPUT`]. `is` may see one several times, each time with the copy that it reads.
    fn any_reader(&self, id: ValueId, mut is: impl FnMut(ValueId, ValueId) -> bool) -> bool {
        let (mut seen, mut work) = (Vec::new(), vec![id]);
        while let Some(at) = work.pop() {
            if self.values.roots.binary_search(&at).is_ok() && is(OUTPUT, at) {
                return true;
            }
            for user in &self.values.users()[at] {
                if !self.copied(*user).any(|of| of == at) {
                    if is(*user, at) {
                        return true;
                    }
                } else if seen.len() < MOST_COPIES && !seen.contains(user) {
                    seen.push(*user);
                    work.push(*user);
                }
            }
        }
        false
    }

    /// The number of readers behind all copies.
    fn readers(&self, id: ValueId) -> usize {
        let mut found = BTreeSet::new();
        self.any_reader(id, |reader, _| {
            found.insert(reader);
            false
        });
        found.len()
    }

    /// Whether there are several readers behind all copies.
    fn is_shared(&self, id: ValueId) -> bool {
        let mut first = None;
        self.any_reader(id, |reader, _| *first.get_or_insert(reader) != reader)
    }

    /// Whether the last step of an operation may be a product or a sum, which a compiler can fuse
    /// into a reader. The other functions end in an instruction of their own.
    fn may_fuse(&self, id: ValueId) -> bool {
        use naga::MathFunction as F;
        let is_own = match self.whole(id) {
            Some((context, Expression::Math { fun, arg1, .. })) => match fun {
                F::Floor
                | F::Ceil
                | F::Round
                | F::Trunc
                | F::Sign
                | F::Step
                | F::Sin
                | F::Cos
                | F::Exp
                | F::Exp2
                | F::InverseSqrt
                | F::Ldexp => true,
                // A compiler writes a power by a known number as products.
                F::Pow => !arg1.is_some_and(|power| self.is_const(context, power)),
                _ => false,
            },
            _ => false,
        };
        self.is_arithmetic(id) && !is_own
    }

    /// Whether an operation adds an operand to something, or subtracts it, before anything else. Only
    /// there does a compiler merge the operand into it: a product into a multiply-add, a sum into a
    /// longer sum, `mix` into either.
    fn begins_with_sum(&self, id: ValueId) -> bool {
        use naga::{BinaryOperator as B, MathFunction as F};
        let adds = |e: &Expression| match e {
            Expression::Binary { op, .. } => matches!(op, B::Add | B::Subtract | B::Modulo),
            Expression::Math { fun, .. } => matches!(
                fun,
                F::Fma
                    | F::Mix
                    | F::SmoothStep
                    | F::Distance
                    | F::Fract
                    | F::Modf
                    | F::Reflect
                    | F::Refract
                    | F::Asin
                    | F::Acos
                    | F::Asinh
                    | F::Acosh
                    | F::Atanh
            ),
            _ => false,
        };
        self.is_arithmetic(id) && self.whole(id).is_some_and(|(_, e)| adds(e))
    }

    /// The conditions that end a loop, if a value merges its iterations.
    fn exits(&self, id: ValueId) -> Vec<ValueId> {
        let named = |(context, e)| self.values.named(context, e);
        let exits = self.merged_by(id).into_iter();
        let exits =
            exits.flat_map(|(context, s)| control::exits(s).into_iter().map(move |e| (context, e)));
        let mut found: Vec<ValueId> = exits.filter_map(named).collect();
        // `a && b` is a variable that a branch on `a` writes.
        let mut next = 0;
        while next < found.len() && found.len() < MOST_COPIES {
            let merges = self.sources(found[next]);
            let branches = merges.iter().filter_map(|m| self.merged_by(*m));
            let conditions = branches.filter_map(|(context, s)| match s {
                Statement::If { condition, .. } => named((context, *condition)),
                _ => None,
            });
            for condition in conditions {
                if !found.contains(&condition) {
                    found.push(condition);
                }
            }
            next += 1;
        }
        found
    }

    /// The statement whose ends a value merges.
    fn merged_by(&self, id: ValueId) -> Option<(ContextId, &'p Statement)> {
        let Node::Version(context, version) = self.values.values[id].node else {
            return None;
        };
        let f = self.function(context);
        match f.memory.origin(version) {
            Origin::Phi { at: Some(at), .. } => Some((context, f.statements.get(*at).statement)),
            _ => None,
        }
    }

    /// Structural hash of each value to [`DEPTH`], by Weisfeiler-Lehman refinement, which handles
    /// loops.
    fn hashed(&self) -> Vec<u64> {
        let values = &self.values.values;
        let exits: Vec<Vec<ValueId>> = (0..values.len()).map(|id| self.exits(id)).collect();
        let tags: Vec<u64> = (0..values.len()).map(|id| self.tag(id)).collect();
        // Copies get the hash of their source, so that removed copies leave no trace.
        let through: Vec<ValueId> = (0..values.len()).map(|id| self.through(id)).collect();
        let mut hashes = tags.clone();
        for _ in 0..DEPTH {
            let next = |id: ValueId| {
                let operands = values[id].operands.iter().chain(&exits[id]);
                let mut of: Vec<u64> = operands.map(|o| hashes[*o]).collect();
                of.sort_unstable();
                hash(&(tags[id], of))
            };
            let round: Vec<u64> = (0..values.len()).map(|id| next(through[id])).collect();
            hashes = round;
        }
        hashes
    }

    fn through(&self, id: ValueId) -> ValueId {
        let mut at = id;
        for _ in 0..MOST_COPIES {
            let is_copy = match &self.values.values[at].node {
                Node::Version(..) => true,
                _ => matches!(
                    self.whole(at),
                    Some((_, Expression::CallResult(_) | Expression::Load { .. }))
                ),
            };
            let mut copied = self.copied(at);
            match (copied.next(), copied.next()) {
                (Some(one), None) if is_copy => at = one,
                _ => break,
            }
        }
        at
    }

    fn tag(&self, id: ValueId) -> u64 {
        let module = self.values.graph.module();
        match &self.values.values[id].node {
            Node::Input(i) => {
                let io = self.values.inputs.get(*i);
                hash(&format!("{:?}", io.and_then(|io| io.binding.as_ref())))
            }
            Node::Version(..) => hash("merge"),
            Node::Control(..) => hash("control"),
            Node::Expression(context, e, path) => {
                let f = self.values.function(*context);
                let ty = match f.ty(module, *e) {
                    naga::TypeInner::Struct { .. } | naga::TypeInner::Array { .. } => String::new(),
                    inner => format!("{inner:?}"),
                };
                hash(&(written(f, module, *e), ty, path))
            }
        }
    }

    fn is_const(&self, context: ContextId, e: Handle<Expression>) -> bool {
        let value = self.values.named(context, e);
        value.is_none_or(|id| self.values.values[id].fact.rate == Rate::Const)
    }

    /// Whether a compiler may drop an operation, or move another through it: it is an input modifier
    /// (`abs`), or one of its operands where their ranges decide.
    fn is_modifier(&self, id: ValueId) -> bool {
        use naga::MathFunction as F;
        match self.whole(id) {
            Some((_, Expression::Math { fun, .. })) => {
                matches!(fun, F::Abs | F::Min | F::Max | F::Clamp | F::Saturate)
            }
            Some((_, Expression::Select { .. } | Expression::Unary { .. })) => true,
            _ => false,
        }
    }
}

/// Values that another of the same structure equals. A compiler computes both once.
pub(crate) fn twins(values: &Values<'_, '_>) -> Vec<bool> {
    let operations = Operations {
        values,
        sees_modifiers: false,
    };
    let hashes = operations.hashed();
    let mut count: BTreeMap<u64, usize> = BTreeMap::new();
    for hash in &hashes {
        *count.entry(*hash).or_default() += 1;
    }
    hashes.iter().map(|hash| count[hash] > 1).collect()
}

/// Values of a stage that may have other bits, or give their readers other bits, if another stage
/// computes them.
///
/// A compiler may fuse an operation into a reader, as it fuses a product into a sum, or rewrite
/// both ([`rewritten`]), if it sees both. It no longer sees the readers of a value that moves.
/// Inside of the stage that computes it, it sees fewer readers of the value's operands. And it may
/// see how an input was computed.
pub(crate) fn unsteady(values: &Values<'_, '_>) -> Vec<bool> {
    let operations = Operations {
        values,
        sees_modifiers: true,
    };
    let all = 0..values.values.len();
    let may_fuse: Vec<bool> = all.clone().map(|id| operations.may_fuse(id)).collect();
    let sources: Vec<Vec<ValueId>> = all.clone().map(|id| operations.sources(id)).collect();
    let mut shared = vec![None; values.values.len()];
    let mut is_shared = |id: ValueId| *shared[id].get_or_insert_with(|| operations.is_shared(id));
    let mut work = Vec::new();
    for id in all.clone().filter(|id| operations.is_arithmetic(*id)) {
        let operands = values.values[id].operands.iter();
        let mut read = operands.flat_map(|o| &sources[*o]);
        let rounds_anew = |source: &ValueId| match values.values[*source].node {
            Node::Input(_) => true,
            _ => may_fuse[*source] && is_shared(*source),
        };
        if read.any(rounds_anew)
            || operations
                .rewritten_with(id)
                .into_iter()
                .any(&mut is_shared)
        {
            work.push(id);
        }
    }
    let mut found = with_users(values, work);
    for id in all {
        let may = sources[id].iter().any(|source| may_fuse[*source]);
        found[id] = found[id]
            || operations.is_rewritten(id)
            || may && operations.any_reader(id, |r, _| r != OUTPUT && operations.is_arithmetic(r));
    }
    found
}

/// The operations of a stage that may round differently if the stage no longer computes some of its
/// values.
///
/// A compiler may fuse a product into a sum, regroup two sums, or write two powers as one
/// ([`rewritten`]), if nothing else reads the first (Mesa's `is_used_once`, for one), or if all its
/// readers can take it in. So an operation is listed if an operand that it may take in loses
/// another reader, and only such operations read the operand then. Values of the same structure
/// count as one, because a compiler computes them once.
pub(crate) struct Pruned<'v, 'g, 'p> {
    operations: Operations<'v, 'g, 'p>,
    /// The operands of each operation that may be fused into it.
    fused: Vec<(ValueId, Vec<ValueId>)>,
    /// The operations that may be rewritten with a source, each with the source's hash.
    rewritten: BTreeSet<(ValueId, u64)>,
    /// All values of the same structure as one that may be fused.
    twins: BTreeMap<u64, Vec<ValueId>>,
    hashes: Vec<u64>,
}

impl<'v, 'g, 'p> Pruned<'v, 'g, 'p> {
    pub(crate) fn new(values: &'v Values<'g, 'p>) -> Self {
        let operations = Operations {
            values,
            sees_modifiers: true,
        };
        let all = 0..values.values.len();
        let is_open =
            |id: &ValueId| operations.may_fuse(*id) && values.values[*id].fact.rate != Rate::Const;
        let readers = all.clone().filter(|id| operations.begins_with_sum(*id));
        let sums = readers.map(|id| {
            let operands = values.values[id].operands.iter();
            let sources = operands.flat_map(|o| operations.sources(*o));
            (id, sources.filter(is_open).collect::<Vec<_>>())
        });
        let changes = |id: &ValueId| values.values[*id].fact.rate != Rate::Const;
        let rewritten: Vec<(ValueId, Vec<ValueId>)> = all
            .clone()
            .map(|id| {
                let sources = operations.rewritten_with(id).into_iter();
                (id, sources.filter(changes).collect::<Vec<_>>())
            })
            .collect();
        let fused: Vec<(ValueId, Vec<ValueId>)> = sums
            .chain(rewritten.iter().cloned())
            .filter(|(_, sources)| !sources.is_empty())
            .collect();
        let hashes = match fused.is_empty() {
            true => Vec::new(),
            false => operations.hashed(),
        };
        let mut twins: BTreeMap<u64, Vec<ValueId>> = BTreeMap::new();
        let sources: BTreeSet<ValueId> = fused.iter().flat_map(|(_, s)| s).copied().collect();
        let known: BTreeSet<u64> = sources.iter().map(|id| hashes[*id]).collect();
        for id in all.filter(|id| !fused.is_empty() && known.contains(&hashes[*id])) {
            twins.entry(hashes[id]).or_default().push(id);
        }
        let pairs = rewritten.iter().flat_map(|(id, sources)| {
            let sources = sources.iter();
            sources.map(|source| (*id, hashes[*source]))
        });
        let rewritten = pairs.collect();
        Self {
            operations,
            fused,
            rewritten,
            twins,
            hashes,
        }
    }

    /// The affected operations among those that stay. `is_returned`: whether the stage still
    /// returns this value, which it returned before.
    pub(crate) fn rounded_anew(
        &self,
        is_kept: impl Fn(ValueId) -> bool,
        is_returned: impl Fn(ValueId) -> bool,
    ) -> Vec<ValueId> {
        let is_lost = |reader: ValueId, copy: ValueId| match reader {
            OUTPUT => !is_returned(copy),
            reader => !is_kept(reader),
        };
        let loses_readers = |hash: u64| {
            let (mut loses, mut keeps_another) = (false, false);
            for twin in &self.twins[&hash] {
                if !is_kept(*twin) {
                    loses = true;
                    continue;
                }
                self.operations.any_reader(*twin, |reader, copy| {
                    match is_lost(reader, copy) {
                        true => loses = true,
                        false => {
                            let joins = self.rewritten.contains(&(reader, hash))
                                || (reader != OUTPUT && self.operations.begins_with_sum(reader));
                            keeps_another |= !joins;
                        }
                    }
                    false
                });
            }
            loses && !keeps_another
        };
        let mut found: BTreeMap<u64, bool> = BTreeMap::new();
        let mut may_merge = |source: &ValueId| {
            let hash = self.hashes[*source];
            *found.entry(hash).or_insert_with(|| loses_readers(hash))
        };
        let kept = self.fused.iter().filter(|(id, _)| is_kept(*id));
        let anew = kept.filter(|(_, sources)| {
            let mut computed = sources.iter().filter(|source| is_kept(**source));
            computed.any(&mut may_merge)
        });
        anew.map(|(id, _)| *id).collect()
    }
}

/// The first operation of a slice that may round differently than in the whole stage, because the
/// slice lacks other readers of its operands; only if coverage, depth or an output at `locations`
/// depends on it.
///
/// # Errors
/// The stage is too large to analyse.
pub(crate) fn rounded_in_slice(
    graph: &Graph<'_>,
    slice: &Slice,
    locations: &BTreeSet<u32>,
) -> Result<Option<Span>, TooLarge> {
    let values = Values::new(graph, slice.entry)?;
    let all = &values.values;
    let mut kept: BTreeMap<FunctionId, Vec<&[Option<Need>]>> = BTreeMap::new();
    for part in &slice.parts {
        let expressions = kept.entry(part.function).or_default();
        expressions.push(&part.kept.expressions);
    }
    let outputs = values.outputs();
    let decided = outputs.iter().filter(|(binding, _)| {
        matches!(binding, Some(Binding::Location { location, .. }) if locations.contains(location))
    });
    let roots = values
        .coverage
        .iter()
        .copied()
        .chain(decided.map(|(_, root)| *root))
        .collect();
    let returned: BTreeSet<ValueId> = slice
        .outputs
        .iter()
        .filter_map(|i| outputs.get(*i).map(|(_, root)| *root))
        .collect();
    let decides = with_operands(&values, roots);
    let is_kept = |id: ValueId| match all[id].node {
        Node::Expression(context, e, _) => {
            let parts = kept.get(&values.contexts[context].function);
            let needs = |part: &&[Option<Need>]| part.get(e.index()).is_some_and(Option::is_some);
            parts.is_some_and(|parts| parts.iter().any(needs))
        }
        _ => true,
    };
    let anew = Pruned::new(&values).rounded_anew(is_kept, |copy| returned.contains(&copy));
    let found = anew.into_iter().find(|id| decides[*id]);
    Ok(found.and_then(|id| match all[id].node {
        Node::Expression(context, e, _) => {
            let function = values.function(context).function;
            Some(function.expressions.get_span(e))
        }
        _ => None,
    }))
}

/// An operation and the provider of its operand, as a compiler sees them.
type Pair = (u64, u64, bool, usize);

struct Looked<'g, 'p> {
    values: Values<'g, 'p>,
    /// A structural hash of each value.
    hashes: Vec<u64>,
    /// Functions with more than one basic block, calls included.
    branches: BTreeSet<FunctionId>,
    /// The number of each statement's basic block, by function.
    blocks: BTreeMap<FunctionId, Vec<usize>>,
}

impl<'g, 'p> Looked<'g, 'p> {
    fn new(graph: &'g Graph<'p>, entry: usize) -> Result<Self, TooLarge> {
        let values = Values::new(graph, entry)?;
        let (branches, blocks) = blocks(graph, FunctionId::EntryPoint(entry));
        let operations = Operations {
            values: &values,
            sees_modifiers: false,
        };
        Ok(Self {
            hashes: operations.hashed(),
            values,
            branches,
            blocks,
        })
    }

    fn operations(&self) -> Operations<'_, 'g, 'p> {
        Operations {
            values: &self.values,
            sees_modifiers: false,
        }
    }

    fn pairs(&self) -> Vec<(ValueId, Pair)> {
        let mut all = Vec::new();
        let operations = self.operations();
        for id in (0..self.values.values.len()).filter(|id| operations.is_arithmetic(*id)) {
            for operand in &self.values.values[id].operands {
                for source in operations.sources(*operand) {
                    let pair = match operations.is_arithmetic(source) {
                        true => (
                            self.hashes[source],
                            self.hashes[id],
                            self.block(source) == self.block(id),
                            operations.readers(source),
                        ),
                        // A constant may be multiplied out by itself, and an iteration written out behind another.
                        false
                            if self.is_constant(source) || !operations.exits(source).is_empty() =>
                        {
                            (self.hashes[source], self.hashes[id], true, 0)
                        }
                        false => continue,
                    };
                    all.push((id, pair));
                }
            }
        }
        all
    }

    /// The operations with a pair that `before` lacks.
    fn new_to(&self, before: &Self) -> BTreeSet<ValueId> {
        let known: HashSet<Pair> = before.pairs().into_iter().map(|(_, p)| p).collect();
        let mine = self.pairs().into_iter();
        mine.filter(|(_, pair)| !known.contains(pair))
            .map(|(id, _)| id)
            .collect()
    }

    fn is_constant(&self, id: ValueId) -> bool {
        let constant = |e| {
            matches!(
                e,
                &(Expression::Literal(_) | Expression::Constant(_) | Expression::ZeroValue(_))
            )
        };
        match self.values.values[id].node {
            // A variable without stores so far.
            Node::Version(..) => self.values.values[id].operands.is_empty(),
            _ => self
                .operations()
                .whole(id)
                .is_some_and(|(_, e)| constant(e)),
        }
    }

    /// The basic block of a value. A function without branches belongs to its caller's block.
    fn block(&self, id: ValueId) -> Option<(ContextId, usize)> {
        let Node::Expression(mut context, e, _) = self.values.values[id].node else {
            return None;
        };
        let mut at = self.values.function(context).statements.evaluated_at(e)?;
        loop {
            let function = self.values.contexts[context].function;
            match self.values.contexts[context].call {
                Some((caller, call)) if !self.branches.contains(&function) => {
                    (context, at) = (caller, call);
                }
                _ => {
                    let blocks = self.blocks.get(&function)?;
                    return Some((context, blocks[at.index()]));
                }
            }
        }
    }

    /// Inputs of the stage with such a binding.
    fn inputs(&self, is: &dyn Fn(&Binding) -> bool) -> Vec<ValueId> {
        let inputs = &self.values.inputs;
        let bound = |i: usize| inputs.get(i).and_then(|io| io.binding.as_ref());
        let values = self.values.values.iter().enumerate();
        values
            .filter(|(_, v)| matches!(v.node, Node::Input(i) if bound(i).is_some_and(is)))
            .map(|(id, _)| id)
            .collect()
    }

    /// The values of these expressions in each call of their functions.
    fn of(&self, expressions: &BTreeSet<(FunctionId, Handle<Expression>)>) -> BTreeSet<ValueId> {
        let is = |id: &ValueId| match self.values.values[*id].node {
            Node::Expression(context, e, _) => {
                expressions.contains(&(self.values.contexts[context].function, e))
            }
            _ => false,
        };
        (0..self.values.values.len()).filter(is).collect()
    }

    /// Bindings of the outputs that depend on these values.
    fn outputs_of(&self, values: BTreeSet<ValueId>) -> Vec<Option<Binding>> {
        let reached = self.reached(values);
        let outputs = self.values.outputs().into_iter();
        outputs
            .filter(|(_, root)| reached[*root])
            .map(|(binding, _)| binding)
            .collect()
    }

    /// All dependents of these values, including themselves.
    fn reached(&self, from: impl IntoIterator<Item = ValueId>) -> Vec<bool> {
        with_users(&self.values, from.into_iter().collect())
    }

    /// Whether a decision depends on the reached values: coverage, a discontinuity, a texture
    /// coordinate.
    fn decides(&self, reached: &[bool]) -> bool {
        let covers = self.values.coverage.iter().any(|root| reached[*root]);
        covers
            || (0..reached.len()).any(|id| {
                let rests = self.values.values[id].operands.iter().any(|o| reached[*o]);
                rests
                    && self.operations().whole(id).is_some_and(|(_, e)| {
                        matches!(e, Expression::ImageSample { .. }) || discontinuity(e).is_some()
                    })
            })
    }
}

/// The callees with more than one basic block, and the block numbers of all of them.
fn blocks(
    graph: &Graph<'_>,
    top: FunctionId,
) -> (BTreeSet<FunctionId>, BTreeMap<FunctionId, Vec<usize>>) {
    let mut branching = BTreeSet::new();
    let mut all = BTreeMap::new();
    // Callees precede their callers.
    for f in graph.functions() {
        if !graph.reaches(top, f.id) {
            continue;
        }
        let mut edges = vec![0; f.statements.len() + 1];
        for (id, node) in f.statements.iter() {
            let branches = match node.statement {
                Statement::If { .. } | Statement::Switch { .. } | Statement::Loop { .. } => true,
                Statement::Call { function, .. } => {
                    branching.contains(&FunctionId::Function(*function))
                }
                _ => false,
            };
            if branches {
                edges[id.index() + 1] += 1;
                edges[node.end.index()] += 1;
                branching.insert(f.id);
            }
        }
        let mut block = 0;
        let numbers = edges.into_iter().map(|more: usize| {
            block += more;
            block
        });
        all.insert(f.id, numbers.collect());
    }
    (branching, all)
}

/// An expression without its operands, with names in place of handles.
fn written(f: &FunctionGraph<'_>, module: &naga::Module, e: Handle<Expression>) -> String {
    let global = |g: Handle<naga::GlobalVariable>| {
        let g = &module.global_variables[g];
        format!("{:?} {:?}", g.name, g.binding)
    };
    let expression = &f.function.expressions[e];
    match expression {
        Expression::Literal(Literal::F32(v)) => format!("f32 {:x}", v.to_bits()),
        Expression::Literal(literal) => format!("{literal:?}"),
        Expression::Constant(c) => {
            let constant = &module.constants[*c];
            let value = &module.global_expressions[constant.init];
            format!("constant {:?} {value:?}", constant.name)
        }
        Expression::Override(o) => format!("override {:?}", module.overrides[*o].name),
        Expression::ZeroValue(_) => "zero".to_owned(),
        Expression::GlobalVariable(g) => global(*g),
        Expression::CallResult(_) => "call".to_owned(),
        Expression::LocalVariable(_) => "local".to_owned(),
        Expression::Load { pointer } => {
            let (mut at, mut steps) = (*pointer, Vec::new());
            loop {
                match f.function.expressions[at] {
                    Expression::AccessIndex { base, index } => {
                        steps.push(index);
                        at = base;
                    }
                    Expression::Access { base, .. } => {
                        steps.push(u32::MAX);
                        at = base;
                    }
                    Expression::GlobalVariable(g) => {
                        return format!("load {} {steps:?}", global(g));
                    }
                    _ => return "load".to_owned(),
                }
            }
        }
        Expression::Compose { .. } => "compose".to_owned(),
        other => {
            // Set all operands to the same handle.
            let mut shell = other.clone();
            let operands = naga_operands::of_expression(other);
            let Some(one) = operands.first() else {
                return format!("{shell:?}");
            };
            naga_operands::map_expression(&mut shell, &mut |o| *o = *one);
            format!("{shell:?}").replace(&format!("{one:?}"), "_")
        }
    }
}

fn hash(of: &(impl Hash + ?Sized)) -> u64 {
    let mut hasher = DefaultHasher::new();
    of.hash(&mut hasher);
    hasher.finish()
}
