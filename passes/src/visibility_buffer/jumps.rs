//! Where a rounding of what a resolve interpolates may become any difference of a colour.
//!
//! A rasteriser and a resolve interpolate the same function of real numbers, and round differently. What follows passes that on as a rounding, until an operation jumps: a
//! comparison at the edge, a `floor` at an integer, a shadow test. What does not vary, the pixel's place, its side and flat values are the same in both.

use naga::{
    Binding, BuiltIn, DerivativeControl, Expression, Handle, ImageDimension, MathFunction,
    ResourceBinding, SampleLevel, Span, SwizzleComponent, TypeInner,
};

use super::steep;
use crate::graph::Graph;
use crate::hoist::jumps::jump;
use crate::hoist::values::{ContextId, Node, TooLarge, ValueId, Values};
use crate::program::Program;
use crate::reflect::{self, Io};

/// What roundings of interpolated values reach, in a fragment stage sliced to its colours.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reached {
    /// The first operation that jumps, and its place.
    pub jump: Option<(String, Span)>,
    /// The first operation whose slope has no bound, and its place.
    pub steep: Option<(&'static str, Span)>,
    /// Samples whose coordinates or level round otherwise, which is continuous if their sampler filters.
    pub samples: Vec<Sample>,
    /// What the stage takes anywhere of neighbours that are the driver's choice.
    pub taken: Taken,
    /// Something interpolated is read.
    pub interpolated: bool,
    /// The place of the first sample whose implicit level has a bias: a resolve scales gradients by 2 to the bias, and a sampler adds the bias to the level.
    pub biased: Option<Span>,
    /// The place of the first sample of a cube at an implicit level: of which gradients, and on which face, is the driver's choice, and gradients that are given are treated otherwise.
    pub cube: Option<Span>,
    /// A varying is interpolated linearly on the screen: between which corners, where the triangle is clipped, is the driver's choice.
    pub linear: bool,
}

/// A sample of a texture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// The sampler, where that is one that is known.
    pub sampler: Option<ResourceBinding>,
    /// Whether the level, and along which line a filter may be anisotropic, comes of gradients.
    pub by_gradients: bool,
    /// Where it stands.
    pub span: Span,
}

/// What a fragment stage takes of its neighbours, where the driver chooses which they are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Taken {
    /// `dpdx`, `dpdy`, `fwidth`.
    pub derivatives: bool,
    /// Those that are `Coarse`.
    pub coarse: bool,
    /// Samples at an implicit level, but of cubes.
    pub samples: bool,
    /// Such samples of cubes.
    pub cubes: bool,
}

impl Taken {
    /// Whether there is anything.
    pub fn any(self) -> bool {
        self != Self::default()
    }
}

/// Follows them from the inputs of the fragment entry point of that index.
///
/// # Errors
/// The stage has too many values.
pub fn reached(program: &Program, entry: usize) -> Result<Reached, TooLarge> {
    let graph = Graph::build(program);
    let values = Values::new(&graph, entry)?;
    let module = program.module();
    let inputs = reflect::inputs(module, &module.entry_points[entry].function);
    let users = values.users();
    let mut is_rounded = vec![false; values.values.len()];
    let mut work: Vec<ValueId> = Vec::new();
    let is_position = |id: ValueId| match values.values[id].node {
        Node::Input(input) => matches!(inputs.get(input).map(kind), Some(Kind::Position)),
        _ => false,
    };
    for (id, value) in values.values.iter().enumerate() {
        let Node::Input(input) = value.node else {
            continue;
        };
        match inputs.get(input).map(kind) {
            Some(Kind::Interpolated | Kind::Position) => work.push(id),
            Some(Kind::Same) | None => {}
        }
    }
    let expressions = values.values.iter().filter_map(|v| match &v.node {
        Node::Expression(context, e, _) => {
            let expressions = &values.function(*context).function.expressions;
            Some((&expressions[*e], expressions.get_span(*e)))
        }
        _ => None,
    });
    let is_biased = |e: &Expression| {
        let biased = |level: &SampleLevel| matches!(level, SampleLevel::Bias(_));
        matches!(e, Expression::ImageSample { level, .. } if biased(level))
    };
    let implicit = values.values.iter().filter_map(|v| {
        let Node::Expression(context, e, _) = &v.node else {
            return None;
        };
        let f = values.function(*context);
        let Expression::ImageSample {
            image,
            level: SampleLevel::Auto | SampleLevel::Bias(_),
            ..
        } = f.function.expressions[*e]
        else {
            return None;
        };
        let cube = ImageDimension::Cube;
        let is_cube = matches!(f.ty(module, image), TypeInner::Image { dim, .. } if *dim == cube);
        Some((is_cube, f.function.expressions.get_span(*e)))
    });
    let derives = |wanted: DerivativeControl| {
        expressions
            .clone()
            .any(|(e, _)| matches!(e, Expression::Derivative { ctrl, .. } if *ctrl == wanted))
    };
    let cube = implicit.clone().find(|(is_cube, _)| *is_cube);
    let is_linear = |input: &Io| {
        let linear = Some(naga::Interpolation::Linear);
        matches!(input.binding, Some(Binding::Location { interpolation, .. }) if interpolation == linear)
    };
    let mut out = Reached {
        taken: Taken {
            derivatives: derives(DerivativeControl::None),
            coarse: derives(DerivativeControl::Coarse),
            samples: implicit.clone().any(|(is_cube, _)| !is_cube),
            cubes: cube.is_some(),
        },
        interpolated: inputs.iter().any(|i| matches!(kind(i), Kind::Interpolated)),
        biased: expressions
            .clone()
            .find_map(|(e, span)| is_biased(e).then_some(span)),
        cube: cube.map(|(_, span)| span),
        linear: inputs.iter().any(is_linear),
        ..Reached::default()
    };
    let mut first: Option<ValueId> = None;
    // A resolve makes gradients of its own of what an implicit level is of.
    let implicit = |id: &ValueId| sample(&values, *id).is_some_and(|(_, level)| is_implicit(level));
    let mut samples: Vec<ValueId> = (0..values.values.len()).filter(implicit).collect();
    while let Some(id) = work.pop() {
        if std::mem::replace(&mut is_rounded[id], true) {
            continue;
        }
        let of_position = is_position(id);
        for user in &users[id] {
            let expression = match &values.values[*user].node {
                Node::Expression(context, e, _) => {
                    let expressions = &values.function(*context).function.expressions;
                    Some((&expressions[*e], expressions.get_span(*e)))
                }
                _ => None,
            };
            let Some((expression, span)) = expression else {
                work.push(*user);
                continue;
            };
            if of_position && is_place(expression) {
                continue;
            }
            // A depth, a w: made between the same corners.
            out.interpolated |= of_position;
            samples.extend(sample(&values, *user).map(|_| *user));
            // Of several, the one that stands first among the values: always the same.
            if let Some(name) = jumps(expression)
                && first.is_none_or(|f| *user < f)
            {
                first = Some(*user);
                out.jump = Some((name, span));
            }
            work.push(*user);
        }
    }
    // In the order of the values, which is always the same; several operands of one may be rounded.
    samples.sort_unstable();
    samples.dedup();
    let samples = samples.into_iter();
    out.samples = samples
        .filter_map(|id| Some(sample(&values, id)?.0))
        .collect();
    out.steep = steep::steep(&values, &is_rounded).map(|(id, name)| {
        let span = match &values.values[id].node {
            Node::Expression(context, e, _) => {
                values.function(*context).function.expressions.get_span(*e)
            }
            _ => Span::UNDEFINED,
        };
        (name, span)
    });
    Ok(out)
}

enum Kind {
    Interpolated,
    /// Its x and y are the pixel's.
    Position,
    /// The same for rasteriser and resolve.
    Same,
}

fn kind(input: &Io) -> Kind {
    match &input.binding {
        Some(Binding::Location {
            interpolation: Some(naga::Interpolation::Flat),
            ..
        }) => Kind::Same,
        Some(Binding::Location { .. }) => Kind::Interpolated,
        Some(Binding::BuiltIn(BuiltIn::Position { .. })) => Kind::Position,
        _ => Kind::Same,
    }
}

/// The sample that a value is, and its level.
fn sample<'p>(values: &Values<'_, 'p>, id: ValueId) -> Option<(Sample, &'p SampleLevel)> {
    let Node::Expression(context, e, _) = values.values[id].node else {
        return None;
    };
    let expressions = &values.function(context).function.expressions;
    let Expression::ImageSample { sampler, level, .. } = &expressions[e] else {
        return None;
    };
    let sample = Sample {
        sampler: binding(values, context, *sampler),
        by_gradients: !matches!(level, SampleLevel::Zero | SampleLevel::Exact(_)),
        span: expressions.get_span(e),
    };
    Some((sample, level))
}

fn is_implicit(level: &SampleLevel) -> bool {
    matches!(level, SampleLevel::Auto | SampleLevel::Bias(_))
}

/// The binding that an expression of a fragment stage is; `None` where it is not known to be one.
fn binding(
    values: &Values<'_, '_>,
    context: ContextId,
    resource: Handle<Expression>,
) -> Option<ResourceBinding> {
    let Node::Expression(context, e, _) = values.values[values.named(context, resource)?].node
    else {
        return None;
    };
    let Expression::GlobalVariable(global) = values.function(context).function.expressions[e]
    else {
        return None;
    };
    values.graph.module().global_variables[global].binding
}

/// Whether of a position no more is taken than the pixel's place.
fn is_place(expression: &Expression) -> bool {
    use SwizzleComponent::{X, Y};
    match expression {
        Expression::AccessIndex { index, .. } => *index < 2,
        Expression::Swizzle { size, pattern, .. } => {
            pattern[..*size as usize].iter().all(|c| matches!(c, X | Y))
        }
        _ => false,
    }
}

/// The name of an operation that makes any difference of a rounding in one of its operands.
fn jumps(expression: &Expression) -> Option<String> {
    match expression {
        // Of a number that is rounded: an integer is not, or its own conversion has jumped.
        Expression::As {
            kind: naga::ScalarKind::Float,
            ..
        } => None,
        Expression::ImageSample {
            gather: Some(_), ..
        } => Some("a gathered texel".to_owned()),
        Expression::ImageSample {
            depth_ref: Some(_), ..
        } => Some("a depth comparison".to_owned()),
        Expression::Math {
            fun:
                MathFunction::Pack4x8snorm
                | MathFunction::Pack4x8unorm
                | MathFunction::Pack2x16snorm
                | MathFunction::Pack2x16unorm
                | MathFunction::Pack2x16float,
            ..
        } => Some("packing".to_owned()),
        _ => jump(expression).map(str::to_owned),
    }
}
