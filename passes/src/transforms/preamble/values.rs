//! Finds the values of a stage that the draw alone decides, and chooses those to compute once a
//! draw.
//!
//! A driver's compiler does this after linking (Mesa's `nir_opt_preamble`, Arm's pilot shaders). A
//! minimum cut ([`crate::analysis::cut`]) weighs the saving of a value in each invocation against
//! reading it back, and a value below another that moves costs nothing more. If the values don't
//! fit into the room, we raise the price of reading until they do.

use std::collections::BTreeSet;

use naga::{AddressSpace, Expression, Handle, ResourceBinding, ScalarKind};

use crate::analysis::contraction::{self, Pruned};
use crate::analysis::cut::{self, Cut};
use crate::analysis::loops::{LoopEnds, iterated};
use crate::analysis::reach::{with_operands, with_users};
use crate::analysis::rounding::Roundings;
use crate::analysis::subnormal;
use crate::analysis::transitive_cost::{is_cheap, transitive_cost};
use crate::analysis::values::{ContextId, Node, ValueId, Values};
use preshade_dataflow::graph::rate::Rate;
use preshade_plan::pass::SourceRange;

/// Cost of reading a stored scalar, in the units of [`preshade_dataflow::graph::cost`]: a load, and a register that
/// it takes.
const READ: f64 = 2.0;

/// Multiples of the price of reading to try. Higher prices move fewer values.
const SWEEP: [f64; 12] = [
    1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 10.0, 16.0, 32.0, 64.0, 128.0, 256.0,
];

/// The possible change by moving a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Class {
    /// None: no compiler fuses it into its readers.
    Exact,
    /// A compiler may fuse it into a reader, so the bits may differ.
    Rounded,
}

/// Why a value that only the draw decides stays.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum NotOncePerDraw {
    /// It changes more often, or never.
    NotOfDraw,
    /// It is no whole 32-bit scalar or vector, or costs no more than reading it.
    NotWorth,
    /// It depends on an input of the stage.
    Input,
    /// It depends on a texture that another pass of the frame may write.
    Texture,
    /// It depends on a storage buffer.
    Buffer,
    /// It depends on immediate data.
    Immediate,
    /// It depends on an override.
    Override,
    /// It changes between iterations of a loop.
    InLoop,
    /// It depends on a loop that may not end.
    MayNotEnd,
    /// Not every invocation computes it.
    Conditional,
    /// It depends on a number that may be subnormal in the scene.
    Subnormal,
    /// It decides coverage or depth, and may round differently.
    Coverage,
    /// Its rounding may change an output too far.
    RoundsFar,
}

impl std::fmt::Display for NotOncePerDraw {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::NotOfDraw => "the draw alone does not decide it",
            Self::NotWorth => "it costs no more than reading it back",
            Self::Input => "it depends on an input that a compute stage does not have",
            Self::Texture => {
                "it depends on a texture, which an earlier pass of the frame may draw to"
            }
            Self::Buffer => {
                "it depends on a storage buffer, which an earlier pass of the frame may write"
            }
            Self::Immediate => "it depends on immediate data, which differ from pass to pass",
            Self::Override => "it depends on an override, which the compiler knows",
            Self::InLoop => "it changes with each iteration of a loop",
            Self::MayNotEnd => "it depends on a loop that may not end",
            Self::Conditional => "some fragments do not compute it",
            Self::Subnormal => {
                "it depends on a subnormal number, which some stages of a driver take for 0"
            }
            Self::Coverage => {
                "it decides a discard, a depth or the sample mask, and a compiler may fuse it \
                 into what reads it"
            }
            Self::RoundsFar => {
                "a compiler may fuse it into what reads it, and its rounding may change an output \
                 visibly"
            }
        })
    }
}

/// The verdicts on a stage's values.
#[derive(Clone, Debug)]
pub struct Verdicts {
    pub verdicts: Vec<Result<Class, NotOncePerDraw>>,
    roundings: Roundings,
    most: f64,
}

/// Judges the values of a stage. `known` are ranges of its sources, `most` the largest change of an
/// output by rounding. `is_steady`: whether no other pass of the frame writes the texture.
pub(crate) fn judge(
    values: &Values<'_, '_>,
    known: &[SourceRange],
    most: f64,
    is_steady: &dyn Fn(&ResourceBinding) -> bool,
) -> Verdicts {
    let unsteady = contraction::unsteady(values);
    let is_of_draw = |id: ValueId| values.values[id].fact.rate == Rate::Draw;
    let may = |id: ValueId| is_of_draw(id) && unsteady[id];
    let roundings = Roundings::new(values, known, &unsteady, may);
    let coverage = with_operands(values, values.coverage.clone());
    let (ends, iterated) = (LoopEnds::new(values), iterated(values));
    let foreign = foreign(values, is_steady);
    let subnormal = subnormal::changed(values, known);
    let verdicts = (0..values.values.len())
        .map(|id| {
            if !is_of_draw(id) {
                return Err(NotOncePerDraw::NotOfDraw);
            }
            let width = shape(values, id).ok_or(NotOncePerDraw::NotWorth)?;
            let (context, _, at) = values.expression(id).ok_or(NotOncePerDraw::NotWorth)?;
            if is_cheap(values, id, READ * f64::from(width)) {
                return Err(NotOncePerDraw::NotWorth);
            }
            match foreign[id] {
                Some(stays) => Err(stays),
                None if subnormal[id] => Err(NotOncePerDraw::Subnormal),
                // The compute pass runs for draws that cover nothing, too.
                None if !ends.may_end(id) => Err(NotOncePerDraw::MayNotEnd),
                None if iterated[id] => Err(NotOncePerDraw::InLoop),
                None if values.control_rate(context, at) > Rate::Draw => {
                    Err(NotOncePerDraw::Conditional)
                }
                None if !unsteady[id] => Ok(Class::Exact),
                None if coverage[id] => Err(NotOncePerDraw::Coverage),
                None if roundings.of(id) <= most => Ok(Class::Rounded),
                None => Err(NotOncePerDraw::RoundsFar),
            }
        })
        .collect();
    Verdicts {
        verdicts,
        roundings,
        most,
    }
}

/// For each value, a dependence of it or its condition that a compute stage lacks or might read too
/// early.
fn foreign(
    values: &Values<'_, '_>,
    is_steady: &dyn Fn(&ResourceBinding) -> bool,
) -> Vec<Option<NotOncePerDraw>> {
    let module = values.graph.module();
    let own = |id: ValueId| match values.values[id].node {
        Node::Input(_) => Some(NotOncePerDraw::Input),
        Node::Expression(context, e, _) => {
            let f = values.function(context);
            match &f.function.expressions[e] {
                read if texture(read).is_some() => {
                    let at = texture(read).and_then(|image| binding(values, context, image));
                    (!at.is_some_and(is_steady)).then_some(NotOncePerDraw::Texture)
                }
                Expression::Override(_) => Some(NotOncePerDraw::Override),
                Expression::Load { pointer } => match f.ty(module, *pointer).pointer_space() {
                    Some(AddressSpace::Immediate) => Some(NotOncePerDraw::Immediate),
                    Some(AddressSpace::Storage { .. }) => Some(NotOncePerDraw::Buffer),
                    _ => None,
                },
                _ => None,
            }
        }
        Node::Version(..) | Node::Control(..) => None,
    };
    let mut found = vec![None; values.values.len()];
    for stays in [
        NotOncePerDraw::Input,
        NotOncePerDraw::Texture,
        NotOncePerDraw::Buffer,
        NotOncePerDraw::Immediate,
        NotOncePerDraw::Override,
    ] {
        let all = 0..values.values.len();
        let from = all.filter(|id| own(*id) == Some(stays)).collect();
        for (known, reached) in found.iter_mut().zip(with_users(values, from)) {
            *known = known.or(reached.then_some(stays));
        }
    }
    let of_draw = |id: &ValueId| values.values[*id].fact.rate <= Rate::Draw;
    let conditions = (0..found.len()).map(|id| found[values.condition(id).filter(of_draw)?]);
    let conditions: Vec<Option<NotOncePerDraw>> = conditions.collect();
    for (known, condition) in found.iter_mut().zip(conditions) {
        *known = known.or(condition);
    }
    found
}

/// The texture that an expression reads or measures.
fn texture(expression: &Expression) -> Option<Handle<Expression>> {
    match expression {
        Expression::ImageSample { image, .. }
        | Expression::ImageLoad { image, .. }
        | Expression::ImageQuery { image, .. } => Some(*image),
        _ => None,
    }
}

/// Where a texture is bound; `None` for an element of an array of textures, and in a function that is given one.
fn binding<'p>(
    values: &Values<'_, 'p>,
    context: ContextId,
    image: Handle<Expression>,
) -> Option<&'p ResourceBinding> {
    match values.function(context).function.expressions[image] {
        Expression::GlobalVariable(global) => values.graph.module().global_variables[global]
            .binding
            .as_ref(),
        _ => None,
    }
}

/// Names of the textures that values and their conditions depend on.
pub(crate) fn textures(values: &Values<'_, '_>, ids: &[ValueId]) -> BTreeSet<String> {
    let conditions = ids.iter().filter_map(|id| values.condition(*id));
    let needed = with_operands(values, ids.iter().copied().chain(conditions).collect());
    let needed = (0..needed.len()).filter(|id| needed[*id]);
    let module = values.graph.module();
    let named = needed.filter_map(|id| {
        let Node::Expression(context, e, _) = values.values[id].node else {
            return None;
        };
        let expressions = &values.function(context).function.expressions;
        match expressions[texture(&expressions[e])?] {
            Expression::GlobalVariable(global) => module.global_variables[global].name.clone(),
            _ => None,
        }
    });
    named.collect()
}

/// Number of components of a 32-bit scalar or vector of numbers.
fn shape(values: &Values<'_, '_>, id: ValueId) -> Option<u8> {
    let (scalar, width) = values.shape(id)?;
    (scalar.width == 4 && scalar.kind != ScalarKind::Bool).then_some(width)
}

/// The restrictions of a choice.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Terms {
    /// The weakest class that may move.
    pub weakest: Class,
    /// Most vectors of four scalars to store.
    pub limit: u32,
    /// Least static cost that each invocation must save.
    pub least: f64,
}

/// The values to compute once a draw.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct StoredValues {
    /// The values, in the order in which they are stored.
    pub moved: Vec<ValueId>,
    pub class: Class,
    /// Number of operations that may round differently.
    pub roundings: u32,
    /// Static cost of an invocation before.
    pub before: f64,
    /// Static cost of an invocation after, with reading.
    pub after: f64,
    /// Static cost of the draw's own work.
    pub once: f64,
}

/// The choice that saves an invocation most; `None` if none saves enough.
pub(crate) fn choose(
    values: &Values<'_, '_>,
    judged: &Verdicts,
    terms: &Terms,
) -> Option<StoredValues> {
    let before = cut::uncut(values)?;
    let items = cut::items(values, |id| price(values, judged, terms.weakest, id));
    let pruned = Pruned::new(values);
    let decides = with_operands(values, values.coverage.clone());
    let mut best: Option<StoredValues> = None;
    for cut in cut::sweep(&items, &values.roots, &SWEEP)? {
        let anew = pruned.rounded_anew(|id| cut.computed[id], |_| true);
        if anew.iter().any(|id| decides[*id]) {
            continue;
        }
        let after = cut.total(&items);
        let saved = before - after;
        if saved <= 0.0 || saved < terms.least || best.as_ref().is_some_and(|b| b.after <= after) {
            continue;
        }
        let choice = choice(values, judged, &cut, &anew, [before, after]);
        best = choice
            .filter(|c| c.class <= terms.weakest && rows(values, &c.moved) <= terms.limit)
            .or(best);
    }
    best
}

/// The values of a cut; `None` if there is none, or if they round too far.
fn choice(
    values: &Values<'_, '_>,
    judged: &Verdicts,
    cut: &Cut,
    anew: &[ValueId],
    [before, after]: [f64; 2],
) -> Option<StoredValues> {
    let class_of = |id: &ValueId| judged.verdicts[*id].as_ref().ok();
    let mut moved = cut.carried.clone();
    moved.retain(|id| class_of(id).is_some());
    let rounded = moved.iter().copied();
    let rounded: Vec<ValueId> = rounded
        .filter(|id| class_of(id) == Some(&Class::Rounded))
        .collect();
    let is_exact = rounded.is_empty() && anew.is_empty();
    if moved.is_empty() || (!is_exact && judged.roundings.together(&rounded, anew) > judged.most) {
        return None;
    }
    let roundings =
        transitive_cost(values, rounded.iter().copied()).0.ceil() as u32 + anew.len() as u32;
    Some(StoredValues {
        moved: stored(values, moved.clone()),
        class: match is_exact {
            true => Class::Exact,
            false => Class::Rounded,
        },
        roundings,
        before,
        after,
        once: transitive_cost(values, moved.into_iter()).0,
    })
}

/// Values in the order that leaves few gaps: a vector of three is followed by a scalar.
fn stored(values: &Values<'_, '_>, moved: Vec<ValueId>) -> Vec<ValueId> {
    let of = |width: u8| {
        let all = moved.iter().copied();
        all.filter(move |id| shape(values, *id) == Some(width))
    };
    let mut scalars = of(1);
    let mut order: Vec<ValueId> = of(4).collect();
    for three in of(3) {
        order.push(three);
        order.extend(scalars.next());
    }
    order.extend(of(2));
    order.extend(scalars);
    order
}

/// Vectors of four scalars that values take in this order.
fn rows(values: &Values<'_, '_>, stored: &[ValueId]) -> u32 {
    let widths = stored.iter().filter_map(|id| shape(values, *id));
    let end = widths.map(u32::from).fold(0_u32, |end, width| {
        let align = width.next_power_of_two();
        end.next_multiple_of(align) + width
    });
    end.div_ceil(4)
}

/// The cost for an invocation of reading a value; `None`: its class is weaker than `weakest`, or it
/// must not move.
fn price(values: &Values<'_, '_>, judged: &Verdicts, weakest: Class, id: ValueId) -> Option<f64> {
    let is_allowed = matches!(judged.verdicts[id], Ok(class) if class <= weakest);
    let width = shape(values, id).filter(|_| is_allowed)?;
    Some(READ * f64::from(width))
}
