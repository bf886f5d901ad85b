//! The values of a fragment stage to compute once for every 2x2 pixels, and the other values that
//! show where that goes wrong.
//!
//! A minimum cut ([`crate::analysis::cut`]) weighs the cost of a value for each pixel against
//! reading it back. Many cuts save nearly the same: a colour can be carried as it is, or the light
//! in it, while each pixel multiplies it with its own texel. So among the cuts that save nearly the
//! most we take the one that leaves most work to the pixels: it keeps most of the detail finer than
//! two pixels ([`choose`]).
//!
//! A guide is a value that the stage loads at the pixel itself and that the carried values are
//! computed from (a depth, a normal, a position). Where neighbours differ in it, the carried value
//! is likely to differ too. A value that only chooses the coordinates of other loads is no guide: a
//! rotation of taps by a texture of noise differs from pixel to pixel, and carries no information
//! about the surface.

use naga::{BinaryOperator, Expression, Handle, MathFunction, ScalarKind, Statement};

use crate::analysis::cut::{self, Cut, Item};
use crate::analysis::loops::{LoopEnds, iterated};
use crate::analysis::named;
use crate::analysis::reach::{with_operands, with_users};
use crate::analysis::transitive_cost::{is_cheap, transitive_cost};
use crate::analysis::values::{ContextId, Node, ValueId, Values};
use preshade_dataflow::graph::StmtId;
use preshade_dataflow::graph::rate::Rate;

/// Most float components to carry.
pub(crate) const MOST_CARRIED: u8 = 4;

/// Words of a texel: two targets of `rgba32uint` have as many bytes as WebGPU lets a pass draw to
/// (`maxColorAttachmentBytesPerSample`).
pub(crate) const MOST_WORDS: u32 = 8;

/// Cost of a carried number for each pixel, in the units of [`preshade_dataflow::graph::cost`]: it is unpacked and
/// weighted four times.
const READ: f64 = 12.0;

/// Cost of the four loads from a target, and of their weights.
const LOADS: f64 = 64.0;
const WEIGHTS: f64 = 24.0;
/// Cost of comparing a guide with those of four neighbours.
const COMPARED: f64 = 48.0;

/// Multiples of the price of reading to try. Higher prices leave more work to the pixels.
const SWEEP: [f64; 12] = [
    1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 10.0, 16.0, 32.0, 64.0, 128.0, 256.0,
];

/// The part of the best saving that is enough.
const ENOUGH: f64 = 0.9;

/// Most cost of a guide: a sample, and its coordinate.
const MOST_GUIDE: f64 = 64.0;

/// Why a value stays in each pixel's stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum NotHalved {
    /// Larger areas than a few pixels share it.
    Uniform,
    /// It is no float, or vector of at most four.
    Shape,
    /// It costs no more than reading it back.
    Cheap,
    /// It decides a discard, a depth or the sample mask.
    Coverage,
    /// It changes between iterations of a loop.
    InLoop,
    /// Not every pixel computes it.
    Conditional,
    /// It depends on a loop that may not end, or runs in one, and no guard can bound the loop. The half-rate stage leaves
    /// out the returns and discards that may protect from it.
    MayNotEnd,
    /// It depends on a texel that the slow part does not need.
    Fine,
}

impl std::fmt::Display for NotHalved {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Uniform => "the draw decides it",
            Self::Shape => "it is no number, or vector of numbers, of 32-bit floats",
            Self::Cheap => "it costs no more than reading it back",
            Self::Coverage => "it decides a discard, a depth or the sample mask",
            Self::InLoop => "it changes with each iteration of a loop",
            Self::Conditional => "some pixels do not compute it",
            Self::MayNotEnd => "it depends on a loop that may not end",
            Self::Fine => "it keeps the detail of a texel",
        })
    }
}

/// The verdicts on a stage's values, by value.
pub(crate) fn judge(values: &Values<'_, '_>) -> Vec<Result<(), NotHalved>> {
    let coverage = with_operands(values, values.coverage.clone());
    let (ends, iterated) = (LoopEnds::new(values), iterated(values));
    (0..values.values.len())
        .map(|id| {
            let width = width(values, id).ok_or(NotHalved::Shape)?;
            let (context, _, at) = values.expression(id).ok_or(NotHalved::Shape)?;
            match () {
                () if values.values[id].fact.rate <= Rate::Draw => Err(NotHalved::Uniform),
                () if is_cheap(values, id, READ * f64::from(width)) => Err(NotHalved::Cheap),
                () if coverage[id] => Err(NotHalved::Coverage),
                () if !ends.may_end(id) => Err(NotHalved::MayNotEnd),
                () if iterated[id] => Err(NotHalved::InLoop),
                () if !is_always_run(values, context, at) => Err(NotHalved::Conditional),
                () => Ok(()),
            }
        })
        .collect()
}

/// Whether every invocation runs a statement. Returns of the entry point do not count: the
/// half-rate stage leaves them out.
fn is_always_run(values: &Values<'_, '_>, mut context: ContextId, mut at: StmtId) -> bool {
    loop {
        let f = values.function(context);
        let mut around = f.statements.ancestors(at);
        let is_free = f.control.of(at).is_empty();
        let is_plain =
            !around.any(|s| !matches!(f.statements.get(s).statement, Statement::Block(_)));
        if !is_free && values.control_rate(context, at) > Rate::Draw && !(context == 0 && is_plain)
        {
            return false;
        }
        match values.contexts[context].call {
            Some((caller, call)) => (context, at) = (caller, call),
            None => return true,
        }
    }
}

/// Number of components of a value of 32-bit floats.
pub(crate) fn width(values: &Values<'_, '_>, id: ValueId) -> Option<u8> {
    let (scalar, width) = values.shape(id)?;
    (scalar.width == 4 && scalar.kind == ScalarKind::Float).then_some(width)
}

/// The values to compute at half rate, with their guides.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct CarriedValues {
    pub moved: Vec<ValueId>,
    pub guides: Vec<ValueId>,
    /// Static cost of a pixel before.
    pub before: f64,
    /// Static cost of a pixel after, with reading and a quarter of the half-rate stage.
    pub after: f64,
    /// Static cost of the half-rate stage.
    pub half: f64,
}

impl CarriedValues {
    /// Static cost that a pixel saves.
    pub fn saved(&self) -> f64 {
        self.before - self.after
    }
}

/// The choice that saves at least `least` and nearly the most; `None` if there is none. `guide`
/// selects the guides to use.
///
/// A texel of the pixel that the slow part does not need stays with the pixels, if that saves
/// nearly as much: then it keeps its detail, and guides nothing.
pub(crate) fn choose(
    values: &Values<'_, '_>,
    verdicts: &[Result<(), NotHalved>],
    least: f64,
    guide: &dyn Fn(ValueId) -> bool,
) -> Option<CarriedValues> {
    let mut best = cheapest(values, verdicts, least, guide)?;
    let enough = ENOUGH * best.saved();
    let mut verdicts = verdicts.to_vec();
    for texel in guides(values, &best.moved) {
        let mut apart = verdicts.clone();
        for (verdict, depends) in apart.iter_mut().zip(with_users(values, vec![texel])) {
            if depends {
                *verdict = Err(NotHalved::Fine);
            }
        }
        let choice = cheapest(values, &apart, least, guide);
        if let Some(choice) = choice.filter(|c| c.saved() >= enough) {
            (best, verdicts) = (choice, apart);
        }
    }
    Some(best)
}

fn cheapest(
    values: &Values<'_, '_>,
    verdicts: &[Result<(), NotHalved>],
    least: f64,
    guide: &dyn Fn(ValueId) -> bool,
) -> Option<CarriedValues> {
    let before = cut::uncut(values)?;
    let items = cut::items(values, |id| price(values, verdicts, id));
    let cuts = cut::sweep(&items, &values.roots, &SWEEP)?;
    let choices = cuts.iter().filter_map(|cut| {
        let choice = choice(values, verdicts, &items, cut, before, guide)?;
        (choice.saved() >= least.max(1.0)).then_some(choice)
    });
    let choices: Vec<CarriedValues> = choices.collect();
    let most = choices.iter().map(CarriedValues::saved).fold(0.0, f64::max);
    choices.into_iter().rfind(|c| c.saved() >= ENOUGH * most)
}

fn choice(
    values: &Values<'_, '_>,
    verdicts: &[Result<(), NotHalved>],
    items: &[Item<'_>],
    cut: &Cut,
    before: f64,
    guide: &dyn Fn(ValueId) -> bool,
) -> Option<CarriedValues> {
    let mut moved = cut.carried.clone();
    moved.retain(|id| verdicts[*id].is_ok());
    let carried: u8 = moved.iter().filter_map(|id| width(values, *id)).sum();
    if moved.is_empty() || carried > MOST_CARRIED {
        return None;
    }
    let mut widths = Vec::new();
    let mut guides = guides(values, &moved);
    guides.retain(|id| {
        let with = || widths.iter().copied().chain(width(values, *id));
        let fits = guide(*id) && words(carried, with()) <= MOST_WORDS;
        if fits {
            widths = with().collect();
        }
        fits
    });
    let targets = words(carried, widths.into_iter()).div_ceil(4);
    let half = transitive_cost(values, moved.iter().chain(&guides).copied()).0;
    let read = LOADS * f64::from(targets) + WEIGHTS + COMPARED * guides.len() as f64;
    Some(CarriedValues {
        after: cut.total(items)
            + transitive_cost(values, guides.iter().copied()).0
            + read
            + half / 4.0,
        moved,
        guides,
        before,
        half,
    })
}

/// Words of so many carried numbers and of guides of these widths. A scalar keeps its precision, which a
/// depth needs; vectors are halves, two a word.
pub(crate) fn words(carried: u8, guides: impl Iterator<Item = u8>) -> u32 {
    let (mut words, mut halves) = (u32::from(carried), 0);
    for width in guides {
        match width {
            1 => words += 1,
            _ => halves += u32::from(width),
        }
    }
    words + halves.div_ceil(2)
}

/// The author's name for a guide, or for its texture.
pub(crate) fn guide_name(values: &Values<'_, '_>, id: ValueId) -> String {
    if let Some(name) = named::name(values, id) {
        return name;
    }
    let texel = std::iter::once(&id).chain(&values.values[id].operands);
    let found = texel.copied().find_map(|id| lookup(values, id));
    let image =
        found.map(|(context, image, _)| &values.function(context).function.expressions[image]);
    let variable = match image {
        Some(Expression::GlobalVariable(variable)) => Some(*variable),
        _ => None,
    };
    let module = values.graph.module();
    let name = variable.and_then(|v| module.global_variables[v].name.clone());
    name.unwrap_or_else(|| "a texel".to_owned())
}

/// The cost of giving a value to each pixel; `None`: it must not move.
fn price(values: &Values<'_, '_>, verdicts: &[Result<(), NotHalved>], id: ValueId) -> Option<f64> {
    let width = width(values, id).filter(|_| verdicts[id].is_ok())?;
    Some(READ * f64::from(width))
}

/// Values that are loaded at the pixel itself, and on which `moved` depend other than through a
/// coordinate; one for each texture, in the order of evaluation.
fn guides(values: &Values<'_, '_>, moved: &[ValueId]) -> Vec<ValueId> {
    let mut seen = vec![false; values.values.len()];
    let mut work = moved.to_vec();
    let mut loads = Vec::new();
    while let Some(id) = work.pop() {
        if std::mem::replace(&mut seen[id], true) {
            continue;
        }
        match lookup(values, id) {
            Some(lookup) => loads.push((id, lookup)),
            None => work.extend(&values.values[id].operands),
        }
    }
    loads.sort_unstable_by_key(|(id, _)| values.expression(*id).map(|(c, _, at)| (c, at)));
    let mut found: Vec<(ValueId, Handle<Expression>, ContextId)> = Vec::new();
    for (id, (context, image, coordinate)) in loads {
        let is_same = |(_, e, c): &(_, Handle<Expression>, ContextId)| {
            let of = |c: ContextId, e| &values.function(c).function.expressions[e];
            of(*c, *e) == of(context, image)
        };
        if found.iter().any(is_same) || !is_own(values, context, coordinate, MOST_STEPS) {
            continue;
        }
        let part = narrowed(values, id, &seen);
        let is_fit = |id: ValueId| {
            let Some((context, _, at)) = values.expression(id) else {
                return false;
            };
            width(values, id).is_some()
                && is_always_run(values, context, at)
                && transitive_cost(values, std::iter::once(id)).0 <= MOST_GUIDE
        };
        if is_fit(part) {
            found.push((part, image, context));
        }
    }
    found.into_iter().map(|(id, ..)| id).collect()
}

/// The texture and the coordinate of a load or a sample.
fn lookup(
    values: &Values<'_, '_>,
    id: ValueId,
) -> Option<(ContextId, Handle<Expression>, Handle<Expression>)> {
    let (context, e, _) = values.expression(id)?;
    match values.function(context).function.expressions[e] {
        Expression::ImageLoad {
            image, coordinate, ..
        }
        | Expression::ImageSample {
            image,
            coordinate,
            offset: None,
            ..
        } => Some((context, image, coordinate)),
        _ => None,
    }
}

/// The components of a texel that are used, if one expression takes them all.
fn narrowed(values: &Values<'_, '_>, id: ValueId, used: &[bool]) -> ValueId {
    let mut users = values.users()[id].iter().filter(|user| used[**user]);
    let is_part = |id: ValueId| {
        let e = values
            .expression(id)
            .map(|(context, e, _)| &values.function(context).function.expressions[e]);
        matches!(
            e,
            Some(Expression::Swizzle { .. } | Expression::AccessIndex { .. })
        )
    };
    match (users.next(), users.next()) {
        (Some(user), None) if is_part(*user) => *user,
        _ => id,
    }
}

/// Most operations between the pixel's place and a coordinate.
const MOST_STEPS: u32 = 24;

/// Whether a coordinate is the pixel's own: its position or a varying, scaled, rounded or mirrored, but
/// not moved.
fn is_own(values: &Values<'_, '_>, context: ContextId, e: Handle<Expression>, left: u32) -> bool {
    let id = values.named(context, e);
    id.is_some_and(|id| is_own_value(values, id, left))
}

fn is_own_value(values: &Values<'_, '_>, id: ValueId, left: u32) -> bool {
    let value = &values.values[id];
    let Some(left) = left.checked_sub(1).filter(|_| value.fact.rate > Rate::Draw) else {
        return false;
    };
    let Node::Expression(context, e, _) = &value.node else {
        // A variable that one place writes.
        let varies = |o: &&ValueId| values.values[**o].fact.rate > Rate::Draw;
        let mut operands = value.operands.iter().filter(varies);
        return match (
            matches!(value.node, Node::Input(_)),
            operands.next(),
            operands.next(),
        ) {
            (true, ..) => true,
            (false, Some(one), None) => is_own_value(values, *one, left),
            _ => false,
        };
    };
    let context = *context;
    let own = |e: Handle<Expression>| is_own(values, context, e, left);
    let rate = |e: Handle<Expression>| {
        let id = values.named(context, e);
        id.map_or(Rate::Const, |id| values.values[id].fact.rate)
    };
    let fixed = |e: Handle<Expression>| rate(e) <= Rate::Draw;
    match &values.function(context).function.expressions[*e] {
        Expression::AccessIndex { base: of, .. }
        | Expression::Swizzle { vector: of, .. }
        | Expression::As { expr: of, .. }
        | Expression::Splat { value: of, .. } => own(*of),
        Expression::Compose { components, .. } => components.iter().all(|c| own(*c) || fixed(*c)),
        Expression::Math {
            fun: MathFunction::Floor | MathFunction::Trunc | MathFunction::Round,
            arg,
            ..
        } => own(*arg),
        Expression::Math {
            fun: MathFunction::Clamp | MathFunction::Min | MathFunction::Max,
            arg,
            arg1,
            arg2,
            ..
        } => own(*arg) && [arg1, arg2].into_iter().flatten().all(|e| fixed(*e)),
        Expression::Binary { op, left, right } => match op {
            BinaryOperator::Multiply => {
                (own(*left) && fixed(*right)) || (fixed(*left) && own(*right))
            }
            BinaryOperator::Divide => own(*left) && fixed(*right),
            // `1 - y`.
            BinaryOperator::Subtract => rate(*left) == Rate::Const && own(*right),
            _ => false,
        },
        Expression::Load { .. } | Expression::CallResult(_) => {
            let varies = |o: &&ValueId| values.values[**o].fact.rate > Rate::Draw;
            let mut operands = value.operands.iter().filter(varies);
            match (operands.next(), operands.next()) {
                (Some(one), None) => is_own_value(values, *one, left),
                _ => false,
            }
        }
        _ => false,
    }
}
