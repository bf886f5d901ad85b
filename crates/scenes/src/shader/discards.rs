//! Finds inputs that make a shader discard some fragments and keep others.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use naga::{
    BinaryOperator, Expression, GlobalVariable, Handle, ImageClass, ImageDimension, Literal,
    ScalarKind, TypeInner,
};
use preshade_passes::analysis::values::{ContextId, Node, ValueId};

use super::flow::{BufferRead, StageFlow};
use preshade_draw::scene::layout::leaf_shape;
use preshade_draw::scene::{Image, Value, material};

/// Values by path, and images by texture name.
#[derive(Default)]
pub(super) struct DiscardInputs {
    pub values: BTreeMap<String, Value>,
    pub textures: BTreeMap<String, Arc<Image>>,
}

/// The middle of a texture channel's range.
const MIDDLE: f64 = 0.5;

/// The inputs that decide the discards of a fragment stage. The texture in the comparison gets a
/// pattern, the threshold the middle of its range, and the flags the values that enable it.
pub(super) fn inputs(flow: &StageFlow<'_, '_>) -> DiscardInputs {
    let mut found = DiscardInputs::default();
    let mut seen = BTreeSet::new();
    let roots = flow.values.coverage.iter().copied();
    let mut work: Vec<ValueId> = roots.filter(|v| is_control(flow, *v)).collect();
    while let Some(value) = work.pop() {
        if !seen.insert(value) {
            continue;
        }
        match flow.expression(value) {
            Some((context, Expression::Binary { op, left, right }, _)) if is_comparison(*op) => {
                let sides = [*left, *right].map(|e| flow.values.named(context, e));
                let literals = [*left, *right].map(|e| integer(flow, context, e));
                match (literals, sides) {
                    ([None, Some(literal)], [Some(side), _])
                    | ([Some(literal), None], [_, Some(side)]) => {
                        flag(flow, side, *op, literal, &mut found);
                    }
                    _ => compared(flow, sides.into_iter().flatten(), &mut found),
                }
            }
            _ => work.extend(&flow.values.values[value].operands),
        }
    }
    found
}

fn is_control(flow: &StageFlow<'_, '_>, value: ValueId) -> bool {
    matches!(flow.values.values[value].node, Node::Control(..))
}

fn is_comparison(op: BinaryOperator) -> bool {
    use BinaryOperator as B;
    matches!(
        op,
        B::Less | B::LessEqual | B::Greater | B::GreaterEqual | B::Equal | B::NotEqual
    )
}

/// The value of an integer literal or constant.
fn integer(flow: &StageFlow<'_, '_>, context: ContextId, e: Handle<Expression>) -> Option<i64> {
    let module = flow.values.graph.module();
    let expression = match &flow.values.function(context).function.expressions[e] {
        Expression::Constant(c) => &module.global_expressions[module.constants[*c].init],
        other => other,
    };
    match expression {
        Expression::Literal(Literal::I32(n)) => Some(i64::from(*n)),
        Expression::Literal(Literal::U32(n)) => Some(i64::from(*n)),
        Expression::Literal(Literal::AbstractInt(n)) => Some(*n),
        _ => None,
    }
}

/// One term of a sum.
#[derive(Default)]
struct Term {
    /// Textures, each with the channel that is read. `None` for several channels.
    textures: Vec<(Handle<GlobalVariable>, Option<u32>)>,
    numbers: Vec<BufferRead>,
}

/// Fills the inputs of a comparison of two sums.
fn compared(
    flow: &StageFlow<'_, '_>,
    sides: impl Iterator<Item = ValueId>,
    found: &mut DiscardInputs,
) {
    let values = summands(flow, sides.collect());
    let terms: Vec<Term> = values.iter().map(|value| term(flow, *value)).collect();
    if terms.iter().all(|t| t.textures.is_empty()) {
        halves(flow, &values, found);
        return;
    }
    for term in &terms {
        // A factor of the texture gets 1, which preserves the texture's range.
        let number = match term.textures.is_empty() {
            true => MIDDLE,
            false => 1.0,
        };
        for read in &term.numbers {
            fill(flow, read, number, found);
        }
        for (texture, channel) in &term.textures {
            pattern(flow, *texture, *channel, found);
        }
    }
}

/// Gives 0.5 to a uniform that is compared with a varying value, such as a dither pattern, if its
/// made-up value is close to 0 or 1.
fn halves(flow: &StageFlow<'_, '_>, terms: &[ValueId], found: &mut DiscardInputs) {
    let module = flow.values.graph.module();
    let is_input = |v: &ValueId| flow.input(*v).is_some();
    if !terms.iter().any(|v| flow.behind(*v).iter().any(is_input)) {
        return;
    }
    for read in terms.iter().flat_map(|value| flow.factors(*value)) {
        let is_extreme = |n: f64| (0.0..=1.0).contains(&n) && (n - MIDDLE).abs() > MIDDLE / 2.0;
        if read.is_uniform(module)
            && let Some([number]) = read.made_up(module).as_deref()
            && is_extreme(*number)
        {
            fill(flow, &read, MIDDLE, found);
        }
    }
}

/// The terms of sums and differences.
fn summands(flow: &StageFlow<'_, '_>, mut work: Vec<ValueId>) -> Vec<ValueId> {
    let mut seen = BTreeSet::new();
    let mut found = Vec::new();
    while let Some(value) = work.pop() {
        match flow.expression(flow.through(value)) {
            _ if !seen.insert(value) => {}
            Some((
                context,
                Expression::Binary {
                    op: BinaryOperator::Add | BinaryOperator::Subtract,
                    left,
                    right,
                },
                _,
            )) => {
                let sides = [*left, *right].map(|e| flow.values.named(context, e));
                work.extend(sides.into_iter().flatten());
            }
            _ => found.push(value),
        }
    }
    found
}

/// The textures and numbers that are factors of a value.
fn term(flow: &StageFlow<'_, '_>, value: ValueId) -> Term {
    let module = flow.values.graph.module();
    let mut term = Term::default();
    let mut seen = BTreeSet::new();
    // Each value with the component that is read from it.
    let mut work = vec![(value, None)];
    while let Some((value, mut channel)) = work.pop() {
        if !seen.insert(value) || is_control(flow, value) {
            continue;
        }
        if let Some(read) = flow.read(value) {
            term.numbers.push(read);
            continue;
        }
        if let Some((context, expression, _)) = flow.expression(value) {
            let f = flow.values.function(context);
            match *expression {
                Expression::ImageSample { image, .. } | Expression::ImageLoad { image, .. } => {
                    let image = &f.function.expressions[image];
                    if let Expression::GlobalVariable(texture) = image {
                        term.textures.push((*texture, channel));
                    }
                    continue;
                }
                Expression::AccessIndex { base, index }
                    if matches!(f.ty(module, base), TypeInner::Vector { .. }) =>
                {
                    channel = Some(index);
                }
                Expression::Swizzle { pattern, .. } => channel = Some(pattern[0] as u32),
                Expression::Load { pointer } => {
                    if let Expression::AccessIndex { base, index } = f.function.expressions[pointer]
                        && let Some(pointee) = pointee(module, f.ty(module, base))
                        && matches!(pointee, TypeInner::Vector { .. })
                    {
                        channel = Some(index);
                    }
                }
                _ => {}
            }
        }
        let operands = flow.values.values[value].operands.iter();
        work.extend(operands.map(|o| (*o, channel)));
    }
    term
}

fn pointee<'m>(module: &'m naga::Module, ty: &TypeInner) -> Option<&'m TypeInner> {
    match ty {
        TypeInner::Pointer { base, .. } => Some(&module.types[*base].inner),
        _ => None,
    }
}

/// Gives a float variable this number in all components, regardless of its name.
fn fill(flow: &StageFlow<'_, '_>, read: &BufferRead, number: f64, found: &mut DiscardInputs) {
    let module = flow.values.graph.module();
    let Some((1, _, scalar)) = leaf_shape(&module.types[read.ty].inner) else {
        return;
    };
    if scalar.kind == ScalarKind::Float {
        // One number fills the variable, even if it is an array of vectors.
        let number = Value::Numbers(vec![number]);
        found.values.entry(read.text(module)).or_insert(number);
    }
}

/// Gives a texture a pattern with high and low values in this channel.
fn pattern(
    flow: &StageFlow<'_, '_>,
    texture: Handle<GlobalVariable>,
    channel: Option<u32>,
    found: &mut DiscardInputs,
) {
    let module = flow.values.graph.module();
    let global = &module.global_variables[texture];
    let TypeInner::Image {
        dim: dim @ ImageDimension::D2,
        class: ImageClass::Sampled { .. },
        ..
    } = module.types[global.ty].inner
    else {
        return;
    };
    let kind = match channel {
        Some(0..=2) => "noise",
        _ => "alpha",
    };
    if let Some(name) = &global.name {
        let image = material::default_texture(kind, dim);
        found.textures.insert(name.clone(), image);
    }
}

/// Gives an integer that a discard depends on the value that the condition requires.
fn flag(
    flow: &StageFlow<'_, '_>,
    side: ValueId,
    op: BinaryOperator,
    literal: i64,
    found: &mut DiscardInputs,
) {
    let module = flow.values.graph.module();
    let side = flow.through(side);
    let (read, value) = match flow.expression(side) {
        // `flags & MASK`, compared with 0.
        Some((
            context,
            Expression::Binary {
                op: BinaryOperator::And,
                left,
                right,
            },
            _,
        )) => {
            let sides = [*left, *right];
            let mask = sides.into_iter().find_map(|e| integer(flow, context, e));
            let read = |e| flow.read(flow.through(flow.values.named(context, e)?));
            (sides.into_iter().find_map(read), mask)
        }
        _ => {
            let value = match op {
                BinaryOperator::Equal | BinaryOperator::GreaterEqual => Some(literal),
                BinaryOperator::NotEqual | BinaryOperator::Greater => literal.checked_add(1),
                _ => None,
            };
            (flow.read(side), value)
        }
    };
    let (Some(read), Some(value)) = (read, value) else {
        return;
    };
    let Some((1, 1, scalar)) = leaf_shape(&module.types[read.ty].inner) else {
        return;
    };
    if !matches!(scalar.kind, ScalarKind::Sint | ScalarKind::Uint) {
        return;
    }
    let before = found.values.remove(&read.text(module));
    let before = match before {
        Some(Value::Numbers(numbers)) => numbers.first().copied().unwrap_or(0.0) as i64,
        _ => 0,
    };
    let number = Value::Numbers(vec![(before | value) as f64]);
    found.values.insert(read.text(module), number);
}
